//! The nearest pose within reach: the one that the hand goes along with where the path lies beyond (+).
//!
//! At the boundary of reach ζ is its normal, and the pose of the path is e = δζ away where the hand is nearest: the kept part Eᵀe vanishes. The normal
//! turns as the hand moves along, ζ̇ = S·EᵀV, and of what the path does the hand needs
//!
//! ```text
//! d(Eᵀe)/dt = EᵀV_d − (1 + δS)·EᵀV:   V = (1 + δS)⁻¹·V_d,   a = (1 + δS)⁻¹·(a_d − 2δ̇ζ̇)          on a sphere R/(R + δ) of the path's
//! ```
//!
//! S follows from the covector w = ζ + E·c that the arm loses: on the boundary wᵀJ stays zero, so ẇᵀJ = −wᵀJ̇, and q̇ moves the arm along it.
//!
//! Reduces to the paper's law: within reach δ is zero, and nothing changes.

use crate::centre::PoseMotion;
use crate::linear::{Vector3, Vector6, angular, linear, stack};
use crate::paper::operational_space::Cholesky;
use crate::paper::singular_frame::orthogonal_rows;
use crate::singularity::screws::Screws;
use crate::tick::Now;
use crate::types::Singularity;
use nalgebra::{Matrix2, Matrix3x2, Matrix6, SMatrix, Vector2};

/// Curvature of a fold that is none, over the arm's length, 1/rad²; and the least share of the path's velocity by which 1 + δS is inverted.
const FLAT: f64 = 0.02;
const LEAST: f64 = 0.1;

/// The boundary of reach about the hand.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Boundary {
    /// Its normal.
    zeta: Vector3,
    /// Its tangents, one of them zero in a plane.
    tangents: Matrix3x2<f64>,
    /// How the normal turns towards the tangents, with the hand's twist.
    turns: SMatrix<f64, 2, 6>,
    /// How far the path lies beyond, along the normal, m.
    beyond_m: f64,
    /// (1 + δS)⁻¹ of the tangents.
    shares: Matrix2<f64>,
}

/// The boundary that keeps the hand from a pose at the distance `error`; `None` where none does.
///
/// Cost about 2 µs for each fold near by; no allocation.
pub(crate) fn nearest<const N: usize>(
    task: &[bool; 6],
    now: &Now<'_, N>,
    error: &Vector6,
) -> Option<Boundary> {
    let listed = now.report.listed().iter().filter(|s| !s.angular);
    let found = listed.filter_map(|s| Boundary::of(task, now, s, error));
    found.max_by(|a, b| a.beyond_m.abs().total_cmp(&b.beyond_m.abs()))
}

impl Boundary {
    fn of<const N: usize>(
        task: &[bool; 6],
        now: &Now<'_, N>,
        s: &Singularity<N>,
        error: &Vector6,
    ) -> Option<Self> {
        let beyond_m = s.zeta_B.dot(error) * (1.0 - s.openness(s.s));
        if beyond_m == 0.0 {
            return None;
        }
        let kept = orthogonal_rows::<N>(task, [s.zeta_B].into_iter()).ok()?;
        let mut E = Matrix6::<f64>::zeros();
        kept.iter()
            .enumerate()
            .for_each(|(k, e)| E.set_column(k, e));
        let K = E.transpose() * now.at.J;
        let mut gram = K * K.transpose();
        (kept.len()..6).for_each(|k| gram[(k, k)] = 1.0);
        let inverse = Cholesky::new(gram).ok()?.solve(&K);
        let w = s.zeta_B - E * (inverse * now.at.J.tr_mul(&s.zeta_B));
        // The motion that leaves the boundary.
        let out = s.aux_row - K.tr_mul(&(inverse * s.aux_row));
        let out = out.try_normalize(1e-3)?;
        let H = Screws(now.at.J).hessian(&w);
        let fold = out.dot(&(H * out));
        // Outwards is where a fold does not lead.
        if fold * beyond_m >= 0.0 || fold.abs() < FLAT * now.report.length_m {
            return None;
        }
        let along = inverse.transpose();
        let along = along - out * (H.tr_mul(&out).transpose() * along / fold);
        let turns = inverse * H * along * -E.transpose();
        let count = (0..kept.len())
            .filter(|k| linear(&kept[*k]).norm() > 0.5)
            .count();
        let mut boundary = Self {
            zeta: linear(&s.zeta_B),
            tangents: Matrix3x2::zeros(),
            turns: SMatrix::zeros(),
            beyond_m,
            shares: Matrix2::identity(),
        };
        for k in 0..count.min(2) {
            boundary.tangents.set_column(k, &linear(&kept[k]));
            boundary.turns.set_row(k, &turns.row(k));
        }
        let S = boundary.turns.fixed_columns::<3>(0) * boundary.tangents;
        let stretched = Matrix2::identity() + S * beyond_m;
        // At the centre of a hole every point of its boundary is as near.
        boundary.shares = stretched
            .try_inverse()
            .filter(|_| stretched.determinant() > LEAST && stretched.trace() > 0.0)?;
        Some(boundary)
    }

