//! A crate cannot use what its manifest does not name: the table "What each crate must not know" of `docs/architecture.md`, checked on the manifests.

use crate::{Package, quoted, rust_files, table, workspace};

const HEADING: &str = "## What each crate must not know";

/// One crate stands between us and each large library, so that it can be replaced there. `re_` stands for all crates whose names begin so.
fn seams(packages: &[Package], rows: &[Vec<String>]) -> Vec<String> {
    let mut wrong = Vec::new();
    for row in rows.iter().filter(|row| row[0].starts_with("all but ")) {
        let (allowed, libraries) = (quoted(&row[0]), quoted(&row[1]));
        for package in packages
            .iter()
            .filter(|one| !allowed.contains(&one.name.as_str()))
        {
            let kinds = ["dependencies", "dev-dependencies", "build-dependencies"];
            let names = kinds
                .into_iter()
                .flat_map(|kind| package.dependencies(kind));
            let behind =
                names.filter(|name| libraries.iter().any(|library| name.starts_with(library)));
            wrong.extend(behind.map(|name| format!("{} depends on {name}", package.name)));
        }
    }
    wrong
}

/// The messages are the ground on which all crates meet, so their crate knows none of them, and no algebra.
fn shared_types_stand_alone(packages: &[Package]) -> Vec<String> {
    let is_named = |name: &str| packages.iter().any(|package| package.name == name);
    let shared_types = packages.iter().filter(|one| one.name == "shared-types");
    let imports = shared_types.flat_map(|package| package.dependencies("dependencies"));
    imports
        .filter(|name| is_named(name) || ["nalgebra", "libm", "glam"].contains(name))
        .map(|name| format!("shared-types depends on {name}"))
        .collect()
}

/// Processes share nothing but messages, so that any of them can be replaced, by a program of another language too. A process is a crate that uses
/// `process` or `runtime`, but for these themselves and the table of all steps; `launcher` and all that uses it start processes and are none.
fn processes_meet_in_messages(packages: &[Package]) -> Vec<String> {
    let uses = |package: &Package, name: &str| package.dependencies("dependencies").contains(&name);
    let mut starters = vec!["launcher"];
    let is_new = |starters: &[&str], one: &Package| {
        !starters.contains(&one.name.as_str()) && starters.iter().any(|name| uses(one, name))
    };
    while let Some(more) = packages.iter().find(|one| is_new(&starters, one)) {
        starters.push(&more.name);
    }
    starters.extend(["process", "runtime", "chain"]);
    let takes_part = |one: &Package| uses(one, "process") || uses(one, "runtime");
    let is_process = |one: &&Package| takes_part(one) && !starters.contains(&one.name.as_str());
    let processes: Vec<&Package> = packages.iter().filter(is_process).collect();
    assert!(processes.len() > 6, "{} processes", processes.len());
    let mut wrong = Vec::new();
    for one in &processes {
        for other in processes.iter().filter(|other| uses(one, &other.name)) {
            wrong.push(format!("{} depends on {}", one.name, other.name));
        }
    }
    wrong
}

/// The launcher moves processes, not messages: it names none, so a new message is none of its concern.
fn launcher_names_no_message() -> Vec<String> {
    let is_end = |letter: char| !letter.is_alphanumeric();
    let wire: String = rust_files("shared-types/src")
        .into_iter()
        .map(|file| file.text)
        .collect();
    let heads = wire.lines().filter_map(|line| line.split_once(" on \""));
    let messages: Vec<&str> = heads
        .filter_map(|(head, _)| head.split(is_end).next_back())
        .collect();
    assert!(
        messages.len() >= 5,
        "the messages are elsewhere: {messages:?}"
    );
    let files = rust_files("services/launcher/src");
    let lines = files
        .iter()
        .filter(|file| !file.is_test())
        .flat_map(|file| file.text.lines());
    lines
        .filter(|line| !line.trim_start().starts_with("//"))
        .filter(|line| line.split(is_end).any(|word| messages.contains(&word)))
        .map(|line| format!("launcher names a message: {line}"))
        .collect()
}

/// `derive(Pod)` refuses padding at compile time; an `impl` by hand would not. And a file that `include!` brings in would be read by none of these
/// checks; the build script's output is data.
fn nothing_goes_around_the_checks(packages: &[Package]) -> Vec<String> {
    let is_by_hand = |line: &str| {
        let head = line.split(" for ").next().unwrap_or_default();
        let traits = ["Pod", "Zeroable", "AnyBitPattern", "NoUninit"];
        line.trim_start().starts_with("unsafe impl")
            && traits.iter().any(|name| head.ends_with(name))
    };
    let hides = |line: &str| line.contains(" include!(") && !line.contains("\"OUT_DIR\"");
    let is_wrong = |line: &str| is_by_hand(line) || hides(line);
    let files = packages.iter().flat_map(Package::sources);
    files
        .filter(|file| file.text.lines().any(is_wrong))
        .map(|file| format!("{} implements Pod by hand, or includes code", file.path))
        .collect()
}

/// What a lint denies is denied in each crate of the table's row, or the lint says nothing.
fn lints_are_denied(packages: &[Package], rows: &[Vec<String>]) -> Vec<String> {
    let mut wrong = Vec::new();
    for row in rows {
        let lints: Vec<&str> = quoted(&row[1])
            .into_iter()
            .filter(|word| word.starts_with("clippy::"))
            .collect();
        for name in quoted(&row[0]).into_iter().filter(|_| !lints.is_empty()) {
            let package = packages.iter().find(|package| package.name == name);
            let package = package.unwrap_or_else(|| panic!("no crate {name}"));
            let library = crate::text(format!("{}/src/lib.rs", package.folder));
            let denied = library
                .lines()
                .find(|line| line.contains("deny("))
                .unwrap_or_default();
            let missing = lints.iter().filter(|lint| !denied.contains(*lint));
            wrong.extend(missing.map(|lint| format!("{name} does not deny {lint}")));
        }
    }
    wrong
}

#[test]
fn each_crate_knows_only_what_the_table_allows() {
    let (packages, rows) = (workspace(), table(HEADING));
    let wrong = [
        seams(&packages, &rows),
        shared_types_stand_alone(&packages),
        processes_meet_in_messages(&packages),
        launcher_names_no_message(),
        lints_are_denied(&packages, &rows),
        nothing_goes_around_the_checks(&packages),
    ]
    .concat();
    assert!(rows.len() > 8 && wrong.is_empty(), "{wrong:#?}");
}
