//! Differences between two messages that should be the same: the first differing field, and how far
//! it differs.

use std::collections::BTreeMap;
use std::marker::PhantomData;
use std::ops::Range;

use shared_types::Message;
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
        let (inside, begin) = (structure(&field.element), base + field.offset);
        let size = match &*field.element {
            _ if inside.is_some() => inside.map_or(0, |(_, size)| size),
            "f64" | "u64" => 8,
            "u8" => 1,
            _ => 4,
        };
        let path = format!("{prefix}{}", field.name);
        let places = (begin..begin + field.size).step_by(size);
        for (index, at) in places.enumerate() {
            let name = match field.type_name.starts_with('[') {
                true => format!("{path}[{index}]"),
                false => path.clone(),
            };
            match inside {
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

/// Those of a message that are compared: all behind the stamps at its beginning.
fn compared(fields: &[Field]) -> Vec<Element> {
    let mut all = Vec::new();
    elements(fields, 0, "", &mut all);
    all.retain(|element| element.bytes.start >= size_of::<Stamps>());
    all
}

/// The first difference between the contents of two messages; stamps are not compared.
pub(super) fn first_difference<M: Message>(expected: &M, found: &M) -> Option<Difference> {
    let [expected, found] = [expected, found].map(bytemuck::bytes_of);
    first_difference_in(M::FIELDS, expected, found)
}

/// The same of two messages whose layout alone is known.
pub(super) fn first_difference_in(
    fields: &[Field],
    expected: &[u8],
    found: &[u8],
) -> Option<Difference> {
    let [old, new] = [expected, found].map(|message| message.get(size_of::<Stamps>()..));
    if old == new {
        return None;
    }
    let mut all = compared(fields).into_iter();
    let first = all.find(|element| element.differs(expected, found))?;
    Some(first.difference(expected, found))
}

/// Differences between two series of messages, field by field.
#[derive(Clone, Debug)]
pub(super) struct Differences<M> {
    elements: Vec<Element>,
    /// By the place of the field in the message.
    fields: BTreeMap<usize, FieldDifference>,
    _messages: PhantomData<M>,
}

impl<M: Message> Default for Differences<M> {
    fn default() -> Self {
        Self {
            elements: compared(M::FIELDS),
            fields: BTreeMap::new(),
            _messages: PhantomData,
        }
    }
}

impl<M: Message> Differences<M> {
    /// Takes in a pair of messages of the same tick; stamps are not compared.
    pub(super) fn add(&mut self, expected: &M, found: &M) {
        if expected.content() == found.content() {
            return;
        }
        let [old, new] = [expected, found].map(bytemuck::bytes_of);
        for field in self.elements.chunk_by(|a, b| a.field == b.field) {
            let differing = field.iter().filter(|element| element.differs(old, new));
            let distances = differing.map(|element| (element.distance(old, new), element));
            let Some((largest, element)) = distances.reduce(|a, b| if b.0 > a.0 { b } else { a })
            else {
                continue;
            };
            let so_far = self.fields.get(&field[0].bytes.start);
            let messages = so_far.map_or(0, |so_far| so_far.messages) + 1;
            let difference = match so_far {
                Some(so_far) if so_far.largest >= largest => FieldDifference {
                    messages,
                    ..so_far.clone()
                },
                _ => FieldDifference {
                    field: element.field.clone(),
                    messages,
                    largest,
                    tick: expected.header().tick,
                    difference: element.difference(old, new),
                },
            };
            self.fields.insert(field[0].bytes.start, difference);
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
    use shared_types::{SingularityReport, TorqueCommand};

    #[test]
    fn the_first_differing_number_is_named_with_both_values() {
        let expected = TorqueCommand::default();
        let mut found = expected;
        found.header.stamps.sent_ns[0] = 7;
        assert_eq!(
            first_difference(&expected, &found),
            None,
            "stamps are not compared"
        );
        found.saturation_mask = 5;
        found.tau[7] = -0.5;
        let difference = first_difference(&expected, &found).unwrap();
        assert_eq!(
            (
                &*difference.field,
                &*difference.expected,
                &*difference.found
            ),
            ("tau[7]", "0.0", "-0.5")
        );
        found.tau[7] = 0.0;
        assert_eq!(
            first_difference(&expected, &found).unwrap().field,
            "saturation_mask"
        );
    }

    #[test]
    fn headers_and_nested_structures_are_looked_into() {
        let expected = SingularityReport::default();
        let mut found = expected;
        let first = |found| first_difference(&expected, &found).unwrap();
        found.singularities[2].zeta_B[4] = 1.0;
        assert_eq!(first(found).field, "singularities[2].zeta_B[4]");
        found.singularities[1].inside = 1;
        assert_eq!(first(found).field, "singularities[1].inside");
        found.header.incarnation = 3;
        let difference = first(found);
        assert_eq!(
            (&*difference.field, &*difference.found),
            ("header.incarnation", "3")
        );
    }

    #[test]
    fn the_largest_difference_of_each_field_is_kept_with_its_place() {
        let mut differences = Differences::default();
        let expected = TorqueCommand::default();
        for (tick, by) in [(3, 1.0), (4, -2.5), (5, 0.5)] {
            let (mut expected, mut found) = (expected, expected);
            (expected.header.tick, found.header.tick) = (tick, tick);
            found.header.stamps.sent_ns[1] = tick;
            found.tau[1] = by;
            found.phase = 2;
            differences.add(&expected, &found);
        }
        let mut poisoned = expected;
        poisoned.tau[3] = f64::NAN;
        let mut spoiled = Differences::default();
        spoiled.add(&expected, &poisoned);
        let fields = differences.fields();
        assert_eq!(
            fields.iter().map(|field| &*field.field).collect::<Vec<_>>(),
            ["tau", "phase"]
        );
        assert_eq!(
            (
                fields[0].messages,
                fields[0].largest,
                fields[0].tick,
                &*fields[0].difference.field
            ),
            (3, 2.5, 4, "tau[1]")
        );
        assert_eq!((fields[1].largest, fields[1].tick), (2.0, 3));
        let fields = spoiled.fields();
        assert_eq!(
            (fields[0].largest, &*fields[0].difference.found),
            (f64::INFINITY, "NaN")
        );
    }
}
