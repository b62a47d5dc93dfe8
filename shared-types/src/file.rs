//! Reads TOML written by people: every error names the place, the mistake and the remedy.

mod words;

use std::fmt;
use std::ops::Range;

use serde::de::DeserializeOwned;
use toml::de::{DeTable, DeValue};

use words::explain;
pub use words::nearest;

/// A file that cannot be used, with the place and the remedy.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InvalidFile {
    /// The file's name as the user gave it.
    pub file: String,
    /// Its text, for showing the line.
    pub text: String,
    /// Place in the text, in bytes.
    pub span: Option<Range<usize>>,
    /// The defect.
    pub message: String,
    /// The remedy.
    pub remedy: String,
}

impl InvalidFile {
    /// The line the span starts on, from 1.
    #[must_use]
    pub fn line(&self) -> Option<usize> {
        let start = self.span.as_ref()?.start.min(self.text.len());
        Some(
            self.text.as_bytes()[..start]
                .iter()
                .filter(|&&byte| byte == b'\n')
                .count()
                + 1,
        )
    }
}

impl fmt::Display for InvalidFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.file)?;
        if let Some(line) = self.line() {
            write!(f, ":{line}")?;
        }
        write!(f, ": {}", self.message)?;
        if !self.remedy.is_empty() {
            write!(f, " ({})", self.remedy)?;
        }
        Ok(())
    }
}

impl std::error::Error for InvalidFile {}

/// A complaint about a value, by its path (`segment.2.duration_s`): found first, located in the text afterwards.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Complaint {
    /// Keys and indices, joined by dots.
    pub path: String,
    /// The defect.
    pub message: String,
    /// The remedy.
    pub remedy: String,
}

impl fmt::Display for Complaint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.path, self.message)?;
        if self.remedy.is_empty() {
            Ok(())
        } else {
            write!(f, " ({})", self.remedy)
        }
    }
}

impl Complaint {
    /// A complaint about the value at `path`.
    pub fn new(
        path: impl Into<String>,
        message: impl Into<String>,
        remedy: impl Into<String>,
    ) -> Self {
        Self {
            path: path.into(),
            message: message.into(),
            remedy: remedy.into(),
        }
    }

    /// The same complaint about a value inside `path`, or about that itself.
    #[must_use]
    pub fn within(self, path: &str) -> Self {
        let path = match &*self.path {
            "" => path.to_owned(),
            inner => format!("{path}.{inner}"),
        };
        Self { path, ..self }
    }

    /// Finds the place in the text, or the setting (`key.path=value`) that has laid a value over it: the last one for this key or for one around or
    /// inside it.
    #[must_use]
    pub fn locate_with(self, file: &str, text: &str, settings: &[String]) -> InvalidFile {
        let concerns = |setting: &&String| {
            let key = setting.split_once('=').map_or("", |(key, _)| key.trim());
            is_within(key, &self.path) || is_within(&self.path, key)
        };
        match settings.iter().rev().find(concerns) {
            Some(setting) => of_setting(setting, (self.message, self.remedy)),
            None => self.locate(file, text),
        }
    }

    /// Finds the place in the text.
    #[must_use]
    pub fn locate(self, file: &str, text: &str) -> InvalidFile {
        InvalidFile {
            file: file.to_owned(),
            text: text.to_owned(),
            span: span_of(text, &self.path),
            message: self.message,
            remedy: self.remedy,
        }
    }
}

/// Parses `text`, with `settings` (`key.path=value`, values as TOML or bare text) applied.
///
/// # Errors
/// [`InvalidFile`] for a syntax error, an unknown key, a wrong type, or a setting that does not fit.
pub fn parse<T: DeserializeOwned>(
    file: &str,
    text: &str,
    settings: &[String],
) -> Result<T, InvalidFile> {
    let invalid = |error: toml::de::Error| {
        let (message, remedy) = match text.trim_start().starts_with('{') {
            true => ("this is JSON".into(), "a file of armplane is TOML".into()),
            false => explain(error.message()),
        };
        // An error about a value, and not about the name of a key, which it tells itself.
        let key = error
            .span()
            .filter(|_| !message.contains('`') || message.ends_with("does not fit here"))
            .and_then(|span| key_at(text, &span));
        let message = key.map_or(message.clone(), |key| format!("`{key}`: {message}"));
        InvalidFile {
            file: file.to_owned(),
            text: text.to_owned(),
            span: error.span(),
            message,
            remedy,
        }
    };
    if settings.is_empty() {
        return toml::from_str(text).map_err(invalid);
    }
    let mut document: toml::Value = toml::from_str(text).map_err(invalid)?;
    // The original text is checked first, so that its own errors keep their lines.
    let mut made = Ok(toml::from_str(text).map_err(invalid)?);
    for setting in settings {
        lay_over(&mut document, setting).map_err(|reason| of_setting(setting, reason))?;
        made = match (made, document.clone().try_into::<T>()) {
            (_, Ok(fits)) => Ok(fits),
            (Ok(_), Err(error)) => Err(of_setting(setting, explain(error.message()))),
            // The first one since which it does not fit is to blame.
            (Err(first), Err(_)) => Err(first),
        };
    }
    made
}

