//! Shared by tests: arms, random postures, and a step of exact dynamics.

use crate::centre::AtCentre;
use crate::controller::Controller;
use crate::linear::{Joints, Vector6};
use crate::setup::start_posture;
use crate::singularity::analyzer::Analyzer;
use crate::tick::{Inputs, Now};
use crate::types::{Command, Report};
use model::{Factors, Model, Robot};
use proptest::prelude::*;
use shared_types::TargetContent;
use shared_types::scenario::{Analysis, Scenario};
use std::collections::BTreeMap;
use std::sync::OnceLock;

/// An arm that stands in a posture, as a tick sees it.
pub(crate) fn standing<T>(name: &str, q: [f64; 6], seen: impl FnOnce(&Now<'_, 6>) -> T) -> T {
    let (robot, q, zero) = (robot(name), Joints::from(q), Joints::zeros());
    let terms = Model::new(robot, None).unwrap().evaluate(&q, &zero);
    let report = Analyzer::new(robot, &Analysis::default()).step(&q, &zero, &terms);
    seen(&Now {
        q: &q,
        qdot: &zero,
        tau_disturbance: &zero,
        wrist: None,
        report: &report,
        terms: &terms,
        at: &AtCentre::new(&terms, &report.p_BC),
        p_EC: &(terms.X_BE.R.transpose() * (report.p_BC - terms.X_BE.p)),
    })
}

/// A built-in robot.
pub(crate) fn robot(name: &str) -> &'static Robot {
    static ROBOTS: OnceLock<BTreeMap<&'static str, Robot>> = OnceLock::new();
    let names = [
        "puma560",
        "puma560-ideal",
        "planar2r",
        "planar3r",
        "iiwa14",
        "ur5",
        "panda",
    ];
    &ROBOTS.get_or_init(|| {
        names
            .into_iter()
            .map(|name| (name, Robot::builtin(name).unwrap()))
            .collect()
    })[name]
}

/// Upper arm and forearm of a PUMA, m, and q3 at full stretch, rad.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PumaLengths {
    pub(crate) a2: f64,
    pub(crate) L3: f64,
    pub(crate) q3_stretched: f64,
}

impl PumaLengths {
    /// q2 that puts the wrist centre above the waist axis, rad: R = c2·K + s2·M = 0 at atan2(−K, M).
    pub(crate) fn overhead(&self, q3: f64) -> f64 {
        let (sin, cos) = libm::sincos(q3 - self.q3_stretched);
        libm::atan2(-(self.a2 + self.L3 * cos), -self.L3 * sin)
    }
}

/// The lengths of a built-in PUMA.
pub(crate) fn puma_lengths(name: &str) -> PumaLengths {
    let Factors::Puma { a2, a3, d4 } = robot(name).factors else {
        panic!("{name} has the factors of a PUMA")
    };
    PumaLengths {
        a2,
        L3: a3.hypot(d4),
        q3_stretched: libm::atan2(d4, a3),
    }
}

pub(crate) fn puma() -> &'static Model<6> {
    static MODEL: OnceLock<Model<6>> = OnceLock::new();
    MODEL.get_or_init(|| Model::new(robot("puma560"), None).unwrap())
}

pub(crate) fn three_r() -> &'static Model<3> {
    static MODEL: OnceLock<Model<3>> = OnceLock::new();
    MODEL.get_or_init(|| Model::new(robot("planar3r"), None).unwrap())
}

/// Any posture within the limits (within a turn where there are none).
pub(crate) fn posture<const N: usize>(model: &Model<N>) -> impl Strategy<Value = Joints<N>> {
    let (lower, upper) = (*model.lower(), *model.upper());
    prop::collection::vec(0.0..1.0_f64, N).prop_map(move |x| {
        Joints::from_fn(|i, _| lower[i].max(-3.2) + x[i] * (upper[i].min(3.2) - lower[i].max(-3.2)))
    })
}

/// A report of an arm that is nowhere singular.
pub(crate) fn empty_report<const N: usize>() -> Report<N> {
    Report::unexamined(1.0)
}

/// A scenario file of the product.
pub(crate) fn scenario(text: &str, settings: &[&str]) -> Scenario {
    let settings: Vec<String> = settings.iter().map(|s| (*s).to_owned()).collect();
    Scenario::parse("test.toml", text, &settings).unwrap()
}

/// An arm under the law, at rest in the start posture of its scenario.
#[derive(Clone)]
pub(crate) struct Bench<const N: usize> {
    pub(crate) model: Model<N>,
    pub(crate) analyzer: Analyzer<N>,
    pub(crate) controller: Controller<N>,
    /// The last one.
    pub(crate) report: Report<N>,
    pub(crate) q: Joints<N>,
    pub(crate) qdot: Joints<N>,
    pub(crate) tick: u64,
    dt: f64,
}

impl<const N: usize> Bench<N> {
    pub(crate) fn new(text: &str) -> Self {
        Self::of(&scenario(text, &[]))
    }

    pub(crate) fn of(scenario: &Scenario) -> Self {
        let robot = Robot::builtin(&scenario.robot).unwrap();
        let model = Model::new(&robot, scenario.frame()).unwrap();
        let q = start_posture(&robot, scenario).unwrap();
        Self {
            controller: Controller::new(model.clone(), &robot, scenario, q).unwrap(),
            analyzer: Analyzer::new(&robot, &scenario.analysis),
            report: empty_report(),
            model,
            q,
            qdot: Joints::zeros(),
            tick: 0,
            dt: scenario.dt_s(),
        }
    }

    /// The command of a tick in which nothing acts that the model does not explain.
    pub(crate) fn command(&mut self, target: Option<&TargetContent>) -> Command<N> {
        self.pressed(None, target)
    }

    /// The same of a hand on which a wrench acts.
    pub(crate) fn pressed(
        &mut self,
        wrist: Option<&Vector6>,
        target: Option<&TargetContent>,
    ) -> Command<N> {
        let terms = self.model.evaluate(&self.q, &self.qdot);
        self.report = self.analyzer.step(&self.q, &self.qdot, &terms);
        self.tick += 1;
        self.controller.step(&Inputs {
            tick: self.tick - 1,
            q: &self.q,
            qdot: &self.qdot,
            tau_disturbance: &Joints::zeros(),
            wrist,
            report: &self.report,
            // At every second tick the law evaluates the model itself.
            terms: self.tick.is_multiple_of(2).then_some(&terms),
            target,
        })
    }

    /// The command on the last report, whatever the posture is, under a torque that the model does not explain.
    pub(crate) fn again(&mut self, tau_disturbance: &Joints<N>) -> Command<N> {
        self.controller.step(&Inputs {
            tick: self.tick,
            q: &self.q,
            qdot: &self.qdot,
            tau_disturbance,
            wrist: None,
            report: &self.report,
            terms: None,
            target: None,
        })
    }

    /// Moves on by a tick under a torque on the joints.
    pub(crate) fn moves(&mut self, tau: &Joints<N>) {
        self.qdot += self.model.forward_dynamics(&self.q, &self.qdot, tau) * self.dt;
        self.q += self.qdot * self.dt;
    }
}
