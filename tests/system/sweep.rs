//! `armplane sweep`: the same bytes as five processes, kills survived, shards put together, bad input in a sentence.

use std::collections::BTreeMap;

use serde_json::Value;

use crate::command::{Desk, Known, Running, until};

/// A short task, so that a sweep of it takes a moment.
const SCENARIO: &str = "name = \"short\"\nrobot = \"puma560\"\nsettle_s = 0.05\n[start]\nq_deg = [20, -60, 170, 0, 30, 0]\n[[segment]]\nby_m = [0.02, 0.0, -0.01]\nduration_s = 0.4\n";

/// A folder with the task, and `more` behind it.
fn desk(more: &str) -> Desk {
    let desk = Desk::new();
    desk.file("short.toml", [SCENARIO, more].concat());
    desk
}

fn sweep_file(desk: &Desk, name: &str, more: &str) {
    let head = format!("name = \"{name}\"\nscenario = \"short.toml\"\n");
    desk.file(format!("{name}.toml"), head + more);
}

/// A key with its values or its range.
fn key(key: &str, values: &str) -> String {
    format!("[[key]]\nkey = \"{key}\"\n{values}\n")
}

/// Every file of the table by its name. A draft that a killed sweep has left is none: the program reads no name with a dot before it.
fn tables(desk: &Desk, folder: &str) -> BTreeMap<String, Vec<u8>> {
    let runs = format!("{folder}/runs");
    let names = desk
        .names(&runs)
        .into_iter()
        .filter(|name| !name.starts_with('.'));
    names
        .map(|name| (name.clone(), desk.bytes(format!("{runs}/{name}"))))
        .collect()
}

/// Gains, masses, noise, start, laws, an analysis by number, a faulty sensor: drawn at random, and run in five processes too.
#[test]
fn runs_drawn_at_random_have_the_bytes_of_five_processes() {
    let fault = "[[fault]]\nprocess = \"plant\"\nkind = \"sensor\"\nas = \"bias\"\njoint = 5\namount = 0.01\nat_s = 0.1\nfor_s = 0.2\n";
    let keys = [
        (
            "control.strategy",
            "values = [\"blended\", \"chang-khatib\", \"damped-least-squares\", \"joint-pd\"]",
        ),
        ("control.k_p", "from = 100\nto = 900\nscale = \"log\""),
        ("plant.mass_factor", "from = 0.8\nto = 1.2"),
        ("plant.encoder_noise_counts", "from = 0\nto = 3"),
        ("plant.friction", "values = [true, false]"),
        ("start.q_deg.4", "from = -5\nto = 40"),
        ("analysis.numeric", "values = [true, false]"),
        ("fault.0.amount", "from = -0.05\nto = 0.05"),
        ("seed", "from = 1\nto = 1000000"),
    ];
    drawn_runs_are_those_of_five_processes(&desk(fault), &keys, 6);
}

/// Two faults of any process and its messages, their kinds, ticks and lengths drawn at random, and run in five processes too.
#[test]
fn faults_drawn_at_random_have_the_bytes_of_five_processes() {
    let fault = |process: &str, kind: &str| {
        format!(
            "[[fault]]\nprocess = \"{process}\"\nkind = \"{kind}\"\nat_tick = 1\nfor_ticks = 1\n"
        )
    };
    let faults = [fault("controller", "kill"), fault("plant", "drop")];
    let keys = [
        (
            "fault.0.process",
            "values = [\"estimator\", \"analyzer\", \"controller\"]",
        ),
        (
            "fault.0.kind",
            "values = [\"kill\", \"crash\", \"hang\", \"cut\"]",
        ),
        ("fault.0.at_tick", "from = 0\nto = 400"),
        ("fault.0.for_ticks", "from = 1\nto = 120"),
        (
            "fault.1.process",
            "values = [\"plant\", \"estimator\", \"analyzer\", \"controller\"]",
        ),
        (
            "fault.1.kind",
            "values = [\"delay\", \"drop\", \"duplicate\", \"stale\", \"corrupt\", \"zombie\"]",
        ),
        ("fault.1.at_tick", "from = 0\nto = 400"),
        ("fault.1.for_ticks", "from = 1\nto = 120"),
        ("seed", "from = 1\nto = 1000000"),
    ];
    drawn_runs_are_those_of_five_processes(&desk(&faults.concat()), &keys, 12);
}

