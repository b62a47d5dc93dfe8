//! The table of contents at the end of a recording's file: a row for each chunk, three columns for each component on each time line.
//!
//! The same as Rerun's builder makes, which parses every batch for what the chunk says itself, and fills up every column after each chunk.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use re_chunk::external::arrow::array::{
    Array, ArrayRef, BooleanArray, RecordBatch, StringArray, UInt64Array,
};
use re_chunk::external::arrow::datatypes::{DataType, Field, Schema};
use re_chunk::external::arrow::error::ArrowError;
use re_chunk::{Chunk, ChunkId, EntityPath, Span, Timeline};
use re_log_encoding::{CodecError, CodecResult, RawRrdManifest};
use re_log_types::{AbsoluteTimeRange, StoreId, TimeInt};
use re_sdk_types::archetypes::Clear;
use re_sdk_types::{Archetype, ComponentBatch, ComponentDescriptor};
use re_sorbet::{
    BatchType, ComponentColumnDescriptor, IndexColumnDescriptor, RowIdColumnDescriptor,
};

/// The chunks of a recording.
#[derive(Default)]
pub(crate) struct Contents {
    chunks: Vec<Entry>,
    /// The part of each component, over the time lines.
    components: BTreeMap<ComponentDescriptor, Component>,
    /// The columns of a table of the whole recording, by entity: it orders them at its end, for to compare two paths costs more than all else here.
    columns: HashMap<EntityPath, BTreeMap<ComponentDescriptor, Column>>,
}

/// A chunk.
struct Entry {
    path: EntityPath,
    id: ChunkId,
    rows: u64,
    is_static: bool,
    place: Span<u64>,
    /// Bytes before they were packed.
    size: u64,
    times: Vec<(Timeline, [TimeInt; 2])>,
}

#[derive(Default)]
struct Component {
    /// The static chunks that have it.
    in_static: Vec<usize>,
    /// The others on each time line: first and last time, and rows.
    on: BTreeMap<Timeline, Vec<(usize, [TimeInt; 2], u64)>>,
}

struct Column {
    datatype: DataType,
    is_static: bool,
    is_empty: bool,
}

impl Contents {
    /// Enters a chunk, which has its place in the file, without its header, and had a size before it was packed; bytes.
    pub(crate) fn enter(&mut self, chunk: &Chunk, place: Span<u64>, size: u64) {
        let number = self.chunks.len();
        let mut times = Vec::new();
        for column in chunk.timelines().values() {
            times.push((*column.timeline(), bounds(column.time_range())));
            for (component, range) in column.time_range_per_component(chunk.components()) {
                let Some(one) = chunk.components().get(component) else {
                    continue;
                };
                let rows = one.list_array.len() - one.list_array.null_count();
                let on = &mut self
                    .components
                    .entry(one.descriptor.clone())
                    .or_default()
                    .on;
                on.entry(*column.timeline()).or_default().push((
                    number,
                    bounds(range),
                    rows as u64,
                ));
            }
        }
        let columns = self.columns.entry(chunk.entity_path().clone()).or_default();
        for one in chunk.components().values() {
            if chunk.is_static() {
                self.components
                    .entry(one.descriptor.clone())
                    .or_default()
                    .in_static
                    .push(number);
            }
            let is_empty = one.list_array.values().is_empty();
            let column = columns
                .entry(one.descriptor.clone())
                .or_insert_with(|| Column {
                    datatype: one.list_array.data_type().clone(),
                    is_static: false,
                    is_empty,
                });
            column.is_static |= chunk.is_static();
            column.is_empty &= is_empty;
        }
        self.chunks.push(Entry {
            path: chunk.entity_path().clone(),
            id: chunk.id(),
            rows: chunk.num_rows() as u64,
            is_static: chunk.is_static(),
            place,
            size,
            times,
        });
    }

    /// The table.
    pub(crate) fn build(&self, store_id: StoreId) -> CodecResult<RawRrdManifest> {
        let sorbet_schema = Schema::new(self.schema());
        let sorbet_schema_sha256 = RawRrdManifest::compute_sorbet_schema_sha256(&sorbet_schema)
            .map_err(CodecError::ArrowSerialization)?;
        let (fields, columns): (Vec<Field>, Vec<ArrayRef>) = self.table()?.into_iter().unzip();
        let data = RecordBatch::try_new(Arc::new(Schema::new(fields)), columns)
            .map_err(CodecError::ArrowSerialization)?;
        Ok(RawRrdManifest {
            store_id,
            sorbet_schema,
            sorbet_schema_sha256,
            data,
        })
    }

