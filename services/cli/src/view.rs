//! `armplane view`: a recording in the installed Rerun viewer.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use session::{Failure, Run, save_blueprint, show, viewer_command};
use shared_types::scenario::Layout;

use crate::layout::layout;
use crate::out::{passed, say};
use crate::progress::observe;

#[derive(Args)]
pub(crate) struct ViewArgs {
    /// The run's folder, or its name under runs/ [default: the latest].
    #[arg(value_name = "RUN")]
    run: Option<PathBuf>,
    /// Layout to open [default: the scenario's].
    #[arg(long, value_parser = layout, value_name = "control|timing|faults")]
    layout: Option<Layout>,
}

pub(crate) fn view(args: &ViewArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let run = Run::find(args.run.as_deref())?;
    let files = run.recording()?;
    let layout = args
        .layout
        .map(|layout| (layout, run.folder.join(format!("{}.rbl", layout.name()))));
    if let Some((layout, path)) = &layout {
        save_blueprint(&run, *layout, path)?;
    }
    let layout = layout.map(|(_, path)| path);
    if as_json {
        say!(
            "{}",
            serde_json::json!({"viewer": viewer_command(), "files": files.iter().chain(&layout).collect::<Vec<_>>()})
        );
    }
    let altered = run.altered();
    if let Some(sentence) = &altered {
        observe(session::Progress::Line(&format!("armplane: {sentence}")));
    }
    show(files, layout.as_deref(), &observe)?;
    // The viewer may show something else than the run did.
    passed(altered.is_none())
}
