//! The analyzer's pure step: finds singularities at or near the estimated posture.

use control::{Analyzer, Report, SetupError, wire};
use model::{Model, Robot, Terms, joints};
use nalgebra::SVector;
use shared_types::scenario::Scenario;
use shared_types::{AnalyzerCheckpoint, SingularityReport, StateEstimate};

/// The pure step of an arm of any number of joints.
pub trait Step: Send + Sync {
    /// The report for an estimate, at its tick. No allocation.
    fn step(&mut self, estimate: &StateEstimate, out: &mut SingularityReport);
    /// The same, with its memory.
    fn copied(&self) -> Box<dyn Step>;
    /// Writes what must survive a restart: all that the next [`step`](Self::step) depends on besides its input.
    fn save(&self, out: &mut AnalyzerCheckpoint);
    /// Takes up what [`save`](Self::save) has written: the next step continues bit for bit.
    fn restore(&mut self, from: &AnalyzerCheckpoint);
}

/// One arm's analysis, tick by tick.
#[derive(Clone, Debug)]
pub struct Cycle<const N: usize> {
    model: Model<N>,
    analyzer: Analyzer<N>,
    /// For the last estimate that came without a matching one.
    terms: Terms<N>,
    /// For the last estimate.
    report: Report<N>,
}

impl<const N: usize> Cycle<N> {
    /// An analyzer for `robot` with the scenario's end-effector frame and thresholds.
    ///
    /// # Errors
    /// [`SetupError`] if the robot does not have `N` joints, or no such frame.
    pub fn new(robot: &Robot, scenario: &Scenario) -> Result<Self, SetupError> {
        let model = Model::new(robot, scenario.frame())?;
        let terms = model.evaluate(&SVector::zeros(), &SVector::zeros());
        let analyzer = Analyzer::new(robot, &scenario.analysis);
        Ok(Self {
            model,
            report: analyzer.unexamined(),
            analyzer,
            terms,
        })
    }

    /// The report for an estimate whose terms another step in this address space has computed, for the same arm and frame.
    pub fn analyse(
        &mut self,
        terms: &Terms<N>,
        estimate: &StateEstimate,
        out: &mut SingularityReport,
    ) -> &Report<N> {
        self.analyzer.step_into(
            &joints(&estimate.q),
            &joints(&estimate.qdot),
            terms,
            &mut self.report,
        );
        wire::report_message(estimate.header.tick, &self.report, out);
        &self.report
    }
}

impl<const N: usize> Step for Cycle<N> {
    fn copied(&self) -> Box<dyn Step> {
        Box::new(self.clone())
    }

    fn save(&self, out: &mut AnalyzerCheckpoint) {
        self.analyzer.save(out);
    }

    fn restore(&mut self, from: &AnalyzerCheckpoint) {
        self.analyzer.restore(from);
    }

    fn step(&mut self, estimate: &StateEstimate, out: &mut SingularityReport) {
        let (q, qdot) = (joints(&estimate.q), joints(&estimate.qdot));
        self.model.evaluate_into(&q, &qdot, &mut self.terms);
        self.analyzer
            .step_into(&q, &qdot, &self.terms, &mut self.report);
        wire::report_message(estimate.header.tick, &self.report, out);
    }
}
