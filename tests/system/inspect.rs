//! `inspect` against the golden data: the numbers that a user sees are the numbers that were checked.

use serde_json::Value;

use crate::command::{Desk, Known};

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        other => vec![other.as_f64().unwrap_or(f64::NAN)],
    }
}

fn list(value: &Value) -> String {
    numbers(value)
        .iter()
        .map(|x| format!("{x:e}"))
        .collect::<Vec<_>>()
        .join(",")
}

#[test]
fn inspect_agrees_with_the_golden_states() {
    let desk = Desk::new();
    let golden: Value =
        serde_json::from_str(include_str!("../golden/reference_planar3.json")).unwrap();
    for state in &golden["states"].list()[..3] {
        let [q, qdot] = [("q", "q"), ("qdot", "qd")]
            .map(|(option, key)| format!("--{option}={}", list(&state[key])));
        let found = desk.json(&["inspect", "--robot", "planar3r", &q, &qdot]);
        for (ours, theirs) in [
            ("J", "J"),
            ("A", "M"),
            ("gravity", "g"),
            ("bias", "nle"),
            ("Jdot_qdot", "Jdot_qd"),
        ] {
            let (ours_all, theirs_all) = (numbers(&found[ours]), numbers(&state[theirs]));
            assert_eq!(ours_all.len(), theirs_all.len(), "{ours}");
            for (a, b) in ours_all.iter().zip(&theirs_all) {
                assert!((a - b).abs() <= 1e-11 * (1.0 + b.abs()), "{ours}: {a} {b}");
            }
        }
    }
}

#[test]
fn wrist_lock_is_named_and_classified() {
    let said = Desk::new().armplane("inspect --q-deg=20,-60,170,0,0,0 --json");
    let found = said.json();
    let wrist = found["singularities"]
        .list()
        .iter()
        .find(|s| s["name"] == "wrist")
        .unwrap();
    assert_eq!(
        (&wrist["inside"], &wrist["type"]),
        (&true.into(), &"type 2".into())
    );
    assert_eq!(found["rank"], 5);
    assert!(numbers(&found["det"])[0].abs() < 1e-12);
    let elbow = found["singularities"]
        .list()
        .iter()
        .find(|s| s["name"] == "elbow")
        .unwrap();
    assert_eq!(
        (&elbow["inside"], &elbow["type"]),
        (&false.into(), &"type 1".into())
    );
}

#[test]
fn list_and_graph_speak_json_and_drawings() {
    let desk = Desk::new();
    let listed = desk.armplane("list --json").json();
    assert!(
        listed["scenarios"]
            .list()
            .iter()
            .any(|s| s["name"] == "fig5-wrist-rotation")
    );
    assert!(
        listed["robots"]
            .list()
            .iter()
            .any(|r| r["name"] == "puma560")
    );
    let dot = desk.armplane("graph --format dot").out;
    assert!(
        dot.contains("controller -> plant [label=\"torque\", style=dashed]"),
        "{dot}"
    );
    assert!(
        desk.armplane("graph --format mermaid")
            .out
            .contains("plant -->|sensor| estimator")
    );
    let graph = desk.armplane("graph --json").json();
    assert_eq!(graph["process"].list().len(), 5);
}

/// Arms of 2, 5 and 8 joints, without `--q`: the middle of each range, and matrices of the arm's own size.
#[test]
fn arms_of_any_size_are_inspected_in_the_middle_of_their_ranges() {
    let desk = Desk::new();
    for joints in [2, 5, 8] {
        let axes = [
            "0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "0 0 1", "1 0 0", "0 1 0",
        ];
        let body = r#"<inertial><origin xyz="0.1 0 0.1"/><mass value="1"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>"#;
        let mut urdf =
            r#"<robot name="arm"><link name="l0"/><drake:ignored><deep/></drake:ignored>"#
                .to_owned();
        for (i, axis) in axes[..joints].iter().enumerate() {
            let (parent, child) = (i, i + 1);
            urdf += &format!(
                r#"<link name="l{child}">{body}</link><joint name="j{child}" type="revolute"><parent link="l{parent}"/><child link="l{child}"/>
                <origin xyz="0.1 0 0.2"/><axis xyz="{axis}"/><limit lower="-1" upper="1.5" effort="10" velocity="2"/></joint>"#
            );
        }
        desk.file("arm.urdf", &(urdf + "</robot>"));
        let found = desk.json("inspect --robot arm.urdf");
        assert_eq!(numbers(&found["q"]), vec![0.25; joints]);
        assert_eq!(
            (numbers(&found["A"]).len(), numbers(&found["J"]).len()),
            (joints * joints, 6 * joints)
        );
        assert_eq!(found["rank"], joints.min(6));
    }
}

