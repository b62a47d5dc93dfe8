//! Rule 8: nothing is silently repaired. No number replaces one that could not be computed, no default a code that could not be read.

use std::path::Path;

use crate::pure_files::pure_files;
use crate::purity::CONTROL_PATH;
use crate::rules::processes;
use crate::source;
use crate::syntax::{is, tokens_of, walk};
use crate::tokens::{Delimiter, TokenTree};

/// The substitute for a failure of the call at this place: the arm of `None` or `Err` in its `match`, the `else` of its `if let`, where it
/// neither leaves nor passes the failure on.
fn replaced_failure(tokens: &[TokenTree], at: usize) -> Option<String> {
    let leaves = |tokens: &[TokenTree]| {
        let mut found = false;
        let words = [
            "return",
            "break",
            "continue",
            "Err",
            "None",
            "panic",
            "unreachable",
        ];
        walk(tokens, &mut |tokens| {
            found |= tokens
                .iter()
                .any(|token| words.iter().any(|word| is(token, word)) || is(token, "?"))
        });
        found
    };
    let block = |token: &TokenTree| match token {
        TokenTree::Group(group) if group.delimiter() == Delimiter::Brace => {
            Some(group.stream().into_iter().collect::<Vec<_>>())
        }
        _ => None,
    };
    let begins = tokens[..at].iter().rposition(|token| {
        is(token, ";") || is(token, "match") || is(token, "if") || block(token).is_some()
    })?;
    let end = at
        + tokens[at..]
            .iter()
            .position(|token| is(token, ";") || block(token).is_some())?;
    let body = block(&tokens[end])?;
    if tokens[at..end].iter().any(|token| is(token, "?")) {
        return None;
    }
    if is(&tokens[begins], "if") && tokens.get(begins + 1).is_some_and(|next| is(next, "let")) {
        let other = tokens
            .get(end + 1)
            .filter(|token| is(token, "else"))
            .and_then(|_| block(tokens.get(end + 2)?))?;
        return (!leaves(&other)).then(|| {
            format!(
                "{{ {} }}",
                other.into_iter().collect::<crate::tokens::TokenStream>()
            )
        });
    }
    if !is(&tokens[begins], "match") {
        return None;
    }
    for (place, token) in body.iter().enumerate() {
        let arrow =
            place >= 1 && is(token, "=") && body.get(place + 1).is_some_and(|next| is(next, ">"));
        let pattern = if arrow {
            body[..place]
                .iter()
                .rev()
                .take_while(|token| !is(token, ","))
                .collect::<Vec<_>>()
        } else {
            continue;
        };
        let fails = pattern
            .iter()
            .any(|token| is(token, "None") || is(token, "Err") || is(token, "_"));
        let value: Vec<TokenTree> = body[place + 2..]
            .iter()
            .take_while(|token| !is(token, ","))
            .cloned()
            .collect();
        if fails && !leaves(&value) {
            return Some(
                value
                    .into_iter()
                    .collect::<crate::tokens::TokenStream>()
                    .to_string(),
            );
        }
    }
    None
}

/// Calls whose failure says that there is no such number.
const ALGEBRA: &str = "try_inverse try_inverse_mut pseudo_inverse inverse cholesky solve try_solve lu qr svd try_svd try_normalize symmetric_eigen \
    try_symmetric_eigen eigenvalues lambda";
/// Calls whose failure says that a message or a checkpoint holds what nothing has written.
const DECODING: &str =
    "from_code from_repr from_bits try_from try_into from_utf8 try_pod_read_unaligned";
const REPAIRS: &str = "unwrap_or unwrap_or_default unwrap_or_else map_or map_or_else";

/// Whether a list of words has this one.
fn has(words: &str, token: &TokenTree) -> bool {
    words.split_whitespace().any(|word| is(token, word))
}

/// The stand-ins, each stated, for a code that can't be read or a number beyond the range of a type.
const SAID: [(&str, &str); 4] = [
    ("Refusal::Checkpoint", "the controller refuses to go on"),
    ("Mode::Regular", "beside a refusal of the same checkpoint"),
    ("Class::Unknown", "a type that the strategy takes as such"),
    ("u32::MAX", "an age in ticks: older than all limits"),
];

/// Whether these arguments of `unwrap_or` are one of [`SAID`].
fn is_said(arguments: &TokenTree) -> bool {
    let text: String = arguments.to_string().split_whitespace().collect();
    SAID.iter().any(|(value, _)| text == format!("({value})"))
}

