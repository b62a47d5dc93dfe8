//! The three singularities of a PUMA, by formula.
//!
//! det J = a2·(d4 c3 − a3 s3)·R·s5 with R = a2 c2 + a3 c23 + d4 s23     [CK95 Eq. 1, factorised]
//!
//! With L3 = √(a3² + d4²) and θ the elbow angle from full stretch, d4 c3 − a3 s3 = −L3 sin θ. The three factors are the elbow's sin θ, the
//! overhead lock's R and the wrist's sin q5. Joints are numbered from 1 in the text and from 0 in the code.

use super::{Measures, Posture};
use crate::MAX_SINGULARITIES;
use crate::linear::{stack, wrap_angle};
use crate::types::{Class, Kind, Singularity};
use model::Terms;
use nalgebra::{Matrix3, SVector, Vector3};

/// The lengths that the factors need, modified DH with Craig's zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PumaFactors {
    /// Upper arm, m.
    pub a2: f64,
    /// Forearm from elbow axis to wrist centre, √(a3² + d4²), m.
    pub L3: f64,
    /// q3 at full stretch, atan2(d4, a3), rad.
    pub q3_stretched: f64,
}

impl PumaFactors {
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

    /// The shoulder's centre S, where the waist axis meets the shoulder axis: fixed in the base.
    #[must_use]
    pub fn shoulder<const N: usize>(terms: &Terms<N>) -> Vector3<f64> {
        terms.p[0] + terms.z[0] * (terms.p[1] - terms.p[0]).dot(&terms.z[0])
    }

    /// Elbow: the wrist centre can't move along the line from the shoulder's centre to it.
    ///
    /// ζ = p/|p| is orthogonal to both tangents z1×p and z2×p, because both axes pass through S. |p|² = a2² + L3² + 2 a2 L3 cos θ + d², so
    /// ζᵀJ = −(a2 L3 sin θ/|p|)·e3 exactly. Type 1: θ moves the wrist centre along ζ at second order.
    fn elbow<const N: usize>(&self, at: &Posture<'_, N>) -> Singularity<N> {
        let theta = self.theta(at.q[2]);
        let (sin, cos) = libm::sincos(theta);
        let p = at.at.p - Self::shoulder(at.terms);
        let length = p.norm();
        let zeta = if length > 1e-9 { p / length } else { at.terms.z[0] };
        let fold = self.a2 * self.L3 / length.max(1e-9);
        Singularity {
            kind: Kind::Elbow,
            class: Class::Type1,
            s: sin,
            s_rate: cos * at.qdot[2],
            zeta_B: stack(&zeta, &Vector3::zeros()),
            R_BS: frame(&zeta, &at.terms.z[1]),
            gain: -fold * sin,
            aux: theta,
            aux_rate: at.qdot[2],
            aux_row: unit(2),
            kappa_1: fold,
            ..Singularity::none()
        }
    }

    /// Wrist: the hand can't turn about n = z4×z5 when z6 is parallel to z4.
    ///
    /// z6 = c5 z4 + (n·z6) n, so with φ̇ = z4·ω₄ and the turn about z4 kept, nᵀω = −(n·z6/c5)·φ̇ modulo the other rows. Type 2: φ only turns ζ.
    fn wrist<const N: usize>(at: &Posture<'_, N>) -> Singularity<N> {
        let [z4, z5, z6] = [at.terms.z[3], at.terms.z[4], at.terms.z[5]];
        let n = z4.cross(&z5);
        let (sin, cos) = libm::sincos(at.q[4]);
        let c5 = if cos.abs() > 0.1 { cos } else { 0.1_f64.copysign(cos) };
        Singularity {
            kind: Kind::Wrist,
            class: Class::Type2,
            angular: true,
            s: sin,
            s_rate: cos * at.qdot[4],
            zeta_B: stack(&Vector3::zeros(), &n),
            R_BS: Matrix3::from_columns(&[n, z4, z5]),
            gain: -n.dot(&z6) / c5,
            aux: at.q[3],
            aux_rate: z4.dot(&at.terms.omega[3]),
            aux_bias: z4.dot(&at.terms.alpha_bias[3]),
            aux_row: SVector::from_fn(|i, _| if i < 4 { z4.dot(&at.terms.z[i]) } else { 0.0 }),
            kappa_2: 1.0,
            ..Singularity::none()
        }
    }

    /// Overhead: the wrist centre, above the waist axis, can't move along the normal z2 of the arm's plane.
    ///
    /// Joints 2 and 3 move it in the plane, so ζᵀJ = R·e1 exactly, R the wrist centre's in-plane distance from the waist axis. A shoulder
    /// offset makes it a one-sided fold: no wrist centre nearer than the offset to the waist axis can be reached.
    fn overhead<const N: usize>(&self, at: &Posture<'_, N>) -> Singularity<N> {
        let [z1, z2] = [at.terms.z[0], at.terms.z[1]];
        let x = z2.cross(&z1);
        let p = at.at.p - Self::shoulder(at.terms);
        let radius = p.dot(&x);
        let reach = self.a2 + self.L3;
        let in_plane = x.x * at.at.J[(0, 1)] + x.y * at.at.J[(1, 1)] + x.z * at.at.J[(2, 1)];
        let in_plane3 = x.x * at.at.J[(0, 2)] + x.y * at.at.J[(1, 2)] + x.z * at.at.J[(2, 2)];
        let offset = p.dot(&z2);
        Singularity {
            kind: Kind::Overhead,
            class: if offset.abs() > 1e-6 { Class::Mixed } else { Class::Type2 },
            s: radius / reach,
            s_rate: (in_plane * at.qdot[1] + in_plane3 * at.qdot[2]) / reach,
            zeta_B: stack(&z2, &Vector3::zeros()),
            R_BS: Matrix3::from_columns(&[z2, z1, x]),
            gain: radius,
            aux: at.q[0],
            aux_rate: at.qdot[0],
            aux_row: unit(0),
            kappa_1: offset.abs(),
            kappa_2: 1.0,
            ..Singularity::none()
        }
    }
}

impl<const N: usize> Measures<N> for PumaFactors {
    fn centre(&self, terms: &Terms<N>) -> Vector3<f64> {
        terms.p[4]
    }

    fn measure(&mut self, posture: &Posture<'_, N>, out: &mut [Singularity<N>; MAX_SINGULARITIES]) -> usize {
        out[0] = self.elbow(posture);
        out[1] = Self::wrist(posture);
        out[2] = self.overhead(posture);
        3
    }
}

/// A right-handed frame with x along `zeta` and y as near `towards` as it can be.
fn frame(zeta: &Vector3<f64>, towards: &Vector3<f64>) -> Matrix3<f64> {
    let y = towards - zeta * zeta.dot(towards);
    let y = if y.norm() > 1e-9 { y.normalize() } else { zeta.cross(&Vector3::x()).normalize() };
    Matrix3::from_columns(&[*zeta, y, zeta.cross(&y)])
}

fn unit<const N: usize>(i: usize) -> SVector<f64, N> {
    SVector::from_fn(|k, _| if k == i { 1.0 } else { 0.0 })
}
