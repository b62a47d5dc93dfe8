//! The layout of a message as data: for programs that pass a message on without knowing its type.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use crate::file::Complaint;
use crate::wire::{Field, Fnv, Header, Message, Part};

/// Largest message that a graph may declare; bytes.
const MOST_BYTES: usize = 4 << 20;

/// A message, by its layout.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MessageLayout {
    /// The topic it travels on.
    pub topic: String,
    /// Its versioned type name.
    pub type_name: String,
    /// A sentence or two on it.
    pub about: String,
    /// The fields, in order; the first is the [`Header`].
    pub fields: Vec<Field>,
    /// Size in bytes, a multiple of 8.
    pub bytes: usize,
    /// [`Layout::layout_hash`](crate::wire::Layout::layout_hash) of the Rust type with this layout.
    pub hash: u64,
}

impl MessageLayout {
    /// The layout of a message that this program knows.
    #[must_use]
    pub fn of<M: Message>() -> Self {
        Self {
            topic: M::TOPIC.to_owned(),
            type_name: M::TYPE_NAME.to_owned(),
            about: M::ABOUT.to_owned(),
            fields: M::FIELDS.to_vec(),
            bytes: size_of::<M>(),
            hash: M::layout_hash(),
        }
    }
}

/// A topic that a graph declares for a message that only its own processes know.
///
/// ```toml
/// [[topic]]
/// name = "energy"
/// type = "armplane.Energy.v1"
/// fields = ["header: Header", "kinetic_j: f64", "per_joint_j: [f64; 8]"]
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DeclaredTopic {
    /// Its name: lower-case letters, digits and `_`.
    pub name: String,
    /// The message's versioned type name.
    #[serde(rename = "type")]
    pub type_name: String,
    /// A sentence or two on it.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub about: String,
    /// `name: type` in the order of the bytes, the first `header: Header`; types `f64`, `u64`, `u32` and arrays of them, without padding.
    pub fields: Vec<String>,
}

impl DeclaredTopic {
    /// The layout it declares.
    ///
    /// # Errors
    /// [`Complaint`], its path relative to the topic: a field without a type, of another type, or out of alignment.
    pub fn layout(&self) -> Result<MessageLayout, Complaint> {
        let mut fields = Vec::with_capacity(self.fields.len());
        let mut end = 0;
        for (i, text) in self.fields.iter().enumerate() {
            let refuse = |message: String, remedy: &str| {
                Err(Complaint::new(format!("fields.{i}"), message, remedy))
            };
            let Some((name, type_name)) = text
                .split_once(':')
                .map(|(name, type_name)| (name.trim(), type_name.trim()))
            else {
                return refuse(
                    format!("`{text}` is no field"),
                    "name: type, as in `kinetic_j: f64`",
                );
            };
            if (i == 0) != (name == "header") || (i == 0) != (type_name == Header::ELEMENT) {
                return refuse(
                    format!("`{text}` at place {i}"),
                    "a message begins with `header: Header`, once",
                );
            }
            let Some((element, unit, count)) = parse_type(type_name) else {
                return refuse(
                    format!("`{type_name}` is no type of a field"),
                    "f64, u64, u32, or an array as `[f64; 6]`",
                );
            };
            if end % unit != 0 {
                return refuse(
                    format!("`{name}` would begin at byte {end}, between two numbers"),
                    "put fields of 8 bytes before those of 4",
                );
            }
            if !is_field_name(name) {
                return refuse(
                    format!("`{}` cannot be the name of a field", name.escape_debug()),
                    "lower-case letters, digits and `_`, a letter first",
                );
            }
            if fields.iter().any(|field: &Field| field.name == name) {
                return refuse(format!("`{name}` is there twice"), "one field of each name");
            }
            let size = element.1 * count;
            fields.push(Field {
                name: Cow::Owned(name.to_owned()),
                type_name: Cow::Owned(type_name.to_owned()),
                element: Cow::Borrowed(element.0),
                offset: end,
                size,
                about: Cow::Borrowed(""),
            });
            end += size;
            if end > MOST_BYTES {
                return refuse(
                    format!("the message has more than {MOST_BYTES} bytes"),
                    "make it smaller",
                );
            }
        }
        if fields.len() < 2 || !end.is_multiple_of(8) {
            let message = format!("a message of {end} bytes in {} fields", fields.len());
            return Err(Complaint::new(
                "fields",
                message,
                "a header and at least one more field, in all a multiple of 8 bytes",
            ));
        }
        let mut hash = Fnv::of(&self.type_name, end, align_of::<u64>(), &fields);
        for field in &fields {
            hash.text(&field.name);
            hash.text(&field.element);
            if field.element == Header::ELEMENT {
                Header::hash_parts(&mut hash);
            }
        }
        let Self {
            name,
            type_name,
            about,
            ..
        } = self.clone();
        Ok(MessageLayout {
            topic: name,
            type_name,
            about,
            fields,
            bytes: end,
            hash: hash.value(),
        })
    }
}

