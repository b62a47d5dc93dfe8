//! The functions that a body calls, by name and by the type or module before it. What a method belongs to is not in the source text of its call.

use std::collections::BTreeSet;

use crate::syntax::{Function, is, is_path_separator, walk};
use crate::tokens::{Delimiter, TokenTree};

/// `qualifier::name(…)`, `.name(…)` or `name(…)`.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Call {
    pub(crate) name: String,
    pub(crate) qualifier: Option<String>,
    is_method: bool,
}

impl Call {
    /// Whether it may call a function of this name in the `impl` block of a type, or of none.
    pub(crate) fn may_be(&self, name: &str, owner: Option<&str>) -> bool {
        let fits = match (&self.qualifier, owner) {
            (Some(qualifier), Some(owner)) => qualifier == owner || qualifier == "Self",
            (Some(qualifier), None) => !is_type(qualifier),
            (None, owner) => self.is_method == owner.is_some(),
        };
        self.name == name && fits
    }
}

fn is_type(name: &str) -> bool {
    name.starts_with(char::is_uppercase)
}

/// Every call in a body, at every depth.
pub(crate) fn calls(body: &[TokenTree]) -> BTreeSet<Call> {
    let mut found = BTreeSet::new();
    walk(body, &mut |tokens| {
        for (at, token) in tokens.iter().enumerate() {
            let TokenTree::Ident(name) = token else { continue };
            if is_called(&tokens[at + 1..]) {
                let is_qualified = at > 2 && is_path_separator(&tokens[at - 2..]);
                let qualifier = is_qualified.then(|| owner(&tokens[..at - 2])).filter(|name| !name.is_empty());
                found.insert(Call { name: name.to_string(), qualifier, is_method: at > 0 && is(&tokens[at - 1], ".") });
            }
        }
    });
    found
}

/// Whether the tokens after a name are arguments, generic ones before them skipped.
fn is_called(after: &[TokenTree]) -> bool {
    let is_arguments = |token: &TokenTree| matches!(token, TokenTree::Group(group) if group.delimiter() == Delimiter::Parenthesis);
    let mut rest = after;
    if is_path_separator(after) && after.get(2).is_some_and(|token| is(token, "<")) {
        let mut depth = 0;
        let end = after.iter().position(|token| {
            depth += i32::from(is(token, "<")) - i32::from(is(token, ">"));
            is(token, ">") && depth == 0
        });
        rest = &after[end.map_or(after.len(), |end| end + 1)..];
    }
    rest.first().is_some_and(is_arguments)
}

/// The last name before a `::`, generic arguments skipped: `Rotation3` of `nalgebra::Rotation3::<f64>::new`.
pub(crate) fn owner(before: &[TokenTree]) -> String {
    let mut depth = 0;
    for token in before.iter().rev() {
        match token {
            token if is(token, ">") => depth += 1,
            token if is(token, "<") => depth -= 1,
            TokenTree::Ident(name) if depth == 0 => return name.to_string(),
            TokenTree::Punct(mark) if depth == 0 && mark.as_char() != ':' => break,
            _ => {}
        }
    }
    String::new()
}

/// A body and the bodies of the functions of its target that it calls, at most so many calls down.
pub(crate) fn reached<'a>(body: &'a [TokenTree], all: &'a [Function], depth: usize) -> Vec<&'a [TokenTree]> {
    let mut seen = BTreeSet::new();
    let (mut found, mut last) = (vec![body], vec![body]);
    for _ in 0..depth {
        let called: BTreeSet<Call> = last.into_iter().flat_map(calls).collect();
        let next = all.iter().enumerate().filter(|(_, one)| !one.is_test());
        let next = next.filter(|(_, one)| called.iter().any(|call| call.may_be(&one.name, one.owner.as_deref())));
        last = next.filter(|(at, _)| seen.insert(*at)).map(|(_, one)| one.body.as_slice()).collect();
        found.extend(&last);
    }
    found
}
