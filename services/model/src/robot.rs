//! The arm as data.

use crate::description::{Description, DescriptionError};
use crate::pose::Pose;
use crate::{geometry, urdf};
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;

/// The largest number of joints supported.
pub const MAX_DOF: usize = 7;

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Turns, within limits.
    Revolute,
    /// Turns without limits.
    Continuous,
    /// Slides, within limits. Its positions are in m, its torques in N.
    Prismatic,
}

/// A joint and the link it moves, with everything fixed to that link lumped into it.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// The joint's name.
    pub name: String,
    /// How it moves.
    pub kind: JointKind,
    /// The joint frame J, which is this link's frame at q = 0, in the parent link's frame.
    pub X_PJ: Pose,
    /// The joint's axis, unit, joint frame.
    pub axis: Vector3<f64>,
    /// The link's mass, kg.
    pub mass: f64,
    /// The link's centre of mass, link frame, m.
    pub com: Vector3<f64>,
    /// The link's inertia about its centre of mass, link axes, kg·m².
    pub inertia: Matrix3<f64>,
    /// Reflected rotor inertia G²·J_m, kg·m².
    pub armature: f64,
    /// Viscous friction, N·m·s/rad.
    pub viscous_friction: f64,
    /// Coulomb friction, N·m.
    pub coulomb_friction: f64,
    /// Lower position limit, rad; −∞ for none.
    pub lower: f64,
    /// Upper position limit, rad; ∞ for none.
    pub upper: f64,
    /// Torque limit, N·m; ∞ for none.
    pub effort: f64,
    /// Speed limit, rad/s; ∞ for none.
    pub velocity: f64,
    /// The moving link's name.
    pub link: String,
}

/// A named frame fixed to a link: every link of the URDF is one.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// The frame's name: the URDF link's.
    pub name: String,
    /// Index of the joint whose link carries it; `None` for the base.
    pub joint: Option<usize>,
    /// The frame in that link's frame.
    pub X_LF: Pose,
}

/// What a shape looks like, m, centred at its frame, with its long axis along z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Geometry {
    /// A box of full side lengths `size`.
    Box {
        /// Side lengths.
        size: Vector3<f64>,
    },
    /// A cylinder.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Length along z.
        length: f64,
    },
    /// A sphere.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// A capsule.
    Capsule {
        /// Radius.
        radius: f64,
        /// Length along z between the centres of the caps.
        length: f64,
    },
}

/// A piece of visual geometry fixed to a link.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shape {
    /// Index of the joint whose link carries it; `None` for the base.
    pub joint: Option<usize>,
    /// The shape's frame in that link's frame.
    pub X_LS: Pose,
    /// What it looks like.
    pub geometry: Geometry,
    /// Red, green, blue, opacity in 0..=1, where the URDF gives the material a colour.
    pub colour: Option<[f64; 4]>,
}

/// An analytic factorisation of det J, if one holds.
///
/// Checked against the geometry when the robot is loaded, so a robot that carries one obeys it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Factors {
    /// det J = a2·(d4·c3 − a3·s3)·(a2·c2 + a3·c23 + d4·s23)·s5: elbow, overhead, wrist (modified DH, Craig's zero).
    Puma {
        /// Upper arm, m.
        a2: f64,
        /// Elbow offset, m.
        a3: f64,
        /// Forearm, m.
        d4: f64,
    },
    /// None known: singularities are found numerically.
    #[default]
    Numeric,
}

impl Factors {
    /// det J(q) by the factorisation, m³ (`None` without one, or for fewer than six joints).
    pub fn determinant(&self, q: &[f64]) -> Option<f64> {
        match (*self, q) {
            (Factors::Puma { a2, a3, d4 }, &[_, q2, q3, _, q5, ..]) => {
                let (s3, c3) = libm::sincos(q3);
                let (s23, c23) = libm::sincos(q2 + q3);
                let elbow = d4 * c3 - a3 * s3;
                let overhead = a2 * libm::cos(q2) + a3 * c23 + d4 * s23;
                Some(a2 * elbow * overhead * libm::sin(q5))
            }
            _ => None,
        }
    }
}

