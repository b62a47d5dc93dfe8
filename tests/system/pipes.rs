//! Named pipes in the places of files: to open one is to wait for its writer, which may never come.

use std::time::{Duration, Instant};

use crate::command::Desk;

const SHORT: &str = "name = \"short\"\nrobot = \"puma560\"\nsettle_s = 0.3\n[start]\nq_deg = [20, -60, 170, 0, 30, 0]\n\
                     [[segment]]\nby_m = [0.01, 0.0, 0.0]\nduration_s = 0.5\n";

pub(crate) fn make_pipe(path: &std::path::Path) {
    let _ = std::fs::remove_file(path);
    assert!(
        std::process::Command::new("mkfifo")
            .arg(path)
            .status()
            .expect("mkfifo")
            .success()
    );
}

#[test]
fn a_pipe_without_a_writer_is_refused_in_one_sentence_by_every_command() {
    let desk = Desk::new();
    desk.file("short.toml", SHORT);
    desk.run("short.toml --out r");
    for name in ["p.toml", "p.urdf", "p.csv", "p"] {
        make_pipe(&desk.path().join(name));
    }
    desk.file("robot.toml", &SHORT.replace("\"puma560\"", "\"p.urdf\""));
    desk.file(
        "graph.toml",
        &SHORT.replace("settle_s", "graph = \"p.toml\"\nsettle_s"),
    );
    let refused = |args: &str, words: &str, codes: &[i32]| {
        let began = Instant::now();
        let said = desk.armplane(args);
        assert!(
            codes.contains(&said.code)
                && said
                    .err
                    .lines()
                    .next()
                    .is_some_and(|sentence| sentence.contains(words)),
            "{args:?}: {}: {}{}",
            said.code,
            said.out,
            said.err
        );
        assert!(
            began.elapsed() < Duration::from_secs(20),
            "{args:?} took {:?}",
            began.elapsed()
        );
    };
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
        "sweep p.toml",
        "verify p.toml",
        "servo p.toml",
        "servo puma560 --from p.csv",
    ] {
        refused(args, "a named pipe", &[2]);
    }
    // In the folder of a run.
    let file = |name: &str| desk.path().join("r").join(name);
    for (name, commands) in [
        ("summary.json", &["report", "export"][..]),
        ("job.json", &["replay", "recover"]),
        ("messages.mcap", &["replay", "export"]),
        ("run.rrd", &["report", "export", "view"]),
    ] {
        let kept = std::fs::read(file(name)).unwrap();
        make_pipe(&file(name));
        if commands.contains(&"recover") {
            let summary = std::fs::read(file("summary.json")).unwrap();
            std::fs::remove_file(file("summary.json")).unwrap();
            refused("recover r", name, &[1, 2]);
            std::fs::write(file("summary.json"), summary).unwrap();
        }
        for command in commands.iter().filter(|command| **command != "recover") {
            let began = Instant::now();
            let said = desk.armplane(&[command, "r"]);
            assert!(
                said.code > 0 && said.code < 3 && !(said.err.clone() + &said.out).is_empty(),
                "{command} with {name}: {}: {}{}",
                said.code,
                said.out,
                said.err
            );
            assert!(
                *command != "view" || said.err.contains("a named pipe"),
                "a viewer was started: {}",
                said.err
            );
            assert!(
                began.elapsed() < Duration::from_secs(20),
                "{command} with {name} took {:?}",
                began.elapsed()
            );
        }
        std::fs::remove_file(file(name)).unwrap();
        std::fs::write(file(name), kept).unwrap();
    }
}

#[test]
fn a_scenario_comes_through_a_pipe_that_the_shell_makes() {
    let desk = Desk::new();
    desk.file("short.toml", SHORT);
    let of = |script: &str| {
        let output = std::process::Command::new("bash")
            .args(["-c", script, env!("CARGO_BIN_EXE_armplane")])
            .current_dir(desk.path())
            .output()
            .expect("bash");
        let summary: serde_json::Value = serde_json::from_slice(&output.stdout)
            .unwrap_or_else(|error| panic!("{error}: {}", String::from_utf8_lossy(&output.stderr)));
        summary["topics"].clone()
    };
    let expected = desk.run("short.toml --out r")["topics"].clone();
    assert_eq!(
        of("\"$0\" run <(sleep 0.2; cat short.toml) --out s --json"),
        expected
    );
    assert_eq!(
        of("cat short.toml | \"$0\" run /dev/stdin --out t --json"),
        expected
    );
}
