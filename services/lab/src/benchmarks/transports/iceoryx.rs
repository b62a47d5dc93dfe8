//! Baseline transport: iceoryx2's publish-subscribe bare, with each way to wake a reader: what a topic is made of, without its checks.
//!
//! Beside `runtime` this is the only module that uses iceoryx2's ports: it measures them bare.

use std::fmt::Display;

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;
use iceoryx2::service::port_factory::publish_subscribe::PortFactory;
use runtime::{DoorbellPort, ProcessError, Shell};

/// How the reader learns of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wake {
    /// By the doorbell of the runtime: a futex on the control page.
    Doorbell,
    /// By iceoryx2's event service, waited for at its listener.
    Listener,
    /// By the same, waited for in a wait set.
    WaitSet,
    /// Not at all: it looks until there is one.
    Poll,
}

type Ipc = ipc::Service;

/// One process's ends of a ring of processes: it reads the payloads of the process before it, bytes aligned to 8.
pub(crate) struct Iceoryx {
    doorbell: DoorbellPort,
    publisher: Publisher<Ipc, [u8], ()>,
    subscriber: Subscriber<Ipc, [u8], ()>,
    /// Of a payload that is sent.
    bytes: usize,
    notifier: Notifier<Ipc>,
    listener: &'static Listener<Ipc>,
    waitset: &'static WaitSet<Ipc>,
    /// Keeps the listener in the wait set.
    _attached: WaitSetGuard<'static, 'static, Ipc>,
    /// Place in the manifest of the process that reads ours.
    to: usize,
}

impl Iceoryx {
    /// Opens the ends of process `me`, which reads from `from` and writes payloads of so many bytes to `to`; all are places in the manifest.
    ///
    /// # Errors
    /// [`ProcessError`] when iceoryx2 refuses.
    pub(crate) fn open(
        shell: &Shell,
        [from, me, to]: [usize; 3],
        bytes: usize,
    ) -> Result<Self, ProcessError> {
        let doorbell = DoorbellPort::of(shell);
        let publisher = {
            let service = data(&doorbell, me)?;
            service
                .publisher_builder()
                .max_loaned_samples(1)
                .initial_max_slice_len(bytes)
                .create()
                .map_err(refused)?
        };
        let subscriber = data(&doorbell, from)?
            .subscriber_builder()
            .create()
            .map_err(refused)?;
        let events = |writer: usize| {
            let builder = doorbell
                .node()
                .service_builder(&name("event", writer)?)
                .event();
            builder
                .event_id_max_value(7)
                .open_or_create()
                .map_err(refused)
        };
        let notifier = events(me)?.notifier_builder().create().map_err(refused)?;
        // A wait set borrows its attachments; both last as long as the process, and their files go with the run.
        let listener: &'static _ = Box::leak(Box::new(
            events(from)?.listener_builder().create().map_err(refused)?,
        ));
        let waitset = WaitSetBuilder::new()
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<Ipc>()
            .map_err(refused)?;
        let waitset: &'static _ = Box::leak(Box::new(waitset));
        let attached = waitset.attach_notification(listener).map_err(refused)?;
        Ok(Self {
            doorbell,
            publisher,
            subscriber,
            bytes,
            notifier,
            listener,
            waitset,
            _attached: attached,
            to,
        })
    }

    /// Loans a sample, lets `fill` write it in place, sends it and wakes its reader.
    ///
    /// # Errors
    /// [`ProcessError`] when iceoryx2 fails.
    pub(crate) fn send(
        &mut self,
        wake: Wake,
        fill: impl FnOnce(&mut [u8]),
    ) -> Result<(), ProcessError> {
        let sample = self
            .publisher
            .loan_slice_uninit(self.bytes)
            .map_err(refused)?;
        // SAFETY: the memory is a mapped file, whose bytes are those of an earlier payload or zero.
        let mut sample = unsafe { sample.assume_init() };
        fill(sample.payload_mut());
        sample.send().map_err(refused)?;
        match wake {
            Wake::Doorbell => self.doorbell.ring(self.to),
            Wake::Listener | Wake::WaitSet => {
                self.notifier.notify().map_err(refused)?;
            }
            Wake::Poll => {}
        }
        Ok(())
    }

    /// Waits for a sample and lends it to `read`.
    ///
    /// # Errors
    /// [`ProcessError`] when iceoryx2 fails, nothing comes within the run's limit (a doorbell), or the run stops.
    pub(crate) fn receive<R>(
        &mut self,
        wake: Wake,
        read: impl FnOnce(&[u8]) -> R,
    ) -> Result<R, ProcessError> {
        let stopped = || ProcessError::setup("stopped before the end");
        if wake == Wake::Doorbell {
            let sample = self
                .doorbell
                .wait(|| self.subscriber.receive())?
                .ok_or_else(stopped)?;
            return Ok(read(&sample));
        }
        loop {
            if let Some(sample) = self.subscriber.receive().map_err(refused)? {
                return Ok(read(&sample));
            }
            match wake {
                Wake::Listener => {
                    self.listener.blocking_wait(|_| ()).map_err(refused)?;
                }
                Wake::WaitSet => {
                    let take = |_| {
                        // A notification means that a sample is in the buffer: the loop looks there.
                        let _ = self.listener.try_wait(|_| ());
                        CallbackProgression::Continue
                    };
                    self.waitset.wait_and_process_once(take).map_err(refused)?;
                }
                Wake::Doorbell | Wake::Poll => std::hint::spin_loop(),
            }
            if self.doorbell.is_stopping() {
                return Err(stopped());
            }
        }
    }
}

fn name(what: &str, writer: usize) -> Result<ServiceName, ProcessError> {
    ServiceName::new(&format!("bare-{what}-{writer}")).map_err(refused)
}

/// The service on which a process writes. One reader holds one sample: large payloads take no more memory than they must.
fn data(
    doorbell: &DoorbellPort,
    writer: usize,
) -> Result<PortFactory<Ipc, [u8], ()>, ProcessError> {
    let aligned = Alignment::new(align_of::<u64>()).ok_or_else(|| refused("the alignment"))?;
    let builder = doorbell
        .node()
        .service_builder(&name("data", writer)?)
        .publish_subscribe::<[u8]>()
        .payload_alignment(aligned);
    let builder = builder
        .max_publishers(1)
        .max_subscribers(1)
        .subscriber_max_borrowed_samples(1);
    builder
        .history_size(0)
        .subscriber_max_buffer_size(2)
        .open_or_create()
        .map_err(refused)
}

fn refused(error: impl Display) -> ProcessError {
    ProcessError::setup(format!("iceoryx2 refuses: {error}"))
}
