//! An arm with more joints than task axes, by number: its lost directions, named where its first three axes meet in a shoulder (Franka Emika Panda,
//! FR3, xArm 7 and their kin).

use super::axes::{EXACT, meeting, three_meet};
use super::family::{ArmFamily, Posture, Situation};
use super::lost::{FOLLOWED, LostDirections};
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

/// An arm with spare joints, without formulas.
#[derive(Clone, Debug)]
pub struct Redundant<const N: usize> {
    /// C on the last axis, from its origin, m; `None`: C is E.
    offset: Option<f64>,
    lost: LostDirections<N>,
}

impl<const N: usize> Redundant<N> {
    /// The family of `robot`, where it has more joints than task axes.
    #[must_use]
    pub fn new(robot: &Robot, analysis: &Analysis) -> Option<Self> {
        let rows = robot.task.count();
        if rows == 0 || rows >= robot.dof() {
            return None;
        }
        let model = Model::<N>::new(robot, None).ok()?;
        // Any posture without parallel axes.
        let terms = model.evaluate(
            &SVector::from_fn(|i, _| 0.3 + 0.37 * i as f64),
            &SVector::zeros(),
        );
        let (offset, _) = meeting(&terms);
        // C's position must not depend on a rotation that the task does not serve: only E itself may then be moved.
        let offset = offset.filter(|_| robot.task.0[3..].iter().all(|served| *served));
        let S = (N == 7 && robot.task.is_full())
            .then(|| three_meet(&terms, EXACT))
            .flatten();
        let C = centre(offset, &terms);
        let names = [Kind::Elbow, Kind::Wrist, Kind::Shoulder, Kind::Numeric];
        let names = if S.is_some() {
            &names[..]
        } else {
            &[Kind::Numeric; FOLLOWED][..rows.min(FOLLOWED)]
        };
        let at = AtCentre::new(&terms, &C, &Vector3::zeros());
        let from = (&Screws(at.J), C - S.unwrap_or_default());
        let scale = (robot.length_m, robot.task.0, robot.dof());
        Some(Self {
            offset,
            lost: LostDirections::new(
                from,
                Geometry {
                    S,
                    elbow_apart: false,
                },
                scale,
                analysis,
                names,
            ),
        })
    }
}

fn centre<const N: usize>(offset: Option<f64>, terms: &Terms<N>) -> Vector3<f64> {
    offset.map_or(terms.X_BE.p, |offset| {
        terms.p[N - 1] + terms.z[N - 1] * offset
    })
}

impl<const N: usize> ArmFamily<N> for Redundant<N> {
    fn centre(&self, terms: &Terms<N>) -> Vector3<f64> {
        centre(self.offset, terms)
    }

    fn measure(
        &mut self,
        posture: &Posture<'_, N>,
        out: &mut [Singularity<N>; MAX_SINGULARITIES],
    ) -> usize {
        self.lost.measure(posture, out)
    }

    fn fold(&self, s: &Singularity<N>, at: &Situation<'_, N>) -> Option<Fold> {
        lost_reference::fold(s, at)
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
        (s.kappa_2.abs() > TURNS).then(|| s.aux_row * (angle / s.kappa_2))
    }

    fn first_of_higher_codimension(&self) -> Option<usize> {
        Some(0)
    }

    fn save(&self, out: &mut AnalyzerCheckpoint) {
        self.lost.save(out);
    }

    fn restore(&mut self, from: &AnalyzerCheckpoint) {
        self.lost.restore(from);
    }
}
