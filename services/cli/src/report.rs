//! `armplane report`: a run as one HTML page.

use std::path::PathBuf;

use clap::Args;
use files::Draft;
use session::table::size;
use session::{Failure, Run};

use crate::out::{answer, whole};
use crate::progress::observe;

#[derive(Args)]
pub(crate) struct ReportArgs {
    /// The run's folder, or its name under runs/ [default: the latest].
    #[arg(value_name = "RUN")]
    run: Option<PathBuf>,
    /// Where to write the page [default: report.html in the run's folder].
    #[arg(long, value_name = "FILE.html")]
    out: Option<PathBuf>,
}

pub(crate) fn report(args: &ReportArgs, as_json: bool) -> Result<bool, Failure> {
    let run = Run::find(args.run.as_deref())?;
    let path = args
        .out
        .clone()
        .unwrap_or_else(|| run.folder.join(session::REPORT));
    let is_file = path.symlink_metadata().is_ok_and(|it| it.is_file());
    if path.extension().map_or(is_file, |ending| ending != "html") {
        return Err(Failure::Input(format!(
            "--out {}: a report is a page: choose a name that ends with .html",
            path.display()
        )));
    }
    let session::Page { text, shortfall } = session::report(&run, &observe)?;
    Draft::write(&path, &text).map_err(|error| {
        Failure::Work(format!(
            "cannot write {}: {error}; choose another file with --out",
            path.display()
        ))
    })?;
    let (page, bytes) = (path.display(), size(text.len() as u64));
    answer(
        as_json,
        &serde_json::json!({"file": path, "bytes": text.len()}),
        &format_args!("{page}  {bytes}; open it with any browser\n"),
    );
    whole(shortfall)
}
