//! The parts of a recording as one file, and the end of a part whose recorder was killed.

use std::collections::BTreeMap;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use re_chunk::external::arrow::array::ListArray;
use re_chunk::{Chunk, ComponentIdentifier, EntityPath};
use re_log_encoding::StreamFooter;
use re_log_types::{StoreId, StoreKind};

use super::parts::create;
use crate::entity;
use crate::read::{Found, ReadError, ReadNews, chunks_of};
use crate::sink::{RecordError, Sink};

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
    let mut merged = Merged::default();
    for path in parts {
        merged.layout_of_part = None;
        chunks_of(path, |found| match found {
            Found::Damaged(damage) => {
                news(ReadNews::Damaged(&damage));
                Ok(())
            }
            Found::Chunk(store, chunk) if store.kind() == StoreKind::Blueprint => {
                let of_part = &mut merged.layout_of_part;
                of_part
                    .get_or_insert_with(|| (store, Vec::new()))
                    .1
                    .push(*chunk);
                Ok(())
            }
            Found::Chunk(store, chunk) => {
                if !chunk.is_static() && *chunk.entity_path() == entity::SIGNALS.into() {
                    news(ReadNews::Rows(chunk.num_rows() as u64));
                }
                merged.add(&store, *chunk, to, [path, &parts[0]])
            }
        })?;
        merged.layout = merged.layout_of_part.take().or(merged.layout);
    }
    let Some((mut sink, _)) = merged.file else {
        let path = parts.first().cloned().unwrap_or_default();
        let reason = "it is empty".to_owned();
        return Err(ReadError::NotARecording { path, reason }.into());
    };
    if let Some((store, chunks)) = merged.layout {
        sink.send_blueprint(&store, chunks.into_iter().map(Ok));
    }
    Ok(sink.finish()?)
}

type Layout = Option<(StoreId, Vec<Chunk>)>;

/// A file of several parts in the making.
#[derive(Default)]
struct Merged {
    /// With the recording it is of.
    file: Option<(Sink, StoreId)>,
    /// The value of each component that never changes.
    constants: BTreeMap<(EntityPath, ComponentIdentifier), ListArray>,
    layout: Layout,
    layout_of_part: Layout,
}

impl Merged {
    /// Writes a chunk of a part, unless it repeats constants.
    fn add(
        &mut self,
        store: &StoreId,
        chunk: Chunk,
        to: &Path,
        [path, first]: [&PathBuf; 2],
    ) -> Result<(), MergeError> {
        let mut is_new = !chunk.is_static();
        for (name, column) in chunk.components().iter().filter(|_| chunk.is_static()) {
            let value = column.list_array.clone();
            let key = (chunk.entity_path().clone(), *name);
            let before = self.constants.insert(key, value);
            is_new |= before.as_ref() != Some(&column.list_array);
        }
        let (sink, known) = match &mut self.file {
            Some(begun) => begun,
            none => none.insert((Sink::new(Box::new(create(to)?), store)?, store.clone())),
        };
        if known != store {
            let (path, first) = (path.clone(), first.clone());
            return Err(MergeError::Foreign { path, first });
        }
        if is_new {
            sink.send_chunk(chunk);
            sink.flush();
            sink.check()?;
        }
        Ok(())
    }
}

/// Whether a recording has its footer: one of a recorder that was killed has none.
pub(crate) fn is_complete(path: &Path) -> std::io::Result<bool> {
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
