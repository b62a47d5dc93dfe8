//! The recorder's checkpoint: progress and intermediate results of its predecessor.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use bytemuck::{bytes_of, bytes_of_mut};
use message_log::BLOCK;
use serde::{Deserialize, Serialize};
use shared_types::summary::RecorderSummary;
use viz::Written;

use crate::assemble::StoredRow;
use crate::judge::Judge;
use crate::topics::Past;

/// Name of the file in the run's directory.
const FILE: &str = "recorder.state";

/// Name of the file beside it with the recording's progress.
const WRITTEN: &str = "recorder.written";

/// How much a replacement has to go through again: messages that are kept, but in no figure yet; some 10 µs a tick. A checkpoint itself is not cheap:
/// it ends a chunk of everything that moves in the picture.
const EVERY: Duration = Duration::from_secs(8);
/// The same in ticks, for runs in lockstep.
const EVERY_TICKS: u64 = 8192;

/// The most ticks from one checkpoint to the next, where the run may be `most_ahead` of the recorder.
pub(crate) fn most_ticks(are_kept: bool, most_ahead: u64) -> u64 {
    runtime::most_ticks_unsaved(are_kept, most_ahead, BLOCK as u64, EVERY_TICKS)
}

/// Everything a recorder has gathered.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Checkpoint<J = Judge> {
    pub(crate) judge: J,
    pub(crate) progress: Past,
    /// The next tick to be assembled.
    pub(crate) next: u64,
    pub(crate) rows: Vec<StoredRow>,
    pub(crate) result: RecorderSummary,
    /// Entries of the fault table reported so far, with the facts reported for each.
    pub(crate) reported: Vec<u32>,
}

/// Place of the checkpoints: in shared memory, so that they outlive the recorder, but not the run.
pub(crate) struct Memory {
    path: PathBuf,
    saved: Instant,
    saved_ticks: u64,
    /// Progress of the recording; it changes too often to be part of a checkpoint.
    written: File,
    noted: Written,
}

impl Memory {
    /// # Errors
    /// If there is no room for it.
    pub(crate) fn open(run_dir: &Path) -> io::Result<Self> {
        let written = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .mode(0o600)
            .open(run_dir.join(WRITTEN))?;
        Ok(Self {
            path: run_dir.join(FILE),
            saved: Instant::now(),
            saved_ticks: 0,
            written,
            noted: Written::default(),
        })
    }

    /// Whether a checkpoint is due at a tick, where the last one may be so many ticks old.
    pub(crate) fn is_due(&self, ticks: u64, most_ticks: u64) -> bool {
        self.saved.elapsed() >= EVERY || ticks >= self.saved_ticks + most_ticks
    }

    /// Notes the progress of the recording.
    pub(crate) fn note(&mut self, written: Option<Written>) {
        if let Some(written) = written.filter(|written| *written != self.noted) {
            self.noted = written;
            let Written { next, part, bytes } = written;
            // It may fail, or the recorder be killed before: then a replacement goes on from the place noted last, and cuts away what is behind that.
            let _ = self
                .written
                .write_all_at(bytes_of(&[next, part.into(), bytes]), 0);
        }
    }

    /// Progress of the predecessor's recording; `None` if it had not noted any.
    pub(crate) fn written(&self) -> Option<Written> {
        let mut numbers = [0_u64; 3];
        self.written
            .read_exact_at(bytes_of_mut(&mut numbers), 0)
            .ok()?;
        let [next, part, bytes] = numbers;
        Some(Written {
            next,
            part: u32::try_from(part).ok()?,
            bytes,
        })
    }

    /// Writes it completely or not at all.
    pub(crate) fn save(&mut self, checkpoint: &Checkpoint<&Judge>) {
        (self.saved, self.saved_ticks) = (Instant::now(), checkpoint.next);
        let mut bytes = Vec::new();
        let draft = self.path.with_extension("draft");
        let written = ciborium::into_writer(checkpoint, &mut bytes)
            .map_err(|error| error.to_string())
            .and_then(|()| {
                std::fs::write(&draft, bytes)
                    .and_then(|()| std::fs::rename(&draft, &self.path))
                    .map_err(|error| error.to_string())
            });
        if let Err(error) = written {
            runtime::complain(&format_args!(
                "a restarted recorder would not know of this: cannot write {}: {error}",
                self.path.display()
            ));
        }
    }

    /// The predecessor's last checkpoint; `None` if there is none that is complete.
    pub(crate) fn last(&self) -> Option<Checkpoint> {
        let bytes = std::fs::read(&self.path).ok()?;
        ciborium::from_reader(bytes.as_slice()).ok()
    }
}
