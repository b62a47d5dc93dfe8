//! Rules 1 to 8 of the house and the layout, one test each; `docs/architecture.md` gives the reasons.

use std::collections::BTreeSet;
use std::path::Path;

use proc_macro2::{Delimiter, TokenTree};
use shared_types::graph::Graph;

use crate::source::{self, File, Package, is, items, paths, walk};

/// Crates in which nothing but numbers is touched.
const PURE_CRATES: [&str; 4] = ["model", "control", "sim", "chain"];
/// Rooms of that kind in crates that do other things too, as a file or as a folder: the step of each process, the judge, the order of lockstep.
const PURE_ROOMS: [&str; 3] = ["cycle", "judge", "lockstep"];
/// Crates on the way from a sensor sample to a torque.
const CONTROL_PATH: [&str; 5] = ["model", "control", "estimator", "analyzer", "controller"];

/// The only users of a dependency: of all crates whose names begin so, whatever part of a library they are.
const SEAMS: [(&str, &[&str]); 7] = [
    ("iceoryx2", &["runtime", "lab"]),
    ("franka", &["plant-fci"]),
    ("rapier", &["sim"]),
    ("parry", &["sim"]),
    ("re_", &["viz"]),
    ("rerun", &["viz"]),
    ("glam", &["sim", "viz"]),
];

/// The length of a room in lines, unit tests not counted.
const ROOM: usize = 500;

fn is_pure(package: &Package, file: &File) -> bool {
    let is_pure_room = |part: &str| PURE_ROOMS.contains(&part.trim_end_matches(".rs"));
    PURE_CRATES.contains(&package.name.as_str()) || file.path.iter().filter_map(|part| part.to_str()).any(is_pure_room)
}

/// The processes of the graph that this program ships.
fn processes() -> Vec<String> {
    let graph = Graph::parse("services/graph.toml", include_str!("../../services/graph.toml")).unwrap();
    graph.process.into_iter().map(|process| process.name).collect()
}

#[test]
fn rule_1_shared_types_imports_no_other_crate_of_the_workspace() {
    let workspace = source::workspace();
    let names: Vec<&str> = workspace.iter().map(|package| package.name.as_str()).collect();
    let shared_types = workspace.iter().find(|package| package.name == "shared-types").unwrap();
    assert_eq!(shared_types.imports().filter(|name| names.contains(name)).collect::<Vec<_>>(), Vec::<&str>::new());
}

#[test]
fn rule_1_every_layout_is_plain_data_checked_at_compile_time() {
    let (mut layouts, mut wrong) = (0, Vec::new());
    for package in source::workspace() {
        for file in package.code() {
            // `derive(Pod)` refuses padding and fields that are not plain data; a hand-written `impl Pod` would not.
            walk(&file.code, &mut |tokens| {
                let by_hand = tokens.windows(3).any(|window| {
                    is(&window[0], "unsafe")
                        && is(&window[1], "impl")
                        && ["Pod", "Zeroable", "bytemuck"].iter().any(|name| is(&window[2], name))
                });
                if by_hand {
                    wrong.push(format!("{} implements Pod by hand", file.path.display()));
                }
            });
            if package.name != "shared-types" {
                continue;
            }
            for item in items(&file.code) {
                let attributes = paths(&item.attributes.concat()).concat();
                if attributes.iter().any(|word| word == "repr") && attributes.iter().any(|word| word == "C") {
                    layouts += 1;
                    if !attributes.iter().any(|word| word == "Pod") {
                        wrong.push(format!("{}: a repr(C) layout without derive(Pod)", file.path.display()));
                    }
                }
            }
        }
    }
    assert!(layouts > 0 && wrong.is_empty(), "{layouts} layouts: {wrong:#?}");
}

