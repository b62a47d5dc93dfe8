//! The structure of source text: its items, functions, paths and imports.

use std::str::FromStr;

use crate::tokens::{Delimiter, Group, Spacing, TokenStream, TokenTree};

/// One item, field or statement with its attributes.
pub(crate) struct Item<'a> {
    /// The inside of each `#[…]`, documentation included.
    pub(crate) attributes: Vec<Vec<TokenTree>>,
    /// From its visibility to its last token.
    pub(crate) body: &'a [TokenTree],
    /// It is compiled for unit tests only.
    pub(crate) for_tests: bool,
    /// The attributes are those of the file or block around it (`#![…]`, `//!`); the body is empty.
    pub(crate) inner: bool,
    pub(crate) all: &'a [TokenTree],
}

/// The items at the top of a token stream. An item ends with a block or a semicolon; inner attributes (`#![…]`) are items of their own.
pub(crate) fn items(tokens: &[TokenTree]) -> Vec<Item<'_>> {
    let mut found = Vec::new();
    let mut at = 0;
    while at < tokens.len() {
        let begin = at;
        let inner = is_inner(&tokens[at..]);
        let mut attributes = Vec::new();
        while let Some((attribute, length)) =
            attribute(&tokens[at..]).filter(|_| is_inner(&tokens[at..]) == inner)
        {
            attributes.push(attribute);
            at += length;
        }
        let end = if inner {
            at
        } else {
            at + length_of_item(&tokens[at..])
        };
        let for_tests = !inner && attributes.iter().any(|attribute| is_for_tests(attribute));
        found.push(Item {
            attributes,
            body: &tokens[at..end],
            for_tests,
            inner,
            all: &tokens[begin..end],
        });
        at = end.max(begin + 1);
    }
    found
}

fn is_inner(tokens: &[TokenTree]) -> bool {
    matches!(tokens, [hash, not, TokenTree::Group(_), ..] if is(hash, "#") && is(not, "!"))
}

/// The inside of the attribute that the tokens begin with, and how many tokens it takes.
fn attribute(tokens: &[TokenTree]) -> Option<(Vec<TokenTree>, usize)> {
    tokens.first().filter(|token| is(token, "#"))?;
    let inner = usize::from(is_inner(tokens));
    match tokens.get(1 + inner) {
        Some(TokenTree::Group(group)) if group.delimiter() == Delimiter::Bracket => {
            Some((group.stream().into_iter().collect(), 2 + inner))
        }
        _ => None,
    }
}

fn length_of_item(tokens: &[TokenTree]) -> usize {
    let words: Vec<String> = tokens
        .iter()
        .take(8)
        .filter(|token| !is_group(token))
        .map(ToString::to_string)
        .collect();
    let mut words = words
        .iter()
        .map(String::as_str)
        .skip_while(|word| *word == "pub");
    // `const fn` has a body; a constant ends with its semicolon, whatever blocks its value has.
    let to_semicolon = match words.next() {
        Some("use" | "static" | "type" | "let") => true,
        Some("const") => !matches!(words.next(), Some("fn" | "unsafe" | "async" | "extern")),
        _ => false,
    };
    for (at, token) in tokens.iter().enumerate() {
        let is_block =
            matches!(token, TokenTree::Group(group) if group.delimiter() == Delimiter::Brace);
        if is(token, ";") || is_block && !to_semicolon {
            let trailing =
                usize::from(is_block && tokens.get(at + 1).is_some_and(|next| is(next, ";")));
            return at + 1 + trailing;
        }
    }
    tokens.len()
}

/// `#[test]`, `#[cfg(test)]` and `#[cfg(all(test, …))]`.
fn is_for_tests(attribute: &[TokenTree]) -> bool {
    fn needs_test(tokens: &[TokenTree]) -> bool {
        match tokens {
            [word] => is(word, "test"),
            [word, TokenTree::Group(group)] if is(word, "all") => {
                let inside: Vec<TokenTree> = group.stream().into_iter().collect();
                inside.split(|token| is(token, ",")).any(needs_test)
            }
            _ => false,
        }
    }
    match attribute {
        [name, TokenTree::Group(group)] if is(name, "cfg") => {
            needs_test(&group.stream().into_iter().collect::<Vec<_>>())
        }
        _ => needs_test(attribute),
    }
}

/// The tokens without what is compiled for unit tests only, at every depth.
pub(crate) fn without_tests(tokens: &[TokenTree]) -> Vec<TokenTree> {
    let mut kept = Vec::new();
    for item in items(tokens) {
        if item.for_tests {
            continue;
        }
        for token in item.all {
            kept.push(match token {
                TokenTree::Group(group) => {
                    let inside: Vec<TokenTree> = group.stream().into_iter().collect();
                    let inside = if group.delimiter() == Delimiter::Brace {
                        without_tests(&inside)
                    } else {
                        inside
                    };
                    TokenTree::Group(Group::new(group.delimiter(), inside.into_iter().collect()))
                }
                other => other.clone(),
            });
        }
    }
    kept
}