/// A name that C, Python and file formats take as it is.
fn is_field_name(name: &str) -> bool {
    let is_part = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    name.starts_with(|c: char| c.is_ascii_lowercase()) && name.chars().all(is_part)
}

/// Element and its size, alignment, and how many of them a type holds.
fn parse_type(text: &str) -> Option<((&'static str, usize), usize, usize)> {
    let scalar = |text: &str| {
        [("f64", 8), ("u64", 8), ("u32", 4)]
            .into_iter()
            .find(|(name, _)| *name == text)
    };
    if text == Header::ELEMENT {
        return Some(((Header::ELEMENT, size_of::<Header>()), 8, 1));
    }
    if let Some(element) = scalar(text) {
        return Some((element, element.1, 1));
    }
    let (element, count) = text.strip_prefix('[')?.strip_suffix(']')?.split_once(';')?;
    let element = scalar(element.trim())?;
    let count = count
        .trim()
        .parse()
        .ok()
        .filter(|count| (1..=MOST_BYTES).contains(count))?;
    Some((element, element.1, count))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::{Layout, wire};

    wire! {
        /// Numbers of every kind.
        Mixed on "mixed" version 3 {
            /// Tick, incarnation, stamps.
            header: Header,
            /// A table; m.
            table: [f64; 6],
            /// A count.
            count: u64,
            /// Two codes.
            codes: [u32; 2],
        }
    }

    fn declared(fields: &[&str]) -> DeclaredTopic {
        let fields = fields.iter().map(ToString::to_string).collect();
        DeclaredTopic {
            name: "mixed".into(),
            type_name: "armplane.Mixed.v3".into(),
            about: "Numbers of every kind.".into(),
            fields,
        }
    }

    #[test]
    fn a_declared_layout_is_that_of_the_type() {
        let declared = declared(&[
            "header: Header",
            "table: [f64; 6]",
            "count: u64",
            "codes: [u32; 2]",
        ])
        .layout()
        .unwrap();
        let known = MessageLayout::of::<Mixed>();
        assert_eq!(
            (declared.hash, declared.bytes),
            (Mixed::layout_hash(), size_of::<Mixed>())
        );
        let places = |layout: &MessageLayout| {
            layout
                .fields
                .iter()
                .map(|field| (field.name.clone(), field.offset))
                .collect::<Vec<_>>()
        };
        assert_eq!(
            (places(&declared), &declared.about),
            (places(&known), &known.about)
        );
    }

    #[test]
    fn another_layout_has_another_hash() {
        let first = declared(&["header: Header", "a: f64", "b: f64"])
            .layout()
            .unwrap()
            .hash;
        for other in [
            ["header: Header", "b: f64", "a: f64"],
            ["header: Header", "a: f64", "b: u64"],
        ] {
            assert_ne!(declared(&other).layout().unwrap().hash, first);
        }
    }

    #[test]
    fn wrong_fields_are_refused_by_their_place() {
        let refused = |fields: &[&str]| declared(fields).layout().unwrap_err().to_string();
        assert!(refused(&["a: f64"]).contains("begins with `header: Header`"));
        assert!(refused(&["header: Header", "a"]).contains("`a` is no field"));
        assert!(refused(&["header: Header", "a: f32"]).starts_with("fields.1: `f32` is no type"));
        assert!(refused(&["header: Header", "a: u32", "b: f64"]).contains("between two numbers"));
        assert!(refused(&["header: Header", "a: u32"]).contains("a multiple of 8 bytes"));
        assert!(refused(&["header: Header", "a: f64", "a: f64"]).contains("twice"));
        assert!(refused(&["header: Header", "a: [f64; 999999999]"]).contains("no type"));
    }
}
