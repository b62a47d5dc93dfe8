//! One door for files: nothing is written through a link or into a pipe, and a saved run that was damaged is not run.

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
    desk.file("victim", "mine");
    desk
}

#[test]
fn no_result_is_written_behind_a_link_or_into_a_pipe() {
    let desk = desk();
    for folder in ["out", "all/run-1", "pages", "manual"] {
        std::fs::create_dir_all(desk.at(folder)).unwrap();
    }
    for (link, command, code) in [
        ("out/signals.csv", "export r --format csv --out out", 1),
        (
            "out/signals.parquet",
            "export r --format parquet --out out",
            1,
        ),
        ("out/run.rrd", "export r --format rrd --out out", 1),
        ("page.html", "report r --out page.html", 1),
        (
            "all/run-1/messages.mcap",
            "verify short.toml --runs 1 --out all",
            2,
        ),
        (
            "all/run-1/run.rrd",
            "verify short.toml --runs 1 --out all",
            2,
        ),
        (
            "all/run-1/job.json",
            "verify short.toml --runs 1 --out all",
            2,
        ),
        ("pages/armplane-run.1", "generate man pages", 2),
        ("manual/armplane.1", "generate man manual", 2),
    ] {
        desk.link(link, "victim");
        let (_, name) = link.rsplit_once('/').unwrap_or(("", link));
        let said = desk.refuses(code, command, name);
        assert_eq!(said.err.lines().count(), 1, "{command}: {}", said.err);
        assert_eq!(desk.read("victim"), "mine", "{command}");
        desk.remove(link);
    }
    desk.pipe("pipe");
    desk.refuses(1, "report r --out pipe", "pipe");
    std::fs::remove_dir(desk.at("all/run-1")).unwrap();
    desk.link("all/run-1", "out");
    desk.refuses(2, "verify short.toml --kills 1 --out all", "run-1");
    // What the user holds is written to.
    let page = desk.succeeds("report r --out /dev/stdout");
    assert!(page.out.contains("</html>"));
}

#[test]
fn a_saved_run_that_was_damaged_is_named_and_one_that_was_edited_runs() {
    let desk = desk();
    let whole = desk.run("r/scenario.toml --out again");
    let [scenario, robot] = ["r/scenario.toml", "r/robot.urdf"].map(|name| desk.read(name));
    let (seal, text) = scenario.split_once('\n').unwrap();
    for at in (seal.len() + 1..scenario.len()).step_by(text.len() / 20) {
        let mut bytes = scenario.clone().into_bytes();
        bytes[at] ^= 1;
        desk.file("r/scenario.toml", bytes);
        desk.refuses(2, "run r/scenario.toml --out none", "r/scenario.toml");
    }
    desk.file("r/scenario.toml", &scenario);
    desk.file(
        "r/robot.urdf",
        robot.replace("mass value=\"1\"", "mass value=\"2\""),
    );
    desk.refuses(2, "run r/scenario.toml --out none", "r/robot.urdf");
    assert!(!desk.has("none"));
    desk.file("r/scenario.toml", text);
    let heavier = desk.run("r/scenario.toml --out heavier");
    assert_ne!(heavier["topics"]["torque"], whole["topics"]["torque"]);
}

#[test]
fn a_file_that_nobody_wrote_by_hand_is_not_taken_in_and_a_long_word_is_cut() {
    let desk = Desk::new();
    let with = |more: String| desk.file("large.toml", SHORT.to_owned() + &more);
    with(format!("#{}\n", "x".repeat(5 << 20)));
    desk.refuses(2, "run large.toml", "large.toml");
    with(format!("{} = 1\n", "x".repeat(1 << 20)));
    let said = desk.refuses(2, "run large.toml", "");
    assert!(said.err.len() < 10_000, "{} bytes", said.err.len());
}

/// The output of a command on a terminal, as `script` has caught it, and in pipes.
fn shown(desk: &Desk, args: &str, no_color: &str) -> [String; 2] {
    let line = format!("{} {args}", env!("CARGO_BIN_EXE_armplane"));
    let on_terminal = ["script", "-qec", &line, "/dev/null"];
    let in_pipes = ["bash", "-c", &line];
    [&on_terminal[..], &in_pipes].map(|words| {
        let mut command = desk.program(words[0]);
        command
            .args(&words[1..])
            .env("SHELL", "/bin/bash")
            .env("TERM", "xterm");
        command.env_remove("NO_COLOR");
        command.envs((!no_color.is_empty()).then_some(("NO_COLOR", no_color)));
        let said = command.output().unwrap();
        String::from_utf8_lossy(&[said.stdout, said.stderr].concat()).into_owned()
    })
}

#[test]
fn codes_from_outside_are_left_out_and_colours_go_to_terminals_only() {
    let desk = Desk::new();
    desk.file("red.toml", "\"\x1b[31;7m\u{202e}\" = 1\n[task\n");
    for args in [
        "run red.toml",
        "run $'--\\e[31;7m\\u202e'",
        "run $'\\e[31;7m\\u202e.toml'",
        "run --json $'--\\e[31;7m\\u202e'",
    ] {
        for text in shown(&desk, args, "") {
            let has = |part: &str| text.contains(part);
            assert!(!has("\x1b[31;7m") && !has("\u{202e}"), "{args}: {text:?}");
        }
    }
    for args in ["--help", "run --unknown", "run red.toml"] {
        for (no_color, colours) in [("", [true, false]), ("1", [false, false])] {
            let found = shown(&desk, args, no_color).map(|text| text.contains("\x1b["));
            assert_eq!(found, colours, "{args}");
        }
    }
}

#[test]
fn an_experiment_removes_files_of_runs_only() {
    let desk = desk();
    let own = [
        "d/run/sub/x",
        "d/run/report.html",
        "v/run-1/notes",
        "v/run-2/notes",
    ];
    for name in own {
        desk.file(name, "mine");
    }
    desk.succeeds("drill short.toml --only controller:kill --out d");
    desk.succeeds("verify short.toml --runs 1 --out v");
    desk.succeeds("verify short.toml --kills 1 --out v");
    for name in own {
        assert_eq!(desk.read(name), "mine", "{name}");
    }
    // Another program's summary makes no folder of a run, and is not replaced.
    desk.file("foreign/summary.json", "{}");
    desk.file("foreign/report.html", "mine");
    desk.refuses(2, "run short.toml --out foreign", "summary.json");
    let foreign = ["foreign/summary.json", "foreign/report.html"].map(|name| desk.read(name));
    assert_eq!(foreign, ["{}", "mine"]);
    std::fs::rename(desk.at("d/run"), desk.at("d/kept")).unwrap();
    desk.link("d/run", "d/kept");
    desk.refuses(2, "drill short.toml --only controller:kill --out d", "run");
    assert_eq!(desk.read("d/kept/sub/x"), "mine");
}
