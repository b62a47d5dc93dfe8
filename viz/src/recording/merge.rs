//! The parts of a recording as one file, and the end of a part whose recorder was killed.

use std::collections::BTreeMap;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use re_chunk::external::arrow::array::ListArray;
use re_chunk::{Chunk, EntityPath};
use re_log_encoding::StreamFooter;
use re_log_types::{StoreId, StoreKind};

use super::parts::create;
use crate::entity;
use crate::frames::Frames;
use crate::read::{Damage, ReadError, ReadNews};
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

/// Values that never change, of each component that has been written.
#[derive(Default)]
struct Constants(BTreeMap<(EntityPath, String), ListArray>);

impl Constants {
    /// Takes the constants of a chunk in; whether any of them is new.
    fn add(&mut self, chunk: &Chunk) -> bool {
        let mut is_new = false;
        for (name, column) in chunk.components().iter() {
            let known = self
                .0
                .entry((chunk.entity_path().clone(), name.to_string()));
            match known {
                std::collections::btree_map::Entry::Occupied(known)
                    if *known.get() == column.list_array => {}
                std::collections::btree_map::Entry::Occupied(mut known) => {
                    known.insert(column.list_array.clone());
                    is_new = true;
                }
                std::collections::btree_map::Entry::Vacant(free) => {
                    free.insert(column.list_array.clone());
                    is_new = true;
                }
            }
        }
        is_new
    }
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
    let mut sink: Option<(Sink, StoreId)> = None;
    let mut constants = Constants::default();
    let mut blueprint: Option<(StoreId, Vec<Chunk>)> = None;
    for path in parts {
        let mut frames = Frames::open(path).map_err(|source| ReadError::Open {
            path: path.clone(),
            source,
        })?;
        let (mut any, mut of_this_part) = (false, None::<(StoreId, Vec<Chunk>)>);
        loop {
            let (store, chunk) = match frames.next_stored() {
                Ok(Some(stored)) => stored,
                Ok(None) => break,
                Err(reason) if any => {
                    news(ReadNews::Damaged(&Damage::new(
                        path,
                        frames.place(),
                        reason,
                    )));
                    break;
                }
                Err(reason) => {
                    return Err(ReadError::NotARecording {
                        path: path.clone(),
                        reason,
                    }
                    .into());
                }
            };
            any = true;
            if store.kind() == StoreKind::Blueprint {
                of_this_part
                    .get_or_insert_with(|| (store, Vec::new()))
                    .1
                    .push(chunk);
                continue;
            }
            let (sink, known) = match &mut sink {
                Some(begun) => begun,
                none => {
                    let begun = Sink::new(Box::new(create(to)?), &store)?;
                    none.insert((begun, store.clone()))
                }
            };
            if *known != store {
                return Err(MergeError::Foreign {
                    path: path.clone(),
                    first: parts[0].clone(),
                });
            }
            if !chunk.is_static() && *chunk.entity_path() == EntityPath::from(entity::SIGNALS) {
                news(ReadNews::Rows(chunk.num_rows() as u64));
            }
            if !chunk.is_static() || constants.add(&chunk) {
                sink.send_chunk(chunk);
                sink.flush();
                sink.check()?;
            }
        }
        blueprint = of_this_part.or(blueprint);
    }
    let Some((mut sink, _)) = sink else {
        let path = parts.first().cloned().unwrap_or_default();
        return Err(ReadError::NotARecording {
            path,
            reason: "it is empty".to_owned(),
        }
        .into());
    };
    if let Some((store, chunks)) = blueprint {
        sink.send_blueprint(&store, chunks.into_iter().map(Ok));
    }
    Ok(sink.finish()?)
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
    let draft = part.with_file_name(format!(
        ".{}",
        part.file_name().unwrap_or_default().display()
    ));
    let mut is_damaged = false;
    let written = merge(std::slice::from_ref(&part.to_owned()), &draft, |news| {
        is_damaged |= matches!(news, ReadNews::Damaged(_))
    });
    let written = written.map_err(|error| match error {
        MergeError::Write(RecordError::Write { source, .. }) => RecordError::Anew { source }.into(),
        error => error,
    });
    let placed = written.and_then(|_| {
        let failed = |source| RecordError::Create {
            path: part.display().to_string(),
            source,
        };
        if is_damaged {
            Ok(())
        } else {
            std::fs::rename(&draft, part).map_err(|source| failed(source).into())
        }
    });
    if is_damaged || placed.is_err() {
        let _ = std::fs::remove_file(&draft);
    }
    placed
}
