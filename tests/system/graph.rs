//! Graphs of one's own: a sixth process in a folder of its own, and graphs that cannot run.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use crate::command::{Desk, Known, assert_nothing_left, restarts};

/// The program of `examples/energy`, built with the profile of this test.
fn energy() -> PathBuf {
    let programs = Path::new(env!("CARGO_BIN_EXE_armplane"))
        .parent()
        .expect("a folder");
    let profile = programs
        .file_name()
        .and_then(|name| name.to_str())
        .expect("a profile");
    let profile = if profile == "debug" { "dev" } else { profile };
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
            profile,
        ])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    assert!(
        built.status.success(),
        "{}",
        String::from_utf8_lossy(&built.stderr)
    );
    programs.join("energy")
}

/// The example's graph, with its program where this test has built it.
fn graph(desk: &Desk) -> String {
    let text = include_str!("../../examples/energy/graph.toml");
    assert!(text.contains("../../target/release/energy"), "{text}");
    let path = desk.file(
        "graph.toml",
        &text.replace(
            "../../target/release/energy",
            &energy().display().to_string(),
        ),
    );
    path.display().to_string()
}

fn scenario(desk: &Desk, name: &str, faults: &str) -> String {
    let text =
        include_str!("../../examples/energy/energy.toml").replace("graph = \"graph.toml\"\n", "");
    desk.file(name, &format!("{text}{faults}"))
        .display()
        .to_string()
}

fn fault(kind: &str, more: &str) -> String {
    format!("\n[[fault]]\nprocess = \"energy\"\nkind = \"{kind}\"\n{more}\n")
}

/// Count and hash of a topic.
fn topic(summary: &Value, name: &str) -> (u64, String) {
    let topic = &summary["topics"][name];
    (
        topic["count"].as_u64().unwrap_or_default(),
        topic["hash"].as_str().unwrap_or_default().to_owned(),
    )
}

#[test]
fn a_sixth_process_runs_in_lockstep_and_changes_nothing_of_the_others() {
    let desk = Desk::new();
    let (graph, scenario) = (graph(&desk), scenario(&desk, "plain.toml", ""));
    let (first, second) = (
        desk.run(&[&scenario, "--graph", &graph]),
        desk.run(&format!("{scenario} --graph {graph} --no-record")),
    );
    let without = desk.run(&[&scenario, "--no-record"]);
    let ticks = first["ticks"].count();
    assert_eq!(
        topic(&first, "energy").0,
        ticks,
        "a message each tick, to the last one: {}",
        first["topics"]
    );
    assert_eq!(first["topics"], second["topics"], "the same bytes twice");
    for name in [
        "sensor",
        "plant_state",
        "estimate",
        "singularity",
        "control_state",
        "torque",
    ] {
        assert_eq!(topic(&first, name), topic(&without, name), "{name}");
    }
    assert_eq!(
        (first["processes"].list().len(), restarts(&first, "energy")),
        (6, 0)
    );
    assert_eq!(
        (
            first["recorder"]["lost"].as_u64(),
            &first["recorder"]["not_drawn"][0]
        ),
        (Some(0), &Value::from("energy"))
    );
    let kept = desk
        .path()
        .join("runs")
        .join("energy-001")
        .join("messages.mcap");
    assert!(
        kept.metadata().is_ok_and(|file| file.len() > 10 * ticks),
        "{}",
        kept.display()
    );
}

