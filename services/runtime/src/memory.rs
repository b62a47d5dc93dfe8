//! What a process sent on a topic, where its death does not reach it, nor that of who should have received it: a ring of the last messages
//! delivered, and the last two made, in a file of the run.
//!
//! A process that is started again knows its own past from here, and a recorder what was on its way to its predecessor. At every instant
//! all slots but the one being written are whole, whenever SIGKILL comes.

use std::fs::OpenOptions;
use std::marker::PhantomData;
use std::os::unix::fs::OpenOptionsExt;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU64, Ordering, fence};

use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use shared_types::Message;

use crate::run_dir::RunDir;

/// Messages in the ring of the delivered: more than can be on their way to the recorder and in its hands, not yet in its files. Two seconds at
/// 1 kHz: on a busy machine a replacement takes most of one.
pub(crate) const RING: usize = 2048;

#[repr(C)]
struct Slots<M> {
    /// Messages delivered so far; the newest lies in slot (count − 1) mod [`RING`]. It grows when a slot is whole.
    delivered: AtomicU64,
    /// Messages made so far, in two slots likewise: while faults shape them, what is made is not what is delivered.
    made: AtomicU64,
    last_made: [M; 2],
    ring: [M; RING],
}

/// The last messages of a topic; written by the topic's one writer.
pub(crate) struct Memory<M: Message> {
    slots: NonNull<Slots<M>>,
    _message: PhantomData<M>,
}

impl<M: Message> Memory<M> {
    /// Maps the file of the topic, which is made where there is none.
    pub(crate) fn open(run: &RunDir) -> std::io::Result<Self> {
        let path = run.path().join(format!("last-{}", M::TOPIC));
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).mode(0o600).open(path)?;
        if file.metadata()?.len() < size_of::<Slots<M>>() as u64 {
            // Written, not only truncated: the memory is there now, or the error is.
            std::os::unix::fs::FileExt::write_all_at(&file, &vec![0; size_of::<Slots<M>>()], 0)?;
        }
        // SAFETY: a fresh shared mapping of a file that is at least this long; nothing else in this process lies there.
        let address =
            unsafe { mmap(std::ptr::null_mut(), size_of::<Slots<M>>(), ProtFlags::READ | ProtFlags::WRITE, MapFlags::SHARED, &file, 0)? };
        let slots = NonNull::new(address.cast()).ok_or_else(|| std::io::Error::other("mapped at address 0"))?;
        Ok(Self { slots, _message: PhantomData })
    }

    fn slots(&self) -> *mut Slots<M> {
        self.slots.as_ptr()
    }

    fn count_delivered(&self) -> &AtomicU64 {
        // SAFETY: mapped for the life of `self` and aligned as a page is.
        unsafe { &(*self.slots()).delivered }
    }

    fn count_made(&self) -> &AtomicU64 {
        // SAFETY: as above.
        unsafe { &(*self.slots()).made }
    }

    /// The place of message `number` of the delivered.
    fn slot(&self, number: u64) -> *mut M {
        // SAFETY: the index is below the ring's length.
        unsafe { (&raw mut (*self.slots()).ring).cast::<M>().add((number % RING as u64) as usize) }
    }

    fn slot_made(&self, number: u64) -> *mut M {
        // SAFETY: the index is 0 or 1.
        unsafe { (&raw mut (*self.slots()).last_made).cast::<M>().add((number % 2) as usize) }
    }

    /// Notes a message that is about to be delivered, in place of the oldest.
    pub(crate) fn deliver(&self, message: &M) {
        let count = self.count_delivered().load(Ordering::Relaxed);
        // SAFETY: a slot of the mapping; only the topic's one living writer writes, and readers look at the count afterwards.
        unsafe { self.slot(count).write(*message) };
        fence(Ordering::Release);
        self.count_delivered().store(count.wrapping_add(1), Ordering::Relaxed);
    }

    /// Keeps a message that is not delivered as it is, or not now.
    pub(crate) fn keep(&self, message: &M) {
        let count = self.count_made().load(Ordering::Relaxed);
        // SAFETY: as in `deliver`; who reads waits for the writer's death.
        unsafe { self.slot_made(count).write(*message) };
        fence(Ordering::Release);
        self.count_made().store(count.wrapping_add(1), Ordering::Relaxed);
    }

    /// The last message made.
    pub(crate) fn last(&self) -> Option<M> {
        self.before(u64::MAX)
    }

    /// The last message made of a tick before `tick`, as far as it is known.
    pub(crate) fn before(&self, tick: u64) -> Option<M> {
        let made = self.count_made().load(Ordering::Acquire);
        // SAFETY: slots of the mapping, every bit pattern is a valid message, and the writer of these two is dead or the caller.
        let last_made = (made.saturating_sub(2)..made).map(|number| unsafe { self.slot_made(number).read() });
        let delivered = self.delivered_so_far().checked_sub(1).and_then(|newest| self.delivered(newest));
        last_made.chain(delivered).filter(|message| message.header().tick < tick).max_by_key(|message| message.header().tick)
    }

    /// How many messages have been delivered.
    pub(crate) fn delivered_so_far(&self) -> u64 {
        self.count_delivered().load(Ordering::Acquire)
    }

    /// Message `number` of those delivered, counted from 0; `None` where it has not come yet, or is no longer there.
    pub(crate) fn delivered(&self, number: u64) -> Option<M> {
        if number >= self.delivered_so_far() {
            return None;
        }
        // SAFETY: a slot of the mapping, and every bit pattern is a valid message; a torn one is thrown away below.
        let message = unsafe { self.slot(number).read_volatile() };
        fence(Ordering::Acquire);
        // The writer may be at work on the slot from the moment on at which this is its next.
        (self.count_delivered().load(Ordering::Relaxed) < number.saturating_add(RING as u64)).then_some(message)
    }
}

