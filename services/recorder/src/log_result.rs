//! Where the message logs of a run go, and the result of a topic's.

use std::path::Path;

use message_log::{LogError, Logs};

/// The folder of the message logs, and the logs of the run.
pub(crate) type Keep<'a> = (&'a Path, &'a Logs);

/// Bytes in the log, and the reason why no more come; a disk that is full ends the log, not the run.
#[derive(Clone, Debug, Default)]
pub(crate) struct LogResult {
    pub(crate) bytes: u64,
    pub(crate) error: String,
}

/// The log that the first recorder of a run has made, where one is wanted; a volume without room ends the log before it begins.
pub(crate) fn first<Log>(made: Option<Result<Log, LogError>>) -> (Option<Log>, LogResult) {
    match made.transpose() {
        Ok(log) => (log, LogResult::default()),
        Err(error) => {
            runtime::complain(&error);
            (
                None,
                LogResult {
                    bytes: 0,
                    error: error.to_string(),
                },
            )
        }
    }
}