#[test]
fn an_arm_from_another_base_on_is_the_rest_of_the_chain() {
    let desk = Desk::new();
    let said = |arguments: &str| {
        let said = desk.succeeds(&format!("inspect --robot ur5 --json {arguments}"));
        said.json()
    };
    let whole = said("--q=0,-1.2,1.6,-1.0,0.9,0.2");
    let rest = said("--base shoulder_link --q=-1.2,1.6,-1.0,0.9,0.2");
    // The first joint at rest, the others carry what they carried.
    let (all, part) = (numbers(&whole["A"]), numbers(&rest["A"]));
    assert_eq!((all.len(), part.len()), (36, 25));
    for row in 0..5 {
        for column in 0..5 {
            let (a, b) = (all[6 * (row + 1) + column + 1], part[5 * row + column]);
            assert!((a - b).abs() < 1e-12, "A[{row}, {column}]: {a} against {b}");
        }
    }
    for (a, b) in numbers(&whole["gravity"])[1..]
        .iter()
        .zip(numbers(&rest["gravity"]))
    {
        assert!((a - b).abs() < 1e-12, "gravity: {a} against {b}");
    }
    let none = desk.armplane("inspect --robot ur5 --base wheel");
    assert_eq!(none.code, 2, "{}", none.out);
    assert!(none.err.contains("wheel"), "{}", none.err);
}

#[test]
fn a_frame_chooses_one_of_several_arms() {
    let desk = Desk::new();
    let joint = |name: &str, parent: &str, child: &str, y: f64| {
        format!(
            "<joint name=\"{name}\" type=\"revolute\"><parent link=\"{parent}\"/><child link=\"{child}\"/><origin xyz=\"0.3 {y} 0\"/><axis xyz=\"0 0 1\"/>\
             <limit lower=\"-2\" upper=\"2\" effort=\"10\" velocity=\"2\"/></joint>"
        )
    };
    let link = |name: &str| {
        format!(
            "<link name=\"{name}\"><inertial><mass value=\"1\"/><inertia ixx=\"0.1\" iyy=\"0.1\" izz=\"0.1\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>"
        )
    };
    let arms = [("left", 0.2), ("right", -0.2)];
    let parts = arms.map(|(side, y)| {
        let (upper, fore) = (format!("{side}_upper"), format!("{side}_fore"));
        [
            link(&upper),
            link(&fore),
            joint(&format!("{side}_1"), "base", &upper, y),
            joint(&format!("{side}_2"), &upper, &fore, 0.0),
        ]
        .concat()
    });
    desk.file(
        "two.urdf",
        &format!(
            "<robot name=\"two\"><link name=\"base\"/>{}</robot>",
            parts.concat()
        ),
    );
    let said = desk.armplane("inspect --robot two.urdf");
    assert!(
        said.code == 2 && said.err.contains("branches at link 'base'"),
        "{}",
        said.err
    );
    for (side, y) in arms {
        let said = desk.armplane(&[
            "inspect",
            "--robot",
            "two.urdf",
            "--frame",
            &format!("{side}_fore"),
            "--q=0,0",
            "--json",
        ]);
        let seen = said.json();
        let position: Vec<f64> = (0..3).map(|row| seen["pose"][row][3].number()).collect();
        assert_eq!(position, [0.6, y, 0.0], "{seen}");
    }
}
