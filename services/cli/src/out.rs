//! Printing for people and pipes. Text of other programs may be in all of it (their last words, names, reasons), and with it codes that a terminal obeys: no
//! control character reaches the terminal but the ends of lines, tabs, and where this program paints, colours.

use std::borrow::Cow;
use std::fmt::Write as _;

/// `println!`, but a reader that has gone away (`armplane run | head`) is no error.
macro_rules! say {
    ($($text:tt)*) => {{
        $crate::out::show(&format_args!("{}\n", format_args!($($text)*)));
    }};
}
pub(crate) use say;

/// Prints what ends its own lines.
pub(crate) fn show(text: &impl std::fmt::Display) {
    use std::io::Write as _;
    let _ = std::io::stdout().write_all(plain(&text.to_string()).as_bytes());
}

/// Prints a line on standard error; a terminal that has gone away is no error.
pub(crate) fn tell(line: &impl std::fmt::Display) {
    use std::io::Write as _;
    let _ = std::io::stderr().write_all(plain(&format!("{line}\n")).as_bytes());
}

/// The same of a line that is painted.
pub(crate) fn tell_painted(line: &impl std::fmt::Display) {
    use std::io::Write as _;
    let _ = std::io::stderr().write_all(painted(&format!("{line}\n")).as_bytes());
}

/// A text without control characters: each is written as JSON writes it (`\u001b`), so that JSON stays JSON.
pub(crate) fn plain(text: &str) -> Cow<'_, str> {
    escaped(text, |_| 0)
}

/// The same of a text in which colours may be.
pub(crate) fn painted(text: &str) -> Cow<'_, str> {
    /// Bytes of the colour (ESC [ numbers m) at the beginning of a text; 0 where there is none.
    fn colour(text: &str) -> usize {
        let Some(rest) = text.strip_prefix("\x1b[") else {
            return 0;
        };
        let numbers = rest
            .find(|letter: char| !(letter.is_ascii_digit() || letter == ';'))
            .unwrap_or(rest.len());
        if rest[numbers..].starts_with('m') {
            text.len() - rest.len() + numbers + 1
        } else {
            0
        }
    }
    escaped(text, colour)
}

/// A text with its control characters escaped but for the ends of lines, tabs, and as many bytes as `kept` wants from a place on.
fn escaped(text: &str, kept: fn(&str) -> usize) -> Cow<'_, str> {
    let is_code = |letter: char| letter.is_control() && !matches!(letter, '\n' | '\t');
    if !text.contains(is_code) {
        return Cow::Borrowed(text);
    }
    let (mut written, mut rest) = (String::with_capacity(text.len() + 16), text);
    while let Some(at) = rest.find(is_code) {
        let (before, code) = rest.split_at(at);
        written.push_str(before);
        let (keep, one) = (kept(code), code.chars().next().map_or(0, char::len_utf8));
        if keep > 0 {
            written.push_str(&code[..keep]);
        } else {
            // Writing to a string does not fail.
            let _ = write!(
                written,
                "\\u{:04x}",
                code.chars().next().map_or(0, u32::from)
            );
        }
        rest = &code[keep.max(one)..];
    }
    written.push_str(rest);
    Cow::Owned(written)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_code_that_a_terminal_obeys_is_left_but_colours_where_they_are_painted() {
        let hostile =
            "a\x1b]0;title\x07\x1b[2Jb\u{9b}31m\x7f\r\tend\n\x1b[1;31mred\x1b[0m\x1b[\x1b[3";
        let all = "a\\u001b]0;title\\u0007\\u001b[2Jb\\u009b31m\\u007f\\u000d\tend\n";
        assert_eq!(
            plain(hostile),
            format!("{all}\\u001b[1;31mred\\u001b[0m\\u001b[\\u001b[3")
        );
        assert_eq!(
            painted(hostile),
            format!("{all}\x1b[1;31mred\x1b[0m\\u001b[\\u001b[3")
        );
        let json = serde_json::json!({"reason": "\u{9b}\x7f\x1b"}).to_string();
        assert_eq!(
            serde_json::from_str::<serde_json::Value>(&plain(&json)).unwrap()["reason"],
            "\u{9b}\x7f\x1b",
            "JSON reads back"
        );
        assert!(matches!(plain("ζ = (0, 1)\n"), Cow::Borrowed(_)));
    }
}
