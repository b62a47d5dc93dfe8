//! A run for other tools.

use std::path::{Path, PathBuf};

use shared_types::scenario::Layout;
use viz::RECORDING;

use crate::drawing::{Read, Record, draw};
use crate::failure::Failure;
use crate::launch::interrupts;
use crate::layout::save_blueprint;
use crate::progress::Observer;
use crate::runs::Run;

/// A form of [`export`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportFormat {
    /// Tables.
    Numbers(viz::ExportFormat),
    /// The recording for the viewer.
    Recording,
    /// A layout for the viewer, by default the scenario's.
    Layout(Option<Layout>),
}

/// The result of [`export`].
#[derive(Clone, Debug)]
pub struct Export {
    /// The files.
    pub files: Vec<PathBuf>,
    /// The last tick in them.
    pub last_tick: Option<u64>,
    /// One sentence, where the record holds less than the run: how much of it, why, and the remedy.
    pub shortfall: Option<String>,
}

/// Writes a run in another form into a folder, as far as its record can be read. Each file takes its place when it is whole.
///
/// # Errors
/// [`Failure::Input`] if the run has no record, or no tick of it can be read: nothing is written then; [`Failure::Work`] if a file cannot be written, or a
/// signal has come.
pub fn export(
    run: &Run,
    format: ExportFormat,
    out: &Path,
    observer: Observer<'_>,
) -> Result<Export, Failure> {
    let make_folder = || {
        files::make_folder(out)
            .map_err(|error| Failure::Input(format!("cannot write to {}: {error}", out.display())))
    };
    if let ExportFormat::Layout(layout) = format {
        make_folder()?;
        let layout = layout.map_or_else(|| run.job().map(|job| job.scenario.view.layout), Ok)?;
        let path = out.join(format!("{}.rbl", layout.name()));
        save_blueprint(run, layout, &path)?;
        return Ok(Export {
            files: vec![path],
            last_tick: None,
            shortfall: None,
        });
    }
    let record = Record::open(run)?;
    make_folder()?;
    let (files, Read { last, lacks }) =
        record.make("export", &mut interrupts()?, observer, |source| {
            let ExportFormat::Numbers(format) = format else {
                let path = out.join(RECORDING);
                draw(source, &path, observer).map_err(Failure::work)?;
                return Ok(vec![path]);
            };
            viz::export(format, out, source).map_err(Failure::work)
        });
    Ok(Export {
        files: files?,
        last_tick: last,
        shortfall: (!lacks.is_empty()).then(|| run.with_remedy(&lacks.join("; "))),
    })
}

/// Clauses in one sentence, but for those that are empty.
pub(crate) fn joined(clauses: [&str; 2]) -> String {
    let mut clauses = clauses.to_vec();
    clauses.retain(|clause| !clause.is_empty());
    clauses.join("; ")
}
