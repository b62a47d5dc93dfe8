//! `inspect`, `list` and `graph`: what a user sees of arms and processes.

use crate::command::{Desk, Known};

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
