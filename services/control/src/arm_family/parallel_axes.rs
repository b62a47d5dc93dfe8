//! Arms of parallel axes (Universal Robots and its kin, six joints), by geometry: no length is declared, the axes identify the arm.
//!
//! Axes 2, 3, 4 are parallel along n, axis 1 meets axis 2 at a right angle, axis 5 is normal to n and meets axis 6 at a right angle in C. Joints 2
//! to 6 cannot move C along n, and joints 2 to 4 cannot turn the end-effector but about n, so
//!
//! det J = ±R·(L2 L3 sin θ)·(n×z5·z6)
//!
//! with R the in-plane distance of C from the waist axis, L2 and L3 the lengths of upper arm and forearm, θ the elbow angle from full stretch.

use super::axes::{EXACT, in_general_position, meeting, shoulder, unit};
use super::family::{ArmFamily, Posture, Situation};
use super::parallel_axes_inverse::{PlanarArm, Plane, foresee, turned};
use super::{elbow, waist, wrist};
use crate::continuous::foresight::{Foreseen, Foresight};
use crate::linear::{rotation_exp, stack, wrap_angle};
use crate::paper::reference::Memory;
use crate::paper::type_1::Fold;
use crate::paper::type_2::Direction;
use crate::types::{Class, Kind, Singularity};
use model::{Robot, Terms};
use nalgebra::{Matrix3, SVector, Vector2, Vector3};
use shared_types::MAX_SINGULARITIES;

/// An arm of parallel axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParallelAxes {
    /// C on the last axis, from its origin, m.
    offset: f64,
}

impl ParallelAxes {
    /// The family's arm, where the axes of `robot` are those of one.
    #[must_use]
    pub fn of<const N: usize>(robot: &Robot) -> Option<Self> {
        if N != 6 {
            return None;
        }
        in_general_position(robot, Self::at::<N>, |one, two| {
            (one.offset - two.offset).abs() < EXACT
        })
    }

    fn at<const N: usize>(terms: &Terms<N>) -> Option<Self> {
        let (offset, z, p) = (meeting(terms).0?, &terms.z, &terms.p);
        let parallel = |i: usize, j: usize| z[i].cross(&z[j]).norm() < EXACT;
        let normal = |i: usize, j: usize| z[i].dot(&z[j]).abs() < EXACT;
        let waist_meets_shoulder =
            normal(0, 1) && (shoulder(terms) - p[1]).cross(&z[1]).norm() < EXACT;
        let wrist = normal(4, 1) && normal(5, 4);
        (parallel(1, 2) && parallel(1, 3) && waist_meets_shoulder && wrist)
            .then_some(Self { offset })
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
}

impl<const N: usize> ArmFamily<N> for ParallelAxes {
    fn centre(&self, terms: &Terms<N>) -> Vector3<f64> {
        terms.p[N - 1] + terms.z[N - 1] * self.offset
    }

    /// det J = ±L2 L3 (L2 + L3)·s_elbow·s_wrist·s_overhead     [CK95 Eq. 1]
    fn measure(
        &mut self,
        posture: &Posture<'_, N>,
        out: &mut [Singularity<N>; MAX_SINGULARITIES],
    ) -> usize {
        let plane = Plane::new(posture.terms, &posture.at.p);
        out[0] = Self::elbow(&plane, posture);
        out[1] = Self::wrist(&plane, posture);
        out[2] = waist::measure(posture, 1..4, plane.upper.norm() + plane.lower.norm());
        3
    }

    fn fold(&self, s: &Singularity<N>, at: &Situation<'_, N>) -> Option<Fold> {
        Some(elbow::fold(
            s.aux,
            PlanarArm::new(at.terms, &at.at.p).elbow_cosine(at),
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
                let z = &at.terms.z;
                let (n, n_rate) = (z[1], (z[0] * at.qdot_planned[0]).cross(&z[1]));
                let axes = wrist::Wrist {
                    z4: n,
                    z5: z[N - 2],
                    z6: z[N - 1],
                    z4_rate: n_rate,
                    carried: 0.0,
                    joints: (None, N - 1),
                };
                let arm = PlanarArm::new(at.terms, &at.at.p);
                wrist::direction(&axes, s, at, memory, |p, z6_d| arm.at(p).wrist_bend(z6_d))
            }
        })
    }

    fn turning(
        &self,
        s: &Singularity<N>,
        terms: &Terms<N>,
        p_BC: &Vector3<f64>,
        angle: f64,
    ) -> Option<SVector<f64, N>> {
        let kind = s.kind;
        if kind == Kind::Elbow {
            return None;
        }
        let arm = PlanarArm::new(terms, p_BC);
        let plane = arm.plane;
        let along = if plane.n.dot(&terms.z[5]) < 0.0 {
            -1.0
        } else {
            1.0
        };
        let mut by = SVector::zeros();
        let z5 = if kind == Kind::Wrist {
            by[5] = -angle * along;
            turned(&plane.z5, angle)
        } else {
            // The arm's plane turns about the waist axis, C on it; axis 5 stays normal to n and z6.
            let turn = rotation_exp(&(plane.z1 * angle));
            let (n, x) = (turn * plane.n, turn * plane.x);
            let m = n.cross(&terms.z[5]);
            let bend = |n: &Vector3<f64>, z5: &Vector3<f64>| {
                libm::atan2(n.cross(z5).dot(&terms.z[5]), n.dot(&terms.z[5]))
            };
            let side = if bend(&plane.n, &terms.z[4]) < 0.0 {
                1.0
            } else {
                -1.0
            };
            let z5 = if m.norm() > 1e-6 {
                m.normalize() * side
            } else {
                turn * terms.z[4]
            };
            by[0] = angle;
            by[4] = -wrap_angle(bend(&n, &z5) - bend(&plane.n, &terms.z[4]));
            by[5] = -libm::atan2(terms.z[5].dot(&terms.z[4].cross(&z5)), terms.z[4].dot(&z5));
            Vector2::new(z5.dot(&plane.z1), z5.dot(&x))
        };
        let new = arm.solve(&plane.C, &z5)?;
        let old = [
            libm::atan2(plane.upper.y, plane.upper.x),
            plane.theta(),
            libm::atan2(plane.z5.y, plane.z5.x),
        ];
        let link_4 = if kind == Kind::Wrist {
            angle
        } else {
            wrap_angle(new[2] - old[2])
        };
        let (upper, theta) = (wrap_angle(new[0] - old[0]), wrap_angle(new[1] - old[1]));
        by[1] = upper * plane.signs[0];
        by[2] = theta * plane.signs[1];
        by[3] = (link_4 - upper - theta) * plane.signs[2];
        Some(by)
    }

    fn foresee(&self, at: &Foresight<'_, N>, out: &mut Foreseen) {
        foresee(at, out);
    }
}
