//! The state from which a process goes on, in a file that outlives its writer.
//!
//! Two slots alternate. A tick's slot is committed before its last message leaves, so a replacement
//! finds the state behind every message that a reader has.

use std::cell::Cell;
use std::path::Path;
use std::slice;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::mapped::Mapped;

/// Before the slots.
#[repr(C)]
struct Head {
    /// Commits so far; the newest lies in slot (commits − 1) mod 2.
    commits: AtomicU64,
    /// The length of each slot's state; bytes.
    bytes: [AtomicU64; 2],
}

/// The state that the last incarnation of a process committed, and the place for that of the tick in hand.
pub(crate) struct StateCell {
    file: Mapped,
    /// Most bytes of a state.
    most: usize,
    /// A state has been written since the last commit.
    is_written: Cell<bool>,
}

/// The state that was committed last in a cell; `None` where there is no cell, or nothing in it.
///
/// # Errors
/// When it cannot be read.
pub(crate) fn newest(path: &Path) -> std::io::Result<Option<Vec<u8>>> {
    let Ok(file) = std::fs::metadata(path) else {
        return Ok(None);
    };
    match (file.len() as usize).checked_sub(size_of::<Head>()) {
        Some(slots) => StateCell::open(path, slots / 2)?.newest(),
        None => Ok(None),
    }
}

impl StateCell {
    /// Maps the file, which is made where there is none.
    ///
    /// # Errors
    /// When there is no room.
    pub(crate) fn open(path: &Path, most: usize) -> std::io::Result<Self> {
        Ok(Self {
            file: Mapped::open(path, size_of::<Head>() + 2 * most)?,
            most,
            is_written: Cell::new(false),
        })
    }

    /// The state that was committed last.
    ///
    /// # Errors
    /// When it counts more bytes than there are.
    pub(crate) fn newest(&self) -> std::io::Result<Option<Vec<u8>>> {
        let commits = self.head().commits.load(Ordering::Acquire);
        let Some(number) = commits.checked_sub(1) else {
            return Ok(None);
        };
        let bytes = self.head().bytes[(number % 2) as usize].load(Ordering::Relaxed);
        if bytes > self.most as u64 {
            let damage = format!("it counts {bytes} bytes, and has room for {}", self.most);
            return Err(std::io::Error::other(damage));
        }
        // SAFETY: a slot of the mapping, and no more of it than there is. Its writer is dead, or writes into it only at the cut after the next one.
        let state = unsafe { slice::from_raw_parts(self.slot(number), bytes as usize) };
        Ok(Some(state.to_vec()))
    }

    /// The state written for the tick in hand, if any, counts from now on.
    pub(crate) fn commit(&self) {
        if !self.is_written.replace(false) {
            return;
        }
        let commits = self.head().commits.load(Ordering::Relaxed);
        self.head().commits.store(commits + 1, Ordering::Release);
    }

    /// Writes the state of the tick in hand, which is committed with the tick; whether there was room for it.
    pub(crate) fn write(&self, state: &[u8]) -> bool {
        if state.len() > self.most {
            return false;
        }
        self.is_written.set(true);
        let number = self.head().commits.load(Ordering::Relaxed);
        let bytes = &self.head().bytes[(number % 2) as usize];
        bytes.store(state.len() as u64, Ordering::Relaxed);
        // SAFETY: a slot of the mapping that is not read before it is committed. A process has one cell, which stays on one thread.
        unsafe {
            let slot = self.slot(number);
            slot.copy_from_nonoverlapping(state.as_ptr(), state.len());
        }
        true
    }

    fn head(&self) -> &Head {
        // SAFETY: mapped for the life of `self`, aligned as a page is, and all of it atomic.
        unsafe { self.file.start().cast().as_ref() }
    }

    fn slot(&self, number: u64) -> *mut u8 {
        // SAFETY: within the mapping, for there are two slots.
        unsafe {
            let first = self.file.start().as_ptr().add(size_of::<Head>());
            first.add((number % 2) as usize * self.most)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RunDir;

    #[test]
    fn what_is_not_committed_is_not_found() {
        let run = RunDir::create().unwrap();
        let open = || StateCell::open(&run.path().join("c"), 9).unwrap();
        let found = || open().newest().unwrap();
        let cell = open();
        assert!(found().is_none() && !cell.write(&[0; 10]));
        for tick in 4..6 {
            assert!(cell.write(&[tick; 4]));
            cell.commit();
        }
        assert!(cell.write(&[105; 5]));
        assert_eq!((found(), found()), (Some(vec![5; 4]), Some(vec![5; 4])));
    }

    #[test]
    fn a_damaged_length_is_refused_and_not_shortened() {
        let run = RunDir::create().unwrap();
        let cell = StateCell::open(&run.path().join("c"), 8).unwrap();
        assert!(cell.write(&[1; 8]));
        cell.commit();
        assert_eq!(cell.newest().unwrap(), Some(vec![1; 8]));
        cell.head().bytes[0].store(9, Ordering::Relaxed);
        assert!(cell.newest().is_err());
    }
}
