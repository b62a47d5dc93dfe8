//! Seven joints with a spherical shoulder and a spherical wrist (KUKA iiwa and its kin), by geometry.
//!
//! Axes 1, 2, 3 meet in S, axes 5, 6, 7 in C. Joints 1 to 3 move C on a sphere about S, so that pᵀJ = −L2 L3 sin θ·e4 exactly, with p = C − S: the
//! elbow has a formula, and codimension 1. With joint 4 in place of that direction the rest of J loses rank under two conditions at once:
//!
//! | set | name | lost |
//! |---|---|---|
//! | q2 = 0, q3 = ±90° | shoulder | a translation of C across p |
//! | q5 = ±90°, q6 = 0 | wrist | the rotation about z5×z6 |
//! | q2 = 0, q6 = 0 | wrist | the rotation about z5×z6, with C held |
//!
//! They are measured by vectors ([`lost`]).

use super::axes::{EXACT, in_general_position, meeting, three_meet, unit};
use super::elbow;
use super::family::{ArmFamily, Posture, Situation};
use super::lost::LostDirections;
use super::lost_geometry::Geometry;
use super::lost_reference;
use super::screws::Screws;
use crate::centre::AtCentre;
use crate::paper::reference::Memory;
use crate::paper::type_1::Fold;
use crate::paper::type_2::{Direction, TURNS};
use crate::types::{Kind, Singularity};
use model::{Model, Robot, Terms};
use nalgebra::{SVector, Vector3};
use shared_types::scenario::Analysis;
use shared_types::{AnalyzerCheckpoint, MAX_SINGULARITIES};

/// An arm with a spherical shoulder and a spherical wrist.
#[derive(Clone, Debug)]
pub struct SphericalShoulder<const N: usize> {
    geometry: Centres,
    lost: LostDirections<N>,
}

/// Where axes meet.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Centres {
    /// The shoulder's centre, base axes, m.
    S: Vector3<f64>,
    /// C on the last axis, from its origin, m.
    offset: f64,
}

impl Centres {
    fn at<const N: usize>(terms: &Terms<N>) -> Option<Self> {
        let (offset, spherical) = meeting(terms);
        let offset = offset.filter(|_| spherical)?;
        Some(Self {
            S: three_meet(terms, EXACT)?,
            offset,
        })
    }
}

impl<const N: usize> SphericalShoulder<N> {
    /// The family's arm, where the axes of `robot` are those of one.
    #[must_use]
    pub fn of(robot: &Robot, analysis: &Analysis) -> Option<Self> {
        if N != 7 {
            return None;
        }
        let same = |one: &Centres, two: &Centres| {
            (one.S - two.S).norm() < EXACT && (one.offset - two.offset).abs() < EXACT
        };
        let geometry = in_general_position(robot, Centres::at::<N>, same)?;
        let terms = Model::<N>::new(robot, None).ok()?.evaluate(
            &SVector::from_fn(|i, _| 0.3 + 0.37 * i as f64),
            &SVector::zeros(),
        );
        let C = terms.p[N - 1] + terms.z[N - 1] * geometry.offset;
        let at = AtCentre::new(&terms, &C, &Vector3::zeros());
        let names = [Kind::Wrist, Kind::Shoulder, Kind::Numeric];
        let lost = LostDirections::new(
            (&Screws(at.J), C - geometry.S),
            Geometry {
                S: Some(geometry.S),
                elbow_apart: true,
            },
            (robot.length_m, robot.task.0, robot.dof()),
            analysis,
            &names,
        );
        Some(Self { geometry, lost })
    }

    /// The shoulder's centre S, base axes, m.
    #[must_use]
    pub fn shoulder(&self) -> Vector3<f64> {
        self.geometry.S
    }

    /// Elbow: C cannot move along the line from S to it. Type 1.
    fn elbow(bend: &Elbow, at: &Posture<'_, N>) -> Singularity<N> {
        let length = bend.p.norm();
        let zeta = if length > 1e-9 {
            bend.p / length
        } else {
            at.terms.z[2]
        };
        let fold = bend.lengths[0] * bend.lengths[1] / length.max(1e-9);
        elbow::measure(
            (&zeta, &at.terms.z[3]),
            (bend.theta, at.qdot[3]),
            fold,
            unit(3),
        )
    }

    fn bend(&self, terms: &Terms<N>, p_C: &Vector3<f64>) -> Elbow {
        Elbow::new(&self.geometry.S, &terms.p[3], p_C, &terms.z[3])
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
        Self {
            p: C - S,
            lengths: [u.norm(), v.norm()],
            theta,
            offset: (C - S).dot(n),
        }
    }
}

impl<const N: usize> ArmFamily<N> for SphericalShoulder<N> {
    fn centre(&self, terms: &Terms<N>) -> Vector3<f64> {
        terms.p[N - 1] + terms.z[N - 1] * self.geometry.offset
    }

    fn measure(
        &mut self,
        posture: &Posture<'_, N>,
        out: &mut [Singularity<N>; MAX_SINGULARITIES],
    ) -> usize {
        let bend = self.bend(posture.terms, &posture.at.p);
        out[0] = Self::elbow(&bend, posture);
        1 + self.lost.measure(posture, &mut out[1..])
    }

    fn fold(&self, s: &Singularity<N>, at: &Situation<'_, N>) -> Option<Fold> {
        if s.kind != Kind::Elbow {
            return lost_reference::fold(s, at);
        }
        let bend = self.bend(at.terms, &at.at.p);
        Some(elbow::fold(
            s.aux,
            elbow::cosine(&self.geometry.S, at.desired, bend.lengths, bend.offset),
        ))
    }

    fn direction(
        &self,
        s: &Singularity<N>,
        at: &Situation<'_, N>,
        memory: &mut Memory,
    ) -> Option<Direction> {
        lost_reference::direction(s, at, memory)
    }

    fn turning(
        &self,
        s: &Singularity<N>,
        _terms: &Terms<N>,
        _p_BC: &Vector3<f64>,
        angle: f64,
    ) -> Option<SVector<f64, N>> {
        (s.kind != Kind::Elbow && s.kappa_2.abs() > TURNS).then(|| s.aux_row * (angle / s.kappa_2))
    }

    fn first_of_higher_codimension(&self) -> Option<usize> {
        Some(1)
    }

    fn save(&self, out: &mut AnalyzerCheckpoint) {
        self.lost.save(out);
    }

    fn restore(&mut self, from: &AnalyzerCheckpoint) {
        self.lost.restore(from);
    }
}
