//! Pure code gives the same bits everywhere: it touches numbers only. Checked on the names in its source.

use std::collections::{BTreeMap, BTreeSet};

use proc_macro2::{Delimiter, TokenTree};

use crate::{File, Package, workspace};

/// Crates that are pure as a whole.
const CRATES: [&str; 10] = [
    "model",
    "control",
    "sim",
    "chain",
    "lines",
    "process",
    "estimator",
    "analyzer",
    "controller",
    "plant",
];
/// Pure rooms of other crates, as a file or as a folder: the judge.
const ROOMS: [&str; 1] = ["services/recorder/src/judge"];
/// Libraries that compute or read text, and crates of ours that pure code may name; of a process, its step, and of the recorder its judge's bounds.
const DEPENDENCIES: &str = "bytemuck control glam hdrhistogram libm model nalgebra process quick_xml rapier3d recorder serde serde_json shared_types sim thiserror \
    toml roxmltree urdf_rs wide analyzer controller estimator operator plant plotters viz mesh_loader xxhash_rust";
const PROCESSES: &str = "analyzer controller estimator operator plant plant_fci recorder";
const STEP: &str = "Bounds Cycle Law Analysis World process";
/// Modules of the standard library without clock, thread, file, environment and process; the three instructions compute, load and store.
const STANDARD: &str = "any array borrow cell cmp collections convert error f32 f64 fmt hash iter marker mem num ops path result slice str sync";
const ITEMS: [&str; 5] = [
    "ptr::eq",
    "time::Duration",
    "arch::x86_64::_mm256_",
    "arch::x86_64::__m256",
    "arch::x86_64::_CMP_",
];
/// Impure all the same: shared state, clocks, and maps whose order is another in every process.
const IMPURE: &str = "HashMap HashSet RandomState DefaultHasher Mutex RwLock Condvar Barrier mpsc atomic Once OnceLock LazyLock OnceCell Instant \
    SystemTime";
const MACROS: &str = "println eprintln print eprint dbg thread_local option_env";
/// Calls that read files or folders, whatever they are called on.
const FILES: &str = "canonicalize exists try_exists is_dir is_file is_symlink metadata symlink_metadata read_dir read_file read_from_file read_link";

fn has(words: &str, word: &str) -> bool {
    words.split_whitespace().any(|one| one == word)
}

/// Calls `look` with the tokens of every depth.
pub(crate) fn each_group(tokens: &[TokenTree], look: &mut impl FnMut(&[TokenTree])) {
    look(tokens);
    for token in tokens {
        if let TokenTree::Group(group) = token {
            each_group(&group.stream().into_iter().collect::<Vec<_>>(), look);
        }
    }
}

/// Calls `found` with every path, `a::b::c`, those of a `use a::{b, c::d}` written out.
pub(crate) fn each_path(tokens: &[TokenTree], found: &mut impl FnMut(&[String])) {
    paths_below(&[], tokens, found);
}

fn paths_below(prefix: &[String], tokens: &[TokenTree], found: &mut impl FnMut(&[String])) {
    let is_colon = |at: usize| tokens.get(at).is_some_and(|token| token.to_string() == ":");
    let (mut at, mut path) = (0, prefix.to_vec());
    while at < tokens.len() {
        match &tokens[at] {
            TokenTree::Group(group) => {
                let inside: Vec<_> = group.stream().into_iter().collect();
                paths_below(&[], &inside, found);
            }
            token @ (TokenTree::Ident(_) | TokenTree::Punct(_)) => {
                let is_name = matches!(token, TokenTree::Ident(_)) || token.to_string() == "*";
                if is_name {
                    path.push(token.to_string());
                    if is_colon(at + 1) && is_colon(at + 2) {
                        at += 3;
                        if let Some(TokenTree::Group(group)) = tokens.get(at)
                            && group.delimiter() == Delimiter::Brace
                        {
                            let inside: Vec<_> = group.stream().into_iter().collect();
                            paths_below(&path, &inside, found);
                            (at, path) = (at + 1, prefix.to_vec());
                        }
                        continue;
                    }
                    found(&path);
                }
                path = prefix.to_vec();
            }
            TokenTree::Literal(_) => {}
        }
        at += 1;
    }
}

/// The fault of a path in pure code, if it has one.
fn is_impure(path: &[String], dependencies: &[String]) -> bool {
    let first = path[0].as_str();
    let is_root = has("std core alloc", first);
    let rest = path.get(1..).unwrap_or_default().join("::");
    let second = path.get(1).map_or("", String::as_str);
    let is_module = second.starts_with(char::is_lowercase) || has("* self", second);
    let is_pure = has(STANDARD, second) || ITEMS.iter().any(|item| rest.starts_with(item));
    let is_dependency = dependencies.iter().any(|name| name == first) && path.len() > 1;
    let is_state = |word: &String| {
        has(IMPURE, word) && (path.len() > 1 || word.starts_with(char::is_uppercase))
    };
    is_root && is_module && !is_pure
        || is_dependency && !has(DEPENDENCIES, first)
        || is_dependency && first == "viz" && !rest.starts_with("digits")
        || is_dependency && first == "plotters" && !rest.starts_with("style")
        || is_dependency && first == "mesh_loader" && rest != "Mesh"
        || is_dependency && has(PROCESSES, first) && !has(STEP, second)
        || path.iter().any(is_state)
}

