//! `armplane clean`.

use launcher::folders::remove_abandoned;
use serde_json::json;

use crate::out::say;
use session::Failure;

pub(crate) fn clean(as_json: bool) -> Result<bool, Failure> {
    let removed = runtime::RunDir::remove_stale().map_err(Failure::work)?;
    let folders = remove_abandoned().map_err(Failure::work)?;
    if as_json {
        let removed: Vec<_> =
            removed.iter().map(|run| json!({"run": run.name, "launcher_pid": run.launcher_pid, "bytes": run.bytes})).collect();
        say!("{}", json!({"removed": removed, "folders": folders}));
    } else if removed.is_empty() && folders.is_empty() {
        say!(
            "nothing to clean: no dead run has left anything in {} or the temporary folder",
            runtime::SHM
        );
    } else {
        for run in &removed {
            say!(
                "removed {} ({:.1} MB), left by launcher {}",
                run.name,
                run.bytes as f64 / 1e6,
                run.launcher_pid
            );
        }
        for folder in &folders {
            say!(
                "removed {}, left by an experiment that was killed",
                folder.display()
            );
        }
    }
    Ok(true)
}
