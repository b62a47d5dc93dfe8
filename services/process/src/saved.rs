//! The state of a process before a tick, with all that belongs to it, as bytes.

use bytemuck::{bytes_of, pod_read_unaligned};

/// Tick and length of the state, before it.
const HEAD: usize = 2 * size_of::<u64>();

/// Ticks between two cuts.
pub const CUT_TICKS: u64 = 1000;

/// A process by its name, and what it has saved: the bytes of a [`Saved`].
pub type NamedSaved = (String, Vec<u8>);

/// The state that a process has saved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Saved<'a> {
    /// The tick that comes next.
    pub tick: u64,
    /// The state, as its step has saved it.
    pub state: &'a [u8],
    /// The message that has closed the loop and is not read yet; empty where none has come, or the process does not make the ticks.
    pub carried: &'a [u8],
}

impl<'a> Saved<'a> {
    /// The parts of what was saved; `None` of other bytes.
    #[must_use]
    pub fn of(bytes: &'a [u8]) -> Option<Self> {
        let (head, rest) = bytes.split_at_checked(HEAD)?;
        let [tick, length]: [u64; 2] = pod_read_unaligned(head);
        let (state, carried) = rest.split_at_checked(usize::try_from(length).ok()?)?;
        Some(Self {
            tick,
            state,
            carried,
        })
    }

    /// Writes the bytes in place of what `out` holds; `state` appends those of the state.
    pub fn write(tick: u64, carried: &[u8], out: &mut Vec<u8>, state: impl FnOnce(&mut Vec<u8>)) {
        out.clear();
        out.resize(HEAD, 0);
        state(out);
        let words = [tick, (out.len() - HEAD) as u64];
        out[..HEAD].copy_from_slice(bytes_of(&words));
        out.extend_from_slice(carried);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_that_is_cut_short_is_none() {
        let mut bytes = Vec::new();
        Saved::write(3000, &[], &mut bytes, |out| out.extend([1, 2, 3]));
        assert_eq!(Saved::of(&bytes[..HEAD + 2]), None);
    }
}
