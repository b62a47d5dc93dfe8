//! Faults in a running graph.

use std::time::{Duration, Instant};

use model::Robot;
use runtime::{FaultRecord, random};
use shared_types::fault::Fault;

use crate::observation::{Living, job};
use crate::{Failure, arm_faults};

/// How long to wait for the next tick of a run.
const PATIENCE: Duration = Duration::from_secs(2);

/// Injects a fault into the run of that name, or the only one that was started from this folder; returns the run and the fault with the
/// tick at which it is in force.
///
/// # Errors
/// [`Failure::Input`] if the run, the process or the fault does not exist; [`Failure::Work`] if the run has no room or no further tick.
pub fn inject(wanted: Option<&str>, fault: &Fault) -> Result<(Living, Fault), Failure> {
    let mut living = Living::find_to_change(wanted)?;
    let (run, manifest, control_page) = living.open()?;
    // A bench has processes and no graph: it takes no fault.
    let job = job(run.path()).ok();
    let found = job.and_then(|job| Some((job.graph.target(&fault.process)?, job)));
    let Some((target, job)) = found else {
        return Err(Failure::Input(format!(
            "the run has no process `{}`; it has {}",
            fault.process,
            manifest.names()
        )));
    };
    let robot = Robot::from_source(&job.robot).map_err(Failure::work)?;
    arm_faults::check(fault, &robot).map_err(Failure::input)?;
    // Any seed will do: the run records it with the fault.
    let seed = random(runtime::now_ns(), u64::from(std::process::id()));
    let scheduled = fault.schedule(&target, manifest.rate_hz, seed);
    let scheduled = scheduled.map_err(Failure::input)?;
    let Some(place) = control_page.fault_table().request(&scheduled) else {
        return Err(Failure::Work(format!(
            "{living} has had {} faults, the most that fit into a run",
            runtime::MOST_WHEN_REQUESTED
        )));
    };
    let account = await_force(&mut living, place)?;
    let Some(in_force) = account.scheduled.fault(&fault.process, &target) else {
        return Err(Failure::Work(format!("{living} does not know this fault")));
    };
    Ok((living, in_force))
}

/// Waits until a fault is in force; after a roll-back the run has it at the same place of another table.
fn await_force(living: &mut Living, place: usize) -> Result<FaultRecord, Failure> {
    let asked = Instant::now();
    let (mut run, _, mut control_page) = living.open()?;
    loop {
        if let Some(account) = control_page.fault_table().record(place) {
            return Ok(account);
        }
        if asked.elapsed() > PATIENCE {
            return Err(Failure::Work(format!(
                "{living} has not begun a tick since: the fault takes effect at its next tick"
            )));
        }
        if !run.path().exists()
            && let Some(again) = living.again()
        {
            *living = again;
            (run, _, control_page) = living.open()?;
        }
        std::thread::sleep(Duration::from_micros(200));
    }
}
