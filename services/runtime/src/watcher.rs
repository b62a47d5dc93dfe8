//! A reader of topics from outside the graph: nobody waits for it, and its death costs nothing.

use std::path::Path;

use process::Port;
use shared_types::topics::OfTopic;

use crate::bus::depth::RECORDER_DEPTH;
use crate::bus::error::TopicError;
use crate::bus::format::Format;
use crate::bus::node::{Bus, join};
use crate::bus::port::Receiver;
use crate::bus::topic::Topic;
use crate::run_dir::RunDir;
use crate::shell::ProcessError;

/// Reads what comes on the topics of a run, and misses what comes too fast.
pub struct Watcher {
    /// The topic's place in the list, and its messages.
    receivers: Vec<(usize, Receiver)>,
    _bus: Bus,
}

impl Watcher {
    /// Joins a run whose launcher has made the topics; `reads` says which of them.
    ///
    /// # Errors
    /// When the run has no such topic, or not yet.
    pub fn open(
        run: &Path,
        name: &str,
        reads: impl Fn(&str) -> bool,
    ) -> Result<Self, ProcessError> {
        let bus = join(&RunDir::open(run)?, name, false)?;
        let ports = Port::all().into_iter().enumerate();
        let read = ports.filter(|(_, port)| reads(port.topic));
        let receivers = read.map(|(place, port)| -> Result<_, TopicError> {
            let format = Format::of_port(&port);
            Ok((place, Topic::open(&bus, format)?.receiver(RECORDER_DEPTH)?))
        });
        Ok(Self {
            receivers: receivers.collect::<Result<_, _>>()?,
            _bus: bus,
        })
    }

    /// Hands over all messages that are there: the place of their topic in the list, and their bytes. Those of a writer that has just died may be missing.
    pub fn collect(&self, mut take: impl FnMut(usize, &[u8])) {
        for (place, receiver) in &self.receivers {
            while let Ok(Some(message)) = receiver.receive() {
                take(*place, &message);
            }
        }
    }
}
