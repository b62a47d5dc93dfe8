//! Source text as a tree of tokens. `proc_macro2` reads it; its tokens stay in one thread, these are read once and shared by all checks.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

pub(crate) use proc_macro2::{Delimiter, Spacing};

/// One token, or a group of them between brackets.
#[derive(Clone)]
pub(crate) enum TokenTree {
    Group(Group),
    Ident(Ident),
    Punct(Punct),
    Literal(Literal),
}

/// The text between two brackets.
#[derive(Clone)]
pub(crate) struct Group {
    delimiter: Delimiter,
    stream: TokenStream,
}

/// A name or a keyword.
#[derive(Clone)]
pub(crate) struct Ident(Arc<str>);

/// One character of an operator.
#[derive(Clone)]
pub(crate) struct Punct(char, Spacing);

/// A number, a character or a text, as it is written.
#[derive(Clone)]
pub(crate) struct Literal(Arc<str>);

/// A sequence of tokens.
#[derive(Clone)]
pub(crate) struct TokenStream(Arc<[TokenTree]>);

impl Group {
    pub(crate) fn new(delimiter: Delimiter, stream: TokenStream) -> Self {
        Self { delimiter, stream }
    }

    pub(crate) fn delimiter(&self) -> Delimiter {
        self.delimiter
    }

    pub(crate) fn stream(&self) -> TokenStream {
        self.stream.clone()
    }

    pub(crate) fn inside(&self) -> &[TokenTree] {
        &self.stream.0
    }
}

impl Punct {
    pub(crate) fn as_char(&self) -> char {
        self.0
    }

    pub(crate) fn spacing(&self) -> Spacing {
        self.1
    }
}

impl TokenStream {
    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl FromStr for TokenStream {
    type Err = proc_macro2::LexError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(proc_macro2::TokenStream::from_str(text)?
            .into_iter()
            .map(TokenTree::from)
            .collect())
    }
}

impl From<proc_macro2::TokenTree> for TokenTree {
    fn from(token: proc_macro2::TokenTree) -> Self {
        use proc_macro2::TokenTree as Read;
        match token {
            Read::Group(group) => Self::Group(Group::new(
                group.delimiter(),
                group.stream().into_iter().map(Self::from).collect(),
            )),
            Read::Ident(ident) => Self::Ident(Ident(ident.to_string().into())),
            Read::Punct(punct) => Self::Punct(Punct(punct.as_char(), punct.spacing())),
            Read::Literal(literal) => Self::Literal(Literal(literal.to_string().into())),
        }
    }
}

impl FromIterator<TokenTree> for TokenStream {
    fn from_iter<I: IntoIterator<Item = TokenTree>>(tokens: I) -> Self {
        Self(tokens.into_iter().collect())
    }
}

impl IntoIterator for TokenStream {
    type Item = TokenTree;
    type IntoIter = std::vec::IntoIter<TokenTree>;

    fn into_iter(self) -> Self::IntoIter {
        Vec::from(&*self.0).into_iter()
    }
}

impl<T: AsRef<str> + ?Sized> PartialEq<T> for Ident {
    fn eq(&self, text: &T) -> bool {
        &*self.0 == text.as_ref()
    }
}

impl fmt::Display for Ident {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl fmt::Display for Literal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl fmt::Display for TokenTree {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ident(ident) => ident.fmt(f),
            Self::Literal(literal) => literal.fmt(f),
            Self::Punct(punct) => write!(f, "{}", punct.0),
            Self::Group(group) => {
                let (open, close) = match group.delimiter {
                    Delimiter::Parenthesis => ("(", ")"),
                    Delimiter::Brace => ("{ ", " }"),
                    Delimiter::Bracket => ("[", "]"),
                    Delimiter::None => ("", ""),
                };
                write!(f, "{open}{}{close}", group.stream)
            }
        }
    }
}

impl fmt::Display for TokenStream {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (at, token) in self.0.iter().enumerate() {
            let is_joint =
                at > 0 && matches!(&self.0[at - 1], TokenTree::Punct(Punct(_, Spacing::Joint)));
            write!(f, "{}{token}", if at == 0 || is_joint { "" } else { " " })?;
        }
        Ok(())
    }
}
