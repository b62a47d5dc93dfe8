//! The program's faults, each a sentence.

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
        "the program of {process} cannot be started: {reason}; `command` in the graph names it, relative to the graph's folder"
    )]
    Start { process: String, reason: String },
    #[error("the program of {process} ended with {exit} {at}")]
    Ended {
        process: String,
        exit: Exit,
        at: String,
    },
    #[error("the program of {process} has not joined within {} s: it has to store `program` = joined in its exchange page (docs/wire.md)", limit.as_secs())]
    Absent { process: String, limit: Duration },
    #[error(
        "the program of {process} refuses the exchange page: {complaint}; compare it with `armplane generate wire`"
    )]
    Refused { process: String, complaint: String },
    #[error(
        "the program of {process} speaks version {theirs} of the exchange page, armplane speaks version {ours}: make its messages again by `armplane generate wire`"
    )]
    Version {
        process: String,
        theirs: u32,
        ours: u32,
    },
    #[error(
        "the program of {process} uses {theirs} ({theirs_hash:016x}) for `{topic}`, armplane uses {ours} ({ours_hash:016x}): make its messages again by `armplane generate wire`"
    )]
    Layout {
        process: String,
        topic: String,
        theirs: String,
        theirs_hash: u64,
        ours: String,
        ours_hash: u64,
    },
    #[error(
        "the program of {process} does not write `{topic}`, which the graph lists in its `writes`: declare it when it joins, or take it out of the graph"
    )]
    Unwritten { process: String, topic: String },
    #[error("the program of {process} has not answered tick {tick} within {} s; `answer_limit_s` in the graph allows it longer", limit.as_secs())]
    Silent {
        process: String,
        tick: u64,
        limit: Duration,
    },
    #[error(
        "the program of {process} answered tick {found} where tick {tick} was asked: an answer takes over the tick of its question"
    )]
    Tick {
        process: String,
        tick: u64,
        found: u64,
    },
    #[error(
        "the program of {process} wrote the count of answers {found} at tick {tick}, where {expected} was due: it grows by one with each answer"
    )]
    Count {
        process: String,
        tick: u64,
        found: u32,
        expected: u32,
    },
    #[error(
        "the program of {process} gave the answer {found} at tick {tick}, which has no meaning; docs/wire.md lists the answers"
    )]
    Code {
        process: String,
        tick: u64,
        found: u32,
    },
    #[error(
        "the program of {process} says of its checkpoint of tick {tick} that it has {found} bytes; there is room for {EXCHANGE_STATE}: save less, or restart without it"
    )]
    State {
        process: String,
        tick: u64,
        found: usize,
    },
    #[error(
        "the checkpoint with which the program of {process} was to go on is damaged: it counts {found} bytes, and has room for {EXCHANGE_STATE}; run again"
    )]
    Damaged { process: String, found: u64 },
    #[error(
        "the program of {process} wrote a number that is not finite into {field} of `{topic}` at tick {tick}; every number of a message is finite"
    )]
    NotFinite {
        process: String,
        tick: u64,
        topic: &'static str,
        field: String,
    },
    #[error("the program of {process} cannot go on at tick {tick}: {complaint}")]
    Failed {
        process: String,
        tick: u64,
        complaint: String,
    },
}
