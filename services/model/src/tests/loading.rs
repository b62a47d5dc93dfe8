//! Reading of URDFs and descriptions, and the reason of every refusal.

use super::identities::odd;
use super::{ODD, load};
use crate::{Defect, Factors, Geometry, Model, ModelError, Pose, PostureError, Robot, RobotError};
use nalgebra::{Matrix3, Vector3, vector};
use shared_types::scenario::Start;

/// The defect for which `urdf` with `description` is refused.
fn defect(urdf: &str, description: &str) -> Defect {
    match load(urdf, description) {
        Err(RobotError::Defect { defect, .. }) => defect,
        other => panic!("{other:?} of {description}"),
    }
}

macro_rules! assert_matches {
    ($found:expr, $pattern:pat $(if $condition:expr)?) => {
        let found = $found;
        assert!(matches!(&found, $pattern $(if $condition)?), "{found:?}");
    };
}

macro_rules! assert_refused {
    ($($urdf:expr, $description:expr => $defect:pat $(if $condition:expr)?,)+) => {$(
        assert_matches!(defect(&$urdf, $description), $defect $(if $condition)?);
    )+};
}

/// The value for which `urdf` with `description` is refused.
fn value(urdf: &str, description: &str) -> (String, String) {
    match defect(urdf, description) {
        Defect::Value { what, value, .. } => (what, value),
        other => panic!("{other:?} of {description}"),
    }
}

const BODY: &str = r#"<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>"#;
const LIMIT: &str = r#"<limit lower="-1" upper="2" effort="10" velocity="3"/>"#;

