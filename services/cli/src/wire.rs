//! `armplane wire`: the wire for programs in other languages.

use std::process::ExitCode;

use clap::{Args, ValueEnum};
use exchange::describe;
use session::Failure;

use crate::out::say;

#[derive(Args)]
pub(crate) struct WireArgs {
    /// The language.
    #[arg(long, value_enum, default_value = "json")]
    lang: Language,
}

#[derive(Clone, Copy, ValueEnum)]
enum Language {
    /// Structures, topics, codes and constants as one document.
    Json,
    /// A header for C11 and C++11, with the program's side of an exchange page.
    C,
    /// The module `wire` of the Python package: ctypes structures.
    Python,
}

pub(crate) fn wire(args: &WireArgs) -> Result<ExitCode, Failure> {
    let text = match args.lang {
        Language::Json => describe::json(),
        Language::C => describe::c(),
        Language::Python => describe::python(),
    };
    say!("{}", text.trim_end());
    Ok(ExitCode::SUCCESS)
}
