//! One tick of each process, without any message.

use std::hint::black_box;

use chain::Chain;
use model::{Model, Robot, joints, padded};
use nalgebra::SVector;
use runtime::now_ns;
use session::load::{self, Loaded};
use session::{Failure, Steering, Targets};
use shared_types::TorqueCommand;
use shared_types::scenario::{PlantModel, Scenario, Start};

use super::distribution::{Distribution, Row as BenchRow, histogram};
use crate::studies::steered::twists;

/// Duration of the session of random twists, s.
const STEERED_S: f64 = 20.0;

/// Evaluations per sample: a clock reading costs a tenth of one.
const BATCH: u64 = 100;
const SAMPLES: u64 = 5_000;

/// The scenario of an arm of seven joints.
const REDUNDANT: &str = "seven-joints";

/// Height of the floor that the arm is pressed on, m; the torque of its second joint beyond gravity that does so, N·m; the damping of its joints,
/// N·m·s/rad; and for how long, the way down included.
const FLOOR_M: f64 = -0.3;
const PRESSING_NM: f64 = 15.0;
const DAMPING: f64 = 20.0;
const PRESSED_TICKS: u64 = 8_000;

/// The terms of the scenario's arm, and those of the built-in arms that other programs publish, at postures along a circle in joint space.
///
/// # Errors
/// [`Failure::Work`] where an arm has no model of its size.
pub fn model(robot: &Robot) -> Result<Vec<BenchRow>, Failure> {
    let mut rows = terms::<6>(robot, "")?;
    let builtin = |name: &str| Robot::builtin(name).map_err(Failure::work);
    rows.extend(terms::<6>(&builtin("ur5")?, "ur5")?);
    rows.extend(terms::<7>(&builtin("panda")?, "panda")?);
    Ok(rows)
}

/// The terms of an arm of `N` joints, which the rows name unless it is the scenario's.
fn terms<const N: usize>(robot: &Robot, name: &str) -> Result<Vec<BenchRow>, Failure> {
    let model = Model::<N>::new(robot, None).map_err(Failure::work)?;
    let posture = |sample: u64| {
        let angle = sample as f64 * 0.01;
        (
            SVector::<f64, N>::from_fn(|joint, _| 0.3 + (angle + joint as f64).sin()),
            SVector::<f64, N>::from_fn(|joint, _| (angle * joint as f64).cos()),
        )
    };
    type Work<'a, const N: usize> = &'a dyn Fn(&SVector<f64, N>, &SVector<f64, N>);
    let row = |mechanism: &str, work: Work<'_, N>| {
        let mut times = histogram();
        for sample in 0..SAMPLES {
            let (q, qdot) = posture(sample);
            let began = now_ns();
            (0..BATCH).for_each(|_| work(black_box(&q), black_box(&qdot)));
            // Hundredths: a histogram of whole nanoseconds would be too coarse.
            times.saturating_record(now_ns() - began);
        }
        let mechanism = if name.is_empty() {
            mechanism.to_owned()
        } else {
            format!("{mechanism}, {name}")
        };
        BenchRow::alone(
            "model",
            &mechanism,
            Distribution::of(&times).divided_by(BATCH as f64),
        )
    };
    Ok(vec![
        row("A, bias and J in one pass", &|q, qdot| {
            black_box(model.evaluate(q, qdot));
        }),
        row("mass matrix", &|q, _| {
            black_box(model.mass_matrix(q));
        }),
        row("inverse dynamics", &|q, qdot| {
            black_box(model.inverse_dynamics(q, qdot, qdot));
        }),
        row("forward dynamics", &|q, qdot| {
            black_box(model.forward_dynamics(q, qdot, qdot));
        }),
    ])
}

/// The time of each pure step of a scenario.
struct Steps {
    sample: Distribution,
    estimator: Distribution,
    analyzer: Distribution,
    controller: Distribution,
    both: Distribution,
    moving: Distribution,
}

/// The pure steps over a whole scenario, hand in hand, as the processes compute them.
fn hand_in_hand(robot: &Robot, scenario: &Scenario) -> Result<Steps, Failure> {
    let mut plant = plant::cycle(robot, scenario).map_err(Failure::work)?;
    let mut estimator = estimator::cycle(robot, scenario).map_err(Failure::work)?;
    let mut analyzer = analyzer::cycle(robot, scenario).map_err(Failure::work)?;
    let mut controller = controller::cycle(robot, scenario).map_err(Failure::work)?;
    let mut m = chain::Tick::default();
    let mut times: [_; 6] = std::array::from_fn(|_| histogram());
    for tick in 0.. {
        if plant.is_over() {
            break;
        }
        let mut last = now_ns();
        let mut lap = |times: &mut hdrhistogram::Histogram<u64>| {
            let now = now_ns();
            let took = now - last;
            times.saturating_record(took);
            last = now;
            took
        };
        plant.sample(tick, &mut m.sensor, &mut m.plant_state);
        lap(&mut times[0]);
        estimator.step(&m.sensor, &mut m.estimate);
        lap(&mut times[1]);
        analyzer.step(&m.estimate, &mut m.singularity);
        let analyzing = lap(&mut times[2]);
        controller.step(
            &m.estimate,
            &m.singularity,
            &mut m.control_state,
            &mut m.torque,
        );
        let controlling = lap(&mut times[3]);
        plant.step(Some(&m.torque));
        lap(&mut times[5]);
        times[4].saturating_record(analyzing + controlling);
    }
    let [sample, estimator, analyzer, controller, both, moving] =
        times.map(|times| Distribution::of(&times));
    Ok(Steps {
        sample,
        estimator,
        analyzer,
        controller,
        both,
        moving,
    })
}

