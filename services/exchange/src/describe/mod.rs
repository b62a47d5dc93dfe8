//! The wire as text, for programs in other languages: every structure from the same list that this program is compiled from.

mod c;
mod json;
mod python;

use shared_types::exchange::{
    EXCHANGE_MARK, EXCHANGE_NAME, EXCHANGE_STATE, EXCHANGE_TEXT, EXCHANGE_TYPE, EXCHANGE_VERSION,
    ExchangeHead, ExchangeTopic,
};
use shared_types::messages::{SingularityState, TargetContent};
use shared_types::topics::{self, Each, Topic};
use shared_types::wire::{Field, Header, MAX_HOPS};
use shared_types::{MAX_DOF, MAX_SINGULARITIES};

pub use c::c;
pub use json::json;
pub use python::python;

/// A structure of the wire.
struct Structure {
    name: &'static str,
    about: &'static str,
    bytes: usize,
    fields: &'static [Field],
    /// For a message: topic, versioned type name, hash of its layout.
    message: Option<(&'static str, &'static str, u64)>,
}

/// The structures that are no messages, and those that messages are made of; each before its first use.
fn parts() -> Vec<Structure> {
    let part = |name, about, bytes, fields| Structure {
        name,
        about,
        bytes,
        fields,
        message: None,
    };
    vec![
        part(
            "Header",
            "The first field of every message.",
            size_of::<Header>(),
            Header::LAYOUT,
        ),
        part(
            "SingularityState",
            SingularityState::DESCRIPTION,
            size_of::<SingularityState>(),
            SingularityState::LAYOUT,
        ),
        part(
            "TargetContent",
            TargetContent::DESCRIPTION,
            size_of::<TargetContent>(),
            TargetContent::LAYOUT,
        ),
        part(
            "ExchangeHead",
            ExchangeHead::DESCRIPTION,
            size_of::<ExchangeHead>(),
            ExchangeHead::LAYOUT,
        ),
        part(
            "ExchangeTopic",
            ExchangeTopic::DESCRIPTION,
            size_of::<ExchangeTopic>(),
            ExchangeTopic::LAYOUT,
        ),
    ]
}

/// The messages, in the order of a tick's data.
fn messages() -> Vec<Structure> {
    struct Describe;
    impl Each for Describe {
        type Output = Structure;
        fn each<M: Topic>(&mut self) -> Structure {
            let message = Some((M::TOPIC, M::TYPE_NAME, M::layout_hash()));
            Structure {
                name: M::ELEMENT,
                about: M::ABOUT,
                bytes: size_of::<M>(),
                fields: M::FIELDS,
                message,
            }
        }
    }
    topics::each(&mut Describe).into()
}

/// The numbers that another language needs, with their meaning.
fn constants() -> Vec<(&'static str, u64, &'static str)> {
    vec![
        (
            "EXCHANGE_MARK",
            EXCHANGE_MARK,
            "the first eight bytes of an exchange page",
        ),
        (
            "EXCHANGE_VERSION",
            u64::from(EXCHANGE_VERSION),
            "version of the contract of the exchange page",
        ),
        (
            "EXCHANGE_TEXT",
            EXCHANGE_TEXT as u64,
            "bytes of a text on the page",
        ),
        (
            "EXCHANGE_NAME",
            EXCHANGE_NAME as u64,
            "bytes of the name of a topic",
        ),
        (
            "EXCHANGE_TYPE",
            EXCHANGE_TYPE as u64,
            "bytes of the name of a type",
        ),
        (
            "EXCHANGE_STATE",
            EXCHANGE_STATE as u64,
            "bytes of a checkpoint, at most",
        ),
        ("MAX_DOF", MAX_DOF as u64, "elements of an array of joints"),
        (
            "MAX_SINGULARITIES",
            MAX_SINGULARITIES as u64,
            "elements of an array of singularities",
        ),
        (
            "MAX_HOPS",
            MAX_HOPS as u64,
            "processes that stamp a message",
        ),
    ]
}