/// One axis of the task space, base axes: a translation or a rotation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TaskAxis {
    /// Translation along x.
    X,
    /// Translation along y.
    Y,
    /// Translation along z.
    Z,
    /// Rotation about x.
    Rx,
    /// Rotation about y.
    Ry,
    /// Rotation about z.
    Rz,
}

impl TaskAxis {
    /// All six, in the order of the Jacobian's rows.
    pub const ALL: [TaskAxis; 6] = [TaskAxis::X, TaskAxis::Y, TaskAxis::Z, TaskAxis::Rx, TaskAxis::Ry, TaskAxis::Rz];

    /// The Jacobian's row, 0 to 5.
    pub fn row(self) -> usize {
        self as usize
    }
}

/// Which of the six task axes an arm serves, by the Jacobian's rows [v; ω].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TaskAxes(pub [bool; 6]);

impl TaskAxes {
    /// Position and orientation.
    pub const ALL: TaskAxes = TaskAxes([true; 6]);

    /// How many axes.
    pub fn count(&self) -> usize {
        self.0.iter().filter(|on| **on).count()
    }

    /// Whether all six.
    pub fn is_full(&self) -> bool {
        self.0 == [true; 6]
    }

    /// The axes served, in row order.
    pub fn iter(&self) -> impl Iterator<Item = TaskAxis> + '_ {
        TaskAxis::ALL.into_iter().filter(|axis| self.0[axis.row()])
    }
}

impl FromIterator<TaskAxis> for TaskAxes {
    fn from_iter<I: IntoIterator<Item = TaskAxis>>(axes: I) -> Self {
        let mut on = [false; 6];
        axes.into_iter().for_each(|axis| on[axis.row()] = true);
        TaskAxes(on)
    }
}

/// The text a robot was made of: enough to make it again in another process.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RobotSource {
    /// What to call the robot.
    pub name: String,
    /// The [description](crate::description), TOML; empty for none.
    #[serde(default)]
    pub description: String,
    /// The URDF.
    pub urdf: String,
}

/// A serial arm as data: valid by construction, whatever it was read from.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// The robot's name.
    pub name: String,
    /// The joints and moving links, from the base outwards.
    pub joints: Vec<Joint>,
    /// Every link of the URDF on or fixed to the chain, as a frame.
    pub frames: Vec<Frame>,
    /// Visual geometry, where the URDF has it in closed form (mesh files are skipped, and noted).
    pub shapes: Vec<Shape>,
    /// Acceleration of gravity, base axes, m/s².
    pub gravity: Vector3<f64>,
    /// The length that makes radians and metres comparable in unit-scaled singular values, m.
    pub length_m: f64,
    /// The analytic factorisation of det J, if one holds.
    pub factors: Factors,
    /// The end-effector frame, unless another is asked for.
    pub default_frame: String,
    /// The task axes this arm serves.
    pub task: TaskAxes,
    /// Named postures, each within the limits, rad.
    pub postures: BTreeMap<String, Vec<f64>>,
    /// Resolution of the joint encoders, bits per turn.
    pub encoder_bits: u32,
    /// What was assumed or left out in reading it, one sentence each, for a person to see.
    pub notes: Vec<String>,
    /// The text it was made of.
    pub source: RobotSource,
}

