//! The rules for pure code and the control path, one test per rule of the house; `docs/architecture.md` gives the reasons.

use std::collections::BTreeSet;

use crate::tokens::{Delimiter, TokenTree};

use crate::calls::owner;
use crate::pure_files::{PURE_CRATES, beyond_the_step, claimed_pure, pure_files};
use crate::rules::processes;
use crate::source;
use crate::syntax::{is, is_path_separator, paths, tokens_of, use_leaves, walk};

/// Crates on the way from a sensor sample to a torque.
pub(crate) const CONTROL_PATH: [&str; 5] =
    ["model", "control", "estimator", "analyzer", "controller"];

/// Crates that pure code may depend on: pure ones, processes (their step only), and libraries that compute or read text.
const PURE_DEPENDENCIES: [&str; 22] = [
    "analyzer",
    "bytemuck",
    "control",
    "controller",
    "estimator",
    "glam",
    "hdrhistogram",
    "libm",
    "lockstep",
    "model",
    "nalgebra",
    "operator",
    "plant",
    "rapier3d-f64",
    "serde",
    "serde_json",
    "shared-types",
    "sim",
    "thiserror",
    "toml",
    "urdf-rs",
    "wide",
];
/// The pure parts of other crates.
const PURE_PARTS: [&str; 2] = ["plotters::style", "viz::plot::digits"];
/// Modules of the standard library that hold no clock, thread, file, environment or process.
const PURE_STANDARD: [&str; 21] = [
    "any",
    "array",
    "borrow",
    "cell",
    "cmp",
    "collections",
    "convert",
    "error",
    "f32",
    "f64",
    "fmt",
    "iter",
    "marker",
    "mem",
    "num",
    "ops",
    "path",
    "result",
    "slice",
    "str",
    "sync",
];
/// Pure items of the other modules.
const PURE_ITEMS: [&str; 2] = ["ptr::eq", "time::Duration"];
/// Of the processor's instructions those of a register of four lanes: they compute, load and store. Others read clocks and noise.
const PURE_INSTRUCTIONS: [&str; 3] = [
    "arch::x86_64::_mm256_",
    "arch::x86_64::__m256",
    "arch::x86_64::_CMP_",
];
/// The impure parts that these modules hold all the same: shared state, and maps whose order is another in every process.
const IMPURE: [&str; 16] = [
    "HashMap",
    "HashSet",
    "RandomState",
    "DefaultHasher",
    "Mutex",
    "RwLock",
    "Condvar",
    "Barrier",
    "mpsc",
    "atomic",
    "Once",
    "OnceLock",
    "LazyLock",
    "OnceCell",
    "Instant",
    "SystemTime",
];

/// Calls that read files or folders, of the standard library's paths and of libraries.
const FILES: &str = "canonicalize exists try_exists is_dir is_file is_symlink metadata symlink_metadata read_dir read_file read_from_file read_link";

