//! The checkpoint of a program, as armplane keeps it.

use shared_types::exchange::EXCHANGE_STATE;
use shared_types::wire::wire;

wire! {
    /// What a program of an exchange page wants to find again after a death: bytes of its own meaning.
    ProgramCheckpoint checkpoint version 1 {
        /// How many bytes count.
        bytes: u64,
        /// The bytes.
        state: [u8; EXCHANGE_STATE],
    }
}
