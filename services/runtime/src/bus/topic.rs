//! Topics as iceoryx2 services; only this file knows how a message becomes a service.

use iceoryx2::prelude::*;
use iceoryx2::service::attribute::{AttributeKey, AttributeValue};
use iceoryx2::service::builder::publish_subscribe::Builder;
use iceoryx2::service::port_factory::PortFactory as _;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use iceoryx2::service::static_config::message_type_details::{TypeDetail, TypeVariant};
use shared_types::process::MAX_PROCESSES;

use crate::bus::depth::depth;
use crate::bus::error::TopicError;
use crate::bus::format::Format;
use crate::bus::node::Bus;
use crate::bus::port::{Bytes, NoHeader, Receiver, Sender};

/// Samples that a reader holds at once: the one of the tick in hand, one that came before its time, and the next.
const MAX_BORROWED: usize = 4;
/// Readers beyond those that the graph names: two for tools that look at a topic from outside. A writer walks over all places
/// several times per message.
const MORE_READERS: usize = 2;
/// The living writer, and the dead one until it has been cleaned up.
const MAX_WRITERS: usize = 2;
const WIRE_ATTRIBUTE: &str = "armplane.wire";

/// A topic of the run, made by the launcher and opened by the processes that the graph names.
pub(crate) struct Topic {
    format: Format,
    service: PortFactory<ipc::Service, Bytes, NoHeader>,
}

impl Topic {
    /// Makes the topic for so many readers of the graph; it is marked with the hash of its layout. With a history, a reader that comes late gets the last
    /// messages too.
    pub(crate) fn create(
        bus: &Bus,
        format: Format,
        readers: usize,
        has_history: bool,
    ) -> Result<Self, TopicError> {
        let attribute = |reason: String| failed("create", &format, reason);
        let value = AttributeValue::new(format!("{:016x}", format.layout).as_bytes())
            .map_err(|e| attribute(format!("{e:?}")))?;
        let attributes = AttributeSpecifier::new()
            .define(&wire_attribute(&format)?, &value)
            .map_err(|e| attribute(e.to_string()))?;
        let service = builder(bus, &format)?
            .max_subscribers(readers + MORE_READERS)
            .history_size(if has_history { depth(format.bytes) } else { 0 })
            .create_with_attributes(&attributes);
        Ok(Self {
            format,
            service: service.map_err(|e| failed("create", &format, e))?,
        })
    }

    /// Opens a topic that the launcher made, and compares the layouts.
    pub(crate) fn open(bus: &Bus, format: Format) -> Result<Self, TopicError> {
        match builder(bus, &format)?.open() {
            Ok(service) => {
                layout_fits(service.attributes(), &format)?;
                Ok(Self { format, service })
            }
            Err(error) => {
                // iceoryx2 itself only says "incompatible". Its details of a service tell more, and cost a look at every process that has it open.
                let details = ipc::Service::details(
                    &service_name(&format)?,
                    bus.config(),
                    MessagingPattern::PublishSubscribe,
                )
                .map_err(|e| failed("open", &format, e))?
                .ok_or_else(|| failed("open", &format, "the launcher has not made it"))?;
                layout_fits(details.static_details.attributes(), &format)?;
                Err(failed("open", &format, error))
            }
        }
    }

    /// The end that writes.
    pub(crate) fn sender(&self) -> Result<Sender, TopicError> {
        let publisher = self
            .service
            .publisher_builder()
            .max_loaned_samples(1)
            .backpressure_strategy(BackpressureStrategy::DiscardData);
        let publisher = publisher.create();
        Ok(Sender {
            format: self.format,
            publisher: publisher.map_err(|e| failed("write", &self.format, e))?,
        })
    }

    /// An end that reads, with room for so many messages, or for as many as the topic holds.
    pub(crate) fn receiver(&self, most: usize) -> Result<Receiver, TopicError> {
        let subscriber = self
            .service
            .subscriber_builder()
            .buffer_size(most.min(depth(self.format.bytes)));
        let subscriber = subscriber.create();
        Ok(Receiver {
            format: self.format,
            subscriber: subscriber.map_err(|e| failed("read", &self.format, e))?,
        })
    }
}

/// Whether a topic is marked with the hash of the layout that is expected here.
fn layout_fits(attributes: &AttributeSet, format: &Format) -> Result<(), TopicError> {
    let found = attributes
        .key_value(&wire_attribute(format)?, 0)
        .map(ToString::to_string)
        .unwrap_or_default();
    let Format {
        topic,
        type_name,
        layout: ours,
        ..
    } = *format;
    if found == format!("{ours:016x}") {
        return Ok(());
    }
    let found = if found.is_empty() {
        "unknown".into()
    } else {
        found
    };
    Err(match format.is_listed() {
        true => TopicError::WireFormat { topic, found, ours },
        false => TopicError::Layout {
            topic,
            type_name,
            found,
            ours,
        },
    })
}

fn failed(action: &'static str, format: &Format, reason: impl std::fmt::Display) -> TopicError {
    TopicError::Service {
        action,
        topic: format.topic,
        reason: reason.to_string(),
    }
}

fn service_name(format: &Format) -> Result<ServiceName, TopicError> {
    ServiceName::new(format.topic).map_err(|e| failed("name", format, format!("{e:?}")))
}

fn wire_attribute(format: &Format) -> Result<AttributeKey, TopicError> {
    AttributeKey::new(WIRE_ATTRIBUTE.as_bytes())
        .map_err(|e| failed("open", format, format!("{e:?}")))
}

/// The service of a topic, with the settings of every topic.
///
/// Its payload is described as iceoryx2's bindings for other languages describe theirs, so that the ports are compiled once for all messages, and
/// a program that knows the type opens it with that type.
fn builder(
    bus: &Bus,
    format: &Format,
) -> Result<Builder<Bytes, NoHeader, ipc::Service>, TopicError> {
    let unusable = |e: &dyn std::fmt::Debug| failed("name", format, format!("{e:?}"));
    let payload = TypeDetail::__internal_new_from_parts(
        TypeVariant::FixedSize,
        format.type_name,
        format.bytes,
        align_of::<u64>(),
    );
    let payload = payload.map_err(|e| unusable(&e))?;
    let header = TypeDetail::new::<()>(TypeVariant::FixedSize);
    let builder = bus
        .service_builder(&service_name(format)?)
        .publish_subscribe::<Bytes>()
        .user_header::<NoHeader>();
    // SAFETY: a message is `format.bytes` plain bytes, of any value, and a header of no bytes is that of any program without one.
    let builder = unsafe {
        builder
            .__internal_set_payload_type_details(&payload)
            .__internal_set_user_header_type_details(&header)
    };
    Ok(builder
        .enable_safe_overflow(true)
        .history_size(0)
        .subscriber_max_buffer_size(depth(format.bytes))
        .subscriber_max_borrowed_samples(MAX_BORROWED)
        .max_publishers(MAX_WRITERS)
        .max_nodes(MAX_PROCESSES + 4))
}
