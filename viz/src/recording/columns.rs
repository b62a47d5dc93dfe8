//! Rows gathered between two chunks: signals, and places over time.

use std::sync::Arc;

use glam::Vec3;
use re_chunk::external::arrow::array::{Array, ArrayRef, Float32Array, Float64Array, ListArray};
use re_chunk::external::arrow::buffer::OffsetBuffer;
use re_chunk::external::arrow::datatypes::Field;
use re_sdk_types::archetypes::Transform3D;
use re_sdk_types::datatypes::Quaternion;
use re_sdk_types::{ComponentDescriptor, SerializedComponentColumn};

use crate::scene::{Mark, Presence, rotation};
use crate::signals::{Drawn, Signal, Width, logarithm, share};
use crate::solid::Placement;

/// The form in which a column's values are written.
#[derive(Clone, Copy)]
pub(super) enum Encoding {
    F64,
    F32,
    Log,
    /// In steps of 1 / [`SHARES`].
    Share,
}

/// Rows of numbers, gathered.
pub(super) struct Table {
    pub(super) ticks: Vec<u64>,
    /// `None` for what is not recorded.
    columns: Vec<Option<Column>>,
}

/// One column's rows: values end to end, and where each row ends. A row without its message is an empty list, not a null: no plot draws a
/// line across it then.
struct Column {
    name: &'static str,
    encoding: Encoding,
    values: Vec<f64>,
    ends: Vec<i32>,
    /// Whether there has been a value, in this chunk or before.
    seen: bool,
}

impl Table {
    /// A column for each signal that is recorded.
    pub(super) fn of_signals() -> Self {
        let encoding = |signal: &Signal| match signal.width() {
            Width::F64 => Some(Encoding::F64),
            Width::F32 => Some(Encoding::F32),
            Width::Log => Some(Encoding::Log),
            Width::Slow | Width::Derived => None,
        };
        let columns = Signal::ALL.iter().map(|signal| {
            encoding(signal).map(|encoding| Column::new(signal.component(), encoding))
        });
        Self {
            ticks: Vec::new(),
            columns: columns.collect(),
        }
    }

    /// A column for each thing that is only drawn, then for each signal at the same rate, by its place behind them.
    ///
    /// With `faults` the column of faults is written from the beginning, as empty as it may be: a viewer that follows looks for it.
    pub(super) fn of_drawn(faults: bool) -> Self {
        let slow = |signal: &Signal| {
            (signal.width() == Width::Slow).then(|| Column::new(signal.component(), Encoding::F32))
        };
        let columns = Drawn::ALL
            .iter()
            .map(|drawn| Some(Column::new(drawn.component(), Encoding::Share)))
            .chain(Signal::ALL.iter().map(slow));
        let mut columns: Vec<Option<Column>> = columns.collect();
        columns[Drawn::Fault as usize]
            .iter_mut()
            .for_each(|column| column.seen = faults);
        Self {
            ticks: Vec::new(),
            columns,
        }
    }

    pub(super) fn rows(&self) -> usize {
        self.ticks.len()
    }

    /// Adds a row; `fill` gives the values of a column by its place.
    pub(super) fn push(&mut self, tick: u64, fill: impl FnOnce(&mut dyn FnMut(usize, &[f64]))) {
        self.ticks.push(tick);
        let columns = &mut self.columns;
        fill(&mut |place, values| {
            if let Some(column) = &mut columns[place] {
                column.values.extend_from_slice(values);
            }
        });
        for column in columns.iter_mut().flatten() {
            column.seen |= column.values.len() as i32 > column.ends[column.ends.len() - 1];
            column.ends.push(column.values.len() as i32);
        }
    }

    /// The rows gathered, as columns; `None` where there are none.
    pub(super) fn take(&mut self) -> Option<(Vec<u64>, Vec<SerializedComponentColumn>)> {
        if self.ticks.is_empty() {
            return None;
        }
        let ticks = std::mem::take(&mut self.ticks);
        let columns = self.columns.iter_mut().flatten();
        Some((ticks, columns.filter_map(Column::take).collect()))
    }
}

impl Column {
    fn new(name: &'static str, encoding: Encoding) -> Self {
        Self {
            name,
            encoding,
            values: Vec::new(),
            ends: vec![0],
            seen: false,
        }
    }

    /// Its rows; none where there has never been a value.
    fn take(&mut self) -> Option<SerializedComponentColumn> {
        let ends = std::mem::replace(&mut self.ends, vec![0]);
        let values = std::mem::take(&mut self.values);
        if !self.seen {
            return None;
        }
        let narrow = |narrowed: fn(f64) -> f32| -> ArrayRef {
            let values = values.iter().map(|value| narrowed(*value));
            Arc::new(Float32Array::from_iter_values(values))
        };
        let values = match self.encoding {
            Encoding::F32 => narrow(|value| value as f32),
            Encoding::Log => narrow(logarithm),
            Encoding::Share => narrow(share),
            Encoding::F64 => Arc::new(Float64Array::from(values)),
        };
        let field = Arc::new(Field::new_list_field(values.data_type().clone(), true));
        let list = ListArray::new(field, OffsetBuffer::new(ends.into()), values, None);
        let name = ComponentDescriptor::partial(self.name);
        Some(SerializedComponentColumn::new(list, name))
    }
}

