//! The recorder's topics: counts, hashes and logs every message, and adds it to the row of its
//! tick.

use std::path::Path;

use message_log::{Contents, LogError, Place, TopicHash, Writer, tick_of};
use runtime::{Collector, ProcessError, Shell};
use serde::{Deserialize, Serialize};
use serde_bytes::ByteBuf;
use shared_types::topics::TOPICS;
use shared_types::wire::Stamps;

use crate::assemble::{Assembler, Put, puts};

/// Progress in one topic.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Progress {
    hash: TopicHash,
    last: Option<u64>,
    lost: u64,
    /// The last message; empty if there is none.
    message: ByteBuf,
}

/// Progress in all topics and in the log.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Past {
    topics: Vec<Progress>,
    log: LogResult,
}

/// Bytes in the log, and the reason why no more come; a disk that is full ends the log, not the run.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct LogResult {
    pub(crate) bytes: u64,
    pub(crate) error: String,
}

/// The messages of a topic so far.
pub(crate) struct Taken {
    pub(crate) topic: String,
    pub(crate) hash: TopicHash,
    /// The last message; empty if there is none.
    last: Vec<u8>,
    /// The way into a row; none of a topic that only the graph knows.
    put: Option<Put>,
}

impl Taken {
    pub(crate) fn new(topic: &str) -> Self {
        let place = TOPICS.iter().position(|known| *known == topic);
        Self {
            topic: topic.to_owned(),
            hash: TopicHash::default(),
            last: Vec::new(),
            put: place.map(|place| puts()[place]),
        }
    }

    pub(crate) fn take(&mut self, message: &[u8], assembler: &mut Assembler) {
        // The stamps at its beginning are not reproducible.
        let content = message.get(size_of::<Stamps>()..).unwrap_or_default();
        self.hash.add_content(content);
        self.last.clear();
        self.last.extend_from_slice(message);
        if let Some(put) = self.put
            && let Some(row) = assembler.row(tick_of(message))
        {
            put(row, message);
        }
    }

    fn last(&self) -> Option<&[u8]> {
        (!self.last.is_empty()).then_some(&self.last)
    }

    /// The tick after the last message's.
    pub(crate) fn next_tick(&self) -> u64 {
        self.last()
            .map_or(0, |last| tick_of(last).saturating_add(1))
    }
}

