//! Why an operation on a run failed.

use std::path::Path;

use shared_types::file::InvalidFile;

/// Why an operation did not succeed.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// The user's input cannot be used; nothing was started.
    #[error("{0}")]
    Input(String),
    /// The user's input cannot be used, with the place in a file.
    #[error("{0}")]
    File(Box<InvalidFile>),
    /// The work itself failed.
    #[error("{0}")]
    Work(String),
}

impl Failure {
    /// A failure of the user's input.
    pub fn input(error: impl std::fmt::Display) -> Self {
        Self::Input(error.to_string())
    }

    /// A file, folder or program that the system keeps this program from writing, making, removing or starting.
    pub fn cannot<E: std::fmt::Display>(verb: &str, path: &Path) -> impl FnOnce(E) -> Self {
        move |error| Self::Work(format!("cannot {verb} {}: {error}", path.display()))
    }

    /// A failure of the work.
    pub fn work(error: impl std::fmt::Display) -> Self {
        Self::Work(error.to_string())
    }
}

impl From<InvalidFile> for Failure {
    fn from(error: InvalidFile) -> Self {
        Self::File(Box::new(error))
    }
}