    /// The part that is left of a translation of the path where the hand goes along the boundary, less what its own turn takes, `taken`.
    fn left(&self, v: &Vector3, taken: &Vector2<f64>) -> Vector3 {
        let across = self.shares * (self.tangents.tr_mul(v) - taken);
        self.zeta * self.zeta.dot(v) + self.tangents * across
    }

    /// Puts the motion of the nearest pose in place of the path's: the desired one, its twist at full clock speed, and its acceleration at the present speed.
    pub(crate) fn lead(&self, desired: &mut PoseMotion, V: &mut Vector6, a_feed: &mut Vector6) {
        *a_feed = self.acceleration(a_feed, &desired.V);
        desired.a = self.acceleration(&desired.a, &desired.V);
        desired.V = self.velocity(&desired.V);
        *V = self.velocity(V);
    }

    /// The error from the nearest pose, and along the normal from the path's.
    pub(crate) fn error(&self, e: &Vector6) -> Vector6 {
        stack(&self.left(&linear(e), &Vector2::zeros()), &angular(e))
    }

    /// The twist of the nearest pose, and the path's own along the normal.
    fn velocity(&self, V: &Vector6) -> Vector6 {
        let turned = self.turns * stack(&Vector3::zeros(), &angular(V)) * self.beyond_m;
        stack(&self.left(&linear(V), &turned), &angular(V))
    }

    /// The acceleration of the nearest pose where the path has the twist `V`.
    fn acceleration(&self, a: &Vector6, V: &Vector6) -> Vector6 {
        let turn = self.turns * self.velocity(V) * (2.0 * self.zeta.dot(&linear(V)));
        let turned = self.turns * stack(&Vector3::zeros(), &angular(a)) * self.beyond_m;
        stack(&self.left(&linear(a), &(turned + turn)), &angular(a))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{robot, standing};

    /// Two links of a metre: the boundary is a circle of radius 2 m.
    #[test]
    fn beyond_a_circle_the_nearest_pose_goes_at_the_same_angle() {
        let task = &robot("planar2r").task.0;
        standing("planar2r", [0.3, 0.0, 0.0, 0.0, 0.0, 0.0], |now| {
            let outwards = Vector3::new(libm::cos(0.3), libm::sin(0.3), 0.0);
            let along = Vector3::new(-outwards.y, outwards.x, 0.0);
            let twist = |v: Vector3| stack(&v, &Vector3::zeros());
            let boundary = |beyond_m: f64| nearest(task, now, &twist(outwards * beyond_m));
            let half = boundary(0.5).unwrap();
            // The path at 1 m/s along and 0.7 m/s outwards, without an acceleration: its angle has the rate 0.4 and the acceleration −2·0.7·0.4/2.5.
            let V = twist(along + outwards * 0.7);
            let off = half.velocity(&V) - twist(along * 0.8 + outwards * 0.7);
            assert!(off.amax() < 1e-9, "{off}");
            let off = half.acceleration(&Vector6::zeros(), &V) + twist(along * 0.448);
            assert!(off.amax() < 1e-9, "{off}");
            assert!((half.error(&V) - half.velocity(&V)).amax() < 1e-12);
            assert!(boundary(-0.5).is_none() && boundary(0.0).is_none());
        });
    }
}
