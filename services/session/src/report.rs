//! A run as a page for people without a viewer.

use model::Robot;
use viz::{Happened, RecordError, Source};

use crate::drawing::Record;
use crate::failure::Failure;
use crate::launch::interrupts;
use crate::progress::Observer;
use crate::runs::Run;

/// The result of [`report`].
#[derive(Clone, Debug)]
pub struct Page {
    /// HTML.
    pub text: String,
    /// One sentence if the record is incomplete: how much is missing, why, and the remedy. The page shows it, too.
    pub shortfall: Option<String>,
}

/// The page of a run, as far as its record can be read.
///
/// # Errors
/// [`Failure::Input`] if the run's summary, its job or its record cannot be read; [`Failure::Work`] if the arm cannot be drawn.
pub fn report(run: &Run, observer: Observer<'_>) -> Result<Page, Failure> {
    let (summary, job) = (run.summary()?, run.job()?);
    if !job.record {
        let robot = Robot::from_source(&job.robot).map_err(Failure::input)?;
        let nothing = Source {
            job: &job,
            robot: &robot,
            happened: Happened::default(),
            ticks: &mut std::iter::empty(),
            progress: &mut |_| true,
        };
        let text = viz::report(&summary, nothing, &[]);
        return Ok(Page {
            text: text.map_err(Failure::work)?,
            shortfall: None,
        });
    }
    // Before the page: it says so at its top.
    let (mut lacks, _) = run.message_damage(&job, Some(&summary));
    lacks.extend(Some(summary.recorder.error.clone()).filter(|error| !error.is_empty()));
    let record = Record::of(job, &run.folder, Some(summary.clone()))?;
    let (text, _) = record.make("report", &mut interrupts()?, observer, |source| {
        viz::report(&summary, source, &lacks)
    });
    Ok(Page {
        text: text.map_err(|error| match error {
            RecordError::Stopped => Failure::work("the report was stopped"),
            error => Failure::work(error),
        })?,
        shortfall: (!lacks.is_empty()).then(|| run.with_remedy(&lacks.join("; "))),
    })
}