/// The items that are compiled for unit tests only, at every depth.
pub(crate) fn only_tests(tokens: &[TokenTree]) -> Vec<TokenTree> {
    let inside = |token: &TokenTree| match token {
        TokenTree::Group(group) if group.delimiter() == Delimiter::Brace => {
            only_tests(group.inside())
        }
        _ => Vec::new(),
    };
    let of = |item: Item<'_>| {
        if item.for_tests {
            item.all.to_vec()
        } else {
            item.body.iter().flat_map(inside).collect()
        }
    };
    items(tokens).into_iter().flat_map(of).collect()
}

/// Whether a token is this word or this punctuation mark.
pub(crate) fn is(token: &TokenTree, text: &str) -> bool {
    match token {
        TokenTree::Ident(ident) => *ident == text,
        TokenTree::Punct(punct) => text.len() == 1 && text.starts_with(punct.as_char()),
        _ => false,
    }
}

fn is_group(token: &TokenTree) -> bool {
    matches!(token, TokenTree::Group(_))
}

/// The inside of the documentation lines among the attributes of an item.
pub(crate) fn documentation(attributes: &[Vec<TokenTree>]) -> String {
    let lines = attributes
        .iter()
        .filter_map(|attribute| match attribute.as_slice() {
            [name, _, TokenTree::Literal(value)] if is(name, "doc") => Some(value.to_string()),
            _ => None,
        });
    lines.collect::<Vec<_>>().join("\n")
}

/// The word after `fn`, `struct` and the like: the name of an item.
pub(crate) fn name_of(item: &Item<'_>) -> Option<String> {
    let kinds = [
        "fn",
        "struct",
        "enum",
        "union",
        "trait",
        "mod",
        "type",
        "const",
        "static",
        "macro_rules",
    ];
    let at = item
        .body
        .iter()
        .position(|token| kinds.iter().any(|kind| is(token, kind)))?;
    item.body[at + 1..].iter().find_map(|token| match token {
        TokenTree::Ident(ident)
            if !["fn", "unsafe", "async", "extern", "mut"]
                .iter()
                .any(|word| *ident == word) =>
        {
            Some(ident.to_string())
        }
        _ => None,
    })
}

/// A function with everything that a check of tests asks about.
pub(crate) struct Function {
    pub(crate) name: String,
    /// The type of its `impl` block.
    pub(crate) owner: Option<String>,
    /// The name of its file without extension; empty where it does not matter.
    pub(crate) home: String,
    /// The inside of each `#[…]`.
    pub(crate) attributes: Vec<Vec<TokenTree>>,
    pub(crate) body: Vec<TokenTree>,
}

impl Function {
    /// `#[test]`, also inside `proptest! { … }`.
    pub(crate) fn is_test(&self) -> bool {
        self.attributes
            .iter()
            .any(|attribute| matches!(attribute.as_slice(), [word] if is(word, "test")))
    }
}

/// Every function at every depth, those inside macros included.
pub(crate) fn functions(tokens: &[TokenTree]) -> Vec<Function> {
    functions_of("", tokens)
}

/// The same of a file of this name.
pub(crate) fn functions_of(home: &str, tokens: &[TokenTree]) -> Vec<Function> {
    let mut found = Vec::new();
    add_functions(tokens, None, &mut found);
    found
        .iter_mut()
        .for_each(|function: &mut Function| home.clone_into(&mut function.home));
    found
}

fn add_functions(tokens: &[TokenTree], owner: Option<&str>, found: &mut Vec<Function>) {
    for item in items(tokens) {
        let is_function = item.body.iter().take(6).any(|token| is(token, "fn"));
        if let (true, Some(name), Some(TokenTree::Group(block))) =
            (is_function, name_of(&item), item.body.last())
        {
            let owner = owner.map(str::to_owned);
            found.push(Function {
                name,
                owner,
                home: String::new(),
                attributes: item.attributes.clone(),
                body: block.inside().to_vec(),
            });
        }
        let implemented = type_of_impl(item.body);
        for token in item.body {
            if let TokenTree::Group(group) = token
                && group.delimiter() == Delimiter::Brace
            {
                add_functions(
                    group.inside(),
                    if is_function {
                        None
                    } else {
                        implemented.as_deref().or(owner)
                    },
                    found,
                );
            }
        }
    }
}

