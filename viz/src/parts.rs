//! The files of a recording: their names, their ends, and all of them as one.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use re_chunk::external::arrow::array::ListArray;
use re_chunk::{Chunk, ComponentIdentifier, EntityPath};
use re_log_encoding::StreamFooter;
use re_log_types::{StoreId, StoreKind};
use xxhash_rust::xxh3::Xxh3Default;

use crate::entity;
use crate::read::{Found, ReadError, ReadNews, chunks_of};
use crate::recording::Written;
use crate::sink::{RecordError, Sink};

/// Name of a part of a recording in its folder: `run.rrd`, then `run-001.rrd`, `run-002.rrd` and so on.
#[must_use]
pub fn part_name(part: u32) -> String {
    match part {
        0 => "run.rrd".to_owned(),
        part => format!("run-{part:03}.rrd"),
    }
}

/// Whether a file of this name is a part of a recording.
#[must_use]
pub fn is_part(name: &str) -> bool {
    let number = name
        .strip_prefix("run")
        .and_then(|rest| rest.strip_suffix(".rrd"));
    let is_number = |text: &str| text.parse::<u32>().is_ok();
    number
        .is_some_and(|number| number.is_empty() || number.strip_prefix('-').is_some_and(is_number))
}

fn files_in(folder: &Path) -> impl Iterator<Item = PathBuf> {
    let parts = (0..).map(|part| folder.join(part_name(part)));
    parts.take_while(|path| path.exists())
}

/// The parts of a recording that a folder holds, in order; without a part that its recorder began and died before it wrote.
#[must_use]
pub fn parts_in(folder: &Path) -> Vec<PathBuf> {
    files_in(folder).filter(|path| !is_blank(path)).collect()
}

/// Whether a file is empty, or no more than the head of a recording and the message that names it: less than 150 bytes, where a chunk has 600 and more.
fn is_blank(path: &Path) -> bool {
    const HEAD: u64 = 512;
    let mut head = Vec::new();
    let read = files::open(path).and_then(|file| file.take(HEAD).read_to_end(&mut head));
    read.is_ok_and(|read| (read as u64) < HEAD) && (head.is_empty() || head.starts_with(b"RRF"))
}

