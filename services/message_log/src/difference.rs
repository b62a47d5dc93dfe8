//! Two messages that should be the same and are not: where they first differ, by name, and how far they do.

use std::marker::PhantomData;
use std::ops::Range;

use shared_types::Message;
use shared_types::wire::{Field, Stamps};

use crate::contents::structure;

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

/// How far a field differs over many messages.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct FieldDifference {
    /// The field, over all its elements: `singularities[0].zeta_B`.
    pub field: String,
    /// In how many messages it differs.
    pub messages: u64,
    /// Largest |found − expected| of an element, in the field's own unit; infinite where one of them is not a number.
    pub largest: f64,
    /// The tick of the largest.
    pub tick: u64,
    /// The element, and both values there.
    #[serde(rename = "at")]
    pub difference: Difference,
}

#[derive(Clone, Copy, Debug)]
enum Number {
    F64,
    U64,
    U32,
}

/// A field of plain numbers, nested structures looked into.
#[derive(Clone, Debug)]
struct Leaf {
    name: String,
    is_array: bool,
    number: Number,
    bytes: Range<usize>,
}

impl Leaf {
    fn size(&self) -> usize {
        if matches!(self.number, Number::U32) {
            4
        } else {
            8
        }
    }

    fn elements(&self) -> impl Iterator<Item = Range<usize>> + use<> {
        let size = self.size();
        self.bytes
            .clone()
            .step_by(size)
            .map(move |begin| begin..begin + size)
    }

    fn difference(&self, element: Range<usize>, expected: &[u8], found: &[u8]) -> Difference {
        let index = (element.start - self.bytes.start) / self.size();
        let field = if self.is_array {
            format!("{}[{index}]", self.name)
        } else {
            self.name.clone()
        };
        let text = |message: &[u8]| {
            let bytes = &message[element.clone()];
            match self.number {
                Number::F64 => format!("{:?}", bytemuck::pod_read_unaligned::<f64>(bytes)),
                Number::U64 => bytemuck::pod_read_unaligned::<u64>(bytes).to_string(),
                Number::U32 => bytemuck::pod_read_unaligned::<u32>(bytes).to_string(),
            }
        };
        Difference {
            field,
            expected: text(expected),
            found: text(found),
        }
    }

    fn value(&self, bytes: &[u8]) -> f64 {
        match self.number {
            Number::F64 => bytemuck::pod_read_unaligned(bytes),
            Number::U64 => bytemuck::pod_read_unaligned::<u64>(bytes) as f64,
            Number::U32 => f64::from(bytemuck::pod_read_unaligned::<u32>(bytes)),
        }
    }
}

/// All plain fields of a structure that begins at byte `base`, in order; without the stamps of a header, which are not compared.
fn leaves(layout: &[Field], base: usize, prefix: &str, found: &mut Vec<Leaf>) {
    for field in layout {
        let (name, begin) = (format!("{prefix}{}", field.name), base + field.offset);
        let is_array = field.type_name.starts_with('[');
        let Some((inside, size)) = structure(&field.element) else {
            let number = match &*field.element {
                "f64" => Number::F64,
                "u64" => Number::U64,
                _ => Number::U32,
            };
            found.push(Leaf {
                name,
                is_array,
                number,
                bytes: begin..begin + field.size,
            });
            continue;
        };
        let stamps = if field.element == "Header" {
            size_of::<Stamps>()
        } else {
            0
        };
        let inside: Vec<_> = inside
            .iter()
            .filter(|field| field.offset >= stamps)
            .cloned()
            .collect();
        for (index, place) in (begin..begin + field.size).step_by(size).enumerate() {
            let prefix = match is_array {
                true => format!("{name}[{index}]."),
                false => format!("{name}."),
            };
            leaves(&inside, place, &prefix, found);
        }
    }
}

fn leaves_of<M: Message>() -> Vec<Leaf> {
    let mut found = Vec::new();
    leaves(M::FIELDS, 0, "", &mut found);
    found
}

