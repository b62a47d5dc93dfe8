//! One door for files: nothing is written through a link or into a pipe, and a saved run that was damaged is not run.

use std::os::unix::fs::symlink;
use std::process::Command;

use crate::command::Desk;

const SHORT: &str = "name = \"short\"\nrobot = \"arm.urdf\"\nsettle_s = 0.1\n[start]\nq_deg = [10, 40]\n[[segment]]\nby_m = [-0.01, 0.0, 0.0]\nduration_s = 0.3\n";

/// Two links in a plane.
const ARM: &str = r#"<robot name="two"><link name="base"/><link name="upper"><inertial><origin xyz="0.15 0 0"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.15 0 0"/><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="one" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="20" velocity="6"/></joint>
<joint name="two" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.3 0 0"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="20" velocity="6"/></joint>
<link name="hand"/><joint name="fixed" type="fixed"><parent link="fore"/><child link="hand"/><origin xyz="0.3 0 0"/></joint></robot>"#;

fn desk() -> Desk {
    let desk = Desk::new();
    desk.file("arm.urdf", ARM);
    desk.file("arm.toml", "task = [\"x\", \"y\"]\n");
    desk.file("short.toml", SHORT);
    desk.run("short.toml --out r");
    desk
}

#[test]
fn no_result_is_written_behind_a_link_or_into_a_pipe() {
    let desk = desk();
    let at = |name: &str| desk.path().join(name);
    let victim = desk.file("victim", "mine");
    std::fs::create_dir(at("out")).unwrap();
    for name in [
        "page.html",
        "out/signals.csv",
        "out/signals.parquet",
        "out/whole.rrd",
    ] {
        symlink(&victim, at(name)).unwrap();
    }
    let formats =
        ["csv", "parquet", "rrd"].map(|format| format!("export r --format {format} --out out"));
    for command in formats
        .iter()
        .map(String::as_str)
        .chain(["report r --out page.html"])
    {
        let said = desk.armplane(command);
        assert!([1, 2].contains(&said.code), "{command}: {}", said.err);
        assert_eq!(said.err.lines().count(), 1, "{command}: {}", said.err);
        assert_eq!(desk.read("victim"), "mine", "{command}");
    }
    std::fs::create_dir(at("drawn")).unwrap();
    symlink(&victim, at("drawn/figures.json")).unwrap();
    desk.refuses(1, "figures --out drawn", &["figures.json"]);
    assert_eq!(desk.read("victim"), "mine");
    let made = Command::new("mkfifo").arg(at("pipe")).status().unwrap();
    assert!(made.success());
    desk.refuses(1, "report r --out pipe", &["pipe"]);
    std::fs::create_dir_all(at("all/run-1")).unwrap();
    for name in ["messages.mcap", "run.rrd", "job.json"] {
        symlink(&victim, at("all/run-1").join(name)).unwrap();
        desk.refuses(2, "verify short.toml --runs 1 --out all", &[name]);
        std::fs::remove_file(at("all/run-1").join(name)).unwrap();
    }
    symlink(at("out"), at("all/history-1")).unwrap();
    desk.refuses(2, "verify short.toml --kills 1 --out all", &["history-1"]);
    assert_eq!(desk.read("victim"), "mine");
    for (folder, name) in [("pages", "armplane-run.1"), ("manual", "armplane.1")] {
        std::fs::create_dir(at(folder)).unwrap();
        symlink(&victim, at(folder).join(name)).unwrap();
        desk.refuses(2, &format!("generate man {folder}"), &[name]);
        assert_eq!(desk.read("victim"), "mine");
    }
    // What the user holds is written to.
    let page = desk.succeeds("report r --out /dev/stdout");
    assert!(page.out.contains("</html>"));
}

#[test]
fn a_saved_run_that_was_damaged_is_named_and_one_that_was_edited_runs() {
    let desk = desk();
    let whole = desk.run("r/scenario.toml --out again");
    let (scenario, robot) = (desk.read("r/scenario.toml"), desk.read("r/robot.urdf"));
    let (seal, text) = scenario.split_once('\n').unwrap();
    for at in (0..text.len()).step_by(text.len() / 20) {
        let mut bytes = text.as_bytes().to_vec();
        bytes[at] ^= 1;
        let bytes = [seal.as_bytes(), b"\n", &bytes].concat();
        std::fs::write(desk.path().join("r/scenario.toml"), bytes).unwrap();
        desk.refuses(2, "run r/scenario.toml --out none", &["r/scenario.toml"]);
    }
    desk.file("r/scenario.toml", &scenario);
    desk.file(
        "r/robot.urdf",
        &robot.replace("mass value=\"1\"", "mass value=\"2\""),
    );
    desk.refuses(2, "run r/scenario.toml --out none", &["r/robot.urdf"]);
    assert!(!desk.path().join("none").exists());
    desk.file("r/scenario.toml", text);
    let heavier = desk.run("r/scenario.toml --out heavier");
    assert_ne!(heavier["topics"]["torque"], whole["topics"]["torque"]);
}