/// A link that is a body, with `rest` inside.
fn shaped(name: &str, rest: &str) -> String {
    format!(r#"<link name="{name}">{BODY}{rest}</link>"#)
}

/// A joint `parent-child`, with `rest` inside.
fn joint(kind: &str, pair: &str, rest: &str) -> String {
    let (parent, child) = pair.split_once('-').unwrap();
    format!(
        r#"<joint name="{pair}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="1 0 0"/><axis xyz="0 0 1"/>{rest}</joint>"#
    )
}

/// A URDF of `parts` and of links that are bodies.
fn robot(links: &str, parts: &[String]) -> String {
    let links = links.split_whitespace().map(|name| shaped(name, ""));
    let links: String = links.collect();
    format!("<robot name=\"r\">{links}{}</robot>", parts.concat())
}

/// Revolute joints `parent-child`, separated by spaces.
fn turning(pairs: &str) -> String {
    let pairs = pairs.split_whitespace();
    pairs.map(|pair| joint("revolute", pair, LIMIT)).collect()
}

/// A link `a` on a base, as it is written, that turns within `limit`.
fn pendulum(a: &str, limit: &str) -> String {
    robot("base", &[a.to_owned(), joint("revolute", "base-a", limit)])
}

/// Three links in a row, each 1 m along x of the one before.
fn row() -> String {
    robot("base a b c", &[turning("base-a a-b b-c")])
}

#[test]
fn builtins_load_and_rebuild_from_their_source() {
    for name in Robot::builtin_names() {
        let robot = Robot::builtin(name).unwrap();
        assert_eq!(robot.name, *name);
        assert!(robot.notes.is_empty(), "{:?}", robot.notes);
        assert!(!robot.shapes.is_empty() && !robot.postures.is_empty());
        assert_eq!(Robot::from_source(&robot.source).unwrap(), robot);
    }
    let puma = Robot::builtin("puma560").unwrap();
    let (a2, a3, d4) = (0.4318, -0.0203, 0.4331);
    assert_eq!(puma.factors, Factors::Puma { a2, a3, d4 });
    assert_eq!(
        (puma.length_m, puma.encoder_bits, puma.task.count()),
        (0.43, 16, 6)
    );
    let [base, shoulder, elbow, _, wrist, _] = &puma.joints[..] else {
        panic!()
    };
    assert_eq!(
        (shoulder.armature, base.effort, base.velocity),
        (4.71, 97.6, 1.92)
    );
    assert_eq!(
        (wrist.lower, wrist.upper),
        (-1.7453292519943295, 1.7453292519943295)
    );
    let inertia = vector![0.07100000000000001, 0.0175, 0.086];
    assert_eq!(elbow.inertia, Matrix3::from_diagonal(&inertia));
    assert_eq!(Robot::builtin("planar3r").unwrap().task.count(), 2);
}

#[test]
fn a_urdf_alone_gets_the_stated_defaults() {
    let robot = load(&pendulum(&shaped("a", ""), LIMIT), "").unwrap();
    assert_eq!((robot.default_frame.as_str(), robot.length_m), ("a", 1.0));
    assert_eq!(
        (robot.gravity, robot.encoder_bits),
        (vector![0.0, 0.0, -9.81], 16)
    );
    assert_eq!(
        (robot.factors, robot.joints[0].armature),
        (Factors::Numeric, 0.0)
    );
    assert_eq!(robot.postures["middle"], [0.5]);
    // The frame sits on the axis: all it can do is turn about it.
    assert_eq!(robot.task.0, [false, false, false, false, false, true]);

    let arm = odd();
    let spin = &arm.joints[2];
    assert_eq!((spin.viscous_friction, spin.coulomb_friction), (0.5, 0.1));
    let limits = [-spin.lower, spin.upper, spin.effort, spin.velocity];
    assert_eq!(limits, [f64::INFINITY; 4]);
    let carriers: Vec<_> = arm.frames.iter().map(|frame| frame.joint).collect();
    assert_eq!(
        carriers,
        [None, Some(0), Some(1), Some(1), Some(2), Some(2)]
    );
    assert_eq!(
        (arm.default_frame.as_str(), arm.joints[1].armature),
        ("tool", 0.7)
    );
}

/// Two bodies bolted together have the second moment of one body: the sum of the parts', each by its own parallel axes.
#[test]
fn fixed_links_are_lumped() {
    let about_origin = |m: f64, X: Pose, I: Matrix3<f64>| {
        let c = X.p;
        let steiner = Matrix3::from_diagonal_element(c.norm_squared()) - c * c.transpose();
        X.R * I * X.R.transpose() + m * steiner
    };
    let bolt = Pose::from_xyz_rpy([0.05, 0.1, 0.15], [0.6, 0.1, -0.2]);
    #[rustfmt::skip]
    let sum = about_origin(
        2.0,
        Pose::from_xyz_rpy([0.0, 0.1, 0.2], [0.0, 0.2, 0.0]),
        Matrix3::new(0.02, -0.003, 0.001, -0.003, 0.03, 0.002, 0.001, 0.002, 0.025),
    ) + about_origin(
        1.5,
        bolt * Pose::from_xyz_rpy([0.02, 0.0, 0.03], [0.1, 0.2, 0.3]),
        Matrix3::new(0.004, 0.001, 0.0, 0.001, 0.005, 0.0, 0.0, 0.0, 0.006),
    );
    let b = &odd().joints[1];
    let found = about_origin(b.mass, Pose::translation(b.com), b.inertia);
    assert!(b.mass == 3.5 && (found - sum).amax() < 1e-15);
}

#[test]
fn branches_are_refused_or_held() {
    let follows = format!(r#"{LIMIT}<mimic joint="arm-left"/>"#);
    let [left, right] = [("arm-left", LIMIT), ("arm-right", &*follows)]
        .map(|(pair, limit)| joint("prismatic", pair, limit));
    let gripper = robot("base arm left right", &[turning("base-arm"), left, right]);
    let held = load(&gripper, "default_frame = \"arm\"").unwrap();
    assert_eq!(
        (held.dof(), held.joints[0].mass, held.notes.len()),
        (1, 3.0, 2)
    );
    // A joint that others mimic, and those others, are a gripper; so is one that is named so.
    let recognised = load(&gripper, "").unwrap();
    assert_eq!(
        (&recognised.joints, &recognised.notes),
        (&held.joints, &held.notes)
    );
    assert_eq!(load(&gripper, "default_frame = \"left\"").unwrap().dof(), 2);
    let jaw = row().replace("b-c", "Gripper");
    assert_eq!(load(&jaw, "").unwrap().default_frame, "b");
    assert_eq!(load(&jaw, "default_frame = \"c\"").unwrap().dof(), 3);
    assert_refused! {
        gripper.replace(r#"<mimic joint="arm-left"/>"#, ""), "" => Defect::Branches { link, .. } if link == "arm",
        gripper, "default_frame = \"right\"" => Defect::Mimic { leader, .. } if leader == "arm-left",
        gripper, "default_frame = \"wrong\"" => Defect::UnknownFrame { known, .. } if known == "'arm', 'base', 'left', 'right'",
    }
}

#[test]
fn a_description_cuts_the_chain_at_its_base_and_at_locked_joints() {
    let free = load(&row(), "").unwrap();
    let locked = load(&row(), "[joints.a-b]\nlocked = 0.7").unwrap();
    assert_eq!(
        (locked.dof(), locked.joints[0].mass, locked.notes.len()),
        (2, 2.0, 0)
    );
    let X = Model::new(&locked, None)
        .unwrap()
        .forward_kinematics(&vector![0.3, -0.4]);
    let same = Model::new(&free, None)
        .unwrap()
        .forward_kinematics(&vector![0.3, 0.7, -0.4]);
    assert!((X.p - same.p).norm() < 1e-15 && (X.R - same.R).norm() < 1e-15);
    let rest = load(&row(), "base_frame = \"a\"").unwrap();
    assert_eq!((rest.dof(), rest.joints[0].name.as_str()), (2, "a-b"));
    assert!(rest.frame("base").is_none() && rest.frame("a").unwrap().joint.is_none());
    let locked = ("joint 'a-b' has locked".to_owned(), "NaN".to_owned());
    assert_eq!(value(&row(), "[joints.a-b]\nlocked = nan"), locked);
    assert_refused! {
        row(), "[joints.x]\nlocked = 0" => Defect::UnknownJoint { .. },
        row(), "base_frame = \"x\"" => Defect::UnknownFrame { .. },
        row(), "base_frame = \"b\"\ndefault_frame = \"a\"" => Defect::NotATree(_),
    }
}

#[test]
fn torque_rates_are_read_or_follow_from_the_torque_limits() {
    let rates = |description: &str| {
        let joints = load(&row(), description).unwrap().joints;
        joints
            .iter()
            .map(|joint| joint.torque_rate)
            .collect::<Vec<_>>()
    };
    assert_eq!(rates(""), [500.0; 3]);
    let mixed = "[joints.a-b]\ntorque_rate = 1000\n[joints.b-c]\neffort = 4";
    assert_eq!(rates(mixed), [500.0, 1000.0, 200.0]);
}

/// A link with inertia and no mass: its inertia counts where its body has mass, and it cannot be a body alone.
#[test]
fn inertia_without_mass_counts_or_is_refused() {
    let hand = r#"<link name="hand"><inertial><mass value="0"/><inertia ixx="0.1" ixy="0" ixz="0" iyy="0.2" iyz="0" izz="0.25"/></inertial></link>"#;
    let fused = [
        turning("base-a"),
        hand.to_owned(),
        joint("fixed", "a-hand", ""),
    ];
    let body = &load(&robot("base a", &fused), "").unwrap().joints[0];
    assert_eq!((body.mass, body.com), (1.0, Vector3::zeros()));
    assert!((body.inertia - Matrix3::from_diagonal(&vector![1.1, 1.2, 1.25])).amax() < 1e-15);
    let alone = robot("base", &[turning("base-hand"), hand.to_owned()]);
    assert!(load(&alone, "").unwrap().complete().is_err());
}

/// Visual geometry keeps its colour; a mesh is named, and the shape that collides stands in for it.
#[test]
fn shapes_are_read_with_their_colours_and_meshes_named() {
    let blue = r#"<material name="blue"><color rgba="0 0 1 1"/></material>"#;
    let solid =
        |tag: &str, content: &str| format!(r#"<{tag}><origin xyz="0 0 1"/>{content}</{tag}>"#);
    let arm = |a: &str| load(&pendulum(&(blue.to_owned() + &shaped("a", a)), LIMIT), "").unwrap();
    let ball = "<geometry><sphere radius=\"1\"/></geometry>";
    for (material, colour) in [
        (
            r#"<material name="x"><color rgba="1 0.5 0 1"/></material>"#,
            Some([1.0, 0.5, 0.0, 1.0]),
        ),
        (r#"<material name="blue"/>"#, Some([0.0, 0.0, 1.0, 1.0])),
        ("", None),
        (r#"<material name="unknown"/>"#, None),
        (
            r#"<material name="x"><color rgba="7 0 0 1"/></material>"#,
            None,
        ),
    ] {
        let shape = arm(&solid("visual", &format!("{ball}{material}"))).shapes[0].clone();
        assert_eq!(
            (shape.geometry, shape.colour),
            (Geometry::Sphere { radius: 1.0 }, colour)
        );
        assert_eq!((shape.joint, shape.X_LS.p), (Some(0), Vector3::z()));
    }
    let moved = load(&pendulum(&shaped("a", ""), LIMIT), "meshes = \"/far\"").unwrap();
    assert_eq!(moved.meshes.to_str(), Some("/far"));
    let mesh = "<geometry><mesh filename=\"a.stl\" scale=\"2 2 2\"/></geometry>";
    let mesh = solid("visual", mesh);
    for (collision, stand_ins) in [("", 0), (solid("collision", ball).as_str(), 1)] {
        let shapes = arm(&format!("{mesh}{collision}")).shapes;
        assert_eq!(
            shapes[0].geometry,
            Geometry::Mesh {
                file: "a.stl".to_owned(),
                scale: Vector3::repeat(2.0),
            }
        );
        assert!(shapes[1..].iter().all(|shape| shape.stands_in));
        assert_eq!(shapes.len(), 1 + stand_ins);
    }
}

#[test]
fn impossible_urdfs_are_refused() {
    let a = |mass: &str, [x, y, z]: [&str; 3]| {
        let inertia =
            format!(r#"<inertia ixx="{x}" ixy="0" ixz="0" iyy="{y}" iyz="0" izz="{z}"/>"#);
        let link = format!(
            r#"<link name="a"><inertial><mass value="{mass}"/>{inertia}</inertial></link>"#
        );
        pendulum(&link, LIMIT)
    };
    let pairs = "a-b b-c c-d d-e e-f f-g g-h h-i i-j";
    let long = robot("a b c d e f g h i j", &[turning(pairs)]);
    assert_eq!(load(&long, "default_frame = \"h\"").unwrap().dof(), 7);
    let fixed = |pair| joint("fixed", pair, "");
    let aside = [turning("a-b"), fixed("c-d"), fixed("d-c")];
    assert_refused! {
        "not xml", "" => Defect::Urdf(_),
        robot("base", &[]), "" => Defect::NoMovableJoint { .. },
        long, "" => Defect::TooManyJoints(9),
        pendulum(&shaped("a", ""), &LIMIT.replace("-1", "${-pi}")), "" => Defect::Urdf(reason) if reason.contains("line 1: <limit> of joint 'base-a'"),
        "<?xml version=\"1.0\"?><!-- an arm --><mujoco/>", "" => Defect::Mjcf,
        a("1", ["1", "1", "-1"]), "" => Defect::Inertia { moments: [-1.0, 1.0, 1.0], .. },
        a("1", ["1", "1", "0"]), "" => Defect::Inertia { .. },
        a("-1", ["1", "1", "1"]), "" => Defect::Inertia { mass: -1.0, .. },
        // The PUMA's third link as published in 1986.
        a("4.8", ["0.066", "0.0125", "0.086"]), "" => Defect::Inertia { .. },
        a("nan", ["1", "1", "1"]), "" => Defect::NotFinite(_),
        a("1", ["inf", "1", "1"]), "" => Defect::NotFinite(_),
        ODD.replace("0.2 -0.1 0", "0.2 nan 0"), "" => Defect::NotFinite(_),
        robot("base a", &[joint("floating", "base-a", "")]), "" => Defect::UnsupportedJoint { kind, .. } if kind == "floating",
        robot("", &[]), "" => Defect::Urdf(_),
        robot("a a", &[turning("a-b")]), "" => Defect::NotATree(_),
        robot("a", &[turning("a-b")]), "" => Defect::NotATree(_),
        robot("a b", &[]), "" => Defect::NotATree(_),
        robot("a b", &[turning("a-b a-b")]), "" => Defect::NotATree(_),
        robot("a b", &[turning("a-b b-a")]), "" => Defect::NotATree(_),
        robot("a b c d", &aside), "" => Defect::NotATree(_),
        robot("a b c", &[fixed("a-c"), fixed("b-c")]), "" => Defect::NotATree(_),
    }
}

#[test]
fn values_that_cannot_be_are_named() {
    for (limits, what, number) in [
        (r#"lower="1" upper="-1" effort="1""#, "range", "1 to -1"),
        (r#"lower="nan" upper="1" effort="1""#, "range", "NaN to 1"),
        (r#"lower="-1" upper="1" velocity="-2""#, "velocity", "-2"),
    ] {
        let expected = (format!("joint 'base-a' has {what}"), number.to_owned());
        let arm = pendulum(&shaped("a", ""), &format!("<limit {limits}/>"));
        assert_eq!(value(&arm, ""), expected);
    }
    let (axis, _) = value(&ODD.replace("1 -2 0.5", "0 0 0"), "");
    assert_eq!(axis, "joint 'turn' has axis");
    let pendulum = pendulum(&shaped("a", ""), LIMIT);
    for (description, what) in [
        (
            "[joints.base-a]\narmature = -1",
            "joint 'base-a' has armature",
        ),
        ("[joints.base-a]\nlower = 5", "joint 'base-a' has range"),
        (
            "[joints.base-a]\ntorque_rate = 0",
            "joint 'base-a' has torque_rate",
        ),
        (
            "[joints.base-a]\ntorque_rate = nan",
            "joint 'base-a' has torque_rate",
        ),
        ("length_m = 0", "length_m"),
        ("gravity = [0, nan, 0]", "gravity"),
        ("encoder_bits = 40", "encoder_bits"),
        ("task = [\"x\", \"y\"]", "task"),
        (
            "[factors]\nkind = \"puma\"\na2 = nan\na3 = 0\nd4 = 1",
            "factors",
        ),
        (
            "[factors]\nkind = \"puma\"\na2 = 1\na3 = 0\nd4 = 1",
            "factors.kind",
        ),
    ] {
        assert_eq!(value(&pendulum, description).0, what);
    }
    assert_refused! {
        pendulum, "gravty = [0, 0, 0]" => Defect::Description(_),
        pendulum, "[joints.base-a]\narmatur = 1" => Defect::Description(_),
        pendulum, "[factors]\nkind = \"stanford\"" => Defect::Description(_),
        pendulum, "[joints.elbow]\narmature = 1" => Defect::UnknownJoint { known, .. } if known == "'base-a'",
        pendulum, "[postures]\nhome = [3.0]" => Defect::Posture { reason: PostureError::OutsideLimits { .. }, .. },
    }
}

/// Kinematics needs neither masses nor limits; motion needs all of them, and is told so at once. A link with a part of its inertia, a joint without a speed,
/// have gaps as well.
#[test]
fn gaps_are_told_together_and_kinematics_does_without() {
    let part = r#"<link name="b"><inertial><mass value="1"/></inertial></link>"#;
    let limit = LIMIT.replace("10", "0").replace("velocity", "speed");
    let arm = robot(
        "base",
        &[
            r#"<link name="a"/>"#.to_owned() + part,
            joint("revolute", "base-a", ""),
            joint("revolute", "a-b", &limit),
        ],
    );
    let found = load(&arm, "").unwrap();
    let RobotError::Defect {
        defect: Defect::Gaps(gaps),
        ..
    } = found.complete().unwrap_err()
    else {
        panic!("no gaps");
    };
    for gap in [
        "'a', 'b'",
        "[joints.\"base-a\"]\n  lower",
        "[joints.\"a-b\"]\n  effort =     # N·m\n  velocity",
    ] {
        assert!(gaps.contains(gap), "{gap}: {gaps}");
    }
    let terms = Model::<2>::new(&found, None)
        .unwrap()
        .evaluate(&vector![0.1, 0.2], &vector![0.0, 0.0]);
    assert!(terms.J.iter().all(|x| x.is_finite()) && terms.A.iter().any(|x| x.is_nan()));
    let given = "[joints.base-a]\nlower = -1\nupper = 1\neffort = 1\nvelocity = 1\n[joints.a-b]\neffort = 2\nvelocity = 1";
    let bodies = arm.replace(
        &(r#"<link name="a"/>"#.to_owned() + part),
        &(shaped("a", "") + &shaped("b", "")),
    );
    assert!(load(&bodies, given).unwrap().complete().is_ok());
}

/// A key of MJCF has all joints of its file: a posture takes those of the chain, unless they break a limit.
#[test]
fn postures_by_joint_are_those_of_the_chain() {
    let keys = "[postures.home]\nbase-a = 0.5\na-b = -0.5\nb-c = 0\nfinger = 9\n[postures.far]\nbase-a = 5\na-b = 0\nb-c = 0";
    let arm = load(&row(), keys).unwrap();
    assert_eq!(arm.postures["home"], [0.5, -0.5, 0.0]);
    assert!(arm.postures.len() == 1 && arm.notes.iter().any(|note| note.contains("'far'")));
}

/// A factorisation that the geometry does not have is refused.
#[test]
fn false_factors_are_refused() {
    let [puma, ur5] = ["puma560", "ur5"].map(|name| Robot::builtin(name).unwrap().source);
    let claim = "[factors]\nkind = \"puma\"\na2 = 0.425\na3 = 0.0\nd4 = 0.39225";
    let puma_with = |from: &str, to: &str| {
        assert!(puma.description.contains(from));
        puma.description.replace(from, to)
    };
    assert_refused! {
        ur5.urdf, claim => Defect::Factors { .. },
        puma.urdf, &puma_with("a3 = -0.0203", "a3 = 0.0203") => Defect::Factors { .. },
        puma.urdf, &puma_with("a2 = 0.4318", "a2 = 0.4319") => Defect::Factors { .. },
        puma.urdf, &puma_with("d4 = 0.4331", "d4 = 0.433100001") => Defect::Factors { .. },
    }
}

#[test]
fn postures_and_names_are_checked() {
    assert_matches!(Robot::builtin("puma"), Err(RobotError::Unknown { .. }));
    let robot = Robot::builtin("puma560").unwrap();
    let unknown = Model::<6>::new(&robot, Some("hand"));
    assert_matches!(unknown, Err(ModelError::UnknownFrame { .. }));
    let small = Model::<5>::new(&robot, None);
    assert_matches!(small, Err(ModelError::Dof { expected, actual, .. }) if (*expected, *actual) == (5, 6));
    let at = |q_deg: &[f64]| {
        let q_deg = Some(q_deg.to_vec());
        robot.start_posture(&Start {
            q_deg,
            ..Start::default()
        })
    };
    let named = |name: &str| {
        let posture = Some(name.to_owned());
        robot.start_posture(&Start {
            posture,
            ..Start::default()
        })
    };
    assert_eq!(
        at(&[0.0, -90.0, 90.0, 0.0, 0.0, 0.0]).unwrap()[2],
        90f64.to_radians()
    );
    assert_eq!(named("ready").unwrap(), robot.postures["ready"]);
    assert_eq!(
        robot.start_posture(&Start::default()),
        Err(PostureError::Missing)
    );
    assert_matches!(named("reddy"), Err(PostureError::Unknown { .. }));
    let few = at(&[0.0; 3]);
    assert_matches!(few, Err(PostureError::Length { actual, expected, .. }) if (*actual, *expected) == (3, 6));
    let beyond = at(&[0.0, 0.0, 0.0, 0.0, 170.0, 0.0]);
    assert_matches!(beyond, Err(PostureError::OutsideLimits { joint, .. }) if joint == "joint5");
    let nowhere = at(&[f64::NAN; 6]);
    assert_matches!(nowhere, Err(PostureError::NotFinite { joint, .. }) if joint == "joint1");
}

/// A file in degrees or millimetres is read as it stands, and doubted.
#[test]
fn limits_in_degrees_and_lengths_in_millimetres_are_doubted() {
    let notes = |z: f64, limit: f64| {
        let limit = format!(r#"<limit lower="-{limit}" upper="{limit}" effort="9" velocity="1"/>"#);
        let joint = joint("revolute", "0-1", &limit).replace("1 0 0", &format!("0 0 {z}"));
        load(&robot("0 1", &[joint]), "").unwrap().notes.len()
    };
    let found = [(0.3, 3.0), (0.3, 170.0), (300.0, 3.0), (0.3, 1e16)];
    assert_eq!(found.map(|(z, limit)| notes(z, limit)), [0, 1, 1, 0]);
}

/// An arm that turns about z and bends in a plane: no rotation about x or y is its own wherever it faces.
#[test]
fn the_served_axes_do_not_depend_on_where_the_arm_faces() {
    let arm = |axes: &[&str]| {
        let joint = |(k, axis): (usize, &&str)| {
            let joint = turning(&format!("{k}-{}", k + 1));
            joint.replace("1 0 0", "0 0 0.3").replace("0 0 1", axis)
        };
        let joints: Vec<_> = axes.iter().enumerate().map(joint).collect();
        let links: Vec<_> = (0..=axes.len()).map(|k| k.to_string()).collect();
        let robot = load(&robot(&links.join(" "), &joints), "").unwrap();
        (robot.task.0, robot.notes.len())
    };
    let (x, y, z) = ("1 0 0", "0 1 0", "0 0 1");
    let [t, f] = [true, false];
    assert_eq!(arm(&[z, y, y, y]), ([t, t, t, f, f, f], 1));
    assert_eq!(arm(&[z, y, y, y, x]).0, [t, t, t, t, t, f]);
    assert_eq!(arm(&[y, y, y]).0, [t, f, t, f, t, f]);
}
