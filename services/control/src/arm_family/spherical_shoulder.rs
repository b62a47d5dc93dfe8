//! Seven joints with a spherical shoulder and a spherical wrist (KUKA iiwa and its kin), by geometry.
//!
//! Axes 1, 2, 3 meet in S, axes 5, 6, 7 in C. Joints 1 to 3 move C on a sphere about S, so that pᵀJ = −L2 L3 sin θ·e4 exactly, with p = C − S. Where
//! axes 5 and 7 are parallel the spare joint stands in, by turning the arm about p: the wrist is singular only where that does not turn the
//! end-effector about n = z5×z6 either, two conditions at once, and its measure is the length of both. Where axes 1 to 3 all move C in one
//! direction (two conditions, too) nothing is reported: there the law refuses.

use super::axes::{EXACT, in_general_position, meeting, unit};
use super::family::{ArmFamily, Posture, Situation};
use super::{elbow, wrist};
use crate::paper::type_1::Fold;
use crate::types::{Class, Singularity};
use model::{Robot, Terms};
use nalgebra::{SVector, Vector3};
use shared_types::MAX_SINGULARITIES;

/// An arm with a spherical shoulder and a spherical wrist.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphericalShoulder {
    /// The shoulder's centre, base axes, m.
    pub S: Vector3<f64>,
    /// C on the last axis, from its origin, m.
    offset: f64,
}

impl SphericalShoulder {
    /// The family's arm, where the axes of `robot` are those of one.
    #[must_use]
    pub fn of<const N: usize>(robot: &Robot) -> Option<Self> {
        if N != 7 {
            return None;
        }
        in_general_position(robot, Self::at::<N>, |one, two| (one.S - two.S).norm() < EXACT && (one.offset - two.offset).abs() < EXACT)
    }

    fn at<const N: usize>(terms: &Terms<N>) -> Option<Self> {
        let (offset, spherical) = meeting(terms);
        let (offset, z, p) = (offset?, &terms.z, &terms.p);
        let across = z[0].cross(&z[1]);
        let along = (p[1] - p[0]).cross(&z[1]).dot(&across) / across.norm_squared().max(EXACT);
        let S = p[0] + z[0] * along;
        let passes = |i: usize| (S - p[i]).cross(&z[i]).norm() < EXACT;
        (spherical && passes(1) && passes(2)).then_some(Self { S, offset })
    }

    /// Elbow: C cannot move along the line from S to it. Type 1.
    fn elbow<const N: usize>(&self, bend: &Elbow, at: &Posture<'_, N>) -> Singularity<N> {
        let length = bend.p.norm();
        let zeta = if length > 1e-9 { bend.p / length } else { at.terms.z[2] };
        let fold = bend.lengths[0] * bend.lengths[1] / length.max(1e-9);
        elbow::measure((&zeta, &at.terms.z[3]), (bend.theta, at.qdot[3]), fold, unit(3))
    }

    fn bend<const N: usize>(&self, terms: &Terms<N>, p_C: &Vector3<f64>) -> Elbow {
        Elbow::new(&self.S, &terms.p[3], p_C, &terms.z[3])
    }
}

/// An elbow between two centres, in the plane normal to its axis: upper arm, forearm, and the share of p = C − S along the axis, m.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Elbow {
    /// C − S.
    p: Vector3<f64>,
    /// Lengths of upper arm and forearm, m.
    lengths: [f64; 2],
    /// Angle from full stretch, (−π, π].
    theta: f64,
    /// p along the elbow's axis, m.
    offset: f64,
}

impl Elbow {
    /// The elbow whose axis goes through `E` along `n`.
    fn new(S: &Vector3<f64>, E: &Vector3<f64>, C: &Vector3<f64>, n: &Vector3<f64>) -> Self {
        let across = |v: Vector3<f64>| v - n * n.dot(&v);
        let (u, v) = (across(E - S), across(C - E));
        let theta = libm::atan2(n.dot(&u.cross(&v)), u.dot(&v));
        Self { p: C - S, lengths: [u.norm(), v.norm()], theta, offset: (C - S).dot(n) }
    }
}

/// A wrist whose singularity the spare joint can make up for: nᵀω = g_φ·φ̇ + (n·ŝ)·ψ̇ modulo the other rows, ψ the turn of the arm about ŝ = p/|p|.
///
/// s = g = √(g_φ² + (n·ŝ)²) ≥ 0, and the auxiliary rate is the one that is left, (g_φ·φ̇ + (n·ŝ)·ψ̇)/g. Two conditions must meet for s = 0, which a path
/// misses or passes at a distance: nothing is to be followed there, the rate is held.
fn aided_wrist<const N: usize>(at: &Posture<'_, N>, p: &Vector3<f64>) -> Singularity<N> {
    let alone = wrist::measure(at);
    let (axis, length) = (alone.axis(), p.norm().max(1e-9));
    let around = p / length;
    let aid = axis.dot(&around);
    let g = (alone.gain * alone.gain + aid * aid).sqrt().max(1e-12);
    // ψ̇ = ŝ·ω of the upper arm.
    let swivel = SVector::<f64, N>::from_fn(|i, _| if i < 3 { around.dot(&at.terms.z[i]) } else { 0.0 });
    let aux_row = (alone.aux_row * alone.gain + swivel * aid) / g;
    let gain_rate = (1.0 + alone.gain * alone.gain) * at.qdot[N - 2];
    let velocity = crate::linear::linear(&(at.at.J * at.qdot));
    let around_rate = (velocity - around * around.dot(&velocity)) / length;
    let aid_rate = at.terms.omega[N - 3].cross(&axis).dot(&around) + axis.dot(&around_rate);
    Singularity {
        class: Class::Mixed,
        s: g,
        s_rate: (alone.gain * gain_rate + aid * aid_rate) / g,
        gain: g,
        aux: 0.0,
        aux_rate: aux_row.dot(at.qdot),
        aux_bias: 0.0,
        aux_row,
        ..alone
    }
}

impl<const N: usize> ArmFamily<N> for SphericalShoulder {
    fn centre(&self, terms: &Terms<N>) -> Vector3<f64> {
        terms.p[N - 1] + terms.z[N - 1] * self.offset
    }

    fn measure(&mut self, posture: &Posture<'_, N>, out: &mut [Singularity<N>; MAX_SINGULARITIES]) -> usize {
        let bend = self.bend(posture.terms, &posture.at.p);
        out[0] = self.elbow(&bend, posture);
        out[1] = aided_wrist(posture, &bend.p);
        2
    }

    fn fold(&self, s: &Singularity<N>, at: &Situation<'_, N>) -> Option<Fold> {
        let bend = self.bend(at.terms, &at.at.p);
        Some(elbow::fold(s.aux, elbow::cosine(&self.S, at.desired, bend.lengths, bend.offset)))
    }
}