/// `Type` in `impl<…> Type<…> { … }` and in `impl<…> Trait for Type<…> { … }`.
pub(crate) fn type_of_impl(body: &[TokenTree]) -> Option<String> {
    let head = body.iter().take_while(|token| !is(token, "where"));
    let words = head.skip_while(|token| !is(token, "impl")).skip(1);
    body.first()
        .filter(|first| is(first, "impl") || is(first, "unsafe"))?;
    let (mut depth, mut last) = (0_i32, None);
    for token in words {
        match token {
            token if is(token, "<") => depth += 1,
            token if is(token, ">") => depth -= 1,
            token if is(token, "for") && depth == 0 => last = None,
            TokenTree::Ident(name) if depth == 0 && !is(token, "dyn") => {
                last = Some(name.to_string())
            }
            TokenTree::Group(group) if group.delimiter() == Delimiter::Brace => break,
            _ => {}
        }
    }
    last
}

/// The tokens and those inside each of their groups, in reading order.
pub(crate) fn walk(tokens: &[TokenTree], visit: &mut dyn FnMut(&[TokenTree])) {
    visit(tokens);
    for token in tokens {
        if let TokenTree::Group(group) = token {
            walk(group.inside(), visit);
        }
    }
}

/// Whether the tokens at this place are `::`.
pub(crate) fn is_path_separator(tokens: &[TokenTree]) -> bool {
    matches!(tokens, [TokenTree::Punct(first), TokenTree::Punct(second), ..]
        if first.as_char() == ':' && first.spacing() == Spacing::Joint && second.as_char() == ':')
}

/// Every path of at least one segment (`a`, `a::b`, `crate::a::b`), as its segments; documentation and attributes left out.
pub(crate) fn paths(tokens: &[TokenTree]) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    collect_paths(tokens, &mut found);
    found
}

fn collect_paths(tokens: &[TokenTree], found: &mut Vec<Vec<String>>) {
    let mut at = 0;
    while at < tokens.len() {
        if let Some((attribute, length)) = attribute(&tokens[at..]) {
            // A derive or a serde attribute may name an item of the crate; documentation may not.
            if !attribute.first().is_some_and(|name| is(name, "doc")) {
                collect_paths(&attribute, found);
            }
            at += length;
            continue;
        }
        match &tokens[at] {
            TokenTree::Ident(first) => {
                let mut path = vec![first.to_string()];
                at += 1;
                while is_path_separator(&tokens[at..]) {
                    let Some(TokenTree::Ident(next)) = tokens.get(at + 2) else {
                        break;
                    };
                    path.push(next.to_string());
                    at += 3;
                }
                found.push(path);
            }
            TokenTree::Group(group) => {
                collect_paths(group.inside(), found);
                at += 1;
            }
            _ => at += 1,
        }
    }
}

/// The leaves of a `use` tree: the name bound and the full path.
pub(crate) fn use_tree(
    tokens: &[TokenTree],
    before: &[String],
    found: &mut Vec<(String, Vec<String>)>,
) {
    for branch in tokens.split(|token| is(token, ",") || is(token, ";")) {
        let mut path = before.to_vec();
        let mut name = None;
        let mut at = 0;
        while at < branch.len() {
            match &branch[at] {
                TokenTree::Ident(ident) if *ident == "as" => {
                    name = branch.get(at + 1).map(ToString::to_string);
                    break;
                }
                TokenTree::Ident(ident) => path.push(ident.to_string()),
                TokenTree::Group(group) => {
                    use_tree(group.inside(), &path, found);
                    path.clear();
                    break;
                }
                token if is(token, "*") => name = Some("*".to_owned()),
                _ => {}
            }
            at += 1;
        }
        if path.is_empty() || path == before && name.is_none() {
            continue;
        }
        if path.last().is_some_and(|last| last == "self") && path.len() > 1 {
            path.pop();
        }
        found.push((
            name.unwrap_or_else(|| path.last().cloned().unwrap_or_default()),
            path,
        ));
    }
}

/// The leaves of all `use` declarations at every depth.
pub(crate) fn use_leaves(tokens: &[TokenTree]) -> Vec<(String, Vec<String>)> {
    let mut found = Vec::new();
    walk(tokens, &mut |tokens| {
        for (at, _) in tokens
            .iter()
            .enumerate()
            .filter(|(_, token)| is(token, "use"))
        {
            let tree: Vec<TokenTree> = tokens[at + 1..]
                .iter()
                .take_while(|token| !is(token, ";"))
                .cloned()
                .collect();
            use_tree(&tree, &[], &mut found);
        }
    });
    found.retain(|(_, path)| !path.is_empty());
    found
}

/// Code that a self-test writes down.
pub(crate) fn tokens_of(text: &str) -> Vec<TokenTree> {
    TokenStream::from_str(text)
        .unwrap_or_else(|error| panic!("{text}: {error}"))
        .into_iter()
        .collect()
}
