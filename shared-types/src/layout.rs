//! The layout of a message as data, for programs that pass messages on without knowing their type.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use crate::file::{Complaint, require};
use crate::topics::{OfTopic, Topic};
use crate::wire::{Field, Fnv, Header, Message, Part};
use crate::{SingularityState, TargetContent};

/// Largest message that a graph may declare; bytes.
const MOST_BYTES: usize = 4 << 20;

/// A message, by its layout.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
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

impl OfTopic for MessageLayout {
    fn of_topic<M: Topic>() -> Self {
        Self::of::<M>()
    }
}

/// The fields and the size of a structure inside messages; `None` of a number.
#[must_use]
pub fn structure(element: &str) -> Option<(&'static [Field], usize)> {
    match element {
        "Header" => Some((Header::FIELDS, size_of::<Header>())),
        "SingularityState" => Some((SingularityState::FIELDS, size_of::<SingularityState>())),
        "TargetContent" => Some((TargetContent::FIELDS, size_of::<TargetContent>())),
        _ => None,
    }
}

impl Field {
    /// How many elements it has; `None` of a single one.
    #[must_use]
    pub fn count(&self) -> Option<usize> {
        let element = match &*self.element {
            "u8" => 1,
            "u32" => 4,
            part => structure(part).map_or(8, |(_, size)| size),
        };
        self.type_name
            .starts_with('[')
            .then_some(self.size / element)
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
    /// Name: lower-case letters, digits and `_`.
    pub name: String,
    /// Versioned name of the message type, such as `armplane.Energy.v1`.
    #[serde(rename = "type")]
    pub type_name: String,
    /// A sentence or two on the message.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub about: String,
    /// `name: type` in memory order, the first `header: Header`. Types are `f64`, `u64`, `u32` and
    /// arrays of them, without padding.
    pub fields: Vec<String>,
}

impl DeclaredTopic {
    /// The layout it declares.
    ///
    /// # Errors
    /// [`Complaint`], its path relative to the topic: a field without a type, of another type, or out of alignment.
    pub fn layout(&self) -> Result<MessageLayout, Complaint> {
        let mut fields: Vec<Field> = Vec::with_capacity(self.fields.len());
        for (i, text) in self.fields.iter().enumerate() {
            let located = |complaint: Complaint| complaint.within(&format!("fields.{i}"));
            let field = field(text, &fields).map_err(located)?;
            fields.push(field);
        }
        let end = fields.last().map_or(0, |last| last.offset + last.size);
        require(
            fields.len() >= 2 && end.is_multiple_of(8),
            "fields",
            format!("a message of {end} bytes in {} fields", fields.len()),
            "a header and at least one more field, in all a multiple of 8 bytes",
        )?;
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

/// The field of a declaration behind those before it; the path is the caller's.
fn field(text: &str, before: &[Field]) -> Result<Field, Complaint> {
    let (name, type_name) = text.split_once(':').ok_or_else(|| {
        let remedy = "name: type, as in `kinetic_j: f64`";
        Complaint::new("", format!("`{text}` is no field"), remedy)
    })?;
    let name = name.trim();
    let type_name = type_name.trim();
    let is_first = before.is_empty();
    let is_header = type_name == Header::ELEMENT;
    require(
        is_first == is_header && is_first == (name == "header"),
        "",
        format!("`{text}` at place {}", before.len()),
        "a message begins with `header: Header`, once",
    )?;
    let (element, unit, count) = parse_type(type_name).ok_or_else(|| {
        let remedy = "f64, u64, u32, or an array as `[f64; 6]`";
        Complaint::new("", format!("`{type_name}` is no type of a field"), remedy)
    })?;
    let offset = before.last().map_or(0, |last| last.offset + last.size);
    // A header is aligned as its largest numbers are.
    require(
        offset.is_multiple_of(unit.min(8)),
        "",
        format!("`{name}` would begin at byte {offset}, between two numbers"),
        "put fields of 8 bytes before those of 4",
    )?;
    require(
        is_field_name(name),
        "",
        format!("`{}` cannot be the name of a field", name.escape_debug()),
        "lower-case letters, digits and `_`, a letter first",
    )?;
    require(
        before.iter().all(|field| field.name != name),
        "",
        format!("`{name}` is there twice"),
        "one field of each name",
    )?;
    let size = unit * count;
    require(
        offset + size <= MOST_BYTES,
        "",
        format!("the message has more than {MOST_BYTES} bytes"),
        "make it smaller",
    )?;
    Ok(Field {
        name: Cow::Owned(name.to_owned()),
        type_name: Cow::Owned(type_name.to_owned()),
        element: Cow::Borrowed(element),
        offset,
        size,
        about: Cow::Borrowed(""),
    })
}

/// A name that C, Python and file formats take as it is.
fn is_field_name(name: &str) -> bool {
    let is_part = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    name.starts_with(|c: char| c.is_ascii_lowercase()) && name.chars().all(is_part)
}

/// The element of a type and its size, and how many of them it holds.
fn parse_type(text: &str) -> Option<(&'static str, usize, usize)> {
    let array = text
        .strip_prefix('[')
        .and_then(|text| text.strip_suffix(']'));
    let (name, count) = match array {
        Some(array) => {
            let (name, count) = array.split_once(';')?;
            (name.trim(), count.trim().parse().ok()?)
        }
        None => (text, 1),
    };
    let known = [
        ("f64", 8),
        ("u64", 8),
        ("u32", 4),
        (Header::ELEMENT, size_of::<Header>()),
    ];
    let (element, size) = known.into_iter().find(|(known, _)| *known == name)?;
    let is_one = element != Header::ELEMENT || array.is_none();
    ((1..=MOST_BYTES).contains(&count) && is_one).then_some((element, size, count))
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

    fn declared(fields: &[&str]) -> Result<MessageLayout, Complaint> {
        let fields = fields.iter().map(ToString::to_string).collect();
        let topic = DeclaredTopic {
            name: "mixed".into(),
            type_name: "armplane.Mixed.v3".into(),
            about: "Numbers of every kind.".into(),
            fields,
        };
        topic.layout()
    }

    #[test]
    fn a_declared_layout_is_that_of_the_type() {
        let fields = [
            "header: Header",
            "table: [f64; 6]",
            "count: u64",
            "codes: [u32; 2]",
        ];
        let declared = declared(&fields).unwrap();
        let known = MessageLayout::of::<Mixed>();
        assert_eq!(
            (declared.hash, declared.bytes),
            (Mixed::layout_hash(), size_of::<Mixed>())
        );
        assert_eq!(
            (&declared.about, declared.fields.len()),
            (&known.about, known.fields.len())
        );
        for (one, other) in declared.fields.iter().zip(&known.fields) {
            assert_eq!((&one.name, one.offset), (&other.name, other.offset));
        }
    }

    #[test]
    fn wrong_fields_are_refused_by_their_place() {
        let cases: [(&[&str], &str); 7] = [
            (&["a: f64"], "fields.0"),
            (&["header: Header", "a"], "fields.1"),
            (&["header: Header", "a: f32"], "fields.1"),
            (&["header: Header", "a: u32", "b: f64"], "fields.2"),
            (&["header: Header", "a: u32"], "fields"),
            (&["header: Header", "a: f64", "a: f64"], "fields.2"),
            (&["header: Header", "a: [f64; 999999999]"], "fields.1"),
        ];
        for (fields, path) in cases {
            assert_eq!(declared(fields).unwrap_err().path, path, "{fields:?}");
        }
    }
}
