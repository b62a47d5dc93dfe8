//! The wire as JSON.

use serde_json::{Map, Value, json as value};
use shared_types::codes;
use shared_types::graph::{BUILT_IN, Graph};
use shared_types::topics::wire_hash;

use super::{Structure, constants, structures};

/// Structures, topics, codes and constants as one JSON document.
pub(crate) fn json() -> String {
    let graph = Graph::parse("graph.toml", BUILT_IN).ok();
    let topic = |structure: &Structure| {
        let (topic, type_name, hash) = structure.message?;
        let readers = graph
            .iter()
            .flat_map(|graph| graph.readers(topic))
            .map(|process| process.name.clone());
        Some(value!({
            "topic": topic,
            "structure": structure.name,
            "type": type_name,
            "layout": format!("{hash:016x}"),
            "bytes": structure.bytes,
            "writer": graph.as_ref().and_then(|graph| graph.writer(topic)).map(|process| process.name.clone()),
            "readers": readers.collect::<Vec<_>>(),
            "rate": "one message per tick",
        }))
    };
    let structures = structures();
    let codes: Map<String, Value> = codes::TABLES
        .iter()
        .map(|(table, codes)| ((*table).to_owned(), table_of(codes)))
        .collect();
    let constants: Map<String, Value> = constants()
        .into_iter()
        .map(|(name, number, about)| (name.to_owned(), value!({ "value": number, "about": about })))
        .collect();
    let document = value!({
        "armplane": env!("CARGO_PKG_VERSION"),
        "wire": format!("{:016x}", wire_hash()),
        "byte_order": "little endian, as the machine",
        "timing": "A message of tick k is computed from the sensor sample of tick k; torque k acts from tick k to tick k + 1.",
        "topics": structures.iter().filter_map(topic).collect::<Vec<_>>(),
        "structures": structures.iter().map(structure).collect::<Vec<_>>(),
        "codes": codes,
        "constants": constants,
    });
    format!("{document:#}\n")
}

fn structure(structure: &Structure) -> Value {
    let fields = structure.fields.iter().map(|field| {
        value!({
            "name": field.name,
            "type": field.element,
            "count": field.count,
            "offset": field.offset,
            "bytes": field.bytes,
            "unit": field.unit,
            "about": field.about,
        })
    });
    value!({
        "name": structure.name,
        "bytes": structure.bytes,
        "align": 8,
        "about": structure.about,
        "fields": fields.collect::<Vec<_>>(),
    })
}

fn table_of(codes: &[(&str, u32, &str)]) -> Value {
    codes
        .iter()
        .map(|(name, code, text)| value!({ "name": name, "code": code, "text": text }))
        .collect()
}
