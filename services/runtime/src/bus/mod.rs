//! Topics on iceoryx2: the services, and the ends that processes read and write.

pub(crate) mod collector;
pub(crate) mod depth;
pub(crate) mod foreign;
mod gather;
pub(crate) mod hub;
pub(crate) mod inlet;
pub(crate) mod reader;
mod recall;
pub(crate) mod topic;
pub(crate) mod writer;
