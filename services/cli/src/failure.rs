//! The exit code of a failed command, and its error as a person or a machine reads it.

use std::io::{stderr, stdout};
use std::process::ExitCode;

use clap::error::ErrorKind;
use miette::{LabeledSpan, MietteDiagnostic, MietteHandlerOpts, NamedSource, Report};
use serde_json::json;
use session::Failure;

use crate::out::{self, is_coloured, plain, show_painted, tell, tell_painted};
use crate::usage;

/// Most characters of a sentence, or of a line of a file, that are printed: more can no longer be read.
const LONGEST: usize = 4000;

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
    tell_sentence(&failure.to_string());
    if let Failure::File(error) = failure
        && let Some(span) = error.span.clone()
        // The lines around the place are shown whole.
        && error.text.lines().all(|line| line.len() <= LONGEST)
    {
        if !is_coloured(&stderr()) {
            // It fails where a hook is set already.
            let _ = miette::set_hook(Box::new(|_| {
                Box::new(MietteHandlerOpts::new().color(false).build())
            }));
        }
        // The file's own codes are left out before colours are added, so its places move.
        let moved = |at| error.text.get(..at).map_or(at, |text| plain(text).len());
        let span = moved(span.start)..moved(span.end);
        let report = Report::from(
            MietteDiagnostic::new("").with_label(LabeledSpan::new_with_span(None, span)),
        );
        let source = NamedSource::new(plain(&error.file), plain(&error.text));
        let shown = format!("{:?}", report.with_source_code(source));
        // The sentence stands above the file's lines, which begin with a frame.
        let frame = shown.lines().skip_while(|line| !line.contains('╭'));
        tell_painted(&frame.collect::<Vec<_>>().join("\n"));
    }
    ExitCode::from(code)
}

/// Prints a sentence on what went wrong.
fn tell_sentence(text: &str) {
    // Only indented lines follow a sentence: a name in it with a line's end could pass for a message of ours.
    let text = plain(text).replace('\n', "\\n").replace("\\n  ", "\n  ");
    let text = match text.char_indices().nth(LONGEST) {
        Some((at, _)) => format!("{} … ({} bytes in all)", &text[..at], text.len()),
        None => text,
    };
    tell(&format_args!("armplane: {text}"));
}

/// Prints what is wrong with a command's arguments, or the help that was asked for.
pub(crate) fn usage(error: &clap::Error, command: &clap::Command) -> ExitCode {
    let code = u8::try_from(error.exit_code()).unwrap_or(2);
    let is_help = error.kind() == ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand;
    if !is_help && error.use_stderr() {
        let words = std::env::args_os().skip(1);
        let words: Vec<String> = words
            .map(|word| word.to_string_lossy().into_owned())
            .collect();
        let sentence = usage::sentence(error, command, &words);
        match out::wants_json() {
            true => tell(
                &json!({"error": {"kind": "usage", "exit_code": code, "message": plain(&sentence)}}),
            ),
            false => tell_sentence(&sentence),
        }
        return ExitCode::from(code);
    }
    let styled = error.render();
    let painted = |is_coloured: bool| match is_coloured {
        true => styled.ansi().to_string(),
        false => plain(&styled.to_string()),
    };
    match error.use_stderr() {
        true => tell_painted(&painted(is_coloured(&stderr())).trim_end()),
        false => show_painted(&painted(is_coloured(&stdout()))),
    }
    ExitCode::from(code)
}
