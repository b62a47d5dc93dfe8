//! Topics as iceoryx2 services: the only place that knows how a message becomes a service.

use std::any::Any;

use iceoryx2::node::CleanupState;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::attribute::{AttributeKey, AttributeValue};
use iceoryx2::service::builder::publish_subscribe::Builder;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use shared_types::topics::{self, Each, TOPICS, wire_hash};
use shared_types::{Message, Topic};

use crate::manifest::Manifest;
use crate::run_dir::{RunDir, SHM};

/// Messages a reader of the chain can leave unread before the oldest is overwritten.
pub const CHAIN_DEPTH: usize = 64;
/// Messages the recorder can leave unread before the oldest is overwritten.
pub const RECORDER_DEPTH: usize = 1024;

/// Samples that a reader holds at once: the one of the tick in hand, one that came before its time, and the next.
const MAX_BORROWED: usize = 4;
const MAX_READERS: usize = 8;
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
        /// What iceoryx2 says.
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
        /// What was tried.
        action: &'static str,
        /// Which topic.
        topic: &'static str,
        /// What iceoryx2 says.
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
        /// What the service says.
        found: String,
        /// What this program was built with.
        ours: u64,
    },
    /// No room for the last message.
    #[error("cannot keep the last message of topic {topic:?} for a replacement: {reason}")]
    Memory {
        /// Which topic.
        topic: &'static str,
        /// What the operating system says.
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
        .subscriber_max_buffer_size(RECORDER_DEPTH)
        .subscriber_max_borrowed_samples(MAX_BORROWED)
        .max_subscribers(MAX_READERS)
        .max_publishers(MAX_WRITERS)
        .max_nodes(crate::manifest::MAX_PROCESSES + 4))
}

fn create<M: Message>(node: &Node<ipc::Service>, wire: u64) -> Result<Box<dyn Any>, TopicError> {
    let key = AttributeKey::new(WIRE_ATTRIBUTE.as_bytes()).map_err(|e| failed::<M>("create", format!("{e:?}")))?;
    let value = AttributeValue::new(format!("{wire:016x}").as_bytes()).map_err(|e| failed::<M>("create", format!("{e:?}")))?;
    let attributes = AttributeSpecifier::new().define(&key, &value).map_err(|e| failed::<M>("create", e))?;
    let service = builder::<M>(node)?.create_with_attributes(&attributes).map_err(|e| failed::<M>("create", e))?;
    Ok(Box::new(service))
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
    open::<M>(node)?.subscriber_builder().buffer_size(depth).create().map_err(|e| failed::<M>("read", e))
}

/// The launcher's side: makes every topic of the run and keeps them, and clears away what a dead process left in them.
pub struct Hub {
    // Dropped in this order: the services first.
    _services: Vec<Box<dyn Any>>,
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
        let services = manifest.topics().into_iter().map(|topic| create_by_name(&node, topic, wire));
        Ok(Self { _services: services.collect::<Result<_, _>>()?, node })
    }

    /// Clears away what dead processes left, so that their replacements find room. Takes milliseconds.
    ///
    /// # Errors
    /// When something of a dead process cannot be cleared away.
    pub fn clear_dead(&self) -> Result<u64, TopicError> {
        let CleanupState { cleanups, failed_cleanups, .. } = self.node.try_cleanup_dead_nodes();
        match failed_cleanups {
            0 => Ok(cleanups),
            failed => Err(TopicError::Node {
                run: self.node.config().global.prefix.to_string(),
                reason: format!("{failed} dead processes could not be cleared away"),
            }),
        }
    }
}

/// A topic's name decides its message.
fn create_by_name(node: &Node<ipc::Service>, topic: &str, wire: u64) -> Result<Box<dyn Any>, TopicError> {
    struct Create<'a>(&'a Node<ipc::Service>, u64);
    impl Each for Create<'_> {
        type Output = Result<Box<dyn Any>, TopicError>;
        fn each<M: Topic>(&mut self) -> Self::Output {
            create::<M>(self.0, self.1)
        }
    }
    topics::named(topic, &mut Create(node, wire))
        .unwrap_or_else(|| Err(TopicError::Unknown { topic: topic.to_owned(), known: TOPICS.join(", ") }))
}
