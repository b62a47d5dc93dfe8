//! The wire as text, for programs in other languages: one document, made from the list from which this program is compiled, and templates over it.

use minijinja::syntax::SyntaxConfig;
use minijinja::value::{Serde, Value as Context};
use minijinja::{Environment, Error};
use serde_json::{Map, Value, json};
use shared_types::codes;
use shared_types::graph::Graph;
use shared_types::layout::structure;
use shared_types::topics::{self, Each, Topic, wire_hash};
use shared_types::wire::{Field, MAX_HOPS, Part};
use shared_types::{MAX_DOF, MAX_SINGULARITIES, SingularityState, TargetContent};

/// The module `armplane/wire.py` of the Python package: `ctypes` structures, which also make `numpy` views without a copy.
pub(crate) const PYTHON: &str = include_str!("describe/wire.py.jinja");
/// A header for C11 and C++11, with the functions of `libarmplane-process`: a program includes it and needs nothing else.
pub(crate) const C: &str = include_str!("describe/wire.h.jinja");

/// A template over the wire's document.
///
/// # Errors
/// [`Error`] if the template is wrong.
pub(crate) fn rendered(template: &str) -> Result<String, Error> {
    let mut environment = Environment::new();
    let mut syntax = SyntaxConfig::builder();
    environment.set_syntax(syntax.trim_blocks(true).lstrip_blocks(true).build()?);
    environment.add_filter("snake", snake);
    environment.add_filter("quoted", |text: String| format!("{text:?}"));
    environment.add_global("header", armplane_process::HEADER);
    environment.render_str(template, Context::from(Serde(wire())))
}

/// Structures, topics, codes and constants as one document. The structures that messages are made of come first, then the messages in the order of a tick's data.
pub(crate) fn wire() -> Value {
    let parts = [
        ("Header", "The first field of every message."),
        ("SingularityState", SingularityState::ABOUT),
        ("TargetContent", TargetContent::ABOUT),
    ];
    let parts = parts.into_iter().filter_map(|(name, about)| {
        let (fields, bytes) = structure(name)?;
        Some(described(name, about, bytes, fields))
    });
    let messages = topics::each(&mut Describe(Graph::built_in(false).ok()));
    let (structures, topics): (Vec<_>, Vec<_>) = messages.into_iter().unzip();
    let table = |codes: &[(&str, u32, &str)]| -> Value {
        let codes = codes.iter();
        codes
            .map(|(name, code, text)| json!({"name": name, "code": code, "text": text}))
            .collect()
    };
    let codes = codes::TABLES.iter();
    let codes = codes.map(|(name, codes)| ((*name).to_owned(), table(codes)));
    json!({
        "armplane": env!("CARGO_PKG_VERSION"),
        "wire": format!("{:016x}", wire_hash()),
        "byte_order": "little endian, as the machine",
        "timing": "A message of tick k is computed from the sensor sample of tick k; torque k acts from tick k to tick k + 1.",
        "topics": topics,
        "structures": parts.chain(structures).collect::<Value>(),
        "codes": codes.collect::<Map<_, _>>(),
        "constants": {
            "MAX_DOF": {"value": MAX_DOF, "about": "elements of an array of joints"},
            "MAX_SINGULARITIES": {"value": MAX_SINGULARITIES, "about": "elements of an array of singularities"},
            "MAX_HOPS": {"value": MAX_HOPS, "about": "processes that stamp a message"},
        },
    })
}

fn described(name: &str, about: &str, bytes: usize, fields: &[Field]) -> Value {
    let fields = fields.iter().map(|field| {
        let (about, unit) = about_and_unit(&field.about);
        json!({
            "name": field.name, "type": field.element, "count": field.count(), "offset": field.offset, "bytes": field.size,
            "unit": unit, "about": about,
        })
    });
    json!({"name": name, "bytes": bytes, "align": 8, "about": about, "fields": fields.collect::<Value>()})
}

/// A message's structure and its topic, with writer and readers in a graph.
struct Describe(Option<Graph>);

impl Each for Describe {
    type Output = (Value, Value);
    fn each<M: Topic>(&mut self) -> (Value, Value) {
        let (name, bytes, graph) = (M::ELEMENT, size_of::<M>(), self.0.as_ref());
        let readers = graph.into_iter().flat_map(|graph| graph.readers(M::TOPIC));
        let topic = json!({
            "topic": M::TOPIC,
            "structure": name,
            "type": M::TYPE_NAME,
            "layout": format!("{:016x}", M::layout_hash()),
            "bytes": bytes,
            "writer": graph.and_then(|graph| graph.writer(M::TOPIC)).map(|process| &process.name),
            "readers": readers.map(|process| &process.name).collect::<Vec<_>>(),
            "rate": "one message per tick",
        });
        (described(name, M::ABOUT, bytes, M::FIELDS), topic)
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
        let document = wire();
        let named = |of: &Value, key: &str| of[key].as_str().expect("a text").to_owned();
        let [python, c] = [PYTHON, C].map(|template| rendered(template).expect("a template"));
        for text in [document.to_string(), python, c] {
            for topic in document["topics"].as_array().expect("a list") {
                for key in ["topic", "type", "layout"] {
                    assert!(text.contains(&named(topic, key)), "{topic}");
                }
            }
            for (name, ..) in codes::TABLES.iter().flat_map(|(_, codes)| *codes) {
                assert!(text.contains(name), "{name}");
            }
        }
    }
}
