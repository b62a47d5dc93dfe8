//! `armplane sweep`: the same bytes as five processes, kills survived, shards put together, bad input in a sentence.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::command::{Desk, Known, finish, until};

/// A short task, so that a sweep of it takes a moment.
const SCENARIO: &str = "name = \"short\"\nrobot = \"puma560\"\nsettle_s = 0.05\n[start]\nq_deg = [20, -60, 170, 0, 30, 0]\n[[segment]]\nby_m = [0.02, 0.0, -0.01]\nduration_s = 0.4\n";

fn desk() -> Desk {
    let desk = Desk::new();
    desk.file("short.toml", SCENARIO);
    desk
}

fn sweep_file(desk: &Desk, name: &str, more: &str) {
    desk.file(
        &format!("{name}.toml"),
        &format!("name = \"{name}\"\nscenario = \"short.toml\"\n{more}"),
    );
}

/// Every file of the table by its name. A draft that a killed sweep has left is none: the program reads no name with a dot before it.
fn tables(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder.join("runs")).expect("the folder of the table");
    let files = entries.flatten().map(|entry| {
        let name = entry.file_name().into_string().unwrap();
        (name, std::fs::read(entry.path()).unwrap())
    });
    files.filter(|(name, _)| !name.starts_with('.')).collect()
}

fn report(desk: &Desk, args: &str) -> Value {
    let said = desk.succeeds(&format!("sweep report {args} --json"));
    said.json()
}

/// Gains, masses, noise, start, laws, an analysis by number, a faulty sensor: drawn at random, and run in five processes too.
#[test]
fn runs_drawn_at_random_have_the_bytes_of_five_processes() {
    let desk = Desk::new();
    let fault = "[[fault]]\nprocess = \"plant\"\nkind = \"sensor\"\nas = \"bias\"\njoint = 5\namount = 0.01\nat_s = 0.1\nfor_s = 0.2\n";
    desk.file("short.toml", &[SCENARIO, fault].concat());
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
    drawn_runs_are_those_of_five_processes(&desk, &keys, 6);
}

/// Two faults of any process and its messages, their kinds, ticks and lengths drawn at random, and run in five processes too.
#[test]
fn faults_drawn_at_random_have_the_bytes_of_five_processes() {
    let desk = Desk::new();
    let fault = |process: &str, kind: &str| {
        format!(
            "[[fault]]\nprocess = \"{process}\"\nkind = \"{kind}\"\nat_tick = 1\nfor_ticks = 1\n"
        )
    };
    desk.file(
        "short.toml",
        &[
            SCENARIO,
            &fault("controller", "kill"),
            &fault("plant", "drop"),
        ]
        .concat(),
    );
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
            "values = [\"delay\", \"drop\", \"duplicate\", \"reorder\", \"stale\", \"corrupt\", \"zombie\"]",
        ),
        ("fault.1.at_tick", "from = 0\nto = 400"),
        ("fault.1.for_ticks", "from = 1\nto = 120"),
        ("seed", "from = 1\nto = 1000000"),
    ];
    drawn_runs_are_those_of_five_processes(&desk, &keys, 12);
}

#[test]
fn a_steered_session_is_swept_and_has_the_bytes_of_five_processes() {
    let desk = Desk::new();
    let file =
        "name = \"steered\"\nscenario = \"servo-hostile\"\n[[key]]\nkey = \"seed\"\nvalues = [3]\n";
    desk.file("steered.toml", file);
    desk.succeeds("sweep steered.toml");
    let report = report(&desk, "runs/steered --worst 1");
    let run = &report["worst"][0];
    let summary = desk.run("servo-hostile --seed 3 --out r");
    assert_eq!(
        (&run["outcome"], &run["hashes"]["torque"]),
        (&summary["outcome"], &summary["topics"]["torque"]["hash"]),
        "{report}"
    );
    assert_eq!(
        run["hashes"]["servo_state"], summary["topics"]["servo_state"]["hash"],
        "{report}"
    );
}

