//! One tick of each process on one thread, without any message; and the recorder's work in a run of its own.

use std::hint::black_box;

use chain::Chain;
use hdrhistogram::Histogram;
use model::{Model, Robot, joints, padded};
use nalgebra::SVector;
use recorder::Judge;
use runtime::now_ns;
use session::load;
use session::{Failure, Observer, Steering, Targets};
use shared_types::TorqueCommand;
use shared_types::job::Mode;
use shared_types::scenario::{PlantModel, Scenario, Start};

use super::{Distribution, Row, histogram};
use crate::folder::scratch;
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

/// Takes the time of some work.
fn timed<T>(times: &mut Histogram<u64>, work: impl FnOnce() -> T) -> T {
    let began = now_ns();
    let result = work();
    times.saturating_record(now_ns() - began);
    result
}

fn row(bench: &str, mechanism: &str, times: &Histogram<u64>) -> Row {
    Row::alone(bench, mechanism, Distribution::of(times, 1.0))
}

/// The terms of the scenario's arm, and those of the built-in arms that other programs publish, at postures along a circle in joint space.
///
/// # Errors
/// [`Failure::Work`] where an arm has no model of its size.
pub fn model(robot: &Robot) -> Result<Vec<Row>, Failure> {
    let mut rows = terms::<6>(robot, "")?;
    let builtin = |name: &str| Robot::builtin(name).map_err(Failure::work);
    rows.extend(terms::<6>(&builtin("ur5")?, ", ur5")?);
    rows.extend(terms::<7>(&builtin("panda")?, ", panda")?);
    Ok(rows)
}

/// The terms of an arm of `N` joints; the rows' names end with its name.
fn terms<const N: usize>(robot: &Robot, name: &str) -> Result<Vec<Row>, Failure> {
    type Vector<const N: usize> = SVector<f64, N>;
    let model = Model::<N>::new(robot, None).map_err(Failure::work)?;
    let row = |mechanism: &str, work: &dyn Fn(&Vector<N>, &Vector<N>)| {
        let mut times = histogram();
        for sample in 0..SAMPLES {
            let angle = sample as f64 * 0.01;
            let q = Vector::<N>::from_fn(|joint, _| 0.3 + (angle + joint as f64).sin());
            let qdot = Vector::<N>::from_fn(|joint, _| (angle * joint as f64).cos());
            timed(&mut times, || {
                (0..BATCH).for_each(|_| work(black_box(&q), black_box(&qdot)))
            });
        }
        let times = Distribution::of(&times, BATCH as f64);
        Row::alone("model", &format!("{mechanism}{name}"), times)
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

/// The times of the pure steps: sample, estimator, analyzer, controller, move.
type Steps = [Histogram<u64>; 5];

/// The pure steps over a whole scenario, one after the other, as the processes compute them.
fn one_after_the_other(robot: &Robot, scenario: &Scenario) -> Result<Steps, Failure> {
    let mut plant = plant::cycle(robot, scenario).map_err(Failure::work)?;
    let mut estimator = estimator::cycle(robot, scenario).map_err(Failure::work)?;
    let mut analyzer = analyzer::cycle(robot, scenario).map_err(Failure::work)?;
    let mut controller = controller::cycle(robot, scenario).map_err(Failure::work)?;
    let mut operator = scenario
        .servo
        .as_ref()
        .map(|servo| operator::Cycle::new(servo, scenario.rate_hz));
    let mut m = chain::Tick::default();
    let mut steps: Steps = std::array::from_fn(|_| histogram());
    let [sampling, estimating, analyzing, controlling, moving] = &mut steps;
    for tick in 0.. {
        if plant.is_over() {
            break;
        }
        timed(sampling, || {
            plant.sample(tick, &mut m.sensor, &mut m.plant_state)
        });
        timed(estimating, || estimator.step(&m.sensor, &mut m.estimate));
        timed(analyzing, || analyzer.step(&m.estimate, &mut m.singularity));
        let target = operator.as_mut().map(|operator| {
            operator.step(&m.sensor, &mut m.target);
            m.target
        });
        timed(controlling, || match &target {
            Some(target) => controller.steer(
                (&m.estimate, &m.singularity),
                Some(target),
                &mut m.servo_state,
                &mut m.control_state,
                &mut m.torque,
            ),
            None => controller.step(
                &m.estimate,
                &m.singularity,
                &mut m.control_state,
                &mut m.torque,
            ),
        });
        timed(moving, || plant.step(Some(&m.torque)));
    }
    Ok(steps)
}

/// The simulated arm's steps: in the scenario, and pressed on a floor.
///
/// # Errors
/// [`Failure::Work`] where robot and scenario do not fit, or the arm does not stay on the floor.
pub fn plant(robot: &Robot, scenario: &Scenario) -> Result<Vec<Row>, Failure> {
    let [sample, .., moving] = &one_after_the_other(robot, scenario)?;
    Ok(vec![
        row("plant", "sample", sample),
        row("plant", "move", moving),
        row("plant", "move, in contact", &pressed(robot, scenario)?),
    ])
}

/// The simulated arm's step in the ticks in which contact points of it with a floor carry force.
fn pressed(robot: &Robot, scenario: &Scenario) -> Result<Histogram<u64>, Failure> {
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
        let [q, qdot] = [&m.plant_state.q, &m.plant_state.qdot].map(joints::<6>);
        let mut tau = model.gravity(&q) - qdot * DAMPING;
        tau[1] += PRESSING_NM;
        m.torque = TorqueCommand {
            header: m.sensor.header,
            tau: padded(&tau),
            ..TorqueCommand::default()
        };
        let mut apart = histogram();
        let touches = m.plant_state.contacts > 0;
        timed(if touches { &mut times } else { &mut apart }, || {
            plant.step(Some(&m.torque))
        });
    }
    if times.len() < PRESSED_TICKS / 4 {
        let ticks = times.len();
        let text = format!("the arm was on the floor in {ticks} of {PRESSED_TICKS} ticks only");
        return Err(Failure::Work(text));
    }
    Ok(times)
}

/// The pure steps of the control chain, as the processes compute them; the last rows are all of them as the chain runs them.
///
/// # Errors
/// [`Failure`] where a scenario cannot be loaded, or does not fit its robot.
pub fn control(robot: &Robot, scenario: &Scenario) -> Result<Vec<Row>, Failure> {
    let [_, estimator, analyzer, controller, _] = &one_after_the_other(robot, scenario)?;
    let redundant = load::scenario(REDUNDANT, &[], None)?;
    let seven = one_after_the_other(&redundant.robot, &redundant.scenario)?;
    let steering = Steering {
        subject: robot.name.clone(),
        targets: Targets::Text(twists(1, STEERED_S)),
        start: None,
        duration_s: None,
        settings: Vec::new(),
        seed: None,
        graph: None,
    };
    let session = steering.load()?;
    let steered = one_after_the_other(&session.robot, &session.scenario)?;
    let whole = |name: &str, change: &dyn Fn(&mut Scenario)| -> Result<Row, Failure> {
        let mut scenario = scenario.clone();
        change(&mut scenario);
        let mut chain = Chain::new(robot, &scenario).map_err(Failure::work)?;
        let (mut m, mut times) = (chain::Tick::default(), histogram());
        while !chain.is_over() {
            timed(&mut times, || chain.step(black_box(&mut m)));
        }
        Ok(row("control", name, &times))
    };
    Ok(vec![
        row("control", "estimator", estimator),
        row("control", "analyzer", analyzer),
        row("control", "controller", controller),
        row("control", "analyzer, seven-joints", &seven[2]),
        row("control", "controller, seven-joints", &seven[3]),
        row("control", "controller, steered", &steered[3]),
        whole("whole tick, one thread", &|_| ())?,
        whole("whole tick, exact plant", &|scenario| {
            scenario.plant.model = PlantModel::Reference
        })?,
        whole("whole tick, dry friction", &|scenario| {
            scenario.plant.friction = true
        })?,
    ])
}

/// The recorder's work over a whole scenario, in a run of its own process.
#[derive(serde::Serialize)]
pub struct Recorded {
    /// Processor time of the process per tick, µs.
    pub cpu_us_per_tick: f64,
    /// The recording, at 1 kHz.
    pub recording_mb_per_min: f64,
    /// The messages that `armplane replay` reads, at 1 kHz.
    pub messages_mb_per_min: f64,
}

impl std::fmt::Display for Recorded {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            cpu_us_per_tick,
            recording_mb_per_min,
            messages_mb_per_min,
        } = self;
        writeln!(
            f,
            "recorder: {cpu_us_per_tick:.1} µs of processor time a tick; {recording_mb_per_min:.0} MB a minute of recording and \
             {messages_mb_per_min:.0} of messages at 1 kHz"
        )
    }
}

