//! `docs/guarantees.md` names for each guarantee a command that tests it: each is one that cargo takes, and matches a test that runs.

use std::path::Path;

use crate::source::{self, File};
use crate::syntax::{functions, is};

/// A command `cargo test …` of the table: the target that it names, and its filters.
#[derive(Debug, PartialEq, Eq)]
struct Command {
    /// `lib`, or the name of an integration test.
    target: String,
    filters: Vec<String>,
}

/// Reads a command; the reason where cargo would not take it.
fn parse(text: &str) -> Result<Command, String> {
    let words = text.strip_prefix("cargo test").ok_or("it is no `cargo test`")?.split_whitespace();
    let (mut target, mut filters, mut is_behind) = (None, Vec::new(), false);
    let mut words = words.peekable();
    while let Some(word) = words.next() {
        match word {
            "--" => is_behind = true,
            "--release" | "--workspace" if !is_behind => {}
            "--lib" if !is_behind => target = Some("lib".to_owned()),
            "--test" if !is_behind => target = words.next().map(str::to_owned),
            _ if word.starts_with('-') => return Err(format!("{word} is not expected")),
            _ => filters.push(word.to_owned()),
        }
    }
    if filters.len() > 1 && !is_behind {
        return Err("cargo takes one filter; more of them stand behind `--`".to_owned());
    }
    Ok(Command { target: target.ok_or("it names no target")?, filters })
}

/// The names of the tests that run of a target's files, as its harness lists them.
fn tests<'a>(files: impl Iterator<Item = &'a File>) -> Vec<String> {
    let of = |file: &'a File| {
        let runs = |function: &crate::syntax::Function| {
            let is_ignored = function.attributes.iter().any(|attribute| attribute.first().is_some_and(|name| is(name, "ignore")));
            function.is_test() && !is_ignored
        };
        let names = functions(&file.tokens).into_iter().filter(runs).map(|function| function.name);
        names.map(|name| [&file.module[..], &[name]].concat().join("::")).collect::<Vec<_>>()
    };
    files.flat_map(of).collect()
}

/// The commands in backticks of a text.
fn commands(text: &str) -> Vec<&str> {
    text.split('`').skip(1).step_by(2).filter(|quoted| quoted.starts_with("cargo ")).collect()
}

#[test]
fn each_guarantee_has_a_command_that_runs_a_test() {
    let text = std::fs::read_to_string(source::root().join("docs/guarantees.md")).expect("the table");
    let workspace = source::workspace();
    let targets = || workspace.iter().flat_map(|package| &package.targets);
    let (mut rows, mut wrong) = (0, Vec::new());
    let is_row = |line: &&str| line.starts_with("| ") && !line.starts_with("| assumption");
    for row in text.lines().filter(is_row) {
        rows += 1;
        let test = row.split(" | ").nth(2).unwrap_or_default();
        if !(test.contains("`armplane ") || test.contains("`cargo test ") || test.starts_with("the same")) {
            wrong.push(format!("no command: {row}"));
        }
        for command in commands(test) {
            let Command { target, filters } = match parse(command) {
                Ok(command) => command,
                Err(reason) => {
                    wrong.push(format!("`{command}`: {reason}"));
                    continue;
                }
            };
            let is_meant = |one: &&source::Target| one.kind == "lib" && target == "lib" || one.kind == "test" && one.name == target;
            let names = tests(targets().filter(is_meant).flat_map(|target| &target.files));
            let unmatched = filters.iter().filter(|filter| !names.iter().any(|name| name.contains(filter.as_str())));
            wrong.extend(unmatched.map(|filter| format!("`{command}`: no test is called {filter}")));
            if filters.is_empty() {
                wrong.push(format!("`{command}` names no test"));
            }
        }
    }
    assert!(rows > 20, "{rows} rows: the check looks in the wrong place");
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn the_check_sees_a_command_that_tests_nothing() {
    let wrong = |text: &str| parse(text).unwrap_err();
    assert!(wrong("cargo test --test system life faults").contains("behind `--`") && wrong("cargo test life").contains("target"));
    let command = parse("cargo test --release --test system -- life faults").unwrap();
    assert_eq!(command, Command { target: "system".into(), filters: vec!["life".into(), "faults".into()] });
    assert_eq!(commands("`armplane drill`, or `cargo test --lib x`"), ["cargo test --lib x"]);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lib.rs");
    std::fs::write(&path, "#[test] fn runs() { assert!(f()); } #[test] #[ignore = \"long\"] fn waits() { assert!(f()); } fn helper() {}")
        .unwrap();
    assert_eq!(tests(source::files_of(Path::new(&path), false).iter()), ["runs"]);
}
