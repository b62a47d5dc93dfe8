//! The three singularities of a PUMA, by formula.
//!
//! det J = a2·(d4 c3 − a3 s3)·R·s5 with R = a2 c2 + a3 c23 + d4 s23
//!
//! With L3 = √(a3² + d4²) and θ the elbow angle from full stretch, d4 c3 − a3 s3 = −L3 sin θ. The three factors are the elbow's sin θ, the
//! overhead's R and the wrist's sin q5. Joints are numbered from 1 in the text and from 0 in the code.

use super::axes::{shoulder, unit};
use super::family::{ArmFamily, Posture, Situation};
use super::puma_inverse::{Forearm, PumaLengths, foresee};
use super::{elbow, waist, wrist};
use crate::continuous::foresight::{Foreseen, Foresight};
use crate::linear::rotation_exp;
use crate::paper::reference::Memory;
use crate::paper::type_1::Fold;
use crate::paper::type_2::Direction;
use crate::types::{Kind, Singularity};
use model::Terms;
use nalgebra::{SVector, Vector3};
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
}

impl<const N: usize> ArmFamily<N> for Puma {
    fn centre(&self, terms: &Terms<N>) -> Vector3<f64> {
        terms.p[4]
    }

    /// det J = −a2 L3 (a2 + L3)·s_elbow·s_wrist·s_overhead     [CK95 Eq. 1]
    fn measure(
        &mut self,
        posture: &Posture<'_, N>,
        out: &mut [Singularity<N>; MAX_SINGULARITIES],
    ) -> usize {
        out[0] = self.elbow(posture);
        out[1] = wrist::measure(posture);
        out[2] = waist::measure(posture, 1..3, self.lengths.a2 + self.lengths.L3);
        3
    }

    fn fold(&self, s: &Singularity<N>, at: &Situation<'_, N>) -> Option<Fold> {
        let S = shoulder(at.terms);
        let offset = (at.at.p - S).dot(&at.terms.z[1]);
        Some(elbow::fold(
            s.aux,
            elbow::cosine(&S, at.desired, [self.lengths.a2, self.lengths.L3], offset),
        ))
    }

    fn direction(
        &self,
        s: &Singularity<N>,
        at: &Situation<'_, N>,
        memory: &mut Memory,
    ) -> Option<Direction> {
        Some(match s.kind {
            Kind::Overhead => waist::direction(at, memory),
            _ => {
                let forearm = Forearm::new(&self.lengths, at.q, at.terms, &at.at.p);
                wrist::direction(
                    &wrist::Wrist::spherical(at.terms, at.qdot_planned),
                    s,
                    at,
                    memory,
                    |p, z6_d| forearm.at(p).wrist_bend(z6_d),
                )
            }
        })
    }

    fn turning(
        &self,
        s: &Singularity<N>,
        terms: &Terms<N>,
        _p_BC: &Vector3<f64>,
        angle: f64,
    ) -> Option<SVector<f64, N>> {
        match s.kind {
            Kind::Wrist => Some(wrist::turning(terms, angle)),
            Kind::Overhead => {
                let turn = rotation_exp(&(terms.z[0] * angle));
                let mut by = wrist::turning_with_forearm(
                    terms,
                    &(turn * terms.z[N - 3]),
                    &(turn * terms.z[N - 2]),
                );
                by[0] = angle;
                Some(by)
            }
            _ => None,
        }
    }

    fn foresee(&self, at: &Foresight<'_, N>, out: &mut Foreseen) {
        foresee(&self.lengths, at, out);
    }
}