#[test]
fn faults_happen_to_a_sixth_process_and_repeat_themselves() {
    let desk = Desk::new();
    let graph = graph(&desk);
    let faults = [
        fault("kill", "at_tick = 300\nfor_ticks = 50"),
        fault("hang", "as = \"for-ever\"\nat_tick = 900\nfor_ticks = 60"),
        fault("drop", "at_tick = 1400\nfor_ticks = 100\nprobability = 0.5"),
        fault(
            "corrupt",
            "as = \"huge\"\nfield = \"potential_j\"\nat_tick = 1600\nfor_ticks = 10",
        ),
    ];
    let scenario = scenario(&desk, "faults.toml", &faults.concat());
    let (first, second) = (
        desk.run(&[&scenario, "--graph", &graph]),
        desk.run(&[&scenario, "--graph", &graph]),
    );
    assert_eq!(first["topics"], second["topics"], "the same bytes twice");
    assert_eq!(
        (restarts(&first, "energy"), restarts(&second, "energy")),
        (2, 2),
        "{}",
        first["faults"]
    );
    let all = first["faults"].list();
    assert!(
        all.len() == 4 && all.iter().all(|fault| fault["occurred"] == true),
        "{}",
        first["faults"]
    );
    assert_eq!(all[3]["plan"]["field"], "potential_j[0]");
    let (count, ticks) = (topic(&first, "energy").0, first["ticks"].count());
    assert!(
        (ticks - 110 - 100..ticks - 110).contains(&count),
        "{count} of {ticks} ticks"
    );
    assert_eq!(
        first["recorder"]["lost"], 0,
        "what a fault kept from leaving is not lost"
    );
    assert_eq!(
        first["outcome"], "goal reached",
        "the loop does not wait for it"
    );
    // The run left a scenario and a graph that repeat it.
    let repeated = desk
        .path()
        .join("runs")
        .join("energy-001")
        .join("scenario.toml");
    assert_eq!(
        desk.run(&[&repeated.display().to_string(), "--no-record"])["topics"],
        first["topics"]
    );
}

#[test]
fn a_sixth_process_survives_the_recorder_and_is_verified() {
    let desk = Desk::new();
    let graph = graph(&desk);
    let death = "\n[[fault]]\nprocess = \"recorder\"\nkind = \"kill\"\nat_tick = 700\n";
    let (plain, deadly) = (
        scenario(&desk, "plain.toml", ""),
        scenario(&desk, "deadly.toml", death),
    );
    let (first, second) = (
        desk.run(&[&plain, "--graph", &graph]),
        desk.run(&[&deadly, "--graph", &graph]),
    );
    assert_eq!(
        first["topics"], second["topics"],
        "a replacement of the recorder misses nothing of a topic that it does not know"
    );
    // A short motion: under the conditions of `verify` every look for a message may pause.
    let short = "--set segment.0.duration_s=0.2 --set settle_s=0.1";
    let verified = desk
        .succeeds(&format!(
            "verify {plain} --graph {graph} --runs 2 --json {short}"
        ))
        .json();
    assert_eq!(verified["identical"], Value::from(true), "{verified}");
    let energies = &verified["reference"]["topics"]["energy"];
    assert_eq!(
        energies["count"], verified["reference"]["ticks"],
        "{verified}"
    );
    assert_eq!(
        verified["reference_run"], 1,
        "one thread has no program of the graph"
    );
}

#[test]
fn a_message_that_the_graph_declares_otherwise_is_refused_with_both_layouts() {
    let desk = Desk::new();
    let path = graph(&desk);
    let text = std::fs::read_to_string(&path)
        .unwrap()
        .replace("manipulability: f64\"", "manipulability: u64\"");
    desk.file("graph.toml", &text);
    let said = desk.armplane(&["run", &scenario(&desk, "plain.toml", ""), "--graph", &path]);
    assert_eq!(said.code, 1, "{}", said.err);
    assert!(
        said.err
            .contains("is declared in the graph with the layout")
            && said.err.contains("armplane.Energy.v1"),
        "{}",
        said.err
    );
    assert_nothing_left(said.launcher);
}

