//! An arm with its number of joints in the type.

use crate::body::Bodies;
use crate::joint::Joint;
use crate::pose::Pose;
use crate::robot::Robot;
use nalgebra::{SVector, Vector3};

/// Why a robot has no model of this size or at this frame.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// The robot has more joints than the type.
    #[error("robot '{robot}' has {actual} joints, more than {expected}: use Model::<{actual}>")]
    Dof {
        /// The robot's name.
        robot: String,
        /// The type's number of joints.
        expected: usize,
        /// The robot's number of joints.
        actual: usize,
    },
    /// The robot has no such frame.
    #[error("robot '{robot}' has no frame '{frame}'; its frames are {known}")]
    UnknownFrame {
        /// The robot's name.
        robot: String,
        /// The frame asked for.
        frame: String,
        /// The frames there are.
        known: String,
    },
}

/// An arm of at most `N` joints and one end-effector frame, ready to compute.
///
/// Places beyond the arm's own joints are *absent* joints: their columns of J are zero, their block of A is the identity, their bias torques are
/// zero, their limits infinite. They are decoupled from the arm, so that with q, q̇ and τ zero there they stay at zero, and every algorithm gives
/// the arm's own values in its own places. An arm of two to five joints thus shares the code of six.
///
/// Immutable: every function is a pure function of its arguments, allocates nothing, and cannot fail. Finite arguments
/// give finite results; q may be any real posture, inside the limits or not.
#[derive(Clone, Debug)]
pub struct Model<const N: usize> {
    pub(crate) bodies: Bodies<N>,
    /// The link that carries E; `None` is the base.
    pub(crate) ee_body: Option<usize>,
    /// E in that link's axes (in the base, for the base).
    pub(crate) X_LE: Pose,
    pub(crate) gravity: Vector3<f64>,
    pub(crate) armature: SVector<f64, N>,
    pub(crate) viscous_friction: SVector<f64, N>,
    pub(crate) coulomb_friction: SVector<f64, N>,
    pub(crate) lower: SVector<f64, N>,
    pub(crate) upper: SVector<f64, N>,
    pub(crate) effort: SVector<f64, N>,
    pub(crate) velocity: SVector<f64, N>,
    pub(crate) torque_rate: SVector<f64, N>,
}

impl<const N: usize> Model<N> {
    /// The model of `robot` with its end-effector frame at `frame` (its default frame if `None`).
    ///
    /// # Errors
    /// [`ModelError`] if `robot` has more than `N` joints, or no such frame.
    pub fn new(robot: &Robot, frame: Option<&str>) -> Result<Self, ModelError> {
        if robot.dof() > N || robot.dof() == 0 {
            return Err(ModelError::Dof {
                robot: robot.name.clone(),
                expected: N,
                actual: robot.dof(),
            });
        }
        let frame = frame.unwrap_or(&robot.default_frame);
        let found = robot.frame(frame).ok_or_else(|| ModelError::UnknownFrame {
            robot: robot.name.clone(),
            frame: frame.to_owned(),
            known: robot.frame_names(),
        })?;
        let bodies = Bodies::new(robot);
        let column = |f: fn(&Joint) -> f64, absent: f64| {
            SVector::from_fn(|i, _| robot.joints.get(i).map_or(absent, f))
        };
        const NONE: f64 = f64::INFINITY;
        Ok(Self {
            ee_body: found.joint,
            X_LE: match found.joint {
                Some(i) => Pose::rotation(bodies.R_urdf[i]) * found.X_LF,
                None => found.X_LF,
            },
            bodies,
            gravity: robot.gravity,
            armature: column(|j| j.armature, 1.0),
            viscous_friction: column(|j| j.viscous_friction, 0.0),
            coulomb_friction: column(|j| j.coulomb_friction, 0.0),
            lower: column(|j| j.lower, -NONE),
            upper: column(|j| j.upper, NONE),
            effort: column(|j| j.effort, NONE),
            velocity: column(|j| j.velocity, NONE),
            torque_rate: column(|j| j.torque_rate, NONE),
        })
    }

    /// The same arm with its end-effector frame moved by `X_ET`: a tool T fixed in the present frame E.
    ///
    /// Kinematics only; the tool's mass is not added.
    pub fn with_tool(mut self, X_ET: &Pose) -> Self {
        self.X_LE = self.X_LE * *X_ET;
        self
    }

    /// The same arm with a share of its torque limits and torque rates, in (0, 1]: the rest is reserved.
    pub fn with_torque_share(mut self, share: f64) -> Self {
        self.effort *= share;
        self.torque_rate *= share;
        self
    }

    /// Reflected rotor inertias, kg·m² (kg for a sliding joint).
    pub fn armature(&self) -> &SVector<f64, N> {
        &self.armature
    }

    /// Viscous friction, N·m·s/rad.
    pub fn viscous_friction(&self) -> &SVector<f64, N> {
        &self.viscous_friction
    }

    /// Coulomb friction, N·m.
    pub fn coulomb_friction(&self) -> &SVector<f64, N> {
        &self.coulomb_friction
    }

    /// Lower position limits, rad; −∞ for none.
    pub fn lower(&self) -> &SVector<f64, N> {
        &self.lower
    }

    /// Upper position limits, rad; ∞ for none.
    pub fn upper(&self) -> &SVector<f64, N> {
        &self.upper
    }

    /// Torque limits, N·m; ∞ for none.
    pub fn effort(&self) -> &SVector<f64, N> {
        &self.effort
    }

    /// Speed limits, rad/s; ∞ for none.
    pub fn velocity(&self) -> &SVector<f64, N> {
        &self.velocity
    }

    /// Largest rates of change of the torques, N·m/s; ∞ for none.
    pub fn torque_rate(&self) -> &SVector<f64, N> {
        &self.torque_rate
    }
}
