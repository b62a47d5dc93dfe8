//! Failures of the program. Each message completes a sentence that starts with "the program of
//! PROCESS".

use std::time::Duration;

use runtime::Exit;
use shared_types::exchange::EXCHANGE_STATE;

/// The program's fault.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[allow(
    missing_docs,
    reason = "each variant is its sentence, with its numbers"
)]
pub enum Failure {
    #[error(
        "cannot be started: {0}; `command` in the graph names it, relative to the graph's folder"
    )]
    Start(String),
    #[error("ended with {exit} {at}")]
    Ended { exit: Exit, at: String },
    #[error("has not joined within {} s: it has to store `program` = joined in its exchange page (docs/wire.md)", .0.as_secs())]
    Absent(Duration),
    #[error("cannot take part: {0}")]
    Refused(String),
    #[error(
        "speaks version {theirs} of the exchange page, armplane speaks version {ours}: make its messages again by `armplane generate wire`"
    )]
    Version { theirs: u32, ours: u32 },
    #[error(
        "uses {theirs} ({theirs_hash:016x}) for `{topic}`, armplane uses {ours} ({ours_hash:016x}): make its messages again by `armplane generate wire`"
    )]
    Layout {
        topic: String,
        theirs: String,
        theirs_hash: u64,
        ours: String,
        ours_hash: u64,
    },
    #[error(
        "does not write `{0}`, which the graph lists in its `writes`: declare it when it joins, or take it out of the graph"
    )]
    Unwritten(String),
    #[error("has not answered tick {tick} within {} s; `answer_limit_s` in the graph allows it longer", limit.as_secs())]
    Silent { tick: u64, limit: Duration },
    #[error(
        "answered tick {found} where tick {tick} was asked: an answer takes over the tick of its question"
    )]
    Tick { tick: u64, found: u64 },
    #[error(
        "wrote the count of answers {found} at tick {tick}, where {expected} was due: it grows by one with each answer"
    )]
    Count {
        tick: u64,
        found: u32,
        expected: u32,
    },
    #[error(
        "gave the answer {found} at tick {tick}, which has no meaning; docs/wire.md lists the answers"
    )]
    Code { tick: u64, found: u32 },
    #[error(
        "says of its checkpoint of tick {tick} that it has {found} bytes; there is room for {EXCHANGE_STATE}: save less, or restart without it"
    )]
    State { tick: u64, found: usize },
    #[error(
        "wrote a number that is not finite into {field} of `{topic}` at tick {tick}; every number of a message is finite"
    )]
    NotFinite {
        tick: u64,
        topic: &'static str,
        field: String,
    },
    #[error("cannot continue at tick {tick}: {complaint}")]
    Failed { tick: u64, complaint: String },
}
