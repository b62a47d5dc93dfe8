//! The wire as text, for programs in other languages. Every structure comes from the list from
//! which this program is compiled.

mod c;
mod json;
mod python;

use shared_types::messages::{SingularityState, TargetContent};
use shared_types::topics::{self, Each, Topic};
use shared_types::wire::{Field, Header, MAX_HOPS};
use shared_types::{MAX_DOF, MAX_SINGULARITIES};

pub(crate) use c::c;
pub(crate) use json::json;
pub(crate) use python::python;

/// A structure of the wire.
struct Structure {
    name: &'static str,
    about: &'static str,
    bytes: usize,
    fields: Vec<Described>,
    /// For a message: topic, versioned type name, hash of its layout.
    message: Option<(&'static str, &'static str, u64)>,
}

/// A field of a structure.
struct Described {
    name: String,
    /// The type of its elements, and how many there are; `None` for a single one.
    element: String,
    count: Option<usize>,
    offset: usize,
    bytes: usize,
    about: String,
    unit: Option<String>,
}

impl Structure {
    /// `before`: the structures that a field may be made of.
    fn of(
        name: &'static str,
        about: &'static str,
        bytes: usize,
        fields: &[Field],
        before: &[Self],
    ) -> Self {
        let describe = |field: &Field| {
            let nested = before.iter().find(|part| part.name == field.element);
            let bytes = match (&*field.element, nested) {
                ("u8", _) => 1,
                ("u32", _) => 4,
                ("u64" | "f64", _) => 8,
                (_, Some(nested)) => nested.bytes,
                (other, None) => panic!("{name}.{}: {other} is not described", field.name),
            };
            let (about, unit) = about_and_unit(&field.about);
            let is_array = field.type_name.starts_with('[');
            Described {
                name: field.name.to_string(),
                element: field.element.to_string(),
                count: is_array.then_some(field.size / bytes),
                offset: field.offset,
                bytes: field.size,
                about,
                unit: unit.map(str::to_owned),
            }
        };
        Self {
            name,
            about,
            bytes,
            fields: fields.iter().map(describe).collect(),
            message: None,
        }
    }
}

/// The structures that are no messages and those that messages are made of, then the messages in the order of a tick's data.
fn structures() -> Vec<Structure> {
    let header = "The first field of every message.";
    let bytes = size_of::<Header>();
    let mut parts = vec![Structure::of("Header", header, bytes, Header::LAYOUT, &[])];
    macro_rules! add {
        ($($part:ident)+) => {$(
            let (about, bytes) = ($part::DESCRIPTION, size_of::<$part>());
            let part = Structure::of(stringify!($part), about, bytes, $part::LAYOUT, &parts);
            parts.push(part);
        )+};
    }
    add!(SingularityState TargetContent);

    struct Describe<'a>(&'a [Structure]);
    impl Each for Describe<'_> {
        type Output = Structure;
        fn each<M: Topic>(&mut self) -> Structure {
            let message = Some((M::TOPIC, M::TYPE_NAME, M::layout_hash()));
            Structure {
                message,
                ..Structure::of(M::ELEMENT, M::ABOUT, size_of::<M>(), M::FIELDS, self.0)
            }
        }
    }
    let messages = topics::each(&mut Describe(&parts));
    parts.extend(messages);
    parts
}

/// The numbers that another language needs, with their meaning.
fn constants() -> [(&'static str, u64, &'static str); 3] {
    macro_rules! table {
        ($($name:ident $about:literal)+) => {[$((stringify!($name), $name as u64, $about)),+]};
    }
    table! {
        MAX_DOF "elements of an array of joints"
        MAX_SINGULARITIES "elements of an array of singularities"
        MAX_HOPS "processes that stamp a message"
    }
}

/// Units that a field can have; one with a remark begins with the unit.
const UNITS: [&str; 14] = [
    "rad",
    "rad/s",
    "rad/s²",
    "m",
    "m/s",
    "N",
    "N·m",
    "J",
    "s",
    "1/s",
    "Hz",
    "ns",
    "bytes",
    "dimensionless",
];

/// The sentences of a field and its unit, where it states one behind a semicolon.
fn about_and_unit(about: &str) -> (String, Option<&str>) {
    let about = about.trim_end_matches('.');
    for (at, _) in about.rmatch_indices("; ") {
        let (before, behind) = (&about[..at], &about[at + 2..]);
        let (unit, more) = behind.split_once(". ").unwrap_or((behind, ""));
        if UNITS.contains(&unit.split([' ', ',']).next().unwrap_or_default()) {
            let sentences = [before, more].join(". ");
            let sentences = sentences.trim_end_matches(". ").replace("codes::", "");
            return (sentences, Some(unit));
        }
    }
    (about.replace("codes::", ""), None)
}

impl Described {
    /// Its name in languages in which it may be a keyword.
    fn identifier(&self) -> String {
        match &*self.name {
            "class" => "class_".to_owned(),
            name => name.to_owned(),
        }
    }

    /// Its sentences, with the unit in brackets.
    fn remark(&self) -> String {
        let unit = self.unit.iter().map(|unit| format!(" [{unit}]"));
        self.about.clone() + &unit.collect::<String>()
    }
}

/// `SensorSample` as `sensor_sample`.
fn snake(name: &str) -> String {
    let mut snake = String::new();
    for (i, c) in name.chars().enumerate() {
        if c.is_ascii_uppercase() && i > 0 {
            snake.push('_');
        }
        snake.push(c.to_ascii_lowercase());
    }
    snake
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_structure_covers_all_its_bytes_with_fields_that_are_described() {
        for Structure {
            name,
            bytes,
            fields,
            ..
        } in structures()
        {
            let mut end = 0;
            for field in fields {
                let place = format!("{name}.{}", field.name);
                assert_eq!(field.offset, end, "{place}");
                let divides = |count| count > 0 && field.bytes.is_multiple_of(count);
                assert!(field.count.is_none_or(divides), "{place}");
                assert!(!field.about.is_empty(), "{place}");
                end += field.bytes;
            }
            assert_eq!(end, bytes, "{name}");
        }
    }

    #[test]
    fn a_unit_is_what_stands_behind_the_last_semicolon() {
        for (text, about, unit) in [
            ("Torque; N·m.", "Torque", Some("N·m")),
            (
                "Angle; rad (m for prismatic joints). More.",
                "Angle. More",
                Some("rad (m for prismatic joints)"),
            ),
            ("One of `codes::DRIVES`.", "One of `DRIVES`", None),
            (
                "A half-sentence; is no unit.",
                "A half-sentence; is no unit",
                None,
            ),
        ] {
            assert_eq!(about_and_unit(text), (about.to_owned(), unit));
        }
        assert_eq!(snake("SensorSample"), "sensor_sample");
    }

    #[test]
    fn all_languages_name_every_message_and_every_code() {
        for text in [json(), c(), python()] {
            for (topic, type_name, hash) in structures().iter().filter_map(|part| part.message) {
                let is_named = text.contains(type_name) && text.contains(topic);
                assert!(
                    is_named && text.contains(&format!("{hash:016x}")),
                    "{type_name}"
                );
            }
            for (name, ..) in shared_types::codes::TABLES
                .iter()
                .flat_map(|(_, codes)| *codes)
            {
                assert!(text.contains(name), "{name}");
            }
        }
    }
}
