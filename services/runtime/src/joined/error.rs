//! Why a program in another language cannot take part, or no longer. Each sentence names the process.

use crate::shell::ProcessError;

/// The end of a program's part in a run.
#[derive(Debug, thiserror::Error)]
pub enum JoinedError {
    /// The graph breaks.
    #[error(transparent)]
    Process(#[from] ProcessError),
    /// An answer is missing.
    #[error(
        "the program of {0} asks for more and has not answered tick {1}: send its outputs before the next wait"
    )]
    Unanswered(String, u64),
    /// An answer is one too many.
    #[error("the program of {0} answers a tick that it has not been given: wait for one first")]
    NothingAsked(String),
    /// A topic without a writer.
    #[error(
        "the program of {0} does not write `{1}`, which the graph lists in its `writes`: fill it, or take it out of the graph"
    )]
    Unwritten(String, &'static str),
    /// Its messages are others.
    #[error(
        "the program of {process} uses the layout {theirs:016x} for `{topic}`, armplane uses {ours:016x}: make its messages again by `armplane generate wire`"
    )]
    Layout {
        /// The process.
        process: String,
        /// The topic.
        topic: String,
        /// The program's.
        theirs: u64,
        /// This library's.
        ours: u64,
    },
    /// No such topic.
    #[error(
        "the program of {process} asks for `{topic}`, which the graph does not list in its `{key}`"
    )]
    Unlisted {
        /// The process.
        process: String,
        /// The topic.
        topic: String,
        /// The key of the graph.
        key: &'static str,
    },
    /// A number that is none.
    #[error(
        "the program of {process} wrote a number that is not finite into {field} of `{topic}` at tick {tick}; every number of a message is finite"
    )]
    NotFinite {
        /// The process.
        process: String,
        /// The topic.
        topic: &'static str,
        /// The first such field.
        field: String,
        /// The tick.
        tick: u64,
    },
    /// It is no function of its inputs.
    #[error(
        "the program of {process} goes on after a death without a state, and answers tick {tick} otherwise than before: {field} of `{topic}`. Compute it from the inputs alone, or give a state to go on from"
    )]
    Differs {
        /// The process.
        process: String,
        /// The topic.
        topic: &'static str,
        /// The first field that differs.
        field: String,
        /// The tick.
        tick: u64,
    },
    /// Too large a state.
    #[error("the state of {0} has {1} bytes; there is room for 1 MiB: save less")]
    State(String, usize),
}
