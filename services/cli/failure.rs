//! What went wrong, as a person reads it, and the exit code that goes with it.

use std::process::ExitCode;

use miette::{LabeledSpan, MietteDiagnostic, NamedSource, Report};
use shared_types::file::InvalidFile;

/// Why a command did not succeed.
pub(crate) enum Failure {
    /// The user's input cannot be used: exit code 2, nothing was started.
    Input(String),
    /// The same, with the place in a file.
    File(Box<InvalidFile>),
    /// The work itself failed: exit code 1.
    Work(String),
}

impl Failure {
    /// A failure of the user's input.
    pub(crate) fn input(error: impl std::fmt::Display) -> Self {
        Self::Input(error.to_string())
    }

    /// A failure of the work.
    pub(crate) fn work(error: impl std::fmt::Display) -> Self {
        Self::Work(error.to_string())
    }

    /// Prints it on standard error and gives the exit code.
    pub(crate) fn report(self) -> ExitCode {
        match self {
            Self::Input(sentence) => {
                eprintln!("armplane: {sentence}");
                ExitCode::from(2)
            }
            Self::Work(sentence) => {
                eprintln!("armplane: {sentence}");
                ExitCode::from(1)
            }
            Self::File(error) => {
                eprintln!("armplane: {error}");
                if let Some(span) = error.span.clone() {
                    let label = LabeledSpan::at(span, error.remedy.clone());
                    let diagnostic = MietteDiagnostic::new(error.message.clone()).with_label(label);
                    eprintln!("{:?}", Report::from(diagnostic).with_source_code(NamedSource::new(&error.file, error.text.clone())));
                }
                ExitCode::from(2)
            }
        }
    }
}

impl From<InvalidFile> for Failure {
    fn from(error: InvalidFile) -> Self {
        Self::File(Box::new(error))
    }
}