    /// The columns of a table of the whole recording.
    fn schema(&self) -> Vec<Field> {
        let mut timelines: Vec<Timeline> = self
            .chunks
            .iter()
            .flat_map(|chunk| &chunk.times)
            .map(|(timeline, _)| *timeline)
            .collect();
        timelines.sort_unstable();
        timelines.dedup();
        let index =
            |timeline| IndexColumnDescriptor::from_timeline(timeline, false).to_arrow_field();
        let clears = Clear::all_components();
        let component = |path: &EntityPath, descriptor: &ComponentDescriptor, column: &Column| {
            let ComponentDescriptor {
                archetype,
                component,
                component_type,
            } = *descriptor;
            let described = ComponentColumnDescriptor {
                store_datatype: column.datatype.clone(),
                entity_path: path.clone(),
                archetype,
                component,
                component_type,
                is_static: column.is_static,
                is_tombstone: clears.contains(descriptor),
                is_semantically_empty: column.is_empty,
            };
            described.to_arrow_field(BatchType::Dataframe)
        };
        let mut columns: Vec<_> = self.columns.iter().collect();
        columns.sort_unstable_by_key(|(path, _)| *path);
        let columns = columns.into_iter().flat_map(|(path, columns)| {
            columns
                .iter()
                .map(move |(descriptor, column)| (path, descriptor, column))
        });
        let rows = RowIdColumnDescriptor { is_sorted: false }.to_arrow_field();
        let own = (!self.chunks.is_empty()).then_some(rows).into_iter();
        own.chain(timelines.into_iter().map(index))
            .chain(columns.map(|(path, descriptor, column)| component(path, descriptor, column)))
            .collect()
    }

    /// The table's columns.
    fn table(&self) -> CodecResult<Vec<(Field, ArrayRef)>> {
        let numbers = |of: fn(&Entry) -> u64| {
            Arc::new(self.chunks.iter().map(of).collect::<UInt64Array>()) as ArrayRef
        };
        let ids = self
            .chunks
            .iter()
            .map(|chunk| chunk.id)
            .collect::<Vec<_>>()
            .to_arrow();
        let ids = ids.map_err(|error| {
            CodecError::ArrowSerialization(ArrowError::ExternalError(Box::new(error)))
        })?;
        let paths =
            StringArray::from_iter_values(self.chunks.iter().map(|chunk| chunk.path.to_string()));
        let are_static: BooleanArray = self
            .chunks
            .iter()
            .map(|chunk| Some(chunk.is_static))
            .collect();
        let mut table: Vec<(Field, ArrayRef)> = vec![
            (RawRrdManifest::field_chunk_entity_path(), Arc::new(paths)),
            (RawRrdManifest::field_chunk_id(), ids),
            (
                RawRrdManifest::field_chunk_is_static(),
                Arc::new(are_static),
            ),
            (
                RawRrdManifest::field_chunk_num_rows(),
                numbers(|chunk| chunk.rows),
            ),
            (
                RawRrdManifest::field_chunk_byte_offset(),
                numbers(|chunk| chunk.place.start),
            ),
            (
                RawRrdManifest::field_chunk_byte_size(),
                numbers(|chunk| chunk.place.len),
            ),
            (
                RawRrdManifest::field_chunk_byte_size_uncompressed(),
                numbers(|chunk| chunk.size),
            ),
        ];
        let count = self.chunks.len();
        for (descriptor, component) in &self.components {
            let mut has = vec![false; count];
            component
                .in_static
                .iter()
                .for_each(|number| has[*number] = true);
            table.push((
                RawRrdManifest::field_has_static_data(descriptor),
                Arc::new(BooleanArray::from(has)),
            ));
        }
        // As Rerun orders them: the time lines by their names.
        let mut lines: BTreeMap<&str, (Timeline, Vec<[TimeInt; 2]>)> = BTreeMap::new();
        for (number, chunk) in self.chunks.iter().enumerate() {
            for (timeline, range) in &chunk.times {
                let line = lines
                    .entry(timeline.name().as_str())
                    .or_insert_with(|| (*timeline, vec![[TimeInt::STATIC; 2]; count]));
                line.1[number] = *range;
            }
        }
        for (timeline, ranges) in lines.values() {
            table.push((
                RawRrdManifest::field_index_start(timeline, None),
                times(timeline, ranges, 0),
            ));
            table.push((
                RawRrdManifest::field_index_end(timeline, None),
                times(timeline, ranges, 1),
            ));
        }
        for (timeline, _) in lines.values() {
            for (descriptor, component) in &self.components {
                let Some(chunks) = component.on.get(timeline) else {
                    continue;
                };
                let (mut ranges, mut rows) = (vec![[TimeInt::STATIC; 2]; count], vec![0; count]);
                chunks.iter().for_each(|(number, range, of)| {
                    (ranges[*number], rows[*number]) = (*range, *of)
                });
                let of = Some(descriptor);
                table.push((
                    RawRrdManifest::field_index_start(timeline, of),
                    times(timeline, &ranges, 0),
                ));
                table.push((
                    RawRrdManifest::field_index_end(timeline, of),
                    times(timeline, &ranges, 1),
                ));
                table.push((
                    RawRrdManifest::field_index_num_rows(timeline, of),
                    Arc::new(UInt64Array::from(rows)),
                ));
            }
        }
        Ok(table)
    }
}

