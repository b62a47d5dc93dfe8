//! `armplane sweep`: the same bytes as five processes, kills survived, shards put together, bad input in a sentence.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::command::{Desk, finish, until};

/// A short task, so that a sweep of it takes a moment.
const SCENARIO: &str = "name = \"short\"\nrobot = \"puma560\"\nsettle_s = 0.05\n[start]\nq_deg = [20, -60, 170, 0, 30, 0]\n[[segment]]\nby_m = [0.02, 0.0, -0.01]\nduration_s = 0.4\n";

fn desk() -> Desk {
    let desk = Desk::new();
    desk.file("short.toml", SCENARIO);
    desk
}

fn sweep_file(desk: &Desk, name: &str, more: &str) {
    desk.file(&format!("{name}.toml"), &format!("name = \"{name}\"\nscenario = \"short.toml\"\n{more}"));
}

/// Every file of the table by its name.
fn tables(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder.join("runs")).expect("the folder of the table").flatten();
    entries.map(|entry| (entry.file_name().into_string().unwrap(), std::fs::read(entry.path()).unwrap())).collect()
}

fn report(desk: &Desk, args: &[&str]) -> Value {
    let said = desk.armplane(&[&["sweep", "report"], args, &["--json"]].concat());
    assert_eq!(said.code, 0, "{}", said.err);
    serde_json::from_str(&said.out).expect("the report is JSON")
}

/// Gains, masses, noise, start, laws, an analysis by number, a faulty sensor: drawn at random, and run in five processes too.
#[test]
fn runs_drawn_at_random_have_the_bytes_of_five_processes() {
    let desk = Desk::new();
    let fault = "[[fault]]\nprocess = \"plant\"\nkind = \"sensor\"\nas = \"bias\"\njoint = 5\namount = 0.01\nat_s = 0.1\nfor_s = 0.2\n";
    desk.file("short.toml", &[SCENARIO, fault].concat());
    let keys = [
        ("control.strategy", "values = [\"blended\", \"chang-khatib\", \"damped-least-squares\", \"joint-pd\"]"),
        ("control.k_p", "from = 100\nto = 900\nscale = \"log\""),
        ("plant.mass_factor", "from = 0.8\nto = 1.2"),
        ("plant.encoder_noise_counts", "from = 0\nto = 3"),
        ("plant.friction", "values = [true, false]"),
        ("start.q_deg.4", "from = -5\nto = 40"),
        ("analysis.numeric", "values = [true, false]"),
        ("fault.0.amount", "from = -0.05\nto = 0.05"),
        ("seed", "from = 1\nto = 1000000"),
    ];
    drawn_runs_are_those_of_five_processes(&desk, &keys, 6);
}

/// Two faults of any process and its messages, their kinds, ticks and lengths drawn at random, and run in five processes too.
#[test]
fn faults_drawn_at_random_have_the_bytes_of_five_processes() {
    let desk = Desk::new();
    let fault = |process: &str, kind: &str| format!("[[fault]]\nprocess = \"{process}\"\nkind = \"{kind}\"\nat_tick = 1\nfor_ticks = 1\n");
    desk.file("short.toml", &[SCENARIO, &fault("controller", "kill"), &fault("plant", "drop")].concat());
    let keys = [
        ("fault.0.process", "values = [\"estimator\", \"analyzer\", \"controller\"]"),
        ("fault.0.kind", "values = [\"kill\", \"crash\", \"hang\", \"cut\"]"),
        ("fault.0.at_tick", "from = 0\nto = 400"),
        ("fault.0.for_ticks", "from = 1\nto = 120"),
        ("fault.1.process", "values = [\"plant\", \"estimator\", \"analyzer\", \"controller\"]"),
        ("fault.1.kind", "values = [\"delay\", \"drop\", \"duplicate\", \"reorder\", \"stale\", \"corrupt\", \"zombie\"]"),
        ("fault.1.at_tick", "from = 0\nto = 400"),
        ("fault.1.for_ticks", "from = 1\nto = 120"),
        ("seed", "from = 1\nto = 1000000"),
    ];
    drawn_runs_are_those_of_five_processes(&desk, &keys, 12);
}

#[test]
fn a_steered_session_is_swept_and_has_the_bytes_of_five_processes() {
    let desk = Desk::new();
    let file = "name = \"steered\"\nscenario = \"servo-hostile\"\n[[key]]\nkey = \"seed\"\nvalues = [3]\n";
    desk.file("steered.toml", file);
    let said = desk.armplane(&["sweep", "steered.toml"]);
    assert_eq!(said.code, 0, "{}", said.err);
    let report = report(&desk, &["runs/steered", "--worst", "1"]);
    let run = &report["worst"][0];
    let summary = desk.run(&["servo-hostile", "--seed", "3", "--out", "r"]);
    assert_eq!((&run["outcome"], &run["hashes"]["torque"]), (&summary["outcome"], &summary["topics"]["torque"]["hash"]), "{report}");
    assert_eq!(run["hashes"]["servo_state"], summary["topics"]["servo_state"]["hash"], "{report}");
}

