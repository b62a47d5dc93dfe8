//! The rules of the house, checked on the source itself: who may import whom, and what pure code does not touch.

use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn rust_files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        let path = entry.path();
        if path.is_dir() && path.file_name().is_some_and(|name| name != "target") {
            rust_files(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// All code of a crate: its files' texts, comments and unit tests left out.
fn code_of(folder: &str) -> Vec<(PathBuf, String)> {
    let mut files = Vec::new();
    let src = root().join(folder).join("src");
    rust_files(&src, &mut files);
    let lib = std::fs::read_to_string(src.join("lib.rs")).unwrap();
    let test_modules: Vec<&str> = lib.split("#[cfg(test)]\nmod ").skip(1).filter_map(|rest| rest.split(';').next()).collect();
    files.retain(|file| {
        file.iter().all(|part| !test_modules.iter().any(|module| part.to_str().is_some_and(|part| part.trim_end_matches(".rs") == *module)))
    });
    let code = |text: String| {
        let before_tests = text.split("#[cfg(test)]").next().unwrap_or_default().to_owned();
        before_tests.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n")
    };
    files.into_iter().map(|file| (file.clone(), code(std::fs::read_to_string(file).unwrap()))).collect()
}

/// The names under `[dependencies]` in a crate's manifest.
fn dependencies_of(folder: &str) -> Vec<String> {
    let text = std::fs::read_to_string(root().join(folder).join("Cargo.toml")).unwrap();
    let section = text.split("[dependencies]").nth(1).unwrap_or_default().split("\n[").next().unwrap_or_default().to_owned();
    section.lines().filter_map(|line| line.split(['.', '=', ' ']).next()).filter(|name| !name.is_empty()).map(str::to_owned).collect()
}

const CRATES: [&str; 17] = [
    "shared-types",
    "sim",
    "viz",
    "services/analyzer",
    "services/chain",
    "services/cli",
    "services/control",
    "services/controller",
    "services/estimator",
    "services/lab",
    "services/launcher",
    "services/message_log",
    "services/model",
    "services/plant",
    "services/recorder",
    "services/runtime",
    "services/session",
];

fn name_of(folder: &str) -> &str {
    folder.rsplit('/').next().unwrap()
}

#[test]
fn every_crate_is_listed_here() {
    let workspace = std::fs::read_to_string(root().join("Cargo.toml")).unwrap();
    for folder in CRATES {
        assert!(workspace.contains(&format!("\"{folder}\"")), "{folder}");
    }
    let members = workspace.split("members = [").nth(1).unwrap().split(']').next().unwrap().matches('"').count() / 2;
    assert_eq!(members, CRATES.len());
}

#[test]
fn shared_types_imports_no_other_crate_of_the_workspace() {
    let dependencies = dependencies_of("shared-types");
    assert!(CRATES.iter().all(|folder| !dependencies.contains(&name_of(folder).to_owned())), "{dependencies:?}");
}

#[test]
fn each_seam_has_one_crate() {
    for (package, allowed) in
        [("iceoryx2", &["lab", "runtime"][..]), ("rapier3d", &["sim"]), ("rerun", &["viz"]), ("glam", &["sim", "viz"])]
    {
        for folder in CRATES {
            let depends = dependencies_of(folder).iter().any(|name| name == package);
            assert!(!depends || allowed.contains(&name_of(folder)), "{folder} depends on {package}");
        }
    }
}

#[test]
fn no_process_imports_another_process() {
    let processes = ["plant", "estimator", "analyzer", "controller", "recorder"];
    for process in processes {
        let dependencies = dependencies_of(&format!("services/{process}"));
        assert!(processes.iter().all(|other| !dependencies.contains(&(*other).to_owned())), "{process}: {dependencies:?}");
    }
}

#[test]
fn pure_code_touches_nothing_but_numbers() {
    let forbidden = [
        "iceoryx2",
        "std::time",
        "Instant::",
        "SystemTime",
        "std::thread",
        "std::fs",
        "std::env",
        "std::net",
        "println!",
        "eprintln!",
        "tracing::",
        "thread_rng",
        "HashMap",
        "HashSet",
    ];
    let mut checked = 0;
    let pure = ["services/model", "services/control", "sim"].iter().flat_map(|folder| code_of(folder));
    let cycles = CRATES.iter().flat_map(|folder| code_of(folder)).filter(|(file, _)| {
        file.ends_with("cycle.rs") || file.ends_with("judge.rs") || file.parent().is_some_and(|folder| folder.ends_with("judge"))
    });
    for (file, code) in pure.chain(cycles) {
        checked += 1;
        for word in forbidden {
            assert!(!code.contains(word), "{} mentions {word}", file.display());
        }
    }
    assert!(checked > 15, "only {checked} files: the check looks in the wrong place");
}

#[test]
fn the_control_path_has_no_dynamic_matrices() {
    for folder in ["services/model", "services/control", "services/estimator", "services/analyzer", "services/controller"] {
        for (file, code) in code_of(folder) {
            assert!(!code.contains("DMatrix") && !code.contains("DVector"), "{}", file.display());
        }
    }
}
