//! The three factors of det J of an arm whose axes 2 and 3 are parallel: waist, elbow and wrist, by the geometry of its axes. No length is declared.
//!
//! n is the direction of axis 2, and axis 1 is normal to it. Axes 5 and 6 meet in C, and are normal to each other. Of the wrist there are two kinds:
//!
//! - spherical, as of most arms with six joints: axis 4 passes through C, too. The forearm ends in W = C, and w is axis 4.
//! - parallel, as of Universal Robots': axis 4 is parallel to n. The forearm ends in W on axis 4, and w = n.
//!
//! Only joint 1 moves C along n, by R. In the plane normal to n joints 2 and 3 move W by the two lengths of the arm. Only joint 6 turns the hand about
//! ζ = w×z5 where the rest of its turn is kept. J is block triangular, so with L2, L3 and θ the lengths and the elbow angle from full stretch
//!
//! det J = ±R·(L2 L3 sin θ)·(ζ·z6)
//!
//! Joints are numbered from 1 in the text and from 0 in the code.

use super::axes::{ROUNDED, frame, in_general_position, meeting, shoulder};
use super::elbow::{self, Bend};
use super::family::Posture;
use crate::linear::{Joints, Matrix3, Vector3, Vector6, linear, sign, stack, unit};
use crate::types::{Class, Kind, Singularity};
use model::{Robot, Terms};
use shared_types::MAX_SINGULARITIES;
use std::f64::consts::FRAC_PI_2;

/// Shortest upper arm or forearm that has an elbow, m.
const SHORTEST: f64 = 1e-3;

/// An arm with these factors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Factors {
    /// Whether axes 4 to 6 meet.
    is_spherical: bool,
    /// Whether axis 1 meets axis 2 and axes 4 to 6 meet: joints 1 and 2 then move C on a sphere.
    moves_on_a_sphere: bool,
}

impl Factors {
    /// The factors of `robot`; `None` where its axes have another geometry.
    pub(super) fn of<const N: usize>(robot: &Robot) -> Option<Self> {
        let recognised = |terms: &Terms<N>| {
            let (z, p) = (&terms.z, &terms.p);
            let parallel = |i: usize, j: usize| z[i].cross(&z[j]).norm() < ROUNDED;
            let normal = |i: usize, j: usize| z[i].dot(&z[j]).abs() < ROUNDED;
            let (offset, is_spherical) = meeting(terms, ROUNDED);
            let C = p[5] + z[5] * offset?;
            let meets = (shoulder(terms) - p[1]).cross(&z[1]).norm() < ROUNDED;
            let found = Self {
                is_spherical,
                moves_on_a_sphere: is_spherical && meets,
            };
            let plane = Plane::of(found, terms, &C);
            let has_elbow = plane.bend.lengths.iter().all(|length| *length > SHORTEST);
            let has_wrist = is_spherical || parallel(1, 3);
            let w = if is_spherical { 3 } else { 1 };
            let is_square = normal(0, 1) && normal(w, 4) && normal(4, 5);
            (parallel(1, 2) && has_wrist && is_square && has_elbow).then_some(found)
        };
        if N != 6 || robot.dof() != 6 {
            return None;
        }
        in_general_position(robot, recognised, PartialEq::eq)
    }

    /// Elbow, wrist and overhead singularity, in this order; returns how many.
    ///
    /// det J = ±L2 L3 (L2 + L3)·s_elbow·s_wrist·s_overhead     [CK95 Eq. 1]
    pub(super) fn measure<const N: usize>(
        self,
        at: &Posture<'_, N>,
        out: &mut [Singularity<N>; MAX_SINGULARITIES],
    ) -> usize {
        let plane = Plane::of(self, at.terms, &at.at.p);
        out[0] = if plane.bend.theta.abs() < FRAC_PI_2 {
            self.elbow(&plane, at)
        } else {
            folded(&plane, at)
        };
        out[1] = self.wrist(at);
        out[2] = overhead(&plane, at);
        3
    }

    /// Elbow: W cannot move along the line ζ from axis 2 to it, ζᵀJ = −(L2 L3 sin θ/ρ)·θ̇ modulo the motion along n and the turn of link 4. Type 1.
    ///
    /// If C moves on a sphere, ζ points from its centre to C, and ζᵀJ = −(L2 L3 sin θ/ρ)·θ̇ exactly.
    fn elbow<const N: usize>(self, plane: &Plane, at: &Posture<'_, N>) -> Singularity<N> {
        let line = if self.moves_on_a_sphere {
            plane.C
        } else {
            plane.bend.upper + plane.bend.forearm
        };
        let (rho, [L2, L3]) = (line.norm(), plane.bend.lengths);
        let zeta = if rho > 1e-9 {
            line / rho
        } else {
            at.terms.z[0]
        };
        elbow::measure(
            (&zeta, &plane.n),
            (plane.bend.theta, plane.side * at.qdot[2]),
            L2 * L3 / rho.max(1e-9),
            unit(2) * plane.side,
        )
    }

