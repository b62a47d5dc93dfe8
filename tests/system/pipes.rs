//! Named pipes in the places of files: to open one is to wait for its writer, which may never come.

use std::time::{Duration, Instant};

use crate::command::{Desk, Said};

const SHORT: &str = "name = \"short\"\nrobot = \"puma560\"\nsettle_s = 0.3\n[start]\nq_deg = [20, -60, 170, 0, 30, 0]\n\
                     [[segment]]\nby_m = [0.01, 0.0, 0.0]\nduration_s = 0.5\n";

/// A command that is refused before a writer could come.
fn refused(desk: &Desk, args: &str) -> Said {
    let began = Instant::now();
    let said = desk.armplane(args);
    let took = began.elapsed();
    assert!(
        [1, 2].contains(&said.code) && took < Duration::from_secs(20),
        "{args}: {}, {took:?}: {}{}",
        said.code,
        said.out,
        said.err
    );
    said
}

#[test]
fn a_pipe_without_a_writer_is_refused_in_one_sentence_by_every_command() {
    let desk = Desk::new();
    desk.file("short.toml", SHORT);
    desk.run("short.toml --out r");
    for name in ["p.toml", "p.urdf", "p.csv", "p"] {
        desk.pipe(name);
    }
    desk.file("robot.toml", SHORT.replace("\"puma560\"", "\"p.urdf\""));
    desk.file(
        "graph.toml",
        SHORT.replace("settle_s", "graph = \"p.toml\"\nsettle_s"),
    );
    for args in [
        "run p.toml",
        "run p",
        "run robot.toml",
        "run graph.toml",
        "run short.toml --graph p.toml",
        "graph p.toml",
        "graph p.toml --format topics",
        "inspect --robot p.urdf",
        "drill p.toml",
        "compare p.toml",
        "verify p.toml",
        "servo p.toml",
        "servo puma560 --from p.csv",
    ] {
        let said = refused(&desk, args);
        let sentence = said.err.lines().next().unwrap_or_default();
        assert!(
            said.code == 2 && sentence.contains("/dev/stdin"),
            "{args}: {}",
            said.err
        );
    }
    // In the folder of a run.
    for (name, commands) in [
        ("summary.json", &["report", "export"][..]),
        ("job.json", &["replay"]),
        ("messages.mcap", &["replay", "export"]),
        ("run.rrd", &["view"]),
    ] {
        let path = format!("r/{name}");
        let kept = desk.bytes(&path);
        desk.pipe(&path);
        for command in commands {
            let said = refused(&desk, &format!("{command} r"));
            assert!(
                !(said.err.clone() + &said.out).is_empty(),
                "{command} with {name}"
            );
            let is_refusal = *command != "view" || said.err.contains("r/run.rrd:");
            assert!(is_refusal, "a viewer was started: {}", said.err);
        }
        desk.remove(&path);
        desk.file(&path, kept);
    }
    desk.remove("r/summary.json");
    desk.pipe("r/job.json");
    let said = refused(&desk, "recover r --only-results");
    assert!(
        said.err
            .lines()
            .next()
            .unwrap_or_default()
            .contains("job.json"),
        "{}",
        said.err
    );
}

#[test]
fn a_scenario_comes_through_a_pipe_that_the_shell_makes() {
    let desk = Desk::new();
    desk.file("short.toml", SHORT);
    let expected = desk.run("short.toml --out r")["topics"].take();
    for script in [
        "\"$ARMPLANE\" run <(sleep 0.2; cat short.toml) --out s --json",
        "cat short.toml | \"$ARMPLANE\" run /dev/stdin --out t --json",
    ] {
        let mut bash = desk.program("bash");
        let output = bash.args(["-c", script]).output().expect("bash");
        let summary: serde_json::Value = serde_json::from_slice(&output.stdout)
            .unwrap_or_else(|error| panic!("{error}: {output:?}"));
        assert_eq!(summary["topics"], expected, "{script}");
    }
}
