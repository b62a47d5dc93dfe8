//! Topics on iceoryx2.

pub(crate) mod topic;