    /// Wrist: the hand cannot turn about ζ = w×z5 where z6 is parallel to w. Type 2.
    ///
    /// φ̇ is the turn of link 4 about w. With the turn about w kept, ζᵀω = −(ζ·z6/w·z6)·φ̇ modulo the other rows: φ only turns ζ.
    fn wrist<const N: usize>(self, at: &Posture<'_, N>) -> Singularity<N> {
        let z = &at.terms.z;
        let w = if self.is_spherical { z[3] } else { z[1] };
        let zeta = w.cross(&z[4]);
        let (sin, cos) = (-zeta.dot(&z[5]), w.dot(&z[5]));
        let aux_row = Joints::<N>::from_fn(|i, _| if i < 4 { w.dot(&z[i]) } else { 0.0 });
        Singularity {
            kind: Kind::Wrist,
            class: Class::Type2,
            angular: true,
            s: sin,
            s_rate: cos * at.qdot[4],
            zeta_B: stack(&Vector3::zeros(), &zeta),
            R_BS: Matrix3::from_columns(&[zeta, w, z[4]]),
            gain: sin
                / if cos.abs() > 0.1 {
                    cos
                } else {
                    0.1_f64.copysign(cos)
                },
            // Of a spherical wrist φ is no function of the posture; joint 4 counts it near the singularity.
            aux: if self.is_spherical {
                at.q[3]
            } else {
                aux_row.dot(at.q)
            },
            aux_rate: aux_row.dot(at.qdot),
            aux_bias: w.dot(&at.terms.alpha_bias[3]),
            aux_row,
            kappa_2: 1.0,
            ..Singularity::none()
        }
    }
}

/// The elbow folded back: W cannot move along the forearm's line, and joint 2, not the elbow, moves most. ζᵀJ = ±L2 sin θ·e2 modulo the motion along n
/// and the turn of link 4.
///
/// The self-motion turns joint 3 by L2/L3 − 1 against joint 2. So ζ turns, and where the lengths differ W goes along it at second order: one-sided, ζ
/// pointing to axis 2, from which W keeps its distance. The coordinate changes where |θ| is a right angle, far from either lock.
fn folded<const N: usize>(plane: &Plane, at: &Posture<'_, N>) -> Singularity<N> {
    let [L2, L3] = plane.bend.lengths;
    let outwards = sign(L2 > L3);
    let zeta = plane.bend.forearm * (outwards / L3);
    let (sin, cos) = libm::sincos(plane.bend.theta);
    let kappa_1 = L2 * (L3 - L2).abs() / L3;
    Singularity {
        kind: Kind::Elbow,
        class: if kappa_1 > ROUNDED {
            Class::Mixed
        } else {
            Class::Type2
        },
        s: sin,
        s_rate: cos * plane.side * at.qdot[2],
        zeta_B: stack(&zeta, &Vector3::zeros()),
        R_BS: frame(&zeta, &plane.n),
        gain: outwards * L2 * sin,
        aux: at.q[1],
        aux_rate: at.qdot[1],
        aux_row: unit(1),
        kappa_1,
        kappa_2: L2 / L3,
        ..Singularity::none()
    }
}

/// Overhead: C, above the waist axis, cannot move along n. ζ = ±n, ζᵀJ = ±R·e1 exactly, s = R/(L2 + L3).
///
/// Type 2; where C is off the plane of axis 1 and n, one-sided: no C nearer to the waist axis than that can be reached, and ζ points to it.
fn overhead<const N: usize>(plane: &Plane, at: &Posture<'_, N>) -> Singularity<N> {
    let Plane { n, x, C, .. } = *plane;
    let (radius, offset, reach) = (
        C.dot(&x),
        C.dot(&n),
        plane.bend.lengths[0] + plane.bend.lengths[1],
    );
    // Out of reach: towards the waist axis.
    let outwards = sign(offset < ROUNDED);
    let in_plane = |j: usize| x.dot(&linear(&Vector6::from(at.at.J.column(j)))) * at.qdot[j];
    let rate: f64 = (1..4).map(in_plane).sum();
    Singularity {
        kind: Kind::Overhead,
        class: if offset.abs() > ROUNDED {
            Class::Mixed
        } else {
            Class::Type2
        },
        s: radius / reach,
        s_rate: rate / reach,
        zeta_B: stack(&(n * outwards), &Vector3::zeros()),
        R_BS: Matrix3::from_columns(&[n * outwards, plane.z1, x * outwards]),
        gain: radius * outwards,
        aux: at.q[0],
        aux_rate: at.qdot[0],
        aux_row: unit(0),
        kappa_1: offset.abs(),
        kappa_2: 1.0,
        ..Singularity::none()
    }
}

/// The arm in one posture, seen along n.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Plane {
    n: Vector3,
    z1: Vector3,
    /// n×z1.
    x: Vector3,
    /// C from the point of axis 1 that is nearest to axis 2, m.
    C: Vector3,
    /// The elbow between axis 2, axis 3 and W.
    bend: Bend,
    /// 1 where joint 3 turns as θ does, −1 where it turns against it.
    side: f64,
}

impl Plane {
    fn of<const N: usize>(factors: Factors, terms: &Terms<N>, C: &Vector3) -> Self {
        let (p, z1, n) = (&terms.p, terms.z[0], terms.z[1]);
        let W = if factors.is_spherical { *C } else { p[3] };
        Self {
            n,
            z1,
            x: n.cross(&z1),
            C: C - shoulder(terms),
            bend: Bend::new(p[2] - p[1], W - p[2], &n),
            side: sign(terms.z[2].dot(&n) >= 0.0),
        }
    }
}