/// Where the contents of two messages first differ; stamps are not compared.
#[must_use]
pub fn first_difference<M: Message>(expected: &M, found: &M) -> Option<Difference> {
    first_difference_in(
        M::FIELDS,
        bytemuck::bytes_of(expected),
        bytemuck::bytes_of(found),
    )
}

/// The same of two messages whose layout alone is known.
#[must_use]
pub fn first_difference_in(fields: &[Field], expected: &[u8], found: &[u8]) -> Option<Difference> {
    let begin = size_of::<Stamps>();
    let place = expected
        .iter()
        .zip(found)
        .skip(begin)
        .position(|(a, b)| a != b)?
        + begin;
    let mut all = Vec::new();
    leaves(fields, 0, "", &mut all);
    let leaf = all.into_iter().find(|leaf| leaf.bytes.contains(&place))?;
    let element = leaf.elements().find(|element| element.contains(&place))?;
    Some(leaf.difference(element, expected, found))
}

/// How far two series of messages differ, field by field.
#[derive(Clone, Debug)]
pub struct Differences<M> {
    leaves: Vec<(Leaf, Option<FieldDifference>)>,
    _messages: PhantomData<M>,
}

impl<M: Message> Default for Differences<M> {
    fn default() -> Self {
        Self {
            leaves: leaves_of::<M>()
                .into_iter()
                .map(|leaf| (leaf, None))
                .collect(),
            _messages: PhantomData,
        }
    }
}

impl<M: Message> Differences<M> {
    /// Takes in a pair of messages of the same tick; stamps are not compared.
    pub fn add(&mut self, expected: &M, found: &M) {
        if expected.content() == found.content() {
            return;
        }
        let (old, new) = (bytemuck::bytes_of(expected), bytemuck::bytes_of(found));
        for (leaf, so_far) in &mut self.leaves {
            if old[leaf.bytes.clone()] == new[leaf.bytes.clone()] {
                continue;
            }
            let mut largest: Option<(f64, Range<usize>)> = None;
            for element in leaf
                .elements()
                .filter(|element| old[element.clone()] != new[element.clone()])
            {
                let size =
                    (leaf.value(&new[element.clone()]) - leaf.value(&old[element.clone()])).abs();
                let size = if size.is_nan() { f64::INFINITY } else { size };
                if largest.as_ref().is_none_or(|(largest, _)| size > *largest) {
                    largest = Some((size, element));
                }
            }
            let Some((size, element)) = largest else {
                continue;
            };
            let messages = so_far.as_ref().map_or(0, |so_far| so_far.messages) + 1;
            match so_far {
                Some(so_far) if so_far.largest >= size => so_far.messages = messages,
                _ => {
                    let difference = leaf.difference(element, old, new);
                    *so_far = Some(FieldDifference {
                        field: leaf.name.clone(),
                        messages,
                        largest: size,
                        tick: expected.header().tick,
                        difference,
                    });
                }
            }
        }
    }

    /// The fields that differ, in the order of the message.
    #[must_use]
    pub fn fields(self) -> Vec<FieldDifference> {
        self.leaves
            .into_iter()
            .filter_map(|(_, difference)| difference)
            .collect()
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
        let expected = SensorSample::default();
        let mut found = expected;
        found.stale_ticks = 2;
        assert_eq!(
            first_difference(&expected, &found).unwrap().field,
            "stale_ticks"
        );
        found.header.incarnation = 3;
        let difference = first_difference(&expected, &found).unwrap();
        assert_eq!(
            (&*difference.field, &*difference.found),
            ("header.incarnation", "3")
        );
        let expected = SingularityReport::default();
        let mut found = expected;
        found.singularities[2].zeta_B[4] = 1.0;
        assert_eq!(
            first_difference(&expected, &found).unwrap().field,
            "singularities[2].zeta_B[4]"
        );
        found.singularities[1].inside = 1;
        assert_eq!(
            first_difference(&expected, &found).unwrap().field,
            "singularities[1].inside"
        );
        found.header.tick = 9;
        assert_eq!(
            first_difference(&expected, &found).unwrap().field,
            "header.tick"
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
