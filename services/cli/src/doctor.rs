//! `armplane doctor`: what the machine offers, what is missing, and what to do about it.

use launcher::doctor::{checks, examine};
use serde_json::json;

use crate::out::say;
use session::Failure;

pub(crate) fn doctor(as_json: bool) -> Result<bool, Failure> {
    let health = examine();
    let checks = checks(&health);
    let sound = checks.iter().all(|check| check.good || check.optional);
    if as_json {
        let list: Vec<_> = checks
            .iter()
            .map(|check| json!({"check": check.what, "good": check.good, "optional": check.optional, "finding": check.finding, "remedy": if check.good { "" } else { check.remedy }}))
            .collect();
        let runs: Vec<_> = health
            .runs
            .iter()
            .map(|run| json!({"run": run.name, "launcher_pid": run.launcher_pid, "alive": run.alive, "bytes": run.bytes}))
            .collect();
        say!("{}", json!({"sound": sound, "checks": list, "runs": runs}));
    } else {
        for check in &checks {
            let mark = match (check.good, check.optional) {
                (true, _) => "ok  ",
                (false, true) => "note",
                (false, false) => "FAIL",
            };
            say!("{mark}  {:<18} {}", check.what, check.finding);
            if !check.good {
                say!("      {:<18} → {}", "", check.remedy);
            }
        }
    }
    Ok(sound)
}
