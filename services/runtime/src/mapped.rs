//! A file of the run in memory: shared by all processes that map it, and outliving each of them.

use std::fs::{File, OpenOptions};
use std::io::{Error, Result};
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::Path;
use std::ptr::NonNull;

use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};

/// The mapping; its holder is responsible for sharing the contents safely.
#[derive(Debug)]
pub(crate) struct Mapped {
    start: NonNull<u8>,
    bytes: usize,
}

impl Mapped {
    /// Maps a file of this user's alone, which is made of zeros where there is none.
    pub(crate) fn open(path: &Path, bytes: usize) -> Result<Self> {
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false);
        let file = options.mode(0o600).open(path)?;
        if file.metadata()?.len() < bytes as u64 {
            // Written, not only truncated: the memory is there now, or the error is.
            file.write_all_at(&vec![0; bytes], 0)?;
        }
        Self::of(&file, bytes)
    }

    /// Maps the beginning of a file that is at least this long.
    pub(crate) fn of(file: &File, bytes: usize) -> Result<Self> {
        let rights = ProtFlags::READ | ProtFlags::WRITE;
        // SAFETY: a fresh shared mapping; nothing else in this process lies there.
        let start = unsafe {
            mmap(
                std::ptr::null_mut(),
                bytes,
                rights,
                MapFlags::SHARED,
                file,
                0,
            )?
        };
        let start =
            NonNull::new(start.cast()).ok_or_else(|| Error::other("mapped at address 0"))?;
        Ok(Self { start, bytes })
    }

    /// Its first byte, aligned as a page is; valid for the life of `self`.
    pub(crate) fn start(&self) -> NonNull<u8> {
        self.start
    }
}

impl Drop for Mapped {
    fn drop(&mut self) {
        // SAFETY: mapped by `of` with this size; holders lend nothing that outlives them.
        let _ = unsafe { munmap(self.start.as_ptr().cast(), self.bytes) };
    }
}