/// A code that is read, and a default in its place: `X::from_code(code).unwrap_or_default()`, also where the reading is a closure's.
fn replaced_codes(code: &[TokenTree]) -> Vec<String> {
    let mut found = Vec::new();
    walk(code, &mut |tokens| {
        for (at, repair) in tokens
            .iter()
            .enumerate()
            .filter(|(_, token)| has(REPAIRS, token))
        {
            let Some(arguments @ TokenTree::Group(_)) = tokens
                .get(at + 1)
                .filter(|_| at > 0 && is(&tokens[at - 1], "."))
            else {
                continue;
            };
            let in_chain = |token: &&TokenTree| {
                !matches!(token, TokenTree::Punct(_)) || is(token, ".") || is(token, ":")
            };
            let chain: Vec<TokenTree> = tokens[..at]
                .iter()
                .rev()
                .take_while(in_chain)
                .cloned()
                .collect();
            let mut reads = Vec::new();
            walk(&chain, &mut |tokens| {
                reads.extend(
                    tokens
                        .iter()
                        .filter(|token| has(DECODING, token))
                        .map(ToString::to_string),
                )
            });
            if let Some(name) = reads.first().filter(|_| !is_said(arguments)) {
                found.push(format!("{name}(…).{repair}(…)"));
            }
        }
    });
    found
}

/// The denominators that a small number keeps from vanishing, `v / v.norm().max(1e-12)`: a direction that is none, without a word.
fn floored_divisors(code: &[TokenTree]) -> Vec<String> {
    let mut found = Vec::new();
    walk(code, &mut |tokens| {
        for (at, _) in tokens
            .iter()
            .enumerate()
            .filter(|(_, token)| is(token, "/"))
        {
            let in_chain = |token: &&TokenTree| {
                !matches!(token, TokenTree::Punct(_))
                    || is(token, ".")
                    || is(token, ":")
                    || is(token, "&")
            };
            let divisor: Vec<&TokenTree> = tokens[at + 1..].iter().take_while(in_chain).collect();
            for pair in divisor.windows(2).filter(|pair| is(pair[0], "max")) {
                let TokenTree::Group(argument) = pair[1] else {
                    continue;
                };
                if let [TokenTree::Literal(least)] = argument.inside()
                    && least
                        .to_string()
                        .parse::<f64>()
                        .is_ok_and(|least| least < SMALL)
                {
                    found.push(format!("/ … .max({least})"));
                }
            }
        }
    });
    found
}

/// The failure of a call of linear algebra followed by `.unwrap_or…`, and a test for NaN with a number in place of what failed it.
fn silent_repairs(code: &[TokenTree]) -> Vec<String> {
    let mut found = Vec::new();
    walk(code, &mut |tokens| {
        for (at, token) in tokens.iter().enumerate() {
            // .name(…) and, some calls later in its chain, .repair(…); after `?` the error has left.
            if let (TokenTree::Ident(name), Some(TokenTree::Group(_))) = (token, tokens.get(at + 1))
                && has(ALGEBRA, token)
            {
                for link in tokens[at + 2..].chunks(3) {
                    let [dot, TokenTree::Ident(repair), TokenTree::Group(_)] = link else {
                        break;
                    };
                    if !is(dot, ".") {
                        break;
                    }
                    if has(REPAIRS, &link[1]) {
                        found.push(format!("{name}(…).{repair}(…)"));
                    }
                }
                if let Some(what) = replaced_failure(tokens, at) {
                    found.push(format!("{name}(…) and in place of its failure {what}"));
                }
            }
            // if x.is_finite() { … } else { 0.0 }
            if is(token, "is_finite") || is(token, "is_nan") {
                let blocks = tokens[at..].iter().take(6).filter_map(|token| match token {
                    TokenTree::Group(group) if group.delimiter() == Delimiter::Brace => {
                        Some(group.stream().into_iter().collect::<Vec<_>>())
                    }
                    _ => None,
                });
                let constant =
                    |block: Vec<TokenTree>| matches!(block.as_slice(), [TokenTree::Literal(_)]);
                if blocks.into_iter().any(constant) {
                    found.push(format!(
                        "{token}: a number in place of one that is not finite"
                    ));
                }
            }
        }
    });
    found
}

/// Where an infinity is no error, once each: what has no limit.
const NO_LIMIT: [(&str, &str); 2] = [
    (
        "services/recorder/src/judge.rs",
        "a joint without a limit uses no share of it",
    ),
    (
        "services/control/src/baselines/hold_and_blend.rs",
        "a joint without a limit is pushed with one unit",
    ),
];

