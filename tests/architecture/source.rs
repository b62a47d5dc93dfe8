//! The workspace as data: its packages as cargo reports them, and each source file as tokens with its unit tests marked.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::str::FromStr;
use std::sync::LazyLock;

use crate::syntax::{is, items, only_tests, without_tests};
use crate::tokens::{TokenStream, TokenTree};
use serde_json::Value;

/// A package of the workspace.
pub(crate) struct Package {
    pub(crate) name: String,
    /// Dependencies: package name and kind (`normal`, `dev` or `build`).
    pub(crate) dependencies: Vec<(String, String)>,
    /// Its library, binaries, examples, benchmarks and integration tests.
    pub(crate) targets: Vec<Target>,
}

impl Target {
    /// A library of any kind (`lib`, `rlib`, `cdylib`, `proc-macro`, …) or a binary.
    pub(crate) fn is_shipped(&self) -> bool {
        !["test", "example", "bench", "custom-build"].contains(&self.kind.as_str())
    }
}

/// A crate as built from one root file.
pub(crate) struct Target {
    pub(crate) name: String,
    /// `lib`, `bin`, `test`, `example`, `bench` or `custom-build`.
    pub(crate) kind: String,
    pub(crate) files: Vec<File>,
}

/// One source file of a target.
pub(crate) struct File {
    /// Relative to the workspace.
    pub(crate) path: PathBuf,
    /// Its module path below the root of the target; empty for the root file.
    pub(crate) module: Vec<String>,
    pub(crate) text: String,
    /// All of it is compiled for unit tests only.
    pub(crate) test_only: bool,
    /// Everything, tests included; comments are not tokens, documentation is a `doc` attribute.
    pub(crate) tokens: Vec<TokenTree>,
    /// The same without the items that are compiled for unit tests only.
    pub(crate) code: Vec<TokenTree>,
}

impl File {
    /// The tokens that are compiled for tests only.
    pub(crate) fn test_code(&self) -> Vec<TokenTree> {
        if self.test_only {
            self.tokens.clone()
        } else {
            only_tests(&self.tokens)
        }
    }
}

impl Package {
    /// Packages that the code itself depends on; test and build dependencies left out.
    pub(crate) fn imports(&self) -> impl Iterator<Item = &str> {
        self.dependencies
            .iter()
            .filter(|(_, kind)| kind == "normal")
            .map(|(name, _)| name.as_str())
    }

    /// Files of the library and of the binaries that are not compiled for unit tests only.
    pub(crate) fn code(&self) -> impl Iterator<Item = &File> {
        let targets = self.targets.iter().filter(|target| target.is_shipped());
        targets
            .flat_map(|target| &target.files)
            .filter(|file| !file.test_only)
    }

    /// Every file of every target.
    pub(crate) fn files(&self) -> impl Iterator<Item = &File> {
        self.targets.iter().flat_map(|target| &target.files)
    }
}

pub(crate) fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// The packages of the workspace with all their sources, read once for all checks.
pub(crate) fn workspace() -> &'static [Package] {
    static WORKSPACE: LazyLock<Vec<Package>> = LazyLock::new(packages);
    &WORKSPACE
}

/// The packages as `cargo metadata` lists them.
fn packages() -> Vec<Package> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let arguments = [
        "metadata",
        "--no-deps",
        "--offline",
        "--format-version",
        "1",
    ];
    let output = Command::new(cargo)
        .args(arguments)
        .current_dir(root())
        .output()
        .expect("cargo metadata starts");
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let metadata: Value =
        serde_json::from_slice(&output.stdout).expect("cargo metadata prints JSON");
    metadata["packages"]
        .as_array()
        .expect("packages")
        .iter()
        .map(package)
        .collect()
}

fn package(entry: &Value) -> Package {
    let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let kind = |value: &Value| {
        if value.is_null() {
            "normal".to_owned()
        } else {
            text(value)
        }
    };
    let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
    let targets = list(&entry["targets"]).into_iter().map(|target| {
        let kind = text(&target["kind"][0]);
        let files = files_of(Path::new(&text(&target["src_path"])), kind == "test");
        Target {
            name: text(&target["name"]),
            kind,
            files,
        }
    });
    Package {
        name: text(&entry["name"]),
        dependencies: list(&entry["dependencies"])
            .iter()
            .map(|one| (text(&one["name"]), kind(&one["kind"])))
            .collect(),
        targets: targets.collect(),
    }
}

/// A root file and every file that its `mod` declarations lead to.
pub(crate) fn files_of(src: &Path, test_only: bool) -> Vec<File> {
    let mut found = Vec::new();
    add(
        src,
        src.parent().expect("a file lies in a folder"),
        Vec::new(),
        test_only,
        &mut found,
    );
    found
}

fn add(path: &Path, children: &Path, module: Vec<String>, test_only: bool, found: &mut Vec<File>) {
    let text =
        std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let tokens: Vec<TokenTree> = TokenStream::from_str(&text)
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()))
        .into_iter()
        .collect();
    let code = without_tests(&tokens);
    let mut declared = Vec::new();
    declarations(
        &tokens,
        path.parent().expect("a file lies in a folder"),
        children,
        &module,
        test_only,
        &mut declared,
    );
    let path = path.strip_prefix(root()).unwrap_or(path).to_owned();
    found.push(File {
        path,
        module,
        text,
        test_only,
        tokens,
        code,
    });
    for (path, module, test_only) in declared {
        let is_mod_rs = path.ends_with("mod.rs");
        let folder = path.parent().expect("a file lies in a folder");
        let children = if is_mod_rs {
            folder.to_owned()
        } else {
            path.with_extension("")
        };
        add(&path, &children, module, test_only, found);
    }
}

/// The files that `mod name;` declarations name: path, module, and whether it is for unit tests only.
fn declarations(
    tokens: &[TokenTree],
    folder: &Path,
    children: &Path,
    module: &[String],
    test_only: bool,
    found: &mut Vec<(PathBuf, Vec<String>, bool)>,
) {
    for item in items(tokens) {
        let Some(at) = item.body.iter().position(|token| is(token, "mod")) else {
            continue;
        };
        let (Some(TokenTree::Ident(name)), Some(after)) =
            (item.body.get(at + 1), item.body.get(at + 2))
        else {
            continue;
        };
        if at > 2 {
            continue; // a visibility has at most two tokens: this is no module
        }
        let name = name.to_string();
        let inside: Vec<String> = module.iter().cloned().chain([name.clone()]).collect();
        let test_only = test_only || item.for_tests;
        if let TokenTree::Group(group) = after {
            let tokens: Vec<TokenTree> = group.stream().into_iter().collect();
            declarations(
                &tokens,
                folder,
                &children.join(&name),
                &inside,
                test_only,
                found,
            );
            continue;
        }
        let named = item
            .attributes
            .iter()
            .find_map(|attribute| path_attribute(attribute))
            .map(|path| folder.join(path));
        let candidates = [
            named,
            Some(children.join(format!("{name}.rs"))),
            Some(children.join(&name).join("mod.rs")),
        ];
        let file = candidates.into_iter().flatten().find(|path| path.exists());
        found.push((
            file.unwrap_or_else(|| {
                panic!("no file for `mod {name};` below {}", children.display())
            }),
            inside,
            test_only,
        ));
    }
}

/// The value of `#[path = "…"]`.
fn path_attribute(attribute: &[TokenTree]) -> Option<String> {
    match attribute {
        [name, _, TokenTree::Literal(value)] if is(name, "path") => {
            Some(value.to_string().trim_matches('"').to_owned())
        }
        _ => None,
    }
}
