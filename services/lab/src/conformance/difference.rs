//! Differences between two messages that should be the same: the first differing field, and how far
//! it differs.

use std::collections::BTreeMap;
use std::ops::Range;

use shared_types::layout::structure;
use shared_types::wire::{Field, Stamps};

/// The first number in which two messages differ.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Difference {
    /// The field, with the indices inside it: `singularities[0].zeta_B[2]`.
    pub field: String,
    /// The first message's value.
    pub expected: String,
    /// The second message's value.
    pub found: String,
}

/// Largest difference of a field over many messages.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct FieldDifference {
    /// The field, over all its elements: `singularities[0].zeta_B`.
    pub field: String,
    /// In how many messages it differs.
    pub messages: u64,
    /// Largest |found − expected| of an element, in the field's own unit; infinite if one of them is not a number.
    pub largest: f64,
    /// The tick of the largest.
    pub tick: u64,
    /// The element, and both values there.
    #[serde(rename = "at")]
    pub difference: Difference,
}

/// A number of a message.
#[derive(Clone, Debug)]
struct Element {
    field: String,
    /// The field with the index, where that has several.
    name: String,
    is_float: bool,
    bytes: Range<usize>,
}

impl Element {
    fn differs(&self, expected: &[u8], found: &[u8]) -> bool {
        expected[self.bytes.clone()] != found[self.bytes.clone()]
    }

    fn bits(&self, message: &[u8]) -> u64 {
        let mut number = [0; 8];
        number[..self.bytes.len()].copy_from_slice(&message[self.bytes.clone()]);
        u64::from_le_bytes(number)
    }

    fn value(&self, message: &[u8]) -> f64 {
        match self.is_float {
            true => f64::from_bits(self.bits(message)),
            false => self.bits(message) as f64,
        }
    }

    fn difference(&self, expected: &[u8], found: &[u8]) -> Difference {
        let text = |message: &[u8]| match self.is_float {
            true => format!("{:?}", self.value(message)),
            false => self.bits(message).to_string(),
        };
        Difference {
            field: self.name.clone(),
            expected: text(expected),
            found: text(found),
        }
    }

    /// |found − expected|; infinite if one of them is not a number.
    fn distance(&self, expected: &[u8], found: &[u8]) -> f64 {
        let distance = (self.value(found) - self.value(expected)).abs();
        if distance.is_nan() {
            f64::INFINITY
        } else {
            distance
        }
    }
}

/// The numbers of a structure that begins at byte `base`, those of structures inside it too, in order.
fn elements(layout: &[Field], base: usize, prefix: &str, found: &mut Vec<Element>) {
    for field in layout {
        let path = format!("{prefix}{}", field.name);
        let count = field.count();
        let size = field.size / count.unwrap_or(1);
        for index in 0..count.unwrap_or(1) {
            let at = base + field.offset + index * size;
            let name = count.map_or_else(|| path.clone(), |_| format!("{path}[{index}]"));
            match structure(&field.element) {
                Some((inside, _)) => elements(inside, at, &format!("{name}."), found),
                None => found.push(Element {
                    field: path.clone(),
                    name,
                    is_float: field.element == "f64",
                    bytes: at..at + size,
                }),
            }
        }
    }
}

/// Differences between two series of messages, field by field.
pub(super) struct Differences {
    elements: Vec<Element>,
    /// The tick of the first, and its first field.
    pub(super) first: Option<(u64, Difference)>,
    /// By the place of the field in the message.
    fields: BTreeMap<usize, FieldDifference>,
}

impl Differences {
    /// Of all that is compared in a message: what is behind the stamps at its beginning.
    pub(super) fn new(fields: &[Field]) -> Self {
        let mut all = Vec::new();
        elements(fields, 0, "", &mut all);
        all.retain(|element| element.bytes.start >= size_of::<Stamps>());
        Self {
            elements: all,
            first: None,
            fields: BTreeMap::new(),
        }
    }

