//! A PUMA's lengths, and its closed-form inverse kinematics along the path: where the first three joints and the wrist will have to be.

use super::axes::shoulder;
use super::wrist::PASS;
use crate::continuous::foresight::{Foreseen, Foresight};
use crate::linear::{wrap_angle, wrap_line};
use model::Terms;
use nalgebra::{Matrix3, SVector, Vector2, Vector3};

/// The lengths that the factors need, modified DH with Craig's zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PumaLengths {
    /// Upper arm, m.
    pub a2: f64,
    /// Forearm from elbow axis to wrist centre, √(a3² + d4²), m.
    pub L3: f64,
    /// q3 at full stretch, atan2(d4, a3), rad.
    pub q3_stretched: f64,
}

impl PumaLengths {
    /// From the DH lengths, m.
    #[must_use]
    pub fn new(a2: f64, a3: f64, d4: f64) -> Self {
        Self { a2, L3: (a3 * a3 + d4 * d4).sqrt(), q3_stretched: libm::atan2(d4, a3) }
    }

    /// Elbow angle from full stretch, (−π, π].
    #[must_use]
    pub fn theta(&self, q3: f64) -> f64 {
        wrap_angle(q3 - self.q3_stretched)
    }
}

/// In-plane radius below which the arm may come out on the other side of its waist axis, m.
const CROSSING: f64 = 0.03;

/// The first three joints' inverse kinematics, on the sides of shoulder and elbow where the arm is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Forearm {
    puma: PumaLengths,
    /// Base axes with the arm's plane as x, z2 as y and the waist axis as z: rows.
    axes: Matrix3<f64>,
    shoulder: Vector3<f64>,
    /// Distance of the arm's plane from the waist axis, m.
    offset: f64,
    /// Sides of shoulder and elbow, ±1.
    sides: [f64; 2],
}

/// The forearm at one place of the wrist centre.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed {
    /// Turn of the waist from where it is now, q2 and θ, rad.
    pub(super) angles: [f64; 3],
    /// In-plane radius, m.
    pub(super) R: f64,
    /// z4 and z2, base axes.
    axes: [Vector3<f64>; 2],
}

impl Forearm {
    pub(super) fn new<const N: usize>(puma: &PumaLengths, q: &SVector<f64, N>, terms: &Terms<N>, p_C: &Vector3<f64>) -> Self {
        let (z1, z2) = (terms.z[0], terms.z[1]);
        let x = z2.cross(&z1);
        let S = shoulder(terms);
        let p = p_C - S;
        let side = |positive: bool| if positive { 1.0 } else { -1.0 };
        let sides = [side(p.dot(&x) >= 0.0), side(puma.theta(q[2]) >= 0.0)];
        Self {
            puma: *puma,
            axes: Matrix3::from_rows(&[x.transpose(), z2.transpose(), z1.transpose()]),
            shoulder: S,
            offset: p.dot(&z2),
            sides,
        }
    }

    /// The forearm for a place of the wrist centre; a place beyond reach is moved to the boundary.
    pub(super) fn at(&self, p: &Vector3<f64>) -> Placed {
        let [a2, L3, d] = [self.puma.a2, self.puma.L3, self.offset];
        let p = self.axes * (p - self.shoulder);
        let r2 = p.x * p.x + p.y * p.y;
        let R = self.sides[0] * (r2 - d * d).max(0.0).sqrt();
        let turn = wrap_angle(libm::atan2(p.y, p.x) - libm::atan2(d, R));
        let cos = ((R * R + p.z * p.z - a2 * a2 - L3 * L3) / (2.0 * a2 * L3)).clamp(-1.0, 1.0);
        let theta = self.sides[1] * libm::acos(cos);
        let (K, M) = (a2 + L3 * cos, -L3 * self.sides[1] * (1.0 - cos * cos).sqrt());
        let q2 = libm::atan2(R * M - p.z * K, R * K + p.z * M);
        let (s23, c23) = libm::sincos(q2 + theta + self.puma.q3_stretched);
        let (s1, c1) = libm::sincos(turn);
        let to_base = self.axes.transpose();
        let axes = [to_base * Vector3::new(s23 * c1, s23 * s1, c23), to_base * Vector3::new(-s1, c1, 0.0)];
        Placed { angles: [turn, q2, theta], R, axes }
    }

    /// The same on the other side of the waist axis.
    fn other_side(&self) -> Self {
        Self { sides: [-self.sides[0], self.sides[1]], ..*self }
    }
}

impl Placed {
    /// w = z4×z6_d in the forearm's own axes z2 and z4×z2, where its direction is q4 but for a constant.
    pub(super) fn sees(&self, z6_d: &Vector3<f64>) -> Vector2<f64> {
        let [z4, z2] = self.axes;
        let w = z4.cross(z6_d);
        Vector2::new(w.dot(&z2), w.dot(&z4.cross(&z2)))
    }
}

/// Largest share of any rate that each stretch of the path ahead takes at full clock speed.
///
/// Rates of joints 1 to 4 between points of the path; near a singularity the auxiliary rate bounds the joint that is its coordinate.
pub(super) fn foresee<const N: usize>(puma: &PumaLengths, at: &Foresight<'_, N>, out: &mut Foreseen) {
    let mut forearm = Forearm::new(puma, at.q, at.terms, &at.p_C);
    let z6_E = at.terms.X_BE.R.transpose() * at.terms.z[5];
    let seen = |forearm: &Forearm, k: usize| {
        let X = at.poses[k];
        let placed = forearm.at(&X.p);
        (placed, placed.sees(&(X.R * z6_E)))
    };
    let (mut placed, mut w) = seen(&forearm, 0);
    for k in 1..at.poses.len() {
        let (mut next, mut next_w) = seen(&forearm, k);
        if placed.R.abs() < CROSSING {
            let other = forearm.other_side();
            let (there, there_w) = seen(&other, k);
            let jump = |p: &Placed| wrap_angle(p.angles[0] - placed.angles[0]).abs();
            if jump(&there) < jump(&next) {
                (forearm, next, next_w) = (other, there, there_w);
            }
        }
        let mut turn = libm::atan2(w.perp(&next_w), w.dot(&next_w));
        let side = next_w - w;
        let nearest = (w + side * (-w.dot(&side) / side.norm_squared().max(1e-18)).clamp(0.0, 1.0)).norm();
        if at.passing || nearest < PASS {
            turn = wrap_line(turn);
        }
        let sin_elbow = libm::sin(next.angles[2]);
        let near = [
            next.R.abs() < at.eta_out.overhead * (puma.a2 + puma.L3),
            false,
            sin_elbow.abs() < at.eta_out.elbow,
            nearest < at.eta_out.wrist,
        ];
        let caps = [at.rate_max.overhead, 0.0, at.rate_max.elbow, at.rate_max.wrist];
        let moved = [
            wrap_angle(next.angles[0] - placed.angles[0]),
            wrap_angle(next.angles[1] - placed.angles[1]),
            wrap_angle(next.angles[2] - placed.angles[2]),
            turn,
        ];
        for j in 0..4 {
            let limit = if near[j] { caps[j].min(at.velocity[j]) } else { at.velocity[j] };
            out.demand[k - 1] = out.demand[k - 1].max(moved[j].abs() / (at.step_s * limit));
        }
        (placed, w) = (next, next_w);
    }
}