impl<M: Message> Drop for Memory<M> {
    fn drop(&mut self) {
        // SAFETY: mapped by `open` with this size, and no reference outlives `self`.
        let _ = unsafe { munmap(self.slots.as_ptr().cast(), size_of::<Slots<M>>()) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::TorqueCommand;

    fn message(tick: u64) -> TorqueCommand {
        let mut message = TorqueCommand::default();
        message.header.tick = tick;
        message.tau[7] = tick as f64;
        message
    }

    #[test]
    fn the_last_message_outlives_its_writer() {
        let run = RunDir::create().unwrap();
        let writer = Memory::<TorqueCommand>::open(&run).unwrap();
        assert!(writer.last().is_none());
        (0..5).for_each(|tick| writer.deliver(&message(tick)));
        assert_eq!(writer.before(4).map_or(0, |before| before.header.tick), 0, "only the newest delivered is looked at");
        // Shaped: made, not delivered.
        (5..8).for_each(|tick| writer.keep(&message(tick)));
        assert_eq!(writer.before(7), Some(message(6)));
        drop(writer);
        assert_eq!(Memory::<TorqueCommand>::open(&run).unwrap().last(), Some(message(7)));
    }

    #[test]
    fn the_ring_gives_what_is_still_in_it() {
        let run = RunDir::create().unwrap();
        let writer = Memory::<TorqueCommand>::open(&run).unwrap();
        let reader = Memory::<TorqueCommand>::open(&run).unwrap();
        assert_eq!(reader.delivered(0), None);
        let count = 3 * RING as u64 + 7;
        (0..count).for_each(|tick| writer.deliver(&message(tick)));
        assert_eq!(reader.delivered_so_far(), count);
        for number in 0..count + 2 {
            let is_there = number + RING as u64 > count && number < count;
            assert_eq!(reader.delivered(number), is_there.then(|| message(number)), "{number}");
        }
    }
}
