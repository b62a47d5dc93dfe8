//! Arms of parallel axes (Universal Robots and its kin, six joints), by geometry: no length is declared, the axes identify the arm.
//!
//! Axes 2, 3, 4 are parallel along n, axis 1 meets axis 2 at a right angle, axis 5 is normal to n and meets axis 6 at a right angle in C. Joints 2
//! to 6 cannot move C along n, and joints 2 to 4 cannot turn the end-effector but about n, so
//!
//! det J = ±R·(L2 L3 sin θ)·(n×z5·z6)
//!
//! with R the in-plane distance of C from the waist axis, L2 and L3 the lengths of upper arm and forearm, θ the elbow angle from full stretch.

use super::axes::{EXACT, in_general_position, meeting, shoulder, unit};
use super::family::{Posture, Situation};
use super::parallel_axes_inverse::{PlanarArm, Plane};
use super::{elbow, waist, wrist};
use crate::linear::stack;
use crate::paper::reference::Memory;
use crate::paper::type_2::Direction;
use crate::types::{Class, Kind, Singularity};
use model::{Robot, Terms};
use nalgebra::{Matrix3, SVector, Vector3};
use shared_types::MAX_SINGULARITIES;

/// An arm of parallel axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParallelAxes;

impl ParallelAxes {
    /// Whether the axes of `robot` are those of one.
    #[must_use]
    pub fn are_of<const N: usize>(robot: &Robot) -> bool {
        let recognised = |terms: &Terms<N>| {
            let (offset, z, p) = (meeting(terms).0?, &terms.z, &terms.p);
            let parallel = |i: usize, j: usize| z[i].cross(&z[j]).norm() < EXACT;
            let normal = |i: usize, j: usize| z[i].dot(&z[j]).abs() < EXACT;
            let waist_meets_shoulder =
                normal(0, 1) && (shoulder(terms) - p[1]).cross(&z[1]).norm() < EXACT;
            let wrist = normal(4, 1) && normal(5, 4);
            (parallel(1, 2) && parallel(1, 3) && waist_meets_shoulder && wrist).then_some(offset)
        };
        let same = |one: &f64, two: &f64| (one - two).abs() < EXACT;
        N == 6 && in_general_position(robot, recognised, same).is_some()
    }

    /// Elbow: along the line from axis 2 to axis 4, ζᵀJ = −(L2 L3 sin θ/ρ)·θ̇ modulo the turn of link 4 and the motion along n. Type 1.
    fn elbow<const N: usize>(plane: &Plane, at: &Posture<'_, N>) -> Singularity<N> {
        let Plane {
            n,
            z1,
            x,
            upper,
            lower,
            signs,
            ..
        } = *plane;
        let line = upper + lower;
        let rho = line.norm().max(1e-9);
        let zeta = (z1 * line.x + x * line.y) / rho;
        let fold = upper.norm() * lower.norm() / rho;
        elbow::measure(
            (&zeta, &n),
            (plane.theta(), signs[1] * at.qdot[2]),
            fold,
            unit(2) * signs[1],
        )
    }

    /// Wrist: about m = n×z5 where z6 is parallel to n. With the turn about n kept, mᵀω = −(m·z6)/(n·z6)·φ̇ modulo the other rows. Type 2.
    fn wrist<const N: usize>(plane: &Plane, at: &Posture<'_, N>) -> Singularity<N> {
        let Plane { n, signs, .. } = *plane;
        let (z5, z6) = (at.terms.z[4], at.terms.z[5]);
        let m = n.cross(&z5);
        let (sin, cos) = (m.dot(&z6), n.dot(&z6));
        let turn = SVector::<f64, N>::from_fn(|i, _| {
            if (1..4).contains(&i) {
                signs[i - 1]
            } else {
                0.0
            }
        });
        Singularity {
            kind: Kind::Wrist,
            class: Class::Type2,
            angular: true,
            s: sin,
            s_rate: -cos * at.qdot[4],
            zeta_B: stack(&Vector3::zeros(), &m),
            R_BS: Matrix3::from_columns(&[m, n, z5]),
            gain: -sin
                / if cos.abs() > 0.1 {
                    cos
                } else {
                    0.1_f64.copysign(cos)
                },
            aux: turn.dot(at.q),
            aux_rate: turn.dot(at.qdot),
            aux_row: turn,
            kappa_2: 1.0,
            ..Singularity::none()
        }
    }

    /// det J = ±L2 L3 (L2 + L3)·s_elbow·s_wrist·s_overhead     [CK95 Eq. 1]
    pub(super) fn measure<const N: usize>(
        &self,
        posture: &Posture<'_, N>,
        out: &mut [Singularity<N>; MAX_SINGULARITIES],
    ) -> usize {
        let plane = Plane::new(posture.terms, &posture.at.p);
        out[0] = Self::elbow(&plane, posture);
        out[1] = Self::wrist(&plane, posture);
        out[2] = waist::measure(posture, 1..4, plane.upper.norm() + plane.lower.norm());
        3
    }

    /// cos θ that the desired pose needs, and its rate, 1/s.
    pub(super) fn elbow_cosine<const N: usize>(at: &Situation<'_, N>) -> [f64; 2] {
        PlanarArm::new(at.terms, &at.at.p).elbow_cosine(at)
    }

    /// The direction of ζ that the desired motion needs, at the wrist's singularity.
    pub(super) fn direction<const N: usize>(
        s: &Singularity<N>,
        at: &Situation<'_, N>,
        memory: &mut Memory,
    ) -> Direction {
        let z = &at.terms.z;
        let axes = wrist::Wrist {
            z4: z[1],
            z5: z[N - 2],
            z6: z[N - 1],
            z4_rate: (z[0] * at.qdot_planned[0]).cross(&z[1]),
            carried: 0.0,
            joints: (None, N - 1),
        };
        let arm = PlanarArm::new(at.terms, &at.at.p);
        wrist::direction(&axes, s, at, memory, |p, z6_d| arm.at(p).wrist_bend(z6_d))
    }
}
