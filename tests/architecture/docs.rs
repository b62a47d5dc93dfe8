//! The documentation names commands: each is one that the program takes, or a test that exists.

use std::process::Command;

use crate::{File, Package, quoted, root, rust_files, text, workspace};

/// The commands of `armplane` in a text: in backticks, or a line each. Options in backticks behind one (`--without hold`) are tried with it.
fn commands(page: &str) -> Vec<String> {
    let (mut found, mut is_fenced) = (Vec::new(), false);
    for line in page.lines() {
        is_fenced ^= line.trim_start().starts_with("```");
        let is_code = (is_fenced || line.starts_with("    ")) && !line.contains('`');
        let own_line = Some(line.trim_start()).filter(|_| is_code);
        let mut last = "";
        for part in quoted(line).into_iter().chain(own_line) {
            if part.starts_with("armplane ") {
                last = part;
                found.push(part.to_owned());
            } else if part.starts_with("--") && part.contains(' ') && !last.is_empty() {
                found.push(format!("{last} {part}"));
            }
        }
    }
    found
}

/// The arguments as a shell splits them, up to a comment, a redirection, the next command, or what may stand there (`[RUN]`, `a|b`).
fn arguments(command: &str) -> Vec<String> {
    let (mut words, mut is_quoted) = (vec![String::new()], false);
    for letter in command.chars() {
        match letter {
            '"' | '\'' => is_quoted = !is_quoted,
            ' ' if !is_quoted => words.push(String::new()),
            _ => words.last_mut().expect("one word at least").push(letter),
        }
    }
    let ends =
        |word: &String| word.starts_with('[') || word.contains(['#', '>', '|', '&', '…', ',']);
    let words = words.into_iter().skip(1).take_while(|word| !ends(word));
    words.filter(|word| !word.is_empty()).collect()
}

/// The reason for which the program does not take these arguments: with `--help` at their end it reads them and does nothing.
fn refusal(command: &str) -> Option<String> {
    let mut program = Command::new(env!("CARGO_BIN_EXE_armplane"));
    let output = program.args(arguments(command)).arg("--help").output();
    let output = output.expect("armplane starts");
    let errors = String::from_utf8_lossy(&output.stderr);
    let reason = errors.lines().next().unwrap_or_default().to_owned();
    // A text may name an option without a value for it.
    (!output.status.success() && !reason.contains("has no value")).then_some(reason)
}

/// A reader types what a page says; a page that an option was renamed under costs them the afternoon.
#[test]
fn the_program_takes_every_command_of_its_documentation() {
    let (mut checked, mut wrong) = (0, Vec::new());
    let pages = std::fs::read_dir(root().join("docs"))
        .expect("the folder")
        .flatten();
    let pages = pages
        .map(|entry| entry.path())
        .chain([root().join("README.md")]);
    for path in pages.filter(|path| path.extension().is_some_and(|end| end == "md")) {
        for command in commands(&text(&path)) {
            checked += 1;
            let refused = refusal(&command);
            wrong
                .extend(refused.map(|reason| format!("{}: `{command}`: {reason}", path.display())));
        }
    }
    assert!(checked > 50, "{checked} commands: looks in the wrong place");
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// The tests of a file by their paths, `folder::file::name`.
fn tests_of(file: &File) -> Vec<String> {
    let module = file
        .path
        .trim_end_matches(".rs")
        .trim_end_matches("/mod")
        .replace('/', "::");
    let below = file.text.split("#[test]").skip(1);
    let names = below.filter_map(|text| text.split("fn ").nth(1)?.split('(').next());
    names.map(|name| format!("{module}::{name}")).collect()
}

/// A guarantee is worth its check: each row names a command, and a filter of `cargo test` that matches nothing would pass in silence.
#[test]
fn each_guarantee_has_a_command_that_tests_it() {
    let (mut rows, mut wrong) = (0, Vec::new());
    let mut files: Vec<_> = workspace().iter().flat_map(Package::sources).collect();
    files.extend(rust_files("tests/system"));
    let mut tests: Vec<String> = files.iter().flat_map(tests_of).collect();
    let transcripts = std::fs::read_dir(root().join("tests/transcripts")).expect("the folder");
    tests.extend(transcripts.flatten().map(|file| {
        format!(
            "system::transcripts::{}",
            file.file_name().to_string_lossy()
        )
    }));
    let exists = |filter: &str| tests.iter().any(|test| test.contains(filter));
    let page = text("docs/guarantees.md");
    let is_row = |line: &&str| line.starts_with("| ") && !line.ends_with("| shown by |");
    for row in page.lines().filter(is_row) {
        rows += 1;
        let test = row.split(" | ").nth(1).unwrap_or_default();
        let is_command = |part: &&str| part.starts_with("armplane ") || part.starts_with("cargo ");
        if !quoted(test).iter().any(is_command) {
            wrong.push(format!("no command: {row}"));
        }
        for command in quoted(test)
            .into_iter()
            .filter(|part| part.starts_with("cargo test"))
        {
            let words: Vec<&str> = command.split_whitespace().skip(2).collect();
            let is_filter = |at: &usize| {
                !words[*at].starts_with("--") && (*at == 0 || words[at - 1] != "--test")
            };
            let filters: Vec<&str> = (0..words.len())
                .filter(is_filter)
                .map(|at| words[at])
                .collect();
            let unmatched = filters.iter().filter(|filter| !exists(filter));
            wrong
                .extend(unmatched.map(|filter| format!("`{command}`: no test is called {filter}")));
            if filters.is_empty() || filters.len() > 1 && !words.contains(&"--") {
                wrong.push(format!(
                    "`{command}`: one filter, or more of them behind `--`"
                ));
            }
        }
    }
    assert!(rows > 10, "{rows} rows: looks in the wrong place");
    assert!(wrong.is_empty(), "{wrong:#?}");
}
