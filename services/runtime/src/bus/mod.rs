//! Topics on iceoryx2: the services, and the ends that processes read and write.
//!
//! Below, a message is bytes (`format`, `topic`, `port`, `retainer`, `inlet`, `gather`), and iceoryx2 is compiled once; types begin at the ends
//! that a process holds (`reader`, `writer`, `collector`).

pub(crate) mod collector;
pub(crate) mod depth;
pub(crate) mod error;
pub(crate) mod format;
mod gather;
pub(crate) mod hub;
mod inlet;
mod missed;
pub(crate) mod node;
pub(crate) mod port;
pub(crate) mod reader;
mod retainer;
pub(crate) mod topic;
pub(crate) mod writer;
