//! The end of a run: a signal ends the experiment with it.

use launcher::{End, Failure as Mishap, Interrupts};
use session::Failure;

fn stopped(signal: &str) -> Failure {
    Failure::Work(format!("stopped by {signal}"))
}

/// # Errors
/// [`Failure::Work`] where a signal has come.
pub(crate) fn check(signals: &mut Interrupts) -> Result<(), Failure> {
    signals
        .pending()
        .map_or(Ok(()), |signal| Err(stopped(signal)))
}

/// Why a run ended before its task did, if it did.
///
/// # Errors
/// [`Failure::Work`] where a signal has ended it.
pub(crate) fn mishap(end: &End) -> Result<Option<&Mishap>, Failure> {
    match end {
        End::Completed => Ok(None),
        End::Failed(mishap) => Ok(Some(mishap)),
        End::Interrupted { signal } => Err(stopped(signal)),
    }
}
