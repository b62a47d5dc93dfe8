//! A test claims something: it asserts, it does not end early in silence, and it is not ignored without a reason.

use std::collections::BTreeSet;

use crate::tokens::{Delimiter, TokenTree};

use crate::source;
use crate::syntax::{Function, functions, is, paths, walk};

/// Macros that fail a test.
const ASSERTIONS: [&str; 10] = [
    "assert",
    "assert_eq",
    "assert_ne",
    "assert_matches",
    "panic",
    "unreachable",
    "prop_assert",
    "prop_assert_eq",
    "prop_assert_ne",
    "compile_fail",
];
/// Methods that fail a test where something goes right that should not. `unwrap` and `expect` claim only that nothing went wrong.
const EXPECTATIONS: [&str; 2] = ["expect_err", "unwrap_err"];

/// Macros whose argument may be a constant and that fail all the same.
const FAILURES: [&str; 3] = ["panic", "unreachable", "compile_fail"];

/// Whether an assertion of these arguments can fail: they name something, constants of the language apart.
fn can_fail(arguments: &[TokenTree]) -> bool {
    let condition: Vec<TokenTree> = arguments
        .iter()
        .take_while(|token| !is(token, ","))
        .cloned()
        .collect();
    let names = |tokens: &[TokenTree]| {
        paths(tokens)
            .into_iter()
            .flatten()
            .any(|word| !["true", "false"].contains(&word.as_str()))
    };
    // `assert_eq!(1, f())`: the name may be on either side.
    names(&condition)
        || condition.len() < arguments.len()
            && !is_boolean(&condition)
            && names(&arguments[condition.len()..])
}

fn is_boolean(tokens: &[TokenTree]) -> bool {
    matches!(tokens, [token] if is(token, "true") || is(token, "false"))
}

/// Whether the block at this place may be passed over: that of an `if` or of a `while let` without an `else`, or of a `match` with an arm that does
/// nothing.
fn is_passed_over(body: &[TokenTree], at: usize) -> bool {
    let inside = |token: &TokenTree| match token {
        TokenTree::Group(group) if group.delimiter() == Delimiter::Brace => Some(group.stream()),
        _ => None,
    };
    let Some(block) = inside(&body[at]) else {
        return false;
    };
    let ends = |token: &TokenTree| is(token, ";") || is(token, ",") || inside(token).is_some();
    let head = &body[body[..at]
        .iter()
        .rposition(ends)
        .map_or(0, |before| before + 1)..at];
    let is_conditional = head
        .windows(2)
        .any(|pair| is(&pair[0], "if") || is(&pair[0], "while") && is(&pair[1], "let"));
    let is_nothing =
        |token: &TokenTree| matches!(token, TokenTree::Group(group) if group.inside().is_empty());
    let arms: Vec<TokenTree> = block.into_iter().collect();
    let is_idle = |arm: &[TokenTree]| is(&arm[0], "=") && is(&arm[1], ">") && is_nothing(&arm[2]);
    let has_idle_arm = head.iter().any(|token| is(token, "match")) && arms.windows(3).any(is_idle);
    has_idle_arm || is_conditional && !body.get(at + 1).is_some_and(|next| is(next, "else"))
}

/// Whether the tokens assert something by themselves: a constant asserts nothing, nor does the body of a loop over nothing, nor a block that a
/// condition passes over.
fn asserts_itself(body: &[TokenTree]) -> bool {
    for (at, token) in body.iter().enumerate() {
        let is_named = |names: &[&str]| {
            names.iter().any(|name| is(token, name))
                && body.get(at + 1).is_some_and(|next| is(next, "!"))
        };
        let is_method =
            at > 0 && is(&body[at - 1], ".") && EXPECTATIONS.iter().any(|name| is(token, name));
        if is_method || is_named(&FAILURES) {
            return true;
        }
        let TokenTree::Group(group) = token else {
            if let (true, Some(TokenTree::Group(arguments))) =
                (is_named(&ASSERTIONS), body.get(at + 2))
                && can_fail(arguments.inside())
            {
                return true;
            }
            continue;
        };
        let over_nothing = at > 1
            && is(&body[at - 2], "in")
            && matches!(&body[at - 1], TokenTree::Group(list) if list.delimiter() == Delimiter::Bracket && list.stream().is_empty());
        if !over_nothing && !is_passed_over(body, at) && asserts_itself(group.inside()) {
            return true;
        }
    }
    false
}

