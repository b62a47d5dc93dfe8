//! Rules on dependencies, seams and files; `docs/architecture.md` gives the reasons.

use std::collections::BTreeSet;
use std::path::Path;

use crate::tokens::TokenTree;
use shared_types::graph::Graph;

use crate::purity::impurities;
use crate::source::{self, File, Package};
use crate::syntax::{is, items, paths, tokens_of, use_leaves, walk};

/// The only users of a dependency: of all crates whose names begin so, whatever part of a library they are.
const SEAMS: [(&str, &[&str]); 8] = [
    ("iceoryx2", &["runtime", "lab"]),
    ("franka", &["plant-fci"]),
    ("gilrs", &["operator"]),
    ("rapier", &["sim"]),
    ("parry", &["sim"]),
    ("re_", &["viz"]),
    ("rerun", &["viz"]),
    ("glam", &["sim", "viz"]),
];

/// The processes: crates that use `runtime`, `launcher` and all that use it apart, which start processes.
pub(crate) fn processes(workspace: &[Package]) -> Vec<&str> {
    let uses = |package: &Package, name: &str| package.imports().any(|import| import == name);
    let mut starters = vec!["launcher"];
    while let Some(more) = workspace.iter().find(|one| {
        !starters.contains(&one.name.as_str()) && starters.iter().any(|name| uses(one, name))
    }) {
        starters.push(&more.name);
    }
    let names = workspace
        .iter()
        .filter(|one| uses(one, "runtime"))
        .map(|one| one.name.as_str());
    names.filter(|name| !starters.contains(name)).collect()
}

#[test]
fn rule_1_shared_types_imports_no_other_crate_of_the_workspace() {
    let workspace = source::workspace();
    let names: Vec<&str> = workspace
        .iter()
        .map(|package| package.name.as_str())
        .collect();
    let shared_types = workspace
        .iter()
        .find(|package| package.name == "shared-types")
        .unwrap();
    assert_eq!(
        shared_types
            .imports()
            .filter(|name| names.contains(name))
            .collect::<Vec<_>>(),
        Vec::<&str>::new()
    );
}

/// Layouts that `derive(Pod)` cannot make.
const PLAIN_BY_HAND: [(&str, &str); 1] = [(
    "services/lab/src/benchmarks/transports/block.rs",
    "a length as a parameter of the type",
)];

/// `unsafe impl<…> Pod for …` and the like.
fn plain_data_by_hand(code: &[TokenTree]) -> bool {
    let mut found = false;
    walk(code, &mut |tokens| {
        for (at, _) in tokens
            .windows(2)
            .enumerate()
            .filter(|(_, pair)| is(&pair[0], "unsafe") && is(&pair[1], "impl"))
        {
            let names = ["Pod", "Zeroable", "AnyBitPattern", "NoUninit"];
            let mut head = tokens[at..].iter().take_while(|token| !is(token, "for"));
            found |= head.any(|token| names.iter().any(|name| is(token, name)));
        }
    });
    found
}

/// The `repr(C)` layouts at every depth, and how many of them do not derive `Pod`.
fn layouts_of(code: &[TokenTree]) -> (usize, usize) {
    let (mut layouts, mut unchecked) = (0, 0);
    walk(code, &mut |tokens| {
        for item in items(tokens) {
            let words = paths(&item.attributes.concat()).concat();
            if words.iter().any(|word| word == "repr") && words.iter().any(|word| word == "C") {
                layouts += 1;
                unchecked += usize::from(!words.iter().any(|word| word == "Pod"));
            }
        }
    });
    (layouts, unchecked)
}

#[test]
fn rule_1_the_check_sees_a_layout_by_hand() {
    assert!(plain_data_by_hand(&tokens_of(
        "unsafe impl<const N: usize> Pod for A<N> {}"
    )));
    assert!(plain_data_by_hand(&tokens_of(
        "mod m { unsafe impl bytemuck::Zeroable for A {} }"
    )));
    assert!(!plain_data_by_hand(&tokens_of(
        "unsafe impl Send for Pod {}"
    )));
    assert_eq!(
        layouts_of(&tokens_of("mod m { #[repr(C)] struct A; }")),
        (1, 1)
    );
    assert_eq!(
        layouts_of(&tokens_of("#[derive(Pod)] #[repr(C)] struct A;")),
        (1, 0)
    );
}

