//! What a recorder that is started again must know: how far its predecessor had come, and what it had gathered.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use bytemuck::{bytes_of, try_pod_read_unaligned};
use runtime::TopicHash;
use serde::{Deserialize, Serialize};
use shared_types::Message;
use shared_types::summary::RecorderSummary;

use crate::assemble::Row;
use crate::judge::Judge;

/// Name of the file in the run's directory.
const FILE: &str = "recorder.state";

/// A recorder that dies unforeseen loses no more of its figures than this.
const EVERY: Duration = Duration::from_millis(250);

/// Everything a recorder has gathered.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Checkpoint {
    pub(crate) judge: Judge,
    pub(crate) progress: [Progress; 5],
    /// The next tick to be assembled.
    pub(crate) next: u64,
    pub(crate) rows: Vec<StoredRow>,
    pub(crate) result: RecorderSummary,
    /// Entries of the ledger that have been told so far, with what was told of each.
    pub(crate) told: Vec<u32>,
}

/// How far one topic has been taken in.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Progress {
    pub(crate) hash: TopicHash,
    pub(crate) last: Option<u64>,
    pub(crate) lost: u64,
}

/// A row that is still waiting for messages: a tick, and the bytes of the messages that have come.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct StoredRow(u64, [Option<Vec<u8>>; 5]);

impl From<&Row> for StoredRow {
    fn from(row: &Row) -> Self {
        fn bytes<M: Message>(message: &Option<M>) -> Option<Vec<u8>> {
            message.as_ref().map(|message| bytes_of(message).to_vec())
        }
        let Row { tick, sensor, truth, estimate, report, command } = row;
        Self(*tick, [bytes(sensor), bytes(truth), bytes(estimate), bytes(report), bytes(command)])
    }
}

impl From<StoredRow> for Row {
    fn from(StoredRow(tick, [sensor, truth, estimate, report, command]): StoredRow) -> Self {
        fn message<M: Message>(bytes: Option<Vec<u8>>) -> Option<M> {
            try_pod_read_unaligned(&bytes?).ok()
        }
        Self {
            tick,
            sensor: message(sensor),
            truth: message(truth),
            estimate: message(estimate),
            report: message(report),
            command: message(command),
        }
    }
}

/// Where checkpoints are kept: in shared memory, so that they outlive the recorder and not the run.
pub(crate) struct Memory {
    path: PathBuf,
    saved: Instant,
}

impl Memory {
    pub(crate) fn new(run_dir: &std::path::Path) -> Self {
        Self { path: run_dir.join(FILE), saved: Instant::now() }
    }

    pub(crate) fn is_due(&self) -> bool {
        self.saved.elapsed() >= EVERY
    }

    /// Whole or not at all.
    pub(crate) fn save(&mut self, checkpoint: &Checkpoint) {
        self.saved = Instant::now();
        let mut bytes = Vec::new();
        let draft = self.path.with_extension("draft");
        let written = ciborium::into_writer(checkpoint, &mut bytes).map_err(|error| error.to_string()).and_then(|()| {
            std::fs::write(&draft, bytes).and_then(|()| std::fs::rename(&draft, &self.path)).map_err(|error| error.to_string())
        });
        if let Err(error) = written {
            eprintln!("a restarted recorder would not know of this: cannot write {}: {error}", self.path.display());
        }
    }

    /// What the predecessor saved last; `None` where there is nothing, or nothing whole.
    pub(crate) fn last(&self) -> Option<Checkpoint> {
        let bytes = std::fs::read(&self.path).ok()?;
        ciborium::from_reader(bytes.as_slice()).ok()
    }
}
