//! Others on the machine: another user, a full memory file system. None costs a run its results.

use std::os::unix::fs::MetadataExt;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

use crate::command::{Desk, assert_nothing_left, finish, run_of, skipped};

pub(crate) fn is_root() -> bool {
    std::fs::metadata("/proc/self").is_ok_and(|own| own.uid() == 0)
}

/// A command of another user.
fn neighbour(script: &str) -> Output {
    Command::new("sh")
        .args(["-c", script])
        .uid(65534)
        .gid(65534)
        .current_dir("/")
        .output()
        .expect("a shell")
}

pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn another_user_costs_a_run_neither_its_results_nor_its_cleaning() {
    if !is_root() {
        return skipped("only root can be another user too");
    }
    let desk = Desk::new();
    let target = desk.file("target", "x");
    let mode = || std::fs::metadata(&target).unwrap().mode();
    let before = mode();
    let run = desk.begin("run --set segment.1.duration_s=5 --json --no-record --out r");
    let name = run_of(run.id()).unwrap();
    // A look-alike of a dead run, and files that bear the name of the living one.
    let dead = "/dev/shm/armplane-0-4194998-1f-0";
    let script = format!(
        "touch /dev/shm/{name}.x && ln -s {} /dev/shm/{name}.link && mkdir {dead} && touch {dead}.y",
        target.display()
    );
    let planted = neighbour(&script);
    let said = finish(run);
    let cleaned = desk.armplane("clean");
    let left: Vec<bool> = [format!("/dev/shm/{name}.x"), format!("{dead}.y")]
        .iter()
        .map(|path| Path::new(path).exists())
        .collect();
    for path in [
        format!("/dev/shm/{name}.x"),
        format!("/dev/shm/{name}.link"),
        format!("{dead}.y"),
    ] {
        let _ = std::fs::remove_file(path);
    }
    let _ = std::fs::remove_dir(dead);
    assert!(planted.status.success(), "{}", text(&planted.stderr));
    assert_eq!(
        (said.code, desk.path().join("r/summary.json").exists()),
        (0, true),
        "{}",
        said.err
    );
    assert_eq!(
        (cleaned.code, left),
        (0, vec![true; 2]),
        "foreign files are no concern of ours: {}",
        cleaned.err
    );
    assert_eq!(mode(), before);
    assert_nothing_left(said.launcher);
}

#[test]
fn a_full_memory_file_system_is_refused_in_bytes_and_one_that_fills_up_later_costs_nothing() {
    let desk = Desk::new();
    let within = |size: &str, script: &str| {
        let mounted = format!("mount -t tmpfs -o size={size} tmpfs /dev/shm || exit 77; {script}");
        Command::new("unshare")
            .args(["-m", "sh", "-c", &mounted, env!("CARGO_BIN_EXE_armplane")])
            .current_dir(desk.path())
            .output()
            .expect("unshare")
    };
    let refused = within("8m", "\"$0\" run --out small");
    if refused.status.code() == Some(77) || text(&refused.stderr).contains("unshare") {
        return skipped("this machine lets no test mount a file system");
    }
    let said = text(&refused.stderr);
    assert!(
        refused.status.code() == Some(1)
            && said.contains("bytes are missing")
            && said.lines().count() == 1,
        "{said}"
    );
    assert!(!desk.path().join("small").exists(), "nothing began");
    let filled = within(
        "48m",
        "\"$0\" run --set segment.1.duration_s=5 --json --out filled > out.json & run=$!
         until test -n \"$(ls /dev/shm/*.connection 2>/dev/null)\"; do sleep 0.01; done; sleep 0.5
         cat /dev/zero > /dev/shm/filler 2>/dev/null; wait $run; code=$?; rm /dev/shm/filler; ls /dev/shm; exit $code",
    );
    assert_eq!(
        (filled.status.code(), text(&filled.stdout)),
        (Some(0), String::new()),
        "{}",
        text(&filled.stderr)
    );
    let summary: Value = desk.read_json("filled/summary.json");
    assert_eq!(
        (&summary["outcome"], &summary["recorder"]["lost"]),
        (&"goal reached".into(), &0.into())
    );
}
