//! Why a text is not a robot, and why a posture is not a robot's.

use shared_types::MAX_DOF;
use std::fmt;

/// Why a text is not a description: the TOML parser's message, with line and column.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct DescriptionError(pub(crate) String);

/// Why a text is not a robot.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RobotError {
    /// No built-in robot of that name.
    #[error(
        "there is no robot '{name}'; the built-in ones are {known}, or give the path of a URDF file"
    )]
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
        /// The fault.
        reason: String,
    },
    /// Several movable branches, none of them named as the arm.
    #[error(
        "robot '{robot}' branches at link '{link}' into joints {joints}: only serial chains are supported, \
         so name the arm's end with `--frame LINK`, `frame = \"LINK\"` in a scenario, or `default_frame = \"LINK\"` in its description \
         (the other joints are then held at zero)"
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
    #[error(
        "robot '{robot}': joint '{joint}' is of type {kind}; supported are revolute, continuous, prismatic and fixed"
    )]
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
        /// The remedy.
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
    /// The description names a joint that the chain does not have.
    #[error(
        "robot '{robot}': the description has a joint '{joint}', but the chain's joints are {known}"
    )]
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
        /// The remedy.
        remedy: String,
    },
    /// A named posture is impossible.
    #[error("robot '{robot}': posture '{name}': {reason}")]
    Posture {
        /// The robot's name.
        robot: String,
        /// The posture's name.
        name: String,
        /// The fault.
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
    #[error(
        "{actual} joint values given, but the robot has {expected} joints ({joints}): give {expected}"
    )]
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

/// Quoted names, separated by commas.
pub(crate) fn list<T: fmt::Display>(names: impl IntoIterator<Item = T>) -> String {
    names
        .into_iter()
        .map(|name| format!("'{name}'"))
        .collect::<Vec<_>>()
        .join(", ")
}