/// The judge and the encoding of the recorder on one thread; and a run in its own process.
///
/// # Errors
/// [`Failure`] where the run fails, or the recorder cannot write.
pub fn record(
    robot: &Robot,
    scenario: &Scenario,
    observer: Observer<'_>,
) -> Result<(Vec<Row>, Recorded), Failure> {
    let mut folder = scratch()?;
    let graph = load::graph(None)?;
    let job = load::job(
        robot,
        scenario.clone(),
        graph,
        Mode::Lockstep,
        folder.path().to_owned(),
    );
    let mut tape = recorder::Tape::start(robot, &job).map_err(Failure::work)?;
    let mut judge = Judge::new(robot, scenario).map_err(Failure::work)?;
    let [mut judging, mut encoding] = [histogram(), histogram()];
    chain::run(robot, scenario, |tick| {
        let row = recorder::Row::new(tick.sensor.header.tick, tick);
        timed(&mut judging, || {
            recorder::Tick::of(&tick.lent())
                .into_iter()
                .for_each(|tick| {
                    judge.tick(tick);
                });
        });
        timed(&mut encoding, || tape.tick(&row));
    })
    .map_err(Failure::input)?;
    tape.finish();
    folder.check_signals()?;
    let rows = vec![
        row("record", "judge", &judging),
        row("record", "recording", &encoding),
    ];
    let (outcome, account) = session::launch(&job, session::plan(&job)?, observer)?;
    folder.check_signals()?;
    let account = account.map(|account| account.recorder);
    let account = account
        .ok_or_else(|| Failure::Work("the recorder left no account of the run".to_owned()))?;
    if !account.error.is_empty() {
        return Err(Failure::Work(account.error));
    }
    let per_tick = |amount: f64| amount / outcome.ticks.max(1) as f64;
    let mb_per_min = |bytes: u64| per_tick(bytes as f64 * 1e-6) * 60_000.0;
    let recorded = Recorded {
        cpu_us_per_tick: per_tick(account.cpu_s * 1e6),
        recording_mb_per_min: mb_per_min(account.bytes),
        messages_mb_per_min: mb_per_min(account.messages_bytes),
    };
    Ok((rows, recorded))
}
