//! Inverse kinematics by Newton steps, in units in which a metre and a radian compare (+).

use super::request::Deviation;
use crate::linear::{
    Jacobian, Joints, Matrix3, Vector3, Vector6, angular, displaced, linear, served, stack,
    symmetric_eigen,
};
use crate::reference::free_axis::{free_axis, rotation_error};
use model::{Model, Pose, TaskAxes};

/// Unit-scaled singular value below which a Newton step asks nothing of a direction.
const FLOOR: f64 = 1e-6;
/// Unit-scaled pose error at which a posture counts as a solution: 0.4 nm, 1e-9 rad.
pub const SOLVED: f64 = 1e-9;
/// Damping under which a direction stands still that is lost, and not needed; unit-scaled pose error of a self-motion that is none.
pub(super) const PLAIN_DAMPING: f64 = 1e-3;
const AT_REST: f64 = 1e-6;
/// Newton steps towards one pose.
const STEPS: usize = 12;
/// The same where damping leaves an error anyway.
const DAMPED_STEPS: usize = 3;
/// Largest joint motion of one Newton step, rad.
const STRIDE: f64 = 0.4;
/// Damped steps from a posture further away, and the unit-scaled pose error that is none.
const APPROACH: (u32, f64) = (60, 1e-6);

/// The kinematics of C, a point of the end-effector link, on the task's axes; lengths are divided by `length_m`.
#[derive(Clone, Copy, Debug)]
pub struct Kinematics<'a, const N: usize> {
    /// The arm.
    pub model: &'a Model<N>,
    /// C in the end-effector's axes, m.
    pub p_EC: Vector3,
    /// Which of the six task axes count.
    pub task: [bool; 6],
    /// The length that makes metres and radians comparable, m.
    pub length_m: f64,
}

/// Unit-scaled σ below which a posture is exactly singular: a self-motion leaves the pose where it is.
pub(crate) const LOCKED: f64 = 2e-3;

/// Eigenvectors of JᵀJ, smallest eigenvalue first, with J itself.
#[derive(Clone, Copy, Debug)]
pub struct Spectrum<const N: usize> {
    /// The unit-scaled Jacobian at C, rows without a task axis zero.
    pub J: Jacobian<N>,
    /// Singular values, smallest first; the first `free` belong to the spare joints.
    pub sigma: [f64; N],
    /// Right singular vectors.
    pub v: [Joints<N>; N],
    /// Joints more than task axes.
    pub free: usize,
    /// Absent joints, which move nothing: the first of the spare ones.
    absent: usize,
}

impl<const N: usize> Spectrum<N> {
    /// The smallest singular value of the task.
    pub fn smallest(&self) -> f64 {
        self.sigma.get(self.free).copied().unwrap_or(0.0)
    }

    /// σ_k v_k's left vector: the task direction that the joint motion `v` moves, not normalised where it moves nothing.
    pub fn lost(&self, k: usize) -> Vector6 {
        // The left vector of a vanishing σ: what no joint motion with a larger σ produces. Left to the caller for k with σ_k > 0.
        self.J * self.v[k]
    }

    /// Σ v_k (J v_k)ᵀe/(σ_k² + λ²) over what is above the floor: the shortest joint motion for the task displacement `e`.
    pub fn solve(&self, e: &Vector6, damping: f64) -> Joints<N> {
        let mut dq = Joints::zeros();
        for k in self.free..N {
            let square = self.sigma[k] * self.sigma[k];
            if self.sigma[k] > FLOOR {
                dq += self.v[k] * (self.lost(k).dot(e) / (square + damping * damping));
            }
        }
        dq
    }

    /// Directions in which spare joints move.
    pub(super) fn spare(&self) -> &[Joints<N>] {
        &self.v[self.absent.min(self.free)..self.free]
    }

    /// The share of `dq` that moves nothing.
    pub fn null_part(&self, dq: &Joints<N>) -> Joints<N> {
        self.v[..self.free]
            .iter()
            .fold(Joints::zeros(), |sum, v| sum + v * v.dot(dq))
    }
}