fn of_setting(setting: &str, (message, remedy): (String, String)) -> InvalidFile {
    InvalidFile {
        file: format!("setting {setting}"),
        text: String::new(),
        span: None,
        message,
        remedy,
    }
}

fn lay_over(document: &mut toml::Value, setting: &str) -> Result<(), (String, String)> {
    let (path, value) = setting.split_once('=').ok_or_else(|| {
        (
            "a setting needs `=`".to_owned(),
            "write it as control.k_p=400".to_owned(),
        )
    })?;
    let value = toml::from_str::<toml::Table>(&format!("value = {value}"))
        .ok()
        .and_then(|mut parsed| parsed.remove("value"))
        .unwrap_or_else(|| toml::Value::String(value.to_owned()));
    let missing = |remedy: String| {
        (
            format!("`{path}` does not name a place in the file"),
            remedy,
        )
    };
    let keys: Vec<&str> = path.trim().split('.').collect();
    let first = keys[0];
    let second = keys.get(1);
    let is_element = second.is_some_and(|key| key.parse::<usize>().is_ok());
    if is_element && document.get(first).is_none() {
        // An element of a list that the file does not have.
        let known = document.as_table().map_or(Vec::new(), |table| {
            table.keys().map(String::as_str).collect()
        });
        let hint = nearest(first, known.into_iter());
        let hint = hint.map_or(String::new(), |name| format!(": did you mean `{name}`?"));
        return Err(missing(format!("the file has no [[{first}]]{hint}")));
    }
    let mut place = document;
    for key in keys {
        place = match place {
            toml::Value::Table(inner) => inner
                .entry(key)
                .or_insert_with(|| toml::Value::Table(toml::Table::new())),
            toml::Value::Array(items) => {
                let end = items.len().saturating_sub(1);
                let known = format!("this list has {first}.0 to {first}.{end}");
                let item = key.parse().ok().and_then(|i: usize| items.get_mut(i));
                item.ok_or_else(|| missing(known))?
            }
            _ => {
                let all = "the keys are those of the file: `armplane generate schema scenario` lists them";
                return Err(missing(all.to_owned()));
            }
        };
    }
    *place = value;
    Ok(())
}

/// Refuses a value that breaks a condition.
///
/// # Errors
/// [`Complaint`] with this message and remedy about the value at `path`.
pub fn require(
    holds: bool,
    path: impl Into<String>,
    message: impl Into<String>,
    remedy: impl Into<String>,
) -> Result<(), Complaint> {
    if holds {
        Ok(())
    } else {
        Err(Complaint::new(path, message, remedy))
    }
}

/// Checks each item of the list at `path`; the path of a complaint is relative to its item.
pub(crate) fn each<T>(
    path: &str,
    items: &[T],
    check: impl Fn(usize, &T) -> Result<(), Complaint>,
) -> Result<(), Complaint> {
    let mut items = items.iter().enumerate();
    items.try_for_each(|(i, item)| {
        check(i, item).map_err(|complaint| complaint.within(&format!("{path}.{i}")))
    })
}

/// Refuses a value that is not a positive finite number.
pub(crate) fn positive(path: &str, value: f64) -> Result<(), Complaint> {
    let is_positive = value.is_finite() && value > 0.0;
    require(
        is_positive,
        path,
        format!("`{path}` is {value}"),
        "it must be a positive number",
    )
}

/// Refuses a value that is not in a range; `what` has it in words.
pub(crate) fn within(
    path: &str,
    value: f64,
    range: std::ops::RangeInclusive<f64>,
    what: impl Into<String>,
) -> Result<(), Complaint> {
    let remedy = format!("it must be from {} to {}", range.start(), range.end());
    require(range.contains(&value), path, what, remedy)
}

/// Refuses the number of a key that is not in a range; `prefix` leads to the key.
pub(crate) fn key_within(
    prefix: &str,
    key: &str,
    value: f64,
    range: std::ops::RangeInclusive<f64>,
) -> Result<(), Complaint> {
    let path = format!("{prefix}{key}");
    within(&path, value, range, format!("`{key}` is {value}"))
}

/// The values of a text with their paths and places, each before those inside it; as far as it can be read, because the text itself may be the defect.
fn values(text: &str) -> Vec<(String, Range<usize>)> {
    fn look(path: &str, value: &DeValue<'_>, found: &mut Vec<(String, Range<usize>)>) {
        let mut inner = |key: &dyn fmt::Display, value: &toml::Spanned<DeValue<'_>>| {
            let path = match path {
                "" => key.to_string(),
                _ => format!("{path}.{key}"),
            };
            found.push((path.clone(), value.span()));
            look(&path, value.get_ref(), found);
        };
        match value {
            DeValue::Table(table) => table
                .iter()
                .for_each(|(key, value)| inner(key.get_ref(), value)),
            DeValue::Array(items) => items
                .iter()
                .enumerate()
                .for_each(|(index, value)| inner(&index, value)),
            _ => {}
        }
    }
    let (document, _) = DeTable::parse_recoverable(text);
    let mut found = Vec::new();
    look("", &DeValue::Table(document.into_inner()), &mut found);
    found
}

