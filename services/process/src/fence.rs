//! Validates messages: none from a dead incarnation enters a process, and no NaN or infinity enters
//! or leaves one.

use shared_types::Message;
use shared_types::wire::Field;

/// Refuses the messages of a writer's dead incarnations.
///
/// A SIGKILLed writer's undelivered messages come first, before its replacement's. In real time the control page says which incarnation
/// lives. In lockstep the last messages of the dead one belong to the run (whether they are read before or after the launcher detects the
/// death must not matter), so there only an incarnation older than one already heard is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Fence {
    newest_heard: u32,
}

impl Default for Fence {
    fn default() -> Self {
        // The first start of a process has the number 1.
        Self { newest_heard: 1 }
    }
}

impl Fence {
    /// Whether a message of an incarnation counts. `living` is its writer's on the control page, `None` in lockstep.
    #[inline]
    pub fn admits(&mut self, incarnation: u32, living: Option<u32>) -> bool {
        let is_living = incarnation >= self.newest_heard.max(living.unwrap_or(0));
        if is_living {
            self.newest_heard = incarnation;
        }
        is_living
    }
}

/// The first field of a message that holds a number that is not finite.
#[inline]
pub(crate) fn first_not_finite<M: Message>(message: &M) -> Option<&'static str> {
    if message.is_finite() {
        return None;
    }
    let is_nested = |field: &&Field| !["Header", "u32", "u64", "f64"].contains(&&*field.element);
    // A byte outside all plain fields belongs to a nested one.
    let guilty = not_finite(bytemuck::bytes_of(message), M::FIELDS)
        .or_else(|| M::FIELDS.iter().find(is_nested));
    Some(guilty.map_or("a field", |field| &*field.name))
}

/// The first of the fields of a message, none of them nested, that holds a number that is not finite.
pub fn not_finite<'a>(message: &[u8], fields: &'a [Field]) -> Option<&'a Field> {
    let is_bad = |field: &&Field| {
        let bytes = message.get(field.offset..field.offset + field.size);
        let mut numbers = bytes.unwrap_or_default().chunks_exact(size_of::<f64>());
        let is_finite = |number: &[u8]| bytemuck::pod_read_unaligned::<f64>(number).is_finite();
        field.is_number() && !numbers.all(is_finite)
    };
    fields.iter().find(is_bad)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_dead_are_refused_as_soon_as_the_control_page_or_a_successor_says_so() {
        // Of these messages, each with the incarnation on the control page, those that count.
        let admitted = |messages: &[(u32, Option<u32>)]| {
            let mut fence = Fence::default();
            let counts = messages
                .iter()
                .map(|(of, living)| fence.admits(*of, *living));
            counts.collect::<Vec<_>>()
        };
        assert_eq!(
            admitted(&[(1, Some(1)), (1, Some(2)), (2, Some(2))]),
            [true, false, true]
        );
        assert_eq!(
            admitted(&[(0, None), (1, None), (2, None), (1, None)]),
            [false, true, true, false]
        );
    }
}
