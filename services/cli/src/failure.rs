//! The exit code of a failed command, and its error as a person reads it.

use std::process::ExitCode;

use miette::{LabeledSpan, MietteDiagnostic, NamedSource, Report};
use session::Failure;

/// Prints a failure on standard error and gives the exit code: 2 for input that cannot be used, 1 for work that failed.
pub(crate) fn report(failure: Failure) -> ExitCode {
    eprintln!("armplane: {failure}");
    match failure {
        Failure::Work(_) => ExitCode::from(1),
        Failure::Input(_) => ExitCode::from(2),
        Failure::File(error) => {
            if let Some(span) = error.span.clone() {
                let label = LabeledSpan::at(span, error.remedy.clone());
                let diagnostic = MietteDiagnostic::new(error.message.clone()).with_label(label);
                eprintln!("{:?}", Report::from(diagnostic).with_source_code(NamedSource::new(&error.file, error.text.clone())));
            }
            ExitCode::from(2)
        }
    }
}
