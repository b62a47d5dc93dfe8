//! The functions that a body calls, by name and by the type or module before it. What a method belongs to is not in the source text of its call.

use std::collections::BTreeSet;

use crate::syntax::{Function, is, is_path_separator, paths, walk};
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
            (Some(qualifier), Some(owner)) => qualifier == owner,
            (Some(qualifier), None) => !is_type(qualifier),
            (None, owner) => self.is_method == owner.is_some(),
        };
        self.name == name && fits
    }
}

fn is_type(name: &str) -> bool {
    name.starts_with(char::is_uppercase)
}

/// Every call in a function, at every depth; `Self` is the type of its `impl` block.
pub(crate) fn calls(from: &Function) -> BTreeSet<Call> {
    let mut found = BTreeSet::new();
    let named = |word: String| {
        if word == "Self" {
            from.owner.clone().unwrap_or(word)
        } else {
            word
        }
    };
    walk(&from.body, &mut |tokens| {
        for (at, token) in tokens.iter().enumerate() {
            let TokenTree::Ident(name) = token else {
                continue;
            };
            if is_called(&tokens[at + 1..]) {
                let is_qualified = at > 2 && is_path_separator(&tokens[at - 2..]);
                let qualifier = is_qualified
                    .then(|| named(owner(&tokens[..at - 2])))
                    .filter(|name| !name.is_empty());
                found.insert(Call {
                    name: name.to_string(),
                    qualifier,
                    is_method: at > 0 && is(&tokens[at - 1], "."),
                });
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

/// The functions of a target that a call may be. Of several free ones of a name those of the caller's file, or of the module before the name, come
/// first; of several methods those of a type that the caller names. A method of which there are many else is none of them: which is not in the text.
fn candidates<'a>(call: &Call, from: &Function, all: &'a [Function]) -> Vec<&'a Function> {
    let fits = |one: &&Function| !one.is_test() && call.may_be(&one.name, one.owner.as_deref());
    let found: Vec<&Function> = all.iter().filter(fits).collect();
    let near = call
        .qualifier
        .as_deref()
        .filter(|qualifier| !is_type(qualifier))
        .unwrap_or(&from.home);
    let named: Vec<String> = if call.is_method {
        paths(&from.body).into_iter().flatten().collect()
    } else {
        Vec::new()
    };
    let is_near = |one: &&Function| {
        one.owner
            .as_ref()
            .map_or(one.home == near, |owner| named.contains(owner))
    };
    let nearest: Vec<&Function> = found.iter().copied().filter(is_near).collect();
    match (nearest.is_empty(), call.is_method && found.len() > METHODS) {
        (false, _) => nearest,
        (true, true) => Vec::new(),
        (true, false) => found,
    }
}

/// Methods of one name that are all followed, at most.
const METHODS: usize = 4;

/// A function and those of its target that it calls, at most so many calls down.
pub(crate) fn reached<'a>(
    from: &'a Function,
    all: &'a [Function],
    depth: usize,
) -> Vec<&'a Function> {
    let mut seen: BTreeSet<*const Function> = BTreeSet::new();
    let (mut found, mut last) = (vec![from], vec![from]);
    for _ in 0..depth {
        let next = last.iter().flat_map(|one| {
            calls(one)
                .into_iter()
                .flat_map(|call| candidates(&call, one, all))
        });
        last = next
            .filter(|one| seen.insert(std::ptr::from_ref(*one)))
            .collect();
        found.extend(&last);
    }
    found
}
