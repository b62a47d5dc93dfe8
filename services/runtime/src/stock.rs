//! iceoryx2's publish-subscribe with each way to wake a reader, for `armplane bench`: what topics are made of, and what they leave out.

use std::fmt::Display;
use std::rc::Rc;

use bytemuck::{Pod, Zeroable};
use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::Publisher;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::*;

use crate::shell::{ProcessError, Shared, Shell, Wait, Waited};

/// A message of `N` 64-bit words and nothing else.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(transparent)]
pub struct Block<const N: usize>(pub [u64; N]);

// SAFETY: plain words without pointers.
unsafe impl<const N: usize> ZeroCopySend for Block<N> {}

/// How the reader learns of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Notice {
    /// By our doorbell: a futex on the control_page.
    Doorbell,
    /// By iceoryx2's event service, waited for at its listener.
    Listener,
    /// By the same, waited for in a wait set.
    WaitSet,
    /// Not at all: it looks until there is one.
    Poll,
}

/// The doorbell's bit: above those of topics, below those of the control_page.
const BIT: u32 = 1 << 29;

type Ipc = ipc::Service;

/// One process's ends of a ring of processes: it reads what the one before it writes.
pub struct Stock<const N: usize> {
    shared: Rc<Shared>,
    publisher: Publisher<Ipc, Block<N>, ()>,
    subscriber: Subscriber<Ipc, Block<N>, ()>,
    notifier: Notifier<Ipc>,
    listener: &'static Listener<Ipc>,
    waitset: &'static WaitSet<Ipc>,
    /// Keeps the listener in the wait set.
    _attached: WaitSetGuard<'static, 'static, Ipc>,
    /// The line on the control page of the process that reads ours.
    to: usize,
    /// The block received last.
    current: Block<N>,
}

impl<const N: usize> Stock<N> {
    /// Opens the ends of process `me`, which reads from `from` and writes to `to`; all are places in the manifest.
    ///
    /// # Errors
    /// When iceoryx2 refuses.
    pub fn open(shell: &Shell, from: usize, me: usize, to: usize) -> Result<Self, ProcessError> {
        let shared = shell.shared();
        let name = |what: &str, writer: usize| ServiceName::new(&format!("{what}-{N}-{writer}")).map_err(refused);
        let data = |writer: usize| {
            let builder = shared.node.service_builder(&name("block", writer)?).publish_subscribe::<Block<N>>();
            builder.history_size(0).subscriber_max_buffer_size(2).open_or_create().map_err(refused)
        };
        let events = |writer: usize| {
            let builder = shared.node.service_builder(&name("event", writer)?).event();
            builder.event_id_max_value(7).open_or_create().map_err(refused)
        };
        let publisher = data(me)?.publisher_builder().max_loaned_samples(1).create().map_err(refused)?;
        let subscriber = data(from)?.subscriber_builder().create().map_err(refused)?;
        let notifier = events(me)?.notifier_builder().create().map_err(refused)?;
        // A wait set borrows what is attached to it; both live as long as the process, and what they leave goes with the run.
        let listener: &'static _ = Box::leak(Box::new(events(from)?.listener_builder().create().map_err(refused)?));
        let waitset = WaitSetBuilder::new().signal_handling_mode(SignalHandlingMode::Disabled).create::<Ipc>().map_err(refused)?;
        let waitset: &'static _ = Box::leak(Box::new(waitset));
        let attached = waitset.attach_notification(listener).map_err(refused)?;
        Ok(Self { shared, publisher, subscriber, notifier, listener, waitset, _attached: attached, to, current: Block::zeroed() })
    }

    /// Sends a block and wakes its reader.
    ///
    /// # Errors
    /// When iceoryx2 fails.
    pub fn send(&mut self, notice: Notice, block: &Block<N>) -> Result<(), ProcessError> {
        self.publisher.loan_uninit().map_err(refused)?.write_payload(*block).send().map_err(refused)?;
        match notice {
            Notice::Doorbell => self.shared.control_page.process(self.to).bell().ring(BIT),
            Notice::Listener | Notice::WaitSet => {
                self.notifier.notify().map_err(refused)?;
            }
            Notice::Poll => {}
        }
        Ok(())
    }

    /// Waits for a block and copies it out, once.
    ///
    /// # Errors
    /// When iceoryx2 fails, or nothing comes within the run's limit (a doorbell), or the run stops.
    pub fn receive(&mut self, notice: Notice) -> Result<&Block<N>, ProcessError> {
        if notice == Notice::Doorbell {
            let describe = || Wait { what: "a block".to_owned(), from: "the process before".to_owned() };
            let look = || match self.subscriber.receive() {
                Ok(sample) => Ok(sample.map(|sample| self.current = *sample)),
                Err(error) => Err(self.shared.port_failed("block", error)),
            };
            return match self.shared.wait(BIT, None, describe, look)? {
                Waited::Ready(()) => Ok(&self.current),
                Waited::Late | Waited::Stopped => Err(ProcessError::setup("stopped before the end")),
            };
        }
        loop {
            if let Some(sample) = self.subscriber.receive().map_err(refused)? {
                self.current = *sample;
                return Ok(&self.current);
            }
            match notice {
                Notice::Listener => {
                    self.listener.blocking_wait(|_| ()).map_err(refused)?;
                }
                Notice::WaitSet => {
                    let take = |_| {
                        // What has been notified is in the buffer: the loop looks there.
                        let _ = self.listener.try_wait(|_| ());
                        CallbackProgression::Continue
                    };
                    self.waitset.wait_and_process_once(take).map_err(refused)?;
                }
                Notice::Doorbell | Notice::Poll => std::hint::spin_loop(),
            }
            if self.shared.is_stopping() {
                return Err(ProcessError::setup("stopped before the end"));
            }
        }
    }
}

fn refused(error: impl Display) -> ProcessError {
    ProcessError::setup(format!("iceoryx2 refuses: {error}"))
}
