//! Inputs that fuzz targets have found, in `tests/fuzz/seeds`: all of them hold their property on every toolchain.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::command::root;
use crate::properties;

/// The property of a target, tried on one input.
fn assert_holds(target: &str, bytes: &[u8]) {
    let on_text = |property: fn(&str)| std::str::from_utf8(bytes).map_or((), property);
    match target {
        "control_page" => properties::control_page(bytes),
        "controller" => properties::controller(bytes),
        "fingers" => properties::fingers(bytes),
        "graph" => on_text(properties::graph),
        "manifest" => properties::manifest(bytes),
        "record" => properties::record(bytes),
        "results" => properties::results(bytes),
        "scenario" => on_text(properties::scenario),
        "target_file" => on_text(properties::target_file),
        "urdf" => on_text(properties::urdf),
        "validation" => properties::validation(bytes),
        _ => panic!("there is no target {target}"),
    }
}

fn entries(folder: impl AsRef<Path>) -> impl Iterator<Item = PathBuf> {
    let entries = std::fs::read_dir(root().join(folder)).into_iter().flatten();
    entries.flatten().map(|entry| entry.path())
}

fn name(path: &Path) -> String {
    path.file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

#[test]
fn every_input_that_fuzzing_has_found_holds_its_property() {
    let targets = entries("tests/fuzz/fuzz_targets").map(|path| name(&path));
    let targets: BTreeSet<_> = targets.collect();
    for folder in entries("tests/fuzz/seeds") {
        assert!(targets.contains(&name(&folder)), "{}", folder.display());
        for input in entries(&folder) {
            assert_holds(&name(&folder), &std::fs::read(input).unwrap());
        }
    }
    // Those that have found nothing begin here.
    targets.iter().for_each(|target| assert_holds(target, &[]));
}
