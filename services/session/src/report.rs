//! A run as a page for people without a viewer.

use std::path::Path;

use crate::failure::Failure;
use crate::runs::Run;

/// The result of [`report`].
#[derive(Clone, Debug)]
pub struct Page {
    /// HTML.
    pub text: String,
    /// One sentence if the recording or the message logs are incomplete: how much is missing, why,
    /// and the remedy. The page shows it, too.
    pub shortfall: Option<String>,
}

/// The page of a run, as far as its recording can be read; `path` is where it shall go, for the errors.
///
/// # Errors
/// [`Failure::Input`] if the run's summary, its job or its recording cannot be read; [`Failure::Work`] if a plot cannot be drawn.
pub fn report(run: &Run, path: &Path) -> Result<Page, Failure> {
    let (summary, job) = (run.summary()?, run.job()?);
    // A recording with a name of its own may be of another run than the messages beside it.
    let damage = if run.is_own() {
        run.message_damage(&job, Some(&summary)).0
    } else {
        Vec::new()
    };
    let viz::Report { text, lacks } = viz::report(&summary, &job, &run.parts, &damage, path)
        .map_err(|error| match error {
            viz::ReportError::Read(error) => Failure::Input(run.with_remedy(&error)),
            other => Failure::work(other),
        })?;
    Ok(Page {
        text,
        shortfall: (!lacks.is_empty()).then(|| run.with_remedy(&lacks.join("; "))),
    })
}
