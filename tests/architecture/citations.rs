//! Each equation of the paper is computed where it is cited and checked where it is computed.
//!
//! The documentation of a function cites: `[CK95 Eq. 4]`, and the function computes something. A comment above a test ties the citation to a numeric
//! check: `// covers: CK95 Eq. 4 (operational_space::new)` names the cited functions by file and name, and the test calls each of them, at most four
//! calls down, and asserts a number. A figure is cited by the scenario that
//! reproduces it (`Chang & Khatib 1995, Figure 5.`) and covered by a test that names this scenario: `// covers: CK95 Figure 5`.

use std::collections::BTreeSet;

use crate::tokens::{Delimiter, TokenTree};

use crate::claims;
use crate::source::{self, File, Function, documentation, functions, is, is_path_separator, items, name_of, paths, root, walk};

/// Statements and figures of Chang & Khatib 1995.
const EQUATIONS: [&str; 5] = ["Eq. 1", "Eq. 2", "Eq. 3", "Eq. 4", "Eq. 5"];
const FIGURES: [&str; 4] = ["Figure 1", "Figure 2", "Figure 4", "Figure 5"];

/// An item of the paper and the function (`file::name`) or scenario that stands for it.
type Tie = (String, String);

/// The equations in `[CK95 Eq. 3, Eq. 5]` and `[CK95 Eq. 3 to 5]`; sections (`[CK95 §4]`) are no equations.
fn equations(text: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    // A citation between backticks is an example of the form.
    let text: String = text.split('`').step_by(2).collect();
    for citation in text.split("[CK95 ").skip(1).filter_map(|rest| rest.split(']').next()) {
        for (at, _) in citation.match_indices("Eq. ") {
            let rest = citation[at + 4..].split([',', '§']).next().unwrap_or_default();
            let numbers: Vec<u32> = rest.split(|c: char| !c.is_ascii_digit()).filter_map(|number| number.parse().ok()).collect();
            let last = if rest.contains(" to ") { numbers.get(1) } else { None };
            if let Some(first) = numbers.first() {
                found.extend((*first..=*last.unwrap_or(first)).map(|number| format!("Eq. {number}")));
            }
        }
    }
    found
}

/// How a covering test names a function of a file.
fn tie(file: &File, name: &str) -> String {
    format!("{}::{name}", file.path.file_stem().unwrap_or_default().to_string_lossy())
}

/// Whether a function of a file does arithmetic or compares, itself or through functions of the same file that it calls.
fn computes(name: &str, all: &[Function]) -> bool {
    let (mut seen, mut waiting) = (BTreeSet::new(), vec![name.to_owned()]);
    while let Some(name) = waiting.pop() {
        for function in all.iter().filter(|function| function.name == name && !function.is_test()) {
            let mut found = false;
            walk(&function.body, &mut |tokens| found |= has_arithmetic(tokens));
            if found {
                return true;
            }
            waiting
                .extend(paths(&function.body).into_iter().filter_map(|path| path.last().cloned()).filter(|word| seen.insert(word.clone())));
        }
    }
    false
}

/// A product, quotient, sum, difference or comparison of two values: an operator between two operands (no reference, arrow or generic argument).
fn has_arithmetic(tokens: &[TokenTree]) -> bool {
    let is_operand = |token: &TokenTree| !matches!(token, TokenTree::Punct(_));
    tokens.windows(3).any(|window| {
        let [left, operator, right] = window else { return false };
        let spaced = matches!(operator, TokenTree::Punct(sign) if "*/+-".contains(sign.as_char()));
        let compares = is(operator, "<") && matches!(left, TokenTree::Group(_));
        (spaced || compares) && is_operand(left) && (is_operand(right) || is(right, "-") || is(right, "=") || is(right, "&"))
    })
}

/// Whether a body asserts a number: an assertion that has a number in its condition, itself or in a function of its target that it calls.
fn asserts_number(body: &[TokenTree], all: &[Function]) -> bool {
    let (mut seen, mut waiting) = (BTreeSet::new(), vec![body.to_vec()]);
    while let Some(body) = waiting.pop() {
        let mut found = false;
        walk(&body, &mut |tokens| {
            for (at, _) in
                tokens.iter().enumerate().filter(|(_, token)| ["assert", "prop_assert", "assert_eq"].iter().any(|name| is(token, name)))
            {
                let Some(TokenTree::Group(arguments)) = tokens.get(at + 2) else { continue };
                let arguments: Vec<TokenTree> = arguments.stream().into_iter().collect();
                walk(&arguments, &mut |tokens| found |= tokens.iter().any(is_number));
            }
        });
        if found {
            return true;
        }
        for word in paths(&body).into_iter().filter_map(|path| path.last().cloned()).filter(|word| seen.insert(word.clone())) {
            waiting
                .extend(all.iter().filter(|function| function.name == word && !function.is_test()).map(|function| function.body.clone()));
        }
    }
    false
}

