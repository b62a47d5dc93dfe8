//! The analyzer's pure step: finds singularities at or near the estimated posture.

use control::{Analyzer, SetupError, wire};
use model::{LastTerms, Model, Robot, joints};
use process::{Damaged, Flow, Inputs, Outputs, Port, Process, Snapshot};
use shared_types::scenario::Scenario;
use shared_types::{AnalyzerCheckpoint, SingularityReport, StateEstimate};

/// One arm's analysis, tick by tick.
#[derive(Clone, Debug)]
pub struct Cycle<const N: usize> {
    model: Model<N>,
}

/// The analysis with what it remembers.
#[derive(Clone, Debug)]
pub struct Analysis<const N: usize>(pub Analyzer<N>);

impl<const N: usize> Cycle<N> {
    /// An analyzer for `robot` with the scenario's end-effector frame and thresholds, before its first tick.
    ///
    /// # Errors
    /// [`SetupError`] if the robot does not have `N` joints, or no such frame.
    pub fn new(robot: &Robot, scenario: &Scenario) -> Result<(Self, Analysis<N>), SetupError> {
        let cycle = Self {
            model: Model::new(robot, scenario.frame())?,
        };
        let analysis = Analysis(Analyzer::new(robot, &scenario.analysis));
        Ok((cycle, analysis))
    }

    /// The arm's model at the end-effector frame.
    pub fn model(&self) -> &Model<N> {
        &self.model
    }

    /// The report for an estimate, at its tick. `last` has the model's terms of it, afterwards.
    pub fn analyse(
        &self,
        Analysis(analyzer): &mut Analysis<N>,
        estimate: &StateEstimate,
        out: &mut SingularityReport,
        last: &mut LastTerms<N>,
    ) {
        let (q, qdot) = (joints(&estimate.q), joints(&estimate.qdot));
        let report = analyzer.step(&q, &qdot, last.at(&self.model, &q, &qdot));
        wire::report_message(estimate.header.tick, &report, out);
    }
}

impl<const N: usize> Snapshot for Analysis<N> {
    fn layout(&self) -> u64 {
        AnalyzerCheckpoint::default().layout()
    }

    fn write(&self, out: &mut Vec<u8>) {
        let mut checkpoint = AnalyzerCheckpoint::default();
        self.0.save(&mut checkpoint);
        checkpoint.write(out)
    }

    fn read(&mut self, from: &[u8]) -> Result<(), Damaged> {
        let mut checkpoint = AnalyzerCheckpoint::default();
        checkpoint.read(from)?;
        self.0.restore(&checkpoint);
        Ok(())
    }
}

impl<const N: usize> Process for Cycle<N> {
    type State = Analysis<N>;
    const READS: &'static [Port] = &[Port::of::<StateEstimate>()];
    const WRITES: &'static [Port] = &[Port::of::<SingularityReport>()];

    fn step(
        &self,
        analysis: &mut Analysis<N>,
        inputs: &Inputs<'_>,
        outputs: &mut Outputs<'_>,
    ) -> Flow {
        if let (Some(estimate), Some(out)) = (inputs.get(), outputs.place()) {
            let last = outputs.scratch.of(|| LastTerms::of(&self.model));
            self.analyse(analysis, estimate, out, last);
        }
        Flow::Go
    }
}
