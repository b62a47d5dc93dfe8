//! Checkpoints: the state from which a restarted process continues, in a file that outlives its
//! writer.
//!
//! Two slots alternate. A tick's slot is committed before its last message leaves, so a replacement
//! finds the state behind every message that a reader has. The previous slot stays, for a death
//! between commit and message.

use std::cell::Cell;
use std::marker::PhantomData;
use std::path::Path;
use std::rc::Rc;
use std::sync::atomic::{AtomicU64, Ordering, fence};

use shared_types::Checkpoint;

use crate::mapped::Mapped;

#[repr(C)]
struct File<C> {
    /// [`Layout::layout_hash`](shared_types::Layout::layout_hash) of `C`; 0 in a fresh file.
    layout: AtomicU64,
    /// Commits so far; the newest lies in slot (commits − 1) mod 2.
    commits: AtomicU64,
    /// The tick of each slot.
    ticks: [AtomicU64; 2],
    slots: [C; 2],
}

struct Slots<C> {
    file: Mapped,
    /// The slot has been handed out since the last commit.
    is_written: Cell<bool>,
    _checkpoint: PhantomData<C>,
}

/// State that is committed when a tick closes.
pub(crate) trait Commit {
    /// Commits the state written for a tick, if any.
    fn commit(&self, tick: u64);
}

impl<C> Slots<C> {
    fn file(&self) -> *mut File<C> {
        self.file.start().cast().as_ptr()
    }

    fn commits(&self) -> &AtomicU64 {
        // SAFETY: mapped for the life of `self`, aligned as a page is.
        unsafe { &(*self.file()).commits }
    }

    fn tick(&self, number: u64) -> &AtomicU64 {
        // SAFETY: as above.
        unsafe { &(*self.file()).ticks[(number % 2) as usize] }
    }

    fn slot(&self, number: u64) -> *mut C {
        // SAFETY: the index is 0 or 1.
        unsafe {
            (&raw mut (*self.file()).slots)
                .cast::<C>()
                .add((number % 2) as usize)
        }
    }
}

impl<C> Commit for Slots<C> {
    fn commit(&self, tick: u64) {
        if !self.is_written.replace(false) {
            return;
        }
        let commits = self.commits().load(Ordering::Relaxed);
        self.tick(commits).store(tick, Ordering::Relaxed);
        fence(Ordering::Release);
        self.commits().store(commits + 1, Ordering::Release);
    }
}

/// A process's checkpoint: the state that the last incarnation committed, and the slot to write
/// now.
pub struct CheckpointSlots<C: Checkpoint> {
    mapped: Rc<Slots<C>>,
    previous: Option<C>,
}

impl<C: Checkpoint> CheckpointSlots<C> {
    /// Maps the file, which is made where there is none. The previous checkpoint is the newest of a tick from which the process may go on.
    ///
    /// # Errors
    /// When there is no room, or the file holds a checkpoint of another layout.
    pub(crate) fn open(
        path: &Path,
        may_resume_from: impl Fn(u64) -> bool,
    ) -> std::io::Result<Self> {
        let mapped = Slots::<C> {
            file: Mapped::open(path, size_of::<File<C>>())?,
            is_written: Cell::new(false),
            _checkpoint: PhantomData,
        };
        // SAFETY: mapped above, and an integer.
        let layout = unsafe { &(*mapped.file()).layout };
        let (ours, found) = (C::layout_hash(), layout.load(Ordering::Relaxed));
        match found {
            0 => layout.store(ours, Ordering::Relaxed),
            found if found != ours => {
                return Err(std::io::Error::other(format!(
                    "it has the layout {found:016x}, this program has {ours:016x}"
                )));
            }
            _ => {}
        }
        let commits = mapped.commits().load(Ordering::Acquire);
        let newest = (commits.saturating_sub(2)..commits).rev();
        let number = newest
            .into_iter()
            .find(|number| may_resume_from(mapped.tick(*number).load(Ordering::Relaxed)));
        // A commit from which no process may go on is taken back: the next one takes its slot, not that of the checkpoint before.
        mapped
            .commits()
            .store(number.map_or(0, |number| number + 1), Ordering::Release);
        // SAFETY: a slot of the mapping whose writer is dead; every bit pattern is a checkpoint, for it is `Pod`.
        let previous = number.map(|number| unsafe { mapped.slot(number).read() });
        Ok(Self {
            mapped: Rc::new(mapped),
            previous,
        })
    }

    pub(crate) fn committer(&self) -> Rc<dyn Commit> {
        Rc::clone(&self.mapped) as Rc<dyn Commit>
    }

    /// The checkpoint of the incarnation before, of the last tick that it sent completely; `None` in a first incarnation.
    pub fn previous(&self) -> Option<&C> {
        self.previous.as_ref()
    }

    /// The slot of the tick in hand, to be overwritten as a whole: it holds the state of two ticks before. It is committed with the tick.
    pub fn slot(&mut self) -> &mut C {
        self.mapped.is_written.set(true);
        let commits = self.mapped.commits().load(Ordering::Relaxed);
        // SAFETY: a slot of the mapping that is not read before it is committed; the borrow of `self` keeps it the only one.
        unsafe { &mut *self.mapped.slot(commits) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RunDir;
    use shared_types::ControllerCheckpoint;

    #[test]
    fn a_commit_that_is_taken_back_does_not_cost_the_one_before() {
        let run = RunDir::create().unwrap();
        let open = |before: u64| {
            CheckpointSlots::<ControllerCheckpoint>::open(&run.path().join("c"), |tick| {
                tick < before
            })
            .unwrap()
        };
        let commit = |slots: &mut CheckpointSlots<ControllerCheckpoint>, tick: u64| {
            bytemuck::bytes_of_mut(slots.slot()).fill(tick as u8);
            slots.committer().commit(tick);
        };
        let found = |before: u64| {
            open(before)
                .previous()
                .map(|last| bytemuck::bytes_of(last)[0])
        };
        let mut slots = open(0);
        assert!(slots.previous().is_none());
        (4..6).for_each(|tick| commit(&mut slots, tick));
        // A death after the commit of tick 5 and before its message, and another one after the commit of the replacement's first tick.
        let mut slots = open(5);
        commit(&mut slots, 105);
        assert_eq!((found(5), found(5)), (Some(4), Some(4)));
        assert_eq!(found(0), None);
    }
}