/// Whether a body asserts something, itself or through functions of the list that it calls.
pub(crate) fn asserts(body: &[TokenTree], all: &[Function]) -> bool {
    let mut seen = BTreeSet::new();
    let mut waiting: Vec<&[TokenTree]> = vec![body];
    while let Some(body) = waiting.pop() {
        if asserts_itself(body) {
            return true;
        }
        for word in paths(body)
            .into_iter()
            .filter_map(|path| path.last().cloned())
        {
            if seen.insert(word.clone()) {
                waiting.extend(
                    all.iter()
                        .filter(|function| function.name == word && !function.is_test())
                        .map(|function| function.body.as_slice()),
                );
            }
        }
    }
    false
}

/// Early ends of a test without a message: a `return` outside closures and inner functions that is not `return skipped(…)`.
fn silent_ends(body: &[TokenTree]) -> usize {
    let mut found = 0;
    let mut at = 0;
    while at < body.len() {
        match &body[at] {
            TokenTree::Ident(word) if *word == "return" => {
                found += usize::from(!body.get(at + 1).is_some_and(|next| is(next, "skipped")))
            }
            // Content of parentheses may be a closure; content of braces after `|…|` or `fn` is one.
            TokenTree::Group(group) if group.delimiter() == Delimiter::Brace => {
                let before: Vec<&TokenTree> = body[..at]
                    .iter()
                    .rev()
                    .take_while(|token| !is(token, ";") && !is(token, "="))
                    .collect();
                let is_function = before.iter().any(|token| is(token, "fn"))
                    || before.first().is_some_and(|token| is(token, "|"));
                if !is_function {
                    found += silent_ends(group.inside());
                }
            }
            _ => {}
        }
        at += 1;
    }
    found
}

/// `let Some(x) = f() else { return };`: a helper that asserts ends for want of something.
fn silent_elses(body: &[TokenTree]) -> usize {
    let mut found = 0;
    walk(body, &mut |tokens| {
        let is_bare = |block: &[TokenTree]| {
            block
                .iter()
                .all(|token| is(token, "return") || is(token, ";"))
                && !block.is_empty()
        };
        let ends =
            |block: &TokenTree| matches!(block, TokenTree::Group(group) if is_bare(group.inside()));
        found += tokens
            .windows(2)
            .filter(|pair| is(&pair[0], "else") && ends(&pair[1]))
            .count();
    });
    found
}

/// `if has_python(…) { … }` without an `else`: what could not run is reported by `skipped`, not passed over.
fn silent_conditions(body: &[TokenTree]) -> usize {
    let mut found = 0;
    walk(body, &mut |tokens| {
        for (at, _) in tokens
            .iter()
            .enumerate()
            .filter(|(_, token)| is(token, "if"))
        {
            let is_block = |token: &TokenTree| matches!(token, TokenTree::Group(group) if group.delimiter() == Delimiter::Brace);
            let Some(block) = tokens[at..]
                .iter()
                .position(is_block)
                .map(|length| at + length)
            else {
                continue;
            };
            let is_question = |pair: &[TokenTree]| {
                pair[0].to_string().starts_with("has_") && matches!(pair[1], TokenTree::Group(_))
            };
            let asks = tokens[at..block].windows(2).any(is_question);
            let reports = tokens[block..]
                .iter()
                .take_while(|token| !is(token, ";"))
                .take(3)
                .any(|part| {
                    paths(std::slice::from_ref(part))
                        .into_iter()
                        .flatten()
                        .any(|word| word == "skipped")
                });
            found += usize::from(asks && !reports);
        }
    });
    found
}

