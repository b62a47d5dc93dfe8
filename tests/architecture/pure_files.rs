//! The files in which nothing but numbers is touched: those of pure crates and rooms with all that these name, and those that claim it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::circles::files_named_by;
use crate::source::{File, Package, Target};
use crate::syntax::{documentation, items, paths, tokens_of, use_leaves};
use crate::tokens::TokenTree;

/// Crates in which nothing but numbers is touched.
pub(crate) const PURE_CRATES: [&str; 5] = ["model", "control", "sim", "chain", "lines"];
/// Rooms of that kind in crates that do other things too, as a file or as a folder: the judge, the lockstep protocol.
const PURE_ROOMS: [&str; 5] = [
    "services/recorder/src/judge",
    "services/lockstep/src/protocol",
    "services/lockstep/src/message_faults",
    "services/lockstep/src/one_thread",
    "services/lockstep/src/recall",
];
/// The same in every process: its step.
const CYCLE: &str = "cycle.rs";

/// The step of a process: the parts of its crate that pure code may name.
const STEP: [&str; 3] = ["Cycle", "Step", "cycle"];

fn is_of_a_pure_room(package: &str, file: &File) -> bool {
    let is_room = PURE_ROOMS
        .iter()
        .any(|room| file.path.with_extension("").starts_with(room));
    PURE_CRATES.contains(&package) || is_room || file.path.ends_with(CYCLE)
}

/// Whether the first lines of a file (`//!`) have the word PURE.
fn claims_to_be_pure(file: &File) -> bool {
    let head: String = items(&file.tokens)
        .iter()
        .filter(|item| item.inner)
        .map(|item| documentation(&item.attributes))
        .collect();
    head.split(|letter: char| !letter.is_alphanumeric())
        .any(|word| word == "PURE")
}

/// The files of pure rooms and all files of their crate that these name, each with the file that names it.
pub(crate) fn pure_files(package: &Package) -> Vec<(&File, &File)> {
    let mut found: BTreeMap<_, (&File, &File)> = BTreeMap::new();
    for target in package.targets.iter().filter(|target| target.is_shipped()) {
        let rooms = target
            .files
            .iter()
            .filter(|file| !file.test_only && is_of_a_pure_room(&package.name, file));
        let mut waiting: Vec<(&File, &File)> = rooms.map(|file| (file, file)).collect();
        let named = if waiting.is_empty() {
            BTreeMap::new()
        } else {
            files_named_by(target)
        };
        while let Some((file, because)) = waiting.pop() {
            if found.insert(&file.path, (file, because)).is_none() {
                waiting.extend(
                    named
                        .get(file.path.as_path())
                        .into_iter()
                        .flatten()
                        .map(|other| (*other, file)),
                );
            }
        }
    }
    found.into_values().collect()
}

/// The other files that claim to be pure. The files that they name are not among them: a picture may be drawn from data whose file reads it.
pub(crate) fn claimed_pure(package: &Package) -> impl Iterator<Item = &File> {
    package.code().filter(|file| claims_to_be_pure(file))
}

/// The names of a process in code, besides its step.
pub(crate) fn beyond_the_step(code: &[TokenTree], processes: &[&str]) -> BTreeSet<String> {
    let is_process = |word: &String| {
        processes
            .iter()
            .any(|process| process.replace('-', "_") == *word)
    };
    let named = paths(code)
        .into_iter()
        .filter(|path| path.len() > 1)
        .chain(use_leaves(code).into_iter().map(|(_, path)| path));
    let beyond = named.filter(|path| {
        is_process(&path[0])
            && !path
                .get(1)
                .is_some_and(|part| STEP.contains(&part.as_str()))
    });
    beyond.map(|path| path.join("::")).collect()
}

/// A package of one library with these files.
fn sample(folder: &Path, files: &[(&str, &str)]) -> Package {
    for (name, text) in files {
        std::fs::write(folder.join(name), text).unwrap();
    }
    let files = crate::source::files_of(&folder.join("lib.rs"), false);
    Package {
        name: "sample".into(),
        dependencies: Vec::new(),
        targets: vec![Target {
            name: "sample".into(),
            kind: "lib".into(),
            files,
        }],
    }
}

#[test]
fn the_check_sees_a_helper_of_a_pure_room_and_a_file_that_claims_to_be_pure() {
    let names = |files: Vec<&File>| {
        files
            .iter()
            .map(|file| {
                file.path
                    .file_name()
                    .unwrap()
                    .to_string_lossy()
                    .into_owned()
            })
            .collect::<Vec<_>>()
    };
    let folder = tempfile::tempdir().unwrap();
    let helper = ("helper.rs", "pub fn f() { crate::second::g() }");
    let second = ("second.rs", "pub fn g() { std::fs::read(x); }");
    let own = (
        "own.rs",
        "//! The numbers of a run. PURE.\nfn f() { Instant::now(); }",
    );
    let lib = (
        "lib.rs",
        "//! Not this one.\nmod cycle; mod helper; mod second; mod own; mod free;",
    );
    let free = ("free.rs", "fn f() { std::fs::read(x); }");
    let package = sample(
        folder.path(),
        &[
            lib,
            ("cycle.rs", "use crate::helper::f;\nfn step() { f() }"),
            helper,
            second,
            own,
            free,
        ],
    );
    assert_eq!(
        names(
            pure_files(&package)
                .into_iter()
                .map(|(file, _)| file)
                .collect()
        ),
        ["cycle.rs", "helper.rs", "second.rs"]
    );
    assert_eq!(names(claimed_pure(&package).collect()), ["own.rs"]);
}

#[test]
fn the_check_sees_more_than_the_step_of_a_process() {
    let seen = |text: &str| beyond_the_step(&tokens_of(text), &["plant", "plant-fci"]).len();
    for text in [
        "plant::run(shell)",
        "use plant::{Cycle, run};",
        "use plant as p;",
        "use plant::*;",
        "fn f(x: plant_fci::Address) {}",
    ] {
        assert_eq!(seen(text), 1, "{text}");
    }
    for text in [
        "plant::cycle(robot)",
        "use plant::{Cycle, Step};",
        "self.plant.sample(tick)",
        "use crate::plant::run;",
    ] {
        assert_eq!(seen(text), 0, "{text}");
    }
}
