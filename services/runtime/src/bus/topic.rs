//! Topics as iceoryx2 services: the only place that knows how a message becomes a service.

use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::*;
use iceoryx2::service::attribute::{AttributeKey, AttributeValue};
use iceoryx2::service::builder::publish_subscribe::Builder;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use shared_types::Message;
use shared_types::process::MAX_PROCESSES;
use shared_types::topics::{TOPICS, wire_hash};

use crate::bus::depth::depth;
use crate::memory::HandedOver;
use crate::run_dir::{RunDir, SHM};

/// Samples that a reader holds at once: the one of the tick in hand, one that came before its time, and the next.
const MAX_BORROWED: usize = 4;
/// Readers beyond those that the graph names: the keeper, and two for tools that look at a topic from outside. A writer walks over all places
/// several times per message.
pub(crate) const MORE_READERS: usize = 3;
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
    /// A graph and a process that disagree on the bytes of a message of their own.
    #[error(
        "topic {topic:?} is declared in the graph with the layout {found}, this program sends {type_name} with the layout {ours:016x}: \
         write the same type name and fields in both"
    )]
    Layout {
        /// Which topic.
        topic: &'static str,
        /// The type of this program.
        type_name: &'static str,
        /// The hash of the layout in the graph.
        found: String,
        /// The hash of the layout in this program.
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
    Ok(settings(node.service_builder(&service_name::<M>()?).publish_subscribe::<Wire<M>>(), size_of::<M>()))
}

/// The settings of every topic, for messages of a size.
pub(crate) fn settings<P, S>(builder: Builder<P, (), S>, bytes: usize) -> Builder<P, (), S>
where
    P: std::fmt::Debug + IceoryxSend + ?Sized,
    S: Service,
{
    builder
        .enable_safe_overflow(true)
        .history_size(0)
        .subscriber_max_buffer_size(depth(bytes))
        .subscriber_max_borrowed_samples(MAX_BORROWED)
        .max_publishers(MAX_WRITERS)
        .max_nodes(MAX_PROCESSES + 4)
}

/// The attributes of a topic: the wire format of its messages.
pub(crate) fn create_attributes(topic: &'static str, wire: u64) -> Result<AttributeSpecifier, TopicError> {
    let failed = |reason: String| TopicError::Service { action: "create", topic, reason };
    let key = AttributeKey::new(WIRE_ATTRIBUTE.as_bytes()).map_err(|e| failed(format!("{e:?}")))?;
    let value = AttributeValue::new(format!("{wire:016x}").as_bytes()).map_err(|e| failed(format!("{e:?}")))?;
    AttributeSpecifier::new().define(&key, &value).map_err(|e| failed(e.to_string()))
}

/// Makes a topic for so many readers of the graph, and its keeper.
pub(crate) fn create<M: Message>(node: &Node<ipc::Service>, run: &RunDir, readers: usize, wire: u64) -> Result<Box<dyn Keep>, TopicError> {
    let attributes = create_attributes(M::TOPIC, wire)?;
    let service = builder::<M>(node)?
        .max_subscribers(readers + MORE_READERS)
        .create_with_attributes(&attributes)
        .map_err(|e| failed::<M>("create", e))?;
    // The first of all subscribers: a message is in the keeper's buffer before any other reader has it.
    let subscriber = service.subscriber_builder().buffer_size(depth(size_of::<M>())).create().map_err(|e| failed::<M>("keep", e))?;
    let handed_over = HandedOver::open(run, M::TOPIC, size_of::<M>())
        .map_err(|error| TopicError::Memory { topic: M::TOPIC, reason: error.to_string() })?;
    Ok(Box::new(Keeper::<M> { subscriber, handed_over, _service: service }))
}

/// One more reader of a topic, in the launcher, that reads nothing: the last [`depth`] messages stay in shared memory, without a copy, whatever
/// process of the run dies.
///
/// When a reader of everything is replaced, what the keeper holds is copied to the file from which the replacement recalls it.
struct Keeper<M: Message> {
    subscriber: Subscribing<M>,
    handed_over: HandedOver,
    _service: PortFactory<ipc::Service, Wire<M>, ()>,
}

pub(crate) trait Keep {
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
            self.handed_over.push(bytemuck::bytes_of(&sample.payload().0));
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
    let is_listed = TOPICS.contains(&M::TOPIC);
    let ours = if is_listed { wire_hash() } else { M::layout_hash() };
    if found != format!("{ours:016x}") {
        let found = if found.is_empty() { "unknown".into() } else { found };
        let (topic, type_name) = (M::TOPIC, M::TYPE_NAME);
        return Err(if is_listed {
            TopicError::WireFormat { topic, found, ours }
        } else {
            TopicError::Layout { topic, type_name, found, ours }
        });
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