impl<const N: usize> Kinematics<'_, N> {
    /// The pose of C.
    pub fn pose(&self, q: &Joints<N>) -> Pose {
        let X = self.model.forward_kinematics(q);
        Pose {
            R: X.R,
            p: X.p + X.R * self.p_EC,
        }
    }

    /// From `X` to `X_d`, unit-scaled, on the task's axes; where two rotations are served, whatever the third one is.
    pub fn error(&self, X_d: &Pose, X: &Pose) -> Vector6 {
        let turn = rotation_error(&X_d.R, &X.R, free_axis(&self.task).as_ref());
        let e = stack(&((X_d.p - X.p) / self.length_m), &turn);
        served(&self.task, &e)
    }

    /// The spectrum of the unit-scaled Jacobian at C.
    pub fn spectrum(&self, q: &Joints<N>) -> Spectrum<N> {
        let mut J = self.model.jacobian(q);
        let is_absent: [bool; N] = std::array::from_fn(|i| J.column(i).amax() == 0.0);
        let r = self.model.forward_kinematics(q).R * self.p_EC;
        J = displaced(J, &r);
        for (k, mut row) in J.row_iter_mut().enumerate() {
            if !self.task[k] {
                row.fill(0.0);
            } else if k < 3 {
                row /= self.length_m;
            }
        }
        let (values, vectors) = symmetric_eigen(&J.tr_mul(&J));
        let mut order: [usize; N] = std::array::from_fn(|i| i);
        let moves: [bool; N] = std::array::from_fn(|k| !is_absent[vectors.column(k).iamax()]);
        order.sort_by(|a, b| {
            let by_value = values[*a].total_cmp(&values[*b]);
            moves[*a].cmp(&moves[*b]).then(by_value)
        });
        let rows = TaskAxes(self.task).count();
        Spectrum {
            J,
            // The norm of J·v resolves what the square root of an eigenvalue's rounding would not.
            sigma: std::array::from_fn(|k| (J * vectors.column(order[k])).norm()),
            v: std::array::from_fn(|k| vectors.column(order[k]).into_owned()),
            free: N.saturating_sub(rows),
            absent: is_absent.iter().filter(|absent| **absent).count(),
        }
    }

    /// The solution that continues `guess`; `drift` is null-space motion wanted on the way.
    ///
    /// Returns the posture and the pose error that is left: at most [`SOLVED`] (or `enough`) where it converged.
    pub fn solve(
        &self,
        X_d: &Pose,
        guess: &Joints<N>,
        drift: &Joints<N>,
        damping: f64,
        enough: f64,
    ) -> (Joints<N>, Vector6) {
        let mut q = *guess;
        let mut drift = *drift;
        let mut e = self.error(X_d, &self.pose(&q));
        for _ in 0..if damping == 0.0 || enough > SOLVED {
            STEPS
        } else {
            DAMPED_STEPS
        } {
            let wanted = drift.amax() > 0.0;
            if e.norm() < enough && !wanted {
                break;
            }
            let spectrum = self.spectrum(&q);
            let mut dq = spectrum.solve(&e, damping);
            if wanted {
                dq += spectrum.null_part(&drift);
                drift = Joints::zeros();
            }
            let size = dq.amax();
            if !size.is_finite() {
                break;
            }
            if size > STRIDE {
                dq *= STRIDE / size;
            }
            q += dq;
            e = self.error(X_d, &self.pose(&q));
            if size < 1e-13 {
                break;
            }
        }
        (q, e)
    }

    /// The posture near `guess` of a self-motion at the pose `X`, and the error that is left: in a lock, where rounding errors are not to turn the joints.
    pub(super) fn at_rest(&self, X: &Pose, guess: &Joints<N>) -> (Joints<N>, Vector6) {
        let zero = Joints::zeros();
        self.solve(X, guess, &zero, PLAIN_DAMPING, AT_REST)
    }

    /// The posture of a pose that damped steps from `near` lead to: the damping falls where a step helps, and grows where it does not.
    pub(super) fn approach(&self, X: &Pose, near: &Joints<N>) -> Option<Joints<N>> {
        let (mut q, mut damping) = (*near, 0.1);
        let mut e = self.error(X, &self.pose(&q));
        let mut spectrum = self.spectrum(&q);
        for _ in 0..APPROACH.0 {
            if e.norm() < APPROACH.1 {
                return Some(q);
            }
            let step = spectrum.solve(&e, damping);
            let next = q + step * (STRIDE / step.amax().max(STRIDE));
            let left = self.error(X, &self.pose(&next));
            if left.norm() < e.norm() {
                (q, e) = (next, left);
                spectrum = self.spectrum(&q);
                damping *= 0.3;
            } else if damping > 1e3 {
                return None;
            } else {
                damping *= 4.0;
            }
        }
        None
    }

    /// Largest part of a unit-scaled error at C over what is allowed of it at E.
    pub fn excess(&self, e: &Vector6, R: &Matrix3, allowed: &Deviation) -> f64 {
        let at_E = linear(e) * self.length_m - angular(e).cross(&(R * self.p_EC));
        (at_E.norm() / allowed.position_m).max(angular(e).norm() / allowed.orientation_rad)
    }
}

/// Where `f` is lowest within a range, by steps of golden section.
pub(super) fn lowest((mut low, mut high): (f64, f64), steps: u32, f: impl Fn(f64) -> f64) -> f64 {
    for _ in 0..steps {
        let (c, d) = (high - 0.618 * (high - low), low + 0.618 * (high - low));
        if f(c) < f(d) { high = d } else { low = c }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{posture, puma};
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn newton_finds_a_near_pose(q in posture(puma()), by in prop::array::uniform6(-0.05..0.05)) {
            let arm = Kinematics { model: puma(), p_EC: Vector3::zeros(), task: [true; 6], length_m: 0.43 };
            prop_assume!(arm.spectrum(&q).smallest() > 0.05);
            let there = arm.pose(&(q + Joints::from(by)));
            let (found, e) = arm.solve(&there, &q, &Joints::zeros(), 0.0, SOLVED);
            prop_assert!(e.norm() < SOLVED, "{e}");
            prop_assert!(arm.error(&there, &arm.pose(&found)).norm() < 1e-8);
        }
    }
}
