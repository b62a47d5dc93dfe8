//! The result of keeping the messages of a topic.

/// Bytes kept, and the reason why no more are; a disk that is full ends the keeping, not the run.
#[derive(Clone, Debug, Default)]
pub(crate) struct Kept {
    pub(crate) bytes: u64,
    pub(crate) error: String,
}