/// Why a text is not a robot.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RobotError {
    /// No built-in robot of that name.
    #[error("there is no robot '{name}'; the built-in ones are {known}, or give the path of a URDF file")]
    Unknown {
        /// The name asked for.
        name: String,
        /// The names there are.
        known: String,
    },
    /// The URDF cannot be parsed.
    #[error("robot '{robot}': not a readable URDF: {reason}")]
    Urdf {
        /// The robot's name.
        robot: String,
        /// The parser's message.
        reason: String,
    },
    /// The description cannot be parsed.
    #[error("robot '{robot}': bad description: {reason}")]
    Description {
        /// The robot's name.
        robot: String,
        /// The parser's message.
        reason: DescriptionError,
    },
    /// The URDF's links and joints do not form a tree.
    #[error("robot '{robot}': the links do not form a tree: {reason}")]
    NotATree {
        /// The robot's name.
        robot: String,
        /// What is wrong.
        reason: String,
    },
    /// Several movable branches, and nothing says which is the arm.
    #[error(
        "robot '{robot}' branches at link '{link}' into joints {joints}: only serial chains are supported, \
         so say which one with `default_frame = \"LINK\"` in its description (the other joints are then held at zero)"
    )]
    Branches {
        /// The robot's name.
        robot: String,
        /// Where it branches.
        link: String,
        /// The movable joints there.
        joints: String,
    },
    /// Nothing moves.
    #[error(
        "robot '{robot}' has no movable joint on the way to '{frame}': it needs 1 to {MAX_DOF} revolute, continuous or prismatic joints"
    )]
    NoMovableJoint {
        /// The robot's name.
        robot: String,
        /// The chain's end.
        frame: String,
    },
    /// Too many joints.
    #[error(
        "robot '{robot}' has {actual} movable joints in its chain; at most {MAX_DOF} are supported: fix some, or choose a nearer `default_frame`"
    )]
    TooManyJoints {
        /// The robot's name.
        robot: String,
        /// How many.
        actual: usize,
    },
    /// A joint of a type that one angle or length cannot describe.
    #[error("robot '{robot}': joint '{joint}' is of type {kind}; supported are revolute, continuous, prismatic and fixed")]
    UnsupportedJoint {
        /// The robot's name.
        robot: String,
        /// The joint.
        joint: String,
        /// Its type.
        kind: String,
    },
    /// A joint that follows another.
    #[error(
        "robot '{robot}': joint '{joint}' mimics '{leader}'; mimic joints are not supported in the chain: make it fixed or independent"
    )]
    Mimic {
        /// The robot's name.
        robot: String,
        /// The joint.
        joint: String,
        /// The joint it follows.
        leader: String,
    },
    /// A joint's value is missing or out of range.
    #[error("robot '{robot}': joint '{joint}' has {what} = {value}; {remedy}")]
    Joint {
        /// The robot's name.
        robot: String,
        /// The joint.
        joint: String,
        /// Which value.
        what: &'static str,
        /// The value.
        value: String,
        /// What it should be.
        remedy: &'static str,
    },
    /// A moving link has no mass.
    #[error(
        "robot '{robot}': moving link '{link}' has no inertia, so its motion cannot be computed: \
         add <inertial> with <origin>, <mass> and <inertia> to it"
    )]
    NoInertia {
        /// The robot's name.
        robot: String,
        /// The link.
        link: String,
    },
    /// A link's mass or inertia is not a body's.
    #[error(
        "robot '{robot}': link '{link}' has an impossible inertia: mass {mass} kg, principal moments {} kg·m² about its \
         centre of mass; the mass and every moment must be positive, and no moment larger than the sum of the other two",
        moments.map(|I| format!("{I:.4e}")).join(", ")
    )]
    Inertia {
        /// The robot's name.
        robot: String,
        /// The link.
        link: String,
        /// Its mass, kg.
        mass: f64,
        /// Its principal moments, kg·m².
        moments: [f64; 3],
    },
    /// A number is not finite.
    #[error("robot '{robot}': {what} is not a finite number")]
    NotFinite {
        /// The robot's name.
        robot: String,
        /// Which number.
        what: String,
    },
    /// A frame does not exist.
    #[error("robot '{robot}' has no frame '{frame}' for its default_frame; its links are {known}")]
    UnknownFrame {
        /// The robot's name.
        robot: String,
        /// The frame.
        frame: String,
        /// The frames there are.
        known: String,
    },
    /// The description speaks of a joint that the chain does not have.
    #[error("robot '{robot}': the description has a joint '{joint}', but the chain's joints are {known}")]
    UnknownJoint {
        /// The robot's name.
        robot: String,
        /// The joint.
        joint: String,
        /// The joints there are.
        known: String,
    },
    /// A value of the description is out of range.
    #[error("robot '{robot}': {what} = {value}; {remedy}")]
    Value {
        /// The robot's name.
        robot: String,
        /// Which value.
        what: &'static str,
        /// The value.
        value: String,
        /// What it should be.
        remedy: String,
    },
    /// A named posture is impossible.
    #[error("robot '{robot}': posture '{name}': {reason}")]
    Posture {
        /// The robot's name.
        robot: String,
        /// The posture's name.
        name: String,
        /// What is wrong with it.
        reason: PostureError,
    },
    /// The factorisation does not hold.
    #[error(
        "robot '{robot}': factors kind = \"puma\" does not fit its geometry: at q = {q:?} det J is {actual:.9e} but the product is {product:.9e}; \
         correct a2, a3, d4 or leave `factors` out (singularities are then found numerically)"
    )]
    Factors {
        /// The robot's name.
        robot: String,
        /// Where.
        q: Vec<f64>,
        /// det J of the geometry, m³.
        actual: f64,
        /// The product of the factors, m³.
        product: f64,
    },
}

