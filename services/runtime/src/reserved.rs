//! A file whose memory is allocated before the run begins, so that a memory file system that fills
//! up later cannot corrupt it.

use std::fs::{self, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

/// Takes `bytes` of memory for the file that [`write_reserved`] will make at `path`; `path` itself does not exist before.
///
/// # Errors
/// When the file system has no room.
pub fn reserve(path: &Path, bytes: usize) -> io::Result<()> {
    let room = room(path);
    // One that an earlier run or somebody else has left, a link or a pipe too: nothing is written through it.
    match fs::remove_file(&room) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    OpenOptions::new()
        .write(true)
        .create_new(true)
        .open(room)?
        .write_all(&vec![0; bytes])
}

/// Makes the file `path` with `text`, in the memory that [`reserve`] took for it where there is some. The file appears whole or not at all.
///
/// # Errors
/// When the file cannot be written, or `text` is longer than the memory taken and the file system is full.
pub fn write_reserved(path: &Path, text: &[u8]) -> io::Result<()> {
    let room = room(path);
    // Not truncated before it is written: that would give the memory back.
    let mut file = OpenOptions::new()
        .write(true)
        .create(true)
        .truncate(false)
        // A link or a pipe that has its name meanwhile is an error.
        .custom_flags(libc::O_NOFOLLOW | libc::O_NONBLOCK)
        .open(&room)?;
    file.write_all(text)?;
    file.set_len(text.len() as u64)?;
    fs::rename(room, path)
}

/// Gives back what [`reserve`] took for `path` and [`write_reserved`] has not used.
pub fn release_reserve(path: &Path) {
    let _ = fs::remove_file(room(path));
}

fn room(path: &Path) -> PathBuf {
    path.with_added_extension("reserved")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_has_the_text_and_nothing_of_the_reserve() {
        let path = std::env::temp_dir().join(format!("armplane-reserved-{}", std::process::id()));
        reserve(&path, 4096).unwrap();
        assert!(!path.exists());
        write_reserved(&path, b"text").unwrap();
        let read = fs::read(&path).unwrap();
        let left = room(&path).exists();
        fs::remove_file(&path).unwrap();
        assert_eq!((read.as_slice(), left), (b"text".as_slice(), false));
    }
}
