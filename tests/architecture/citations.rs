//! Each equation of the paper is computed where it is cited and checked where it is computed.
//!
//! The documentation of a function cites: `[CK95 Eq. 4]`, and the function computes something. A comment above a test ties the citation to a numeric
//! check: `// covers: CK95 Eq. 4 (operational_space::new)` names the cited functions by file and name, and the test calls each of them, at most six
//! calls down, and pins a number down: an equality, an upper bound, or a yes or no to a number. That the formula in the documentation is the one that
//! the code computes is the numbers' part: it can't be read off the source. A figure is cited by the scenario that
//! reproduces it (`Chang & Khatib 1995, Figure 5.`) and covered by a test that names this scenario: `// covers: CK95 Figure 5`.

use std::collections::BTreeSet;
use std::path::Path;

use crate::tokens::TokenTree;

use crate::calls::{calls, reached};
use crate::claims;
use crate::source::{self, File, root};
use crate::syntax::{
    Function, documentation, functions, functions_of, is, items, name_of, paths, type_of_impl, walk,
};

/// Statements and figures of Chang & Khatib 1995.
const EQUATIONS: [&str; 5] = ["Eq. 1", "Eq. 2", "Eq. 3", "Eq. 4", "Eq. 5"];
const FIGURES: [&str; 5] = ["Figure 1", "Figure 2", "Figure 3", "Figure 4", "Figure 5"];
/// A figure that shows postures of several scenarios: its name in `figures.json`, and the file that draws it.
const DRAWN: (&str, &str) = ("fig3", "services/lab/src/studies/figures/locks.rs");

/// An item of the paper and the function (`file::name`) or scenario that stands for it.
type Tie = (String, String);

/// The equations in `[CK95 Eq. 3, Eq. 5]` and `[CK95 Eq. 3 to 5]`; sections (`[CK95 §4]`) are no equations.
fn equations(text: &str) -> BTreeSet<String> {
    numbered(&split_citations(text).0)
}

/// The text inside of `[CK95 …]`, and the rest of a text. A citation between backticks is an example of the form.
fn split_citations(text: &str) -> (String, String) {
    let text: String = text.split('`').step_by(2).collect();
    let (mut inside, mut outside) = (String::new(), String::new());
    for (place, piece) in text.split("[CK95 ").enumerate() {
        let (cited, rest) = if place == 0 {
            ("", piece)
        } else {
            piece.split_once(']').unwrap_or((piece, ""))
        };
        inside += &format!("{cited}, ");
        outside += rest;
    }
    (inside, outside)
}

/// The numbers of `Eq. 3` and `Eq. 3 to 5`; those of `Eq. 2.31` are another source's.
fn numbered(text: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for (at, _) in text.match_indices("Eq. ") {
        let rest = text[at + 4..].split([',', '§']).next().unwrap_or_default();
        let after = rest.trim_start_matches(|c: char| c.is_ascii_digit());
        let numbers: Vec<u32> = rest
            .split(|c: char| !c.is_ascii_digit())
            .map_while(|number| number.parse().ok())
            .collect();
        let is_other = after
            .strip_prefix('.')
            .is_some_and(|decimals| decimals.starts_with(|c: char| c.is_ascii_digit()));
        let second = after.strip_prefix(" to ").and_then(|rest| {
            rest.split(|c: char| !c.is_ascii_digit())
                .next()?
                .parse()
                .ok()
        });
        if let Some(first) = numbers.first().filter(|_| !is_other) {
            found.extend((*first..=second.unwrap_or(*first)).map(|number| format!("Eq. {number}")));
        }
    }
    found
}

fn home(file: &File) -> std::borrow::Cow<'_, str> {
    file.path.file_stem().unwrap_or_default().to_string_lossy()
}

/// How a covering test names a function of a file: `file::function` or `file::Type::method`.
fn tie(file: &File, owner: Option<&str>, name: &str) -> String {
    [Some(&*home(file)), owner, Some(name)]
        .into_iter()
        .flatten()
        .collect::<Vec<_>>()
        .join("::")
}

/// Whether a function of a file does arithmetic or compares, itself or through functions of the same file that it calls.
fn computes(name: &str, all: &[Function]) -> bool {
    let (mut seen, mut waiting) = (BTreeSet::new(), vec![name.to_owned()]);
    while let Some(name) = waiting.pop() {
        for function in all
            .iter()
            .filter(|function| function.name == name && !function.is_test())
        {
            let mut found = false;
            walk(&function.body, &mut |tokens| {
                found |= has_arithmetic(tokens)
            });
            if found {
                return true;
            }
            waiting.extend(
                paths(&function.body)
                    .into_iter()
                    .filter_map(|path| path.last().cloned())
                    .filter(|word| seen.insert(word.clone())),
            );
        }
    }
    false
}

