//! The viewer's layout for a run.

use std::path::Path;

use model::Robot;
use shared_types::scenario::Layout;
use viz::Tick;

use crate::failure::Failure;
use crate::runs::Run;

/// The layout of a run as a `.rbl`: the first tick is computed again, which names the singularities and places the eye.
///
/// # Errors
/// [`Failure`] if the job cannot be read or computed, or the file not be written.
pub fn save_blueprint(run: &Run, layout: Layout, path: &Path) -> Result<(), Failure> {
    let mut job = run.job()?;
    let robot = Robot::from_source(&job.robot).map_err(Failure::input)?;
    let first = chain::first_tick(&robot, &job.scenario).map_err(Failure::input)?;
    // The faults that the run has had, those injected by hand too: plots mark them.
    if let Ok(Some(summary)) = run.summary_if_any() {
        let faults = summary.faults.into_iter();
        job.scenario.fault = faults.filter_map(|fault| fault.plan).collect();
    }
    let first = Tick {
        messages: (&first).into(),
        ..Tick::default()
    };
    viz::save_blueprint(path, &job, &robot, &first, layout).map_err(Failure::work)
}