#[test]
fn targets_that_have_changed_are_not_those_of_the_sweep() {
    let desk = Desk::new();
    let targets = |speed: u32| {
        desk.file("targets.csv", &format!("# armplane targets 1, length mm\n0, twist, base, 0.3, {speed} 0 0 0 0 0\n0.3, end\n"));
    };
    let scenario = "name = \"steered\"\nrobot = \"puma560\"\n[start]\nposture = \"ready\"\n[servo]\ninput = \"targets.csv\"\n";
    desk.file("steered.toml", scenario);
    let file = "name = \"s\"\nscenario = \"steered.toml\"\npartition = 1\n[[key]]\nkey = \"seed\"\nvalues = [1, 2]\n";
    desk.file("s.toml", file);
    targets(100);
    desk.succeeds("sweep s.toml --shard 1/2 --out one");
    targets(50);
    desk.refuses(
        2,
        "sweep s.toml --shard 1/2 --out one",
        &["another fingerprint"],
    );
    desk.succeeds("sweep s.toml --shard 2/2 --out two");
    desk.refuses(
        2,
        "sweep --merge one two --out whole",
        &["another fingerprint"],
    );
    targets(100);
    let said = desk.armplane("sweep s.toml --shard 1/2 --out one --json");
    assert!(
        said.code == 0 && said.out.contains("\"found\":1"),
        "{}{}",
        said.out,
        said.err
    );
    // Files that a key lists are read, too.
    desk.file(
        "s.toml",
        &file.replace(
            "\"seed\"\nvalues = [1, 2]",
            "\"servo.input\"\nvalues = [\"targets.csv\", \"nowhere.csv\"]",
        ),
    );
    desk.refuses(
        2,
        "sweep s.toml --out three",
        &["s.toml:6: there is no file ", "nowhere.csv: give the path"],
    );
}

#[test]
fn runs_that_come_to_nothing_are_in_the_exit_code() {
    let desk = desk();
    let file = |name: &str, keys: &str| sweep_file(&desk, name, keys);
    let folder = |name: &str| desk.path().join("runs").join(name).display().to_string();
    // A run that is refused is a row: a range of starts shows where the arm can begin.
    file(
        "some",
        "[[key]]\nkey = \"start.q_deg.1\"\nfrom = -500\nto = -60\nsteps = 2\n",
    );
    let said = desk.armplane("sweep some.toml");
    assert!(
        said.code == 0 && said.out.contains("refused    1 of 2 runs, for example: "),
        "{}{}",
        said.out,
        said.err
    );
    // Of the listed ones each has a result.
    file(
        "listed",
        "[[key]]\nkey = \"start.q_deg.1\"\nvalues = [-500, -60]\n",
    );
    let said = desk.armplane("sweep listed.toml --json");
    let error: Value = serde_json::from_str(&said.err).unwrap();
    let (done, sentence): (Value, _) = (said.json(), error["error"]["message"].text());
    assert_eq!(
        (
            said.code,
            &done["computed"],
            &done["refused"],
            &done["failed"]
        ),
        (1, &1.into(), &1.into(), &0.into()),
        "{done}"
    );
    assert!(
        sentence.contains("no run with start.q_deg.1 = -500 has a result: "),
        "{sentence}"
    );
    assert_eq!(
        tables(&desk.path().join("runs/listed")).len(),
        1,
        "the table is there"
    );
    assert_eq!(
        desk.armplane("sweep listed.toml").code,
        1,
        "the same again, from the table"
    );
    file(
        "none",
        "[[key]]\nkey = \"start.q_deg.1\"\nfrom = -500\nto = -490\nsteps = 2\n",
    );
    let said = desk.armplane("sweep none.toml");
    assert!(
        said.code == 1 && said.err.contains("no run of 2 has a result: "),
        "{}",
        said.err
    );
    assert!(
        said.err.lines().last().unwrap().contains("runs/none"),
        "{} {}",
        said.err,
        folder("none")
    );
    // Values of faults that the graph has no process for.
    desk.file(
        "short.toml",
        &[
            SCENARIO,
            "[[fault]]\nprocess = \"controller\"\nkind = \"kill\"\nat_tick = 100\n",
        ]
        .concat(),
    );
    file(
        "fault",
        "[[key]]\nkey = \"fault.0.process\"\nvalues = [\"estimator\", \"nobody\"]\n",
    );
    desk.refuses(
        1,
        "sweep fault.toml",
        &["no run with fault.0.process = nobody has a result: "],
    );
    // A shard is judged when all of them are put together.
    file(
        "parts",
        "partition = 1\n[[key]]\nkey = \"start.q_deg.1\"\nvalues = [-500, -60]\n",
    );
    for shard in ["1", "2"] {
        desk.succeeds(&[
            "sweep",
            "parts.toml",
            "--shard",
            &format!("{shard}/2"),
            "--out",
            shard,
        ]);
    }
    desk.refuses(
        1,
        "sweep --merge 1 2 --out merged",
        &["no run with start.q_deg.1 = -500 has a result: "],
    );
}

