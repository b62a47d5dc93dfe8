//! A chunk as bytes: Arrow's stream of a schema and one batch of rows.
//!
//! The schema costs more than the rows of most chunks: each column has metadata of its own. Of chunks with the same columns the schemas differ in two texts,
//! the chunk's id and the path of its entity. So Rerun and Arrow make a schema once for all chunks with these columns, with room for a longer path than most,
//! and both texts are put into its bytes.

use std::fmt::Display;
use std::ops::Range;
use std::sync::Arc;

use re_chunk::external::arrow::array::{ArrayRef, RecordBatch, RecordBatchOptions};
use re_chunk::external::arrow::datatypes::{Field, Schema, SchemaRef};
use re_chunk::external::arrow::ipc::MetadataVersion;
use re_chunk::external::arrow::ipc::writer::{
    CompressionContext, DictionaryTracker, IpcDataGenerator, IpcWriteOptions, StreamWriter,
    write_message,
};
use re_chunk::{Chunk, ChunkComponents, TimeColumn};
use re_sdk_types::ComponentDescriptor;

/// The end of a stream of Arrow's.
const END: [u8; 8] = [0xff, 0xff, 0xff, 0xff, 0, 0, 0, 0];
/// Bytes to whose multiples buffers are filled up: the least that the format has.
const ALIGNMENT: usize = 8;
/// Bytes of the longest path that a remembered schema has room for: those of a layout's lines, the longest of all, have 120.
const ROOM: usize = 160;

/// Writes chunks, and remembers their schemas.
#[derive(Default)]
pub(crate) struct Encoder {
    known: Vec<Known>,
}

/// A schema that has been made.
struct Known {
    schema: SchemaRef,
    /// As it is written, with zeros for the path.
    bytes: Vec<u8>,
    /// Where the two texts are. Before the path is its length: what follows it, up to the end of its room, belongs to nothing.
    id: Range<usize>,
    path: Range<usize>,
    /// The columns, in the schema's order.
    is_sorted: bool,
    times: Vec<TimeColumn>,
    components: Vec<ComponentDescriptor>,
}

impl Encoder {
    /// Appends a chunk to `out`.
    pub(crate) fn write(&mut self, chunk: &Chunk, out: &mut Vec<u8>) -> Result<(), String> {
        let path = chunk.entity_path().to_string();
        let known = self
            .known
            .iter()
            .find_map(|known| Some((known, known.batch(chunk, &path)?)));
        if let Some((known, batch)) = known {
            return known.write(chunk, &path, &batch, out);
        }
        if let Some(known) = Known::of(chunk, &path)?
            && let Some(batch) = known.batch(chunk, &path)
        {
            known.write(chunk, &path, &batch, out)?;
            self.known.push(known);
            return Ok(());
        }
        let batch = chunk.to_chunk_batch().map_err(said)?;
        let mut writer =
            StreamWriter::try_new_with_options(&mut *out, batch.schema_ref(), options()?)
                .map_err(said)?;
        writer
            .write(&batch)
            .and_then(|()| writer.finish())
            .map_err(said)
    }
}

impl Known {
    /// The schema of a chunk; `None` where it has no place of its own for the two texts, or the path is too long for it.
    fn of(chunk: &Chunk, path: &str) -> Result<Option<Self>, String> {
        let batch = chunk.to_chunk_batch().map_err(said)?;
        let schema = batch.schema();
        let (mut metadata, room) = (schema.metadata().clone(), "/".repeat(ROOM));
        let mut places = metadata.values_mut().filter(|value| *value == path);
        let is_one =
            places.next().map(|place| place.clone_from(&room)).is_some() && places.next().is_none();
        let is_elsewhere =
            |field: &Arc<Field>| field.metadata().values().any(|value| value == path);
        if !is_one || path.len() > ROOM || schema.fields().iter().any(is_elsewhere) {
            return Ok(None);
        }
        let mut bytes = Vec::new();
        StreamWriter::try_new_with_options(
            &mut bytes,
            &Schema::new_with_metadata(schema.fields().clone(), metadata),
            options()?,
        )
        .map_err(said)?;
        let Some((id, place)) =
            only(&bytes, chunk.id().to_string().as_bytes()).zip(only(&bytes, room.as_bytes()))
        else {
            return Ok(None);
        };
        bytes[place.clone()].fill(0);
        let times = batch
            .index_columns()
            .filter_map(|(column, _)| chunk.timelines().get(&column.timeline_name()).cloned());
        let components = batch
            .component_columns()
            .map(|(column, _)| column.component_descriptor());
        Ok(Some(Self {
            schema,
            bytes,
            id,
            path: place,
            is_sorted: is_sorted(chunk),
            times: times
                .map(|column| {
                    TimeColumn::new(
                        Some(column.is_sorted()),
                        *column.timeline(),
                        Vec::new().into(),
                    )
                })
                .collect(),
            components: components.collect(),
        }))
    }

