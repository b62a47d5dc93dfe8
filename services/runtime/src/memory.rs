//! What a process sent last on a topic, where its death does not reach it: two slots in a file of the run, written in turn.
//!
//! A process that is started again has no other memory. At every instant one of the slots is whole, whenever SIGKILL comes.

use std::fs::OpenOptions;
use std::marker::PhantomData;
use std::os::unix::fs::OpenOptionsExt;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU64, Ordering, fence};

use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use shared_types::Message;

use crate::run_dir::RunDir;

#[repr(C)]
struct Slots<M> {
    /// Messages kept so far; the newest lies in slot (count − 1) mod 2. It grows when a slot is whole.
    count: AtomicU64,
    slots: [M; 2],
}

/// The last message of a topic; written by the topic's one writer, read by its replacement when the writer is dead.
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

    fn count(&self) -> &AtomicU64 {
        // SAFETY: mapped for the life of `self` and aligned as a page is.
        unsafe { &(*self.slots.as_ptr()).count }
    }

    /// Keeps a message in place of the one before the last.
    pub(crate) fn keep(&self, message: &M) {
        let count = self.count().load(Ordering::Relaxed);
        // SAFETY: the index is 0 or 1; only the topic's one living writer writes, and who reads waits for its death.
        unsafe { (&raw mut (*self.slots.as_ptr()).slots).cast::<M>().add((count % 2) as usize).write(*message) };
        fence(Ordering::Release);
        self.count().store(count.wrapping_add(1), Ordering::Relaxed);
    }

    /// The last message kept.
    pub(crate) fn last(&self) -> Option<M> {
        self.kept(1)
    }

    /// The one before the last; for the writer itself.
    pub(crate) fn before_last(&self) -> Option<M> {
        self.kept(2)
    }

    fn kept(&self, back: u64) -> Option<M> {
        let newest = self.count().load(Ordering::Acquire).checked_sub(back)?;
        // SAFETY: the index is 0 or 1, every bit pattern is a valid message, and its writer is dead or the caller.
        Some(unsafe { (&raw const (*self.slots.as_ptr()).slots).cast::<M>().add((newest % 2) as usize).read() })
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

    #[test]
    fn the_last_message_outlives_its_writer() {
        let run = RunDir::create().unwrap();
        let writer = Memory::<TorqueCommand>::open(&run).unwrap();
        assert!(writer.last().is_none());
        let mut message = TorqueCommand::default();
        for tick in 0..5 {
            message.header.tick = tick;
            message.resume[63] = tick as f64;
            writer.keep(&message);
        }
        assert_eq!(writer.before_last().unwrap().header.tick, 3);
        drop(writer);
        assert_eq!(Memory::<TorqueCommand>::open(&run).unwrap().last(), Some(message));
    }
}