/// The names of the processes are the graph's, in the summary and in the recording.
#[test]
fn a_process_keeps_its_name_in_the_recording() {
    let desk = Desk::new();
    let text = include_str!("../../shared-types/graph.toml");
    assert!(text.contains("name = \"controller\""), "{text}");
    desk.file(
        "renamed.toml",
        &text.replace(
            "name = \"controller\"",
            "name = \"c\"\nprogram = \"controller\"",
        ),
    );
    let short = "--set segment.0.duration_s=0.5 --set segment.1.duration_s=0.5";
    let summary = desk.run(&format!("--graph renamed.toml --out run {short}"));
    assert!(
        summary["processes"]
            .list()
            .iter()
            .any(|process| process["name"] == "c"),
        "{summary}"
    );
    desk.succeeds("export run");
    let read =
        |name: &str| std::fs::read_to_string(desk.path().join("run").join(name)).expect("a file");
    let events = read("events.csv");
    assert!(
        events.contains("state,process/c,up") && events.contains("state,process/analyzer,up"),
        "{events}"
    );
    assert!(
        !events.contains("controller")
            && !read("signals.csv")
                .lines()
                .next()
                .expect("headings")
                .contains("controller")
    );
    let said = desk.armplane("replay run --process c");
    assert!(
        said.code == 0 && said.out.contains("seed 1, c, ") && said.out.contains("the same bytes"),
        "{}{}",
        said.out,
        said.err
    );
    desk.succeeds("replay run");
    let said = desk.armplane("replay run --process controller");
    let refusal = "run has no process `controller` that can be replayed: --process takes plant, estimator, analyzer, c";
    assert!(said.code != 0 && said.err.contains(refusal), "{}", said.err);
}

#[test]
fn a_process_that_never_opens_a_topic_of_its_writes_is_refused() {
    let desk = Desk::new();
    let path = graph(&desk);
    let text = std::fs::read_to_string(&path)
        .unwrap()
        .replace("writes = [\"energy\"]", "writes = [\"spare\", \"energy\"]");
    desk.file(
        "graph.toml",
        &format!("{text}\n[[topic]]\nname = \"spare\"\ntype = \"own.Spare.v1\"\nfields = [\"header: Header\", \"x: f64\"]\n"),
    );
    let scenario = scenario(&desk, "plain.toml", "");
    for mode in ["--no-record", "--no-record --mode realtime"] {
        let said = desk.armplane(&format!("run {scenario} --graph {path} {mode}"));
        assert_eq!(said.code, 1, "{}", said.err);
        assert!(
            said.err
                .contains("energy has no writer for topic \"spare\", which stands in its `writes`"),
            "{}",
            said.err
        );
        assert_nothing_left(said.launcher);
    }
}

#[test]
fn graphs_that_cannot_run_are_refused_before_anything_starts() {
    let desk = Desk::new();
    let process =
        |more: &str| format!("extends = \"armplane\"\n[[process]]\nname = \"mine\"\n{more}\n");
    let writer = |number: u32| {
        format!(
            "[[topic]]
name = \"t{number}\"
type = \"A.B{number}.v1\"
fields = [\"header: Header\", \"v: f64\"]
\
             [[process]]
name = \"p{number}\"
command = [\"true\"]
reads = [\"estimate\"]
writes = [\"t{number}\"]
"
        )
    };
    let crowd = "extends = \"armplane\"\n".to_owned() + &(1..=5).map(writer).collect::<String>();
    let cases = [
        (crowd, "9 processes write messages"),
        (
            process("command = [\"./missing\"]\nreads = [\"estimate\"]"),
            "there is no program",
        ),
        (
            process("command = [\"no-such-program-anywhere\"]\nreads = [\"estimate\"]"),
            "in PATH",
        ),
        (
            process("command = [\"./graph.toml\"]\nreads = [\"estimate\"]"),
            "is not an executable file",
        ),
        (
            process("command = [\"sh\"]\nreads = [\"weather\"]"),
            "there is no topic `weather`",
        ),
    ];
    for (text, expected) in cases {
        desk.file("graph.toml", &text);
        let said = desk.armplane("run fig5-wrist-rotation --graph graph.toml");
        assert_eq!(said.code, 2, "{text}\n{}{}", said.out, said.err);
        assert!(said.err.contains(expected), "{text}\n{}", said.err);
        assert!(
            !desk.path().join("runs").exists(),
            "a results folder for a graph that cannot run"
        );
    }
}
