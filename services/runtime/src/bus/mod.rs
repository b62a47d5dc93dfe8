//! Topics on iceoryx2: the services, and the ends that processes read and write.
//!
//! Inside, messages are bytes (`format`, `topic`, `port`, `inlet`, `collector`), so that
//! iceoryx2 is compiled once. The ends that a process holds are typed (`reader`, `writer`).

pub(crate) mod collector;
pub(crate) mod depth;
pub(crate) mod error;
pub(crate) mod format;
pub(crate) mod hub;
mod inlet;
pub(crate) mod node;
pub(crate) mod port;
pub(crate) mod reader;
pub(crate) mod topic;
pub(crate) mod writer;
