//! `armplane view`: a recording in the installed Rerun viewer.

use std::path::{Path, PathBuf};

use clap::Args;
use session::{Failure, Run, save_blueprint, show, viewer_command};
use shared_types::scenario::Layout;

use crate::layout::layout;
use crate::out::say;
use crate::progress::observe;

#[derive(Args)]
pub(crate) struct ViewArgs {
    /// The run's folder, or its name under runs/ [default: the latest].
    #[arg(value_name = "RUN")]
    run: Option<PathBuf>,
    /// Layout to open [default: the scenario's].
    #[arg(long, value_parser = layout, value_name = "control|timing")]
    layout: Option<Layout>,
}

pub(crate) fn view(args: &ViewArgs, as_json: bool) -> Result<bool, Failure> {
    let is_file =
        |path: &&PathBuf| path.is_file() && path.extension().is_some_and(|it| it == "rrd");
    if let Some(file) = args.run.as_ref().filter(is_file) {
        show_file(file, None, as_json)?;
        return Ok(true);
    }
    let run = Run::find(args.run.as_deref())?;
    let shown = session::shown(&run, &observe)?;
    let saved = |layout: Layout| {
        let path = run.folder.join(format!("{}.rbl", layout.name()));
        save_blueprint(&run, layout, &path).map(|()| path)
    };
    let layout = args.layout.map(saved).transpose()?;
    if let Some(sentence) = &shown.lack {
        observe(session::Progress::Line(&format!("armplane: {sentence}")));
    }
    show_file(&shown.file, layout.as_deref(), as_json)?;
    // The viewer shows less than the run was.
    Ok(shown.lack.is_none())
}

fn show_file(file: &Path, layout: Option<&Path>, as_json: bool) -> Result<(), Failure> {
    if as_json {
        let files: Vec<_> = [file].into_iter().chain(layout).collect();
        say!(
            "{}",
            serde_json::json!({"viewer": viewer_command(), "files": files})
        );
    }
    show(file, layout, &observe)
}
