//! The exit code of a failed command, and its error as a person or a machine reads it.

use std::io::IsTerminal as _;
use std::process::ExitCode;

use miette::{LabeledSpan, MietteDiagnostic, NamedSource, Report};
use serde_json::json;
use session::Failure;

use crate::out::{show, show_painted, tell, tell_painted};

/// Prints a failure on standard error and gives the exit code: 2 for input that cannot be used, 1 for work that failed. For machines it is one JSON
/// object on one line.
pub(crate) fn report(failure: Failure, as_json: bool) -> ExitCode {
    let (kind, code) = match failure {
        Failure::Work(_) => ("work", 1_u8),
        Failure::Input(_) | Failure::File(_) => ("input", 2),
    };
    if as_json {
        let place = match &failure {
            Failure::File(error) => {
                json!({"file": error.file, "line": error.line(), "remedy": error.remedy})
            }
            _ => json!(null),
        };
        tell(
            &json!({"error": {"kind": kind, "exit_code": code, "message": failure.to_string(), "place": place}}),
        );
        return ExitCode::from(code);
    }
    tell(&format_args!("armplane: {failure}"));
    if let Failure::File(error) = failure
        && let Some(span) = error.span.clone()
    {
        let label = LabeledSpan::new_with_span(
            (!error.remedy.is_empty()).then(|| error.remedy.clone()),
            span,
        );
        let diagnostic = MietteDiagnostic::new(error.message.clone()).with_label(label);
        tell_painted(&format_args!(
            "{:?}",
            Report::from(diagnostic)
                .with_source_code(NamedSource::new(&error.file, error.text.clone()))
        ));
    }
    ExitCode::from(code)
}

/// Whether the arguments ask for JSON, before they are parsed, or where they cannot be.
pub(crate) fn wants_json() -> bool {
    std::env::args_os().any(|argument| argument == "--json")
}

/// Prints what is wrong with a command's arguments, or the help that was asked for.
pub(crate) fn usage(error: &clap::Error) -> ExitCode {
    let code = u8::try_from(error.exit_code()).unwrap_or(2);
    if !error.use_stderr() {
        let text = error.render();
        if std::io::stdout().is_terminal() {
            show_painted(&text.ansi());
        } else {
            show(&text);
        }
    } else if wants_json() {
        let text = with_remedy(&error.render().to_string());
        let message = text
            .split("\n\n")
            .next()
            .unwrap_or_default()
            .trim_start_matches("error: ");
        tell(&json!({"error": {"kind": "usage", "exit_code": code, "message": message}}));
    } else {
        let styled = error.render();
        let text = if std::io::stderr().is_terminal() {
            styled.ansi().to_string()
        } else {
            styled.to_string()
        };
        tell_painted(&with_remedy(&text).trim_end());
    }
    ExitCode::from(code)
}

/// The standard library's words for a text that is no number, with the remedy in their place.
fn with_remedy(text: &str) -> String {
    [
        ("invalid digit found in string", "give a whole number"),
        (
            "cannot parse integer from empty string",
            "give a whole number",
        ),
        (
            "number too large to fit in target type",
            "give a smaller number",
        ),
        ("invalid float literal", "give a number"),
        ("cannot parse float from empty string", "give a number"),
    ]
    .iter()
    .fold(text.to_owned(), |text, (words, remedy)| {
        text.replace(words, remedy)
    })
}