/// Place of the value at `path`, or of the nearest enclosing value that exists.
fn span_of(text: &str, path: &str) -> Option<Range<usize>> {
    let mut values = values(text).into_iter();
    let place = values.rfind(|(known, _)| is_within(path, known));
    place.map(|(_, span)| span)
}

/// Keys within each other that a sentence names.
const MOST_KEYS: usize = 6;

/// The key of the value that stands at a place in the text, with the keys around it. A table that has a header of its own does not enclose its values in
/// the text.
fn key_at(text: &str, place: &Range<usize>) -> Option<String> {
    let mut values = values(text).into_iter();
    let encloses = |span: &Range<usize>| span.start <= place.start && place.end <= span.end;
    let (mut key, _) = values.rfind(|(_, span)| encloses(span))?;
    // Of values within each other the first few tell which it is.
    if let Some((end, _)) = key.match_indices('.').nth(MOST_KEYS - 1) {
        key.truncate(end);
    }
    Some(key)
}

/// Whether a path leads to a value or into it.
fn is_within(inner: &str, outer: &str) -> bool {
    let rest = inner.strip_prefix(outer);
    rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;

    const TEXT: &str = "name = \"x\"\nrobot = \"puma560\"\n[start]\nposture = \"ready\"\n[[segment]]\nduration_s = 1.0\n";

    #[test]
    fn a_typo_names_its_line_and_the_right_word() {
        let text = TEXT.replace("duration_s", "duration");
        let error = parse::<Scenario>("a.toml", &text, &[]).unwrap_err();
        assert_eq!(error.line(), Some(6));
        assert_eq!(
            error.to_string(),
            "a.toml:6: unknown key `duration` (did you mean `duration_s`?)"
        );
    }

    #[test]
    fn a_value_that_does_not_fit_is_named_by_its_key() {
        let deep = format!("deep = {}1{}\n{TEXT}", "[".repeat(300), "]".repeat(300));
        let cases = [
            (TEXT.replace("= 1.0", "= true"), 6, "`segment.0.duration_s`"),
            (format!("rate_hz = 5000000000\n{TEXT}"), 1, "`rate_hz`"),
            (
                TEXT.replace("posture = \"ready\"", "q_deg = [1, \"b\"]"),
                4,
                "`start.q_deg.1`",
            ),
            (deep, 1, "`deep.0.0.0.0.0`"),
            (format!("seed = 99999999999999999999\n{TEXT}"), 1, "`seed`"),
        ];
        for (text, line, key) in cases {
            let error = parse::<Scenario>("a.toml", &text, &[]).unwrap_err();
            assert!(error.message.starts_with(key), "{error}");
            assert_eq!(error.line(), Some(line), "{error}");
        }
    }

    #[test]
    fn settings_are_laid_over() {
        let settings = [
            "seed=7",
            "control.k_p=100.0",
            "segment.0.duration_s=2.5",
            "robot=planar3r",
        ]
        .map(str::to_owned);
        let scenario: Scenario = parse("a.toml", TEXT, &settings).unwrap();
        assert_eq!(
            (
                scenario.seed,
                scenario.control.k_p,
                scenario.segment[0].duration_s
            ),
            (7, 100.0, 2.5)
        );
        assert_eq!(scenario.robot, "planar3r");
    }

    #[test]
    fn a_wrong_setting_is_refused_by_name() {
        for setting in ["control.kp=1.0", "segment.3.duration_s=1", "seed"] {
            let error = parse::<Scenario>("a.toml", TEXT, &[setting.to_owned()]).unwrap_err();
            assert_eq!(error.file, format!("setting {setting}"));
        }
    }

    #[test]
    fn complaints_find_their_line() {
        let line = |path| Complaint::new(path, "x", "").locate("a.toml", TEXT).line();
        let lines = ["segment.0.duration_s", "nowhere.at.all"].map(line);
        assert_eq!(lines, [Some(6), None]);
    }

    #[test]
    fn a_complaint_about_a_setting_names_the_setting() {
        let settings = [
            "segment.0.duration_s=2",
            "segment.0.duration_s=-1",
            "segment.01=3",
        ];
        let settings = settings.map(str::to_owned);
        let place = |path: &str| {
            let complaint = Complaint::new(path, "x", "");
            complaint.locate_with("a.toml", TEXT, &settings).file
        };
        let places = ["segment.0.duration_s", "segment.0", "segment.1.duration_s"].map(place);
        let last = "setting segment.0.duration_s=-1";
        assert_eq!(places, [last, last, "a.toml"]);
    }
}
