//! The launcher's side of all topics.

use std::time::Duration;

use iceoryx2::prelude::*;
use shared_types::Topic;
use shared_types::topics::{self, Each, TOPICS, wire_hash};

use crate::bus::foreign;
use crate::bus::topic::{Bus, Keep, TopicError, create, join};
use crate::control_page::ControlPage;
use crate::manifest::Manifest;
use crate::run_dir::RunDir;

/// The launcher's side: makes every topic of the run, keeps the last messages of each, and clears away what a dead process left in them.
pub struct Hub {
    // Dropped in this order: the services first.
    keepers: Vec<Box<dyn Keep>>,
    node: Bus,
}

impl std::fmt::Debug for Hub {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Hub").finish_non_exhaustive()
    }
}

impl Hub {
    /// Makes all topics of the run.
    ///
    /// # Errors
    /// When the graph names a topic that has no message, or shared memory cannot be used.
    pub fn create(run: &RunDir, manifest: &Manifest) -> Result<Self, TopicError> {
        Self::create_speaking(run, manifest, wire_hash())
    }

    pub(crate) fn create_speaking(run: &RunDir, manifest: &Manifest, wire: u64) -> Result<Self, TopicError> {
        let node = join(run, "launcher", true)?;
        run.make_private().map_err(|e| TopicError::Node { run: run.name().to_owned(), reason: e.to_string() })?;
        let keepers = manifest.topics().into_iter().map(|topic| match manifest.message(topic) {
            Some(message) => foreign::create(&node, run, manifest.readers_of(topic), message),
            None => create_by_name(&node, run, topic, manifest.readers_of(topic), wire),
        });
        Ok(Self { keepers: keepers.collect::<Result<_, _>>()?, node })
    }

    /// Connects the keepers to writers that are new; one load per topic where there is none.
    ///
    /// # Errors
    /// When iceoryx2 fails.
    pub fn connect(&self) -> Result<(), TopicError> {
        self.keepers.iter().try_for_each(|keeper| keeper.connect())
    }

    /// Copies the messages that the keepers hold to the files from which a replacement of the recorder recalls them.
    ///
    /// # Errors
    /// When iceoryx2 fails.
    pub fn hand_over(&self) -> Result<(), TopicError> {
        self.keepers.iter().try_for_each(|keeper| keeper.hand_over())
    }

    /// Hands over where a process has requested it; whether one has.
    ///
    /// # Errors
    /// When iceoryx2 fails.
    pub fn answer(&self, control_page: &ControlPage) -> Result<bool, TopicError> {
        let Some(request) = control_page.requested_hand_over() else { return Ok(false) };
        self.hand_over()?;
        control_page.answer_hand_over(request);
        Ok(true)
    }

    /// Clears away what dead processes left, so that their replacements find room. Takes milliseconds.
    ///
    /// # Errors
    /// When something of a dead process cannot be cleared away.
    pub fn clear_dead(&self) -> Result<u64, TopicError> {
        let mut dead = Vec::new();
        let found = Node::<ipc::Service>::list(self.node.config(), |state| {
            if let NodeState::Dead(view) = state {
                dead.push(view);
            }
            CallbackProgression::Continue
        });
        found.map_err(|e| TopicError::Node { run: self.node.config().global.prefix.to_string(), reason: e.to_string() })?;
        // All that these have sent is delivered by now, and handed over before their ports go: a keeper has room for few dead writers. It is
        // handed over before a replacement can send, too: the files have the messages in the order in which they were sent.
        if let Err(error) = self.hand_over() {
            tracing::warn!("{error}");
        }
        let (cleared, failed): (Vec<_>, Vec<_>) =
            dead.into_iter().map(|view| view.blocking_remove_stale_resources(Duration::ZERO)).partition(Result::is_ok);
        match failed.len() {
            0 => Ok(cleared.len() as u64),
            failed => Err(TopicError::Node {
                run: self.node.config().global.prefix.to_string(),
                reason: format!("{failed} dead processes could not be cleared away"),
            }),
        }
    }
}

/// A topic's name decides its message.
fn create_by_name(node: &Bus, run: &RunDir, topic: &str, readers: usize, wire: u64) -> Result<Box<dyn Keep>, TopicError> {
    struct Create<'a>(&'a Bus, &'a RunDir, usize, u64);
    impl Each for Create<'_> {
        type Output = Result<Box<dyn Keep>, TopicError>;
        fn each<M: Topic>(&mut self) -> Self::Output {
            create::<M>(self.0, self.1, self.2, self.3)
        }
    }
    topics::named(topic, &mut Create(node, run, readers, wire))
        .unwrap_or_else(|| Err(TopicError::Unknown { topic: topic.to_owned(), known: TOPICS.join(", ") }))
}