/// A sweep of runs drawn from `keys`: the command that it gives for each has the same hashes and figures in five processes.
fn drawn_runs_are_those_of_five_processes(desk: &Desk, keys: &[(&str, &str)], count: usize) {
    let keys: String = keys
        .iter()
        .map(|(name, values)| key(name, values))
        .collect();
    sweep_file(
        desk,
        "drawn",
        &format!("{keys}[sample]\nruns = {count}\nseed = 5\n"),
    );
    desk.succeeds("sweep drawn.toml");
    let report = desk.json(&format!("sweep report runs/drawn --worst {count}"));
    let runs = report["worst"].list();
    assert_eq!(runs.len(), count, "{report}");
    for run in runs {
        // The command as a person would paste it.
        let command = run["command"]
            .text()
            .replacen("armplane", "\"$ARMPLANE\"", 1);
        let mut shell = desk.program("sh");
        let said = shell
            .args(["-c", &format!("{command} --json")])
            .output()
            .unwrap();
        let summary: Value =
            serde_json::from_slice(&said.stdout).unwrap_or_else(|_| panic!("{command}\n{said:?}"));
        for (ours, theirs) in [
            ("outcome", &summary["outcome"]),
            ("value", &summary["task"]["position_max_mm"]),
        ] {
            assert_eq!(&run[ours], theirs, "{command}");
        }
        let topics = summary["topics"].as_object().unwrap().iter();
        let hashes: BTreeMap<_, _> = topics.map(|(topic, it)| (topic, &it["hash"])).collect();
        // A topic that the run does not have is a column without a hash.
        let found = run["hashes"].as_object().unwrap().iter();
        let found: BTreeMap<_, _> = found.filter(|(_, hash)| **hash != "–").collect();
        assert_eq!(found, hashes, "{command}");
        assert!(
            desk.has(format!("drawn-run-{}/run.rrd", run["run"])),
            "a recording"
        );
    }
}

#[test]
fn a_steered_session_is_swept_and_has_the_bytes_of_five_processes() {
    let desk = Desk::new();
    let head = "name = \"steered\"\nscenario = \"servo-hostile\"\n";
    desk.file(
        "steered.toml",
        head.to_owned() + &key("seed", "values = [3]"),
    );
    desk.succeeds("sweep steered.toml");
    let report = desk.json("sweep report runs/steered --worst 1");
    let run = &report["worst"][0];
    let summary = desk.run("servo-hostile --seed 3 --out r");
    assert_eq!(run["outcome"], summary["outcome"], "{report}");
    for topic in ["torque", "servo_state"] {
        assert_eq!(
            run["hashes"][topic], summary["topics"][topic]["hash"],
            "{report}"
        );
    }
}