/// The properties of the fuzz targets: they take any bytes, and reject those that are no case.
const PROPERTIES: &str = "tests/system/properties";

const RETURNS: &str = "returns early without `return skipped(why)`";
const PASSES: &str = "passes over what cannot run without `skipped(why)`";

/// The defects of a test, beside the functions of its target that are compiled for tests only.
fn faults_of_a_test(test: &Function, all: &[Function]) -> Vec<&'static str> {
    let has =
        |attribute: &[TokenTree], word: &str| attribute.first().is_some_and(|name| is(name, word));
    let should_panic = test
        .attributes
        .iter()
        .any(|attribute| has(attribute, "should_panic"));
    let is_bare = test
        .attributes
        .iter()
        .any(|attribute| attribute.len() == 1 && has(attribute, "ignore"));
    let found = [
        (
            !should_panic && !asserts(&test.body, all),
            "asserts nothing",
        ),
        (silent_ends(&test.body) > 0, RETURNS),
        (silent_conditions(&test.body) > 0, PASSES),
        (is_bare, "is ignored without a reason"),
    ];
    found
        .into_iter()
        .filter(|(is_so, _)| *is_so)
        .map(|(_, fault)| fault)
        .collect()
}

/// The defects of a function that tests call and that asserts for them.
fn faults_of_a_helper(helper: &Function) -> Vec<&'static str> {
    let mut asserts = false;
    walk(&helper.body, &mut |tokens| {
        asserts |= asserts_itself(tokens)
    });
    let found = [
        (asserts && silent_elses(&helper.body) > 0, RETURNS),
        (silent_conditions(&helper.body) > 0, PASSES),
    ];
    found
        .into_iter()
        .filter(|(is_so, _)| *is_so)
        .map(|(_, fault)| fault)
        .collect()
}

