//! The checkpoint of a program, as armplane keeps it.

use shared_types::exchange::EXCHANGE_STATE;
use shared_types::wire::wire;

wire! {
    /// The program's state for a replacement: opaque bytes.
    ProgramCheckpoint checkpoint version 1 {
        /// How many bytes count.
        bytes: u64,
        /// The bytes.
        state: [u8; EXCHANGE_STATE],
    }
}

impl ProgramCheckpoint {
    /// The bytes that count; `None` if it counts more than it has.
    pub(crate) fn used(&self) -> Option<&[u8]> {
        self.state.get(..usize::try_from(self.bytes).ok()?)
    }
}

#[cfg(test)]
mod tests {
    use bytemuck::Zeroable;

    use super::*;

    #[test]
    fn a_damaged_length_is_refused_and_not_shortened() {
        let with = |bytes: u64| ProgramCheckpoint {
            bytes,
            ..ProgramCheckpoint::zeroed()
        };
        assert_eq!(with(3).used(), Some(&[0; 3][..]));
        assert_eq!(
            with(EXCHANGE_STATE as u64).used().map(<[u8]>::len),
            Some(EXCHANGE_STATE)
        );
        assert!(
            with(EXCHANGE_STATE as u64 + 1).used().is_none() && with(u64::MAX).used().is_none()
        );
    }
}
