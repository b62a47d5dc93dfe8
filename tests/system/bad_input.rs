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
    let scenario = |name: &str, from: &str, to: &str| {
        assert!(SCENARIO.contains(from));
        desk.file(name, &SCENARIO.replace(from, to));
    };
    desk.file("good.toml", SCENARIO);
    scenario("typo.toml", "duration_s", "duration");
    scenario("robot.toml", "puma560", "puma650");
    scenario(
        "posture.toml",
        "posture = \"nominal\"",
        "q_deg = [0, 0, 0, 0, 170, 0]",
    );
    scenario("joints.toml", "posture = \"nominal\"", "q_deg = [0, 0, 0]");
    scenario("syntax.toml", "[start]", "[start");
    desk.file("bare.urdf", URDF_WITHOUT_INERTIA);
    scenario("bare.toml", "puma560", "bare.urdf");

    desk.file(
        "macro.urdf",
        &URDF_WITHOUT_INERTIA.replace("</robot>", "<xacro:arm/></robot>"),
    );
    desk.file(
        "hand.urdf",
        &URDF_WITHOUT_INERTIA.replace("<link name=\"arm\"/>", INERTIA_WITHOUT_MASS),
    );

    let cases: [(&str, &str); 16] = [
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
        ("run bare.toml", "arm"),
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
    ];
    for (args, expected) in cases {
        desk.refuses(2, args, &[expected]);
    }
    assert!(
        !desk.path().join("runs").exists(),
        "no results of a run that did not begin"
    );
}

#[test]
fn usage_errors_have_exit_code_2_and_help_an_example() {
    let desk = Desk::new();
    assert_eq!(desk.armplane("run --no-such-flag").code, 2);
    let not_utf_8 = std::ffi::OsStr::from_bytes(b"\xff\xfe");
    let mut command = desk.command("run --no-such-flag");
    let said = command.arg(not_utf_8).output().unwrap();
    assert_eq!(said.status.code(), Some(2), "{said:?}");
    for command in ["run", "list", "inspect", "graph", "doctor", "clean"] {
        let said = desk.armplane(&format!("{command} --help"));
        assert!(
            said.code == 0 && said.out.contains("Example"),
            "{command}: {}",
            said.out
        );
    }
}