/// Name and hash of each topic, and those that are in no row.
pub(crate) fn account<'a>(
    topics: impl Iterator<Item = &'a Taken> + Clone,
) -> (Vec<(&'a str, TopicHash)>, Vec<String>) {
    let foreign = topics.clone().filter(|taken| taken.put.is_none());
    let foreign = foreign.map(|taken| taken.topic.clone()).collect();
    let hashes = topics.map(|taken| (taken.topic.as_str(), taken.hash));
    (hashes.collect(), foreign)
}

/// A topic that the recorder reads.
struct TopicReader {
    /// Its channel in the log.
    channel: usize,
    collector: Collector<[u8]>,
    taken: Taken,
}

/// All topics that the recorder reads, and the log that keeps their messages where that is wanted.
pub(crate) struct Topics {
    readers: Vec<TopicReader>,
    log: Option<Writer>,
    result: LogResult,
}

impl Topics {
    /// A replacement continues where its predecessor was killed: messages that the log has since
    /// the last checkpoint are taken in again, and the first [`drain`](Self::drain) gives the
    /// messages that were under way. `log`: where messages are kept.
    ///
    /// # Errors
    /// When a topic cannot be opened.
    pub(crate) fn open(
        shell: &Shell,
        contents: &Contents,
        log: Option<&Path>,
        past: &Past,
        assembler: &mut Assembler,
    ) -> Result<Self, ProcessError> {
        let (mut readers, mut place) = (Vec::new(), Place::default());
        for (channel, layout) in contents.layouts().iter().enumerate() {
            place.messages.push(0);
            if shell.reads(&layout.topic) {
                let past = past.topics.get(readers.len()).cloned().unwrap_or_default();
                place.messages[channel] = past.hash.count();
                let mut collector = shell.collector_of(&layout.topic)?;
                if shell.incarnation() > 1 {
                    collector.resume(past.last, past.lost);
                }
                readers.push(TopicReader {
                    channel,
                    collector,
                    taken: Taken {
                        hash: past.hash,
                        last: past.message.into_vec(),
                        ..Taken::new(&layout.topic)
                    },
                });
            }
        }
        let mut topics = Self {
            readers,
            log: None,
            result: past.log.clone(),
        };
        place.bytes = topics.result.bytes;
        if let Some(path) = log.filter(|_| topics.result.error.is_empty()) {
            let opened = match shell.incarnation() {
                1 => Writer::create(path, contents),
                _ => topics.resume(path, contents, &place, assembler),
            };
            topics.log = opened.map_err(|error| topics.fail(&error)).ok();
        }
        if shell.incarnation() > 1 {
            for TopicReader {
                collector, taken, ..
            } in &mut topics.readers
            {
                collector.recall(taken.last())?;
            }
        }
        Ok(topics)
    }

    fn resume(
        &mut self,
        path: &Path,
        contents: &Contents,
        from: &Place,
        assembler: &mut Assembler,
    ) -> Result<Writer, LogError> {
        Writer::resume(path, contents, from, |channel, message| {
            let mut readers = self.readers.iter_mut();
            if let Some(reader) = readers.find(|reader| reader.channel == channel) {
                reader.collector.recount(message);
                reader.taken.take(message, assembler);
            }
        })
    }

    /// Takes in everything that is there, in a run of which so many ticks have begun.
    pub(crate) fn drain(
        &mut self,
        begun: u64,
        assembler: &mut Assembler,
    ) -> Result<(), ProcessError> {
        let (log, mut failed) = (&mut self.log, None);
        for TopicReader {
            channel,
            collector,
            taken,
            ..
        } in &mut self.readers
        {
            collector.collect(|message| {
                taken.take(message, assembler);
                if let Some(log) = log
                    && failed.is_none()
                {
                    failed = log.add(*channel, message).err();
                }
            })?;
        }
        if let Some(error) = failed {
            self.fail(&error);
        }
        self.write(|log| log.end_round(begun));
        Ok(())
    }

    /// Writes the messages that wait for the end of a block.
    pub(crate) fn flush(&mut self) {
        self.write(Writer::flush);
    }

    fn write(&mut self, write: impl FnOnce(&mut Writer) -> Result<(), LogError>) {
        if let Some(log) = &mut self.log {
            match write(log) {
                Ok(()) => self.result.bytes = log.place().bytes,
                Err(error) => self.fail(&error),
            }
        }
    }

    /// The first error ends the log.
    fn fail(&mut self, error: &LogError) {
        runtime::complain(error);
        self.result.error = error.to_string();
        if let Some(bytes) = self.log.take().and_then(|log| log.bytes().ok()) {
            self.result.bytes = bytes;
        }
    }

    pub(crate) fn has_failed(&self) -> bool {
        !self.result.error.is_empty()
    }

    pub(crate) fn progress(&self) -> Past {
        let topics = self.readers.iter().map(|reader| Progress {
            hash: reader.taken.hash,
            last: reader.collector.last(),
            lost: reader.collector.lost(),
            message: ByteBuf::from(&reader.taken.last[..]),
        });
        Past {
            topics: topics.collect(),
            log: self.result.clone(),
        }
    }

    /// Ends the log.
    pub(crate) fn finish(&mut self) -> LogResult {
        match self.log.take().map(Writer::finish) {
            None => {}
            Some(Ok(bytes)) => self.result.bytes = bytes,
            Some(Err(error)) => self.fail(&error),
        }
        self.result.clone()
    }

    /// See [`account`].
    pub(crate) fn account(&self) -> (Vec<(&str, TopicHash)>, Vec<String>) {
        account(self.readers.iter().map(|reader| &reader.taken))
    }
}
