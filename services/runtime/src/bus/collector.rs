//! The recorder's end of a topic: delivers every message in order.

use std::marker::PhantomData;
use std::rc::Rc;

use shared_types::Message;

use crate::bus::format::read;
use crate::bus::gather::Gathering;
use crate::bus::port::Receiver;
use crate::context::Context;
use crate::wait::Interrupted;

/// Reads everything of a topic, in order; never waits. Of a topic whose type is not known, `[u8]`, messages are bytes that begin with a header.
pub struct Collector<M: ?Sized>(Gathering, PhantomData<fn(&M)>);

impl<M: ?Sized> Collector<M> {
    pub(crate) fn new(shared: Rc<Context>, receiver: Rc<Receiver>) -> Self {
        Self(Gathering::new(shared, receiver), PhantomData)
    }

    /// Continues where an earlier reader of the topic stopped.
    pub fn resume(&mut self, last: Option<u64>, lost: u64) {
        self.0.resume(last, lost);
    }

    /// After the messages of an earlier reader's files: takes in nothing more of their ticks, which the topic's history has too.
    pub fn go_on(&mut self) {
        self.0.go_on();
    }

    /// The last tick taken in.
    pub fn last(&self) -> Option<u64> {
        self.0.last()
    }

    /// Ticks that never came: gaps between the ticks that did, from tick 0.
    pub fn lost(&self) -> u64 {
        self.0.lost()
    }
}

impl<M: Message> Collector<M> {
    /// Hands over all messages that are there, oldest first.
    ///
    /// # Errors
    /// When iceoryx2 fails.
    pub fn collect(&mut self, mut take: impl FnMut(&M)) -> Result<(), Interrupted> {
        self.0.collect(&mut |message| {
            // Admitted messages are of the type's size.
            read(message, |message| take(message));
        })
    }
}

impl Collector<[u8]> {
    /// Hands over all messages that are there, oldest first, as their bytes.
    ///
    /// # Errors
    /// When iceoryx2 fails.
    pub fn collect(&mut self, mut take: impl FnMut(&[u8])) -> Result<(), Interrupted> {
        self.0.collect(&mut take)
    }
}
