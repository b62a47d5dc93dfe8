//! Chunks that are the same in every run of an arm, encoded beforehand: its figure, the styles of its lanes, the layouts of its views.
//!
//! To encode one costs 0.1 to 0.5 million instructions, most of them Arrow's and Rerun's for its schema, and a short run has as many such chunks as others.
//! `memory.bin` holds those of the default run as Rerun and LZ4 wrote them. They are found by what they hold and by the version of the format: a chunk that
//! is not there, of another arm or of a layout that has been changed, is encoded as ever. `cargo test --release --test system anew -- --ignored` makes the file
//! from a run's recording, and `cargo test --release --test system remembered` fails where the default run does not find nearly all in it.
//!
//! Rows that are remembered have the ids of those runs, which are older than any id made since. The latest row of a place counts, so that what comes later in a
//! recording must not be taken from here.

use std::collections::BTreeMap;
use std::hash::{Hash, Hasher};
use std::path::Path;
use std::sync::OnceLock;

use re_chunk::external::arrow::array::{Array, ArrayData};
use re_chunk::{Chunk, ChunkId, EntityPath};
use re_log_encoding::CrateVersion;
use re_log_types::StoreKind;
use re_log_types::external::re_tuid::Tuid;
use xxhash_rust::xxh3::Xxh3;

use crate::frames::Frames;
use crate::ipc::Encoder;
use crate::packer::Packer;
use crate::read::ReadError;

/// The file: the number of its chunks u64; for each its key u128, its id u128, the bytes that it has u64 and those that it takes u64; then the chunks, packed.
/// All little-endian, by the keys.
static FILE: &[u8] = include_bytes!("memory.bin");

/// Bytes of what the file says of a chunk.
const ENTRY: usize = 48;

/// A remembered chunk.
#[derive(Clone, Copy)]
pub(crate) struct Remembered {
    pub(crate) id: ChunkId,
    /// Bytes before they were packed.
    pub(crate) size: u64,
    /// The chunk, as Arrow writes it, packed by LZ4.
    pub(crate) packed: &'static [u8],
}

/// Whether a chunk is of a kind that may be remembered: one row, whose values do not change, or of a layout.
pub(crate) fn may_hold(kind: StoreKind, chunk: &Chunk) -> bool {
    chunk.num_rows() == 1 && (kind == StoreKind::Blueprint || chunk.is_static())
}

/// The remembered chunk that holds the same.
pub(crate) fn find(chunk: &Chunk) -> Option<Remembered> {
    static INDEX: OnceLock<Vec<(u128, Remembered)>> = OnceLock::new();
    let index = INDEX.get_or_init(|| read(FILE).unwrap_or_default());
    let key = key(chunk)?;
    index.binary_search_by_key(&key, |(key, _)| *key).ok().map(|at| index[at].1)
}

/// What a file of remembered chunks holds; `None` where it is none.
fn read(file: &'static [u8]) -> Option<Vec<(u128, Remembered)>> {
    let (count, rest) = file.split_first_chunk()?;
    let (entries, mut chunks) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*count)).ok()?.checked_mul(ENTRY)?)?;
    let entry = |entry: &[u8; ENTRY]| {
        let number = |at: usize| entry[at..].first_chunk().map_or(0, |bytes| u128::from_le_bytes(*bytes));
        let both = number(32);
        let (packed, behind) = chunks.split_at_checked((both >> 64) as usize)?;
        chunks = behind;
        Some((number(0), Remembered { id: ChunkId::from_tuid(Tuid::from_u128(number(16))), size: both as u64, packed }))
    };
    entries.as_chunks().0.iter().map(entry).collect()
}

/// A number for what a chunk holds, its ids left out; `None` where it is not plainly in memory from its first byte on.
fn key(chunk: &Chunk) -> Option<u128> {
    let mut hasher = Xxh3::new();
    CrateVersion::LOCAL.to_bytes().hash(&mut hasher);
    for part in chunk.entity_path().iter() {
        part.unescaped_str().hash(&mut hasher);
    }
    let mut times: Vec<_> = chunk.timelines().values().map(|column| (*column.timeline(), column.times_raw())).collect();
    times.sort_unstable_by_key(|(timeline, _)| *timeline);
    for (timeline, times) in times {
        (timeline.name().as_str(), timeline.typ(), times).hash(&mut hasher);
    }
    let mut columns: Vec<_> = chunk.components().values().collect();
    columns.sort_unstable_by_key(|column| column.descriptor.component.as_str());
    for column in columns {
        let descriptor = &column.descriptor;
        let names = [descriptor.archetype.map(|name| name.as_str()), Some(descriptor.component.as_str())];
        (names, descriptor.component_type.map(|name| name.as_str())).hash(&mut hasher);
        hash(&column.list_array.to_data(), &mut hasher)?;
    }
    Some(hasher.digest128())
}

/// Adds an array: its type, its length, and its bytes, those of what it is made of, too.
fn hash(data: &ArrayData, hasher: &mut Xxh3) -> Option<()> {
    if data.offset() != 0 {
        return None;
    }
    (data.data_type(), data.len(), data.null_count()).hash(hasher);
    if let Some(nulls) = data.nulls() {
        nulls.iter().for_each(|is_valid| hasher.write_u8(is_valid.into()));
    }
    for buffer in data.buffers() {
        buffer.len().hash(hasher);
        hasher.update(buffer.as_slice());
    }
    data.child_data().iter().try_for_each(|child| hash(child, hasher))
}