/// First and last time; of no rows neither.
fn bounds(range: AbsoluteTimeRange) -> [TimeInt; 2] {
    if range == AbsoluteTimeRange::EMPTY {
        [TimeInt::STATIC; 2]
    } else {
        [range.min(), range.max()]
    }
}

fn times(timeline: &Timeline, ranges: &[[TimeInt; 2]], which: usize) -> ArrayRef {
    timeline
        .typ()
        .make_arrow_array_from_time_ints(ranges.iter().map(|range| range[which]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use re_chunk::{RowId, TimePoint};
    use re_log_encoding::RrdManifestBuilder;
    use re_log_types::StoreKind;
    use re_sdk_types::archetypes::{Mesh3D, Points3D, TextLog};

    /// The fields of a schema, in an order that does not depend on a hash map's.
    fn sorted(schema: &Schema) -> Vec<Field> {
        let mut fields: Vec<Field> = schema
            .fields()
            .iter()
            .map(|field| field.as_ref().clone())
            .collect();
        fields.sort();
        fields
    }

    #[test]
    fn the_table_is_the_one_that_rerun_builds() {
        let at = |tick: i64| {
            TimePoint::from([
                (Timeline::new_sequence("tick"), tick),
                (Timeline::new_duration("t"), 1_000_000 * tick),
            ])
        };
        let chunk = |path: &str| Chunk::builder(path);
        let row = RowId::new;
        let chunks = [
            chunk("/log")
                .with_archetype(row(), at(3), &TextLog::new("a"))
                .with_archetype(row(), at(9), &TextLog::new("b")),
            // A component that only some rows have, and one that is empty.
            chunk("/points")
                .with_archetype(row(), at(1), &Points3D::new([[0.0; 3]]))
                .with_archetype(row(), at(2), &Points3D::new([[1.0; 3]]).with_labels(["x"]))
                .with_archetype(
                    row(),
                    at(5),
                    &Points3D::new([[1.0; 3]]).with_radii(Vec::<f32>::new()),
                ),
            chunk("/mesh").with_archetype(row(), TimePoint::default(), &Mesh3D::new([[0.0; 3]; 3])),
            chunk("/mesh").with_archetype(
                row(),
                at(4),
                &Mesh3D::update_fields().with_albedo_factor(0xff00_00ff),
            ),
            chunk("/points").with_archetype(row(), at(8), &Clear::flat()),
            chunk("/log").with_archetype(row(), at(12), &TextLog::new("c")),
            chunk("/__properties/run").with_archetype(
                row(),
                TimePoint::default(),
                &TextLog::new("property"),
            ),
            chunk("/line").with_archetype(
                row(),
                [(Timeline::new_sequence("blueprint"), 0)],
                &TextLog::new("one line alone"),
            ),
        ];
        let (mut contents, mut expected) = (Contents::default(), RrdManifestBuilder::default());
        for (number, chunk) in (0..).zip(chunks) {
            let (chunk, place) = (
                chunk.build().expect("a chunk"),
                Span {
                    start: 1000 * number,
                    len: 700 + number,
                },
            );
            contents.enter(&chunk, place, 2000 + number);
            expected
                .append(
                    &chunk.to_chunk_batch().expect("a batch"),
                    place,
                    2000 + number,
                )
                .expect("entered");
        }
        let store = || StoreId::new(StoreKind::Recording, "armplane-test", "run");
        let (found, expected) = (
            contents.build(store()).expect("a table"),
            expected.build(store()).expect("a table"),
        );
        found.sanity_check_heavy().expect("whole");
        assert_eq!(found.data, expected.data);
        assert_eq!(
            sorted(&found.sorbet_schema),
            sorted(&expected.sorbet_schema)
        );
        assert_eq!(found.sorbet_schema_sha256, expected.sorbet_schema_sha256);
        Contents::default()
            .build(store())
            .expect("a table of nothing");
    }
}