/// The simulated arm's steps: in the scenario, and pressed on a floor.
///
/// # Errors
/// [`Failure::Work`] where robot and scenario do not fit, or the arm does not stay on the floor.
pub fn plant(robot: &Robot, scenario: &Scenario) -> Result<Vec<BenchRow>, Failure> {
    let steps = hand_in_hand(robot, scenario)?;
    let row = |mechanism: &str, distribution: Distribution| {
        BenchRow::alone("plant", mechanism, distribution)
    };
    Ok(vec![
        row("sample", steps.sample),
        row("move", steps.moving),
        row("move, in contact", pressed(robot, scenario)?),
    ])
}

/// The simulated arm's step in the ticks in which contact points of it with a floor carry force.
fn pressed(robot: &Robot, scenario: &Scenario) -> Result<Distribution, Failure> {
    let mut scenario = scenario.clone();
    scenario.start = Start {
        posture: Some("nominal".to_owned()),
        ..Start::default()
    };
    scenario.plant.floor_m = Some(FLOOR_M);
    let model = Model::<6>::new(robot, None).map_err(Failure::work)?;
    let mut plant = plant::cycle(robot, &scenario).map_err(Failure::work)?;
    let (mut m, mut times) = (chain::Tick::default(), histogram());
    for tick in 0..PRESSED_TICKS {
        plant.sample(tick, &mut m.sensor, &mut m.plant_state);
        let (q, qdot) = (
            joints::<6>(&m.plant_state.q),
            joints::<6>(&m.plant_state.qdot),
        );
        let mut tau = model.gravity(&q) - qdot * DAMPING;
        tau[1] += PRESSING_NM;
        m.torque = TorqueCommand {
            header: m.sensor.header,
            tau: padded(&tau),
            ..TorqueCommand::default()
        };
        let began = now_ns();
        plant.step(Some(&m.torque));
        if m.plant_state.contacts > 0 {
            times.saturating_record(now_ns() - began);
        }
    }
    if times.len() < PRESSED_TICKS / 4 {
        return Err(Failure::Work(format!(
            "the arm was on the floor in {} of {PRESSED_TICKS} ticks only",
            times.len()
        )));
    }
    Ok(Distribution::of(&times))
}

/// The pure steps of the control chain, as the processes compute them; the last rows are all of them as the chain runs them.
///
/// # Errors
/// [`Failure`] where a scenario cannot be loaded, or does not fit its robot.
pub fn control(robot: &Robot, scenario: &Scenario) -> Result<Vec<BenchRow>, Failure> {
    let steps = hand_in_hand(robot, scenario)?;
    let Loaded {
        scenario: redundant,
        robot: seven,
        ..
    } = load::scenario(REDUNDANT, &[], None)?;
    let both = hand_in_hand(&seven, &redundant)?.both;
    let mut m = chain::Tick::default();
    let mut whole = |name: &str, scenario: &Scenario| -> Result<BenchRow, Failure> {
        let mut chain = Chain::new(robot, scenario).map_err(Failure::work)?;
        let mut times = histogram();
        while !chain.is_over() {
            let began = now_ns();
            chain.step(black_box(&mut m));
            times.saturating_record(now_ns() - began);
        }
        Ok(BenchRow::alone("control", name, Distribution::of(&times)))
    };
    let mut exact = scenario.clone();
    exact.plant.model = PlantModel::Reference;
    let mut rubbing = scenario.clone();
    rubbing.plant.friction = true;
    Ok(vec![
        BenchRow::alone("control", "estimator", steps.estimator),
        BenchRow::alone("control", "analyzer", steps.analyzer),
        BenchRow::alone("control", "controller", steps.controller),
        BenchRow::alone(
            "control",
            &format!("analyzer and controller, {REDUNDANT}"),
            both,
        ),
        BenchRow::alone("control", "controller, steered", steered(robot)?),
        whole("whole tick, one thread", scenario)?,
        whole("whole tick, exact plant", &exact)?,
        whole("whole tick, dry friction", &rubbing)?,
    ])
}

/// The controller's step in a session of random twists on the same arm.
fn steered(robot: &Robot) -> Result<Distribution, Failure> {
    let steering = Steering {
        subject: robot.name.clone(),
        targets: Targets::Text(twists(1, STEERED_S)),
        start: None,
        duration_s: None,
        settings: Vec::new(),
        seed: None,
        graph: None,
    };
    let Loaded {
        scenario, robot, ..
    } = steering.load()?;
    let mut plant = plant::cycle(&robot, &scenario).map_err(Failure::work)?;
    let mut estimator = estimator::cycle(&robot, &scenario).map_err(Failure::work)?;
    let mut analyzer = analyzer::cycle(&robot, &scenario).map_err(Failure::work)?;
    let mut controller = controller::cycle(&robot, &scenario).map_err(Failure::work)?;
    let mut operator = operator::Cycle::new(
        &scenario.servo.clone().unwrap_or_default(),
        scenario.rate_hz,
    );
    let (mut m, mut times) = (chain::Tick::default(), histogram());
    for tick in 0.. {
        if plant.is_over() {
            break;
        }
        plant.sample(tick, &mut m.sensor, &mut m.plant_state);
        estimator.step(&m.sensor, &mut m.estimate);
        analyzer.step(&m.estimate, &mut m.singularity);
        operator.step(&m.sensor, &mut m.target);
        let began = now_ns();
        controller.steer(
            (&m.estimate, &m.singularity),
            Some(&m.target),
            &mut m.servo_state,
            &mut m.control_state,
            &mut m.torque,
        );
        times.saturating_record(now_ns() - began);
        plant.step(Some(&m.torque));
    }
    Ok(Distribution::of(&times))
}
