//! Rows gathered between two chunks: signals, and places over time.

use std::sync::Arc;

use glam::Affine3;
use re_sdk_types::archetypes::Transform3D;
use re_sdk_types::datatypes::Quaternion;
use rerun::external::arrow::array::{Array, ArrayRef, Float32Array, Float64Array, ListArray};
use rerun::external::arrow::buffer::OffsetBuffer;
use rerun::external::arrow::datatypes::Field;
use rerun::{ComponentDescriptor, SerializedComponentColumn};

use crate::pose::rotation;
use crate::signals::{Kept, Now, Signal, logarithm, share, short};

/// Rows of numbers, gathered.
pub(super) struct Table {
    /// Where they are recorded.
    pub(super) entity: &'static str,
    pub(super) ticks: Vec<u64>,
    columns: Vec<Column>,
}

/// One column's rows: values end to end, and how many each row has. A row without its message is an empty list, not a null: no plot draws a
/// line across it then.
struct Column {
    signal: Signal,
    values: Vec<f64>,
    lengths: Vec<usize>,
    /// Whether there has been a value, in this chunk or before.
    seen: bool,
}

impl Table {
    /// A column for each signal that is kept there. With `faults` the column of faults is written from the beginning, as empty as it may be: a viewer
    /// that follows looks for it.
    pub(super) fn of(entity: &'static str, faults: bool) -> Self {
        let column = |signal: &Signal| Column {
            signal: *signal,
            values: Vec::new(),
            lengths: Vec::new(),
            seen: faults && *signal == Signal::Fault,
        };
        let signals = Signal::ALL
            .iter()
            .filter(|signal| signal.of().kept.entity() == Some(entity));
        Self {
            entity,
            ticks: Vec::new(),
            columns: signals.map(column).collect(),
        }
    }

    pub(super) fn push(&mut self, now: &Now) {
        self.ticks.push(now.row.tick);
        for column in &mut self.columns {
            let before = column.values.len();
            (column.signal.of().take)(now, &mut column.values);
            column.lengths.push(column.values.len() - before);
        }
    }

    /// The rows gathered, as columns.
    pub(super) fn take(&mut self) -> (Vec<u64>, Vec<SerializedComponentColumn>) {
        let columns = self.columns.iter_mut().filter_map(Column::take).collect();
        (std::mem::take(&mut self.ticks), columns)
    }
}

impl Column {
    /// Its rows; none where there has never been a value.
    fn take(&mut self) -> Option<SerializedComponentColumn> {
        let lengths = std::mem::take(&mut self.lengths);
        let values = std::mem::take(&mut self.values);
        self.seen |= !values.is_empty();
        if !self.seen {
            return None;
        }
        let narrow = |narrowed: fn(f64) -> f32| -> ArrayRef {
            let values = values.iter().map(|value| narrowed(*value));
            Arc::new(Float32Array::from_iter_values(values))
        };
        let values: ArrayRef = match self.signal.of().kept {
            Kept::F64 => Arc::new(Float64Array::from(values)),
            Kept::Log(_) => narrow(logarithm),
            Kept::Drawn => narrow(share),
            Kept::Short => narrow(short),
            _ => narrow(|value| value as f32),
        };
        let field = Arc::new(Field::new_list_field(values.data_type().clone(), true));
        let list = ListArray::new(field, OffsetBuffer::from_lengths(lengths), values, None);
        let name = ComponentDescriptor::partial(self.signal.component());
        Some(SerializedComponentColumn::new(list, name))
    }
}

/// The places of an entity over time, and its sizes where they change.
#[derive(Default)]
pub(super) struct Track {
    pub(super) ticks: Vec<u64>,
    pub(super) places: Vec<Affine3>,
    pub(super) sizes: Vec<[f32; 3]>,
}

impl Track {
    pub(super) fn columns(&self) -> Vec<SerializedComponentColumn> {
        let mut transform = Transform3D::update_fields();
        if !self.places.is_empty() {
            let places = self.places.iter();
            transform = transform
                .with_many_translation(places.clone().map(|at| at.translation.to_array()))
                .with_many_quaternion(places.map(quaternion));
        }
        if !self.sizes.is_empty() {
            transform = transform.with_many_scale(self.sizes.iter().copied());
        }
        let columns = transform.columns_of_unit_batches();
        columns.map(Iterator::collect).unwrap_or_default()
    }
}

/// How something is turned.
pub(super) fn quaternion(at: &Affine3) -> Quaternion {
    Quaternion::from_xyzw(rotation(at).to_array())
}