#[test]
fn rule_1_every_layout_is_plain_data_checked_at_compile_time() {
    let (mut layouts, mut wrong) = (0, Vec::new());
    for package in source::workspace() {
        for file in package.code() {
            // `derive(Pod)` refuses padding and fields that are not plain data; a hand-written `impl Pod` would not.
            let by_hand = plain_data_by_hand(&file.code)
                && !PLAIN_BY_HAND
                    .iter()
                    .any(|(path, _)| file.path == Path::new(path));
            if by_hand {
                wrong.push(format!("{} implements Pod by hand", file.path.display()));
            }
            if package.name != "shared-types" {
                continue;
            }
            let (checked, unchecked) = layouts_of(&file.code);
            layouts += checked;
            if unchecked > 0 {
                wrong.push(format!(
                    "{}: a repr(C) layout without derive(Pod)",
                    file.path.display()
                ));
            }
        }
    }
    assert!(
        layouts > 0 && wrong.is_empty(),
        "{layouts} layouts: {wrong:#?}"
    );
}

/// The parts of a library behind a seam that a `pub use`, a `pub extern crate` or a `pub type` hands on.
fn exported_seams(code: &[TokenTree]) -> Vec<String> {
    let is_seam = |name: &str| SEAMS.iter().any(|(seam, _)| name.starts_with(seam));
    let leaves = use_leaves(code);
    let renamed: Vec<&String> = leaves
        .iter()
        .filter(|(_, path)| is_seam(&path[0]))
        .map(|(name, _)| name)
        .collect();
    let mut found = Vec::new();
    walk(code, &mut |tokens| {
        for (at, _) in tokens
            .windows(2)
            .enumerate()
            .filter(|(_, pair)| is(&pair[0], "pub"))
        {
            let end = tokens[at..]
                .iter()
                .position(|token| is(token, ";"))
                .map_or(tokens.len(), |length| at + length);
            let first = if is(&tokens[at + 1], "use") {
                use_leaves(&tokens[at..end])
                    .into_iter()
                    .map(|(_, path)| path[0].clone())
                    .collect()
            } else if is(&tokens[at + 1], "extern") {
                tokens
                    .get(at + 3)
                    .map(|name| vec![name.to_string()])
                    .unwrap_or_default()
            } else if is(&tokens[at + 1], "type") {
                paths(&tokens[at + 2..end])
                    .into_iter()
                    .map(|path| path[0].clone())
                    .collect()
            } else {
                Vec::new()
            };
            found.extend(
                first
                    .into_iter()
                    .filter(|name| is_seam(name) || renamed.contains(&name)),
            );
        }
    });
    found
}

