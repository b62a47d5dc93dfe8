//! Others on the machine: another user, a full memory file system. None costs a run its results.

use std::os::unix::fs::MetadataExt;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Output};

use crate::command::{Desk, Known, assert_nothing_left, run_of, skipped};

pub(crate) fn is_root() -> bool {
    std::fs::metadata("/proc/self").is_ok_and(|own| own.uid() == 0)
}

pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A script, in which `$0` is armplane, where a small volume is in the place of a folder; `None` where this machine lets no test mount one.
pub(crate) fn on_volume(desk: &Desk, folder: &str, size: &str, script: &str) -> Option<Output> {
    let script = format!("mount -t tmpfs -o size={size} tmpfs {folder} || exit 77; {script}");
    let mut unshare = desk.program("unshare");
    unshare.args(["-m", "sh", "-c", &script, env!("CARGO_BIN_EXE_armplane")]);
    let output = unshare.output().expect("unshare");
    let is_refused = output.status.code() == Some(77) || text(&output.stderr).contains("unshare");
    (!is_refused).then_some(output)
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
    let [file, look_alike, link] = [
        format!("/dev/shm/{name}.x"),
        format!("{dead}.y"),
        format!("/dev/shm/{name}.link"),
    ];
    let script = format!(
        "touch {file} && ln -s {} {link} && mkdir {dead} && touch {look_alike}",
        target.display()
    );
    let mut neighbour = Command::new("sh");
    neighbour
        .args(["-c", &script])
        .uid(65534)
        .gid(65534)
        .current_dir("/");
    let planted = neighbour.status().expect("a shell");
    let launcher = run.id();
    let ended = run.wait_with_output().expect("armplane ends");
    let cleaned = desk.armplane("clean");
    let left = [&file, &look_alike].map(|path| Path::new(path).exists());
    for path in [file, link, look_alike] {
        let _ = std::fs::remove_file(path);
    }
    let _ = std::fs::remove_dir(dead);
    assert!(planted.success());
    // Foreign files are no concern of ours.
    assert!(ended.status.success(), "{}", text(&ended.stderr));
    assert_eq!((cleaned.code, left), (0, [true; 2]), "{}", cleaned.err);
    assert_nothing_left(launcher);
    assert!(desk.has("r/summary.json"));
    assert_eq!(mode(), before);
}

#[test]
fn a_full_memory_file_system_is_refused_in_bytes_and_one_that_fills_up_later_costs_nothing() {
    let desk = Desk::new();
    let within = |size: &str, script: &str| on_volume(&desk, "/dev/shm", size, script);
    let Some(refused) = within("8m", "\"$0\" run --out small") else {
        return skipped("this machine lets no test mount a file system");
    };
    let said = text(&refused.stderr);
    assert!(
        refused.status.code() == Some(1) && said.contains(" bytes ") && said.lines().count() == 1,
        "{said}"
    );
    assert!(!desk.has("small"), "nothing began");
    let filled = within(
        "48m",
        "\"$0\" run --set segment.1.duration_s=5 --json --out filled > out.json & run=$!
         until test -n \"$(ls /dev/shm/*.connection 2>/dev/null)\"; do sleep 0.01; done; sleep 0.5
         cat /dev/zero > /dev/shm/filler 2>/dev/null; wait $run; code=$?; rm /dev/shm/filler; ls /dev/shm; exit $code",
    );
    let filled = filled.expect("a volume");
    assert_eq!(filled.status.code(), Some(0), "{}", text(&filled.stderr));
    assert_eq!(text(&filled.stdout), "", "left in /dev/shm");
    desk.read_json("filled/summary.json")
        .holds(r#"{"outcome": "goal reached", "recorder/lost": 0}"#);
}
