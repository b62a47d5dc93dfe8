//! No circle of files: the imports between the files of a crate form a directed graph without cycles.
//!
//! An edge leads from a file that names an item to the file that defines it. Re-exports are followed to the definition, so that
//! a facade (`pub use child::Item;`) does not hide an edge and does not count as one unless the facade's file uses the item itself.
//! A method is an edge too where the file of a type calls it and an `impl` block of that type in another file defines it.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::tokens::{Delimiter, TokenTree};

use crate::source::{self, File, Target};
use crate::syntax::{is, items, paths, type_of_impl, use_tree};

/// The bindings of one module: items that it defines, names that it imports, modules from which it imports everything.
#[derive(Default)]
struct Module {
    file: usize,
    items: BTreeSet<String>,
    imports: Vec<Import>,
}

/// One leaf of a `use` tree.
#[derive(Clone)]
struct Import {
    /// The name bound here; `*` for everything.
    name: String,
    path: Vec<String>,
    public: bool,
}

struct Crate<'a> {
    files: Vec<&'a File>,
    modules: BTreeMap<Vec<String>, Module>,
    /// `#[macro_export]` macros by name: the files that define them.
    macros: BTreeMap<String, usize>,
    /// Methods in `impl` blocks: the module and the name of the type as written there, the method, the file.
    methods: Vec<(Vec<String>, String, String, usize)>,
    /// Those of them that other modules may call.
    public_methods: BTreeSet<(String, usize)>,
}

/// For each file, by index, the files it depends on and through which names.
type Edges = BTreeMap<usize, BTreeMap<usize, BTreeSet<String>>>;

impl<'a> Crate<'a> {
    fn new(target: &'a Target) -> Self {
        let files: Vec<&File> = target.files.iter().filter(|file| !file.test_only).collect();
        let mut whole = Self {
            files,
            modules: BTreeMap::new(),
            macros: BTreeMap::new(),
            methods: Vec::new(),
            public_methods: BTreeSet::new(),
        };
        for index in 0..whole.files.len() {
            let (code, module) = (
                whole.files[index].code.clone(),
                whole.files[index].module.clone(),
            );
            whole.read(&code, module, index);
        }
        whole
    }

    fn read(&mut self, code: &[TokenTree], path: Vec<String>, file: usize) {
        let mut module = Module {
            file,
            ..Module::default()
        };
        for item in items(code) {
            let words: Vec<&TokenTree> = item
                .body
                .iter()
                .filter(|token| !matches!(token, TokenTree::Group(group) if group.delimiter() == Delimiter::Parenthesis))
                .collect();
            let public = words.first().is_some_and(|word| is(word, "pub"));
            let Some(at) = words
                .iter()
                .position(|word| KEYWORDS.iter().any(|keyword| is(word, keyword)))
            else {
                continue;
            };
            if is(words[at], "use") {
                let body: Vec<TokenTree> = words[at + 1..]
                    .iter()
                    .map(|token| (*token).clone())
                    .collect();
                let mut leaves = Vec::new();
                use_tree(&body, &[], &mut leaves);
                module
                    .imports
                    .extend(
                        leaves
                            .into_iter()
                            .map(|(name, path)| Import { name, path, public }),
                    );
                continue;
            }
            if is(words[at], "impl") {
                self.read_impl(item.body, &path, file);
                continue;
            }
            let skip = 1 + usize::from(is(words[at], "macro_rules"));
            let Some(name) = words[at + skip..].iter().find_map(|token| match token {
                TokenTree::Ident(ident)
                    if !["fn", "unsafe", "async", "extern", "mut"]
                        .iter()
                        .any(|word| *ident == word) =>
                {
                    Some(ident.to_string())
                }
                _ => None,
            }) else {
                continue;
            };
            if is(words[at], "mod") {
                if let Some(TokenTree::Group(group)) =
                    item.body.iter().find(|token| matches!(token, TokenTree::Group(group) if group.delimiter() == Delimiter::Brace))
                {
                    let inside: Vec<String> = path.iter().cloned().chain([name]).collect();
                    self.read(group.inside(), inside, file);
                }
                continue;
            }
            if is(words[at], "macro_rules")
                && item.attributes.iter().any(|attribute| {
                    attribute
                        .first()
                        .is_some_and(|name| is(name, "macro_export"))
                })
            {
                self.macros.insert(name.clone(), file);
            }
            module.items.insert(name);
        }
        self.modules.insert(path, module);
    }

