//! All kinds of faults, for people and machines.

use serde_json::{Value, json};
use shared_types::fault::Kind;
use shared_types::graph::Role;

use crate::table::table;

/// The kinds of faults, as an array of one object a kind.
pub fn json() -> Value {
    let kinds = Kind::ALL.iter().map(|&kind| {
            let length_s = kind.usual_length_s();
            json!({
                "kind": kind.name(), "about": kind.about(), "roles": kind.roles().iter().map(|role| role.name()).collect::<Vec<_>>(),
                "length_s": length_s.is_finite().then_some(length_s),
                "ways": kind.ways().map(|way| json!({
                    "as": way.name(), "about": way.about(), "amount": kind.usual_amount(way), "unit": kind.unit(way)
                })).collect::<Vec<_>>(),
            })
        });
    kinds.collect()
}

/// The kinds of faults: what happens, to which processes, for how long, in which ways.
pub fn text() -> String {
    let mut rows = table(&[
        "kind",
        "what happens",
        "can happen to",
        "usual time",
        "--as (usual amount)",
    ]);
    for kind in Kind::ALL {
        let ways = kind.ways().map(|way| match kind.usual_amount(way) {
            0.0 => way.name().to_owned(),
            amount => format!("{} ({amount} {})", way.name(), kind.unit(way)),
        });
        let processes = match kind.roles() {
            all if all.len() == Role::ALL.len() => "any process".to_owned(),
            roles => roles
                .iter()
                .map(|role| role.about())
                .collect::<Vec<_>>()
                .join(" and "),
        };
        let length_s = kind.usual_length_s();
        let length = if length_s.is_finite() {
            format!("{length_s} s")
        } else {
            "to the end".to_owned()
        };
        rows.add_row([
            kind.name().to_owned(),
            kind.about().to_owned(),
            processes,
            length,
            ways.collect::<Vec<_>>().join(", "),
        ]);
    }
    format!(
        "{rows}\nTo plan a fault, use the same words in a scenario under [[fault]], with at_tick or at_s.\nIt then happens at that tick of every run.\n"
    )
}
