//! Topics as iceoryx2 services: the only place that knows how a message becomes a service.

use std::time::Duration;

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use iceoryx2::service::attribute::{AttributeKey, AttributeValue};
use iceoryx2::service::builder::publish_subscribe::Builder;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use shared_types::topics::{self, Each, TOPICS, wire_hash};
use shared_types::{Message, Topic};

use crate::bus::depth::depth;
use crate::control_page::ControlPage;
use crate::manifest::Manifest;
use crate::memory::HandedOver;
use crate::run_dir::{RunDir, SHM};

/// Samples that a reader holds at once: the one of the tick in hand, one that came before its time, and the next.
const MAX_BORROWED: usize = 4;
/// Readers beyond those that the graph names: the keeper, and two for tools that look at a topic from outside. A writer walks over all places
/// several times per message.
const MORE_READERS: usize = 3;
/// The living writer, and the dead one until it has been cleaned up.
const MAX_WRITERS: usize = 2;
/// Dead writers whose last messages a reader can still have to read.
const MAX_DEAD_WRITERS: usize = 8;
const WIRE_ATTRIBUTE: &str = "armplane.wire";

/// A message as iceoryx2 takes it: the same bytes under the message's own versioned type name.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub(crate) struct Wire<M>(pub(crate) M);

// SAFETY: `Message` is `Pod`: `repr(C)`, no pointer, no padding; the type name is versioned and unique per layout.
unsafe impl<M: Message> ZeroCopySend for Wire<M> {
    unsafe fn type_name() -> &'static str {
        M::TYPE_NAME
    }
}

/// Why a topic cannot be made or opened.
#[derive(Debug, thiserror::Error)]
pub enum TopicError {
    /// iceoryx2 has no place to put its files.
    #[error("cannot join the run {run} in shared memory: {reason}")]
    Node {
        /// The run's name.
        run: String,
        /// iceoryx2's own error.
        reason: String,
    },
    /// No message of that name.
    #[error("there is no topic {topic:?}; there are {known}")]
    Unknown {
        /// The name asked for.
        topic: String,
        /// The names there are.
        known: String,
    },
    /// The launcher did not make it, or it cannot be used.
    #[error("cannot {action} topic {topic:?}: {reason}")]
    Service {
        /// The operation.
        action: &'static str,
        /// Which topic.
        topic: &'static str,
        /// iceoryx2's own error.
        reason: String,
    },
    /// Two builds that disagree on the bytes.
    #[error(
        "topic {topic:?} was made with wire format {found}, this program speaks {ours:016x}: \
         start all processes from the same build of armplane"
    )]
    WireFormat {
        /// Which topic.
        topic: &'static str,
        /// The service's own error.
        found: String,
        /// This program's own value.
        ours: u64,
    },
    /// No room for what a replacement must find.
    #[error("cannot keep messages of topic {topic:?} for a replacement: {reason}")]
    Memory {
        /// Which topic.
        topic: &'static str,
        /// The operating system's error.
        reason: String,
    },
    /// The graph does not declare it.
    #[error("process {process:?} may not {action} topic {topic:?}: the graph does not say so")]
    Undeclared {
        /// The process.
        process: String,
        /// "read" or "write".
        action: &'static str,
        /// Which topic.
        topic: &'static str,
    },
}

fn config(run: &RunDir, is_launcher: bool) -> Result<Config, TopicError> {
    let unusable = |reason: String| TopicError::Node { run: run.name().to_owned(), reason };
    let path = run.path().to_str().unwrap_or(SHM);
    let mut config = Config::default();
    config.global.set_root_path(&Path::new(path.as_bytes()).map_err(|e| unusable(format!("{path}: {e:?}")))?);
    config.global.prefix = FileName::new(format!("{}.", run.name()).as_bytes()).map_err(|e| unusable(format!("{e:?}")))?;
    // Cleaning up after a dead process takes milliseconds: the launcher does it, never a process of the chain.
    config.global.node.cleanup_dead_nodes_on_creation = is_launcher;
    config.global.node.cleanup_dead_nodes_on_destruction = is_launcher;
    config.global.service.cleanup_dead_nodes_on_open = is_launcher;
    // Every look into an empty buffer walks over the places for connections to dead writers: 128 by default, a tenth of a hop.
    config.defaults.publish_subscribe.subscriber_expired_connection_buffer = MAX_DEAD_WRITERS;
    Ok(config)
}