    /// Notes the methods of an `impl Type` block; those of `impl Trait for Type` are called through the trait.
    fn read_impl(&mut self, body: &[TokenTree], module: &[String], file: usize) {
        let Some(TokenTree::Group(block)) = body.last() else {
            return;
        };
        if body.iter().any(|token| is(token, "for")) {
            return;
        }
        let Some(name) = type_of_impl(body) else {
            return;
        };
        for item in items(block.inside()) {
            let method = item
                .body
                .iter()
                .position(|token| is(token, "fn"))
                .and_then(|at| item.body.get(at + 1));
            if let Some(TokenTree::Ident(method)) = method {
                if item.body.first().is_some_and(|word| is(word, "pub")) {
                    self.public_methods.insert((method.to_string(), file));
                }
                self.methods
                    .push((module.to_vec(), name.clone(), method.to_string(), file));
            }
        }
    }

    /// For each file, the methods of its types that other files define: method and file.
    fn methods_elsewhere(&self) -> BTreeMap<usize, BTreeMap<&str, usize>> {
        let mut found: BTreeMap<usize, BTreeMap<&str, usize>> = BTreeMap::new();
        for (module, name, method, file) in &self.methods {
            if let Some(home) = self
                .resolve(module, std::slice::from_ref(name), 0)
                .filter(|home| home != file)
            {
                found.entry(home).or_default().insert(method, *file);
            }
        }
        found
    }

    /// Methods defined away from the file of their type whose name no other function of the crate has: whoever calls one uses that file.
    fn unique_elsewhere(&self) -> BTreeMap<&str, usize> {
        let mut counts: BTreeMap<String, usize> = BTreeMap::new();
        for function in self
            .files
            .iter()
            .flat_map(|file| crate::syntax::functions(&file.code))
        {
            *counts.entry(function.name).or_default() += 1;
        }
        let away = self.methods_elsewhere();
        let away = away
            .values()
            .flatten()
            .map(|(method, file)| (*method, *file));
        away.filter(|(method, file)| {
            counts.get(*method) == Some(&1)
                && self.public_methods.contains(&((*method).to_owned(), *file))
        })
        .collect()
    }

    /// The file that defines what a path names, seen from a module.
    fn resolve(&self, from: &[String], path: &[String], depth: usize) -> Option<usize> {
        if depth > 16 {
            return None;
        }
        let mut at: Vec<String> = from.to_vec();
        let mut rest = path;
        match path.first()?.as_str() {
            "crate" => {
                at.clear();
                rest = &rest[1..];
            }
            "self" => rest = &rest[1..],
            "super" => {
                while rest.first().is_some_and(|word| word == "super") {
                    at.pop()?;
                    rest = &rest[1..];
                }
            }
            first => {
                let module = self.modules.get(&at)?;
                let child: Vec<String> = at.iter().cloned().chain([first.to_owned()]).collect();
                let known = self.modules.contains_key(&child)
                    || module.imports.iter().any(|import| import.name == first);
                if !known {
                    return None; // another crate, the standard library, or an item of this module
                }
            }
        }
        while let Some((segment, after)) = rest.split_first() {
            let child: Vec<String> = at.iter().cloned().chain([segment.clone()]).collect();
            if self.modules.contains_key(&child) {
                at = child;
                rest = after;
                continue;
            }
            let module = self.modules.get(&at)?;
            if module.items.contains(segment) {
                return Some(module.file);
            }
            if let Some(import) = module.imports.iter().find(|import| import.name == *segment) {
                let whole: Vec<String> = import.path.iter().chain(after).cloned().collect();
                return self.resolve(&at, &whole, depth + 1);
            }
            if at.is_empty() && self.macros.contains_key(segment) {
                return self.macros.get(segment).copied();
            }
            let globs = module.imports.iter().filter(|import| import.name == "*");
            let found = globs.filter_map(|glob| {
                let whole: Vec<String> = glob.path.iter().chain(rest).cloned().collect();
                self.resolve(&at, &whole, depth + 1)
            });
            return found.into_iter().next().or(Some(module.file));
        }
        // A module by itself: what is used of it are paths of their own.
        None
    }

    fn edges(&self) -> Edges {
        let mut edges = Edges::new();
        let (elsewhere, unique) = (self.methods_elsewhere(), self.unique_elsewhere());
        let mut add = |from: usize, to: Option<usize>, name: &[String]| {
            if let Some(to) = to.filter(|to| *to != from) {
                edges
                    .entry(from)
                    .or_default()
                    .entry(to)
                    .or_default()
                    .insert(name.join("::"));
            }
        };
        for (path, module) in &self.modules {
            let code = module_code(
                &self.files[module.file].code,
                &path[self.files[module.file].module.len()..],
            );
            let (mut uses, mut others) = (Vec::new(), Vec::new());
            split_uses(&code, &mut uses, &mut others);
            let named = paths(&others);
            for path_used in &named {
                // A single word is an item of this module unless an import binds it.
                if path_used.len() > 1
                    || module
                        .imports
                        .iter()
                        .any(|import| import.name == path_used[0])
                {
                    add(module.file, self.resolve(path, path_used, 0), path_used);
                }
            }
            for import in &uses {
                let is_facade = import.public
                    && import.path.first().is_some_and(|first| {
                        let child: Vec<String> =
                            path.iter().cloned().chain([first.clone()]).collect();
                        first == "self" || self.modules.contains_key(&child)
                    });
                if !is_facade {
                    add(
                        module.file,
                        self.resolve(path, &import.path, 0),
                        &import.path,
                    );
                }
            }
            for name in called_methods(&others) {
                let to = elsewhere
                    .get(&module.file)
                    .and_then(|methods| methods.get(name.as_str()));
                let to = to.or_else(|| unique.get(name.as_str())).copied();
                add(module.file, to, &[format!(".{name}()")]);
            }
        }
        edges
    }
}

