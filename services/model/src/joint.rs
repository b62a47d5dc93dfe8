//! A joint and the link it moves.

use crate::pose::Pose;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum JointKind {
    /// Turns, within limits.
    Revolute,
    /// Turns without limits.
    Continuous,
    /// Slides, within limits. Its positions are in m, its torques in N.
    Prismatic,
}

impl JointKind {
    /// A position as people read it: in degrees, or in mm where the joint slides.
    #[must_use]
    pub fn shown(self, q: f64) -> f64 {
        match self {
            Self::Prismatic => q * 1e3,
            _ => q.to_degrees(),
        }
    }

    /// Units of a position as it is [`shown`](Self::shown), and of a load.
    #[must_use]
    pub fn units(self) -> [&'static str; 2] {
        match self {
            Self::Prismatic => [" mm", "N"],
            _ => ["°", "N·m"],
        }
    }
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
    /// Lower position limit, rad (m where it slides); −∞ for none.
    pub lower: f64,
    /// Upper position limit, rad; ∞ for none.
    pub upper: f64,
    /// Torque limit, N·m (N where it slides); ∞ for none.
    pub effort: f64,
    /// Speed limit, rad/s; ∞ for none.
    pub velocity: f64,
    /// Largest rate of change of the torque that the drive accepts, N·m/s; ∞ for none.
    pub torque_rate: f64,
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
