//! The rules of the house that neither the compiler nor clippy nor cargo-deny can check; `docs/architecture.md` gives the reasons.

mod crates;
mod deny;
mod docs;
mod equations;
mod pure;

use std::path::{Path, PathBuf};

use proc_macro2::{Delimiter, TokenStream, TokenTree};

/// The folder of the repository.
fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The text of a file of the repository.
fn text(path: impl AsRef<Path>) -> String {
    let path = root().join(path);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// A Rust file of a crate.
struct File {
    /// From the root of the repository.
    path: String,
    text: String,
}

impl File {
    /// Whether it is compiled for tests only, by its place.
    fn is_test(&self) -> bool {
        let stem = self.path.trim_end_matches(".rs");
        self.path.contains("/tests/")
            || ["/tests", "_tests", "/testing"]
                .iter()
                .any(|end| stem.ends_with(end))
    }

    /// Its tokens, comments left out and test modules too.
    fn code(&self) -> Vec<TokenTree> {
        let stream: TokenStream = self.text.parse().expect("what compiles can be read");
        without_tests(stream)
    }
}

/// The tokens without the items behind `#[cfg(test)]` and `#[test]`.
fn without_tests(stream: TokenStream) -> Vec<TokenTree> {
    let (mut kept, mut tokens) = (Vec::new(), stream.into_iter().peekable());
    while let Some(token) = tokens.next() {
        let attribute = tokens.peek().map(|next| next.to_string().replace(' ', ""));
        let is_test = matches!(attribute.as_deref(), Some("[cfg(test)]" | "[test]"));
        if token.to_string() == "#" && is_test {
            tokens.find(|token| token.to_string() == ";" || is_group(token, Delimiter::Brace));
        } else {
            kept.push(token);
        }
    }
    kept
}

fn is_group(token: &TokenTree, delimiter: Delimiter) -> bool {
    matches!(token, TokenTree::Group(group) if group.delimiter() == delimiter)
}

/// The Rust files below a folder of the repository.
fn rust_files(folder: &str) -> Vec<File> {
    let (mut files, mut folders) = (Vec::new(), vec![root().join(folder)]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path: PathBuf = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|end| end == "rs") {
                let name = path.strip_prefix(root()).unwrap_or(&path);
                files.push(File {
                    path: name.display().to_string(),
                    text: text(&path),
                });
            }
        }
    }
    files.sort_by(|a, b| a.path.cmp(&b.path));
    files
}

/// A crate of the workspace.
struct Package {
    name: String,
    folder: String,
    manifest: toml::Table,
}

impl Package {
    /// The crates that a kind of dependency names, `dependencies` or `dev-dependencies`.
    fn dependencies(&self, kind: &str) -> Vec<&str> {
        let table = self.manifest.get(kind).and_then(toml::Value::as_table);
        table.map_or(Vec::new(), |table| {
            table.keys().map(String::as_str).collect()
        })
    }

    /// The files of its library.
    fn sources(&self) -> Vec<File> {
        rust_files(&format!("{}/src", self.folder))
    }
}

/// The crates that the workspace lists as its members.
fn workspace() -> Vec<Package> {
    let table = |path: String| text(path).parse::<toml::Table>().expect("a manifest");
    let root = table("Cargo.toml".to_owned());
    let members = root["workspace"]["members"]
        .as_array()
        .expect("a list")
        .iter();
    let folders = members.map(|folder| folder.as_str().expect("a path").to_owned());
    let package = |folder: String| {
        let manifest = table(format!("{folder}/Cargo.toml"));
        // As code names it: a crate that is published has another name in the registry.
        let library = manifest
            .get("lib")
            .and_then(|lib| lib.get("name")?.as_str());
        let name = library.map(|name| name.replace('_', "-")).or_else(|| {
            let name = manifest["package"]["name"].as_str();
            name.map(str::to_owned)
        });
        let name = name.expect("a name");
        Package {
            name,
            folder,
            manifest,
        }
    };
    folders.map(package).collect()
}

/// The table below a heading of `docs/architecture.md`, a row of trimmed cells each; the two lines of its head are left out.
fn table(heading: &str) -> Vec<Vec<String>> {
    let page = text("docs/architecture.md");
    let (_, below) = page.split_once(heading).expect("the heading");
    let rows = below
        .lines()
        .skip_while(|line| !line.starts_with('|'))
        .take_while(|line| line.starts_with('|'));
    rows.skip(2)
        .map(|row| {
            row.trim_matches('|')
                .split('|')
                .map(|cell| cell.trim().to_owned())
                .collect()
        })
        .collect()
}

/// The words between backticks.
fn quoted(text: &str) -> Vec<&str> {
    text.split('`').skip(1).step_by(2).collect()
}
