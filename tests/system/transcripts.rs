//! Sessions at a shell with what must come of each command, in `tests/transcripts`, whose README has the notation: a test for each file.

use std::cmp::Ordering;
use std::str::FromStr;

use serde_json::Value;

use crate::command::{Desk, Said, root, skipped, source};

macro_rules! transcripts {
    ($($name:ident)*) => {
        $(#[test]
        fn $name() {
            play(stringify!($name));
        })*
        const ALL: &[&str] = &[$(stringify!($name)),*];
    };
}

transcripts!(
    account bad_input bench clients compare cuts damage deaths door ends faults first_minutes foreign graph honesty inspect limits pipes programs
    recording replay schema servo top trials verify wire
);

#[test]
fn each_file_of_the_folder_is_a_test() {
    let entries = std::fs::read_dir(root().join("tests/transcripts")).expect("the folder");
    let names = entries.flatten().map(|entry| entry.file_name());
    let names: Vec<_> = names
        .filter_map(|name| Some(name.to_str()?.strip_suffix(".txt")?.to_owned()))
        .collect();
    assert!(
        names.len() == ALL.len() && names.iter().all(|name| ALL.contains(&&**name)),
        "{names:?}"
    );
}

/// A line, and the indented ones below it.
#[derive(Clone, Debug)]
struct Step {
    line: String,
    block: String,
}

/// The commands so far, with their names: of its own case.
struct Session {
    desk: Desk,
    said: Vec<(String, Said)>,
}

fn play(name: &str) {
    let text = source(&format!("tests/transcripts/{name}.txt"));
    for case in text.split("\n== ").skip(1) {
        let (title, body) = case.split_once('\n').expect("a case has lines");
        for steps in filled(steps(body)) {
            let mut session = Session {
                desk: Desk::new(),
                said: Vec::new(),
            };
            eprintln!("{name}: {title}");
            session.play(&steps);
        }
    }
}

fn steps(body: &str) -> Vec<Step> {
    let mut steps: Vec<Step> = Vec::new();
    for line in body.lines().filter(|line| !line.starts_with('#')) {
        let inner = line
            .strip_prefix("    ")
            .or((line.is_empty()).then_some(line));
        match (inner, steps.last_mut()) {
            (Some(inner), Some(step)) => step.block += &format!("{inner}\n"),
            _ if line.is_empty() => {}
            _ => steps.push(Step {
                line: line.to_owned(),
                block: String::new(),
            }),
        }
    }
    steps
}

/// The steps once, or for each row of a table that they begin with, whose values replace the names of its columns.
fn filled(steps: Vec<Step>) -> Vec<Vec<Step>> {
    let Some((head, names)) = steps
        .first()
        .and_then(|step| Some((step, step.line.strip_prefix("each ")?)))
    else {
        return vec![steps];
    };
    let rows = head.block.lines().filter(|row| !row.is_empty());
    rows.map(|row| {
        let values = || names.split(" | ").zip(row.split(" | "));
        let fill = |text: &str| {
            values().fold(text.to_owned(), |text, (name, value)| {
                text.replace(&format!("{{{name}}}"), value.trim())
            })
        };
        steps[1..]
            .iter()
            .map(|step| Step {
                line: fill(&step.line),
                block: fill(&step.block),
            })
            .collect()
    })
    .collect()
}

impl Session {
    fn play(&mut self, steps: &[Step]) {
        let mut is_left_out = false;
        for (at, Step { line, block }) in steps.iter().enumerate() {
            let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
            if word == "needs" {
                is_left_out = self.desk.shell(rest).code != 0;
                if is_left_out {
                    skipped(format!("there is no `{rest}`"));
                }
            } else if is_left_out {
            } else if word == "@" {
                self.desk.file(rest, block);
            } else if let Some(name) = word.strip_suffix('$') {
                let said = self.desk.shell(&format!("{rest}\n{block}"));
                let code = steps
                    .get(at + 1)
                    .and_then(|next| next.line.split(' ').next()?.parse().ok())
                    .unwrap_or(0);
                let is_expected = said.code == code && !said.err.contains("panicked");
                assert!(
                    is_expected,
                    "{line}: {}, not {code}: {}{}",
                    said.code, said.out, said.err
                );
                self.said.push((name.to_owned(), said));
            } else if word.parse::<i32>().is_ok() {
                let err = &self.said.last().expect("a command").1.err;
                assert!(
                    rest.split_whitespace().all(|name| err.contains(name)),
                    "{line}: {err}"
                );
            } else {
                self.check(line);
            }
        }
    }

