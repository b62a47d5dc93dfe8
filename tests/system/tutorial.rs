//! `docs/tutorial.md`, followed to the letter: its files are written, its commands run, in the order of the page.

use crate::command::{Desk, skipped, source};

/// The fenced blocks: what stands behind the language of each, and its text. "sh" is run, one with a name behind its language is written.
fn blocks(page: &str) -> impl Iterator<Item = (&str, String)> {
    let mut lines = page.lines();
    std::iter::from_fn(move || {
        let head = lines.find_map(|line| line.strip_prefix("```"))?;
        let text = lines.by_ref().take_while(|line| *line != "```");
        Some((head, text.map(|line| format!("{line}\n")).collect()))
    })
}

#[test]
fn every_file_and_command_of_the_tutorial_works() {
    let desk = Desk::new();
    let has_python = desk.shell("python3 -c ''").code == 0;
    let (mut files, mut commands) = (0, 0);
    for (head, text) in blocks(&source("docs/tutorial.md")) {
        if let Some((_, name)) = head.split_once(' ') {
            desk.file(name, text);
            files += 1;
            continue;
        }
        for line in text.lines().filter(|_| head == "sh") {
            if line.starts_with("python3") && !has_python {
                skipped(format!("`{line}`: there is no python3 here"));
                continue;
            }
            // Another profile than the page's would compile everything a second time.
            let line = line.replace("--release", "--offline --profile ${PROFILE/debug/dev}");
            let line = line.replace("target/release", "target/$PROFILE");
            // The page's ARMPLANE is the repository, and another program stands in for the viewer.
            let said = desk.shell(&format!(
                "export ARMPLANE=$ROOT ARMPLANE_RERUN=true; {line}"
            ));
            assert_eq!(said.code, 0, "`{line}`: {}{}", said.out, said.err);
            commands += 1;
        }
    }
    assert!(
        files >= 7 && commands >= 18,
        "{files} files, {commands} commands: is the page still read?"
    );
    for (left, said) in [
        ("reach/report.html", "Locked"),
        ("faulty/report.html", "controller kill"),
        ("s1.svg", "polyline"),
        ("straight/summary.json", "goal reached"),
    ] {
        let is_made = left != "s1.svg" || has_python;
        assert!(
            !is_made || desk.read(left).contains(said),
            "{left} lacks `{said}`"
        );
    }
}
