//! `docs/tutorial.md`, followed to the letter: its files are written, its commands run, in the order of the page.

use std::path::Path;
use std::process::Command;

use crate::command::{Desk, skipped};

/// A block of the page.
enum Step {
    /// A file's name and text.
    File(String, String),
    /// Commands.
    Shell(String),
}

/// The fenced blocks: "sh" is run, one with a name behind its language is written.
fn steps(page: &str) -> Vec<Step> {
    let mut steps = Vec::new();
    let mut lines = page.lines();
    while let Some(line) = lines.next() {
        let Some(head) = line.strip_prefix("```") else {
            continue;
        };
        let text: Vec<&str> = lines.by_ref().take_while(|line| *line != "```").collect();
        let text = text.join("\n") + "\n";
        match head.split_once(' ') {
            Some((_, name)) => steps.push(Step::File(name.to_owned(), text)),
            None if head == "sh" => steps.push(Step::Shell(text)),
            None => {}
        }
    }
    steps
}

#[test]
fn every_file_and_command_of_the_tutorial_works() {
    let page = include_str!("../../docs/tutorial.md");
    let desk = Desk::new();
    let armplane = Path::new(env!("CARGO_BIN_EXE_armplane"));
    let programs = armplane.parent().expect("a folder");
    let profile = programs
        .file_name()
        .and_then(|name| name.to_str())
        .unwrap_or_default();
    let path = format!(
        "{}:{}",
        programs.display(),
        std::env::var("PATH").unwrap_or_default()
    );
    let python = Command::new("python3")
        .arg("--version")
        .output()
        .is_ok_and(|output| output.status.success());
    let (mut files, mut commands) = (0, 0);
    for step in steps(page) {
        match step {
            Step::File(name, text) => {
                desk.file(&name, &text);
                files += 1;
            }
            Step::Shell(text) => {
                for line in text.lines() {
                    if line.starts_with("python3") && !python {
                        skipped(format!("`{line}`: there is no python3 here"));
                        continue;
                    }
                    // Another profile than the page's would compile everything a second time.
                    let line = line.replace("--release", &format!("--offline --profile {profile}"));
                    let line = line.replace("target/release", &format!("target/{profile}"));
                    let done = Command::new("sh")
                        .args(["-c", &line])
                        .current_dir(desk.path())
                        .env("PATH", &path)
                        .env("ARMPLANE", env!("CARGO_MANIFEST_DIR"))
                        // Stands in for the viewer.
                        .env("ARMPLANE_RERUN", "true")
                        .output()
                        .expect("a shell");
                    let [out, err] = [done.stdout, done.stderr]
                        .map(|text| String::from_utf8_lossy(&text).into_owned());
                    assert!(
                        done.status.success(),
                        "`{line}` ended with {}:\n{out}\n{err}",
                        done.status
                    );
                    commands += 1;
                }
            }
        }
    }
    assert!(
        files >= 7 && commands >= 18,
        "{files} files, {commands} commands: is the page still read?"
    );
    for (left, said) in [
        ("reach/report.html", "Locked"),
        ("faulty/report.html", "fault in force"),
        ("s1.svg", "polyline"),
        ("straight/summary.json", "goal reached"),
    ] {
        if left != "s1.svg" || python {
            assert!(
                std::fs::read_to_string(desk.path().join(left))
                    .expect(left)
                    .contains(said),
                "{left} lacks `{said}`"
            );
        }
    }
}
