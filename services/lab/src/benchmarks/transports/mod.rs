//! Transports between two processes that topics are measured against: of the machine, and of iceoryx2 bare.

mod block;
mod iceoryx;
mod mailbox;

pub use block::{Block, HEADER_BYTES, HEADER_WORDS, is_whole};
pub use iceoryx::{Bare, Iceoryx, Wake as IceoryxWake};
pub use mailbox::{Mailboxes, Wake};