#[test]
fn a_file_that_nobody_wrote_by_hand_is_not_taken_in_and_a_long_word_is_cut() {
    let desk = desk();
    desk.file("large.toml", &format!("{SHORT}#{}\n", "x".repeat(5 << 20)));
    desk.refuses(2, "run large.toml", &["large.toml"]);
    desk.file(
        "word.toml",
        &format!("{SHORT}{} = 1\n", "x".repeat(1 << 20)),
    );
    let said = desk.armplane("run word.toml");
    assert_eq!(said.code, 2);
    assert!(said.err.len() < 10_000, "{} bytes", said.err.len());
}

/// The output of a command on a terminal, as `script` has caught it, and in pipes.
fn shown(desk: &Desk, args: &str, no_color: &str) -> [Vec<u8>; 2] {
    let line = format!("{} {args}", env!("CARGO_BIN_EXE_armplane"));
    let on_terminal = ["script", "-qec", &line, "/dev/null"];
    let in_pipes = ["bash", "-c", &line];
    [&on_terminal[..], &in_pipes].map(|words| {
        let mut command = Command::new(words[0]);
        command.args(&words[1..]).current_dir(desk.path());
        command.env("SHELL", "/bin/bash").env("TERM", "xterm");
        command.env_remove("NO_COLOR");
        command.envs((!no_color.is_empty()).then_some(("NO_COLOR", no_color)));
        let said = command.stdin(std::process::Stdio::null()).output().unwrap();
        [said.stdout, said.stderr].concat()
    })
}

#[test]
fn codes_from_outside_are_shown_and_colours_go_to_terminals_only() {
    const RED: &[u8] = b"\x1b[31;7m";
    let has = |text: &[u8], part: &[u8]| text.windows(part.len()).any(|at| at == part);
    let desk = Desk::new();
    desk.file("red.toml", "\"\x1b[31;7m\u{202e}\" = 1\n[task\n");
    for args in [
        "run red.toml",
        "run $'--\\e[31;7m\\u202e'",
        "run $'\\e[31;7m\\u202e.toml'",
        "run --json $'--\\e[31;7m\\u202e'",
    ] {
        for said in shown(&desk, args, "") {
            let text = String::from_utf8_lossy(&said);
            assert!(
                !has(&said, RED) && !text.contains('\u{202e}'),
                "{args}: {text:?}"
            );
            assert!(
                text.contains("u001b[31;7m") && text.contains("u202e"),
                "{args}: {text:?}"
            );
        }
    }
    for args in ["--help", "run --unknown", "run red.toml"] {
        let [terminal, pipe] = shown(&desk, args, "");
        assert!(has(&terminal, b"\x1b[") && !has(&pipe, b"\x1b["), "{args}");
        let [terminal, pipe] = shown(&desk, args, "1");
        assert!(!has(&terminal, b"\x1b[") && !has(&pipe, b"\x1b["), "{args}");
    }
}

#[test]
fn an_experiment_removes_files_of_runs_only() {
    let desk = desk();
    let at = |name: &str| desk.path().join(name);
    for folder in ["d/run/sub", "v/run-1", "v/history-1/live", "foreign"] {
        std::fs::create_dir_all(at(folder)).unwrap();
    }
    let own = [
        "d/run/sub/x",
        "d/run/report.html",
        "v/run-1/notes",
        "v/history-1/live/notes",
    ];
    own.iter().for_each(|name| drop(desk.file(name, "mine")));
    desk.succeeds("drill short.toml --only controller:kill --out d");
    desk.succeeds("verify short.toml --runs 1 --out v");
    desk.succeeds("verify short.toml --kills 1 --out v");
    for name in own {
        assert_eq!(desk.read(name), "mine", "{name}");
    }
    assert!(!at("v/history-1/live/messages.mcap").exists());
    // Another program's summary makes no folder of a run, and is not replaced.
    desk.file("foreign/summary.json", "{}");
    desk.file("foreign/report.html", "mine");
    desk.refuses(2, "run short.toml --out foreign", &["summary.json"]);
    assert_eq!(
        (
            desk.read("foreign/summary.json"),
            desk.read("foreign/report.html")
        ),
        ("{}".to_owned(), "mine".to_owned())
    );
    std::fs::rename(at("d/run"), at("d/kept")).unwrap();
    symlink(at("d/kept"), at("d/run")).unwrap();
    desk.refuses(
        2,
        "drill short.toml --only controller:kill --out d",
        &["run"],
    );
    assert_eq!(desk.read("d/kept/sub/x"), "mine");
}
