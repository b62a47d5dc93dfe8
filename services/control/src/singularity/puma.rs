//! The three singularities of a PUMA, by formula.
//!
//! det J = a2·(d4 c3 − a3 s3)·R·s5 with R = a2 c2 + a3 c23 + d4 s23
//!
//! With L3 = √(a3² + d4²) and θ the elbow angle from full stretch, d4 c3 − a3 s3 = −L3 sin θ. The three factors are the elbow's sin θ, the
//! overhead's R and the wrist's sin q5. Joints are numbered from 1 in the text and from 0 in the code.

use super::axes::{shoulder, unit};
use super::family::{Posture, Situation};
use super::puma_inverse::{Forearm, PumaLengths};
use super::{elbow, waist, wrist};
use crate::paper::reference::Memory;
use crate::paper::type_2::Direction;
use crate::types::Singularity;
use nalgebra::Vector3;
use shared_types::MAX_SINGULARITIES;

/// A PUMA with a spherical wrist, six joints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Puma {
    lengths: PumaLengths,
}

impl Puma {
    /// From the DH lengths, m.
    #[must_use]
    pub fn new(a2: f64, a3: f64, d4: f64) -> Self {
        Self {
            lengths: PumaLengths::new(a2, a3, d4),
        }
    }

    /// Elbow: the wrist centre cannot move along the line from the shoulder's centre to it.
    ///
    /// ζ = p/|p| is orthogonal to both tangents z1×p and z2×p, because both axes pass through S. |p|² = a2² + L3² + 2 a2 L3 cos θ + d², so
    /// ζᵀJ = −(a2 L3 sin θ/|p|)·e3 exactly. Type 1: θ moves the wrist centre along ζ at second order.
    fn elbow<const N: usize>(&self, at: &Posture<'_, N>) -> Singularity<N> {
        let p = at.at.p - shoulder(at.terms);
        let length = p.norm();
        let zeta = if length > 1e-9 {
            p / length
        } else {
            at.terms.z[0]
        };
        let fold = self.lengths.a2 * self.lengths.L3 / length.max(1e-9);
        elbow::measure(
            (&zeta, &at.terms.z[1]),
            (self.lengths.theta(at.q[2]), at.qdot[2]),
            fold,
            unit(2),
        )
    }

    /// det J = −a2 L3 (a2 + L3)·s_elbow·s_wrist·s_overhead     [CK95 Eq. 1]
    pub(super) fn measure<const N: usize>(
        &self,
        posture: &Posture<'_, N>,
        out: &mut [Singularity<N>; MAX_SINGULARITIES],
    ) -> usize {
        out[0] = self.elbow(posture);
        out[1] = wrist::measure(posture);
        out[2] = waist::measure(posture, 1..3, self.lengths.a2 + self.lengths.L3);
        3
    }

    /// cos θ that puts C at its desired place, and its rate, 1/s.
    pub(super) fn elbow_cosine<const N: usize>(&self, at: &Situation<'_, N>) -> [f64; 2] {
        let S = shoulder(at.terms);
        let offset = (at.at.p - S).dot(&at.terms.z[1]);
        elbow::cosine(&S, at.desired, [self.lengths.a2, self.lengths.L3], offset)
    }

    /// The direction of ζ that the desired motion needs, at the wrist's singularity.
    pub(super) fn direction<const N: usize>(
        &self,
        s: &Singularity<N>,
        at: &Situation<'_, N>,
        memory: &mut Memory,
    ) -> Direction {
        let forearm = Forearm::new(&self.lengths, at.q, at.terms, &at.at.p);
        let wrist = wrist::Wrist::spherical(at.terms, at.qdot_planned);
        let bend_at = |p: &Vector3<f64>, z6_d: &Vector3<f64>| forearm.at(p).wrist_bend(z6_d);
        wrist::direction(&wrist, s, at, memory, bend_at)
    }
}