/// Why a posture is not the robot's.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PostureError {
    /// Wrong number of values.
    #[error("{actual} joint values given, but the robot has {expected} joints ({joints})")]
    Length {
        /// Values given.
        actual: usize,
        /// Joints.
        expected: usize,
        /// The joints' names.
        joints: String,
    },
    /// A value is not finite.
    #[error("joint '{joint}' is {value}: give a finite number")]
    NotFinite {
        /// The joint.
        joint: String,
        /// The value.
        value: f64,
    },
    /// A value is outside the limits.
    #[error("joint '{joint}' = {value} is outside its limits [{lower}, {upper}]")]
    OutsideLimits {
        /// The joint.
        joint: String,
        /// The value, rad.
        value: f64,
        /// Lower limit, rad.
        lower: f64,
        /// Upper limit, rad.
        upper: f64,
    },
}

/// Name, URDF, description.
const BUILTIN: &[(&str, &str, &str)] = &[
    ("puma560", include_str!("../robots/puma560.urdf"), include_str!("../robots/puma560.toml")),
    ("puma560-ideal", include_str!("../robots/puma560-ideal.urdf"), include_str!("../robots/puma560-ideal.toml")),
    ("planar3r", include_str!("../robots/planar3r.urdf"), include_str!("../robots/planar3r.toml")),
    ("ur5", include_str!("../robots/ur5.urdf"), include_str!("../robots/ur5.toml")),
    ("iiwa14", include_str!("../robots/iiwa14.urdf"), include_str!("../robots/iiwa14.toml")),
];

const BUILTIN_NAMES: [&str; BUILTIN.len()] = {
    let mut names = [""; BUILTIN.len()];
    let mut i = 0;
    while i < names.len() {
        names[i] = BUILTIN[i].0;
        i += 1;
    }
    names
};

