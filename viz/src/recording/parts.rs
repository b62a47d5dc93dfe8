//! The files of a recording.

use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};

use xxhash_rust::xxh3::Xxh3Default;

use super::state::Written;
use crate::sink::RecordError;

/// Name of a part of a recording in its folder: `run.rrd`, then `run-001.rrd`, `run-002.rrd` and so on.
#[must_use]
pub fn part_name(part: u32) -> String {
    if part == 0 {
        "run.rrd".to_owned()
    } else {
        format!("run-{part:03}.rrd")
    }
}

/// The parts of a recording that a folder holds, in order; without a part that its recorder began and died before it wrote.
#[must_use]
pub fn parts_in(folder: &Path) -> Vec<PathBuf> {
    let parts = (0..)
        .map(|part| folder.join(part_name(part)))
        .take_while(|path| path.exists());
    parts.filter(|path| !is_blank(path)).collect()
}

/// Takes away what stands in a folder's recording behind the place to which it is known to have come; all of it where none is known. The recorder that wrote
/// it was killed before it could say how far it had come, and its replacement writes it again.
///
/// # Errors
/// The file system's own.
pub fn cut_behind(folder: &Path, written: Option<&Written>) -> io::Result<()> {
    let parts = (0..)
        .map(|part| (part, folder.join(part_name(part))))
        .take_while(|(_, path)| path.exists());
    for (part, path) in parts.collect::<Vec<_>>() {
        match written {
            Some(written) if part < written.part => {}
            Some(written) if part == written.part => {
                let file = File::options().write(true).open(path)?;
                if file.metadata()?.len() > written.bytes {
                    file.set_len(written.bytes)?;
                }
            }
            _ => std::fs::remove_file(path)?,
        }
    }
    Ok(())
}

/// The room that files of a recording take on the volume; bytes. One that is gone takes nothing.
#[must_use]
pub fn bytes_in(parts: &[PathBuf]) -> u64 {
    parts
        .iter()
        .filter_map(|part| std::fs::metadata(part).ok())
        .map(|file| file.len())
        .sum()
}

/// The checksum of each file's bytes, as `summary.json` keeps it: XXH3 of 64 bits, in hexadecimal.
///
/// # Errors
/// The file system's own, of the first file that cannot be read.
pub fn checksums(parts: &[PathBuf]) -> io::Result<Vec<String>> {
    parts.iter().map(|part| checksum(part)).collect()
}

fn checksum(part: &Path) -> io::Result<String> {
    let mut sum = Xxh3Default::new();
    io::copy(&mut files::open(part)?, &mut sum)?;
    Ok(format!("{:016x}", sum.digest()))
}

/// Whether a file is empty, or no more than the head of a recording and the message that names it: less than 150 bytes, where a chunk has 600 and more.
pub(super) fn is_blank(path: &Path) -> bool {
    const HEAD: usize = 512;
    let mut head = Vec::new();
    let read = files::open(path).and_then(|file| {
        std::io::Read::read_to_end(&mut std::io::Read::take(file, HEAD as u64), &mut head)
    });
    read.is_ok() && head.len() < HEAD && (head.is_empty() || head.starts_with(b"RRF"))
}

pub(super) fn create(path: &Path) -> Result<File, RecordError> {
    File::create(path).map_err(|source| RecordError::Create {
        path: path.display().to_string(),
        source,
    })
}