/// A sweep of runs drawn from `keys`: the command that it gives for each has the same hashes and figures in five processes.
fn drawn_runs_are_those_of_five_processes(desk: &Desk, keys: &[(&str, &str)], count: usize) {
    let keys: String = keys
        .iter()
        .map(|(key, values)| format!("[[key]]\nkey = \"{key}\"\n{values}\n"))
        .collect();
    sweep_file(
        desk,
        "drawn",
        &format!("{keys}[sample]\nruns = {count}\nseed = 5\n"),
    );
    desk.succeeds("sweep drawn.toml");
    let report = report(desk, &format!("runs/drawn --worst {count}"));
    let runs = report["worst"].list();
    assert_eq!(runs.len(), count, "{report}");
    for run in runs {
        // The command as a person would paste it.
        let command = run["command"]
            .text()
            .replacen("armplane", env!("CARGO_BIN_EXE_armplane"), 1);
        let said = Command::new("sh")
            .args(["-c", &format!("{command} --json")])
            .current_dir(desk.path())
            .output()
            .unwrap();
        let summary: Value =
            serde_json::from_slice(&said.stdout).unwrap_or_else(|_| panic!("{command}\n{said:?}"));
        assert_eq!(summary["outcome"], run["outcome"], "{command}");
        assert_eq!(
            summary["task"]["position_max_mm"], run["value"],
            "{command}"
        );
        let hashes: BTreeMap<_, _> = summary["topics"]
            .as_object()
            .unwrap()
            .iter()
            .map(|(topic, it)| (topic, &it["hash"]))
            .collect();
        // A topic that the run does not have is a column without a hash.
        let found: BTreeMap<_, _> = run["hashes"]
            .as_object()
            .unwrap()
            .iter()
            .filter(|(_, hash)| **hash != "–")
            .collect();
        assert_eq!(found, hashes, "{command}");
        assert!(
            desk.path()
                .join(format!("drawn-run-{}/run.rrd", run["run"]))
                .exists(),
            "a recording"
        );
    }
}