#[test]
fn every_test_claims_something_and_none_ends_in_silence() {
    let workspace = source::workspace();
    let (mut tests, mut wrong) = (0, Vec::new());
    for package in workspace {
        for target in &package.targets {
            // A test may assert through a helper of another file of its target; what is shipped with it asserts nothing for it.
            let all: Vec<Function> = target
                .files
                .iter()
                .flat_map(|file| functions(&file.test_code()))
                .collect();
            for file in &target.files {
                for function in functions(&file.test_code()) {
                    tests += usize::from(function.is_test());
                    let is_property = file.path.starts_with(PROPERTIES) && !function.is_test();
                    let faults = if is_property {
                        Vec::new()
                    } else if function.is_test() {
                        faults_of_a_test(&function, &all)
                    } else {
                        faults_of_a_helper(&function)
                    };
                    wrong.extend(faults.into_iter().map(|fault| {
                        format!("{}: {} {fault}", file.path.display(), function.name)
                    }));
                }
            }
        }
    }
    // A line that a passing test prints is discarded: what could not run is reported by `skipped`.
    for file in workspace
        .iter()
        .flat_map(source::Package::files)
        .filter(|file| file.path.starts_with("tests/system"))
    {
        walk(&file.tokens, &mut |tokens| {
            if tokens.windows(2).any(|pair| {
                (is(&pair[0], "eprintln") || is(&pair[0], "println")) && is(&pair[1], "!")
            }) {
                wrong.push(format!(
                    "{} prints instead of reporting `skipped(why)`",
                    file.path.display()
                ));
            }
        });
    }
    assert!(
        tests > 300,
        "only {tests} tests: the check looks in the wrong place"
    );
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn the_check_sees_a_test_without_a_claim() {
    let of = |text: &str| {
        functions(
            &text
                .parse::<crate::tokens::TokenStream>()
                .unwrap()
                .into_iter()
                .collect::<Vec<_>>(),
        )
    };
    let claims = |text: &str| {
        let all = of(text);
        asserts(&all[0].body, &all)
    };
    assert!(claims("#[test] fn t() { assert_eq!(1, f()); }"));
    assert!(
        claims("#[test] fn t() { check(3); } fn check(n: u32) { assert!(n > 2); }"),
        "through a helper"
    );
    assert!(!claims("#[test] fn t() { f().expect(\"a file\"); }"));
    assert!(
        !claims("#[test] fn t() { f().unwrap(); }")
            && !claims("#[test] fn t() { check(3); } fn check(_: u32) {}")
    );
    assert!(
        !claims("#[test] fn t() { if let Some(x) = f() { assert!(x); } }"),
        "passed over where there is none"
    );
    assert!(
        !claims("#[test] fn t() { while let Some(x) = f() { assert!(x); } }")
            && !claims("#[test] fn t() { if f() { assert!(g()); } }")
    );
    assert!(claims(
        "#[test] fn t() { if let Some(x) = f() { assert!(x); } else { panic!(); } }"
    ));
    assert!(!claims(
        "#[test] fn t() { match f() { Some(x) => assert!(x), None => {} } }"
    ));
    assert!(!claims(
        "#[test] fn t() { match f() { Some(x) => { assert!(x); } _ => () } }"
    ));
    assert!(claims(
        "#[test] fn t() { match f() { Some(x) => assert!(x), None => panic!() } }"
    ));
    let shipped = "fn new() { assert!(f()); } #[cfg(test)] mod tests { #[test] fn t() { Foo::new(); } fn check() { assert!(f()); } }";
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("lib.rs"), shipped).unwrap();
    let names = |file: &source::File| {
        functions(&file.test_code())
            .into_iter()
            .map(|function| function.name)
            .collect::<Vec<_>>()
    };
    let files = source::files_of(&folder.path().join("lib.rs"), false);
    assert_eq!(
        names(&files[0]),
        ["t", "check"],
        "an assertion in the code itself is no claim of a test"
    );
    assert!(
        !claims("#[test] fn t() { assert!(true); }")
            && !claims("#[test] fn t() { assert_eq!(1, 1); f(); }"),
        "constants"
    );
    assert!(
        !claims("#[test] fn t() { assert!(true, \"{}\", f()); }"),
        "the text names something, the condition does not"
    );
    assert!(
        !claims("#[test] fn t() { for x in [] { assert!(f(x)); } }")
            && claims("#[test] fn t() { for x in [1] { assert!(f(x)); } }")
    );
    let silent = |text: &str| silent_conditions(&of(text)[0].body);
    assert_eq!(
        silent("#[test] fn t() { if has_python(\"\") { assert!(f()); } }"),
        1
    );
    assert_eq!(
        silent(
            "#[test] fn t() { if has_python(\"\") { assert!(f()); } else { skipped(\"no python\") } }"
        ),
        0
    );
    assert_eq!(
        silent(
            "#[test] fn t() { if !has_python(\"\") { return skipped(\"no python\"); } assert!(f()); }"
        ),
        0
    );
    let elses = |text: &str| faults_of_a_helper(&of(text)[0]);
    assert_eq!(
        elses("fn check(x: u8) { let Ok(y) = f(x) else { return }; assert!(y); }"),
        [RETURNS]
    );
    assert_eq!(
        elses("fn check(x: u8) { for y in f() { let Ok(z) = y else { return; }; assert!(z); } }"),
        [RETURNS]
    );
    assert!(
        elses("fn read(x: u8) -> bool { let Ok(y) = f(x) else { return false }; assert!(y); y }")
            .is_empty()
    );
    assert_eq!(
        elses("fn check(x: u8) { if has_python(x) { assert!(f(x)); } }"),
        [PASSES]
    );
    let ends = |text: &str| silent_ends(&of(text)[0].body);
    assert_eq!(
        ends("#[test] fn t() { let Some(x) = f() else { return }; assert!(x); }"),
        1
    );
    assert_eq!(
        ends(
            "#[test] fn t() { let Some(x) = f() else { return skipped(\"no ptrace\") }; assert!(x); }"
        ),
        0
    );
    assert_eq!(
        ends("#[test] fn t() { let f = |x| { return x; }; assert!(f(true)); }"),
        0,
        "a closure returns for itself"
    );
}
