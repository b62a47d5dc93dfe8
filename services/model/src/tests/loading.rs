//! Reading of URDFs and descriptions, and the sentence of every refusal.

use super::identities::{ODD, odd};
use crate::{Factors, Geometry, Model, ModelError, Robot, RobotError, RobotText, TaskAxes};
use nalgebra::{Matrix3, SVector, Vector3};

fn load(urdf: &str, description: &str) -> Result<Robot, RobotError> {
    Robot::from_source(&RobotText {
        name: "r".to_owned(),
        description: description.to_owned(),
        urdf: urdf.to_owned(),
    })
}

/// The sentence `urdf` with `description` is refused with.
fn refusal(urdf: &str, description: &str) -> String {
    let error = load(urdf, description).expect_err("it must be refused");
    println!("{error}");
    error.to_string()
}

#[track_caller]
fn assert_says(sentence: &str, words: &[&str]) {
    for word in words {
        assert!(sentence.contains(word), "'{word}' is not in: {sentence}");
    }
}

const BODY: &str = r#"<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>"#;

/// A link that is a body.
fn link(name: &str) -> String {
    format!(r#"<link name="{name}">{BODY}</link>"#)
}

/// A joint, with `rest` inside.
fn joint(kind: &str, parent: &str, child: &str, rest: &str) -> String {
    format!(
        r#"<joint name="{parent}-{child}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="1 0 0"/><axis xyz="0 0 1"/>{rest}</joint>"#
    )
}

const LIMIT: &str = r#"<limit lower="-1" upper="2" effort="10" velocity="3"/>"#;

fn robot(parts: &[String]) -> String {
    format!("<robot name=\"r\">{}</robot>", parts.concat())
}

/// One link on a base.
fn pendulum(limit: &str) -> String {
    robot(&[
        link("base"),
        link("a"),
        joint("revolute", "base", "a", limit),
    ])
}

#[test]
fn builtins_load_and_rebuild_from_their_source() {
    for name in Robot::builtin_names() {
        let robot = Robot::builtin(name).unwrap();
        assert_eq!(robot.name, *name);
        assert!(robot.notes.is_empty(), "{:?}", robot.notes);
        assert!(!robot.shapes.is_empty() && !robot.postures.is_empty());
        let wire = serde_json::to_string(&robot.source).unwrap();
        assert_eq!(
            Robot::from_source(&serde_json::from_str(&wire).unwrap()).unwrap(),
            robot
        );
    }
}

#[test]
fn puma_is_what_its_source_says() {
    let robot = Robot::builtin("puma560").unwrap();
    assert_eq!(
        robot.factors,
        Factors::Puma {
            a2: 0.4318,
            a3: -0.0203,
            d4: 0.4331
        }
    );
    assert_eq!(
        (robot.length_m, robot.encoder_bits, robot.task),
        (0.43, 16, TaskAxes::ALL)
    );
    assert_eq!(robot.joints[1].armature, 4.71);
    assert_eq!(
        (robot.joints[4].lower, robot.joints[4].upper),
        (-1.7453292519943295, 1.7453292519943295)
    );
    assert_eq!(
        (robot.joints[0].effort, robot.joints[0].velocity),
        (97.6, 1.92)
    );
    assert_eq!(
        robot.joints[2].inertia,
        Matrix3::from_diagonal(&Vector3::new(0.07100000000000001, 0.0175, 0.086))
    );
    assert_eq!(Robot::builtin("planar3r").unwrap().task.count(), 2);
}

#[test]
fn a_urdf_alone_gets_the_stated_defaults() {
    let robot = load(&pendulum(LIMIT), "").unwrap();
    assert_eq!(robot.default_frame, "a");
    assert_eq!(
        (robot.gravity, robot.encoder_bits, robot.factors),
        (Vector3::new(0.0, 0.0, -9.81), 16, Factors::Numeric)
    );
    assert_eq!(robot.length_m, 1.0);
    assert_eq!(robot.postures["middle"], [0.5]);
    // The frame sits on the axis: all it can do is turn about it.
    assert_eq!(
        robot.task.iter().map(|axis| axis.row()).collect::<Vec<_>>(),
        [5]
    );
    assert_eq!(robot.joints[0].armature, 0.0);

    let arm = odd();
    assert_eq!(arm.default_frame, "tool");
    let spin = &arm.joints[2];
    assert_eq!((spin.viscous_friction, spin.coulomb_friction), (0.5, 0.1));
    assert_eq!(
        (spin.lower, spin.upper, spin.effort, spin.velocity),
        (
            f64::NEG_INFINITY,
            f64::INFINITY,
            f64::INFINITY,
            f64::INFINITY
        )
    );
    assert_eq!(arm.joints[1].armature, 0.7);
    assert_eq!(
        arm.frames
            .iter()
            .map(|frame| frame.joint)
            .collect::<Vec<_>>(),
        [None, Some(0), Some(1), Some(1), Some(2), Some(2)]
    );
}

/// Two point-like bodies bolted together have the second moment of one body.
#[test]
fn fixed_links_are_lumped() {
    let arm = odd();
    let b = &arm.joints[1];
    assert_eq!(b.mass, 3.5);
    // The moment about the link's origin is the sum of the parts', each by its own parallel axes.
    let about_origin = |m: f64, c: Vector3<f64>, I: Matrix3<f64>| {
        I + m * (Matrix3::from_diagonal_element(c.norm_squared()) - c * c.transpose())
    };
    let part =
        |m: f64, X: crate::Pose, I: Matrix3<f64>| about_origin(m, X.p, X.R * I * X.R.transpose());
    let bolt = crate::Pose::from_xyz_rpy([0.05, 0.1, 0.15], [0.6, 0.1, -0.2]);
    let sum = part(
        2.0,
        crate::Pose::from_xyz_rpy([0.0, 0.1, 0.2], [0.0, 0.2, 0.0]),
        Matrix3::new(
            0.02, -0.003, 0.001, -0.003, 0.03, 0.002, 0.001, 0.002, 0.025,
        ),
    ) + part(
        1.5,
        bolt * crate::Pose::from_xyz_rpy([0.02, 0.0, 0.03], [0.1, 0.2, 0.3]),
        Matrix3::new(0.004, 0.001, 0.0, 0.001, 0.005, 0.0, 0.0, 0.0, 0.006),
    );
    assert!((about_origin(b.mass, b.com, b.inertia) - sum).amax() < 1e-15);
}

#[test]
fn branches_are_refused_or_held() {
    let gripper = robot(&[
        link("base"),
        link("arm"),
        link("left"),
        link("right"),
        joint("revolute", "base", "arm", LIMIT),
        joint("prismatic", "arm", "left", LIMIT),
        joint(
            "prismatic",
            "arm",
            "right",
            &format!(r#"{LIMIT}<mimic joint="arm-left"/>"#),
        ),
    ]);
    let held = load(&gripper, "default_frame = \"arm\"").unwrap();
    assert_eq!(
        (held.dof(), held.joints[0].mass, held.notes.len()),
        (1, 3.0, 2)
    );
    assert_says(&held.notes[0], &["'arm-left'", "held at zero"]);
    // A joint that others mimic, and those others, are a gripper.
    let recognised = load(&gripper, "").unwrap();
    assert_eq!(
        (
            &recognised.joints,
            recognised.default_frame.as_str(),
            recognised.notes.len()
        ),
        (&held.joints, "arm", 2)
    );
    let torso = gripper.replace(r#"<mimic joint="arm-left"/>"#, "");
    assert_says(
        &refusal(&torso, ""),
        &[
            "branches at link 'arm'",
            "'arm-left', 'arm-right'",
            "default_frame",
        ],
    );
    assert_eq!(load(&gripper, "default_frame = \"left\"").unwrap().dof(), 2);
    assert_says(
        &refusal(&gripper, "default_frame = \"right\""),
        &["'arm-right' mimics 'arm-left'"],
    );
    assert_says(
        &refusal(&gripper, "default_frame = \"wrong\""),
        &["no frame 'wrong'", "'arm', 'base', 'left', 'right'"],
    );
}

#[test]
fn a_joint_named_as_a_gripper_is_no_part_of_the_arm() {
    let arm = robot(&[
        link("base"),
        link("wrist"),
        link("moving"),
        joint("revolute", "base", "wrist", LIMIT),
        joint("revolute", "wrist", "moving", LIMIT).replace("wrist-moving", "Gripper"),
    ]);
    let read = load(&arm, "").unwrap();
    assert_eq!(
        (read.dof(), read.default_frame.as_str(), read.joints[0].mass),
        (1, "wrist", 2.0)
    );
    assert_says(&read.notes[0], &["'Gripper'", "held at zero"]);
    assert_eq!(load(&arm, "default_frame = \"moving\"").unwrap().dof(), 2);
}

/// Three links in a row, each 1 m along x of the one before.
fn row() -> String {
    robot(&[
        link("base"),
        link("a"),
        link("b"),
        link("c"),
        joint("revolute", "base", "a", LIMIT),
        joint("revolute", "a", "b", LIMIT),
        joint("revolute", "b", "c", LIMIT),
    ])
}

#[test]
fn a_locked_joint_is_a_fixed_one_at_its_position() {
    let free = load(&row(), "").unwrap();
    let locked = load(&row(), "[joints.a-b]\nlocked = 0.7").unwrap();
    assert_eq!(
        (locked.dof(), locked.joints[0].mass, locked.notes.len()),
        (2, 2.0, 0)
    );
    let q = [0.3, -0.4];
    let X = Model::<2>::new(&locked, None)
        .unwrap()
        .forward_kinematics(&SVector::from(q));
    let same = Model::<3>::new(&free, None)
        .unwrap()
        .forward_kinematics(&SVector::from([q[0], 0.7, q[1]]));
    assert!((X.p - same.p).norm() < 1e-15 && (X.R - same.R).norm() < 1e-15);
    assert_says(
        &refusal(&row(), "[joints.a-b]\nlocked = nan"),
        &["'a-b'", "locked = NaN"],
    );
    assert_says(
        &refusal(&row(), "[joints.x]\nlocked = 0"),
        &["joint 'x'", "'base-a', 'a-b', 'b-c'"],
    );
}

#[test]
fn the_base_may_be_any_link() {
    let read = load(&row(), "base_frame = \"a\"").unwrap();
    assert_eq!(
        read.joints
            .iter()
            .map(|joint| joint.name.as_str())
            .collect::<Vec<_>>(),
        ["a-b", "b-c"]
    );
    assert_eq!(read.frame("a").unwrap().joint, None);
    assert!(read.frame("base").is_none());
    assert_says(&refusal(&row(), "base_frame = \"x\""), &["no frame 'x'"]);
    assert_says(
        &refusal(&row(), "base_frame = \"b\"\ndefault_frame = \"a\""),
        &["'a' does not hang on the base 'b'"],
    );
}

#[test]
fn torque_rates_are_read_or_follow_from_the_torque_limits() {
    let rates = |description: &str| {
        load(&row(), description)
            .unwrap()
            .joints
            .iter()
            .map(|joint| joint.torque_rate)
            .collect::<Vec<_>>()
    };
    assert_eq!(rates(""), [500.0; 3]);
    assert_eq!(
        rates("[joints.a-b]\ntorque_rate = 1000\n[joints.b-c]\neffort = 4"),
        [500.0, 1000.0, 200.0]
    );
    assert_says(
        &refusal(&row(), "[joints.a-b]\ntorque_rate = 0"),
        &["'a-b'", "torque_rate = 0"],
    );
    assert_says(
        &refusal(&row(), "[joints.a-b]\ntorque_rate = nan"),
        &["torque_rate = NaN"],
    );
}

/// A link with inertia and no mass: its inertia counts where its body has mass, and it cannot be a body alone.
#[test]
fn inertia_without_mass_counts_or_is_refused() {
    let hand = r#"<link name="hand"><inertial><mass value="0"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.25"/></inertial></link>"#;
    let fused = robot(&[
        link("base"),
        link("a"),
        hand.to_owned(),
        joint("revolute", "base", "a", LIMIT),
        joint("fixed", "a", "hand", ""),
    ]);
    let body = &load(&fused, "").unwrap().joints[0];
    assert_eq!((body.mass, body.com), (1.0, Vector3::zeros()));
    assert!((body.inertia - Matrix3::from_diagonal(&Vector3::new(1.1, 1.2, 1.25))).amax() < 1e-15);
    let alone = robot(&[
        link("base"),
        hand.to_owned(),
        joint("revolute", "base", "hand", LIMIT),
    ]);
    assert_says(
        &refusal(&alone, ""),
        &["moving link 'hand' has no inertia", "<mass>"],
    );
}

#[test]
fn foreign_elements_are_read_over_and_macros_refused() {
    let foreign = row()
        .replace("<robot", "<robot xmlns:drake=\"http://drake.mit.edu\"")
        .replace(
            "</robot>",
            r#"<drake:linear_spring drake:x="1"><drake:deep/></drake:linear_spring></robot>"#,
        );
    assert_eq!(
        load(&foreign, "").unwrap().joints,
        load(&row(), "").unwrap().joints
    );
    let undeclared = row().replace(
        "<axis",
        r#"<drake:rotor_inertia value="1"/><axis drake:note="x""#,
    );
    assert_eq!(
        load(&undeclared, "").unwrap().joints,
        load(&row(), "").unwrap().joints
    );
    assert_says(
        &refusal(&row().replace("</robot>", "<xacro:arm/></robot>"), ""),
        &["xacro:arm", "expand"],
    );
}

#[test]
fn shapes_are_read_and_meshes_noted() {
    let visual = |geometry: &str| {
        format!(
            r#"<link name="a">{BODY}<visual><origin xyz="0 0 1"/><geometry>{geometry}</geometry></visual></link>"#
        )
    };
    let arm = |geometry: &str| {
        load(
            &robot(&[
                link("base"),
                visual(geometry),
                joint("revolute", "base", "a", LIMIT),
            ]),
            "",
        )
        .unwrap()
    };
    let boxed = arm(r#"<box size="1 2 3"/>"#);
    assert_eq!(
        boxed.shapes[0].geometry,
        Geometry::Box {
            size: Vector3::new(1.0, 2.0, 3.0)
        }
    );
    assert_eq!(
        (boxed.shapes[0].joint, boxed.shapes[0].X_LS.p),
        (Some(0), Vector3::z())
    );
    let meshed = arm(r#"<mesh filename="a.stl"/>"#);
    assert!(meshed.shapes.is_empty());
    assert_says(&meshed.notes[0], &["a.stl", "'a'"]);
}

#[test]
fn shapes_have_their_materials_colours() {
    let visual = |material: &str| {
        format!(
            r#"<link name="a">{BODY}<visual><geometry><sphere radius="1"/></geometry>{material}</visual></link>"#
        )
    };
    let arm = |material: &str| {
        let shared = r#"<material name="blue"><color rgba="0 0 1 1"/></material>"#.to_owned();
        load(
            &robot(&[
                shared,
                link("base"),
                visual(material),
                joint("revolute", "base", "a", LIMIT),
            ]),
            "",
        )
        .unwrap()
        .shapes[0]
            .colour
    };
    assert_eq!(
        arm(r#"<material name="x"><color rgba="1 0.5 0 1"/></material>"#),
        Some([1.0, 0.5, 0.0, 1.0])
    );
    assert_eq!(
        arm(r#"<material name="blue"/>"#),
        Some([0.0, 0.0, 1.0, 1.0])
    );
    assert_eq!(
        [
            arm(""),
            arm(r#"<material name="unknown"/>"#),
            arm(r#"<material name="x"><color rgba="7 0 0 1"/></material>"#)
        ],
        [None; 3]
    );
}

#[test]
fn a_mesh_is_shown_as_the_shape_it_collides_as() {
    let body = r#"<visual><geometry><mesh filename="a.dae"/></geometry></visual><collision><origin xyz="0 0 1"/><geometry><capsule radius="0.1" length="0.4"/></geometry></collision>"#;
    let link_a = format!(r#"<link name="a">{BODY}{body}</link>"#);
    let arm = load(
        &robot(&[link("base"), link_a, joint("revolute", "base", "a", LIMIT)]),
        "",
    )
    .unwrap();
    assert_eq!(arm.shapes.len(), 1);
    assert_eq!(
        (arm.shapes[0].geometry, arm.shapes[0].X_LS.p),
        (
            Geometry::Capsule {
                radius: 0.1,
                length: 0.4
            },
            Vector3::z()
        )
    );
    assert_says(&arm.notes[0], &["a.dae"]);
}

#[test]
fn impossible_urdfs_are_refused() {
    assert_says(&refusal("not xml", ""), &["not a readable URDF"]);
    assert_says(&refusal(&robot(&[link("base")]), ""), &["no movable joint"]);
    assert_says(&refusal(&robot(&[]), ""), &["do not form a tree"]);

    let massless = robot(&[
        link("base"),
        r#"<link name="a"/>"#.to_owned(),
        joint("revolute", "base", "a", LIMIT),
    ]);
    assert_says(
        &refusal(&massless, ""),
        &["moving link 'a' has no inertia", "<inertial>"],
    );
    let inertia = |m: &str, x: &str, y: &str, z: &str| {
        let body = format!(
            r#"<link name="a"><inertial><mass value="{m}"/><inertia ixx="{x}" ixy="0" ixz="0" iyy="{y}" iyz="0" izz="{z}"/></inertial></link>"#
        );
        robot(&[link("base"), body, joint("revolute", "base", "a", LIMIT)])
    };
    assert_says(
        &refusal(&inertia("1", "1", "1", "-1"), ""),
        &["link 'a'", "impossible inertia", "-1.0000e0"],
    );
    assert_says(
        &refusal(&inertia("1", "1", "1", "0"), ""),
        &["impossible inertia"],
    );
    assert_says(&refusal(&inertia("-1", "1", "1", "1"), ""), &["mass -1 kg"]);
    // The PUMA's third link as published in 1986.
    assert_says(
        &refusal(&inertia("4.8", "0.066", "0.0125", "0.086"), ""),
        &["1.2500e-2, 6.6000e-2, 8.6000e-2", "sum of the other two"],
    );
    assert_says(
        &refusal(&inertia("nan", "1", "1", "1"), ""),
        &["inertia of link 'a' is not a finite number"],
    );
    assert_says(
        &refusal(&inertia("1", "inf", "1", "1"), ""),
        &["inertia of link 'a' is not a finite number"],
    );

    let floating = robot(&[link("base"), link("a"), joint("floating", "base", "a", "")]);
    assert_says(&refusal(&floating, ""), &["'base-a' is of type floating"]);
    let twisted = ODD.replace("1 -2 0.5", "0 0 0");
    assert_says(
        &refusal(&twisted, ""),
        &["'turn'", "axis", "[0.0, 0.0, 0.0]"],
    );
    let nowhere = ODD.replace("0.2 -0.1 0", "0.2 nan 0");
    assert_says(
        &refusal(&nowhere, ""),
        &["pose of joint 'spin' is not a finite number"],
    );

    assert_says(
        &refusal(&pendulum(""), ""),
        &["'base-a'", "upper = 0", "<limit>"],
    );
    assert_says(
        &refusal(
            &pendulum(r#"<limit lower="1" upper="-1" effort="1" velocity="1"/>"#),
            "",
        ),
        &["upper = -1"],
    );
    assert_says(
        &refusal(
            &pendulum(r#"<limit lower="-1" upper="1" effort="0" velocity="1"/>"#),
            "",
        ),
        &["effort = 0"],
    );
    assert_says(
        &refusal(
            &pendulum(r#"<limit lower="-1" upper="1" effort="1" velocity="-2"/>"#),
            "",
        ),
        &["velocity = -2"],
    );
    assert_says(
        &refusal(
            &pendulum(r#"<limit lower="nan" upper="1" effort="1" velocity="1"/>"#),
            "",
        ),
        &["lower = NaN"],
    );

    let names: Vec<String> = (0..10).map(|i| format!("l{i}")).collect();
    let mut parts: Vec<String> = names.iter().map(|name| link(name)).collect();
    parts.extend(
        names
            .windows(2)
            .map(|pair| joint("revolute", &pair[0], &pair[1], LIMIT)),
    );
    assert_says(
        &refusal(&robot(&parts), ""),
        &["9 movable joints", "at most 8"],
    );
    assert_eq!(
        load(&robot(&parts), "default_frame = \"l7\"")
            .unwrap()
            .dof(),
        7
    );
}

#[test]
fn tangled_trees_are_refused() {
    let (a, b) = (link("a"), link("b"));
    let ab = joint("revolute", "a", "b", LIMIT);
    assert_says(
        &refusal(&robot(&[a.clone(), a.clone(), ab.clone()]), ""),
        &["two links 'a'"],
    );
    assert_says(
        &refusal(&robot(&[a.clone(), ab.clone()]), ""),
        &["'a-b'", "link 'b' that is missing"],
    );
    assert_says(
        &refusal(&robot(&[a.clone(), b.clone()]), ""),
        &["'a', 'b' have no parent"],
    );
    assert_says(
        &refusal(&robot(&[a.clone(), b.clone(), ab.clone(), ab.clone()]), ""),
        &["two joints 'a-b'"],
    );
    let loops = [
        a.clone(),
        b.clone(),
        ab.clone(),
        joint("revolute", "b", "a", LIMIT),
    ];
    assert_says(&refusal(&robot(&loops), ""), &["loop"]);
    let aside = [
        a,
        b,
        ab,
        link("c"),
        link("d"),
        joint("fixed", "c", "d", ""),
        joint("fixed", "d", "c", ""),
    ];
    assert_says(&refusal(&robot(&aside), ""), &["2 of 4 links", "loop"]);
    let two_parents = [
        link("a"),
        link("b"),
        link("c"),
        joint("fixed", "a", "c", ""),
        joint("fixed", "b", "c", ""),
    ];
    assert_says(
        &refusal(&robot(&two_parents), ""),
        &["'c' is the child of two joints"],
    );
}

#[test]
fn impossible_descriptions_are_refused() {
    let with = |description: &str| refusal(&pendulum(LIMIT), description);
    assert_says(&with("gravty = [0, 0, 0]"), &["bad description", "gravty"]);
    assert_says(&with("[joints.base-a]\narmatur = 1"), &["armatur"]);
    assert_says(
        &with("[joints.elbow]\narmature = 1"),
        &["joint 'elbow'", "'base-a'"],
    );
    assert_says(&with("[joints.base-a]\narmature = -1"), &["armature = -1"]);
    assert_says(&with("[joints.base-a]\nlower = 5"), &["upper = 2"]);
    assert_says(&with("length_m = 0"), &["length_m = 0"]);
    assert_says(&with("gravity = [0, nan, 0]"), &["gravity"]);
    assert_says(&with("encoder_bits = 40"), &["encoder_bits = 40"]);
    assert_says(
        &with("task = [\"x\", \"y\"]"),
        &["task", "as many as there are joints"],
    );
    assert_says(
        &with("[postures]\nhome = [3.0]"),
        &["posture 'home'", "'base-a' = 3", "[-1, 2]"],
    );
    assert_says(
        &with("[factors]\nkind = \"puma\"\na2 = 1\na3 = 0\nd4 = 1"),
        &["six joints", "has 1"],
    );
    assert_says(&with("[factors]\nkind = \"stanford\""), &["stanford"]);
}

/// A factorisation that the geometry does not have is refused.
#[test]
fn false_factors_are_refused() {
    let source = Robot::builtin("puma560").unwrap().source;
    for (from, to) in [
        ("a3 = -0.0203", "a3 = 0.0203"),
        ("a2 = 0.4318", "a2 = 0.4319"),
        ("d4 = 0.4331", "d4 = 0.433100001"),
    ] {
        assert!(source.description.contains(from));
        assert_says(
            &refusal(&source.urdf, &source.description.replace(from, to)),
            &["det J", "leave `factors` out"],
        );
    }
    let ur5 = Robot::builtin("ur5").unwrap().source;
    let claim = "[factors]\nkind = \"puma\"\na2 = 0.425\na3 = 0.0\nd4 = 0.39225";
    assert_says(&refusal(&ur5.urdf, claim), &["does not fit its geometry"]);
}

#[test]
fn unknown_names_are_listed() {
    assert_says(
        &Robot::builtin("puma").unwrap_err().to_string(),
        &[
            "no robot 'puma'",
            "puma560, puma560-ideal, planar3r, ur5, planar2r, iiwa14",
        ],
    );
    let robot = Robot::builtin("puma560").unwrap();
    let error = Model::<6>::new(&robot, Some("hand")).unwrap_err();
    assert_says(
        &error.to_string(),
        &["no frame 'hand'", "'base'", "'ee', 'flange'"],
    );
    assert!(matches!(
        Model::<5>::new(&robot, None),
        Err(ModelError::Dof {
            expected: 5,
            actual: 6,
            ..
        })
    ));
}

#[test]
fn postures_are_checked() {
    let robot = Robot::builtin("puma560").unwrap();
    let mut q = [0.0; 6];
    assert_eq!(robot.check_posture(&q), Ok(()));
    q[4] = 1.8;
    assert_says(
        &robot.check_posture(&q).unwrap_err().to_string(),
        &["'joint5' = 1.8", "-1.745", "1.745"],
    );
    q[4] = f64::NAN;
    assert_says(
        &robot.check_posture(&q).unwrap_err().to_string(),
        &["'joint5' is NaN"],
    );
    assert_says(
        &robot.check_posture(&q[..5]).unwrap_err().to_string(),
        &["5 joint values", "6 joints"],
    );
}

/// The idealised PUMA at its triple lock has rank 3, as in the paper; the measured one has 4.
#[test]
fn triple_lock_has_the_papers_rank_only_without_a3() {
    let rank = |name: &str, q3: f64| {
        let robot = Robot::builtin(name).unwrap();
        let q = SVector::from([0.3, -std::f64::consts::FRAC_PI_2, q3, 0.0, 0.0, 0.0]);
        let J = Model::<6>::new(&robot, None).unwrap().jacobian(&q);
        J.singular_values().iter().filter(|s| **s > 1e-9).count()
    };
    assert_eq!(rank("puma560-ideal", std::f64::consts::FRAC_PI_2), 3);
    assert_eq!(rank("puma560", 0.4331_f64.atan2(-0.0203)), 4);
}
