//! Why a turn ends before the run does.

use runtime::{Interrupted, ProcessError};

use crate::failure::Failure;

/// Early end of a process, by itself or by its program.
pub(crate) enum Ended {
    Ours(ProcessError),
    Theirs(Failure),
}

impl From<ProcessError> for Ended {
    fn from(error: ProcessError) -> Self {
        Self::Ours(error)
    }
}

impl From<Interrupted> for Ended {
    fn from(error: Interrupted) -> Self {
        Self::Ours(error.into())
    }
}