/// The names in code that are not pure: places of the standard library, other names of a crate's root, dependencies outside the list, mutable
/// or hidden state, output.
pub(crate) fn impurities(code: &[TokenTree], dependencies: &[String]) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let mut named = paths(code);
    for (name, path) in use_leaves(code) {
        let root =
            ["std", "core", "alloc"].contains(&path[0].as_str()) || dependencies.contains(&path[0]);
        if root && (path.len() == 1 && name != path[0] || path.len() == 1 && name == "*") {
            found.insert(format!("{} as {name}", path[0]));
        }
        if root {
            named.push(path);
        }
    }
    for path in &named {
        let first = path[0].as_str();
        let standard = ["std", "core", "alloc"].contains(&first) && path.len() > 1;
        let is_module = |word: &str| word.chars().all(|c| !c.is_uppercase());
        let is_pure = |rest: &[String]| {
            let item = rest.join("::");
            let computes = PURE_INSTRUCTIONS
                .iter()
                .any(|instruction| item.starts_with(instruction));
            PURE_STANDARD.contains(&rest[0].as_str())
                || PURE_ITEMS.contains(&item.as_str())
                || computes
        };
        if standard && is_module(&path[1]) && !is_pure(&path[1..]) {
            found.insert(path.join("::"));
        }
        if path.iter().any(|word| {
            IMPURE.contains(&word.as_str())
                && (path.len() > 1 || word.chars().any(char::is_uppercase))
        }) {
            found.insert(path.join("::"));
        }
        let is_allowed = PURE_DEPENDENCIES
            .iter()
            .any(|pure| pure.replace('-', "_") == first)
            || PURE_PARTS
                .iter()
                .any(|part| path.join("::").starts_with(part));
        if path.len() > 1 && dependencies.iter().any(|name| name == first) && !is_allowed {
            found.insert(path.join("::"));
        }
    }
    walk(code, &mut |tokens| {
        for (at, token) in tokens.iter().enumerate() {
            let after = tokens.get(at + 1);
            let macros = [
                "println",
                "eprintln",
                "print",
                "eprint",
                "dbg",
                "thread_local",
                "option_env",
            ];
            if macros.iter().any(|name| is(token, name)) && after.is_some_and(|next| is(next, "!"))
            {
                found.insert(format!("{token}!"));
            }
            let is_called = matches!(after, Some(TokenTree::Group(group)) if group.delimiter() == Delimiter::Parenthesis);
            let of_something = at > 0 && (is(&tokens[at - 1], ".") || is(&tokens[at - 1], ":"));
            if is_called && of_something && has(FILES, &token.to_string()) {
                found.insert(format!("{token}(…)"));
            }
            // `'static` is a lifetime.
            if is(token, "static") && !(at > 0 && is(&tokens[at - 1], "'")) {
                found.insert(format!(
                    "static {}",
                    after.map(ToString::to_string).unwrap_or_default()
                ));
            }
            if is(token, "extern")
                && after
                    .is_some_and(|next| is(next, "crate") || matches!(next, TokenTree::Literal(_)))
            {
                found.insert("extern".to_owned());
            }
        }
    });
    found
}

