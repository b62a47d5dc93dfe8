//! The inputs and intermediate results of one tick of the controller.

use crate::centre::{AtCentre, PoseMotion};
use crate::continuous::path_plan::Sample;
use crate::continuous::saturation::Limited;
use crate::law::Actives;
use crate::linear::{angular, linear};
use crate::telemetry::Telemetry;
use crate::trajectory::Leg;
use crate::types::Report;
use model::Terms;
use nalgebra::{SVector, Vector3, Vector6};

/// The inputs of one tick.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Inputs<'a, const N: usize> {
    pub(crate) q: &'a SVector<f64, N>,
    pub(crate) qdot: &'a SVector<f64, N>,
    pub(crate) tau_disturbance: &'a SVector<f64, N>,
    pub(crate) report: &'a Report<N>,
    pub(crate) terms: &'a Terms<N>,
    /// Kinematics at C.
    pub(crate) at: &'a AtCentre<N>,
    /// C in the end-effector's axes, m.
    pub(crate) p_EC: &'a Vector3<f64>,
}

/// Step 1's result: the desired motion and the acceleration that follows it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion<const N: usize> {
    /// The leg of the path, while it lasts.
    pub(crate) leg: Option<Leg>,
    /// The planned posture, where the leg is planned.
    pub(crate) planned: Option<Sample<N>>,
    /// From a goal on that is beyond reach.
    pub(crate) clips: bool,
    /// Speed of the clock; the path's own runs at it, or waits.
    pub(crate) clock: f64,
    /// Desired motion of E.
    pub(crate) desired_E: PoseMotion,
    /// Desired motion of C.
    pub(crate) desired: PoseMotion,
    /// Twist of C at full clock speed.
    pub(crate) V_nominal: Vector6<f64>,
    /// Acceleration of C at the clock's present speed.
    pub(crate) a_feed: Vector6<f64>,
    /// Pose error at C.
    pub(crate) error: Vector6<f64>,
    /// The share of a* that answers to the pose error, k_p·e bounded.
    pub(crate) feedback: Vector6<f64>,
    /// Operational acceleration a* at C.
    pub(crate) a: Vector6<f64>,
}

/// Step 2's result: the singularities that take part in the solve, and the telemetry of each.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Auxiliary<const N: usize> {
    pub(crate) actives: Actives<N>,
    pub(crate) telemetry: Telemetry,
    /// Largest share of an auxiliary rate at full clock speed.
    pub(crate) load: f64,
}

/// Step 4's result: the torque within its limits, and where it met its rate.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LimitedTorque<const N: usize> {
    /// Before the torque rates.
    pub(crate) limited: Limited<N>,
    /// Bit i where joint i met its rate.
    pub(crate) rate_mask: u32,
}

impl<const N: usize> Motion<N> {
    /// The share of a* = `a` along the path's twist, metres made radians by the arm's length.
    #[inline]
    pub(crate) fn along_path(&self, a: &Vector6<f64>, length_m: f64) -> Vector6<f64> {
        let (V, L2) = (&self.V_nominal, length_m * length_m);
        let dot = |x: &Vector6<f64>, y: &Vector6<f64>| {
            linear(x).dot(&linear(y)) / L2 + angular(x).dot(&angular(y))
        };
        let size = dot(V, V);
        if size < 1e-8 {
            Vector6::zeros()
        } else {
            V * (dot(V, a) / size)
        }
    }
}
