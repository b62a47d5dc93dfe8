//! The process: publishes the robot's states, and sends torques to the robot.

use model::{Model, Robot, embedded};
use runtime::{ProcessError, Shell};
use shared_types::codes::{DRIVE_STOPPING, DRIVES, name_of};
use shared_types::scenario::Scenario;
use shared_types::{PlantState, SensorSample, TorqueCommand};

use crate::address::Address;
use crate::approach::Approach;
use crate::client::{Client, Rates};
use crate::cycle::Cycle;
use crate::error::RobotFailure;
use crate::interface::{JOINTS, RATE_HZ};

/// Time beyond the planned one to come to rest at the start; s.
const PATIENCE_S: f64 = 3.0;

/// A robot's own bar for its success rate: below, the network or this machine is too slow.
const GOOD_RATE: f64 = 0.99;

pub(crate) fn run(
    shell: &Shell,
    robot: &Robot,
    scenario: &Scenario,
    address: &Address,
) -> Result<(), ProcessError> {
    let model = Model::<JOINTS>::new(robot, scenario.frame()).map_err(ProcessError::setup)?;
    let start = embedded::<JOINTS>(
        &robot
            .start_posture(&scenario.start)
            .map_err(ProcessError::setup)?,
    );
    if scenario.rate_hz != RATE_HZ {
        let sentence = format!(
            "{} runs at {} Hz, the robot at {RATE_HZ}: leave `rate_hz` out",
            scenario.name, scenario.rate_hz
        );
        return Err(ProcessError::setup(RobotFailure::Scenario(sentence)));
    }
    let client = Client::connect(address).map_err(ProcessError::setup)?;
    client.check_ready().map_err(ProcessError::setup)?;
    if !approach(shell, &client, &model, start).map_err(ProcessError::setup)? {
        return Ok(());
    }
    let mut sensors = shell.writer::<SensorSample>()?;
    let mut truths = shell.writer::<PlantState>()?;
    let mut torques = shell.reader::<TorqueCommand>()?;
    let mut source = shell.tick_source(0);
    // The robot holds the arm itself until every process is ready.
    if !source.begin()? {
        return Ok(());
    }
    let mut control = client.control().map_err(ProcessError::setup)?;
    let (mut now, mut passed) = control.next(0).map_err(ProcessError::setup)?;
    let mut cycle = Cycle::new(
        model,
        scenario.plant.hold_ticks,
        scenario.planned_ticks(),
        &now,
    );
    let mut drive = cycle.drive();
    while let Some(tick) = source.next_by(passed)? {
        let (mut sample, mut truth) = (sensors.loan_as_is(tick)?, truths.loan_as_is(tick)?);
        cycle.sample(tick, &now, &mut sample, &mut truth);
        sample.send()?;
        truth.send()?;
        let tau = cycle.step(&now, torques.arriving(tick, source.deadline_ns())?);
        if cycle.drive() != drive {
            // Not each tick that is held: the log has the stops, and the way back from them.
            if cycle.drive() >= DRIVE_STOPPING {
                tracing::warn!(
                    "tick {tick}: no torque comes in time, the arm is {}",
                    name_of(DRIVES, cycle.drive())
                );
            } else if drive >= DRIVE_STOPPING {
                tracing::warn!("tick {tick}: torque comes in time again, the arm goes on");
            }
            drive = cycle.drive();
        }
        if cycle.is_over() {
            source.finish()?;
            let rates = control.finish(tick, tau).map_err(ProcessError::setup)?;
            report(&rates);
            return Ok(());
        }
        let answered = control
            .send(tick, tau)
            .and_then(|()| control.next(tick + 1));
        (now, passed) = match answered {
            Ok(next) => next,
            Err(failure) => {
                report(&control.rates());
                // The last messages of the run say that the arm has been stopped, and how it was last seen.
                cycle.stopped_by_robot();
                if let Some(tick) = source.next_by(1)? {
                    let (mut sample, mut truth) =
                        (sensors.loan_as_is(tick)?, truths.loan_as_is(tick)?);
                    cycle.sample(tick, &now, &mut sample, &mut truth);
                    sample.send()?;
                    truth.send()?;
                }
                return Err(ProcessError::setup(failure));
            }
        };
    }
    // Stopped in the middle of the task: the arm may be moving, so the robot itself brings it to rest, as `control` is dropped.
    report(&control.rates());
    Ok(())
}

/// Moves the arm to the start posture; `false` if the run is stopped meanwhile.
fn approach(
    shell: &Shell,
    client: &Client,
    model: &Model<JOINTS>,
    start: nalgebra::SVector<f64, JOINTS>,
) -> Result<bool, RobotFailure> {
    let mut control = client.control()?;
    let (mut now, _) = control.next(0)?;
    let approach = Approach::new(now.q, start);
    let mut guard = Cycle::new(model.clone(), 0, u64::MAX, &now);
    let (mut t_s, mut tau) = (0.0, [0.0; JOINTS]);
    while !shell.is_stopping() {
        if t_s >= approach.duration_s() && approach.is_there(&now.q, &now.qdot) {
            control.finish(0, tau)?;
            return Ok(true);
        }
        if t_s > approach.duration_s() + PATIENCE_S {
            let (joint, off) = approach.furthest(&now.q);
            return Err(RobotFailure::NotAtStart {
                joint,
                off_mrad: off * 1e3,
                seconds: t_s,
            });
        }
        tau = guard.send_within_steps(&now, &approach.torque(model, t_s, &now.q, &now.qdot));
        control.send(0, tau)?;
        let (next, passed) = control.next(0)?;
        (now, t_s) = (next, t_s + passed as f64 / f64::from(RATE_HZ));
    }
    Ok(false)
}

fn report(rates: &Rates) {
    let sentence = format!(
        "the robot received {:.2} % of the commands in time, {:.0} % in the worst 100; {} of its states were missed",
        rates.mean() * 100.0,
        rates.least * 100.0,
        rates.missed
    );
    if rates.mean() < GOOD_RATE {
        tracing::warn!("{sentence}")
    } else {
        eprintln!("{sentence}")
    }
}