    /// `PATH OPERATOR VALUE`; both may be sums.
    fn check(&self, line: &str) {
        let words: Vec<_> = line.split(' ').collect();
        let is_operator = |word: &&str| OPERATORS.contains(word);
        let at = words.iter().position(is_operator);
        let at = at.unwrap_or_else(|| panic!("no step: {line}"));
        let wanted = words[at + 1..].join(" ");
        let wanted = match serde_json::from_str(&wanted) {
            Ok(json) => json,
            Err(_) => self.sum(&wanted).swap_remove(0),
        };
        let all = self.sum(&words[..at].join(" "));
        assert!(!all.is_empty(), "{line}: none");
        for found in all {
            let order = found.as_f64().partial_cmp(&wanted.as_f64());
            let order = order.filter(|_| found.is_number() && wanted.is_number());
            let is_so = match words[at] {
                "=" => is_equal(&found, &wanted),
                "!=" => !is_equal(&found, &wanted),
                "<" => order.is_some_and(Ordering::is_lt),
                "<=" => order.is_some_and(Ordering::is_le),
                ">" => order.is_some_and(Ordering::is_gt),
                ">=" => order.is_some_and(Ordering::is_ge),
                "in" => has(&wanted, &found),
                "has" => has(&found, &wanted),
                _ => !has(&found, &wanted),
            };
            assert!(is_so, "{line}: {found}, not {wanted}");
        }
    }

    /// The values that a path names, or the sum of numbers and of what several paths name.
    fn sum(&self, text: &str) -> Vec<Value> {
        let number = |term| Some(vec![Value::from(f64::from_str(term).ok()?)]);
        let term = |term| number(term).unwrap_or_else(|| self.found(term));
        let mut terms: Vec<_> = text.split(" + ").map(term).collect();
        if terms.len() == 1 {
            return terms.remove(0);
        }
        let numbers = terms.iter().flatten().filter_map(Value::as_f64);
        vec![numbers.sum::<f64>().into()]
    }

    /// The values that a path names: of the last command, or of the one in front of its colon.
    fn found(&self, path: &str) -> Vec<Value> {
        let (name, path) = path.split_once(':').unwrap_or(("", path));
        let mut commands = self.said.iter().rev();
        let found = commands.find(|one| name.is_empty() || one.0 == name);
        let (_, said) = found.unwrap_or_else(|| panic!("no command {name}"));
        let (first, rest) = path.split_once('/').unwrap_or((path, ""));
        match first {
            "out" => parts(&said.out.clone().into(), rest),
            "err" => parts(&said.err.clone().into(), rest),
            _ => parts(&json(said), path),
        }
    }
}

const OPERATORS: [&str; 9] = ["=", "!=", "<", "<=", ">", ">=", "in", "has", "lacks"];

/// Its output for machines: a list where there is more than one line of it.
fn json(said: &Said) -> Value {
    let lines = serde_json::Deserializer::from_str(&said.out).into_iter();
    let mut all: Vec<Value> = lines
        .map(|line| line.unwrap_or_else(|error| panic!("{error}: {}{}", said.out, said.err)))
        .collect();
    match all.len() {
        1 => all.remove(0),
        _ => all.into(),
    }
}

/// The parts of a value at a path: `faults/0/kind`; `faults/#`, how many there are, of a text its lines; `faults/*/kind`, each.
fn parts(value: &Value, path: &str) -> Vec<Value> {
    let (key, rest) = path.split_once('/').unwrap_or((path, ""));
    match (key, value) {
        ("", _) => vec![value.clone()],
        ("#", Value::Array(list)) => vec![list.len().into()],
        ("#", Value::Object(map)) => vec![map.len().into()],
        ("#", Value::String(text)) => vec![text.lines().count().into()],
        ("*", Value::Array(list)) => list.iter().flat_map(|one| parts(one, rest)).collect(),
        ("*", Value::Object(map)) => map.values().flat_map(|one| parts(one, rest)).collect(),
        _ => parts(
            value.pointer(&format!("/{key}")).unwrap_or(&Value::Null),
            rest,
        ),
    }
}

fn is_equal(a: &Value, b: &Value) -> bool {
    a == b || a.is_number() && a.as_f64() == b.as_f64()
}

/// Whether a text has another one in it, or a list a value that is equal, or that has these parts.
fn has(value: &Value, wanted: &Value) -> bool {
    let is_it = |one: &Value| match wanted {
        Value::Object(all) => all
            .iter()
            .all(|(path, wanted)| is_equal(&parts(one, path)[0], wanted)),
        _ => is_equal(one, wanted),
    };
    match (value, wanted) {
        (Value::String(text), Value::String(wanted)) => text.contains(&**wanted),
        (Value::Array(list), _) => list.iter().any(is_it),
        _ => is_it(value),
    }
}