const KEYWORDS: [&str; 12] = [
    "use",
    "impl",
    "mod",
    "fn",
    "struct",
    "enum",
    "union",
    "trait",
    "type",
    "const",
    "static",
    "macro_rules",
];

/// The tokens of an inline module of a file without its own inline modules, which are looked at by themselves.
fn module_code(code: &[TokenTree], inline: &[String]) -> Vec<TokenTree> {
    let mut kept = Vec::new();
    for item in items(code) {
        let at = item.body.iter().take(3).position(|token| is(token, "mod"));
        let name = at
            .and_then(|at| item.body.get(at + 1))
            .map(ToString::to_string);
        let block = at.and_then(|at| match item.body.get(at + 2) {
            Some(TokenTree::Group(group)) => Some(group.stream().into_iter().collect::<Vec<_>>()),
            _ => None,
        });
        match (block, inline.split_first()) {
            (Some(block), Some((first, rest))) if name.as_ref() == Some(first) => {
                return module_code(&block, rest);
            }
            (None, None) => kept.extend(item.body.iter().cloned()),
            _ => {}
        }
    }
    kept
}

/// Takes `use` declarations, at any depth, out of the tokens.
fn split_uses(tokens: &[TokenTree], uses: &mut Vec<Import>, others: &mut Vec<TokenTree>) {
    for item in items(tokens) {
        let at = item.body.iter().take(3).position(|token| is(token, "use"));
        if let Some(at) = at {
            let public = item.body.first().is_some_and(|word| is(word, "pub"));
            let mut leaves = Vec::new();
            use_tree(&item.body[at + 1..], &[], &mut leaves);
            uses.extend(
                leaves
                    .into_iter()
                    .map(|(name, path)| Import { name, path, public }),
            );
            continue;
        }
        for attribute in &item.attributes {
            if !attribute.first().is_some_and(|name| is(name, "doc")) {
                others.extend(attribute.iter().cloned());
            }
        }
        for token in item.body {
            match token {
                TokenTree::Group(group) if group.delimiter() == Delimiter::Brace => {
                    let mut inside = Vec::new();
                    split_uses(group.inside(), uses, &mut inside);
                    others.push(TokenTree::Group(crate::tokens::Group::new(
                        Delimiter::Brace,
                        inside.into_iter().collect(),
                    )));
                }
                other => others.push(other.clone()),
            }
        }
    }
}

/// The names in `.name(…)`.
fn called_methods(tokens: &[TokenTree]) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    crate::syntax::walk(tokens, &mut |tokens| {
        for window in tokens.windows(3) {
            if let [dot, TokenTree::Ident(name), TokenTree::Group(group)] = window
                && is(dot, ".")
                && group.delimiter() == Delimiter::Parenthesis
            {
                found.insert(name.to_string());
            }
        }
    });
    found
}

/// For each file of a target, by its path, the files whose items it names.
pub(crate) fn files_named_by(target: &Target) -> BTreeMap<&Path, Vec<&File>> {
    let whole = Crate::new(target);
    let edges = whole.edges().into_iter();
    edges
        .map(|(from, to)| {
            (
                whole.files[from].path.as_path(),
                to.into_keys().map(|to| whole.files[to]).collect(),
            )
        })
        .collect()
}

