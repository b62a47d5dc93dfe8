//! The state of a process as bytes.

use bytemuck::{bytes_of, pod_read_unaligned};
use shared_types::Layout;
use xxhash_rust::xxh3::xxh3_64;

/// Why bytes are no state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Damaged {
    /// They are of another layout.
    #[error(
        "the state has the layout {found:016x}, this program has {ours:016x}: start it from a state that this version has saved"
    )]
    Layout {
        /// That of this program.
        ours: u64,
        /// Theirs.
        found: u64,
    },
    /// They are not the bytes that were saved.
    #[error("the state does not match its checksum")]
    Checksum,
    /// They are no state of this process.
    #[error("the state is none of this process")]
    Content,
}

/// State that can be saved and taken up again, bit for bit.
pub trait Snapshot {
    /// A hash of what [`write`](Self::write) writes: it differs where the bytes mean something else.
    fn layout(&self) -> u64;

    /// Appends all of it.
    fn write(&self, out: &mut Vec<u8>);

    /// Takes up what [`write`](Self::write) has written.
    ///
    /// # Errors
    /// [`Damaged`], with the state as it was.
    fn read(&mut self, from: &[u8]) -> Result<(), Damaged>;
}

/// Plain data is its own snapshot.
impl<T: Layout> Snapshot for T {
    fn layout(&self) -> u64 {
        T::layout_hash()
    }

    fn write(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(bytes_of(self));
    }

    fn read(&mut self, from: &[u8]) -> Result<(), Damaged> {
        if from.len() != size_of::<T>() {
            return Err(Damaged::Content);
        }
        *self = pod_read_unaligned(from);
        Ok(())
    }
}

/// No state: each tick follows from its inputs.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stateless;

impl Snapshot for Stateless {
    fn layout(&self) -> u64 {
        0
    }
    fn write(&self, _out: &mut Vec<u8>) {}
    fn read(&mut self, from: &[u8]) -> Result<(), Damaged> {
        from.is_empty().then_some(()).ok_or(Damaged::Content)
    }
}

/// Layout and checksum before the bytes of a state.
const HEAD: usize = 2 * size_of::<u64>();

/// Appends a state with its layout and checksum.
pub(crate) fn save(state: &impl Snapshot, out: &mut Vec<u8>) {
    let begin = out.len();
    out.resize(begin + HEAD, 0);
    state.write(out);
    let (head, bytes) = out[begin..].split_at_mut(HEAD);
    head[..HEAD / 2].copy_from_slice(&state.layout().to_le_bytes());
    head[HEAD / 2..].copy_from_slice(&xxh3_64(bytes).to_le_bytes());
}

/// Takes up what [`save`] has written.
pub(crate) fn restore(state: &mut impl Snapshot, from: &[u8]) -> Result<(), Damaged> {
    let (head, bytes) = from.split_at_checked(HEAD).ok_or(Damaged::Checksum)?;
    let word = |at: usize| u64::from_le_bytes(std::array::from_fn(|i| head[at + i]));
    let (ours, found) = (state.layout(), word(0));
    if found != ours {
        return Err(Damaged::Layout { ours, found });
    }
    if word(HEAD / 2) != xxh3_64(bytes) {
        return Err(Damaged::Checksum);
    }
    state.read(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::{ServoState, TorqueCommand};

    #[test]
    fn a_state_comes_back_bit_for_bit_or_not_at_all() {
        let state = TorqueCommand {
            tau: [
                -0.0,
                f64::MIN_POSITIVE / 3.0,
                0.1,
                1e300,
                -1.0,
                0.5,
                2.0,
                3.0,
            ],
            ..TorqueCommand::default()
        };
        let (mut bytes, mut other) = (Vec::new(), TorqueCommand::default());
        save(&state, &mut bytes);
        assert_eq!(bytes.len(), HEAD + size_of::<TorqueCommand>());
        restore(&mut other, &bytes).unwrap();
        assert_eq!(bytes_of(&other), bytes_of(&state));
        for at in 0..bytes.len() {
            let (mut spoilt, mut kept) = (bytes.clone(), other);
            spoilt[at] ^= 1 << (at % 8);
            assert!(restore(&mut kept, &spoilt).is_err(), "byte {at}");
            assert!(restore(&mut kept, &bytes[..at]).is_err(), "{at} bytes");
            assert_eq!(bytes_of(&kept), bytes_of(&other));
        }
        let another = restore(&mut ServoState::default(), &bytes);
        assert!(matches!(another, Err(Damaged::Layout { .. })));
    }
}
