//! The checkpoint of a program, as armplane keeps it.

use shared_types::exchange::EXCHANGE_STATE;
use shared_types::wire::wire;

wire! {
    /// The state that a program of an exchange page finds again after a death: bytes of its own meaning.
    ProgramCheckpoint checkpoint version 1 {
        /// How many bytes count.
        bytes: u64,
        /// The bytes.
        state: [u8; EXCHANGE_STATE],
    }
}