#[test]
fn a_sweep_that_is_killed_goes_on_and_its_table_is_that_of_one_piece() {
    let desk = desk();
    let keys = "partition = 5\n[[key]]\nkey = \"control.k_p\"\nfrom = 100\nto = 900\nsteps = 8\n[[key]]\nkey = \"seed\"\nfrom = 1\nto = 8\nsteps = 8\n";
    sweep_file(&desk, "killed", keys);
    desk.succeeds("sweep killed.toml --out whole");
    let whole = tables(&desk.path().join("whole"));
    assert_eq!(whole.len(), 13);
    let finished = || {
        let runs = desk.path().join("out/runs");
        let entries = std::fs::read_dir(runs).into_iter().flatten().flatten();
        let is_whole = |name: &str| name.starts_with("part-");
        entries
            .filter(|entry| is_whole(&entry.file_name().to_string_lossy()))
            .count()
    };
    let (mut kills, mut seen) = (0, 0);
    for wanted in [1, 3, 6] {
        let mut child = desk.start("sweep killed.toml --out out");
        until("partitions to be complete", || {
            finished() >= wanted || child.try_wait().unwrap().is_some()
        });
        child.kill().unwrap();
        kills += u32::from(finish(child).code == -1);
        assert!(finished() >= seen, "no complete partition is lost");
        seen = finished();
    }
    assert!(kills > 0, "none of the kills came in time");
    let done = desk.json("sweep killed.toml --out out");
    assert_eq!(
        (&done["runs"], done["found"].as_u64()),
        (&64.into(), Some((5 * seen).min(64) as u64)),
        "no complete partition is repeated"
    );
    assert!(tables(&desk.path().join("out")) == whole, "the same files");
    let said = desk.armplane("sweep killed.toml --out out --json");
    assert_eq!(said.json()["found"], 64, "nothing is left to do");
}

#[test]
fn shards_put_together_are_the_sweep_in_one_piece_and_gaps_and_overlaps_are_refused() {
    let desk = desk();
    sweep_file(
        &desk,
        "grid",
        "partition = 2\n[[key]]\nkey = \"control.k_p\"\nfrom = 100\nto = 800\nsteps = 8\n",
    );
    desk.succeeds("sweep grid.toml");
    for shard in ["1", "2", "3"] {
        desk.succeeds(&[
            "sweep",
            "grid.toml",
            "--shard",
            &format!("{shard}/3"),
            "--out",
            &format!("shard-{shard}"),
        ]);
    }
    let refused = |args: &str, expected: &str| {
        let said = desk.armplane(&format!("sweep --merge {args} --out merged"));
        assert!(
            said.code == 2 && said.err.contains(expected) && said.err.lines().count() == 1,
            "{} {}",
            said.code,
            said.err
        );
        assert!(!desk.path().join("merged").exists());
    };
    refused("shard-1 shard-3", "2 of 8 runs are missing, the first is 2");
    refused("shard-1 shard-2 shard-3 shard-2", "runs 2 to 3 are in both");
    refused("shard-1 short.toml", "no sweep.json");
    let manifest = desk.path().join("shard-2/sweep.json");
    let text = std::fs::read_to_string(&manifest).unwrap();
    let program = serde_json::from_str::<Value>(&text).unwrap()["program"]
        .text()
        .to_owned();
    std::fs::write(&manifest, text.replace(&program, "0123456789abcdef")).unwrap();
    refused("shard-1 shard-2 shard-3", "checksum");
    std::fs::write(&manifest, &text).unwrap();
    desk.succeeds("sweep --merge shard-3 shard-1 shard-2 --out merged");
    assert!(tables(&desk.path().join("merged")) == tables(&desk.path().join("runs/grid")));
    desk.refuses(2, "sweep grid.toml --shard 1/9", &["at most 4"]);
}