/// A product, quotient, sum, difference or comparison of two values: an operator between two operands (no reference, arrow or generic argument).
fn has_arithmetic(tokens: &[TokenTree]) -> bool {
    let is_operand = |token: &TokenTree| !matches!(token, TokenTree::Punct(_));
    tokens.windows(3).any(|window| {
        let [left, operator, right] = window else {
            return false;
        };
        let spaced = matches!(operator, TokenTree::Punct(sign) if "*/+-".contains(sign.as_char()));
        let compares = is(operator, "<") && matches!(left, TokenTree::Group(_));
        (spaced || compares)
            && is_operand(left)
            && (is_operand(right) || is(right, "-") || is(right, "=") || is(right, "&"))
    })
}

/// Whether a test pins a number down, itself or in a function for tests that it calls: a sign alone does not.
fn pins_a_number(test: &Function, helpers: &[Function], ties: &[Tie]) -> bool {
    let names: Vec<&str> = ties
        .iter()
        .filter_map(|(_, place)| place.rsplit("::").next())
        .collect();
    let mut found = false;
    for one in reached(test, helpers, CALLS) {
        walk(&one.body, &mut |tokens| {
            for (at, token) in tokens.iter().enumerate() {
                let Some(TokenTree::Group(arguments)) = tokens.get(at + 2) else {
                    continue;
                };
                let is_equality = ["assert_eq", "prop_assert_eq"]
                    .iter()
                    .any(|name| is(token, name));
                let is_assertion = ["assert", "prop_assert"].iter().any(|name| is(token, name));
                found |= is_equality && has_number(arguments.inside())
                    || is_assertion && is_pin(arguments.inside(), &names);
            }
        });
    }
    found
}

/// An equality with a number in it, an upper bound that is a number, or a function of these names that answers yes or no to a number.
fn is_pin(arguments: &[TokenTree], names: &[&str]) -> bool {
    let condition: Vec<TokenTree> = arguments
        .iter()
        .take_while(|token| !is(token, ","))
        .cloned()
        .collect();
    let mut found = false;
    walk(&condition, &mut |tokens| {
        for (at, token) in tokens.iter().enumerate() {
            let next = |by: usize| tokens.get(at + by);
            let is_generic = at > 0 && is(&tokens[at - 1], ":");
            let is_bound = is(token, "<")
                && !is_generic
                && (next(1).is_some_and(is_number) || next(2).is_some_and(is_number));
            let is_equality =
                is(token, "=") && next(1).is_some_and(|next| is(next, "=")) && has_number(tokens);
            let ends = next(2).is_none_or(|next| is(next, "&") || is(next, "|"));
            let is_answer = names.iter().any(|name| is(token, name))
                && next(1).is_some_and(|arguments| has_number(std::slice::from_ref(arguments)));
            found |= is_bound || is_equality || is_answer && ends;
        }
    });
    found
}

fn has_number(tokens: &[TokenTree]) -> bool {
    let mut found = false;
    walk(tokens, &mut |tokens| found |= tokens.iter().any(is_number));
    found
}

fn is_number(token: &TokenTree) -> bool {
    matches!(token, TokenTree::Literal(value) if value.to_string().starts_with(|first: char| first.is_ascii_digit()))
}

/// The lines of comments that speak of an equation without citing it: no test is tied to them. The head of a file may name the equations that its
/// functions, or those of the files below it, cite.
fn loose_mentions(text: &str, cited_below: &BTreeSet<String>) -> Vec<usize> {
    let is_loose = |line: &str| {
        let Some((_, comment)) = line
            .split_once("//")
            .filter(|(code, _)| code.matches('"').count() % 2 == 0)
        else {
            return false;
        };
        let spoken = numbered(&split_citations(comment).1);
        let is_tie = comment.trim_start().starts_with("covers: CK95 ");
        let is_of_a_head = comment.starts_with('!') && spoken.is_subset(cited_below);
        !(is_tie || is_of_a_head || spoken.is_empty())
    };
    text.lines()
        .enumerate()
        .filter(|(_, line)| is_loose(line))
        .map(|(at, _)| at + 1)
        .collect()
}