impl Robot {
    /// The built-in robots' names.
    pub fn builtin_names() -> &'static [&'static str] {
        &BUILTIN_NAMES
    }

    /// A built-in robot.
    ///
    /// Errors: [`RobotError::Unknown`], which lists the names.
    pub fn builtin(name: &str) -> Result<Robot, RobotError> {
        let (name, urdf, description) = BUILTIN
            .iter()
            .find(|(known, ..)| *known == name)
            .ok_or_else(|| RobotError::Unknown { name: name.to_owned(), known: BUILTIN_NAMES.join(", ") })?;
        Robot::from_source(&RobotSource { name: (*name).to_owned(), description: (*description).to_owned(), urdf: (*urdf).to_owned() })
    }

    /// A robot from its URDF and [description](crate::description). The same source gives the same robot.
    ///
    /// Fixed joints are merged into the links that move, and kept as frames. Movable joints off the way to the
    /// description's `default_frame` are held at zero, and noted. Errors: [`RobotError`].
    pub fn from_source(source: &RobotSource) -> Result<Robot, RobotError> {
        let name = source.name.clone();
        let description =
            Description::parse(&source.description).map_err(|reason| RobotError::Description { robot: name.clone(), reason })?;
        let mut chain = urdf::read(&name, &source.urdf, description.default_frame.as_deref())?;
        description.apply_to_joints(&name, &mut chain.joints)?;
        chain.joints.iter().try_for_each(|joint| check_joint(&name, joint))?;

        let default_frame = description.default_frame.clone().unwrap_or(chain.tip);
        let mut robot = Robot {
            name,
            length_m: geometry::default_length(&chain.joints, &chain.frames, &default_frame),
            joints: chain.joints,
            frames: chain.frames,
            shapes: chain.shapes,
            gravity: Vector3::new(0.0, 0.0, -9.81),
            factors: Factors::Numeric,
            default_frame,
            task: TaskAxes::ALL,
            postures: BTreeMap::new(),
            encoder_bits: 16,
            notes: chain.notes,
            source: source.clone(),
        };
        robot.task = geometry::served_axes(&robot);
        description.apply(&mut robot)?;
        robot.check_factors()?;
        Ok(robot)
    }

    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.joints.len()
    }

    /// The frame of that name.
    pub fn frame(&self, name: &str) -> Option<&Frame> {
        self.frames.iter().find(|frame| frame.name == name)
    }

    /// The frames' names, separated by commas.
    pub fn frame_names(&self) -> String {
        list(self.frames.iter().map(|frame| &frame.name))
    }

    /// Whether `q` is a posture of this robot: one finite value per joint, inside the limits.
    ///
    /// Errors: [`PostureError`], which names the first joint that is not.
    pub fn check_posture(&self, q: &[f64]) -> Result<(), PostureError> {
        if q.len() != self.dof() {
            return Err(PostureError::Length {
                actual: q.len(),
                expected: self.dof(),
                joints: list(self.joints.iter().map(|joint| &joint.name)),
            });
        }
        for (joint, &value) in self.joints.iter().zip(q) {
            if !value.is_finite() {
                return Err(PostureError::NotFinite { joint: joint.name.clone(), value });
            }
            if value < joint.lower || value > joint.upper {
                return Err(PostureError::OutsideLimits { joint: joint.name.clone(), value, lower: joint.lower, upper: joint.upper });
            }
        }
        Ok(())
    }

    /// The factorisation must equal det J, or it is refused.
    fn check_factors(&self) -> Result<(), RobotError> {
        let Factors::Puma { a2, a3, d4 } = self.factors else { return Ok(()) };
        let scale = a2.abs() * (a3.abs() + d4.abs()) * (a2.abs() + a3.abs() + d4.abs());
        // Generic postures (multiples of an irrational), with nothing at 0 or π/2.
        for k in 0..8 {
            let q: Vec<f64> = (0..self.dof()).map(|i| 2.399963 * (k * 7 + i + 1) as f64 % 3.1).collect();
            let J = geometry::jacobian(self, &q);
            let (Some(product), Ok(square)) = (self.factors.determinant(&q), <[_; 6]>::try_from(J.as_slice())) else {
                return Err(RobotError::Value {
                    robot: self.name.clone(),
                    what: "factors.kind",
                    value: "\"puma\"".to_owned(),
                    remedy: format!("it needs six joints, and this arm has {}", self.dof()),
                });
            };
            let actual = nalgebra::Matrix6::from_columns(&square).determinant();
            if (actual - product).abs() > 1e-9 * scale {
                return Err(RobotError::Factors { robot: self.name.clone(), q, actual, product });
            }
        }
        Ok(())
    }
}

/// Quoted names, separated by commas.
pub(crate) fn list<T: fmt::Display>(names: impl IntoIterator<Item = T>) -> String {
    names.into_iter().map(|name| format!("'{name}'")).collect::<Vec<_>>().join(", ")
}

fn check_joint(robot: &str, joint: &Joint) -> Result<(), RobotError> {
    let refuse = |what, value: f64, remedy| {
        Err(RobotError::Joint { robot: robot.to_owned(), joint: joint.name.clone(), what, value: value.to_string(), remedy })
    };
    let limits = "state a range, lower < upper, in the URDF's <limit> or in the description";
    if joint.lower.is_nan() || joint.lower == f64::INFINITY {
        return refuse("lower", joint.lower, limits);
    }
    if joint.upper.is_nan() || joint.upper <= joint.lower {
        return refuse("upper", joint.upper, limits);
    }
    let positive = "state a positive number (or inf) in the URDF's <limit> or in the description";
    if joint.effort.is_nan() || joint.effort <= 0.0 {
        return refuse("effort", joint.effort, positive);
    }
    if joint.velocity.is_nan() || joint.velocity <= 0.0 {
        return refuse("velocity", joint.velocity, positive);
    }
    let not_negative = "state a finite number, zero or more";
    for (what, value) in
        [("armature", joint.armature), ("viscous_friction", joint.viscous_friction), ("coulomb_friction", joint.coulomb_friction)]
    {
        if !(value >= 0.0 && value.is_finite()) {
            return refuse(what, value, not_negative);
        }
    }
    Ok(())
}