/// A sweep of runs drawn from `keys`: the command that it gives for each has the same hashes and figures in five processes.
fn drawn_runs_are_those_of_five_processes(desk: &Desk, keys: &[(&str, &str)], count: usize) {
    let keys: String = keys.iter().map(|(key, values)| format!("[[key]]\nkey = \"{key}\"\n{values}\n")).collect();
    sweep_file(desk, "drawn", &format!("{keys}[sample]\nruns = {count}\nseed = 5\n"));
    let said = desk.armplane(&["sweep", "drawn.toml"]);
    assert_eq!(said.code, 0, "{}", said.err);
    let report = report(desk, &["runs/drawn", "--worst", &count.to_string()]);
    let runs = report["worst"].as_array().unwrap();
    assert_eq!(runs.len(), count, "{report}");
    for run in runs {
        // The command as a person would paste it.
        let command = run["command"].as_str().unwrap().replacen("armplane", env!("CARGO_BIN_EXE_armplane"), 1);
        let said = Command::new("sh").args(["-c", &format!("{command} --json")]).current_dir(desk.path()).output().unwrap();
        let summary: Value = serde_json::from_slice(&said.stdout).unwrap_or_else(|_| panic!("{command}\n{said:?}"));
        assert_eq!(summary["outcome"], run["outcome"], "{command}");
        assert_eq!(summary["task"]["position_max_mm"], run["value"], "{command}");
        let hashes: BTreeMap<_, _> = summary["topics"].as_object().unwrap().iter().map(|(topic, it)| (topic, &it["hash"])).collect();
        // A topic that the run does not have is a column without a hash.
        let found: BTreeMap<_, _> = run["hashes"].as_object().unwrap().iter().filter(|(_, hash)| **hash != "–").collect();
        assert_eq!(found, hashes, "{command}");
        assert!(desk.path().join(format!("drawn-run-{}/run.rrd", run["run"])).exists(), "a recording");
    }
}

#[test]
fn a_sweep_that_is_killed_goes_on_and_its_table_is_that_of_one_piece() {
    let desk = desk();
    let keys = "partition = 5\n[[key]]\nkey = \"control.k_p\"\nfrom = 100\nto = 900\nsteps = 8\n[[key]]\nkey = \"seed\"\nfrom = 1\nto = 8\nsteps = 8\n";
    sweep_file(&desk, "killed", keys);
    assert_eq!(desk.armplane(&["sweep", "killed.toml", "--out", "whole"]).code, 0);
    let whole = tables(&desk.path().join("whole"));
    assert_eq!(whole.len(), 13);
    // Of a partition that has its table the journal may still be there.
    let finished = || {
        let out = desk.path().join("out");
        let tables = if out.join("runs").exists() { tables(&out) } else { BTreeMap::new() };
        let journals = std::fs::read_dir(out.join("journal")).into_iter().flatten().flatten().map(|entry| entry.path());
        let begun = journals.filter(|path| {
            let table = path.with_extension("parquet");
            path.extension().is_some_and(|extension| extension == "journal")
                && table.file_name().and_then(|name| name.to_str()).is_some_and(|name| !tables.contains_key(name))
        });
        let lines = |path| std::fs::read_to_string(path).map_or(0, |text| text.matches('\n').count());
        5 * tables.len() + begun.map(lines).sum::<usize>()
    };
    let (mut kills, mut seen) = (0, 0);
    for wanted in [3, 17, 31] {
        let mut child = desk.start(&["sweep", "killed.toml", "--out", "out"]);
        until("runs to be finished", || finished() >= wanted || child.try_wait().unwrap().is_some());
        child.kill().unwrap();
        kills += u32::from(finish(child).code == -1);
        assert!(finished() >= seen, "no run is lost");
        seen = finished();
    }
    assert!(kills > 0, "none of the kills came in time");
    let said = desk.armplane(&["sweep", "killed.toml", "--out", "out", "--json"]);
    assert_eq!(said.code, 0, "{}", said.err);
    let done: Value = serde_json::from_str(&said.out).unwrap();
    assert_eq!((&done["runs"], done["found"].as_u64()), (&64.into(), Some(seen.min(64) as u64)), "no run is repeated");
    assert!(tables(&desk.path().join("out")) == whole, "the same files");
    assert!(!desk.path().join("out/journal").exists());
    let said = desk.armplane(&["sweep", "killed.toml", "--out", "out", "--json"]);
    assert_eq!(serde_json::from_str::<Value>(&said.out).unwrap()["found"], 64, "nothing is left to do");
}