/// The circles of a crate: each a set of files that depend on each other, with one closed way through it.
fn circles(target: &Target) -> Vec<String> {
    let whole = Crate::new(target);
    let edges = whole.edges();
    let count = whole.files.len();
    // The files that a file depends on, directly or through others.
    let reached = |from: usize| {
        let (mut seen, mut waiting) = (BTreeSet::new(), vec![from]);
        while let Some(file) = waiting.pop() {
            waiting.extend(
                edges
                    .get(&file)
                    .into_iter()
                    .flat_map(BTreeMap::keys)
                    .filter(|to| seen.insert(**to)),
            );
        }
        seen
    };
    let reaches: Vec<BTreeSet<usize>> = (0..count).map(reached).collect();
    let mut seen = BTreeSet::new();
    let mut found = Vec::new();
    for (from, reached) in reaches.iter().enumerate() {
        if !reached.contains(&from) || !seen.insert(from) {
            continue;
        }
        let members: Vec<usize> = reached
            .iter()
            .copied()
            .filter(|to| reaches[*to].contains(&from))
            .collect();
        seen.extend(&members);
        let mut text = String::new();
        for member in &members {
            for (to, names) in edges
                .get(member)
                .into_iter()
                .flatten()
                .filter(|(to, _)| members.contains(to))
            {
                let names: Vec<&str> = names.iter().map(String::as_str).collect();
                text += &format!(
                    "\n  {} -> {}: {}",
                    whole.files[*member].path.display(),
                    whole.files[*to].path.display(),
                    names.join(", ")
                );
            }
        }
        found.push(text);
    }
    found
}

#[test]
fn no_crate_has_a_circle_of_files() {
    let (mut found, mut files) = (Vec::new(), 0);
    for package in source::workspace() {
        for target in package
            .targets
            .iter()
            .filter(|target| ["lib", "bin"].contains(&target.kind.as_str()))
        {
            files += target.files.len();
            found.extend(
                circles(target)
                    .into_iter()
                    .map(|circle| format!("{}:{circle}", target.name)),
            );
        }
    }
    assert!(
        files > 100,
        "only {files} files: the check looks in the wrong place"
    );
    assert!(
        found.is_empty(),
        "{} circles of files:\n{}",
        found.len(),
        found.join("\n")
    );
}

#[test]
fn the_check_sees_a_circle_through_a_facade_and_through_a_method() {
    let folder = tempfile::tempdir().unwrap();
    let circles_of = |files: &[(&str, &str)]| {
        for (name, text) in files {
            std::fs::write(folder.path().join(name), text).unwrap();
        }
        let files = source::files_of(&folder.path().join("lib.rs"), false);
        circles(&Target {
            name: "sample".into(),
            kind: "lib".into(),
            files,
        })
    };
    let facade = ("lib.rs", "mod a;\nmod b;\npub use a::A;\npub use b::B;\n");
    let apart = [
        facade,
        ("a.rs", "pub struct A;\n"),
        ("b.rs", "use crate::A;\npub struct B(A);\n"),
    ];
    assert_eq!(circles_of(&apart), Vec::<String>::new());
    let through_the_facade = [
        facade,
        ("a.rs", "pub struct A;\nfn f(_: &crate::B) {}\n"),
        ("b.rs", "use crate::A;\npub struct B(A);\n"),
    ];
    assert_eq!(circles_of(&through_the_facade).len(), 1);
    let in_tests_only = [
        facade,
        (
            "a.rs",
            "pub struct A;\n#[cfg(test)]\nmod tests { use crate::B; }\n",
        ),
        ("b.rs", "use crate::A;\npub struct B(A);\n"),
    ];
    assert_eq!(circles_of(&in_tests_only), Vec::<String>::new());
    let after_the_tests = [
        facade,
        (
            "a.rs",
            "#[cfg(test)]\nmod tests {}\npub struct A;\nfn f(_: &crate::B) {}\n",
        ),
        ("b.rs", "use crate::A;\npub struct B(A);\n"),
    ];
    assert_eq!(
        circles_of(&after_the_tests).len(),
        1,
        "code after a test module is looked at"
    );
    let through_a_method = [
        facade,
        (
            "a.rs",
            "pub struct A;\nimpl A { fn outer(&self) { self.inner() } }\n",
        ),
        (
            "b.rs",
            "use crate::A;\npub struct B;\nimpl A { pub(crate) fn inner(&self) {} }\n",
        ),
    ];
    assert_eq!(circles_of(&through_a_method).len(), 1);
    let through_a_method_of_a_third = [
        ("lib.rs", "mod a;\nmod b;\nmod c;\n"),
        (
            "a.rs",
            "use crate::c::A;\npub struct Z;\nfn outer(x: &A) { x.inner() }\n",
        ),
        (
            "b.rs",
            "use crate::a::Z;\nuse crate::c::A;\nimpl A { pub(crate) fn inner(&self) { let _ = Z; } }\n",
        ),
        ("c.rs", "pub struct A;\n"),
    ];
    assert_eq!(circles_of(&through_a_method_of_a_third).len(), 1);
    let with_its_parent = [
        (
            "lib.rs",
            "mod a;\npub struct Shared;\npub fn run() { a::work(&Shared) }\n",
        ),
        ("a.rs", "pub fn work(_: &super::Shared) {}\n"),
    ];
    assert_eq!(circles_of(&with_its_parent).len(), 1);
}
