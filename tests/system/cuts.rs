//! Runs that go on after the death of their launcher. `tests/transcripts/cuts.txt` has those that go on by order.

use serde_json::Value;

use crate::command::{Desk, Known, Running, children_of_run, until};

/// Which faults of a run happened.
fn occurred(run: &Value) -> Vec<(&Value, &Value)> {
    let faults = run["faults"].as_array().expect("faults");
    let faults = faults.iter().filter(|fault| !fault["plan"].is_null());
    faults
        .map(|fault| (&fault["tick"], &fault["occurred"]))
        .collect()
}

/// Goes on from these ticks of the run in `whole`, which has these results.
fn goes_on(desk: &Desk, whole: &Value, ticks: impl Iterator<Item = u64>) {
    for tick in ticks {
        let again = desk.run(&format!("--from whole@{tick} --out again"));
        assert_eq!(again["topics"], whole["topics"], "from {tick}");
        assert_eq!(again["task"], whole["task"], "from {tick}");
        assert_eq!(occurred(&again), occurred(whole), "from {tick}");
        again.holds(&format!(r#"{{"recorder/lost": 0, "from/tick": {tick}}}"#));
    }
}

#[test]
#[ignore = "ten minutes: 300 ticks and 100 deaths of a launcher, drawn at random"]
fn every_tick_and_every_moment_will_do() {
    let desk = Desk::new();
    desk.golden("motion.toml");
    let whole = desk.run("motion.toml --out whole");
    let last = whole["ticks"].count() - 1;
    let tick = |i: u64| 1 + runtime::random(11, i) % last;
    goes_on(&desk, &whole, (0..300).map(tick));
    let moment = |i: u64| runtime::random(12, i) % last;
    let killed = survives(&desk, &whole, (0..100).map(moment));
    assert!(killed >= 90, "{killed} runs of 100 still lived");
}

/// Kills the launcher of the run in `whole` once it has done so many ticks, each time, and goes on. Returns how many were killed in time.
fn survives(desk: &Desk, whole: &Value, ticks: impl Iterator<Item = u64>) -> usize {
    let mut killed = 0;
    for least in ticks {
        let run = desk.start("run motion.toml --out r");
        until("the tick", || {
            run.ticks() > least || desk.has("r/summary.json")
        });
        run.signal("KILL");
        let launcher = run.finish().launcher;
        until("the processes to go", || {
            children_of_run(launcher).is_empty()
        });
        if !desk.has("r/summary.json") {
            let said = desk.armplane("recover r --json");
            assert_eq!(said.code, 0, "{}", said.err);
            let summary = said.json();
            assert_eq!(summary["topics"], whole["topics"], "{least}");
            assert_eq!(summary["task"], whole["task"], "{least}");
            assert_eq!(occurred(&summary), occurred(whole), "{least}");
            killed += 1;
        }
        let left = std::fs::read_dir("/dev/shm").unwrap().flatten();
        let of_run = format!("-{launcher}-");
        let left = left.filter(|one| one.file_name().to_string_lossy().contains(&of_run));
        assert_eq!(left.count(), 0, "{least}");
        std::fs::remove_dir_all(desk.at("r")).unwrap();
    }
    killed
}

#[test]
fn a_run_whose_launcher_was_killed_goes_on_to_the_bytes_of_the_undisturbed_run() {
    let desk = Desk::new();
    desk.golden("motion.toml");
    let whole = desk.run("motion.toml --out whole");
    let killed = survives(&desk, &whole, [0, 700, 1500, 2600].into_iter());
    assert!(killed > 1, "all but {killed} were quicker");
}
