//! The launcher's reader of a topic: retains the last messages, so that no death loses one.

use lockstep::Ring;

use crate::bus::depth::depth;
use crate::bus::error::TopicError;
use crate::bus::format::{Format, header};
use crate::bus::node::Bus;
use crate::bus::port::Receiver;
use crate::bus::topic::Topic;
use crate::memory::HandedOver;
use crate::run_dir::RunDir;

/// One more reader of a topic, in the launcher, that reads nothing: the last [`depth`] messages stay in shared memory, without a copy, whatever
/// process of the run dies.
///
/// When the recorder is replaced, the retained messages are copied to a file, from which the
/// replacement fetches them.
pub(crate) struct Retainer {
    format: Format,
    receiver: Receiver,
    handed_over: HandedOver,
    _topic: Topic,
}

impl Retainer {
    /// Makes the topic, and its first reader: a message is in the retainer's buffer before any other reader has it.
    pub(crate) fn create(
        bus: &Bus,
        run: &RunDir,
        format: Format,
        readers: usize,
        layout: u64,
    ) -> Result<Self, TopicError> {
        let topic = Topic::create(bus, format, readers, layout)?;
        let receiver = topic.receiver(depth(format.bytes))?;
        let handed_over = HandedOver::open(run, format.topic, format.bytes).map_err(|error| {
            TopicError::Memory {
                topic: format.topic,
                reason: error.to_string(),
            }
        })?;
        Ok(Self {
            format,
            receiver,
            handed_over,
            _topic: topic,
        })
    }

    /// Connects to new writers: a dead writer's messages outlive the removal of its ports only in
    /// connected readers.
    pub(crate) fn connect(&self) -> Result<(), TopicError> {
        self.receiver
            .update_connections()
            .map_err(|e| self.failed(e))
    }

    /// Copies all that is there to the file, oldest first.
    pub(crate) fn hand_over(&self) -> Result<(), TopicError> {
        while let Some(message) = self.receiver.receive().map_err(|e| self.failed(e))? {
            self.handed_over.push(&message);
        }
        Ok(())
    }

    pub(crate) fn topic(&self) -> &'static str {
        self.format.topic
    }

    /// The tick of the newest message handed over.
    pub(crate) fn last_tick(&self) -> Option<u64> {
        let newest = self.handed_over.count().checked_sub(1)?;
        self.handed_over
            .get(newest)
            .map(|message| header(&message).tick)
    }

    fn failed(&self, reason: impl std::fmt::Display) -> TopicError {
        TopicError::Service {
            action: "keep",
            topic: self.format.topic,
            reason: reason.to_string(),
        }
    }
}