/// The citations of a file, tied to the item that each documents; an error for each at a place that computes nothing.
fn citations(
    file: &File,
    tokens: &[TokenTree],
    owner: Option<&str>,
    found: &mut BTreeSet<Tie>,
    wrong: &mut Vec<String>,
) {
    for item in items(tokens) {
        for equation in equations(&documentation(&item.attributes)) {
            match name_of(&item).filter(|_| !item.inner) {
                Some(name) if computes(&name, &functions(&file.tokens)) => drop(found.insert((equation, tie(file, owner, &name)))),
                Some(name) => wrong.push(format!("{}: {name} cites [CK95 {equation}] and computes nothing", file.path.display())),
                None => wrong.push(format!(
                    "{}: [CK95 {equation}] stands at a whole file, not at the function that computes it",
                    file.path.display()
                )),
            }
        }
        for token in item.body {
            if let TokenTree::Group(group) = token {
                citations(
                    file,
                    group.inside(),
                    type_of_impl(item.body).as_deref().or(owner),
                    found,
                    wrong,
                );
            }
        }
    }
}

/// `Eq. 4 (new, at)` as ties; `Figures 1 and 2` as ties to the scenarios that cite them.
fn named(text: &str, scenarios: &BTreeSet<Tie>) -> Option<Vec<Tie>> {
    if let Some(numbers) = text.strip_prefix("Figure") {
        let numbers = numbers
            .split(|c: char| !c.is_ascii_digit())
            .filter(|number| !number.is_empty());
        let figures: Vec<String> = numbers.map(|number| format!("Figure {number}")).collect();
        return Some(
            scenarios
                .iter()
                .filter(|(figure, _)| figures.contains(figure))
                .cloned()
                .collect(),
        );
    }
    let (item, rest) = text.split_once(" (")?;
    let names = rest.split_once(')')?.0;
    Some(
        names
            .split(", ")
            .map(|name| (item.to_owned(), name.to_owned()))
            .collect(),
    )
}

/// Calls from a test to the function that computes the equation, at most.
const CALLS: usize = 6;

/// Whether a test uses what a tie names: it calls the function, or it names the scenario.
fn mentions(test: &Function, all: &[Function], (item, place): &Tie) -> bool {
    let functions = reached(test, all, CALLS);
    if FIGURES.contains(&item.as_str()) {
        let (literal, mut found) = (format!("\"{place}\""), false);
        let mut look =
            |tokens: &[TokenTree]| found |= tokens.iter().any(|token| token.to_string() == literal);
        functions.iter().for_each(|one| walk(&one.body, &mut look));
        return found;
    }
    let calls = |name: &str, owner: Option<&str>| {
        functions
            .iter()
            .flat_map(|one| calls(one))
            .any(|call| call.may_be(name, owner))
    };
    match place.split("::").collect::<Vec<_>>()[..] {
        [_, name] => calls(name, None),
        [_, owner, name] => calls(name, Some(owner)),
        _ => false,
    }
}

/// The functions of a target.
struct Functions {
    all: Vec<Function>,
    /// Those that are compiled for tests only.
    of_tests: Vec<Function>,
}

impl Functions {
    fn of(files: &[File]) -> Self {
        let all = files
            .iter()
            .flat_map(|file| functions_of(&home(file), &file.tokens))
            .collect();
        Self {
            all,
            of_tests: files
                .iter()
                .flat_map(|file| functions_of(&home(file), &file.test_code()))
                .collect(),
        }
    }
}

/// The ties of the `// covers:` comments of a file.
fn coverage(
    file: &File,
    target: &Functions,
    scenarios: &BTreeSet<Tie>,
    found: &mut BTreeSet<Tie>,
    wrong: &mut Vec<String>,
) {
    let all = functions_of(&home(file), &file.tokens);
    for (at, line) in file.text.lines().enumerate() {
        let Some(text) = line.trim_start().strip_prefix("// covers: CK95 ") else {
            continue;
        };
        let place = format!("{}:{}", file.path.display(), at + 1);
        let Some(ties) = named(text, scenarios) else {
            wrong.push(format!("{place}: no name in parentheses: {text}"));
            continue;
        };
        let below: Vec<&str> = file
            .text
            .lines()
            .skip(at + 1)
            .take(6)
            .map(str::trim_start)
            .collect();
        let name = below
            .iter()
            .find_map(|line| line.strip_prefix("fn "))
            .and_then(|rest| rest.split(['(', '<']).next());
        let Some(test) = all
            .iter()
            .find(|function| function.is_test() && Some(function.name.as_str()) == name)
        else {
            wrong.push(format!("{place}: no test follows"));
            continue;
        };
        if !claims::asserts(&test.body, &target.of_tests)
            || !pins_a_number(test, &target.of_tests, &ties)
        {
            wrong.push(format!("{place}: {} pins no number down", test.name));
        }
        for tie in ties {
            if mentions(test, &target.all, &tie) {
                found.insert(tie);
            } else {
                wrong.push(format!("{place}: {} does not use {}", test.name, tie.1));
            }
        }
    }
}

