//! `inspect`, `list` and `graph`: what a user sees of arms and processes.

use serde_json::Value;

use crate::command::{Desk, Known};

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(items) => items.iter().flat_map(numbers).collect(),
        other => vec![other.as_f64().unwrap_or(f64::NAN)],
    }
}

/// Asserts that two lists are equal, to a share of their values or of 1.
fn assert_close(what: &str, ours: &[f64], theirs: &[f64], share: f64) {
    assert_eq!(ours.len(), theirs.len(), "{what}");
    for (a, b) in ours.iter().zip(theirs) {
        assert!((a - b).abs() <= share * (1.0 + b.abs()), "{what}: {a} {b}");
    }
}

#[test]
fn wrist_lock_is_named_and_classified() {
    let found = Desk::new().json("inspect --q-deg=20,-60,170,0,0,0");
    for (name, inside, class) in [("wrist", true, "type 2"), ("elbow", false, "type 1")] {
        let mut listed = found["singularities"].list().iter();
        let one = listed.find(|one| one["name"] == name).unwrap();
        assert!(one["inside"] == inside && one["type"] == class, "{one}");
    }
    assert_eq!(found["rank"], 5);
    assert!(found["det"].number().abs() < 1e-12);
}

#[test]
fn list_and_graph_speak_json_and_drawings() {
    let desk = Desk::new();
    let listed = desk.json("list");
    for (kind, name) in [("scenarios", "fig5-wrist-rotation"), ("robots", "puma560")] {
        let mut names = listed[kind].list().iter();
        assert!(names.any(|one| one["name"] == name), "{name}");
    }
    for (format, line) in [
        (
            "dot",
            "controller -> plant [label=\"torque\", style=dashed]",
        ),
        ("mermaid", "plant -->|sensor| estimator"),
    ] {
        let drawn = desk.succeeds(&format!("graph --format {format}")).out;
        assert!(drawn.contains(line), "{drawn}");
    }
    desk.json("graph").holds(r#"{"process/#": 5}"#);
}

/// A body with its joint to the one before.
fn link(name: &str, parent: &str, at: &str, axis: &str) -> String {
    format!(
        r#"<link name="{name}"><inertial><origin xyz="0.1 0 0.1"/><mass value="1"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial></link>
        <joint name="to_{name}" type="revolute"><parent link="{parent}"/><child link="{name}"/>
        <origin xyz="{at}"/><axis xyz="{axis}"/><limit lower="-1" upper="1.5" effort="10" velocity="2"/></joint>"#
    )
}

/// Arms of 2, 5 and 8 joints, without `--q`: the middle of each range, and matrices of the arm's own size.
#[test]
fn arms_of_any_size_are_inspected_in_the_middle_of_their_ranges() {
    let desk = Desk::new();
    let axes = [
        "0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "0 0 1", "1 0 0", "0 1 0",
    ];
    for joints in [2, 5, 8] {
        let names: Vec<_> = (0..=joints).map(|i| format!("l{i}")).collect();
        let links = names.windows(2).zip(axes);
        let links: String = links
            .map(|(pair, axis)| link(&pair[1], &pair[0], "0.1 0 0.2", axis))
            .collect();
        let head = r#"<robot name="arm"><link name="l0"/><drake:ignored><deep/></drake:ignored>"#;
        desk.file("arm.urdf", format!("{head}{links}</robot>"));
        let found = desk.json("inspect --robot arm.urdf");
        assert_eq!(numbers(&found["q"]), vec![0.25; joints]);
        let sizes = ["A", "J"].map(|matrix| numbers(&found[matrix]).len());
        assert_eq!(sizes, [joints * joints, 6 * joints]);
        assert_eq!(found["rank"], joints.min(6));
    }
}

#[test]
fn an_arm_from_another_base_on_is_the_rest_of_the_chain() {
    let desk = Desk::new();
    let [whole, rest] = [
        "--q=0,-1.2,1.6,-1.0,0.9,0.2",
        "--base shoulder_link --q=-1.2,1.6,-1.0,0.9,0.2",
    ]
    .map(|args| desk.json(&format!("inspect --robot ur5 {args}")));
    // The first joint at rest, the others carry what they carried.
    let all = numbers(&whole["A"]);
    let rows = all.chunks(6).skip(1).flat_map(|row| row[1..].to_vec());
    assert_close("A", &rows.collect::<Vec<_>>(), &numbers(&rest["A"]), 1e-12);
    let gravity = numbers(&whole["gravity"]);
    assert_close("gravity", &gravity[1..], &numbers(&rest["gravity"]), 1e-12);
}

#[test]
fn a_frame_chooses_one_of_several_arms() {
    let desk = Desk::new();
    let arms = [("left", 0.2), ("right", -0.2)];
    let parts = arms.map(|(side, y)| {
        let upper = link(
            &format!("{side}_upper"),
            "base",
            &format!("0.3 {y} 0"),
            "0 0 1",
        );
        upper
            + &link(
                &format!("{side}_fore"),
                &format!("{side}_upper"),
                "0.3 0 0",
                "0 0 1",
            )
    });
    let urdf = format!(
        "<robot name=\"two\"><link name=\"base\"/>{}</robot>",
        parts.concat()
    );
    desk.file("two.urdf", urdf);
    desk.refuses(2, "inspect --robot two.urdf", "'base' --frame");
    for (side, y) in arms {
        let seen = desk.json(&format!(
            "inspect --robot two.urdf --frame {side}_fore --q=0,0"
        ));
        let position = [0, 1, 2].map(|row| seen["pose"][row][3].number());
        assert_eq!(position, [0.6, y, 0.0], "{seen}");
    }
}
