//! The result of keeping the messages of a topic.

use message_log::LogError;

/// Bytes kept, and the reason why no more are; a disk that is full ends the keeping, not the run.
#[derive(Clone, Debug, Default)]
pub(crate) struct Kept {
    pub(crate) bytes: u64,
    pub(crate) error: String,
}

/// The log that the first recorder of a run has made, where one is wanted; a volume without room ends the keeping before it begins.
pub(crate) fn first<Log>(made: Option<Result<Log, LogError>>) -> (Option<Log>, Kept) {
    match made.transpose() {
        Ok(log) => (log, Kept::default()),
        Err(error) => {
            eprintln!("{error}");
            (None, Kept { bytes: 0, error: error.to_string() })
        }
    }
}