/// Floors under a divisor above this are limits of a quantity, in its unit.
const SMALL: f64 = 1e-3;
/// Divisions by a floored number that stand: at most so many in a crate, fewer with each that learns to say that there is no direction.
const FLOORED: [(&str, usize); 1] = [("control", 30)];

#[test]
fn rule_8_nothing_is_silently_repaired() {
    let mut wrong = Vec::new();
    let workspace = source::workspace();
    let processes = processes(workspace);
    for package in workspace {
        let (pure, name) = (pure_files(package), package.name.as_str());
        let mut floored = Vec::new();
        for file in package.code() {
            let path = file.path.display();
            let is_numeric =
                CONTROL_PATH.contains(&name) || pure.iter().any(|(one, _)| one.path == file.path);
            if is_numeric || processes.contains(&name) || name == "runtime" {
                let mut repairs = silent_repairs(&file.code);
                if NO_LIMIT
                    .iter()
                    .any(|(path, _)| file.path == Path::new(path))
                {
                    repairs.pop();
                }
                repairs.extend(replaced_codes(&file.code));
                wrong.extend(repairs.into_iter().map(|what| format!("{path}: {what}")));
            }
            if is_numeric {
                floored.extend(
                    floored_divisors(&file.code)
                        .into_iter()
                        .map(|what| format!("{path}: {what}")),
                );
            }
        }
        if floored.len()
            > FLOORED
                .iter()
                .find(|(crate_name, _)| *crate_name == name)
                .map_or(0, |(_, most)| *most)
        {
            wrong.push(format!(
                "{} divisions by a floored number: {floored:#?}",
                floored.len()
            ));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
    let codes = |text: &str| replaced_codes(&tokens_of(text)).len();
    assert_eq!(
        codes("let x = Refusal::from_code(from.stop).unwrap_or_default();"),
        1
    );
    assert_eq!(
        codes("let x = most.and_then(|code| Class::from_code(code)).unwrap_or_default();"),
        1
    );
    assert_eq!(
        codes("let x = f(y) + usize::try_from(last.bytes).unwrap_or(LONGEST);"),
        1
    );
    assert_eq!(
        codes(
            "Class::from_code(s.class).ok_or(Unknown)?; u32::try_from(age).unwrap_or(u32::MAX); a.from_code(x)?; b.unwrap_or(0)"
        ),
        0
    );
    assert_eq!(
        codes("Refusal::from_code(x).unwrap_or(Refusal::None)")
            + codes("Refusal::from_code(x).unwrap_or(Refusal::Checkpoint)"),
        1
    );
    let floors = |text: &str| floored_divisors(&tokens_of(text)).len();
    assert_eq!(
        floors("v / v.norm().max(1e-12)")
            + floors("a * (b / (c + d).max(1e-9))")
            + floors("1.0 / f(x)[0].abs().max(1e-30)"),
        3
    );
    assert_eq!(
        floors("a / share.max(1.0)")
            + floors("(a / b).max(1e-9)")
            + floors("a / b - c.max(1e-9)")
            + floors("a / b.max(SMALL)"),
        0
    );
    let seen = |text: &str| silent_repairs(&tokens_of(text)).len();
    assert_eq!(
        seen("let B = A.try_inverse().unwrap_or(Matrix3::identity());"),
        1
    );
    assert_eq!(seen("let y = if x.is_nan() { 0.0 } else { x };"), 1);
    assert_eq!(seen("let y = if x.is_finite() { x } else { 0.0 };"), 1);
    assert_eq!(seen("let B = A.try_inverse().ok_or(Error::Singular)?;"), 0);
    for text in [
        "match A.try_inverse() { Some(B) => B, None => Matrix3::identity() }",
        "let B = match A.try_inverse() { Some(B) => B, _ => Matrix3::identity() };",
        "if let Some(B) = A.try_inverse() { B } else { Matrix3::identity() }",
        "A.cholesky().map(|c| c.inverse()).unwrap_or(Matrix3::identity())",
        "solve(A, b).ok().unwrap_or(zero)",
    ] {
        assert!(seen(text) > 0, "{text}");
    }
    for text in [
        "match A.try_inverse() { Some(B) => Ok(B), None => Err(Error::Singular) }",
        "let Some(B) = A.try_inverse() else { return Err(Error::Singular) };",
        "if let Some(B) = A.try_inverse() { B } else { return None; }",
        "if let Some(B) = A.try_inverse() { found.push(B); }",
        "let B = solve(A, b)?.get(0).unwrap_or(zero);",
    ] {
        assert_eq!(seen(text), 0, "{text}");
    }
}
