//! The process: publishes the robot's states, and sends torques to the robot.

use model::{Model, Robot, embedded};
use runtime::{ProcessError, Shell};
use shared_types::codes::{DRIVE_STOPPING, DRIVES, name_of};
use shared_types::scenario::Scenario;
use shared_types::{PlantState, SensorSample, TorqueCommand};

use crate::address::Address;
use crate::approach::Approach;
use crate::client::{Client, Rates};
use crate::cycle::{Cycle, Measured};
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
    let start = robot.start_posture(&scenario.start);
    let start = embedded::<JOINTS>(&start.map_err(ProcessError::setup)?);
    let client = Client::connect(address)?;
    client.check_ready()?;
    if !approach(shell, &client, &model, start)? {
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
    let mut control = client.control()?;
    let (mut now, mut passed) = control.next(0)?;
    let (hold, planned) = (scenario.plant.hold_ticks, scenario.planned_ticks());
    let mut cycle = Cycle::new(model, hold, planned, &now);
    let mut publish = |cycle: &Cycle, tick: u64, now: &Measured| -> Result<(), ProcessError> {
        cycle.sample(tick, now, sensors.loan(tick)?, truths.loan(tick)?);
        sensors.send()?;
        Ok(truths.send()?)
    };
    while let Some(tick) = source.next_by(passed)? {
        publish(&cycle, tick, &now)?;
        let before = cycle.drive();
        let tau = cycle.step(&now, torques.arriving(tick, source.deadline_ns())?);
        log_drive(tick, before, cycle.drive());
        if cycle.is_over() {
            let rates = control.finish(tick, tau)?;
            source.finish()?;
            return Ok(report(&rates));
        }
        let sent = control.send(tick, tau);
        (now, passed) = match sent.and_then(|()| control.next(tick + 1)) {
            Ok(next) => next,
            Err(failure) => {
                report(&control.rates());
                // The last messages of the run say that the arm has been stopped, and how it was last seen.
                cycle.stopped_by_robot();
                if let Some(tick) = source.next_by(1)? {
                    publish(&cycle, tick, &now)?;
                }
                return Err(failure.into());
            }
        };
    }
    // Stopped in the middle of the task: the arm may be moving, so the robot itself brings it to rest, as `control` is dropped.
    report(&control.rates());
    Ok(())
}

/// Logs the stops of the drive and the way back from them, not each tick that is held.
fn log_drive(tick: u64, before: u32, now: u32) {
    if now == before {
    } else if now >= DRIVE_STOPPING {
        let drive = name_of(DRIVES, now);
        tracing::warn!("tick {tick}: no torque comes in time, the arm is {drive}");
    } else if before >= DRIVE_STOPPING {
        tracing::warn!("tick {tick}: torque comes in time again, the arm goes on");
    }
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