#[test]
fn a_sweep_that_cannot_be_is_refused_in_a_sentence() {
    let desk = desk();
    let refused = |more: &str, expected: &str| {
        sweep_file(&desk, "bad", more);
        let said = desk.armplane("sweep bad.toml");
        assert!(
            said.code == 2 && said.err.contains(expected),
            "{} {}",
            said.code,
            said.err
        );
        assert!(!desk.path().join("runs/bad").exists());
    };
    refused(
        "[[key]]\nkey = \"control.kp\"\nvalues = [1.0]\n",
        "did you mean `k_p`?",
    );
    refused(
        "[[key]]\nkey = \"start.q\"\nvalues = [[0.0]]\n",
        "given 2 times",
    );
    let seed = "[[key]]\nkey = \"seed\"\n";
    for (more, expected) in [
        ("fault = 1\n".to_owned(), "unknown field `fault`"),
        (
            format!("{seed}from = 0\nto = 1e300\nsteps = 3\n"),
            "it takes whole numbers only (both ends must be whole, and within",
        ),
        (
            "[[key]]\nkey = \"fault.0.process\"\nvalues = [\"plant\"]\n".to_owned(),
            "`fault.0.process = \"plant\"`: `fault.0.process` does not name a place in the file",
        ),
        (
            format!("set = [\"seed2=1\"]\n{seed}values = [1]\n"),
            "bad.toml:3: `seed2=1`: unknown field `seed2`",
        ),
    ] {
        refused(&more, expected);
    }
    let fault = |fault: &str| {
        format!(
            "set = [\"fault=[{{{fault}, at_tick=10}}]\"]\n[[key]]\nkey = \"seed\"\nvalues = [1]\n"
        )
    };
    refused(&fault("process='plant', kind='kill'"), "it ends the run");
    refused(
        &fault("process='recorder', kind='slow-disk'"),
        "one thread has no such process",
    );
    let grid = |values: &str| {
        sweep_file(
            &desk,
            "grid",
            &format!("[[key]]\nkey = \"control.k_p\"\nvalues = {values}\n"),
        )
    };
    grid("[100, 200]");
    desk.succeeds("sweep grid.toml");
    grid("[100, 300]");
    desk.refuses(2, "sweep grid.toml", &["another fingerprint"]);
    sweep_file(
        &desk,
        "other",
        "[[key]]\nkey = \"control.k_p\"\nvalues = [100]\n",
    );
    desk.refuses(
        2,
        "sweep other.toml --out runs/grid",
        &["another name: grid"],
    );
    desk.refuses(2, "sweep report runs/grid --by reason", &["has no numbers"]);
    desk.refuses(2, "sweep report .", &["no sweep.json"]);
}

#[test]
fn nothing_is_written_through_a_link_and_damaged_results_are_refused_with_a_remedy() {
    let desk = desk();
    sweep_file(
        &desk,
        "grid",
        "partition = 4\n[[key]]\nkey = \"control.k_p\"\nfrom = 100\nto = 800\nsteps = 8\n",
    );
    desk.succeeds("sweep grid.toml --out g");
    let folder = desk.path().join("g");
    let refused = |args: &str, words: &str| {
        let said = desk.armplane(args);
        assert!(
            said.code == 2 && said.err.contains(words) && said.err.lines().count() == 1,
            "{args:?}: {}: {}",
            said.code,
            said.err
        );
    };
    let tables = tables(&folder);
    let (name, rows) = tables.last_key_value().unwrap();
    let part = folder.join("runs").join(name);
    let mut flipped = rows.clone();
    // Of the footer, too.
    let at = flipped.len() - 40;
    flipped[at] ^= 1;
    for bytes in [
        &[],
        &rows[..rows.len() / 2],
        &rows[..rows.len() - 1],
        &flipped,
    ] {
        std::fs::write(&part, bytes).unwrap();
        for args in [
            "sweep grid.toml --out g",
            "sweep report g",
            "sweep --merge g --out m",
        ] {
            refused(args, name);
        }
    }
    std::fs::remove_file(&part).unwrap();
    let elsewhere = desk.file("elsewhere", "mine");
    std::os::unix::fs::symlink(&elsewhere, &part).unwrap();
    refused("sweep grid.toml --out g", name);
    std::fs::remove_file(&part).unwrap();
    std::fs::remove_dir_all(folder.join("runs")).unwrap();
    std::fs::create_dir(desk.path().join("other")).unwrap();
    std::os::unix::fs::symlink(desk.path().join("other"), folder.join("runs")).unwrap();
    refused("sweep grid.toml --out g", "g/runs");
    assert!(
        std::fs::read_dir(desk.path().join("other"))
            .unwrap()
            .next()
            .is_none(),
        "nothing is written through a link"
    );
    assert_eq!(std::fs::read_to_string(elsewhere).unwrap(), "mine");
    std::fs::remove_file(folder.join("runs")).unwrap();
    desk.succeeds("sweep grid.toml --out g");
    std::fs::write(folder.join("sweep.json"), "{").unwrap();
    refused("sweep report g", "sweep.json");
}