#[test]
fn shards_put_together_are_the_sweep_in_one_piece_and_gaps_and_overlaps_are_refused() {
    let desk = desk();
    sweep_file(&desk, "grid", "partition = 2\n[[key]]\nkey = \"control.k_p\"\nfrom = 100\nto = 800\nsteps = 8\n");
    assert_eq!(desk.armplane(&["sweep", "grid.toml"]).code, 0);
    for shard in ["1", "2", "3"] {
        let said = desk.armplane(&["sweep", "grid.toml", "--shard", &format!("{shard}/3"), "--out", &format!("shard-{shard}")]);
        assert_eq!(said.code, 0, "{}", said.err);
    }
    let refused = |args: &[&str], expected: &str| {
        let said = desk.armplane(&[&["sweep", "--merge"], args, &["--out", "merged"]].concat());
        assert!(said.code == 2 && said.err.contains(expected) && said.err.lines().count() == 1, "{} {}", said.code, said.err);
        assert!(!desk.path().join("merged").exists());
    };
    refused(&["shard-1", "shard-3"], "2 of 8 runs are missing: compute shard 2/3");
    refused(&["shard-1", "shard-2", "shard-3", "shard-2"], "runs 2 to 3 are in both");
    refused(&["shard-1", "short.toml"], "not the folder of a shard");
    let manifest = desk.path().join("shard-2/sweep.json");
    let text = std::fs::read_to_string(&manifest).unwrap();
    let program = serde_json::from_str::<Value>(&text).unwrap()["program"].as_str().unwrap().to_owned();
    std::fs::write(&manifest, text.replace(&program, "0123456789abcdef")).unwrap();
    refused(&["shard-1", "shard-2", "shard-3"], "different builds of armplane");
    std::fs::write(&manifest, &text).unwrap();
    let said = desk.armplane(&["sweep", "--merge", "shard-3", "shard-1", "shard-2", "--out", "merged"]);
    assert_eq!(said.code, 0, "{}", said.err);
    assert!(tables(&desk.path().join("merged")) == tables(&desk.path().join("runs/grid")));
    let said = desk.armplane(&["sweep", "grid.toml", "--shard", "1/9"]);
    assert!(said.code == 2 && said.err.contains("at most 4"), "{}", said.err);
}

#[test]
fn a_sweep_that_cannot_be_is_refused_in_a_sentence() {
    let desk = desk();
    let refused = |more: &str, expected: &str| {
        sweep_file(&desk, "bad", more);
        let said = desk.armplane(&["sweep", "bad.toml"]);
        assert!(said.code == 2 && said.err.contains(expected), "{} {}", said.code, said.err);
        assert!(!desk.path().join("runs/bad").exists());
    };
    refused("", "the grid is empty");
    refused("[[key]]\nkey = \"control.kp\"\nvalues = [1.0]\n", "did you mean `k_p`?");
    refused("[[key]]\nkey = \"start.q_deg.4\"\nunit = \"rad\"\nvalues = [1.0]\n", "is in °, not in rad");
    refused("[[key]]\nkey = \"start.q_rad\"\nvalues = [[0.0]]\n", "given 2 times");
    let fault = |fault: &str| format!("set = [\"fault=[{{{fault}, at_tick=10}}]\"]\n[[key]]\nkey = \"seed\"\nvalues = [1]\n");
    refused(&fault("process='plant', kind='kill'"), "it ends the run");
    refused(&fault("process='recorder', kind='slow-disk'"), "one thread has no such process");
    let grid = |values: &str| sweep_file(&desk, "grid", &format!("[[key]]\nkey = \"control.k_p\"\nvalues = {values}\n"));
    grid("[100, 200]");
    assert_eq!(desk.armplane(&["sweep", "grid.toml"]).code, 0);
    grid("[100, 300]");
    let said = desk.armplane(&["sweep", "grid.toml"]);
    assert!(said.code == 2 && said.err.contains("before its file, its scenario or its robot changed"), "{}", said.err);
    sweep_file(&desk, "other", "[[key]]\nkey = \"control.k_p\"\nvalues = [100]\n");
    let said = desk.armplane(&["sweep", "other.toml", "--out", "runs/grid"]);
    assert!(said.code == 2 && said.err.contains("the results of the sweep `grid`"), "{}", said.err);
    let said = desk.armplane(&["sweep", "report", "runs/grid", "--by", "reason"]);
    assert!(said.code == 2 && said.err.contains("has no numbers"), "{}", said.err);
    let said = desk.armplane(&["sweep", "report", "."]);
    assert!(said.code == 2 && said.err.contains("no sweep.json"), "{}", said.err);
}
