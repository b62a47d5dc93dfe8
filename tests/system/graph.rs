//! Graphs of one's own: a sixth process in a folder of its own, and graphs that cannot run.

use std::path::Path;
use std::process::Command;

use crate::command::{Desk, Known, occurred, restarts, root, source};

/// The program of `examples/energy`, built with the profile of this test.
fn energy() -> String {
    let programs = Path::new(env!("CARGO_BIN_EXE_armplane"))
        .parent()
        .expect("a folder");
    let profile = programs.file_name().expect("a profile");
    let profile = if profile == "debug" {
        "dev".as_ref()
    } else {
        profile
    };
    // With the whole workspace: the same features as this test, so that nothing else is compiled.
    let built = Command::new(env!("CARGO"))
        .args([
            "build",
            "--quiet",
            "--offline",
            "--workspace",
            "--bin",
            "energy",
            "--profile",
        ])
        .arg(profile)
        .current_dir(root())
        .output()
        .expect("cargo runs");
    assert!(
        built.status.success(),
        "{}",
        String::from_utf8_lossy(&built.stderr)
    );
    programs.join("energy").display().to_string()
}

/// A folder with the example's scenario, with and without faults, and its graph, with its program where this test has built it and one part changed.
fn desk(faults: &str, [from, to]: [&str; 2]) -> Desk {
    let desk = Desk::new();
    let graph = source("examples/energy/graph.toml");
    let program = "../../target/release/energy";
    assert!(graph.contains(program) && graph.contains(from), "{graph}");
    desk.file(
        "graph.toml",
        graph.replace(from, to).replace(program, &energy()),
    );
    let scenario = source("examples/energy/energy.toml").replace("graph = \"graph.toml\"\n", "");
    desk.file("faults.toml", [&scenario, faults].concat());
    desk.file("plain.toml", scenario);
    desk
}

const AS_IT_IS: [&str; 2] = ["", ""];

