//! `docs/guarantees.md` names for each guarantee a command that tests it: each is one that cargo takes and that matches
//! a test that runs, or one that `armplane` takes, as all commands of the documentation are.

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
    let words = text
        .strip_prefix("cargo test")
        .ok_or("it is no `cargo test`")?
        .split_whitespace();
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
    Ok(Command {
        target: target.ok_or("it names no target")?,
        filters,
    })
}

/// The names of the tests that run of a target's files, as its harness lists them.
fn tests<'a>(files: impl Iterator<Item = &'a File>) -> Vec<String> {
    let of = |file: &'a File| {
        let runs = |function: &crate::syntax::Function| {
            let is_ignored = function
                .attributes
                .iter()
                .any(|attribute| attribute.first().is_some_and(|name| is(name, "ignore")));
            function.is_test() && !is_ignored
        };
        let names = functions(&file.tokens)
            .into_iter()
            .filter(runs)
            .map(|function| function.name);
        names
            .map(|name| [&file.module[..], &[name]].concat().join("::"))
            .collect::<Vec<_>>()
    };
    files.flat_map(of).collect()
}

/// The commands in backticks of a text that begin so.
fn commands<'a>(text: &'a str, program: &'a str) -> impl Iterator<Item = &'a str> {
    text.split('`')
        .skip(1)
        .step_by(2)
        .filter(move |quoted| quoted.starts_with(program))
}

/// The commands of `armplane` in a text: in backticks, or a line each. Options in backticks behind one (`--without hold`) are tried with it.
fn own_commands(text: &str) -> Vec<String> {
    let (mut found, mut last, mut is_fenced) = (Vec::new(), "", false);
    for line in text.lines() {
        is_fenced ^= line.trim_start().starts_with("```");
        let is_code = is_fenced || line.starts_with("    ");
        let own_line = Some(line.trim_start()).filter(|line| is_code && !line.contains('`'));
        for quoted in line.split('`').skip(1).step_by(2).chain(own_line) {
            if quoted.starts_with("armplane ") {
                last = quoted;
                found.push(quoted.to_owned());
            } else if quoted.starts_with("--") && quoted.contains(' ') && !last.is_empty() {
                found.push(format!("{last} {quoted}"));
            }
        }
        last = "";
    }
    found
}

/// The arguments of a command as a shell splits them, up to a comment, a redirection, the next command, or what may stand there (`[RUN]`, `a|b`).
fn arguments(command: &str) -> Vec<String> {
    let (mut words, mut is_quoted) = (vec![String::new()], false);
    for letter in command.chars() {
        match letter {
            '"' | '\'' => is_quoted = !is_quoted,
            ' ' if !is_quoted => words.push(String::new()),
            _ => words.last_mut().expect("one word at least").push(letter),
        }
    }
    let ends = |word: &String| {
        word.starts_with('[')
            || ["#", ">", "|", "&", "…", ","]
                .iter()
                .any(|mark| word.contains(mark))
    };
    words
        .into_iter()
        .skip(1)
        .take_while(|word| !ends(word))
        .filter(|word| !word.is_empty())
        .collect()
}

/// The reason for which the program does not take these arguments: with `--help` at their end it reads them and does nothing.
fn refusal(arguments: &[String]) -> Option<String> {
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_armplane"))
        .args(arguments)
        .arg("--help")
        .output()
        .expect("armplane starts");
    let reason = String::from_utf8_lossy(&output.stderr)
        .lines()
        .next()
        .unwrap_or_default()
        .to_owned();
    // A text may name an option without a value for it.
    (!output.status.success() && !reason.contains("a value is required")).then_some(reason)
}

#[test]
fn the_program_takes_every_command_of_its_documentation() {
    let (mut checked, mut wrong) = (0, Vec::new());
    let docs = std::fs::read_dir(source::root().join("docs"))
        .unwrap()
        .map(|entry| entry.unwrap().path());
    for path in docs
        .filter(|path| path.extension().is_some_and(|end| end == "md"))
        .chain([source::root().join("README.md")])
    {
        for command in own_commands(&std::fs::read_to_string(&path).unwrap()) {
            checked += 1;
            let place = path
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned();
            wrong.extend(
                refusal(&arguments(&command))
                    .map(|reason| format!("{place}: `{command}`: {reason}")),
            );
        }
    }
    assert!(
        checked > 50,
        "{checked} commands: the check looks in the wrong place"
    );
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert_eq!(
        own_commands("`armplane drill`, which fails with `--without hold`\n    armplane list # names\narmplane is `--json`").len(),
        3
    );
    assert_eq!(
        arguments("armplane bench hop --only \"same core\" > table # all"),
        ["bench", "hop", "--only", "same core"]
    );
    for text in [
        "armplane verify --kils 500",
        "armplane nosuch",
        "armplane drill --without nosuch",
        "armplane verify --kills many",
    ] {
        assert!(refusal(&arguments(text)).is_some(), "{text}");
    }
}

#[test]
fn each_guarantee_has_a_command_that_runs_a_test() {
    let text =
        std::fs::read_to_string(source::root().join("docs/guarantees.md")).expect("the table");
    let workspace = source::workspace();
    let targets = || workspace.iter().flat_map(|package| &package.targets);
    let (mut rows, mut wrong, mut has_command_above) = (0, Vec::new(), false);
    let is_row = |line: &&str| line.starts_with("| ") && !line.starts_with("| assumption");
    for row in text.lines().filter(is_row) {
        rows += 1;
        let test = row.split(" | ").nth(2).unwrap_or_default();
        let has_command = commands(test, "armplane ")
            .chain(commands(test, "cargo "))
            .next()
            .is_some();
        if !(has_command || test == "the same" && has_command_above) {
            wrong.push(format!("no command: {row}"));
        }
        has_command_above = has_command;
        for command in commands(test, "cargo ") {
            let Command { target, filters } = match parse(command) {
                Ok(command) => command,
                Err(reason) => {
                    wrong.push(format!("`{command}`: {reason}"));
                    continue;
                }
            };
            let is_meant = |one: &&source::Target| {
                one.kind == "lib" && target == "lib" || one.kind == "test" && one.name == target
            };
            let names = tests(targets().filter(is_meant).flat_map(|target| &target.files));
            let unmatched = filters
                .iter()
                .filter(|filter| !names.iter().any(|name| name.contains(filter.as_str())));
            wrong
                .extend(unmatched.map(|filter| format!("`{command}`: no test is called {filter}")));
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
    assert!(
        wrong("cargo test --test system life faults").contains("behind `--`")
            && wrong("cargo test life").contains("target")
    );
    let command = parse("cargo test --release --test system -- life faults").unwrap();
    assert_eq!(
        command,
        Command {
            target: "system".into(),
            filters: vec!["life".into(), "faults".into()]
        }
    );
    assert_eq!(
        commands("`armplane drill`, or `cargo test --lib x`", "cargo ").collect::<Vec<_>>(),
        ["cargo test --lib x"]
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lib.rs");
    std::fs::write(&path, "#[test] fn runs() { assert!(f()); } #[test] #[ignore = \"long\"] fn waits() { assert!(f()); } fn helper() {}")
        .unwrap();
    assert_eq!(
        tests(source::files_of(Path::new(&path), false).iter()),
        ["runs"]
    );
}