#[test]
fn rule_2_pure_code_touches_nothing_but_numbers() {
    let (mut checked, mut wrong) = (0, Vec::new());
    let workspace = source::workspace();
    for package in workspace {
        let dependencies: Vec<String> = package
            .imports()
            .map(|name| name.replace('-', "_"))
            .collect();
        let mut processes = processes(workspace);
        processes.retain(|process| package.imports().any(|import| import == *process));
        for (file, because) in pure_files(package)
            .into_iter()
            .chain(claimed_pure(package).map(|file| (file, file)))
        {
            checked += 1;
            let mut impure = impurities(&file.code, &dependencies);
            impure.extend(beyond_the_step(&file.code, &processes));
            let place = format!(
                "{} (pure because of {})",
                file.path.display(),
                because.path.display()
            );
            wrong.extend(
                impure
                    .into_iter()
                    .map(|word| format!("{place} names {word}")),
            );
        }
        if PURE_CRATES.contains(&package.name.as_str()) {
            let others = package
                .imports()
                .filter(|name| !PURE_DEPENDENCIES.contains(name));
            wrong.extend(others.map(|name| format!("{} depends on {name}", package.name)));
        }
    }
    assert!(
        checked > 30,
        "only {checked} files: the check looks in the wrong place"
    );
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn rule_2_the_check_sees_what_is_not_pure() {
    let dependencies = ["libc", "nalgebra", "message_log", "viz", "session"].map(str::to_owned);
    let seen = |text: &str| !impurities(&tokens_of(text), &dependencies).is_empty();
    for text in [
        "fn f() { std::fs::read(x); }",
        "fn f() { ::std::fs::read(x); }",
        "use std as s;",
        "use std::{self as s};",
        "use std::*;",
        "extern crate std as s;",
        "use std::{fmt, collections::{HashMap}};",
        "use std::{fmt, env::var};",
        "use std::time::{Duration, Instant};",
        "use std::sync::atomic::AtomicU64;",
        "fn f() { libc::clock_gettime(0, t); }",
        "use libc as c;",
        "static mut X: u64 = 0;",
        "fn f() { static N: AtomicU64 = AtomicU64::new(0); }",
        "fn f() { println!(); }",
        "extern \"C\" { fn getpid() -> i32; }",
        "fn f() { std::path::Path::new(x).exists() }",
        "fn f() { urdf_rs::read_file(p) }",
        "use std::sync::Once;",
        "fn f() { message_log::read(p) }",
        "use viz::Recording;",
        "fn f() { session::load(p) }",
        "use viz as v;",
        "use std::arch::x86_64::*;",
        "use std::arch::x86_64::{__m256d, _rdtsc};",
        "fn f() { std::arch::x86_64::_mm_prefetch::<0>(p) }",
    ] {
        assert!(seen(text), "{text}");
    }
    for text in [
        "fn f(x: &'static str) -> std::fmt::Result { libm::log(x); nalgebra::zero() }",
        "use std::{fmt, ops::{Add, Mul}};",
        "use std::arch::x86_64::__m256d; use std::arch::x86_64::_mm256_add_pd;",
    ] {
        assert!(!seen(text), "{text}");
    }
}

/// Functions of the standard library and of nalgebra that differ between machines; `sqrt` and the four operations are exact everywhere,
/// the products of `powi` come in an order that the documentation leaves open.
const PLATFORM: &str = "sin cos tan sin_cos asin acos atan atan2 sinh cosh tanh asinh acosh atanh sinh_cosh sinc sinhc cosc coshc exp exp2 \
    exp_m1 ln ln_1p log log2 log10 powi powf powc cbrt hypot gamma ln_gamma";
/// Constructors and methods of nalgebra's rotations that call them.
const TRIGONOMETRIC: &str = "from_euler_angles from_axis_angle from_scaled_axis from_matrix from_matrix_eps rotation_between scaled_rotation_between \
    rotation_between_axis euler_angles scaled_axis axis_angle angle_to angle new_rotation new_rotation_wrt_point slerp try_slerp look_at_rh look_at_lh";
/// Types of nalgebra whose `new` calls them.
const ROTATIONS: [&str; 8] = [
    "Rotation2",
    "Rotation3",
    "UnitQuaternion",
    "UnitComplex",
    "Isometry2",
    "Isometry3",
    "Similarity2",
    "Similarity3",
];

/// Whether a list of words has this one.
fn has(words: &str, word: &str) -> bool {
    words.split_whitespace().any(|one| one == word)
}

/// Calls of these functions: `x.sin()`, `f64::sin(x)`, `.map(f64::sin)`, `<f64>::sin(x)`, `Rotation3::new(…)`. Those of `libm` are allowed.
fn platform_calls(code: &[TokenTree]) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for (_, path) in use_leaves(code) {
        let last = path.last().map(String::as_str).unwrap_or_default();
        if ["std", "core", "f64", "nalgebra"].contains(&path[0].as_str()) && has(PLATFORM, last) {
            found.insert(path.join("::"));
        }
    }
    walk(code, &mut |tokens| {
        for at in 1..tokens.len() {
            let name = tokens[at].to_string();
            let is_method = is(&tokens[at - 1], ".")
                && tokens
                    .get(at + 1)
                    .is_some_and(|next| matches!(next, TokenTree::Group(_)));
            let of_a_path = at > 2 && is_path_separator(&tokens[at - 2..]);
            let owner = if of_a_path {
                owner(&tokens[..at - 2])
            } else {
                String::new()
            };
            let is_platform = has(PLATFORM, name.trim_start_matches("simd_")) && owner != "libm";
            let is_rotation =
                has(TRIGONOMETRIC, &name) || name == "new" && ROTATIONS.contains(&owner.as_str());
            if (is_platform || is_rotation) && (is_method || of_a_path) {
                found.insert(format!(
                    "{owner}{}{name}",
                    if of_a_path { "::" } else { "." }
                ));
            }
        }
    });
    found
}

