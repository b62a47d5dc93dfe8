//! The path that a scenario commands, as a judge follows it: from the scenario, the robot and the true posture alone.
//!
//! A controller says how far along the path it is, and nothing else that it says counts. The pose that belongs to that
//! time is computed here, and a goal that depends on a singular direction is settled at the true posture.

use crate::analyzer::Analyzer;
use crate::setup::{SetupError, start_posture};
use crate::trajectory::{Path, Progress};
use crate::types::Report;
use crate::{linear, served};
use model::{Model, Refused, Robot, joints};
use nalgebra::{SVector, Vector3, Vector6};
use shared_types::scenario::Scenario;
use shared_types::{PlantState, SingularityReport};

/// The commanded path of an arm of any number of joints.
pub trait CommandedPath: std::fmt::Debug {
    /// The place at which the path begins.
    fn start(&self) -> Progress;

    /// The time that the path takes by its own clock, s.
    fn duration_s(&self) -> f64;

    /// Moves on by `by_s` of the path's clock, s. A leg that begins takes its singular direction from the true posture;
    /// `reported` chooses between ζ and −ζ, which mean the same direction.
    ///
    /// Requires `by_s` finite and not negative · Cost that of the model's terms where a leg begins, else a few ns; no
    /// allocation
    fn advance(
        &mut self,
        place: &mut Progress,
        by_s: f64,
        truth: &PlantState,
        reported: &SingularityReport,
    );

    /// Position and orientation error of the true pose at a place, `[p_d − p; log(R_d Rᵀ)]`, on the axes that the task
    /// serves. Units m, rad; frame B.
    fn error(&self, place: &Progress, truth: &PlantState) -> Vector6<f64>;

    /// Whether a place is behind the last leg.
    fn is_over(&self, place: &Progress) -> bool;
}

/// The commanded path of a scenario that has one: a steered run follows targets instead.
///
/// # Errors
/// [`Refused`] where the scenario does not fit the robot.
pub fn commanded_path(
    robot: &Robot,
    scenario: &Scenario,
) -> Result<Option<Box<dyn CommandedPath>>, Refused> {
    if scenario.servo.is_some() {
        return Ok(None);
    }
    model::boxed!(robot, N => Commanded::<N>::new(robot, scenario), dyn CommandedPath).map(Some)
}

/// The path of one arm.
#[derive(Clone, Debug)]
struct Commanded<const N: usize> {
    model: Model<N>,
    analyzer: Analyzer<N>,
    path: Path,
    start: Progress,
    /// Of the posture in which the last leg began.
    report: Report<N>,
    task: [bool; 6],
}

impl<const N: usize> Commanded<N> {
    fn new(robot: &Robot, scenario: &Scenario) -> Result<Self, SetupError> {
        let (model, q) = (
            Model::new(robot, scenario.frame())?,
            start_posture(robot, scenario)?,
        );
        let rest = model.evaluate(&q, &SVector::zeros());
        let mut analyzer = Analyzer::new(robot, &scenario.analysis);
        let report = analyzer.step(&q, &SVector::zeros(), &rest);
        Ok(Self {
            path: Path::new(scenario, &report)?,
            start: Progress::at(rest.X_BE),
            report,
            analyzer,
            model,
            task: robot.task.0,
        })
    }

    /// Analyses the true posture; each ζ points as reported.
    fn analyse(&mut self, truth: &PlantState, reported: &SingularityReport) {
        let (q, qdot) = (joints(&truth.q), joints(&truth.qdot));
        let terms = self.model.evaluate(&q, &qdot);
        self.analyzer.step_into(&q, &qdot, &terms, &mut self.report);
        let listed = self.report.count;
        for (own, other) in self.report.singularities[..listed]
            .iter_mut()
            .zip(&reported.singularities)
        {
            if own.zeta_B.dot(&Vector6::from(other.zeta_B)) < 0.0 {
                own.zeta_B = -own.zeta_B;
            }
        }
    }
}

impl<const N: usize> CommandedPath for Commanded<N> {
    fn start(&self) -> Progress {
        self.start
    }

    fn duration_s(&self) -> f64 {
        self.path.duration_s()
    }

    fn advance(
        &mut self,
        place: &mut Progress,
        by_s: f64,
        truth: &PlantState,
        reported: &SingularityReport,
    ) {
        let begins =
            |leg: &crate::trajectory::Leg| !place.begun || place.time_s + by_s >= leg.duration_s;
        if self.path.leg(place.leg).is_some_and(begins) {
            self.analyse(truth, reported);
        }
        self.path.advance(place, by_s, &self.report);
    }

    fn error(&self, place: &Progress, truth: &PlantState) -> Vector6<f64> {
        let desired = self.path.place(place).moving(0.0, 0.0);
        let R = nalgebra::Matrix3::from_column_slice(&truth.R_BE);
        let free = served::free_axis(&self.task);
        let turn = served::rotation_error(&desired.R, &R, free.as_ref());
        let error = linear::stack(&(desired.p - Vector3::from(truth.p_BE)), &turn);
        // Times zero, not zero: a NaN stays one.
        Vector6::from_fn(|i, _| error[i] * if self.task[i] { 1.0 } else { 0.0 })
    }

    fn is_over(&self, place: &Progress) -> bool {
        self.path.leg(place.leg).is_none()
    }
}
