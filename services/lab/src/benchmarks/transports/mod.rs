//! Transports between two processes that topics are measured against: of the machine, and of iceoryx2 bare.

mod block;
mod iceoryx;
mod mailbox;

pub(super) use block::{
    BLOCK_TOPICS, BLOCKS, BlockMessage, HEADER_BYTES, HEADER_WORDS, is_whole, message_words,
};
pub(super) use iceoryx::{Iceoryx, Wake as IceoryxWake};
pub(super) use mailbox::{Mailboxes, Wake};