fn is_number(token: &TokenTree) -> bool {
    matches!(token, TokenTree::Literal(value) if value.to_string().starts_with(|first: char| first.is_ascii_digit()))
}

/// The citations of a file, tied to the item that each documents; an error for each at a place that computes nothing.
fn citations(file: &File, tokens: &[TokenTree], found: &mut BTreeSet<Tie>, wrong: &mut Vec<String>) {
    for item in items(tokens) {
        for equation in equations(&documentation(&item.attributes)) {
            match name_of(&item).filter(|_| !item.inner) {
                Some(name) if computes(&name, &functions(&file.tokens)) => drop(found.insert((equation, tie(file, &name)))),
                Some(name) => wrong.push(format!("{}: {name} cites [CK95 {equation}] and computes nothing", file.path.display())),
                None => wrong.push(format!(
                    "{}: [CK95 {equation}] stands at a whole file, not at the function that computes it",
                    file.path.display()
                )),
            }
        }
        for token in item.body {
            if let TokenTree::Group(group) = token {
                citations(file, group.inside(), found, wrong);
            }
        }
    }
}

/// `Eq. 4 (new, at)` as ties; `Figures 1 and 2` as ties to the scenarios that cite them.
fn named(text: &str, scenarios: &BTreeSet<Tie>) -> Option<Vec<Tie>> {
    if let Some(numbers) = text.strip_prefix("Figure") {
        let numbers = numbers.split(|c: char| !c.is_ascii_digit()).filter(|number| !number.is_empty());
        let figures: Vec<String> = numbers.map(|number| format!("Figure {number}")).collect();
        return Some(scenarios.iter().filter(|(figure, _)| figures.contains(figure)).cloned().collect());
    }
    let (item, rest) = text.split_once(" (")?;
    let names = rest.split_once(')')?.0;
    Some(names.split(", ").map(|name| (item.to_owned(), name.to_owned())).collect())
}

/// Calls from a test to the function that computes the equation, at most.
const CALLS: usize = 4;

/// Whether the tokens after a name use it: a call, an item of it, its fields; a name alone may be a variable.
fn is_used(after: &[TokenTree]) -> bool {
    let is_group = |token: &TokenTree| matches!(token, TokenTree::Group(group) if group.delimiter() != Delimiter::Bracket);
    after.first().is_some_and(is_group) || is_path_separator(after)
}

/// Whether a body uses something, itself or through functions of its target that it calls.
fn mentions(body: &[TokenTree], all: &[Function], name: &str) -> bool {
    let literal = format!("\"{name}\"");
    let mut seen = BTreeSet::new();
    let mut bodies = vec![body];
    for _ in 0..=CALLS {
        let mut next = Vec::new();
        for body in bodies {
            let words: BTreeSet<String> = paths(body).into_iter().flatten().collect();
            let mut found = false;
            walk(body, &mut |tokens| {
                found |= tokens.iter().any(|token| matches!(token, TokenTree::Literal(value) if value.to_string() == literal));
                found |= tokens.iter().enumerate().any(|(at, token)| is(token, name) && is_used(&tokens[at + 1..]));
            });
            if found {
                return true;
            }
            let called = all.iter().filter(|function| words.contains(&function.name) && !function.is_test());
            next.extend(called.filter(|function| seen.insert(function.name.clone())).map(|function| function.body.as_slice()));
        }
        bodies = next;
    }
    false
}

/// The ties of the `// covers:` comments of a file.
fn coverage(file: &File, target: &[Function], scenarios: &BTreeSet<Tie>, found: &mut BTreeSet<Tie>, wrong: &mut Vec<String>) {
    let all = functions(&file.tokens);
    for (at, line) in file.text.lines().enumerate() {
        let Some(text) = line.trim_start().strip_prefix("// covers: CK95 ") else { continue };
        let place = format!("{}:{}", file.path.display(), at + 1);
        let Some(ties) = named(text, scenarios) else {
            wrong.push(format!("{place}: no name in parentheses: {text}"));
            continue;
        };
        let below: Vec<&str> = file.text.lines().skip(at + 1).take(6).map(str::trim_start).collect();
        let name = below.iter().find_map(|line| line.strip_prefix("fn ")).and_then(|rest| rest.split(['(', '<']).next());
        let Some(test) = all.iter().find(|function| function.is_test() && Some(function.name.as_str()) == name) else {
            wrong.push(format!("{place}: no test follows"));
            continue;
        };
        if !claims::asserts(&test.body, target) || !asserts_number(&test.body, target) {
            wrong.push(format!("{place}: {} asserts no number", test.name));
        }
        for (item, name) in ties {
            if mentions(&test.body, target, name.rsplit("::").next().unwrap_or_default()) {
                found.insert((item, name));
            } else {
                wrong.push(format!("{place}: {} does not use {name}", test.name));
            }
        }
    }
}

