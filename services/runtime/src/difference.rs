//! Two messages that should be the same and are not: where they first differ, by name.

use shared_types::wire::{Field, Stamps};
use shared_types::{Message, SingularityState};

/// The first number in which two messages differ.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Difference {
    /// The field, with the indices inside it: `singularities[0].zeta_B[2]`.
    pub field: String,
    /// What the first message has there.
    pub expected: String,
    /// What the second message has there.
    pub found: String,
}

/// The header behind its stamps, which are not compared.
const HEADER: &[Field] = {
    const fn field(name: &'static str, type_name: &'static str, offset: usize, size: usize) -> Field {
        Field { name, type_name, offset: size_of::<Stamps>() + offset, size }
    }
    &[field("tick", "u64", 0, 8), field("incarnation", "u32", 8, 4), field("flags", "u32", 12, 4)]
};

/// Where the contents of two messages first differ; stamps are not compared.
#[must_use]
pub fn first_difference<M: Message>(expected: &M, found: &M) -> Option<Difference> {
    let place = expected.content().iter().zip(found.content()).position(|(a, b)| a != b)? + size_of::<Stamps>();
    let (field, range, is_f64) = locate(M::FIELDS, place, 0);
    let text = |message: &M| {
        let bytes = &bytemuck::bytes_of(message)[range.clone()];
        match bytes.len() {
            8 if is_f64 => format!("{:?}", bytemuck::pod_read_unaligned::<f64>(bytes)),
            8 => bytemuck::pod_read_unaligned::<u64>(bytes).to_string(),
            _ => bytemuck::pod_read_unaligned::<u32>(bytes).to_string(),
        }
    };
    Some(Difference { field, expected: text(expected), found: text(found) })
}

/// The number at byte `place` of a structure that begins at byte `base`: its name, its bytes, and whether it is an `f64`.
fn locate(layout: &[Field], place: usize, base: usize) -> (String, std::ops::Range<usize>, bool) {
    let is_here = |field: &&Field| (field.offset..field.offset + field.size).contains(&(place - base));
    // Layouts cover every byte: the wire's own tests prove it.
    let Some(field) = layout.iter().find(is_here) else { return ("?".to_owned(), place..place + 4, false) };
    let begin = base + field.offset;
    let element = |size: usize| {
        let index = (place - begin) / size;
        let name = if field.type_name.starts_with('[') { format!("{}[{index}]", field.name) } else { field.name.to_owned() };
        (name, begin + index * size)
    };
    if field.type_name == "Header" {
        let (name, range, is_f64) = locate(HEADER, place, begin);
        (format!("header.{name}"), range, is_f64)
    } else if field.type_name.contains("SingularityState") {
        let (outer, begin) = element(size_of::<SingularityState>());
        let (inner, range, is_f64) = locate(SingularityState::LAYOUT, place, begin);
        (format!("{outer}.{inner}"), range, is_f64)
    } else {
        let size = if field.type_name.contains("u32") { 4 } else { 8 };
        let (name, begin) = element(size);
        (name, begin..begin + size, field.type_name.contains("f64"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::{SensorSample, SingularityReport, TorqueCommand};

    #[test]
    fn the_first_differing_number_is_named_with_both_values() {
        let expected = TorqueCommand::default();
        let mut found = expected;
        found.header.stamps.sent_ns[0] = 7;
        assert_eq!(first_difference(&expected, &found), None, "stamps are not compared");
        found.mode[3] = 5;
        found.tau_null[7] = -0.5;
        let difference = first_difference(&expected, &found).unwrap();
        assert_eq!((&*difference.field, &*difference.expected, &*difference.found), ("tau_null[7]", "0.0", "-0.5"));
        found.tau_null[7] = 0.0;
        assert_eq!(first_difference(&expected, &found).unwrap().field, "mode[3]");
    }

    #[test]
    fn headers_and_nested_structures_are_looked_into() {
        let expected = SensorSample::default();
        let mut found = expected;
        found.stale_ticks = 2;
        assert_eq!(first_difference(&expected, &found).unwrap().field, "stale_ticks");
        found.header.incarnation = 3;
        let difference = first_difference(&expected, &found).unwrap();
        assert_eq!((&*difference.field, &*difference.found), ("header.incarnation", "3"));
        let expected = SingularityReport::default();
        let mut found = expected;
        found.singularities[2].zeta_B[4] = 1.0;
        assert_eq!(first_difference(&expected, &found).unwrap().field, "singularities[2].zeta_B[4]");
        found.singularities[1].inside = 1;
        assert_eq!(first_difference(&expected, &found).unwrap().field, "singularities[1].inside");
        found.header.tick = 9;
        assert_eq!(first_difference(&expected, &found).unwrap().field, "header.tick");
    }
}