/// A file of the chunks in recordings that may be remembered.
///
/// # Errors
/// As reading the recordings.
pub fn remember(recordings: &[&Path]) -> Result<Vec<u8>, ReadError> {
    let (mut all, mut encoder, mut packer) = (BTreeMap::new(), Encoder::default(), Packer::default());
    for recording in recordings {
        for chunk in rememberable(recording)? {
            let (Some(key), mut bytes) = (key(&chunk), Vec::new()) else { continue };
            if encoder.write(&chunk, &mut bytes).is_ok()
                && let Some(packed) = packer.pack(&bytes)
            {
                all.entry(key).or_insert_with(|| (chunk.id().as_u128(), bytes.len() as u64, packed.to_vec()));
            }
        }
    }
    let mut file = (all.len() as u64).to_le_bytes().to_vec();
    for (key, (id, size, packed)) in &all {
        file.extend([key.to_le_bytes(), id.to_le_bytes()].concat());
        file.extend([size.to_le_bytes(), (packed.len() as u64).to_le_bytes()].concat());
    }
    all.values().for_each(|(.., packed)| file.extend_from_slice(packed));
    Ok(file)
}

/// How many chunks of a recording were remembered when it was made, of how many that could be.
///
/// # Errors
/// As reading it.
pub fn remembered(recording: &Path) -> Result<[usize; 2], ReadError> {
    let chunks = rememberable(recording)?;
    let ids: Vec<ChunkId> = read(FILE).unwrap_or_default().into_iter().map(|(_, chunk)| chunk.id).collect();
    Ok([chunks.iter().filter(|chunk| ids.contains(&chunk.id())).count(), chunks.len()])
}

/// The chunks of a recording that may be remembered: the first of each place.
fn rememberable(recording: &Path) -> Result<Vec<Chunk>, ReadError> {
    let path = recording.to_owned();
    let mut frames = Frames::open(recording).map_err(|source| ReadError::Open { path: path.clone(), source })?;
    let mut chunks: Vec<Chunk> = Vec::new();
    while let Some((store, chunk)) = frames.next_stored().map_err(|reason| ReadError::NotARecording { path: path.clone(), reason })? {
        let is_new = chunks.iter().all(|other| other.entity_path() != chunk.entity_path());
        // A run's properties are its own.
        let is_own = chunk.entity_path().starts_with(&EntityPath::properties());
        if is_new && !is_own && may_hold(store.kind(), &chunk) {
            chunks.push(chunk);
        }
    }
    Ok(chunks)
}

#[cfg(test)]
mod tests {
    use super::*;
    use re_chunk::external::arrow::ipc::reader::StreamReader;
    use re_chunk::{RowId, TimePoint, Timeline};
    use re_sdk_types::archetypes::{Mesh3D, TextLog};
    use re_sorbet::ChunkBatch;

    fn words(words: &str, tick: Option<i64>) -> Chunk {
        let at = tick.map_or(TimePoint::default(), |tick| TimePoint::from([(Timeline::new_sequence("blueprint"), tick)]));
        Chunk::builder("/words").with_archetype(RowId::new(), at, &TextLog::new(words)).build().expect("a chunk")
    }

    #[test]
    fn a_key_is_of_what_a_chunk_holds_and_not_of_its_ids() {
        assert_eq!(key(&words("a", Some(0))), key(&words("a", Some(0))));
        let others = [words("b", Some(0)), words("a", Some(1)), words("a", None)];
        let keys: Vec<_> = others.iter().chain([&words("a", Some(0))]).map(key).collect();
        assert!((0..4).all(|i| keys[i].is_some() && (0..i).all(|k| keys[i] != keys[k])), "{keys:?}");
    }

    #[test]
    fn a_chunk_that_has_been_written_and_read_keeps_its_key() {
        let mesh = Mesh3D::new([[1.0_f32, 2.0, 3.0]; 3]).with_vertex_normals([[0.0, 0.0, 1.0]; 3]).with_triangle_indices([[0, 1, 2]]);
        let mesh = Chunk::builder("/mesh").with_archetype(RowId::new(), TimePoint::default(), &mesh).build().expect("a chunk");
        for chunk in [words("a", Some(0)), mesh] {
            let mut bytes = Vec::new();
            Encoder::default().write(&chunk, &mut bytes).expect("written");
            let batch = StreamReader::try_new(bytes.as_slice(), None).expect("a stream").next().expect("a batch").expect("whole");
            let batch = ChunkBatch::try_from(&batch).expect("a chunk's");
            assert_eq!(key(&Chunk::from_chunk_batch(&batch).expect("a chunk")), key(&chunk));
        }
    }

    #[test]
    fn the_file_can_be_read_to_its_last_byte() {
        let chunks = read(FILE).expect("it is one");
        assert!(chunks.is_sorted_by_key(|(key, _)| *key));
        let told = 8 + chunks.iter().map(|(_, chunk)| ENTRY + chunk.packed.len()).sum::<usize>();
        assert_eq!(told, FILE.len());
        for (_, chunk) in chunks {
            let bytes = re_log_encoding::external::lz4_flex::block::decompress(chunk.packed, chunk.size as usize).expect("packed");
            assert_eq!(bytes.len() as u64, chunk.size);
        }
    }
}
