//! Each equation of the paper is cited where it is computed, `[CK95 Eq. 4]`, and checked by a test that says so:
//! `// covers: CK95 Eq. 4 (operational_space::Operational::new)`, the file, the type and the function.

use std::collections::BTreeSet;

use crate::{File, Package, text, workspace};

const FIGURES: [&str; 5] = ["Figure 1", "Figure 2", "Figure 3", "Figure 4", "Figure 5"];

/// The name at the beginning of a text.
fn name(text: &str) -> &str {
    let is_end = |letter: char| !(letter.is_alphanumeric() || letter == '_');
    text.split(is_end).next().unwrap_or_default()
}

/// The type of an `impl` line without indentation.
fn type_of_impl(line: &str) -> Option<&str> {
    let rest = line.strip_prefix("impl")?;
    let rest = rest
        .split_once("> ")
        .filter(|_| rest.starts_with('<'))
        .map_or(rest, |(_, rest)| rest);
    let owner = rest.rsplit_once(" for ").map_or(rest, |(_, owner)| owner);
    Some(name(owner.trim_start()))
}

/// The numbers in `[CK95 Eq. 4]`, `[CK95 Eq. 3, Eq. 5]` and `[CK95 Eq. 3 to 5]`; between backticks the form is only explained.
fn equations(line: &str) -> Vec<String> {
    let plain: String = line.split('`').step_by(2).collect();
    let cited = plain
        .split("[CK95 ")
        .skip(1)
        .filter_map(|rest| rest.split_once(']'));
    let mut found = Vec::new();
    for part in cited.flat_map(|(cited, _)| cited.split(", ")) {
        let numbers = part.strip_prefix("Eq. ").unwrap_or_default().split(" to ");
        let numbers: Vec<u32> = numbers.filter_map(|number| number.parse().ok()).collect();
        if let (Some(first), Some(last)) = (numbers.first(), numbers.last()) {
            found.extend((*first..=*last).map(|number| format!("Eq. {number}")));
        }
    }
    found
}

/// A formula that stands at no function is tied to no code: each citation is in the comment of a function, whose place it becomes.
fn cited(file: &File, wrong: &mut Vec<String>) -> BTreeSet<(String, String)> {
    let stem = file.path.rsplit('/').next().unwrap_or_default();
    let stem = stem.trim_end_matches(".rs");
    let (mut owner, mut found, lines) =
        ("", BTreeSet::new(), file.text.lines().collect::<Vec<_>>());
    for (at, line) in lines.iter().enumerate() {
        if !line.starts_with(' ') {
            let is_end = line.starts_with('}');
            owner = type_of_impl(line).unwrap_or(if is_end { "" } else { owner });
        }
        for equation in equations(line) {
            let is_head = |line: &&&str| {
                ["///", "#["]
                    .iter()
                    .any(|mark| line.trim_start().starts_with(mark))
            };
            let code = lines[at..].iter().find(|line| !is_head(line));
            let function = code.and_then(|line| Some(name(line.split_once("fn ")?.1)));
            let owner = if owner.is_empty() {
                String::new()
            } else {
                format!("{owner}::")
            };
            match function {
                Some(function) => {
                    found.insert((equation, format!("{stem}::{owner}{function}")));
                }
                None => wrong.push(format!(
                    "{}:{}: {equation} stands at no function",
                    file.path,
                    at + 1
                )),
            }
        }
    }
    found
}

/// A comment alone checks nothing: a test follows, and asserts.
fn is_checked(lines: &[&str]) -> bool {
    let head = lines
        .iter()
        .take(8)
        .position(|line| line.trim() == "#[test]" || line.starts_with("def test_"));
    let Some(head) = head else { return false };
    if lines[head].starts_with("def ") {
        let mut body = lines[head + 1..].iter();
        return body
            .by_ref()
            .take_while(|line| line.starts_with(' '))
            .any(|line| line.contains("assert"));
    }
    let indent = lines[head].len() - lines[head].trim_start().len();
    let end = format!("{}}}", " ".repeat(indent));
    let body = lines[head..].iter().take_while(|line| **line != end);
    body.into_iter().any(|line| line.contains("assert"))
}

/// What the `// covers: CK95 …` comments of a file name; figures without a place.
fn covered(file: &File, wrong: &mut Vec<String>) -> BTreeSet<(String, String)> {
    let (mut found, lines) = (BTreeSet::new(), file.text.lines().collect::<Vec<_>>());
    for (at, line) in lines.iter().enumerate() {
        let line = line.trim_start().trim_start_matches(['/', '#']);
        let Some(what) = line.strip_prefix(" covers: CK95 ") else {
            continue;
        };
        if !is_checked(&lines[at..]) {
            wrong.push(format!(
                "{}:{}: no test that asserts follows",
                file.path,
                at + 1
            ));
        }
        let numbers = what.split(|letter: char| !letter.is_ascii_digit());
        if what.starts_with("Figure") {
            let figures = numbers.filter(|number| !number.is_empty());
            found.extend(figures.map(|number| (format!("Figure {number}"), String::new())));
        } else if let Some((equation, place)) = what.trim_end_matches(')').split_once(" (") {
            found.extend(
                place
                    .split(", ")
                    .map(|one| (equation.to_owned(), one.to_owned())),
            );
        } else {
            wrong.push(format!("{}:{}: no place in parentheses", file.path, at + 1));
        }
    }
    found
}

/// A figure is reproduced by a scenario that says so, or drawn by a study, and a test holds its numbers.
fn figures() -> BTreeSet<(String, String)> {
    let scenarios = std::fs::read_dir(crate::root().join("sim/scenarios")).expect("the folder");
    let mut pages: Vec<String> = scenarios
        .flatten()
        .map(|entry| text(entry.path()))
        .collect();
    pages.push(text("python/armplane/experiments/paper.py"));
    let is_shown = |figure: &&str| {
        let line = format!("Chang & Khatib 1995, {figure}.");
        pages.iter().any(|page| page.contains(&line))
    };
    let shown = FIGURES.iter().copied().filter(is_shown);
    shown
        .map(|figure| (figure.to_owned(), String::new()))
        .collect()
}

/// The paper is the program's specification: every equation and figure is there, each citation has a test, and no test covers what nothing cites.
#[test]
fn each_equation_and_figure_of_the_paper_is_tied_to_a_test() {
    let (mut cites, mut covers, mut wrong) = (figures(), BTreeSet::new(), Vec::new());
    let mut files: Vec<File> = workspace().iter().flat_map(Package::sources).collect();
    files.extend(crate::rust_files("tests/system"));
    let python = "python/tests/test_experiments.py";
    files.push(File {
        path: python.to_owned(),
        text: text(python),
    });
    for file in &files {
        cites.extend(cited(file, &mut wrong));
        covers.extend(covered(file, &mut wrong));
    }
    let equations = (1..=5).map(|number| format!("Eq. {number}"));
    let items: Vec<String> = equations.chain(FIGURES.map(str::to_owned)).collect();
    let missing = items
        .iter()
        .filter(|item| !cites.iter().any(|(cited, _)| cited == *item));
    wrong.extend(missing.map(|item| format!("nothing cites {item}")));
    let untested = cites.difference(&covers);
    wrong.extend(untested.map(|(item, place)| format!("no test covers {item} {place}")));
    let stale = covers.difference(&cites);
    wrong.extend(stale.map(|(item, place)| format!("covered, but not cited: {item} {place}")));
    assert!(wrong.is_empty(), "{wrong:#?}");
}