/// Takes away what stands in a folder's recording behind the place to which it is known to have come; all of it where none is known. The recorder that wrote
/// it was killed before it could say how far it had come, and its replacement writes it again.
///
/// # Errors
/// The file system's own.
pub fn cut_behind(folder: &Path, written: Option<&Written>) -> io::Result<()> {
    for (part, path) in files_in(folder).collect::<Vec<_>>().into_iter().enumerate() {
        match written.map(|written| (written.part as usize, written.bytes)) {
            Some((last, _)) if part < last => {}
            Some((last, bytes)) if part == last => {
                let file = File::options().write(true).open(path)?;
                if file.metadata()?.len() > bytes {
                    file.set_len(bytes)?;
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
    let files = parts.iter().filter_map(|part| std::fs::metadata(part).ok());
    files.map(|file| file.len()).sum()
}

/// The checksum of each file's bytes, as `summary.json` keeps it: XXH3 of 64 bits, in hexadecimal.
///
/// # Errors
/// The file system's own, of the first file that cannot be read.
pub fn checksums(parts: &[PathBuf]) -> io::Result<Vec<String>> {
    let checksum = |part: &PathBuf| {
        let mut sum = Xxh3Default::new();
        io::copy(&mut files::open(part)?, &mut sum)?;
        Ok(format!("{:016x}", sum.digest()))
    };
    parts.iter().map(checksum).collect()
}

pub(crate) fn create(path: &Path) -> Result<File, RecordError> {
    files::create(path).map_err(|source| {
        let path = path.display().to_string();
        RecordError::Create { path, source }
    })
}

/// Why recordings cannot be merged.
#[derive(Debug, thiserror::Error)]
pub enum MergeError {
    /// A part cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] RecordError),
    /// A part belongs to another recording than the first one.
    #[error(
        "{path} is a part of another recording than {first}: put the files of one run into one folder"
    )]
    Foreign {
        /// Which.
        path: PathBuf,
        /// The first part.
        first: PathBuf,
    },
}

/// Writes the parts of one recording into one file, with its footer: every row of every part, constants that the parts repeat once, and the
/// blueprint of the last part that has one. A damaged chunk ends its part and is given to `news`, as the counts of rows are.
///
/// # Errors
/// [`MergeError`] where a part cannot be read or is of another recording, or the file cannot be written.
pub fn merge(
    parts: &[PathBuf],
    to: &Path,
    mut news: impl FnMut(ReadNews<'_>),
) -> Result<u64, MergeError> {
    let mut merged: Option<(Sink, StoreId)> = None;
    let mut constants = BTreeMap::new();
    let mut layout: Option<(StoreId, Vec<Chunk>)> = None;
    for path in parts {
        let mut own: Option<(StoreId, Vec<Chunk>)> = None;
        chunks_of(path, |found| match found {
            Found::Damaged(damage) => {
                news(ReadNews::Damaged(&damage));
                Ok::<(), MergeError>(())
            }
            Found::Chunk(store, chunk) if store.kind() == StoreKind::Blueprint => {
                own.get_or_insert_with(|| (store, Vec::new()))
                    .1
                    .push(*chunk);
                Ok(())
            }
            Found::Chunk(store, chunk) => {
                if !chunk.is_static() && *chunk.entity_path() == entity::SIGNALS.into() {
                    news(ReadNews::Rows(chunk.num_rows() as u64));
                }
                let (sink, known) = match &mut merged {
                    Some(begun) => begun,
                    none => none.insert((Sink::new(Box::new(create(to)?), &store)?, store.clone())),
                };
                if *known != store {
                    let (path, first) = (path.clone(), parts[0].clone());
                    return Err(MergeError::Foreign { path, first });
                }
                if is_new(&chunk, &mut constants) {
                    sink.stream.send_chunk(*chunk);
                    sink.flush();
                }
                Ok(sink.check()?)
            }
        })?;
        layout = own.or(layout);
    }
    let Some((mut sink, _)) = merged else {
        let path = parts.first().cloned().unwrap_or_default();
        return Err(ReadError::NotARecording {
            path,
            reason: "it is empty".to_owned(),
        }
        .into());
    };
    if let Some((store, chunks)) = layout {
        sink.send_blueprint(&store, chunks.into_iter().map(Ok));
    }
    Ok(sink.finish()?)
}

/// Whether a chunk does not only repeat values that never change.
fn is_new(
    chunk: &Chunk,
    constants: &mut BTreeMap<(EntityPath, ComponentIdentifier), ListArray>,
) -> bool {
    let mut is_new = !chunk.is_static();
    for (name, column) in chunk.components().iter().filter(|_| chunk.is_static()) {
        let key = (chunk.entity_path().clone(), *name);
        let before = constants.insert(key, column.list_array.clone());
        is_new |= before.as_ref() != Some(&column.list_array);
    }
    is_new
}

/// Whether a recording has its footer: one of a recorder that was killed has none.
pub(crate) fn is_complete(path: &Path) -> io::Result<bool> {
    let mut file = files::open(path)?;
    let mut end = [0; StreamFooter::ENCODED_SIZE_BYTES];
    if file.metadata()?.len() < end.len() as u64 {
        return Ok(false);
    }
    file.seek(SeekFrom::End(-(end.len() as i64)))?;
    file.read_exact(&mut end)?;
    Ok(end.windows(8).any(|magic| magic == b"RRF2FOOT"))
}

/// Gives a part that has no footer one: a recorder that was killed left it so, and readers that seek need it. While the part is written anew it
/// takes its place a second time. A part that is damaged stays as it is.
///
/// # Errors
/// [`MergeError`] where the part cannot be read or written; it stays as it was then.
pub fn complete(part: &Path) -> Result<(), MergeError> {
    let unreadable = |source| ReadError::Open {
        path: part.to_owned(),
        source,
    };
    if is_complete(part).map_err(unreadable)? {
        return Ok(());
    }
    let name = part.file_name().unwrap_or_default();
    let draft = part.with_file_name(format!(".{}", name.display()));
    let mut is_damaged = false;
    let written = merge(&[part.to_owned()], &draft, |news| {
        is_damaged |= matches!(news, ReadNews::Damaged(_));
    });
    let placed = match written {
        Ok(_) if is_damaged => Ok(()),
        Ok(_) => std::fs::rename(&draft, part).map_err(|source| {
            let path = part.display().to_string();
            RecordError::Create { path, source }.into()
        }),
        Err(MergeError::Write(RecordError::Write { source, .. })) => {
            Err(RecordError::Anew { source }.into())
        }
        Err(error) => Err(error),
    };
    if is_damaged || placed.is_err() {
        let _ = std::fs::remove_file(&draft);
    }
    placed
}
