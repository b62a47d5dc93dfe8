//! Printing for people and pipes.

/// `println!`, but a reader that has gone away (`armplane run | head`) is no error.
macro_rules! say {
    ($($text:tt)*) => {{
        use std::io::Write as _;
        let _ = writeln!(std::io::stdout(), $($text)*);
    }};
}
pub(crate) use say;

/// Prints what ends its own lines.
pub(crate) fn show(text: &impl std::fmt::Display) {
    use std::io::Write as _;
    let _ = write!(std::io::stdout(), "{text}");
}

/// Prints a line on standard error; a terminal that has gone away is no error.
pub(crate) fn tell(line: &impl std::fmt::Display) {
    use std::io::Write as _;
    let _ = writeln!(std::io::stderr(), "{line}");
}
