//! The path ahead through an arm's closed-form inverse kinematics: how far each joint moves from one of its points to the next.

use super::waist::CROSSING;
use super::wrist::{PASS, nearest_to_origin};
use crate::continuous::foresight::{Foreseen, Foresight};
use crate::linear::{wrap_angle, wrap_line};
use model::Pose;
use nalgebra::{Vector2, Vector3};

/// The arm at one point of the path.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point<J> {
    /// Turn of the waist from where it is now, rad.
    pub(super) turn: f64,
    /// In-plane distance of C from the waist axis, signed by its side, m.
    pub(super) R: f64,
    /// The wrist's bend: |w| is the sine of the wrist angle, its direction that of ζ but for a constant.
    pub(super) w: Vector2<f64>,
    /// The other joints.
    pub(super) joints: J,
}

/// The arm's motion from one point of the path to the next.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stretch<J> {
    pub(super) from: Point<J>,
    pub(super) to: Point<J>,
    /// Turn of the waist, rad.
    pub(super) waist: f64,
    /// Turn of w, rad; where the wrist's singularity is passed through, that of its line.
    pub(super) wrist: f64,
    /// Closest approach of w to the wrist's singularity, rad.
    pub(super) nearest: f64,
}

/// Closed-form inverse kinematics on one side of the waist axis.
pub(super) trait InverseKinematics: Copy {
    /// The joints besides the waist.
    type Joints: Copy;

    /// The same on the other side of the waist axis.
    fn other_side(&self) -> Self;

    /// The arm with C at `X`, the last axis along `z6_d`, from the joints at the point before; `None` at the path's first point.
    ///
    /// Frame base axes · Units m · Ensures finite numbers for any pose: one beyond reach is moved to the boundary · Cost O(1), no allocation
    fn at_pose(
        &self,
        X: &Pose,
        z6_d: &Vector3<f64>,
        before: Option<&Self::Joints>,
    ) -> Point<Self::Joints>;
}

/// Raises the demand on each stretch of the path ahead to the largest share of any rate that it takes at full clock speed.
///
/// `moved` gives the motions of a stretch, each with its largest rate: rad and rad/s. An arm that passes near its waist axis comes out on the side to
/// which the waist turns less. Shapes `out.demand` one number per stretch · Errors none · Cost one or two inverse kinematics per point, no allocation
pub(super) fn foresee<A: InverseKinematics, const N: usize, const M: usize>(
    mut arm: A,
    at: &Foresight<'_, N>,
    out: &mut Foreseen,
    moved: impl Fn(&Stretch<A::Joints>) -> [(f64, f64); M],
) {
    let z6_E = at.terms.X_BE.R.transpose() * at.terms.z[N - 1];
    let point = |arm: &A, k: usize, before: Option<&A::Joints>| {
        let X = at.poses[k];
        arm.at_pose(&X, &(X.R * z6_E), before)
    };
    let mut from = point(&arm, 0, None);
    for k in 1..at.poses.len() {
        let mut to = point(&arm, k, Some(&from.joints));
        if from.R.abs() < CROSSING {
            let other = arm.other_side();
            let there = point(&other, k, Some(&from.joints));
            let jump = |to: &Point<A::Joints>| wrap_angle(to.turn - from.turn).abs();
            if jump(&there) < jump(&to) {
                (arm, to) = (other, there);
            }
        }
        let nearest = nearest_to_origin(&from.w, &to.w).norm();
        let turn = libm::atan2(from.w.perp(&to.w), from.w.dot(&to.w));
        let wrist = if at.passing || nearest < PASS {
            wrap_line(turn)
        } else {
            turn
        };
        let stretch = Stretch {
            from,
            to,
            waist: wrap_angle(to.turn - from.turn),
            wrist,
            nearest,
        };
        for (by, limit) in moved(&stretch) {
            out.demand[k - 1] = out.demand[k - 1].max(by.abs() / (at.step_s * limit));
        }
        from = to;
    }
}