/// One process's side of all topics.
pub(crate) type Bus = Node<ipc::Service>;

pub(crate) fn join(run: &RunDir, name: &str, is_launcher: bool) -> Result<Node<ipc::Service>, TopicError> {
    let unusable = |reason: String| TopicError::Node { run: run.name().to_owned(), reason };
    let node_name = NodeName::new(name).map_err(|e| unusable(format!("{name:?}: {e:?}")))?;
    NodeBuilder::new()
        .name(&node_name)
        .config(&config(run, is_launcher)?)
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create()
        .map_err(|e| unusable(e.to_string()))
}

fn failed<M: Message>(action: &'static str, reason: impl std::fmt::Display) -> TopicError {
    TopicError::Service { action, topic: M::TOPIC, reason: reason.to_string() }
}

fn service_name<M: Message>() -> Result<ServiceName, TopicError> {
    ServiceName::new(M::TOPIC).map_err(|e| failed::<M>("name", format!("{e:?}")))
}

fn builder<M: Message>(node: &Node<ipc::Service>) -> Result<Builder<Wire<M>, (), ipc::Service>, TopicError> {
    Ok(node
        .service_builder(&service_name::<M>()?)
        .publish_subscribe::<Wire<M>>()
        .enable_safe_overflow(true)
        .history_size(0)
        .subscriber_max_buffer_size(depth(size_of::<M>()))
        .subscriber_max_borrowed_samples(MAX_BORROWED)
        .max_publishers(MAX_WRITERS)
        .max_nodes(crate::manifest::MAX_PROCESSES + 4))
}

fn create<M: Message>(node: &Node<ipc::Service>, run: &RunDir, readers: usize, wire: u64) -> Result<Box<dyn Keep>, TopicError> {
    let key = AttributeKey::new(WIRE_ATTRIBUTE.as_bytes()).map_err(|e| failed::<M>("create", format!("{e:?}")))?;
    let value = AttributeValue::new(format!("{wire:016x}").as_bytes()).map_err(|e| failed::<M>("create", format!("{e:?}")))?;
    let attributes = AttributeSpecifier::new().define(&key, &value).map_err(|e| failed::<M>("create", e))?;
    let service = builder::<M>(node)?
        .max_subscribers(readers + MORE_READERS)
        .create_with_attributes(&attributes)
        .map_err(|e| failed::<M>("create", e))?;
    // The first of all subscribers: a message is in the keeper's buffer before any other reader has it.
    let subscriber = service.subscriber_builder().buffer_size(depth(size_of::<M>())).create().map_err(|e| failed::<M>("keep", e))?;
    let handed_over = HandedOver::open(run).map_err(|error| TopicError::Memory { topic: M::TOPIC, reason: error.to_string() })?;
    Ok(Box::new(Keeper::<M> { subscriber, handed_over, _service: service }))
}

/// One more reader of a topic, in the launcher, that reads nothing: the last [`depth`] messages stay in shared memory, without a copy, whatever
/// process of the run dies.
///
/// When a reader of everything is replaced, what the keeper holds is copied to the file from which the replacement recalls it.
struct Keeper<M: Message> {
    subscriber: Subscribing<M>,
    handed_over: HandedOver<M>,
    _service: PortFactory<ipc::Service, Wire<M>, ()>,
}

