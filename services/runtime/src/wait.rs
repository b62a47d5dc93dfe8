//! Results of a wait: its message, too late, a stop of the run, or nothing.

use std::time::Duration;

/// Reasons why a wait ended without its message. A stop of the run is not among them: waits return
/// `None` then.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Interrupted {
    /// Nothing came within the limit.
    #[error("{process} waited {waited:?} for {what} and gave up: is {from} alive?")]
    TimedOut {
        /// The waiting process.
        process: String,
        /// For what.
        what: String,
        /// The process that it was expected from.
        from: String,
        /// The waited.
        waited: Duration,
    },
    /// In lockstep a tick was skipped; nothing may be lost there.
    #[error(
        "{process} expected tick {expected} of topic {topic:?} and got tick {found}: a message was lost in lockstep"
    )]
    Lost {
        /// The reading process.
        process: String,
        /// Which topic.
        topic: &'static str,
        /// The tick that should have come.
        expected: u64,
        /// The tick that came.
        found: u64,
    },
    /// The graph declares an output that the process has not opened.
    #[error(
        "{process} has no writer for topic {topic:?}, which stands in its `writes` in the graph: \
         open one with `Shell::writer` before the first tick, or take the topic out of `writes`"
    )]
    Unopened {
        /// The process.
        process: String,
        /// The topic without a writer.
        topic: String,
    },
    /// In lockstep a process takes the next tick before it has answered the one in hand.
    #[error(
        "{process} asks for more and has not sent topic {topic:?} of tick {tick}: \
         send one message on each topic of its `writes` at every tick, or take the topic out of `writes`"
    )]
    Unsent {
        /// The process.
        process: String,
        /// The topic that it has not sent.
        topic: String,
        /// Its tick.
        tick: u64,
    },
    /// The program of the process has asked to end the wait, in [`Joined::look_out`](crate::Joined::look_out), or the process that stands for it is gone.
    #[error("{process} has ended its wait: {why}")]
    Asked {
        /// The process.
        process: String,
        /// The reason.
        why: &'static str,
    },
    /// iceoryx2 failed.
    #[error("{process} cannot use topic {topic:?}: {reason}")]
    Port {
        /// The process.
        process: String,
        /// Which topic.
        topic: &'static str,
        /// iceoryx2's own error.
        reason: String,
    },
}

/// How a wait ended.
pub(crate) enum Waited<T> {
    Ready(T),
    Late,
    Stopped,
}

/// The object of a wait, for its error message.
pub(crate) struct Wait {
    pub(crate) what: String,
    pub(crate) from: String,
}