    /// Appends the rows of a chunk with this schema.
    fn write(
        &self,
        chunk: &Chunk,
        path: &str,
        batch: &RecordBatch,
        out: &mut Vec<u8>,
    ) -> Result<(), String> {
        let begin = out.len();
        out.extend_from_slice(&self.bytes);
        let schema = &mut out[begin..];
        schema[self.id.clone()].copy_from_slice(chunk.id().to_string().as_bytes());
        schema[self.path.start - size_of::<u32>()..self.path.start]
            .copy_from_slice(&(path.len() as u32).to_le_bytes());
        schema[self.path.start..][..path.len()].copy_from_slice(path.as_bytes());
        let (options, mut dictionaries) = (options()?, DictionaryTracker::new(false));
        let encoded = IpcDataGenerator::default().encode(
            batch,
            &mut dictionaries,
            &options,
            &mut CompressionContext::default(),
        );
        let (before, rows) = encoded.map_err(said)?;
        for message in before.into_iter().chain([rows]) {
            write_message(&mut *out, message, &options).map_err(said)?;
        }
        out.extend_from_slice(&END);
        Ok(())
    }

    /// The rows of a chunk, where this is its schema but for the two texts.
    fn batch(&self, chunk: &Chunk, path: &str) -> Option<RecordBatch> {
        let ChunkComponents(components) = chunk.components();
        let is_like = path.len() <= self.path.len()
            && components.len() == self.components.len()
            && chunk.timelines().len() == self.times.len()
            && self.components.iter().all(|one| {
                components
                    .get(&one.component)
                    .is_some_and(|column| column.descriptor == *one)
            });
        if !is_like || is_sorted(chunk) != self.is_sorted {
            return None;
        }
        let time = |known: &TimeColumn| {
            let column = chunk.timelines().get(known.timeline().name())?;
            (column.timeline() == known.timeline() && column.is_sorted() == known.is_sorted())
                .then(|| column.times_array())
        };
        let ids: ArrayRef = Arc::new(chunk.row_ids_array().clone());
        let times = self.times.iter().map(time);
        let values = self.components.iter().map(|one| {
            Some(Arc::new(components.get(&one.component)?.list_array.clone()) as ArrayRef)
        });
        let columns = std::iter::once(Some(ids))
            .chain(times)
            .chain(values)
            .collect::<Option<Vec<_>>>()?;
        // It refuses columns of other types than the schema's.
        RecordBatch::try_new_with_options(
            Arc::clone(&self.schema),
            columns,
            &RecordBatchOptions::default(),
        )
        .ok()
    }
}

/// Whether its rows are in the order of their ids, which its schema says.
fn is_sorted(chunk: &Chunk) -> bool {
    chunk.is_row_ids_sorted()
}

/// Where a text stands among bytes, if it stands there once.
fn only(bytes: &[u8], text: &[u8]) -> Option<Range<usize>> {
    let is_text = |window: &[u8]| window.first() == text.first() && window == text;
    let mut places = bytes
        .windows(text.len().max(1))
        .enumerate()
        .filter(|(_, window)| is_text(window))
        .map(|(at, _)| at);
    let at = places.next().filter(|_| places.next().is_none())?;
    Some(at..at + text.len())
}

fn options() -> Result<IpcWriteOptions, String> {
    IpcWriteOptions::try_new(ALIGNMENT, false, MetadataVersion::V5).map_err(said)
}

fn said(error: impl Display) -> String {
    error.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use re_chunk::external::arrow::ipc::reader::StreamReader;
    use re_chunk::{RowId, TimePoint, Timeline};
    use re_sdk_types::archetypes::{Points3D, TextLog};

    fn at(tick: i64) -> TimePoint {
        TimePoint::from([(Timeline::new_sequence("tick"), tick)])
    }

    #[test]
    fn a_remembered_schema_gives_the_chunk_that_rerun_gives() {
        let words = |path: &str, time| {
            Chunk::builder(path)
                .with_archetype(RowId::new(), time, &TextLog::new(path))
                .build()
        };
        let points = |path: &str, rows: i64| {
            let points = |k: i64| Points3D::new([[k as f32; 3]]).with_labels([path]);
            (0..rows)
                .fold(Chunk::builder(path), |chunk, k| {
                    chunk.with_archetype(RowId::new(), at(k), &points(k))
                })
                .build()
        };
        let chunks = [
            words("/of/words", at(1)),
            words("/of/other", at(2)),
            words("/of/words", TimePoint::default()),
            words("/of/longer_words", at(1)),
            words(&format!("/of/{}", "very_".repeat(ROOM / 5)), at(1)),
            points("/some/points", 3),
            points("/more/points", 7),
            points("/some/points", 1),
        ];
        let mut encoder = Encoder::default();
        for chunk in chunks {
            let (chunk, mut bytes) = (chunk.expect("a chunk"), vec![7; 3]);
            encoder.write(&chunk, &mut bytes).expect("written");
            let read: Vec<_> = StreamReader::try_new(&bytes[3..], None)
                .expect("a stream")
                .map(|batch| batch.expect("a batch"))
                .collect();
            let expected: RecordBatch = chunk.to_record_batch().expect("a batch");
            assert_eq!(read, [expected], "{}", chunk.entity_path());
        }
        assert_eq!(
            encoder.known.len(),
            3,
            "of words with and without a time, and of points"
        );
    }
}
