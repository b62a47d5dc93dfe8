//! The topics of an exchange page: copies each message between shared memory and the page.

use std::collections::VecDeque;
use std::marker::PhantomData;

use bytemuck::bytes_of;
use runtime::{Collector, Interrupted, ProcessError, Reader, Shell, Writer};
use shared_types::topics::{self, Each, Topic};

use crate::page::Page;
use crate::reply::Draft;

/// A topic that the process reads, tick by tick.
pub(crate) trait Input {
    /// Puts the next message on the page; its tick, `None` when the run stops.
    fn next(&mut self, page: &Page) -> Result<Option<u64>, Interrupted>;
    /// Puts the message of a tick on the page; `false` when it will not come.
    fn at(&mut self, page: &Page, tick: u64) -> Result<bool, Interrupted>;
    /// Puts the newest message that arrives in a tick on the page; `false` when none does.
    fn arriving(
        &mut self,
        page: &Page,
        tick: u64,
        deadline_ns: Option<u64>,
    ) -> Result<bool, Interrupted>;
}

/// A topic that the process writes.
pub(crate) trait Output {
    /// The name, and the first field of the message on the page that holds a number that is not finite.
    fn not_finite(&mut self, page: &Page) -> Option<(&'static str, String)>;
    /// Sends the message on the page that [`Output::not_finite`] has seen last.
    fn send(&mut self, tick: u64) -> Result<(), ProcessError>;
}

/// A topic of which an observer takes in every message.
pub(crate) trait Gathered {
    /// Takes in the messages that have arrived.
    fn collect(&mut self) -> Result<(), Interrupted>;
    /// The tick of the oldest message not yet shown, and how many wait.
    fn oldest(&self) -> Option<(u64, usize)>;
    /// Puts the oldest message on the page, if it belongs to this tick.
    fn show(&mut self, page: &Page, tick: u64);
}

/// Puts a message on the page, if there is one. Returns whether there was.
fn show<M: Topic>(page: &Page, place: usize, message: Option<&M>) -> bool {
    message
        .iter()
        .for_each(|message| page.put(place, bytes_of(*message)));
    page.mark_fresh(place, message.is_some());
    message.is_some()
}

struct Reading<M: Topic> {
    reader: Reader<M>,
    place: usize,
}

impl<M: Topic> Input for Reading<M> {
    fn next(&mut self, page: &Page) -> Result<Option<u64>, Interrupted> {
        let message = self.reader.next()?;
        let tick = message.map(|message| message.header().tick);
        if tick.is_some() {
            show(page, self.place, message);
        }
        Ok(tick)
    }

    fn at(&mut self, page: &Page, tick: u64) -> Result<bool, Interrupted> {
        Ok(show(page, self.place, self.reader.at(tick)?))
    }

    fn arriving(
        &mut self,
        page: &Page,
        tick: u64,
        deadline_ns: Option<u64>,
    ) -> Result<bool, Interrupted> {
        let message = self.reader.arriving(tick, deadline_ns)?;
        Ok(show(page, self.place, message))
    }
}

struct Writing<M: Topic> {
    writer: Writer<M>,
    draft: Draft<M>,
}

impl<M: Topic> Output for Writing<M> {
    fn not_finite(&mut self, page: &Page) -> Option<(&'static str, String)> {
        self.draft.not_finite(page)
    }

    fn send(&mut self, tick: u64) -> Result<(), ProcessError> {
        Ok(self.writer.send(self.draft.message(tick))?)
    }
}

struct Gathering<M: Topic> {
    collector: Collector<M>,
    place: usize,
    waiting: VecDeque<Box<M>>,
}

impl<M: Topic> Gathered for Gathering<M> {
    fn collect(&mut self) -> Result<(), Interrupted> {
        self.collector
            .collect(|message| self.waiting.push_back(Box::new(*message)))
    }

    fn oldest(&self) -> Option<(u64, usize)> {
        self.waiting
            .front()
            .map(|message| (message.header().tick, self.waiting.len()))
    }

    fn show(&mut self, page: &Page, tick: u64) {
        let message = self
            .waiting
            .pop_front_if(|message| message.header().tick == tick);
        show(page, self.place, message.as_deref());
    }
}

/// Opens a topic as one of the three ends; `place` is its place on the page.
pub(crate) fn open<E: End + ?Sized>(
    shell: &Shell,
    topic: &str,
    place: usize,
) -> Result<Box<E>, ProcessError> {
    struct Open<'a, E: ?Sized>(&'a Shell, usize, PhantomData<E>);
    impl<E: End + ?Sized> Each for Open<'_, E> {
        type Output = Result<Box<E>, ProcessError>;
        fn each<M: Topic>(&mut self) -> Self::Output {
            E::of::<M>(self.0, self.1)
        }
    }
    let opened = topics::named(topic, &mut Open(shell, place, PhantomData::<E>));
    opened
        .ok_or_else(|| ProcessError::setup(format!("an exchange page does not carry `{topic}`")))?
}

/// A use of a topic: how its end is made for a message type.
pub(crate) trait End {
    fn of<M: Topic>(shell: &Shell, place: usize) -> Result<Box<Self>, ProcessError>;
}

impl End for dyn Input {
    fn of<M: Topic>(shell: &Shell, place: usize) -> Result<Box<Self>, ProcessError> {
        Ok(Box::new(Reading {
            reader: shell.reader::<M>()?,
            place,
        }))
    }
}

impl End for dyn Output {
    fn of<M: Topic>(shell: &Shell, place: usize) -> Result<Box<Self>, ProcessError> {
        Ok(Box::new(Writing {
            writer: shell.writer::<M>()?,
            draft: Draft::of(place),
        }))
    }
}

impl End for dyn Gathered {
    fn of<M: Topic>(shell: &Shell, place: usize) -> Result<Box<Self>, ProcessError> {
        Ok(Box::new(Gathering {
            collector: shell.collector::<M>()?,
            place,
            waiting: VecDeque::new(),
        }))
    }
}