#[test]
fn targets_that_have_changed_are_not_those_of_the_sweep() {
    let desk = Desk::new();
    let targets = |speed: u32| {
        desk.file("targets.csv", format!("# armplane targets 1, length mm\n0, twist, base, 0.3, {speed} 0 0 0 0 0\n0.3, end\n"));
    };
    desk.file("short.toml", "name = \"steered\"\nrobot = \"puma560\"\n[start]\nposture = \"ready\"\n[servo]\ninput = \"targets.csv\"\n");
    sweep_file(
        &desk,
        "s",
        &["partition = 1\n", &key("seed", "values = [1, 2]")].concat(),
    );
    targets(100);
    desk.succeeds("sweep s.toml --shard 1/2 --out one");
    let manifest = desk.read_json("one/sweep.json");
    let other = manifest["fingerprint"].text();
    targets(50);
    desk.refuses(2, "sweep s.toml --shard 1/2 --out one", other);
    desk.succeeds("sweep s.toml --shard 2/2 --out two");
    desk.refuses(2, "sweep --merge one two --out whole", other);
    targets(100);
    desk.json("sweep s.toml --shard 1/2 --out one")
        .holds(r#"{"found": 1}"#);
    // Files that a key lists are read, too.
    sweep_file(
        &desk,
        "s",
        &key("servo.input", "values = [\"targets.csv\", \"nowhere.csv\"]"),
    );
    desk.refuses(2, "sweep s.toml --out three", "s.toml:5: nowhere.csv");
}

#[test]
fn runs_that_come_to_nothing_are_in_the_exit_code() {
    let desk = desk("[[fault]]\nprocess = \"controller\"\nkind = \"kill\"\nat_tick = 100\n");
    let start = |values| key("start.q_deg.1", values);
    let listed = "values = [-500, -60]";
    // A run that is refused is a row: a range of starts shows where the arm can begin.
    sweep_file(&desk, "some", &start("from = -500\nto = -60\nsteps = 2"));
    desk.json("sweep some.toml")
        .holds(r#"{"computed": 1, "refused": 1, "failed": 0}"#);
    // Of the listed ones each has a result.
    sweep_file(&desk, "listed", &start(listed));
    let none = "start.q_deg.1 -500";
    let said = desk.refuses(1, "sweep listed.toml --json", none);
    said.json()
        .holds(r#"{"computed": 1, "refused": 1, "failed": 0}"#);
    assert_eq!(tables(&desk, "runs/listed").len(), 1, "the table is there");
    // The same again, from the table.
    desk.refuses(1, "sweep listed.toml", none);
    sweep_file(&desk, "none", &start("from = -500\nto = -490\nsteps = 2"));
    let said = desk.refuses(1, "sweep none.toml --json", "runs/none");
    said.json().holds(r#"{"computed": 0, "refused": 2}"#);
    // Values of faults that the graph has no process for.
    sweep_file(
        &desk,
        "fault",
        &key("fault.0.process", "values = [\"estimator\", \"nobody\"]"),
    );
    desk.refuses(1, "sweep fault.toml", "fault.0.process nobody");
    // A shard is judged when all of them are put together.
    sweep_file(
        &desk,
        "parts",
        &["partition = 1\n", &start(listed)].concat(),
    );
    for shard in ["1", "2"] {
        desk.succeeds(&format!("sweep parts.toml --shard {shard}/2 --out {shard}"));
    }
    desk.refuses(1, "sweep --merge 1 2 --out merged", none);
}

#[test]
fn a_sweep_that_is_killed_goes_on_and_its_table_is_that_of_one_piece() {
    let desk = desk("");
    let keys = key("control.k_p", "from = 100\nto = 900\nsteps = 8")
        + &key("seed", "from = 1\nto = 8\nsteps = 8");
    sweep_file(&desk, "killed", &["partition = 5\n", &keys].concat());
    desk.succeeds("sweep killed.toml --out whole");
    let whole = tables(&desk, "whole");
    assert_eq!(whole.len(), 13);
    let finished = || tables(&desk, "out").len();
    let (mut kills, mut seen) = (0, 0);
    for wanted in [1, 3, 6] {
        let mut child = desk.start("sweep killed.toml --out out");
        until("partitions to be complete", || {
            finished() >= wanted || child.try_wait().unwrap().is_some()
        });
        child.kill().unwrap();
        kills += u32::from(child.finish().code == -1);
        assert!(finished() >= seen, "no complete partition is lost");
        seen = finished();
    }
    assert!(kills > 0, "none of the kills came in time");
    // No complete partition is repeated, and then nothing is left to do.
    for found in [(5 * seen).min(64), 64] {
        let done = desk.json("sweep killed.toml --out out");
        assert_eq!(
            (done["runs"].count(), done["found"].count()),
            (64, found as u64)
        );
        assert!(tables(&desk, "out") == whole, "the same files");
    }
}

#[test]
fn shards_put_together_are_the_sweep_in_one_piece_and_gaps_and_overlaps_are_refused() {
    let desk = desk("");
    let keys = key("control.k_p", "from = 100\nto = 800\nsteps = 8");
    sweep_file(&desk, "grid", &["partition = 2\n", &keys].concat());
    desk.succeeds("sweep grid.toml");
    for shard in ["1", "2", "3"] {
        desk.succeeds(&format!(
            "sweep grid.toml --shard {shard}/3 --out shard-{shard}"
        ));
    }
    let refused = |shards: &str, names: &str| {
        let args = format!("sweep --merge {shards} --out merged");
        let said = desk.refuses(2, &args, names);
        assert_eq!(said.err.lines().count(), 1, "{}", said.err);
        assert!(!desk.has("merged"));
    };
    refused("shard-1 shard-3", "2 8 2:");
    refused("shard-1 shard-2 shard-3 shard-2", "2 3 shard-2");
    refused("shard-1 short.toml", "short.toml sweep.json");
    let manifest = "shard-2/sweep.json";
    let text = desk.read(manifest);
    let program = desk.read_json(manifest)["program"].text().to_owned();
    desk.file(manifest, text.replace(&program, "0123456789abcdef"));
    refused("shard-1 shard-2 shard-3", "shard-2 checksum");
    desk.file(manifest, &text);
    desk.succeeds("sweep --merge shard-3 shard-1 shard-2 --out merged");
    assert!(tables(&desk, "merged") == tables(&desk, "runs/grid"));
    desk.refuses(2, "sweep grid.toml --shard 1/9", "9 4 `partition`");
}

#[test]
fn a_sweep_that_cannot_be_is_refused_in_a_sentence() {
    let desk = desk("");
    let seed = |values: &str| key("seed", values);
    let set = |set: &str| format!("set = [\"{set}\"]\n{}", seed("values = [1]"));
    for (more, expected) in [
        (key("control.kp", "values = [1.0]"), "bad.toml:4: `k_p`"),
        (
            key("start.q", "values = [[0.0]]"),
            "bad.toml:4: q_deg, posture",
        ),
        ("fault = 1\n".to_owned(), "bad.toml:3: `fault` `scenario`"),
        (
            seed("from = 0\nto = 1e300\nsteps = 3"),
            "bad.toml:4: `seed` 1e300: ±9007199254740992",
        ),
        (
            key("fault.0.process", "values = [\"plant\"]"),
            "bad.toml:4: `fault.0.process` schema",
        ),
        (set("seed2=1"), "bad.toml:3: `seed2=1`: `seed`"),
        (
            set("fault=[{process='plant', kind='kill', at_tick=10}]"),
            "short `kill` plant",
        ),
        (
            set("fault=[{process='recorder', kind='disk-full', at_tick=10}]"),
            "short `disk-full` recorder",
        ),
    ] {
        sweep_file(&desk, "bad", &more);
        desk.refuses_each(&[("sweep bad.toml", expected)]);
    }
    let grid = |name, values| sweep_file(&desk, name, &key("control.k_p", values));
    grid("grid", "values = [100, 200]");
    grid("other", "values = [100]");
    desk.succeeds("sweep grid.toml --out g");
    let manifest = desk.read_json("g/sweep.json");
    grid("grid", "values = [100, 300]");
    desk.refuses_each(&[
        ("sweep grid.toml --out g", manifest["fingerprint"].text()),
        ("sweep other.toml --out g", "grid other --out"),
        ("sweep report g --by reason", "`reason` position_max_mm"),
        ("sweep report .", "sweep.json"),
    ]);
}

#[test]
fn nothing_is_written_through_a_link_and_damaged_results_are_refused_with_a_remedy() {
    let desk = desk("");
    let keys = key("control.k_p", "from = 100\nto = 800\nsteps = 8");
    sweep_file(&desk, "grid", &["partition = 4\n", &keys].concat());
    desk.succeeds("sweep grid.toml --out g");
    let refused = |args: &str, words: &str| {
        let said = desk.refuses(2, args, words);
        assert_eq!(said.err.lines().count(), 1, "{args}: {}", said.err);
    };
    let tables = tables(&desk, "g");
    let (name, rows) = tables.last_key_value().unwrap();
    let part = format!("g/runs/{name}");
    let mut flipped = rows.clone();
    // Of the footer, too.
    let at = flipped.len() - 40;
    flipped[at] ^= 1;
    let n = rows.len();
    for bytes in [&[], &rows[..n / 2], &rows[..n - 1], &flipped] {
        desk.file(&part, bytes);
        for args in [
            "sweep grid.toml --out g",
            "sweep report g",
            "sweep --merge g --out m",
        ] {
            refused(args, name);
        }
    }
    desk.remove(&part);
    desk.file("elsewhere", "mine");
    desk.link(&part, "elsewhere");
    refused("sweep grid.toml --out g", name);
    std::fs::remove_dir_all(desk.at("g/runs")).unwrap();
    std::fs::create_dir(desk.at("other")).unwrap();
    desk.link("g/runs", "other");
    refused("sweep grid.toml --out g", "g/runs");
    assert!(
        desk.names("other").is_empty(),
        "nothing is written through a link"
    );
    assert_eq!(desk.read("elsewhere"), "mine");
    desk.remove("g/runs");
    desk.succeeds("sweep grid.toml --out g");
    desk.file("g/sweep.json", "{");
    refused("sweep report g", "sweep.json");
}
