//! Topics whose messages this program does not know: counted, hashed and kept as bytes, not drawn.

use message_log::{Place, RowWriter, Shape, TopicHash};
use runtime::{ForeignCollector, ProcessError, Shell};
use shared_types::layout::MessageLayout;
use shared_types::wire::Stamps;

use crate::checkpoint::{Bytes, Progress};
use crate::log_result::{self, Keep, LogResult};

/// The end of one such topic: its fingerprint, and the file that keeps its messages where that is wanted.
pub(crate) struct ForeignTap {
    pub(crate) topic: String,
    collector: ForeignCollector,
    hash: TopicHash,
    last: Option<Vec<u8>>,
    keep: Option<RowWriter>,
    logged: LogResult,
}

/// The reproducible bytes of a message: all but the stamps at its beginning.
pub(crate) fn content(message: &[u8]) -> &[u8] {
    message.get(size_of::<Stamps>()..).unwrap_or_default()
}

/// The bytes of a message as 64-bit words.
fn words(message: &[u8]) -> Vec<u64> {
    bytemuck::pod_collect_to_vec(message)
}

impl ForeignTap {
    /// A replacement goes on where its predecessor was killed, as for every other topic.
    pub(crate) fn open(
        shell: &Shell,
        layout: &MessageLayout,
        messages: Option<Keep<'_>>,
        past: &Progress,
    ) -> Result<Self, ProcessError> {
        let (topic, shape) = (layout.topic.clone(), Shape::from(layout));
        let mut collector = shell.foreign_collector(&topic)?;
        if shell.incarnation() == 1 {
            let (keep, logged) = log_result::first(
                messages.map(|(folder, logs)| RowWriter::create(folder, &shape, logs)),
            );
            return Ok(Self {
                topic,
                collector,
                hash: TopicHash::default(),
                last: None,
                keep,
                logged,
            });
        }
        collector.resume(past.last, past.lost);
        let (mut hash, mut last) = (past.hash, past.message.clone().map(|bytes| bytes.0));
        let mut logged = LogResult {
            bytes: past.log_bytes,
            error: past.log_error.clone(),
        };
        let place = Place {
            byte: past.log_bytes,
            messages: past.hash.count(),
        };
        let resumed = messages
            .filter(|_| logged.error.is_empty())
            .map(|(folder, logs)| {
                RowWriter::resume(folder, &shape, logs, place, |row| {
                    let message: Vec<u8> = bytemuck::cast_slice(&row).to_vec();
                    hash.add_content(content(&message));
                    collector.recount(&message);
                    last = Some(message);
                })
            });
        let keep = resumed.transpose().unwrap_or_else(|error| {
            runtime::complain(&error);
            logged.error = error.to_string();
            None
        });
        collector.recall(last.as_deref())?;
        Ok(Self {
            topic,
            collector,
            hash,
            last,
            keep,
            logged,
        })
    }

    pub(crate) fn drain(&mut self) -> Result<(), ProcessError> {
        let Self {
            collector,
            hash,
            last,
            keep,
            logged,
            ..
        } = self;
        collector.collect(|message| {
            hash.add_content(content(message));
            let last = last.get_or_insert_default();
            last.clear();
            last.extend_from_slice(message);
            if let Some(keeping) = keep
                && let Err(error) = keeping.add(&words(message))
            {
                runtime::complain(&error);
                *logged = LogResult {
                    bytes: keeping.place().byte,
                    error: error.to_string(),
                };
                *keep = None;
            }
        })?;
        Ok(())
    }

    pub(crate) fn flush(&mut self) {
        if let Some(keep) = &mut self.keep
            && let Err(error) = keep.flush()
        {
            runtime::complain(&error);
            self.logged = LogResult {
                bytes: keep.place().byte,
                error: error.to_string(),
            };
            self.keep = None;
        }
    }

    pub(crate) fn has_failed(&self) -> bool {
        !self.logged.error.is_empty()
    }

    pub(crate) fn hash(&self) -> TopicHash {
        self.hash
    }

    pub(crate) fn progress(&self) -> Progress {
        Progress {
            hash: self.hash,
            last: self.collector.last(),
            lost: self.collector.lost(),
            message: self.last.clone().map(Bytes),
            log_bytes: self
                .keep
                .as_ref()
                .map_or(self.logged.bytes, |keep| keep.place().byte),
            log_error: self.logged.error.clone(),
        }
    }

    pub(crate) fn finish(&mut self) -> LogResult {
        match self
            .keep
            .take()
            .map(|keep| (keep.place().byte, keep.finish()))
        {
            None => self.logged.clone(),
            Some((_, Ok(bytes))) => LogResult {
                bytes,
                error: String::new(),
            },
            Some((bytes, Err(error))) => LogResult {
                bytes,
                error: error.to_string(),
            },
        }
    }
}
