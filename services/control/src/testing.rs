//! Shared by tests: arms, random postures, and a step of exact dynamics.

use crate::centre::AtCentre;
use crate::controller::Controller;
use crate::singularity::analyzer::Analyzer;
use crate::tick::{Inputs, Now};
use crate::types::{Command, Report};
use model::{Factors, Model, Robot, Terms};
use nalgebra::{SVector, Vector3};
use proptest::prelude::*;
use shared_types::TargetContent;
use shared_types::scenario::{Analysis, Scenario};
use std::collections::BTreeMap;
use std::sync::OnceLock;

/// An arm that stands in a posture, as a tick sees it.
pub(crate) fn standing<T>(name: &str, q: [f64; 6], seen: impl FnOnce(&Now<'_, 6>) -> T) -> T {
    let (robot, q, zero) = (robot(name), SVector::from(q), SVector::zeros());
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
pub(crate) fn posture<const N: usize>(model: &Model<N>) -> impl Strategy<Value = SVector<f64, N>> {
    let (lower, upper) = (*model.lower(), *model.upper());
    prop::collection::vec(0.0..1.0_f64, N).prop_map(move |x| {
        SVector::from_fn(|i, _| {
            lower[i].max(-3.2) + x[i] * (upper[i].min(3.2) - lower[i].max(-3.2))
        })
    })
}

/// A report of an arm that is nowhere singular.
pub(crate) fn empty_report<const N: usize>() -> Report<N> {
    Report::unexamined(1.0, Vector3::zeros())
}

/// The command for an arm on which nothing acts that the model does not explain.
pub(crate) fn undisturbed<const N: usize>(
    controller: &mut Controller<N>,
    tick: u64,
    [q, qdot]: [&SVector<f64, N>; 2],
    report: &Report<N>,
    terms: Option<&Terms<N>>,
    target: Option<&TargetContent>,
) -> Command<N> {
    controller.step(&Inputs {
        tick,
        q,
        qdot,
        tau_disturbance: &SVector::zeros(),
        wrist: None,
        report,
        terms,
        target,
    })
}

/// A scenario file of the product.
pub(crate) fn scenario(text: &str, settings: &[&str]) -> Scenario {
    let settings: Vec<String> = settings.iter().map(|s| (*s).to_owned()).collect();
    Scenario::parse("test.toml", text, &settings).unwrap()
}

/// One step of the arm's exact dynamics with the torque held: Runge–Kutta of fourth order.
pub(crate) fn rk4<const N: usize>(
    model: &Model<N>,
    q: &SVector<f64, N>,
    qdot: &SVector<f64, N>,
    tau: &SVector<f64, N>,
    dt: f64,
) -> (SVector<f64, N>, SVector<f64, N>) {
    let f = |q: &SVector<f64, N>, v: &SVector<f64, N>| model.forward_dynamics(q, v, tau);
    let h = 0.5 * dt;
    let a1 = f(q, qdot);
    let (v2, q2) = (qdot + a1 * h, q + qdot * h);
    let a2 = f(&q2, &v2);
    let (v3, q3) = (qdot + a2 * h, q + v2 * h);
    let a3 = f(&q3, &v3);
    let (v4, q4) = (qdot + a3 * dt, q + v3 * dt);
    let a4 = f(&q4, &v4);
    (
        q + (qdot + (v2 + v3) * 2.0 + v4) * (dt / 6.0),
        qdot + (a1 + (a2 + a3) * 2.0 + a4) * (dt / 6.0),
    )
}
