//! What the geometry of an arm tells the tracker: the rows whose rank is watched, and the names of singular postures.

use super::screws::Screws;
use crate::linear::{Jacobian, Vector3, Vector6, angular, linear, stack};
use crate::types::Kind;

/// Sine, or share of a length, below which a geometric condition holds at a projected posture.
const HOLDS: f64 = 1e-4;

/// The arm's geometry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Geometry {
    /// Where axes 1 to 3 meet, base axes, m.
    pub(super) S: Option<Vector3>,
    /// Whether the elbow has a formula of its own: the translation along C − S is then replaced by joint 4.
    pub(super) elbow_apart: bool,
}

impl Geometry {
    /// The unit-scaled rows whose rank is watched; `p` is C − S.
    pub(super) fn rows<const N: usize>(
        &self,
        screws: &Screws<N>,
        p: &Vector3,
        length_m: f64,
    ) -> Jacobian<N> {
        let mut rows = screws.scaled(length_m);
        if self.elbow_apart && N > 3 {
            let along = p / p.norm().max(1e-9);
            for j in 0..N {
                let own: f64 = (0..3).map(|k| along[k] * rows[(k, j)]).sum();
                let wanted = if j == 3 { 1.0 } else { 0.0 };
                for k in 0..3 {
                    rows[(k, j)] += along[k] * (wanted - own);
                }
            }
        }
        rows
    }

    /// u without its share along C − S, which the elbow's formula measures.
    ///
    /// Shapes u 6, scaled rows · Frame base axes · Requires `p` = C − S, m · Errors none: u where the elbow has no formula of its own
    pub(super) fn without_elbow(&self, u: Vector6, p: &Vector3) -> Vector6 {
        if !self.elbow_apart {
            return u;
        }
        let along = p / p.norm().max(1e-9);
        let v = linear(&u);
        stack(&(v - along * along.dot(&v)), &angular(&u))
    }

    /// The term that the turn of p adds to uᵀ·d(rows)/dt·v, 1/s; J unscaled, `u` on the scaled rows.
    pub(super) fn turning<const N: usize>(
        &self,
        screws: &Screws<N>,
        p: &Vector3,
        [u, v, qdot]: [&[f64]; 3],
        length_m: f64,
    ) -> f64 {
        if !self.elbow_apart || N < 4 {
            return 0.0;
        }
        let (length, velocity) = (p.norm().max(1e-9), |y: &[f64]| {
            (0..N).map(|j| screws.column(j).0 * y[j]).sum::<Vector3>()
        });
        let along = p / length;
        let C = velocity(qdot);
        let (rate, moved) = ((C - along * along.dot(&C)) / length, velocity(v) / length_m);
        let u = Vector3::new(u[0], u[1], u[2]);
        u.dot(&rate) * (v[3] - along.dot(&moved)) - u.dot(&along) * rate.dot(&moved)
    }

    /// The name of the singular set in which a posture lies, and the one for a second direction that is lost there.
    ///
    /// Elbow: joint 4 does not change the distance from S to where axes 5 and 6 meet. Shoulder: axes 1 and 3 are parallel. Else the wrist.
    pub(super) fn names<const N: usize>(&self, screws: &Screws<N>, p: &Vector3) -> [Kind; 2] {
        if self.S.is_none() || N != 7 {
            return [Kind::Numeric; 2];
        }
        let z = |i: usize| screws.column(i).1;
        let point = |i: usize| screws.column(i).1.cross(&screws.column(i).0);
        let normal = z(4).cross(&z(5));
        let W = point(4)
            + z(4)
                * ((point(5) - point(4)).cross(&z(5)).dot(&normal)
                    / normal.norm_squared().max(1e-12));
        let (reach, forearm) = (W + p, W - point(3));
        let parallel = |i: usize, j: usize| z(i).cross(&z(j)).norm() < HOLDS;
        let other = if parallel(0, 2) {
            Kind::Shoulder
        } else {
            Kind::Wrist
        };
        if !self.elbow_apart
            && reach.dot(&z(3).cross(&forearm)).abs() < HOLDS * reach.norm() * forearm.norm()
        {
            return [Kind::Elbow, other];
        }
        if parallel(4, 6) {
            [Kind::Wrist, other]
        } else {
            [other, Kind::Wrist]
        }
    }
}