#[test]
fn rule_2_pure_code_touches_nothing_but_numbers() {
    // Ordered maps only: a hash map's order is another in every process.
    let forbidden = [
        "iceoryx2",
        "time",
        "Instant",
        "SystemTime",
        "thread",
        "fs",
        "env",
        "net",
        "process",
        "io",
        "println",
        "eprintln",
        "print",
        "eprint",
        "dbg",
        "tracing",
        "log",
        "rand",
        "getrandom",
        "thread_rng",
        "RandomState",
        "HashMap",
        "HashSet",
        "Mutex",
        "RwLock",
        "thread_local",
        "static_mut",
    ];
    let standard_only = ["time", "thread", "fs", "env", "net", "process", "io"];
    let (mut checked, mut wrong) = (0, Vec::new());
    for package in source::workspace() {
        for file in package.code().filter(|file| is_pure(&package, file)) {
            checked += 1;
            let mut words = BTreeSet::new();
            for path in paths(&file.code) {
                let standard = ["std", "core"].contains(&path[0].as_str());
                if path[0] == "libm" {
                    continue; // its `log` is a number
                }
                let found =
                    path.iter().find(|word| forbidden.contains(&word.as_str()) && (standard || !standard_only.contains(&word.as_str())));
                // A dependency is the first word of its path; a local variable may have its name.
                words.extend(found.filter(|word| path.len() > 1 || word.chars().any(char::is_uppercase)).map(|_| path.join("::")));
            }
            for name in ["println", "eprintln", "print", "eprint", "dbg", "thread_local"] {
                walk(&file.code, &mut |tokens| {
                    if tokens.windows(2).any(|pair| is(&pair[0], name) && is(&pair[1], "!")) {
                        words.insert(format!("{name}!"));
                    }
                });
            }
            // `use std::{fs, …}`
            walk(&file.code, &mut |tokens| {
                for window in tokens.windows(4) {
                    if let [std, _, _, TokenTree::Group(group)] = window
                        && is(std, "std")
                        && group.delimiter() == Delimiter::Brace
                    {
                        let inside: Vec<TokenTree> = group.stream().into_iter().collect();
                        let found = paths(&inside).into_iter().filter(|path| forbidden.contains(&path[0].as_str()));
                        words.extend(found.map(|path| format!("std::{}", path.join("::"))));
                    }
                }
            });
            wrong.extend(words.into_iter().map(|word| format!("{} names {word}", file.path.display())));
        }
    }
    assert!(checked > 30, "only {checked} files: the check looks in the wrong place");
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn rule_2_the_allocation_counts_of_the_pure_cycles_exist() {
    let workspace = source::workspace();
    let chain = workspace.iter().find(|package| package.name == "chain").unwrap();
    let counted = chain.targets.iter().any(|target| target.kind == "test" && target.name == "allocations");
    assert!(counted, "services/chain/tests/allocations.rs counts what a tick allocates");
}

#[test]
fn rule_3_each_seam_has_one_crate() {
    let mut wrong = Vec::new();
    let mut used = BTreeSet::new();
    for package in source::workspace() {
        for (name, _) in &package.dependencies {
            let Some((seam, allowed)) = SEAMS.iter().find(|(seam, _)| name.starts_with(seam)) else { continue };
            used.insert(*seam);
            if !allowed.contains(&package.name.as_str()) {
                wrong.push(format!("{} depends on {name}", package.name));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert!(["iceoryx2", "rapier", "re_", "glam"].iter().all(|seam| used.contains(seam)), "a seam without a user: {used:?}");
}

/// Whether a file names one of these words, each as it stands in a path or before `!`.
fn named(file: &File, words: &[&str]) -> Vec<String> {
    let mut found: Vec<String> = paths(&file.code).into_iter().flatten().filter(|word| words.contains(&word.as_str())).collect();
    found.dedup();
    found.into_iter().map(|word| format!("{} names {word}", file.path.display())).collect()
}

#[test]
fn rule_1_shared_types_has_no_algebra_and_no_input_or_output() {
    let workspace = source::workspace();
    let shared_types = workspace.iter().find(|package| package.name == "shared-types").unwrap();
    let algebra: Vec<&str> = shared_types.imports().filter(|name| ["nalgebra", "libm", "ndarray"].contains(name)).collect();
    assert_eq!(algebra, Vec::<&str>::new());
    let words = ["File", "fs", "TcpStream", "Command", "stdin", "stdout", "stderr", "println", "eprintln"];
    let wrong: Vec<String> = shared_types.code().flat_map(|file| named(file, &words)).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn rule_4_the_launcher_does_not_know_the_content_of_messages() {
    let workspace = source::workspace();
    let launcher = workspace.iter().find(|package| package.name == "launcher").unwrap();
    let messages = workspace.iter().find(|package| package.name == "shared-types").unwrap().files();
    let messages = messages.filter(|file| file.path.ends_with("messages.rs")).flat_map(|file| declared(&file.tokens)).collect::<Vec<_>>();
    assert!(messages.len() >= 5, "the messages are declared elsewhere: {messages:?}");
    let words: Vec<&str> = messages.iter().map(String::as_str).collect();
    let wrong: Vec<String> = launcher.code().flat_map(|file| named(file, &words)).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// The names that `wire! { Name on "topic" … }` declares.
fn declared(tokens: &[TokenTree]) -> Vec<String> {
    let mut found = Vec::new();
    walk(tokens, &mut |tokens| {
        for pair in tokens.windows(2) {
            if let [TokenTree::Ident(name), on] = pair
                && is(on, "on")
            {
                found.push(name.to_string());
            }
        }
    });
    found
}

#[test]
fn rule_5_session_and_lab_do_not_print() {
    let words = ["println", "eprintln", "print", "eprint", "dbg"];
    let mut wrong = Vec::new();
    for package in source::workspace().iter().filter(|package| ["session", "lab"].contains(&package.name.as_str())) {
        for file in package.code() {
            walk(&file.code, &mut |tokens| {
                let printing = |pair: &[TokenTree]| words.iter().any(|word| is(&pair[0], word)) && is(&pair[1], "!");
                if tokens.windows(2).any(printing) {
                    wrong.push(format!("{} prints", file.path.display()));
                }
            });
            // A child's output may be sent somewhere: `Stdio` and `.stdout(…)` are no printing.
            let own = paths(&file.code)
                .into_iter()
                .filter(|path| path.len() > 1 && path[0] == "io" && ["stdout", "stderr"].contains(&path[1].as_str()));
            wrong.extend(own.map(|path| format!("{} names {}", file.path.display(), path.join("::"))));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn rule_5_functions_that_differ_between_machines_are_those_of_libm() {
    // The standard library's are the platform's; `sqrt` and the four operations are exact everywhere, `powi` is products.
    let platform = [
        "sin", "cos", "tan", "sin_cos", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "exp2", "exp_m1", "ln", "ln_1p",
        "log", "log2", "log10", "powf", "cbrt", "hypot",
    ];
    let mut wrong = Vec::new();
    for package in source::workspace() {
        let is_simulated = ["plant", "sim"].contains(&package.name.as_str()) || CONTROL_PATH.contains(&package.name.as_str());
        for file in package.code().filter(|file| is_simulated || is_pure(&package, file)) {
            walk(&file.code, &mut |tokens| {
                for window in tokens.windows(3) {
                    if is(&window[0], ".")
                        && matches!(window[2], TokenTree::Group(_))
                        && let Some(name) = platform.iter().find(|name| is(&window[1], name))
                    {
                        wrong.push(format!("{}: .{name}(…)", file.path.display()));
                    }
                }
            });
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn rule_4_no_process_imports_another_process() {
    let (workspace, processes) = (source::workspace(), processes());
    let mut found = 0;
    for package in workspace.iter().filter(|package| processes.contains(&package.name)) {
        found += 1;
        let others: Vec<&str> = package.imports().filter(|name| processes.iter().any(|process| process == name)).collect();
        assert_eq!(others, Vec::<&str>::new(), "{} imports a process", package.name);
    }
    assert_eq!(found, processes.len(), "each process of the graph has a crate of its name: {processes:?}");
}

#[test]
fn rule_6_the_control_path_has_no_dynamic_matrices() {
    let mut wrong = Vec::new();
    for package in source::workspace().iter().filter(|package| CONTROL_PATH.contains(&package.name.as_str())) {
        for file in package.code() {
            let dynamic = ["DMatrix", "DVector", "Dyn", "OMatrix", "VecStorage", "MatrixXx1", "RowDVector"];
            let found = paths(&file.code).into_iter().flatten().find(|word| dynamic.contains(&word.as_str()));
            wrong.extend(found.map(|word| format!("{} names {word}", file.path.display())));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// `.inverse_like(…)` followed by `.unwrap_or…`, and a test for NaN with a number in place of what failed it.
fn silent_repairs(code: &[TokenTree]) -> Vec<String> {
    let may_fail = [
        "try_inverse",
        "try_inverse_mut",
        "pseudo_inverse",
        "inverse",
        "cholesky",
        "solve",
        "try_solve",
        "lu",
        "qr",
        "svd",
        "try_svd",
        "try_normalize",
        "symmetric_eigen",
        "try_symmetric_eigen",
        "eigenvalues",
        "lambda",
    ];
    let repairs = ["unwrap_or", "unwrap_or_default", "unwrap_or_else", "map_or", "map_or_else"];
    let mut found = Vec::new();
    walk(code, &mut |tokens| {
        for (at, token) in tokens.iter().enumerate() {
            // name ( … ) . repair ( … )
            let chain = (tokens.get(at + 1), tokens.get(at + 2), tokens.get(at + 3));
            if let (TokenTree::Ident(name), (Some(TokenTree::Group(_)), Some(dot), Some(TokenTree::Ident(repair)))) = (token, chain)
                && is(dot, ".")
                && may_fail.iter().any(|word| *name == word)
                && repairs.iter().any(|word| *repair == word)
            {
                found.push(format!("{name}(…).{repair}(…)"));
            }
            // if x.is_finite() { … } else { 0.0 }
            if is(token, "is_finite") || is(token, "is_nan") {
                let blocks = tokens[at..].iter().take(6).filter_map(|token| match token {
                    TokenTree::Group(group) if group.delimiter() == Delimiter::Brace => {
                        Some(group.stream().into_iter().collect::<Vec<_>>())
                    }
                    _ => None,
                });
                let constant = |block: Vec<TokenTree>| matches!(block.as_slice(), [TokenTree::Literal(_)]);
                if blocks.into_iter().any(constant) {
                    found.push(format!("{token}: a number in place of one that is not finite"));
                }
            }
        }
    });
    found
}

/// Where an infinity is no error: what has no limit.
const NO_LIMIT: [(&str, &str); 2] = [
    ("services/recorder/src/judge.rs", "a joint without a limit uses no share of it"),
    ("services/control/src/baselines/hold_and_blend.rs", "a joint without a limit is pushed with one unit"),
];

#[test]
fn rule_8_nothing_is_silently_repaired() {
    let mut wrong = Vec::new();
    for package in source::workspace() {
        for file in package.code().filter(|file| is_pure(&package, file) || CONTROL_PATH.contains(&package.name.as_str())) {
            if NO_LIMIT.iter().any(|(path, _)| file.path == Path::new(path)) {
                continue;
            }
            wrong.extend(silent_repairs(&file.code).into_iter().map(|what| format!("{}: {what}", file.path.display())));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    let seen = |text: &str| silent_repairs(&text.parse::<proc_macro2::TokenStream>().unwrap().into_iter().collect::<Vec<_>>()).len();
    assert_eq!(seen("let B = A.try_inverse().unwrap_or(Matrix3::identity());"), 1);
    assert_eq!(seen("let y = if x.is_nan() { 0.0 } else { x };"), 1);
    assert_eq!(seen("let y = if x.is_finite() { x } else { 0.0 };"), 1);
    assert_eq!(seen("let B = A.try_inverse().ok_or(Error::Singular)?;"), 0);
}

#[test]
fn a_file_is_one_room() {
    let mut long = Vec::new();
    for package in source::workspace() {
        for file in package.files() {
            let lines = file.lines_of_code();
            if lines > ROOM {
                long.push(format!("{} has {lines} lines", file.path.display()));
            }
        }
    }
    assert!(long.is_empty(), "longer than {ROOM} lines without tests: {long:#?}");
}
