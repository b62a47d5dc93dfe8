//! The analyzer's pure step: where the estimated posture is singular, or nearly.

use control::{Analyzer, SetupError, wire};
use model::{Model, Robot, joints};
use shared_types::scenario::Scenario;
use shared_types::{AnalyzerCheckpoint, SingularityReport, StateEstimate};

/// One arm's analysis, tick by tick.
#[derive(Clone, Debug)]
pub struct Cycle<const N: usize> {
    model: Model<N>,
    analyzer: Analyzer<N>,
    /// Whether the report has singular values, rank, condition, determinant and manipulability.
    with_conditioning: bool,
}

impl<const N: usize> Cycle<N> {
    /// An analyzer for `robot` with the scenario's end-effector frame and thresholds.
    ///
    /// # Errors
    /// [`SetupError`] where the robot does not have `N` joints, or no such frame.
    pub fn new(robot: &Robot, scenario: &Scenario) -> Result<Self, SetupError> {
        let frame = scenario.frame();
        Ok(Self { model: Model::new(robot, frame)?, analyzer: Analyzer::new(robot, &scenario.analysis), with_conditioning: true })
    }

    /// Leaves singular values, rank, condition, determinant and manipulability at zero in every report, which takes half the time: no law reads them.
    pub fn leave_out_conditioning(&mut self) {
        self.with_conditioning = false;
    }

    /// Writes what must survive a restart: all that the next [`step`](Self::step) depends on besides its input.
    pub fn save(&self, out: &mut AnalyzerCheckpoint) {
        self.analyzer.save(out);
    }

    /// Takes up what [`save`](Self::save) has written: the next step continues bit for bit.
    pub fn restore(&mut self, from: &AnalyzerCheckpoint) {
        self.analyzer.restore(from);
    }

    /// The report for an estimate, at its tick. No allocation.
    pub fn step(&mut self, estimate: &StateEstimate, out: &mut SingularityReport) {
        let (q, qdot) = (joints(&estimate.q), joints(&estimate.qdot));
        let terms = self.model.evaluate(&q, &qdot);
        let report = match self.with_conditioning {
            true => self.analyzer.step(&q, &qdot, &terms),
            false => self.analyzer.listed(&q, &qdot, &terms).0,
        };
        wire::report_message(estimate.header.tick, &report, out);
    }
}
