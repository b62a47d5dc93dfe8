//! One clear sentence, exit code 2, nothing started, nothing left.

use std::os::unix::ffi::OsStrExt as _;

use crate::command::Desk;

const SCENARIO: &str = "name = \"mine\"\nrobot = \"puma560\"\n[start]\nposture = \"nominal\"\n[[segment]]\nduration_s = 0.2\n";

const URDF_WITHOUT_INERTIA: &str = r#"<robot name="bare"><link name="base"/><link name="arm"/>
<joint name="j1" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"#;

const INERTIA_WITHOUT_MASS: &str = r#"<link name="arm"><inertial><mass value="0"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>"#;

#[test]
fn every_wrong_input_is_refused_with_its_reason() {
    let desk = Desk::new();
    let fault = "[[fault]]\nprocess = \"recorder\"\nkind = \"drop\"\n[start]";
    for (name, from, to) in [
        ("good", "mine", "good"),
        ("typo", "duration_s", "duration"),
        ("robot", "puma560", "puma650"),
        ("bare", "puma560", "bare.urdf"),
        (
            "posture",
            "posture = \"nominal\"",
            "q_deg = [0, 0, 0, 0, 170, 0]",
        ),
        ("joints", "posture = \"nominal\"", "q_deg = [0, 0, 0]"),
        ("leg", "duration_s", "posture_deg = [0]\nduration_s"),
        (
            "turn",
            "duration_s",
            "turn = { about = \"zeta:wrst\", by_deg = 1 }\nduration_s",
        ),
        ("syntax", "[start]", "[start"),
        ("fault", "[start]", fault),
        (
            "joint",
            "[start]",
            &fault.replace(
                "recorder\"\nkind = \"drop",
                "plant\"\njoint = 9\nkind = \"sensor",
            ),
        ),
    ] {
        assert!(SCENARIO.contains(from));
        desk.file(format!("{name}.toml"), SCENARIO.replace(from, to));
    }
    desk.file("bare.urdf", URDF_WITHOUT_INERTIA);
    let urdf = |from: &str, to: &str| URDF_WITHOUT_INERTIA.replace(from, to);
    desk.file("macro.urdf", urdf("</robot>", "<xacro:arm/></robot>"));
    desk.file(
        "hand.urdf",
        urdf("<link name=\"arm\"/>", INERTIA_WITHOUT_MASS),
    );
    desk.file("arm.urdf", "<robot/>");
    desk.file("arm.xml", "<mujoco/>");
    desk.file("empty/notes", "mine");
    desk.refuses_each(&[
        ("view", "there is no run under runs/"),
        (
            "run fig5-wrist-rotatoin",
            "did you mean `fig5-wrist-rotation`?",
        ),
        ("run missing.toml", "there is no file missing.toml"),
        (
            "run typo.toml",
            "typo.toml:6: unknown field `duration` (did you mean `duration_s`?)",
        ),
        ("run syntax.toml", "syntax.toml:3"),
        (
            "run robot.toml",
            "robot.toml:2: there is no robot `puma650`",
        ),
        ("run posture.toml", "posture.toml:"),
        ("run joints.toml", "joints.toml:"),
        ("run leg.toml", "segment 0: 1 joint values given"),
        ("run turn.toml", "segment 0: there is no singularity 'wrst'"),
        (
            "run good.toml --set plant.floor_m=1",
            "link1 starts in the floor",
        ),
        (
            "run good.toml --set frame=nowhere",
            "there is no frame `nowhere`",
        ),
        ("run bare.toml", "arm"),
        ("run fault.toml", "cannot happen to the recorder"),
        ("run joint.toml", "has 6 joints"),
        ("run good.toml --set control.kp=1", "unknown field `kp`"),
        ("run good.toml --set rate_hz=7", "rate 7 Hz is out of range"),
        (
            "run good.toml --out /proc/nowhere",
            "choose another folder with --out",
        ),
        ("run good.toml --graph typo.toml", "typo.toml"),
        (
            "inspect --robot macro.urdf",
            "<xacro:arm> is a macro: expand the file first",
        ),
        (
            "inspect --robot hand.urdf",
            "moving link 'arm' has no inertia",
        ),
        ("inspect --robot r2d2 --q 0", "there is no robot `r2d2`"),
        ("inspect --q 0,0,0", "joint"),
        ("inspect --robot ur5 --base wheel", "wheel"),
        ("fault controller kill --run nowhere", "nowhere"),
        ("report nowhere", "there is no run nowhere"),
        ("replay nowhere", "is not the folder of a run"),
        ("export empty", "is not a run"),
        ("run .", "."),
        (
            "compare fig5 --law blendet",
            "there is no control law `blendet`: did you mean `blended`?",
        ),
        (
            "compare fig5-wrist-rotatoin",
            "did you mean `fig5-wrist-rotation`?",
        ),
        (
            "compare sweep --speed 0",
            "--speed is 0: it must be a positive number",
        ),
        (
            "compare sweep --set control.baseline.truncated_svd_floor=-1",
            "it must be a positive number",
        ),
        ("compare sweep --robot ur6 --out out", "ur5"),
        ("compare --robot ur5", "armplane compare sweep --robot"),
        (
            "figures --out /proc/nowhere",
            "choose another folder with --out",
        ),
        ("generate man /proc/nowhere", "/proc/nowhere"),
    ]);
    // Of runs without a recording or messages.
    desk.run("good.toml --out run");
    desk.run("good.toml --out bare --no-record --no-messages");
    desk.refuses_each(&[
        ("export bare", "without --no-record"),
        ("view bare", "without --no-record"),
        ("view bare --layout pretty", "control, timing and faults"),
        ("replay bare", "without --no-messages"),
        ("replay run --set control.kp=1", "unknown field `kp`"),
        ("replay run --set robot=ur5", "keeps the robot of its run"),
    ]);
    desk.file("bare/run.rrd", "not a recording");
    desk.refuses_each(&[("export bare", "is not a recording of armplane")]);
    // No scenario: in one line.
    for file in [
        "arm.urdf",
        "arm.xml",
        "run/run.rrd",
        "run/messages.mcap",
        "run",
    ] {
        let said = desk.refuses(2, &format!("run {file}"), &[file]);
        assert_eq!(said.err.lines().count(), 1, "{}", said.err);
    }
    // The sentence and the lines of the file do not say the same.
    let said = desk.refuses(2, "run robot.toml", &["`puma560`", "MJCF"]);
    assert_eq!(said.err.matches("MJCF").count(), 1, "{}", said.err);
}

#[test]
fn usage_errors_have_exit_code_2_and_help_an_example() {
    let desk = Desk::new();
    let mut command = desk.command("run --no-such-flag");
    assert_eq!(command.status().unwrap().code(), Some(2));
    let not_utf_8 = std::ffi::OsStr::from_bytes(b"\xff\xfe");
    assert_eq!(command.arg(not_utf_8).status().unwrap().code(), Some(2));
    for command in ["run", "list", "inspect", "graph", "doctor", "clean"] {
        let said = desk.succeeds(&format!("{command} --help"));
        assert!(said.out.contains("Example"), "{command}: {}", said.out);
    }
}