#[test]
fn functions_that_differ_between_machines_are_those_of_libm() {
    let mut wrong = Vec::new();
    for package in source::workspace() {
        let pure = pure_files(package);
        let is_simulated = ["plant", "sim"].contains(&package.name.as_str())
            || CONTROL_PATH.contains(&package.name.as_str());
        for file in package
            .code()
            .filter(|file| is_simulated || pure.iter().any(|(one, _)| one.path == file.path))
        {
            wrong.extend(
                platform_calls(&file.code)
                    .into_iter()
                    .map(|name| format!("{}: {name}", file.path.display())),
            );
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    let seen = |text: &str| platform_calls(&tokens_of(text)).len();
    for text in [
        "x.sin()",
        "x.asinh()",
        "f64::sin(x)",
        "v.map(f64::cos)",
        "<f64>::sin(x)",
        "Rotation3::new(v)",
        "nalgebra::Rotation3::<f64>::new(v)",
        "UnitQuaternion::from_euler_angles(a, b, c)",
        "q.angle()",
        "Matrix4::new_rotation(v)",
        "x.simd_sin()",
        "x.powi(3)",
        "v.map(|x| f64::powi(x, 2))",
    ] {
        assert_eq!(seen(text), 1, "{text}");
    }
    for text in [
        "libm::sin(x)",
        "v.map(libm::cos)",
        "x.sqrt()",
        "Vector3::new(x, y, z)",
        "let sin = a.sin;",
    ] {
        assert_eq!(seen(text), 0, "{text}");
    }
}

/// Types whose size is not in their type: nalgebra's, and a matrix made of vectors on the heap.
fn dynamic_matrices(code: &[TokenTree]) -> BTreeSet<String> {
    let dynamic = |word: &str| {
        let begins = [
            "DMatrix",
            "DVector",
            "RowDVector",
            "OMatrix",
            "OVector",
            "VecStorage",
        ]
        .iter()
        .any(|name| word.starts_with(name));
        // Matrix6xX, MatrixXx3
        begins
            || word == "Dyn"
            || word == "Dynamic"
            || word.starts_with("Matrix") && (word.contains("xX") || word.contains("Xx"))
    };
    let mut found: BTreeSet<String> = paths(code)
        .into_iter()
        .flatten()
        .filter(|word| dynamic(word))
        .collect();
    walk(code, &mut |tokens| {
        for window in tokens.windows(5) {
            let words: Vec<String> = window.iter().map(ToString::to_string).collect();
            if words[..4] == ["Vec", "<", "Vec", "<"] && ["f64", "f32"].contains(&words[4].as_str())
            {
                found.insert(words.concat());
            }
        }
    });
    found
}

#[test]
fn rule_6_the_control_path_has_no_dynamic_matrices() {
    let mut wrong = Vec::new();
    for package in source::workspace()
        .iter()
        .filter(|package| CONTROL_PATH.contains(&package.name.as_str()))
    {
        for file in package.code() {
            wrong.extend(
                dynamic_matrices(&file.code)
                    .into_iter()
                    .map(|word| format!("{} names {word}", file.path.display())),
            );
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    let seen = |text: &str| dynamic_matrices(&tokens_of(text)).len();
    for text in [
        "x: nalgebra::Matrix6xX<f64>",
        "x: MatrixXx3<f64>",
        "x: DMatrix<f64>",
        "x: Vec<Vec<f64>>",
        "x: DVectorView<f64>",
    ] {
        assert_eq!(seen(text), 1, "{text}");
    }
    for text in [
        "x: Matrix6<f64>",
        "x: SMatrix<f64, 6, N>",
        "x: Vec<f64>",
        "x: MatrixView6<f64>",
    ] {
        assert_eq!(seen(text), 0, "{text}");
    }
}