/// Places over time.
#[derive(Default)]
pub(super) struct Track {
    pub(super) ticks: Vec<u64>,
    pub(super) translations: Vec<[f32; 3]>,
    pub(super) quaternions: Vec<[f32; 4]>,
    /// Empty for what never changes its size.
    pub(super) sizes: Vec<[f32; 3]>,
}

impl Track {
    pub(super) fn push(&mut self, tick: u64, at: &Placement) {
        self.ticks.push(tick);
        self.translations.push(at.p.to_array());
        self.quaternions.push(rotation(at).to_array());
    }

    pub(super) fn columns(&self) -> Vec<SerializedComponentColumn> {
        let mut transform = Transform3D::update_fields();
        if !self.translations.is_empty() {
            let turns = self.quaternions.iter().copied().map(Quaternion::from_xyzw);
            transform = transform
                .with_many_translation(self.translations.iter().copied())
                .with_many_quaternion(turns);
        }
        if !self.sizes.is_empty() {
            transform = transform.with_many_scale(self.sizes.iter().copied());
        }
        let columns = transform.columns_of_unit_batches();
        columns.map(Iterator::collect).unwrap_or_default()
    }
}

/// A singularity's frame at C, the size of its mark there, and the words above it.
#[derive(Default)]
pub(super) struct MarkTracks {
    pub(super) frame: Track,
    pub(super) size: Track,
    pub(super) label: Track,
}

/// Values since the last chunk.
#[derive(Default)]
pub(super) struct Picture {
    pub(super) links: Vec<Track>,
    pub(super) hand: Track,
    pub(super) target: Track,
    /// Of each singularity.
    pub(super) marks: Vec<MarkTracks>,
    /// Ellipsoids of velocity and mobility.
    pub(super) abilities: [Track; 2],
    /// The paths' points; the last of a chunk is the first of the next.
    pub(super) actual: Vec<(u64, Vec3)>,
    pub(super) desired: Vec<(u64, Vec3)>,
}

impl Picture {
    pub(super) fn rows(&self) -> usize {
        self.hand.ticks.len()
    }

    /// `unit`: the size of the mark of a singularity the arm is in; m. `sides`: on which side of its axis each label is.
    pub(super) fn push(
        &mut self,
        tick: u64,
        links: &[Placement],
        [hand, desired]: [Option<&Placement>; 2],
        marks: &[Mark],
        unit: f32,
        sides: &[f32],
    ) {
        self.links.resize_with(links.len(), Track::default);
        for (track, at) in self.links.iter_mut().zip(links) {
            track.push(tick, at);
        }
        if let Some(hand) = hand {
            self.hand.push(tick, hand);
            self.actual.push((tick, hand.p));
        }
        if let Some(desired) = desired {
            self.target.push(tick, desired);
            self.desired.push((tick, desired.p));
        }
        self.marks
            .resize_with(self.marks.len().max(marks.len()), Default::default);
        let mut labels = 0.0;
        for ((tracks, mark), side) in self.marks.iter_mut().zip(marks).zip(sides) {
            // Hidden entities need no pose.
            if mark.look.presence != Presence::Hidden {
                tracks.frame.push(tick, &mark.X_BS);
                tracks.size.ticks.push(tick);
                tracks.size.sizes.push([unit * mark.size; 3]);
            }
            if mark.look.presence == Presence::Inside {
                // Each below the one before: seen from far they would overlap.
                let below = Vec3::NEG_Z * (0.75 * unit * labels);
                labels += 1.0;
                // Beside the end of its axis: above it, or below where the axis points down; nearer to C, and higher, the more it lies: words
                // are wide, and hang from their place.
                let zeta = mark.zeta();
                let end = zeta * (side * (0.85 + 0.2 * zeta.z.abs()) * unit);
                let above = 0.25 + 0.45 * (1.0 - zeta.z.abs());
                let aside = Vec3::Z
                    * (if end.z < -0.3 * unit {
                        -0.25 * unit
                    } else {
                        above * unit
                    });
                tracks.label.push(
                    tick,
                    &Placement {
                        p: mark.X_BS.p + end + aside + below,
                        ..Placement::IDENTITY
                    },
                );
            }
        }
    }

    pub(super) fn take(&mut self) -> Option<Self> {
        if self.rows() == 0 {
            return None;
        }
        let mut next = Self::default();
        next.actual.extend(self.actual.last());
        next.desired.extend(self.desired.last());
        Some(std::mem::replace(self, next))
    }
}