/// The type of a field's elements, and how many there are; `None` for a single one.
fn elements(field: &Field) -> (&str, Option<usize>) {
    let bytes = match &*field.element {
        "u8" => 1,
        "u32" => 4,
        "u64" | "f64" => 8,
        name => parts()
            .iter()
            .find(|part| part.name == name)
            .map_or(field.size, |part| part.bytes),
    };
    (
        &field.element,
        field
            .type_name
            .starts_with('[')
            .then_some(field.size / bytes),
    )
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
fn about_and_unit(field: &Field) -> (String, Option<&str>) {
    let about = field.about.trim_end_matches('.');
    for (at, _) in about.rmatch_indices("; ") {
        let (before, behind) = (&about[..at], &about[at + 2..]);
        let (unit, more) = behind.split_once(". ").unwrap_or((behind, ""));
        if UNITS.contains(&unit.split([' ', ',']).next().unwrap_or_default()) {
            let about = if more.is_empty() {
                before.to_owned()
            } else {
                format!("{before}. {more}")
            };
            return (about.replace("codes::", ""), Some(unit));
        }
    }
    (about.replace("codes::", ""), None)
}

/// The name of a field in languages in which it is a keyword.
fn identifier(field: &Field) -> String {
    if field.name == "class" {
        "class_".to_owned()
    } else {
        field.name.to_string()
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
    fn every_structure_covers_all_its_bytes_with_types_that_are_described() {
        let parts = parts();
        for Structure {
            name,
            bytes,
            fields,
            ..
        } in parts.iter().chain(&messages())
        {
            let mut end = 0;
            for field in *fields {
                let (element, count) = elements(field);
                let known = ["u8", "u32", "u64", "f64"].contains(&element)
                    || parts.iter().any(|part| part.name == element);
                assert!(known, "{name}.{}: {element}", field.name);
                assert_eq!(field.offset, end, "{name}.{}", field.name);
                assert!(
                    count.is_none_or(|count| count > 0 && field.size.is_multiple_of(count)),
                    "{name}.{}",
                    field.name
                );
                assert!(!field.about.is_empty(), "{name}.{}", field.name);
                end += field.size;
            }
            assert_eq!(end, *bytes, "{name}");
        }
    }

    #[test]
    fn a_unit_is_what_stands_behind_the_last_semicolon() {
        let sensor = &messages()[0];
        let field = |name: &str| {
            sensor
                .fields
                .iter()
                .find(|field| field.name == name)
                .unwrap()
        };
        assert_eq!(about_and_unit(field("tau_drive")).1, Some("N·m"));
        assert_eq!(
            about_and_unit(field("q_encoder")).1,
            Some("rad (m for prismatic joints)")
        );
        assert_eq!(
            about_and_unit(field("drive")),
            ("One of `DRIVES`".to_owned(), None)
        );
        let parts = parts();
        let head = parts
            .iter()
            .find(|part| part.name == "ExchangeHead")
            .unwrap();
        let reason = head
            .fields
            .iter()
            .find(|field| field.name == "reason")
            .unwrap();
        assert_eq!(about_and_unit(reason).1, None, "a half-sentence is no unit");
        let state = messages()
            .into_iter()
            .find(|message| message.name == "ControlState")
            .unwrap();
        let planned = state
            .fields
            .iter()
            .find(|field| field.name == "planned_s")
            .unwrap();
        assert_eq!(about_and_unit(planned).1, Some("s"));
        assert_eq!(snake("SensorSample"), "sensor_sample");
    }

    #[test]
    fn all_languages_name_every_message_and_every_code() {
        let (json, c, python) = (json(), c(), python());
        for message in messages() {
            let (topic, type_name, hash) = message.message.unwrap();
            for text in [&json, &c, &python] {
                assert!(
                    text.contains(type_name) && text.contains(topic),
                    "{type_name}"
                );
                assert!(text.contains(&format!("{hash:016x}")), "{type_name}");
            }
        }
        for (_, codes) in shared_types::codes::TABLES {
            assert!(codes.iter().all(|(name, ..)| json.contains(name)
                && c.contains(name)
                && python.contains(name)));
        }
    }
}