#[test]
fn a_sixth_process_runs_in_lockstep_and_changes_nothing_of_the_others() {
    let death = "\n[[fault]]\nprocess = \"recorder\"\nkind = \"kill\"\nat_tick = 700\n";
    let desk = desk(death, AS_IT_IS);
    let first = desk.run("plain.toml --graph graph.toml --out first");
    let second = desk.run("plain.toml --graph graph.toml --no-record");
    let killed = desk.run("faults.toml --graph graph.toml");
    let mut without = desk.run("plain.toml --no-record")["topics"].take();
    assert_eq!(first["topics"], second["topics"], "the same bytes twice");
    // A replacement of the recorder misses nothing of a topic that it does not know.
    assert_eq!(first["topics"], killed["topics"]);
    without["energy"] = first["topics"]["energy"].clone();
    assert_eq!(first["topics"], without);
    let ticks = first["ticks"].count();
    assert_eq!(
        first["topics"]["energy"]["count"], ticks,
        "a message each tick, to the last one"
    );
    first.holds(r#"{"processes/#": 6, "recorder/lost": 0, "recorder/not_drawn/0": "energy"}"#);
    assert_eq!(restarts(&first, "energy"), 0);
    assert!(desk.bytes("first/messages.mcap").len() as u64 > 10 * ticks);
    // A short motion: under the conditions of `verify` every look for a message may pause.
    let short = "--set segment.0.duration_s=0.2 --set settle_s=0.1";
    let verified = desk.json(&format!(
        "verify plain.toml --graph graph.toml --runs 2 {short}"
    ));
    // One thread has no program of the graph.
    verified.holds(r#"{"identical": true, "reference_run": 1}"#);
    let reference = &verified["reference"];
    assert_eq!(
        reference["topics"]["energy"]["count"], reference["ticks"],
        "{verified}"
    );
}

#[test]
fn faults_happen_to_a_sixth_process_and_repeat_themselves() {
    let fault = |kind: &str, more: &str| {
        format!("\n[[fault]]\nprocess = \"energy\"\nkind = \"{kind}\"\n{more}\n")
    };
    let faults = [
        fault("kill", "at_tick = 300\nfor_ticks = 50"),
        fault("hang", "as = \"for-ever\"\nat_tick = 900\nfor_ticks = 60"),
        fault("drop", "at_tick = 1400\nfor_ticks = 100\nprobability = 0.5"),
        fault(
            "corrupt",
            "as = \"huge\"\nfield = \"potential_j\"\nat_tick = 1600\nfor_ticks = 10",
        ),
    ];
    let desk = desk(&faults.concat(), AS_IT_IS);
    let [first, second] = [0, 1].map(|_| desk.run("faults.toml --graph graph.toml"));
    assert_eq!(first["topics"], second["topics"], "the same bytes twice");
    for run in [&first, &second] {
        assert_eq!(restarts(run, "energy"), 2, "{}", run["faults"]);
    }
    assert_eq!(occurred(&first), 4, "{}", first["faults"]);
    // A message that a fault kept from leaving is not lost, and the loop does not wait for it.
    first.holds(
        r#"{"faults/#": 4, "faults/3/plan/field": "potential_j[0]", "recorder/lost": 0, "outcome": "goal reached"}"#,
    );
    let (count, ticks) = (
        first["topics"]["energy"]["count"].count(),
        first["ticks"].count(),
    );
    let expected = ticks - 110 - 100..ticks - 110;
    assert!(expected.contains(&count), "{count} of {ticks} ticks");
    // The run left a scenario and a graph that repeat it.
    let repeated = desk.run("runs/energy-001/scenario.toml --no-record");
    assert_eq!(repeated["topics"], first["topics"]);
}

#[test]
fn a_message_or_topic_that_the_graph_declares_otherwise_is_refused() {
    let layout = ["manipulability: f64\"", "manipulability: u64\""];
    let writes = ["writes = [\"energy\"]", "writes = [\"spare\", \"energy\"]"];
    let spare = "\n[[topic]]\nname = \"spare\"\ntype = \"own.Spare.v1\"\nfields = [\"header: Header\", \"x: f64\"]\n";
    for (change, more, names) in [
        (layout, "", "\"energy\" armplane.Energy.v1"),
        (writes, spare, "\"spare\" `writes`"),
    ] {
        let desk = desk("", change);
        desk.file("graph.toml", desk.read("graph.toml") + more);
        for mode in ["lockstep", "realtime"] {
            let args = format!("run plain.toml --graph graph.toml --no-record --mode {mode}");
            desk.refuses(1, &args, names);
        }
    }
}

/// The names of the processes are the graph's, in the summary and in the recording.
#[test]
fn a_process_keeps_its_name_in_the_recording() {
    let desk = Desk::new();
    let renamed = "name = \"c\"\nprogram = \"controller\"";
    let text = source("shared-types/graph.toml").replace("name = \"controller\"", renamed);
    assert!(text.contains(renamed), "{text}");
    desk.file("renamed.toml", text);
    let short = "--set segment.0.duration_s=0.5 --set segment.1.duration_s=0.5";
    let summary = desk.run(&format!("--graph renamed.toml --out run {short}"));
    assert_eq!(restarts(&summary, "c"), 0);
    desk.succeeds("export run");
    let [events, signals] = ["run/events.csv", "run/signals.csv"].map(|name| desk.read(name));
    for process in ["c", "analyzer"] {
        assert!(
            events.contains(&format!("state,process/{process},up")),
            "{events}"
        );
    }
    let headings = signals.lines().next().expect("headings");
    assert!(!events.contains("controller") && !headings.contains("controller"));
    desk.json("replay run --process c")
        .holds(r#"{"process": "c", "identical": true}"#);
    desk.succeeds("replay run");
    let names = "`controller` --process analyzer, c";
    desk.refuses(2, "replay run --process controller", names);
}

#[test]
fn graphs_that_cannot_run_are_refused_before_anything_starts() {
    let desk = Desk::new();
    let writer = |number: u32| {
        format!(
            "[[topic]]\nname = \"t{number}\"\ntype = \"A.B{number}.v1\"\nfields = [\"header: Header\", \"v: f64\"]\n\
             [[process]]\nname = \"p{number}\"\ncommand = [\"true\"]\nreads = [\"estimate\"]\nwrites = [\"t{number}\"]\n"
        )
    };
    let crowd = (1..=5).map(writer).collect::<String>();
    let process = |command: &str, reads: &str| {
        format!("[[process]]\nname = \"mine\"\ncommand = [\"{command}\"]\nreads = [\"{reads}\"]\n")
    };
    for (text, expected) in [
        (crowd, "graph.toml:46: 9 `p5`"),
        (process("./missing", "estimate"), "`mine`: ./missing:"),
        (
            process("no-such-program-anywhere", "estimate"),
            "`mine`: PATH",
        ),
        (process("./graph.toml", "estimate"), "`mine`: ./graph.toml"),
        (
            process("sh", "weather"),
            "graph.toml:5: `weather` singularity,",
        ),
    ] {
        desk.file("graph.toml", format!("extends = \"armplane\"\n{text}"));
        desk.refuses_each(&[("run fig5-wrist-rotation --graph graph.toml", expected)]);
    }
}