/// The figures of the paper, each with the scenario that reproduces it or the name of its drawing.
fn figures() -> BTreeSet<Tie> {
    let mut found = BTreeSet::new();
    let mut add = |path: &Path, name: &str| {
        let text = std::fs::read_to_string(path).unwrap();
        let shown = FIGURES
            .iter()
            .filter(|figure| text.contains(&format!("Chang & Khatib 1995, {figure}.")));
        found.extend(shown.map(|figure| ((*figure).to_owned(), name.to_owned())));
    };
    for entry in std::fs::read_dir(root().join("sim/scenarios"))
        .unwrap()
        .flatten()
    {
        add(
            &entry.path(),
            &entry.path().file_stem().unwrap().to_string_lossy(),
        );
    }
    add(&root().join(DRAWN.1), DRAWN.0);
    found
}

#[test]
fn every_citation_is_tied_to_a_numeric_check() {
    let scenarios = figures();
    let (mut cited, mut covered, mut wrong) = (scenarios.clone(), BTreeSet::new(), Vec::new());
    for package in source::workspace() {
        for target in package
            .targets
            .iter()
            .filter(|target| target.name != "architecture")
        {
            let functions = Functions::of(&target.files);
            let mut of_files: Vec<(&[String], BTreeSet<String>)> = Vec::new();
            for file in &target.files {
                let mut ties = BTreeSet::new();
                citations(file, &file.code, None, &mut ties, &mut wrong);
                of_files.push((
                    &file.module,
                    ties.iter().map(|(equation, _)| equation.clone()).collect(),
                ));
                cited.extend(ties);
                coverage(file, &functions, &scenarios, &mut covered, &mut wrong);
            }
            for file in &target.files {
                let below = of_files
                    .iter()
                    .filter(|(module, _)| module.starts_with(&file.module));
                let loose = loose_mentions(
                    &file.text,
                    &below.flat_map(|(_, equations)| equations.clone()).collect(),
                );
                wrong.extend(loose.into_iter().map(|line| {
                    format!(
                        "{}:{line} names an equation outside of `[CK95 …]`",
                        file.path.display()
                    )
                }));
            }
        }
    }
    for item in EQUATIONS.iter().chain(&FIGURES) {
        if !cited.iter().any(|(cited, _)| cited == item) {
            wrong.push(format!("nothing cites {item}"));
        }
    }
    wrong.extend(
        cited
            .difference(&covered)
            .map(|(item, name)| format!("{name} cites {item}, and no test covers it")),
    );
    wrong.extend(covered.difference(&cited).map(|(item, name)| {
        format!("a test covers {item} ({name}), and nothing of that name cites it")
    }));
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn the_check_sees_what_is_missing() {
    let set = |list: &[&str]| {
        list.iter()
            .map(ToString::to_string)
            .collect::<BTreeSet<_>>()
    };
    assert_eq!(
        equations("x [CK95 Eq. 3 to 5, §4]"),
        set(&["Eq. 3", "Eq. 4", "Eq. 5"])
    );
    assert_eq!(equations("x [CK95 Eq. 3, Eq. 5]"), set(&["Eq. 3", "Eq. 5"]));
    assert_eq!(equations("x [CK95 §4] Eq. 1"), set(&[]));
    let folder = tempfile::tempdir().unwrap();
    let wrong_in = |text: &str| {
        let path = folder.path().join("lib.rs");
        std::fs::write(&path, text).unwrap();
        let file = &source::files_of(&path, false)[0];
        let (mut cited, mut covered, mut wrong) = (BTreeSet::new(), BTreeSet::new(), Vec::new());
        citations(file, &file.code, None, &mut cited, &mut wrong);
        coverage(
            file,
            &Functions::of(std::slice::from_ref(file)),
            &BTreeSet::new(),
            &mut covered,
            &mut wrong,
        );
        wrong.len() + cited.symmetric_difference(&covered).count()
    };
    let code = "/// x = 2y [CK95 Eq. 4]\nfn inverse(y: f64) -> f64 { y * 2.0 }\n";
    assert_eq!(
        wrong_in(&format!(
            "{code}// covers: CK95 Eq. 4 (lib::inverse)\n#[test]\nfn t() {{ assert!(inverse(1.0) == 2.0); }}"
        )),
        0
    );
    assert_eq!(wrong_in(code), 1, "no test");
    assert_eq!(
        wrong_in(&format!(
            "{code}// covers: CK95 Eq. 4 (lib::inverse)\nfn t() {{ assert!(inverse(1.0) == 2.0); }}"
        )),
        2,
        "not a test"
    );
    assert_eq!(
        wrong_in(&format!(
            "{code}// covers: CK95 Eq. 4 (lib::inverse)\n#[test]\nfn t() {{ let x = other(); assert!(x == 1); }}"
        )),
        2,
        "not called"
    );
    assert_eq!(
        wrong_in(&format!(
            "{code}// covers: CK95 Eq. 4 (lib::inverse)\n#[test]\nfn t() {{ let inverse = 1; assert!(inverse > 0); }}"
        )),
        3,
        "a variable of that name"
    );
    assert_eq!(
        wrong_in(&format!(
            "{code}// covers: CK95 Eq. 3 (lib::inverse)\n#[test]\nfn t() {{ assert!(inverse(1.0) == 2.0); }}"
        )),
        2,
        "another equation"
    );
    let nothing = "/// x = 2y [CK95 Eq. 4]\nfn inverse(y: f64) -> f64 { y }\n";
    let test =
        "// covers: CK95 Eq. 4 (lib::inverse)\n#[test]\nfn t() { assert!(inverse(1.0) == 2.0); }";
    assert_eq!(
        wrong_in(&format!("{nothing}{test}")),
        2,
        "nothing is computed"
    );
    assert_eq!(
        wrong_in(&format!("{code}{}", test.replace("lib::", "other::"))),
        2,
        "a function of that name elsewhere"
    );
    assert_eq!(
        wrong_in(&format!(
            "{code}{}",
            test.replace("inverse(1.0) == 2.0", "inverse(y).is_finite()")
        )),
        1,
        "no number"
    );
    assert_eq!(wrong_in("//! x = y [CK95 Eq. 4]\n"), 1, "at a file");
    let sign = test.replace("inverse(1.0) == 2.0", "inverse(1.0) > 0.0");
    assert_eq!(
        wrong_in(&format!("{code}{sign}")),
        1,
        "a sign pins nothing down"
    );
    let told = test.replace("inverse(1.0) == 2.0", "other() == 2.0, \"{}\", \"inverse\"");
    assert_eq!(
        wrong_in(&format!("{code}{told}")),
        2,
        "the name in a message"
    );
    let method = "impl A {\n/// x = 2y [CK95 Eq. 4]\nfn new(y: f64) -> f64 { y * 2.0 }\n}\n// covers: CK95 Eq. 4 (lib::A::new)\n";
    assert_eq!(
        wrong_in(&format!(
            "{method}#[test]\nfn t() {{ assert!(A::new(1.0) == 2.0); }}"
        )),
        0
    );
    assert_eq!(
        wrong_in(&format!(
            "{method}#[test]\nfn t() {{ assert!(B::new(1.0) == 2.0); }}"
        )),
        2,
        "the `new` of another type"
    );
    let deep = "impl B { fn new(y: f64) -> f64 { A::new(y) } }\n#[test]\nfn t() { assert!(Vector3::new(1.0) == 2.0); }";
    assert_eq!(
        wrong_in(&format!("{method}{deep}")),
        2,
        "a `new` that no call reaches"
    );
    let none = BTreeSet::new();
    let text = "/// by Eq. 4\n// [CK95 Eq. 3]\n//! Eq. 3 to 5\nlet x = y; // Eq. 2\nlet x = \"// Eq. 3\";\n// RBDA Eq. 2.31, `Eq. 1`\n// covers: CK95 Eq. 4 (a::b)\n";
    assert_eq!(loose_mentions(text, &none), [1, 3, 4]);
    assert_eq!(
        loose_mentions(text, &set(&["Eq. 3", "Eq. 4", "Eq. 5"])),
        [1, 4],
        "the head of a file names what is cited below it"
    );
}