/// What a run depends on besides its input cannot be repeated: no clock, thread, file, environment, logger, hidden state or hash order.
fn impurities(code: &[TokenTree], dependencies: &[String]) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    each_path(code, &mut |path| {
        if is_impure(path, dependencies) {
            found.insert(path.join("::"));
        }
    });
    each_group(code, &mut |tokens| {
        let words: Vec<String> = tokens.iter().map(ToString::to_string).collect();
        for (at, word) in words.iter().enumerate() {
            let next = words.get(at + 1).map_or("", String::as_str);
            let before = if at > 0 { words[at - 1].as_str() } else { "" };
            let is_called = has(". :", before) && next.starts_with('(');
            let is_foreign = word == "extern" && (next == "crate" || next.starts_with('"'));
            let is_renamed = has("std core alloc", word) && (next == "as" || next == ";");
            if has(MACROS, word) && next == "!"
                || has(FILES, word) && is_called
                || word == "static" && before != "'"
                || is_foreign
                || is_renamed
            {
                found.insert(format!("{word} {next}"));
            }
        }
    });
    found
}

/// The files of a crate's pure rooms, and those of the crate that they name by `crate::` or `super::`, each with what made it pure.
fn rooms<'a>(package: &Package, files: &'a [File]) -> BTreeMap<&'a str, (&'a File, &'a str)> {
    let is_room = |file: &File| {
        CRATES.contains(&package.name.as_str())
            || file.path.ends_with("/cycle.rs")
            || ROOMS.iter().any(|room| {
                file.path
                    .strip_prefix(room)
                    .is_some_and(|rest| rest.starts_with(['.', '/']))
            })
    };
    let rooms = files.iter().filter(|file| is_room(file));
    let mut waiting: Vec<(&File, &str)> = rooms.map(|file| (file, "its room")).collect();
    let mut found = BTreeMap::new();
    while let Some((file, because)) = waiting.pop() {
        if found.insert(file.path.as_str(), (file, because)).is_some() {
            continue;
        }
        let source = format!("{}/src", package.folder);
        let here = file.path.trim_end_matches(".rs").trim_end_matches("/mod");
        let parent = here.rsplit_once('/').map_or("", |(parent, _)| parent);
        each_path(&file.code(), &mut |path| {
            let mut place = match path[0].as_str() {
                "crate" => source.clone(),
                "super" => parent.to_owned(),
                "self" => here.to_owned(),
                other => format!("{here}/{other}"),
            };
            let own = usize::from(has("crate super self", &path[0]));
            for part in &path[own..] {
                if own == 1 {
                    place = format!("{place}/{part}");
                }
                let names = [format!("{place}.rs"), format!("{place}/mod.rs")];
                let named = files.iter().filter(|one| names.contains(&one.path));
                waiting.extend(named.map(|one| (one, file.path.as_str())));
            }
        });
    }
    found
}

/// The judge of a run and its replay must agree in every bit, so this holds for pure crates, rooms and steps, and for every file that says PURE.
#[test]
fn pure_code_touches_nothing_but_numbers() {
    let (mut checked, mut wrong) = (0, Vec::new());
    for package in workspace() {
        let mut files = package.sources();
        files.retain(|file| !file.is_test());
        let kinds = package.dependencies("dependencies").into_iter();
        let dependencies: Vec<String> = kinds.map(|name| name.replace('-', "_")).collect();
        let rooms = rooms(&package, &files);
        let says_so = |file: &&File| {
            let head = file.text.lines().take_while(|line| line.starts_with("//!"));
            let mut words =
                head.flat_map(|line| line.split(|letter: char| !letter.is_alphanumeric()));
            words.any(|word| word == "PURE")
        };
        let claims = files
            .iter()
            .filter(says_so)
            .map(|file| (file, "its first lines"));
        for (file, because) in claims.chain(rooms.values().copied()) {
            checked += 1;
            let names = impurities(&file.code(), &dependencies);
            let place = format!("{} (pure by {because})", file.path);
            wrong.extend(
                names
                    .into_iter()
                    .map(|name| format!("{place} names {name}")),
            );
        }
    }
    assert!(
        checked > 100,
        "only {checked} files: looks in the wrong place"
    );
    assert!(wrong.is_empty(), "{wrong:#?}");
}