    /// Takes in a pair of messages of the same tick; stamps are not compared.
    pub(super) fn add(&mut self, tick: u64, old: &[u8], new: &[u8]) {
        if old.get(size_of::<Stamps>()..) == new.get(size_of::<Stamps>()..) {
            return;
        }
        for field in self.elements.chunk_by(|a, b| a.field == b.field) {
            let mut differing = field.iter().filter(|one| one.differs(old, new));
            let Some(first) = differing.clone().next() else {
                continue;
            };
            self.first
                .get_or_insert_with(|| (tick, first.difference(old, new)));
            let at = self.fields.entry(field[0].bytes.start);
            let so_far = at.or_insert_with(|| FieldDifference {
                field: first.field.clone(),
                messages: 0,
                largest: f64::NEG_INFINITY,
                tick,
                difference: first.difference(old, new),
            });
            so_far.messages += 1;
            for element in differing.by_ref() {
                let distance = element.distance(old, new);
                if distance > so_far.largest {
                    (so_far.largest, so_far.tick) = (distance, tick);
                    so_far.difference = element.difference(old, new);
                }
            }
        }
    }

    /// The fields that differ, in the order of the message.
    pub(super) fn fields(self) -> Vec<FieldDifference> {
        self.fields.into_values().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::wire::Part;
    use shared_types::{Message, SingularityReport, TorqueCommand};

    fn first<M: Message>(expected: &M, found: &M) -> Option<[String; 3]> {
        let [expected, found] = [expected, found].map(bytemuck::bytes_of);
        let mut differences = Differences::new(M::FIELDS);
        differences.add(0, expected, found);
        let (_, first) = differences.first?;
        Some([first.field, first.expected, first.found])
    }

    fn texts(all: [&str; 3]) -> Option<[String; 3]> {
        Some(all.map(str::to_owned))
    }

    #[test]
    fn the_first_differing_number_is_named_with_both_values_also_in_headers_and_nested_structures()
    {
        let expected = TorqueCommand::default();
        let mut found = expected;
        found.header.stamps.sent_ns[0] = 7;
        assert_eq!(first(&expected, &found), None, "stamps are not compared");
        found.saturation_mask = 5;
        found.tau[7] = -0.5;
        assert_eq!(first(&expected, &found), texts(["tau[7]", "0.0", "-0.5"]));
        found.tau[7] = 0.0;
        assert_eq!(
            first(&expected, &found),
            texts(["saturation_mask", "0", "5"])
        );
        let expected = SingularityReport::default();
        let mut found = expected;
        found.singularities[2].zeta_B[4] = 1.0;
        let nested = texts(["singularities[2].zeta_B[4]", "0.0", "1.0"]);
        assert_eq!(first(&expected, &found), nested);
        found.header.incarnation = 3;
        let header = texts(["header.incarnation", "0", "3"]);
        assert_eq!(first(&expected, &found), header);
    }

    #[test]
    fn the_largest_difference_of_each_field_is_kept_with_its_place() {
        let mut differences = Differences::new(TorqueCommand::FIELDS);
        let expected = TorqueCommand::default();
        for (tick, by) in [(3, 1.0), (4, -2.5), (5, f64::NAN), (6, 0.5)] {
            let mut found = expected;
            (found.tau[1], found.phase) = (by, 2);
            let [expected, found] = [&expected, &found].map(bytemuck::bytes_of);
            differences.add(tick, expected, found);
            let largest = differences.fields.values().next().map(|of| of.largest);
            let expected = if tick == 3 { 1.0 } else { 2.5 };
            assert_eq!(
                largest,
                Some(if tick > 4 { f64::INFINITY } else { expected })
            );
        }
        let first = differences
            .first
            .clone()
            .map(|first| (first.0, first.1.field));
        assert_eq!(first, Some((3, "tau[1]".to_owned())));
        let fields = differences.fields();
        let of =
            |field: &FieldDifference| (field.messages, field.tick, field.difference.field.clone());
        assert_eq!(
            fields.iter().map(of).collect::<Vec<_>>(),
            [(4, 5, "tau[1]".to_owned()), (4, 3, "phase".to_owned())]
        );
    }
}
