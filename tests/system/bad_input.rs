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
        ("bare", "puma560", "plain.urdf"),
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
    desk.file("plain.urdf", URDF_WITHOUT_INERTIA);
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
        ("view", "`armplane run` runs/"),
        ("run fig5-wrist-rotatoin", "`fig5-wrist-rotation`"),
        ("run missing.toml", "missing.toml:"),
        ("run typo.toml", "typo.toml:6: `duration_s`"),
        ("run syntax.toml", "syntax.toml:3: `]`"),
        ("run robot.toml", "robot.toml:2: `puma560`"),
        ("run posture.toml", "posture.toml:4: 'joint5' 1.7453"),
        ("run joints.toml", "joints.toml:4: 3 'joint6'"),
        ("run leg.toml", "leg.toml: 0: 1 'joint6'"),
        ("run turn.toml", "turn.toml: 0: 'wrst' elbow"),
        (
            "run good.toml --set plant.floor_m=1",
            "good.toml: link1 plant.floor_m",
        ),
        (
            "run good.toml --set frame=nowhere",
            "good.toml: `nowhere` flange",
        ),
        ("run bare.toml", "bare.toml:2: 'arm' <inertial>"),
        ("run fault.toml", "fault.toml:5: `drop`"),
        ("run joint.toml", "joint.toml:5: 9: puma560 6"),
        ("run good.toml --set control.kp=1", "`k_p`"),
        ("run good.toml --set rate_hz=7", "rate_hz=7 50 20000"),
        ("run good.toml --out /proc/nowhere", "/proc/nowhere: --out"),
        ("run good.toml --graph typo.toml", "typo.toml:1: `extends`"),
        (
            "inspect --robot macro.urdf",
            "macro.urdf: <xacro:arm> `xacro",
        ),
        ("new mine --robot hand.urdf", "'hand' 'arm' <inertial>"),
        ("inspect --robot r2d2 --q 0", "`r2d2` puma560-ideal"),
        ("inspect --q 0,0,0", "3 'joint6'"),
        ("inspect --robot ur5 --base wheel", "'wheel' 'tool0'"),
        ("fault controller kill --run nowhere", "nowhere"),
        ("report nowhere", "nowhere: runs/fig5-wrist-rotation-001"),
        ("replay nowhere", "nowhere job.json"),
        ("export empty", "empty messages.mcap summary.json"),
        ("run .", ".toml"),
        ("compare fig5 --law blendet", "`blended`"),
        ("compare fig5-wrist-rotatoin", "`fig5-wrist-rotation`"),
        ("compare sweep --speed 0", "--speed 0: m/s"),
        (
            "compare sweep --set control.baseline.truncated_svd_floor=-1",
            "`control.baseline.truncated_svd_floor` -1",
        ),
        ("compare sweep --robot ur6 --out out", "`ur5`"),
        ("compare --robot ur5", "--robot sweep"),
        ("generate man /proc/nowhere", "/proc/nowhere:"),
    ]);
    // Of runs without a recording or messages.
    desk.run("good.toml --out run");
    desk.run("good.toml --out bare --no-record");
    desk.refuses_each(&[
        ("export bare", "bare --no-record"),
        ("view bare", "bare --no-record"),
        ("view bare --layout pretty", "'pretty' timing"),
        ("replay bare", "bare"),
        ("replay run --set control.kp=1", "`k_p`"),
        ("replay run --set robot=ur5", "puma560 robot="),
    ]);
    // No scenario: in one line.
    for file in [
        "arm.urdf",
        "arm.xml",
        "run/run.rrd",
        "run/messages.mcap",
        "run",
    ] {
        let said = desk.refuses(2, &format!("run {file}"), file);
        assert_eq!(said.err.lines().count(), 1, "{}", said.err);
    }
    // The sentence and the lines of the file do not say the same.
    let said = desk.refuses(2, "run robot.toml", "");
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