#[test]
fn rule_3_each_seam_has_one_crate() {
    let mut wrong = Vec::new();
    let mut used = BTreeSet::new();
    for package in source::workspace() {
        for (name, _) in &package.dependencies {
            let Some((seam, allowed)) = SEAMS.iter().find(|(seam, _)| name.starts_with(seam))
            else {
                continue;
            };
            used.insert(*seam);
            if !allowed.contains(&package.name.as_str()) {
                wrong.push(format!("{} depends on {name}", package.name));
            }
        }
    }
    for package in source::workspace() {
        for file in package.code() {
            wrong.extend(
                exported_seams(&file.code)
                    .into_iter()
                    .map(|name| format!("{} re-exports {name}", file.path.display())),
            );
            let bare = package.name == "lab"
                && !file
                    .path
                    .starts_with("services/lab/src/benchmarks/transports");
            if bare
                && paths(&file.code)
                    .iter()
                    .any(|path| path[0].starts_with("iceoryx2"))
            {
                wrong.push(format!(
                    "{} names iceoryx2: of lab, only the baseline transports may",
                    file.path.display()
                ));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    let seen = |text: &str| exported_seams(&tokens_of(text)).len();
    assert_eq!(
        seen("pub use rapier3d_f64::prelude::RigidBody;")
            + seen("mod a { pub use ::rerun::{Archetype as A}; }"),
        2
    );
    assert_eq!(
        seen("use rapier3d_f64 as r; pub use r::prelude::RigidBody;")
            + seen("pub extern crate rapier3d_f64;"),
        2
    );
    assert_eq!(
        seen("pub type Body = rapier3d_f64::prelude::RigidBody;")
            + seen("use glam as g; pub type V = g::DVec3;"),
        2
    );
    assert_eq!(
        seen(
            "pub(crate) use rapier3d_f64::prelude::*; pub use crate::drive::Drive; use glam::DVec3;"
        ),
        0
    );
    assert!(
        ["iceoryx2", "rapier", "re_", "glam"]
            .iter()
            .all(|seam| used.contains(seam)),
        "a seam without a user: {used:?}"
    );
}

/// Whether a file names one of these words, each as it stands in a path or before `!`.
fn named(file: &File, words: &[&str]) -> Vec<String> {
    let mut found: Vec<String> = paths(&file.code)
        .into_iter()
        .flatten()
        .filter(|word| words.contains(&word.as_str()))
        .collect();
    found.dedup();
    found
        .into_iter()
        .map(|word| format!("{} names {word}", file.path.display()))
        .collect()
}

#[test]
fn rule_1_shared_types_has_no_algebra_and_no_input_or_output() {
    let workspace = source::workspace();
    let shared_types = workspace
        .iter()
        .find(|package| package.name == "shared-types")
        .unwrap();
    let algebra: Vec<&str> = shared_types
        .imports()
        .filter(|name| ["nalgebra", "libm", "ndarray"].contains(name))
        .collect();
    assert_eq!(algebra, Vec::<&str>::new());
    let dependencies: Vec<String> = shared_types
        .imports()
        .map(|name| name.replace('-', "_"))
        .collect();
    let dependencies: Vec<String> = dependencies
        .into_iter()
        .filter(|name| !["bytemuck", "strsim"].contains(&name.as_str()))
        .collect();
    let wrong: Vec<String> = shared_types
        .code()
        .flat_map(|file| {
            impurities(&file.code, &dependencies)
                .into_iter()
                .map(|word| format!("{} names {word}", file.path.display()))
        })
        .collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn rule_4_the_launcher_does_not_know_the_content_of_messages() {
    let workspace = source::workspace();
    let launcher = workspace
        .iter()
        .find(|package| package.name == "launcher")
        .unwrap();
    let messages = workspace
        .iter()
        .find(|package| package.name == "shared-types")
        .unwrap()
        .files();
    let messages = messages
        .filter(|file| file.path.ends_with("messages.rs"))
        .flat_map(|file| declared(&file.tokens))
        .collect::<Vec<_>>();
    assert!(
        messages.len() >= 5,
        "the messages are declared elsewhere: {messages:?}"
    );
    let words: Vec<&str> = messages.iter().map(String::as_str).collect();
    let wrong: Vec<String> = launcher
        .code()
        .flat_map(|file| named(file, &words))
        .collect();
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

/// Ways to the terminal. A child's output may be sent somewhere: `Stdio` and `.stdout(…)` are no printing.
fn prints(code: &[TokenTree]) -> BTreeSet<String> {
    let streams = ["stdout", "stderr", "Stdout", "Stderr"];
    let named = paths(code)
        .into_iter()
        .chain(use_leaves(code).into_iter().map(|(_, path)| path));
    let of_streams = named.filter(|path| {
        path.len() > 1
            && path
                .last()
                .is_some_and(|last| streams.contains(&last.as_str()))
    });
    let mut found: BTreeSet<String> = of_streams.map(|path| path.join("::")).collect();
    walk(code, &mut |tokens| {
        let words = ["println", "eprintln", "print", "eprint", "dbg"];
        let macros = tokens
            .windows(2)
            .filter(|pair| words.iter().any(|word| is(&pair[0], word)) && is(&pair[1], "!"));
        found.extend(macros.map(|pair| pair[0].to_string()));
        let devices = ["\"/dev/tty\"", "\"/dev/stdout\"", "\"/dev/stderr\""];
        found.extend(
            tokens
                .iter()
                .map(ToString::to_string)
                .filter(|word| devices.contains(&word.as_str())),
        );
    });
    found
}

#[test]
fn session_and_lab_do_not_print() {
    let mut wrong = Vec::new();
    for package in source::workspace()
        .iter()
        .filter(|package| ["session", "lab"].contains(&package.name.as_str()))
    {
        for file in package.code() {
            wrong.extend(
                prints(&file.code)
                    .into_iter()
                    .map(|what| format!("{} prints: {what}", file.path.display())),
            );
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    for text in [
        "println!()",
        "writeln!(std::io::stdout(), x)",
        "use std::io::stderr;",
        "use std::io as o; o::stdout()",
        "Path::new(\"/dev/tty\")",
    ] {
        assert!(!prints(&tokens_of(text)).is_empty(), "{text}");
    }
    assert!(
        prints(&tokens_of(
            "command.stdout(Stdio::piped()); child.stderr.take()"
        ))
        .is_empty(),
        "a child's output is sent somewhere"
    );
}

/// The processes that import a process, with it.
fn imports_of_processes(workspace: &[Package]) -> Vec<(&str, &str)> {
    let processes = processes(workspace);
    let importers = workspace
        .iter()
        .filter(|package| processes.contains(&package.name.as_str()));
    importers
        .flat_map(|one| {
            one.imports()
                .filter(|import| processes.contains(import))
                .map(|import| (one.name.as_str(), import))
        })
        .collect()
}

#[test]
fn rule_4_no_process_imports_another_process() {
    let workspace = source::workspace();
    assert_eq!(imports_of_processes(workspace), []);
    let graph = Graph::parse(
        "services/graph.toml",
        include_str!("../../services/graph.toml"),
    )
    .unwrap();
    let found = processes(workspace);
    let missing: Vec<_> = graph
        .process
        .iter()
        .map(|process| &process.name)
        .filter(|name| !found.contains(&name.as_str()))
        .collect();
    assert!(
        missing.is_empty(),
        "processes of the graph without a crate of their name that uses `runtime`: {missing:?}"
    );
    let package = |name: &str, imports: &[&str]| Package {
        name: name.into(),
        dependencies: imports
            .iter()
            .map(|name| ((*name).to_owned(), "normal".to_owned()))
            .collect(),
        targets: Vec::new(),
    };
    let with = |more: Package| {
        let sample = [
            package("plant", &["runtime"]),
            package("launcher", &["runtime"]),
            package("session", &["launcher", "plant"]),
            more,
        ];
        imports_of_processes(&sample).len()
    };
    assert_eq!(
        with(package("camera", &["runtime", "plant"])),
        1,
        "a process that no list names"
    );
    assert_eq!(
        with(package("cli", &["runtime", "session", "plant"])) + with(package("chain", &["plant"])),
        0
    );
}

/// `include!` of a file that these checks would not read; what the build script writes below OUT_DIR is data.
fn included(code: &[TokenTree]) -> usize {
    let mut found = 0;
    walk(code, &mut |tokens| {
        for window in tokens.windows(3) {
            if let [name, mark, TokenTree::Group(group)] = window
                && is(name, "include")
                && is(mark, "!")
            {
                found += usize::from(!group.stream().to_string().contains("\"OUT_DIR\""));
            }
        }
        found += tokens
            .windows(2)
            .filter(|pair| is(&pair[0], "include") && is(&pair[1], "as"))
            .count();
    });
    found
}

#[test]
fn no_code_is_hidden_in_an_included_file() {
    let workspace = source::workspace();
    let files = workspace.iter().flat_map(Package::files);
    let wrong: Vec<String> = files
        .filter(|file| included(&file.tokens) > 0)
        .map(|file| file.path.display().to_string())
        .collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert_eq!(
        included(&tokens_of("fn f() { include!(\"hidden.rs\") }")),
        1
    );
    assert_eq!(
        included(&tokens_of(
            "const A: &[u8] = include!(concat!(env!(\"OUT_DIR\"), \"/a.rs\")); const B: &str = include_str!(\"b\");"
        )),
        0
    );
}