trait Keep {
    /// Connects to writers that are new: what a dead one has sent outlives the clearing away of its ports only in connected readers.
    fn connect(&self) -> Result<(), TopicError>;
    /// Copies all that is there to the file, oldest first.
    fn hand_over(&self) -> Result<(), TopicError>;
}

impl<M: Message> Keep for Keeper<M> {
    fn connect(&self) -> Result<(), TopicError> {
        self.subscriber.update_connections().map_err(|e| failed::<M>("keep", e))
    }

    fn hand_over(&self) -> Result<(), TopicError> {
        while let Some(sample) = self.subscriber.receive().map_err(|e| failed::<M>("keep", e))? {
            self.handed_over.push(&sample.payload().0);
        }
        Ok(())
    }
}

/// Opens a topic that the launcher made, after comparing the wire formats.
fn open<M: Message>(node: &Node<ipc::Service>) -> Result<PortFactory<ipc::Service, Wire<M>, ()>, TopicError> {
    let key = AttributeKey::new(WIRE_ATTRIBUTE.as_bytes()).map_err(|e| failed::<M>("open", format!("{e:?}")))?;
    // Before opening: iceoryx2 itself would only say "incompatible", and only if a size changed.
    let details = ipc::Service::details(&service_name::<M>()?, node.config(), MessagingPattern::PublishSubscribe)
        .map_err(|e| failed::<M>("open", e))?
        .ok_or_else(|| failed::<M>("open", "the launcher has not made it"))?;
    let found = details.static_details.attributes().key_value(&key, 0).map(ToString::to_string).unwrap_or_default();
    let ours = wire_hash();
    if found != format!("{ours:016x}") {
        let found = if found.is_empty() { "unknown".into() } else { found };
        return Err(TopicError::WireFormat { topic: M::TOPIC, found, ours });
    }
    builder::<M>(node)?.open().map_err(|e| failed::<M>("open", e))
}

pub(crate) type Publishing<M> = Publisher<ipc::Service, Wire<M>, ()>;
pub(crate) type Subscribing<M> = Subscriber<ipc::Service, Wire<M>, ()>;

pub(crate) fn publisher<M: Message>(node: &Node<ipc::Service>) -> Result<Publishing<M>, TopicError> {
    open::<M>(node)?
        .publisher_builder()
        .max_loaned_samples(1)
        .backpressure_strategy(BackpressureStrategy::DiscardData)
        .create()
        .map_err(|e| failed::<M>("write", e))
}

pub(crate) fn subscriber<M: Message>(node: &Node<ipc::Service>, depth: usize) -> Result<Subscribing<M>, TopicError> {
    let most = crate::bus::depth::depth(size_of::<M>());
    open::<M>(node)?.subscriber_builder().buffer_size(depth.min(most)).create().map_err(|e| failed::<M>("read", e))
}

/// The launcher's side: makes every topic of the run, keeps the last messages of each, and clears away what a dead process left in them.
pub struct Hub {
    // Dropped in this order: the services first.
    keepers: Vec<Box<dyn Keep>>,
    node: Node<ipc::Service>,
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
        let keepers = manifest.topics().into_iter().map(|topic| create_by_name(&node, run, topic, manifest.readers_of(topic), wire));
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
fn create_by_name(node: &Node<ipc::Service>, run: &RunDir, topic: &str, readers: usize, wire: u64) -> Result<Box<dyn Keep>, TopicError> {
    struct Create<'a>(&'a Node<ipc::Service>, &'a RunDir, usize, u64);
    impl Each for Create<'_> {
        type Output = Result<Box<dyn Keep>, TopicError>;
        fn each<M: Topic>(&mut self) -> Self::Output {
            create::<M>(self.0, self.1, self.2, self.3)
        }
    }
    topics::named(topic, &mut Create(node, run, readers, wire))
        .unwrap_or_else(|| Err(TopicError::Unknown { topic: topic.to_owned(), known: TOPICS.join(", ") }))
}
