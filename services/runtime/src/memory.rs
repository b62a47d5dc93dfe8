//! Messages in files of the run, safe from any death of a process: retained messages for a
//! replacement of the recorder, and the last two messages of a writer whose messages faults change.
//!
//! Neither lies on the path of a message in a run without faults. At any instant, all slots but the
//! one being written are complete.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering, fence};

use lockstep::Ring;
use process::Packed;

use crate::bus::depth::depth;
use crate::mapped::Mapped;
use crate::run_dir::RunDir;

/// Bytes before the first slot: the count, and room that aligns the slots as a cache line is.
const HEAD: usize = 64;

/// A file of slots that take turns, with a count of the messages written; messages of one size, a multiple of 8 bytes.
struct Slots {
    file: Mapped,
    slots: usize,
    /// Bytes of a message.
    bytes: usize,
}

impl Slots {
    /// Maps the file, which is made where there is none.
    fn open(path: &Path, slots: usize, bytes: usize) -> std::io::Result<Self> {
        let file = Mapped::open(path, HEAD + slots * bytes)?;
        Ok(Self { file, slots, bytes })
    }

    fn count(&self) -> &AtomicU64 {
        // SAFETY: mapped for the life of `self` and aligned as a page is.
        unsafe { self.file.start().cast().as_ref() }
    }

    fn written(&self) -> u64 {
        self.count().load(Ordering::Acquire)
    }

    fn slot(&self, number: u64) -> *mut u64 {
        // SAFETY: the index is below the number of slots, and head and slots are multiples of 8 bytes.
        unsafe {
            self.file
                .start()
                .as_ptr()
                .add(HEAD + (number % self.slots as u64) as usize * self.bytes)
                .cast()
        }
    }

    /// Adds a message in place of the oldest; one of another size is not one.
    fn push(&self, message: &[u8]) {
        if message.len() != self.bytes {
            return;
        }
        let count = self.count().load(Ordering::Relaxed);
        // SAFETY: a slot of the mapping; there is one living writer, and readers look at the count afterwards.
        unsafe {
            self.slot(count)
                .cast::<u8>()
                .copy_from_nonoverlapping(message.as_ptr(), message.len())
        };
        fence(Ordering::Release);
        self.count().store(count.wrapping_add(1), Ordering::Release);
    }

    /// Message `number`, counted from 0; `None` if it has not come yet, or is no longer there.
    fn get(&self, number: u64) -> Option<Vec<u8>> {
        if number >= self.written() {
            return None;
        }
        let slot = self.slot(number);
        // SAFETY: words of a slot of the mapping; a torn message is thrown away below.
        let words = (0..self.bytes / size_of::<u64>())
            .map(|word| unsafe { slot.add(word).read_volatile() });
        let message = words.flat_map(u64::to_ne_bytes).collect();
        fence(Ordering::Acquire);
        // The writer may be at work on the slot from the moment on at which this is its next.
        (self.count().load(Ordering::Relaxed) < number.saturating_add(self.slots as u64))
            .then_some(message)
    }
}

/// The messages of a topic that its retainer has handed over, the last of them: written by the launcher, read by a replacement of the recorder.
pub(crate) struct HandedOver(Slots);

impl HandedOver {
    /// Maps the file of the topic, which is made where there is none.
    pub(crate) fn open(run: &RunDir, topic: &str, bytes: usize) -> std::io::Result<Self> {
        Slots::open(
            &run.path().join(format!("handed-over-{topic}")),
            2 * depth(bytes),
            bytes,
        )
        .map(Self)
    }

    /// Adds a message in place of the oldest.
    pub(crate) fn push(&self, message: &[u8]) {
        self.0.push(message);
    }
}

impl Ring for HandedOver {
    type Message = Vec<u8>;

    fn count(&self) -> u64 {
        self.0.written()
    }

    /// Twice as many as the retainer holds.
    fn length(&self) -> u64 {
        self.0.slots as u64
    }

    fn get(&self, number: u64) -> Option<Vec<u8>> {
        self.0.get(number)
    }
}

/// A writer's last two messages while faults change them: the original differs from the message
/// delivered.
pub(crate) struct LastMade(Slots);

impl LastMade {
    /// Maps the file of the topic, which is made where there is none.
    pub(crate) fn open(run: &RunDir, topic: &str, bytes: usize) -> std::io::Result<Self> {
        // A third slot: of the last two none is the next to be written.
        Slots::open(&run.path().join(format!("made-{topic}")), 3, bytes).map(Self)
    }

    /// Keeps a message that is not delivered as it is, or not now.
    pub(crate) fn keep(&self, message: &[u8]) {
        self.0.push(message);
    }

    /// The last message made of a tick before `tick`, as far as it is known.
    pub(crate) fn before(&self, tick: u64) -> Option<Packed> {
        let made = self.0.written();
        let last_made = (made.saturating_sub(2)..made)
            .filter_map(|number| self.0.get(number))
            .map(|bytes| Packed::of(&bytes));
        last_made
            .filter(|message| message.header().tick < tick)
            .max_by_key(|message| message.header().tick)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytemuck::bytes_of;
    use shared_types::TorqueCommand;

    fn message(tick: u64) -> TorqueCommand {
        let mut message = TorqueCommand::default();
        message.header.tick = tick;
        message.tau[7] = tick as f64;
        message
    }

    #[test]
    fn the_last_message_made_outlives_its_writer() {
        let run = RunDir::create().unwrap();
        let open = || LastMade::open(&run, "torque", size_of::<TorqueCommand>());
        let made = |tick| Some(Packed::of(bytes_of(&message(tick))));
        let writer = open().unwrap();
        assert!(writer.before(u64::MAX).is_none());
        (5..8).for_each(|tick| writer.keep(bytes_of(&message(tick))));
        assert_eq!(
            (writer.before(7), writer.before(6)),
            (made(6), None),
            "two are kept"
        );
        drop(writer);
        assert_eq!(open().unwrap().before(u64::MAX), made(7));
    }

    #[test]
    fn the_ring_gives_what_is_still_in_it() {
        let run = RunDir::create().unwrap();
        let open = || HandedOver::open(&run, "torque", size_of::<TorqueCommand>()).unwrap();
        let (writer, reader) = (open(), open());
        let length = reader.length();
        assert_eq!(reader.get(0), None);
        let count = 3 * length + 7;
        (0..count).for_each(|tick| writer.push(bytes_of(&message(tick))));
        assert_eq!(reader.count(), count);
        for number in 0..count + 2 {
            let is_there = number + length > count && number < count;
            assert_eq!(
                reader.get(number),
                is_there.then(|| bytes_of(&message(number)).to_vec()),
                "{number}"
            );
        }
    }
}
