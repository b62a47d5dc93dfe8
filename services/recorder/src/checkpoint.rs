//! The recorder's checkpoint: the progress of its predecessor and its gathered results.

use std::convert::Infallible;
use std::fmt;
use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use bytemuck::{bytes_of, bytes_of_mut, try_pod_read_unaligned};
use message_log::{BLOCK, TopicHash};
use serde::de::Visitor;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use shared_types::summary::RecorderSummary;
use shared_types::topics::{self, Build, ByTopic, COUNT, Each, Received, Topic};
use viz::Written;

use crate::assemble::Row;
use crate::judge::Judge;

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
pub(crate) struct Checkpoint {
    pub(crate) judge: Judge,
    pub(crate) progress: Past,
    /// The next tick to be assembled.
    pub(crate) next: u64,
    pub(crate) rows: Vec<StoredRow>,
    pub(crate) result: RecorderSummary,
    /// Entries of the fault table that have been reported so far, with what was reported of each.
    pub(crate) reported: Vec<u32>,
}

/// How far each topic has been taken in.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Past {
    pub(crate) listed: [Progress; COUNT],
    /// Of the topics that only the graph knows, in its order.
    pub(crate) foreign: Vec<Progress>,
}

/// How far one topic has been taken in.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Progress {
    pub(crate) hash: TopicHash,
    pub(crate) last: Option<u64>,
    pub(crate) lost: u64,
    /// The last message, where there is one.
    pub(crate) message: Option<Bytes>,
    /// Bytes in the file of kept messages, which are all of them until now.
    pub(crate) log_bytes: u64,
    /// Why no more of them are kept.
    pub(crate) log_error: String,
}

/// A row that is still waiting for messages: a tick, and the bytes of the messages that have come.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct StoredRow(u64, [Option<Bytes>; COUNT]);

/// Bytes that are stored as one string of them, not number by number.
#[derive(Clone, Debug)]
pub(crate) struct Bytes(pub(crate) Vec<u8>);

impl Serialize for Bytes {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(&self.0)
    }
}

impl<'de> Deserialize<'de> for Bytes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Whole;
        impl Visitor<'_> for Whole {
            type Value = Bytes;
            fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                formatter.write_str("bytes")
            }
            fn visit_byte_buf<E>(self, bytes: Vec<u8>) -> Result<Bytes, E> {
                Ok(Bytes(bytes))
            }
            fn visit_bytes<E>(self, bytes: &[u8]) -> Result<Bytes, E> {
                Ok(Bytes(bytes.to_vec()))
            }
        }
        deserializer.deserialize_byte_buf(Whole)
    }
}

impl From<&Row> for StoredRow {
    fn from(row: &Row) -> Self {
        struct Stored<'a>(&'a ByTopic<Received>);
        impl Each for Stored<'_> {
            type Output = Option<Bytes>;
            fn each<M: Topic>(&mut self) -> Self::Output {
                M::of(self.0)
                    .as_ref()
                    .map(|message| Bytes(bytes_of(message).to_vec()))
            }
        }
        Self(row.tick, topics::each(&mut Stored(row.messages())))
    }
}

impl From<StoredRow> for Row {
    fn from(StoredRow(tick, bytes): StoredRow) -> Self {
        struct Messages([Option<Bytes>; COUNT]);
        impl Build<Received> for Messages {
            type Error = Infallible;
            fn build<M: Topic>(&mut self) -> Result<Option<M>, Infallible> {
                Ok(self.0[M::INDEX]
                    .as_ref()
                    .and_then(|bytes| try_pod_read_unaligned(&bytes.0).ok()))
            }
        }
        Self::new(tick, ByTopic::build(&mut Messages(bytes)))
    }
}

/// Where checkpoints are kept: in shared memory, so that they outlive the recorder and not the run.
pub(crate) struct Memory {
    path: PathBuf,
    saved: Instant,
    saved_ticks: u64,
    /// How far the recording has come; it changes too often to be a checkpoint's.
    written: File,
    noted: Written,
}

impl Memory {
    /// # Errors
    /// Where there is no room for it.
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

    /// Notes how far the recording has come.
    pub(crate) fn note(&mut self, written: Written) {
        if written != self.noted {
            self.noted = written;
            let Written { next, part, bytes } = written;
            // It may fail, or the recorder be killed before: then a replacement goes on from the place noted last, and cuts away what is behind that.
            let _ = self
                .written
                .write_all_at(bytes_of(&[next, part.into(), bytes]), 0);
        }
    }

    /// How far the predecessor's recording had come; `None` where it has not come to note it.
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

    /// Whole or not at all.
    pub(crate) fn save(&mut self, checkpoint: &Checkpoint) {
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

    /// The predecessor's last checkpoint; `None` where there is none that is complete.
    pub(crate) fn last(&self) -> Option<Checkpoint> {
        let bytes = std::fs::read(&self.path).ok()?;
        ciborium::from_reader(bytes.as_slice()).ok()
    }
}

#[cfg(test)]
mod tests {
    use shared_types::random::at as random;

    use super::*;

    /// The most messages of a topic that are in the retainer alone, whenever the recorder is killed: a run at random speeds, with as many messages as the
    /// retainer holds, and as far ahead of the recorder as [`runtime::Shell::most_ahead`] lets it be.
    fn most_unsafe(held: u64, are_kept: bool, most_ticks: fn(bool, u64) -> u64) -> u64 {
        let most_ahead = (held / 4).min(256);
        let (mut sent, mut taken_in, mut closed, mut in_log, mut saved) = (0_u64, 0, 0, 0, 0);
        let mut most = 0;
        for step in 0..100_000 {
            // In bursts: now the run is far ahead, now the recorder takes in a message at a time.
            if sent <= closed + most_ahead && random(7, step / 300) % 5 < 1 + random(8, step) % 5 {
                sent += 1;
            } else if random(9, step).is_multiple_of(3) {
                // A round: what was there when it began is closed with it.
                closed = taken_in;
                taken_in = sent;
                in_log += (taken_in - in_log) / BLOCK as u64 * BLOCK as u64;
                if taken_in >= saved + most_ticks(are_kept, most_ahead) {
                    (saved, in_log) = (taken_in, taken_in);
                }
            }
            most = most.max(sent - if are_kept { in_log } else { saved });
        }
        most
    }

    #[test]
    fn a_message_that_no_file_has_is_in_the_retainer_whenever_the_recorder_is_killed() {
        for (held, are_kept) in [16, 64, 256, 512, 1024]
            .into_iter()
            .flat_map(|held| [(held, true), (held, false)])
        {
            let most = most_unsafe(held, are_kept, most_ticks);
            assert!(
                most <= held,
                "{most} messages are in the retainer alone, which holds {held}; a log is kept: {are_kept}"
            );
        }
        let seldom = |_, _| EVERY_TICKS;
        assert!(
            most_unsafe(1024, false, seldom) > 1024 && most_unsafe(64, true, seldom) > 64,
            "the rule is needed"
        );
    }

    #[test]
    fn checkpoints_are_rare_where_the_logs_have_what_they_need() {
        assert_eq!(most_ticks(true, 256), EVERY_TICKS);
        assert_eq!(
            (most_ticks(false, 256), most_ticks(true, 4)),
            (256, 4),
            "nothing is kept; a block is more than the retainers hold"
        );
    }
}