/// The figures that each scenario of the program reproduces.
fn figures() -> BTreeSet<Tie> {
    let mut found = BTreeSet::new();
    for entry in std::fs::read_dir(root().join("sim/scenarios")).unwrap().flatten() {
        let text = std::fs::read_to_string(entry.path()).unwrap();
        let name = entry.path().file_stem().unwrap().to_string_lossy().into_owned();
        let shown = FIGURES.iter().filter(|figure| text.contains(&format!("Chang & Khatib 1995, {figure}.")));
        found.extend(shown.map(|figure| ((*figure).to_owned(), name.clone())));
    }
    found
}

#[test]
fn every_citation_is_tied_to_a_numeric_check() {
    let scenarios = figures();
    let (mut cited, mut covered, mut wrong) = (scenarios.clone(), BTreeSet::new(), Vec::new());
    for package in source::workspace() {
        for target in package.targets.iter().filter(|target| target.name != "architecture") {
            let all: Vec<Function> = target.files.iter().flat_map(|file| functions(&file.tokens)).collect();
            for file in &target.files {
                citations(file, &file.code, &mut cited, &mut wrong);
                coverage(file, &all, &scenarios, &mut covered, &mut wrong);
            }
        }
    }
    for item in EQUATIONS.iter().chain(&FIGURES) {
        if !cited.iter().any(|(cited, _)| cited == item) {
            wrong.push(format!("nothing cites {item}"));
        }
    }
    wrong.extend(cited.difference(&covered).map(|(item, name)| format!("{name} cites {item}, and no test covers it")));
    wrong
        .extend(covered.difference(&cited).map(|(item, name)| format!("a test covers {item} ({name}), and nothing of that name cites it")));
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn the_check_sees_what_is_missing() {
    let set = |list: &[&str]| list.iter().map(ToString::to_string).collect::<BTreeSet<_>>();
    assert_eq!(equations("x [CK95 Eq. 3 to 5, §4]"), set(&["Eq. 3", "Eq. 4", "Eq. 5"]));
    assert_eq!(equations("x [CK95 Eq. 3, Eq. 5]"), set(&["Eq. 3", "Eq. 5"]));
    assert_eq!(equations("x [CK95 §4] Eq. 1"), set(&[]));
    let folder = tempfile::tempdir().unwrap();
    let wrong_in = |text: &str| {
        let path = folder.path().join("lib.rs");
        std::fs::write(&path, text).unwrap();
        let file = &source::files_of(&path, false)[0];
        let (mut cited, mut covered, mut wrong) = (BTreeSet::new(), BTreeSet::new(), Vec::new());
        citations(file, &file.code, &mut cited, &mut wrong);
        coverage(file, &functions(&file.tokens), &BTreeSet::new(), &mut covered, &mut wrong);
        wrong.len() + cited.symmetric_difference(&covered).count()
    };
    let code = "/// x = 2y [CK95 Eq. 4]\nfn inverse(y: f64) -> f64 { y * 2.0 }\n";
    assert_eq!(wrong_in(&format!("{code}// covers: CK95 Eq. 4 (lib::inverse)\n#[test]\nfn t() {{ assert!(inverse(1.0) == 2.0); }}")), 0);
    assert_eq!(wrong_in(code), 1, "no test");
    assert_eq!(
        wrong_in(&format!("{code}// covers: CK95 Eq. 4 (lib::inverse)\nfn t() {{ assert!(inverse(1.0) == 2.0); }}")),
        2,
        "not a test"
    );
    assert_eq!(
        wrong_in(&format!("{code}// covers: CK95 Eq. 4 (lib::inverse)\n#[test]\nfn t() {{ let x = other(); assert!(x == 1); }}")),
        2,
        "not called"
    );
    assert_eq!(
        wrong_in(&format!("{code}// covers: CK95 Eq. 4 (lib::inverse)\n#[test]\nfn t() {{ let inverse = 1; assert!(inverse > 0); }}")),
        2,
        "a variable of that name"
    );
    assert_eq!(
        wrong_in(&format!("{code}// covers: CK95 Eq. 3 (lib::inverse)\n#[test]\nfn t() {{ assert!(inverse(1.0) == 2.0); }}")),
        2,
        "another equation"
    );
    let nothing = "/// x = 2y [CK95 Eq. 4]\nfn inverse(y: f64) -> f64 { y }\n";
    let test = "// covers: CK95 Eq. 4 (lib::inverse)\n#[test]\nfn t() { assert!(inverse(1.0) == 2.0); }";
    assert_eq!(wrong_in(&format!("{nothing}{test}")), 2, "nothing is computed");
    assert_eq!(wrong_in(&format!("{code}{}", test.replace("lib::", "other::"))), 2, "a function of that name elsewhere");
    assert_eq!(wrong_in(&format!("{code}{}", test.replace("inverse(1.0) == 2.0", "inverse(y).is_finite()"))), 1, "no number");
    assert_eq!(wrong_in("//! x = y [CK95 Eq. 4]\n"), 1, "at a file");
}
