//! Reasons why a topic cannot be used.

/// Why a topic cannot be made or opened.
#[derive(Debug, thiserror::Error)]
pub enum TopicError {
    /// iceoryx2 has no place to put its files.
    #[error("cannot join the run {run} in shared memory: {reason}")]
    Node {
        /// The run's name.
        run: String,
        /// iceoryx2's own error.
        reason: String,
    },
    /// No message of that name.
    #[error("there is no topic {topic:?}; there are {known}")]
    Unknown {
        /// The name asked for.
        topic: String,
        /// The names there are.
        known: String,
    },
    /// The launcher did not make it, or it cannot be used.
    #[error("cannot {action} topic {topic:?}: {reason}")]
    Service {
        /// The operation.
        action: &'static str,
        /// Which topic.
        topic: &'static str,
        /// iceoryx2's own error.
        reason: String,
    },
    /// Two builds that disagree on the bytes.
    #[error(
        "topic {topic:?} was made with wire format {found}, this program has {ours:016x}: \
         start all processes from the same build of armplane"
    )]
    WireFormat {
        /// Which topic.
        topic: &'static str,
        /// The service's own error.
        found: String,
        /// This program's own value.
        ours: u64,
    },
    /// A graph and a process that disagree on the bytes of a message of their own.
    #[error(
        "topic {topic:?} is declared in the graph with the layout {found}, this program sends {type_name} with the layout {ours:016x}: \
         write the same type name and fields in both"
    )]
    Layout {
        /// Which topic.
        topic: &'static str,
        /// The type of this program.
        type_name: &'static str,
        /// The hash of the layout in the graph.
        found: String,
        /// The hash of the layout in this program.
        ours: u64,
    },
    /// The graph does not declare it.
    #[error("process {process:?} may not {action} topic {topic:?}: the graph does not say so")]
    Undeclared {
        /// The process.
        process: String,
        /// "read" or "write".
        action: &'static str,
        /// Which topic.
        topic: &'static str,
    },
}
