//! Why a text is not a robot, and why a posture is not a robot's.

use crate::joint::JointKind;
use shared_types::MAX_DOF;
use std::fmt;

/// Why there is no such robot.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(
    missing_docs,
    reason = "each variant is its sentence, with its numbers"
)]
pub enum RobotError {
    #[error(
        "there is no robot '{name}'; the built-in ones are {known}, or give the path of a URDF or MJCF file"
    )]
    Unknown { name: String, known: String },
    #[error("robot '{robot}': {defect}")]
    Defect { robot: String, defect: Defect },
}

/// The defect of a text that is not a robot.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(
    missing_docs,
    reason = "each variant is its sentence, with its numbers"
)]
pub enum Defect {
    #[error("not a URDF: {0}")]
    Urdf(String),
    #[error(
        "it is MJCF, which MuJoCo reads: `python -m armplane.mjcf ARM.xml` makes a URDF of it; the commands of armplane and `Arm.from_urdf` in Python do so \
         by themselves for a file that ends in .xml"
    )]
    Mjcf,
    /// The file, the line and the defect.
    #[error("in its description, the TOML file of its name: {0}")]
    Description(String),
    #[error("the links do not form a tree: {0}")]
    NotATree(String),
    #[error(
        "it branches at link '{link}' into joints {joints}: only serial chains are supported, \
         so name the arm's end with `--frame LINK`, `frame = \"LINK\"` in a scenario, `tip=` in Python, or `default_frame = \"LINK\"` in its description \
         (the other joints are then held at zero)"
    )]
    Branches { link: String, joints: String },
    #[error(
        "it has no movable joint on the way to '{frame}': it needs 1 to {MAX_DOF} revolute, continuous or prismatic joints"
    )]
    NoMovableJoint { frame: String },
    #[error(
        "it has {0} movable joints in its chain; at most {MAX_DOF} are supported: fix some, or choose a nearer base or end (`base_frame`, `default_frame` in \
         its description; `--base`, `--frame` of `armplane inspect`)"
    )]
    TooManyJoints(usize),
    #[error(
        "joint '{joint}' is of type {kind}; supported are revolute, continuous, prismatic and fixed: \
         remove it, or make it one of these"
    )]
    UnsupportedJoint { joint: String, kind: String },
    #[error(
        "joint '{joint}' mimics '{leader}'; mimic joints are not supported in the chain: make it fixed or independent"
    )]
    Mimic { joint: String, leader: String },
    /// Gaps of an arm that is to move, and a block to fill in.
    #[error("it cannot move yet: {0}")]
    Gaps(String),
    /// Principal moments in kg·m².
    #[error(
        "link '{link}' has an impossible inertia: mass {mass} kg, principal moments {} kg·m² about its \
         centre of mass; the mass and every moment must be positive, and no moment larger than the sum of the other two",
        moments.map(|I| format!("{I:.4e}")).join(", ")
    )]
    Inertia {
        link: String,
        mass: f64,
        moments: [f64; 3],
    },
    #[error("{0} is not a finite number")]
    NotFinite(String),
    #[error("it has no frame '{frame}'; its links are {known}")]
    UnknownFrame { frame: String, known: String },
    #[error("the description has a joint '{joint}', but the chain's joints are {known}")]
    UnknownJoint { joint: String, known: String },
    /// A value of the URDF or the description, with the joint it belongs to.
    #[error("{what} = {value}; {remedy}")]
    Value {
        what: String,
        value: String,
        remedy: &'static str,
    },
    #[error("posture '{name}': {reason}")]
    Posture { name: String, reason: PostureError },
    /// det J in m³.
    #[error(
        "factors kind = \"puma\" does not fit its geometry: at q = {q:?} det J is {actual:.9e} but the product is {product:.9e}; \
         correct a2, a3, d4 or leave `factors` out (singularities are then found numerically)"
    )]
    Factors {
        q: Vec<f64>,
        actual: f64,
        product: f64,
    },
}

impl Defect {
    /// Refuses the first of some values of `owner` that does not hold. Of each: what it is, the value, whether it holds, and the remedy.
    pub(crate) fn check<const K: usize>(
        owner: &str,
        values: [(&str, String, bool, &'static str); K],
    ) -> Result<(), Self> {
        let mut broken = values.into_iter().filter(|(.., holds, _)| !holds);
        broken.next().map_or(Ok(()), |(what, value, _, remedy)| {
            let what = format!("{owner}{what}");
            Err(Self::Value {
                what,
                value,
                remedy,
            })
        })
    }

    /// A joint's value that cannot be.
    pub(crate) fn of_joint(
        joint: &str,
        what: &str,
        value: impl fmt::Display,
        remedy: &'static str,
    ) -> Self {
        Self::Value {
            what: format!("joint '{joint}' has {what}"),
            value: value.to_string(),
            remedy,
        }
    }
}

/// Why a posture is not the robot's; values in rad, or m for a sliding joint.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[allow(
    missing_docs,
    reason = "each variant is its sentence, with its numbers"
)]
pub enum PostureError {
    #[error(
        "{actual} joint values given, but the robot has {expected} joints ({joints}): give {expected}"
    )]
    Length {
        actual: usize,
        expected: usize,
        joints: String,
    },
    #[error("joint '{joint}' is {value}: give a finite number")]
    NotFinite { joint: String, value: f64 },
    #[error(
        "joint '{joint}' = {} is outside its limits [{}, {}]: the nearest within is {}",
        in_both(*kind, *value), in_both(*kind, *lower), in_both(*kind, *upper), in_both(*kind, value.clamp(*lower, *upper))
    )]
    OutsideLimits {
        joint: String,
        kind: JointKind,
        value: f64,
        lower: f64,
        upper: f64,
    },
    #[error("{robot} has no posture `{name}`: it has {known}; or give q or q_deg")]
    Unknown {
        robot: String,
        name: String,
        known: String,
    },
    #[error("joint '{joint}' slides, and has no position in degrees: give q, in rad and m")]
    Degrees { joint: String },
    #[error("no start posture is given: give one of q, q_deg, posture")]
    Missing,
}

/// A position in rad (m), and as people read it.
fn in_both(kind: JointKind, q: f64) -> String {
    format!("{q:.4} ({:.2}{})", kind.shown(q), kind.units()[0])
}

/// Most names in a sentence.
const MOST_NAMES: usize = 100;

/// Quoted names, separated by commas.
pub(crate) fn list<T: fmt::Display>(names: impl IntoIterator<Item = T>) -> String {
    let mut names = names.into_iter().map(|name| format!("'{name}'"));
    let mut shown: Vec<_> = names.by_ref().take(MOST_NAMES).collect();
    let left = names.count();
    if left > 0 {
        shown.push(format!("and {left} more"));
    }
    shown.join(", ")
}
