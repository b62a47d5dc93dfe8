//! Shared by tests: arms, random postures, and an exact plant to close the loop with.

use crate::linear::stack;
use crate::singularity::puma_inverse::PumaLengths;
use crate::types::{Command, Mode, Phase, Report};
use crate::{Analyzer, Controller, Inputs};
use model::{Factors, Model, Robot};
use nalgebra::{SVector, Vector3, Vector6};
use proptest::prelude::*;
use shared_types::scenario::Scenario;
use std::collections::BTreeMap;
use std::sync::OnceLock;

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

/// The lengths of a built-in PUMA.
pub(crate) fn puma_lengths(name: &str) -> PumaLengths {
    let Factors::Puma { a2, a3, d4 } = robot(name).factors else {
        panic!("{name} has the factors of a PUMA")
    };
    PumaLengths::new(a2, a3, d4)
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

/// A scenario file of the product.
pub(crate) fn scenario(text: &str, settings: &[&str]) -> Scenario {
    let settings: Vec<String> = settings.iter().map(|s| (*s).to_owned()).collect();
    Scenario::parse("test.toml", text, &settings).unwrap()
}

/// The result of one tick.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tick<const N: usize> {
    pub(crate) q: SVector<f64, N>,
    pub(crate) report: Report<N>,
    pub(crate) command: Command<N>,
    /// True pose minus desired pose, `[p_d − p; log(R_d Rᵀ)]`.
    pub(crate) error: Vector6<f64>,
}

impl<const N: usize> Tick<N> {
    /// Error along the engaged singular directions, and orthogonal to them: (mm, deg) each.
    pub(crate) fn split(&self) -> ([f64; 2], [f64; 2]) {
        let (mut linear, mut angular) = (
            crate::linear::linear(&self.error),
            crate::linear::angular(&self.error),
        );
        let (e, w) = (linear, angular);
        for (i, s) in self.report.listed().iter().enumerate() {
            if self.command.mode[i] == Mode::Regular {
                continue;
            }
            let axis = s.axis();
            if s.angular {
                angular -= axis * axis.dot(&angular);
            } else {
                linear -= axis * axis.dot(&linear);
            }
        }
        let unit = |p: f64, o: f64| [p * 1e3, o.to_degrees()];
        (
            unit((e - linear).norm(), (w - angular).norm()),
            unit(linear.norm(), angular.norm()),
        )
    }
}

/// The figures of a whole run.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Figures {
    pub(crate) along_mm: f64,
    pub(crate) along_deg: f64,
    pub(crate) orthogonal_mm: f64,
    pub(crate) orthogonal_deg: f64,
    pub(crate) final_mm: f64,
    pub(crate) final_deg: f64,
    pub(crate) speed: f64,
    pub(crate) torque: f64,
    pub(crate) torque_step: f64,
    pub(crate) torque_step_p95: f64,
    pub(crate) saturated_ticks: usize,
    pub(crate) refused: bool,
    pub(crate) limit_violated: bool,
}

/// A run in one thread: analyzer, controller and an exact plant (RK4 at the control rate).
pub(crate) fn run<const N: usize>(
    scenario: &Scenario,
    each: impl FnMut(usize, &Tick<N>),
) -> Figures {
    run_on(robot(&scenario.robot), scenario, each)
}

/// The same on any robot.
pub(crate) fn run_on<const N: usize>(
    robot: &Robot,
    scenario: &Scenario,
    mut each: impl FnMut(usize, &Tick<N>),
) -> Figures {
    let frame = scenario.frame();
    let model = Model::<N>::new(robot, frame).unwrap();
    let q_start = crate::start_posture::<N>(robot, scenario).unwrap();
    let mut analyzer = Analyzer::new(robot, &scenario.analysis);
    let mut controller = Controller::new(model.clone(), robot, scenario, q_start).unwrap();
    let (mut q, mut qdot) = (q_start, SVector::<f64, N>::zeros());
    let mut out = Figures::default();
    let mut last: Option<Command<N>> = None;
    let mut steps = vec![];
    let dt = scenario.dt_s();
    let disturbance = SVector::<f64, N>::zeros();
    let mut k = 0;
    loop {
        let terms = model.evaluate(&q, &qdot);
        let report = analyzer.step(&q, &qdot, &terms);
        let command = controller.step(&Inputs {
            tick: k as u64,
            q: &q,
            qdot: &qdot,
            tau_disturbance: &disturbance,
            report: &report,
            terms: Some(&terms),
            target: None,
        });
        let tau = command.tau;
        let X = model.forward_kinematics(&q);
        let error = stack(
            &(command.p_BE_d - X.p),
            &crate::linear::rotation_log(&(command.R_BE_d * X.R.transpose())),
        );
        let tick = Tick {
            q,
            report,
            command,
            error,
        };
        each(k, &tick);

        let (along, orthogonal) = tick.split();
        out.along_mm = out.along_mm.max(along[0]);
        out.along_deg = out.along_deg.max(along[1]);
        out.orthogonal_mm = out.orthogonal_mm.max(orthogonal[0]);
        out.orthogonal_deg = out.orthogonal_deg.max(orthogonal[1]);
        out.final_mm = crate::linear::linear(&error).norm() * 1e3;
        out.final_deg = crate::linear::angular(&error).norm().to_degrees();
        out.saturated_ticks += usize::from(command.saturation_mask != 0);
        out.refused |= command.phase == Phase::Refused;
        let mut step = 0.0_f64;
        for i in 0..N {
            out.speed = out.speed.max(qdot[i].abs() / model.velocity()[i]);
            out.torque = out.torque.max(tau[i].abs() / model.effort()[i]);
            out.limit_violated |= q[i] < model.lower()[i] - 1e-3 || q[i] > model.upper()[i] + 1e-3;
            if let Some(last) = &last {
                step = step.max((tau[i] - last.tau[i]).abs() / model.effort()[i]);
            }
        }
        steps.push(step);
        last = Some(command);
        if matches!(command.phase, Phase::Done | Phase::Refused)
            || k as f64 * dt > 3.0 * scenario.duration_s()
        {
            break;
        }
        (q, qdot) = rk4(&model, &q, &qdot, &tau, dt);
        k += 1;
    }
    steps.sort_by(f64::total_cmp);
    out.torque_step = *steps.last().unwrap();
    out.torque_step_p95 = steps[steps.len() * 95 / 100];
    out
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
