//! The steps of the processes `analyzer` and `controller`, for an arm of any number of joints.

use std::sync::Arc;

use controller::{Commanded, Law, Read};
use model::{LastTerms, Refused, Robot, embedded};
use shared_types::scenario::Scenario;
use shared_types::{AnalyzerCheckpoint, ControllerCheckpoint, SingularityReport, StateEstimate};

/// The steps with what they remember.
pub(crate) trait Steps: Send + Sync {
    /// See [`analyzer::Cycle::analyse`].
    fn analyse(&mut self, estimate: &StateEstimate, report: &mut SingularityReport);
    /// See [`controller::Cycle::control`].
    fn control(&mut self, read: &Read<'_>, out: &mut Commanded<'_>);
    /// Begins with the arm at rest in another posture, one value per joint, rad: before the first tick. No allocation.
    fn begin(&mut self, q_start: &[f64]);
    /// The same, with what they remember.
    fn copied(&self) -> Box<dyn Steps>;
    /// Forgets what they remember. No allocation.
    fn reset(&mut self);
}

#[derive(Clone)]
struct Of<const N: usize> {
    look: LookOf<N>,
    controller: controller::Cycle<N>,
    law: Law<N>,
    /// The law's memory before the first tick.
    fresh: Arc<ControllerCheckpoint>,
}

/// Those of a robot before their first tick.
pub(crate) fn steps(robot: &Robot, scenario: &Scenario) -> Result<Box<dyn Steps>, Refused> {
    model::boxed!(robot, N => Of::<N>::new(robot, scenario), dyn Steps)
}

impl<const N: usize> Of<N> {
    fn new(robot: &Robot, scenario: &Scenario) -> Result<Self, Refused> {
        let look = LookOf::new(robot, scenario)?;
        let (controller, law) =
            controller::Cycle::new(robot, scenario).map_err(Refused::because)?;
        let mut fresh = ControllerCheckpoint::default();
        law.0.save(&mut fresh);
        Ok(Self {
            look,
            controller,
            law,
            fresh: Arc::new(fresh),
        })
    }
}

impl<const N: usize> Steps for Of<N> {
    fn analyse(&mut self, estimate: &StateEstimate, report: &mut SingularityReport) {
        self.look.analyse(estimate, report);
    }

    fn control(&mut self, read: &Read<'_>, out: &mut Commanded<'_>) {
        let last = &mut self.look.last;
        self.controller.control(&mut self.law, read, out, last);
    }

    fn begin(&mut self, q_start: &[f64]) {
        self.law.0.begin(embedded(q_start));
    }

    fn copied(&self) -> Box<dyn Steps> {
        Box::new(self.clone())
    }

    fn reset(&mut self) {
        self.look.reset();
        self.law.0.restore(&self.fresh);
    }
}

/// The step of the process `analyzer`, for postures by themselves.
pub(crate) trait Look: Send + Sync {
    /// The report of an estimate, as at the process's first tick. No allocation.
    fn report(&mut self, estimate: &StateEstimate, report: &mut SingularityReport);
    /// See `leave_far_unnamed` of the analyzer.
    fn leave_far_unnamed(&mut self);
    /// The same.
    fn copied(&self) -> Box<dyn Look>;
}

#[derive(Clone)]
struct LookOf<const N: usize> {
    analyzer: analyzer::Cycle<N>,
    analysis: analyzer::Analysis<N>,
    /// The analysis before the first tick.
    fresh: Arc<AnalyzerCheckpoint>,
    last: LastTerms<N>,
}

/// That of a robot.
pub(crate) fn look(robot: &Robot, scenario: &Scenario) -> Result<Box<dyn Look>, Refused> {
    model::boxed!(robot, N => LookOf::<N>::new(robot, scenario), dyn Look)
}

impl<const N: usize> LookOf<N> {
    fn new(robot: &Robot, scenario: &Scenario) -> Result<Self, Refused> {
        let (analyzer, analysis) =
            analyzer::Cycle::new(robot, scenario).map_err(Refused::because)?;
        let mut fresh = AnalyzerCheckpoint::default();
        analysis.0.save(&mut fresh);
        Ok(Self {
            last: LastTerms::of(analyzer.model()),
            analyzer,
            analysis,
            fresh: Arc::new(fresh),
        })
    }

    fn analyse(&mut self, estimate: &StateEstimate, report: &mut SingularityReport) {
        let last = &mut self.last;
        self.analyzer
            .analyse(&mut self.analysis, estimate, report, last);
    }

    fn reset(&mut self) {
        self.analysis.0.restore(&self.fresh);
    }
}

impl<const N: usize> Look for LookOf<N> {
    fn report(&mut self, estimate: &StateEstimate, report: &mut SingularityReport) {
        self.reset();
        self.analyse(estimate, report);
    }

    fn leave_far_unnamed(&mut self) {
        self.analysis.0.leave_far_unnamed();
    }

    fn copied(&self) -> Box<dyn Look> {
        Box::new(self.clone())
    }
}
