//! A line on standard error.

use std::fmt::Display;
use std::io::Write as _;

/// Writes a line on standard error; where that is closed or full, nothing: a process does not end because nobody can read it.
pub fn complain(words: &impl Display) {
    let _ = writeln!(std::io::stderr().lock(), "{words}");
}
