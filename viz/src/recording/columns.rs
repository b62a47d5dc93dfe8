//! Rows gathered between two chunks: signals, and places over time.

use glam::Vec3;
use re_chunk::external::arrow::array::{ArrayRef, Float32Array, Float64Array, ListArray};
use re_chunk::external::arrow::buffer::{OffsetBuffer, ScalarBuffer};
use re_chunk::external::arrow::datatypes::Field;
use re_sdk_types::SerializedComponentColumn;
use re_sdk_types::archetypes::Transform3D;
use re_sdk_types::datatypes::Quaternion;

use super::pieces::custom;
use crate::scene::{Mark, Presence, rotation};
use crate::signals::{SHARES, Signal, Width};
use crate::solid::Placement;

/// Rows of signals, gathered.
#[derive(Default)]
pub(super) struct Table {
    pub(super) ticks: Vec<u64>,
    pub(super) columns: Vec<Column>,
}

/// One signal's rows: values end to end, and where each row ends. A row without its message is an empty list, not a null: no plot draws a
/// line across it then.
pub(super) struct Column {
    pub(super) signal: Signal,
    pub(super) wide: Vec<f64>,
    pub(super) narrow: Vec<f32>,
    pub(super) ends: Vec<i32>,
    /// Whether there has been a value, in this chunk or before.
    pub(super) seen: bool,
}

impl Table {
    pub(super) fn rows(&self) -> usize {
        self.ticks.len()
    }

    pub(super) fn push(&mut self, tick: u64, fill: impl FnOnce(&mut dyn FnMut(Signal, &mut dyn Iterator<Item = f64>))) {
        if self.columns.is_empty() {
            self.columns = Signal::ALL.iter().map(|signal| Column::new(*signal)).collect();
        }
        self.ticks.push(tick);
        let columns = &mut self.columns;
        fill(&mut |signal, values| {
            let column = &mut columns[signal as usize];
            match signal.width() {
                Width::F64 => column.wide.extend(values),
                Width::F32 => column.narrow.extend(values.map(|value| value as f32)),
                Width::Share => column.narrow.extend(values.map(|value| (value * SHARES).round() as f32 / SHARES as f32)),
            }
        });
        for column in columns {
            let (end, before) = ((column.wide.len() + column.narrow.len()) as i32, column.ends.last().copied().unwrap_or(0));
            column.seen |= end > before;
            column.ends.push(end);
        }
    }

    /// The rows gathered, as columns; `None` where there are none.
    pub(super) fn take(&mut self) -> Option<(Vec<u64>, Vec<SerializedComponentColumn>)> {
        if self.ticks.is_empty() {
            return None;
        }
        let ticks = std::mem::take(&mut self.ticks);
        let columns = self.columns.iter_mut().filter_map(|column| {
            let next = Column { seen: column.seen, ..Column::new(column.signal) };
            std::mem::replace(column, next).build()
        });
        Some((ticks, columns.collect()))
    }
}

impl Column {
    pub(super) fn new(signal: Signal) -> Self {
        Self { signal, wide: Vec::new(), narrow: Vec::new(), ends: vec![0], seen: false }
    }

    pub(super) fn build(self) -> Option<SerializedComponentColumn> {
        if !self.seen {
            return None;
        }
        let values: ArrayRef = match self.signal.width() {
            Width::F64 => std::sync::Arc::new(Float64Array::from(self.wide)),
            Width::F32 | Width::Share => std::sync::Arc::new(Float32Array::from(self.narrow)),
        };
        let field = std::sync::Arc::new(Field::new_list_field(values.data_type().clone(), true));
        let list = ListArray::new(field, OffsetBuffer::new(ScalarBuffer::from(self.ends)), values, None);
        Some(SerializedComponentColumn::new(list, custom(self.signal.name(), None)))
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

    pub(super) fn columns(self) -> Vec<SerializedComponentColumn> {
        let mut transform = Transform3D::update_fields();
        if !self.translations.is_empty() {
            let quaternions = self.quaternions.into_iter().map(Quaternion::from_xyzw);
            transform = transform.with_many_translation(self.translations).with_many_quaternion(quaternions);
        }
        if !self.sizes.is_empty() {
            transform = transform.with_many_scale(self.sizes);
        }
        transform.columns_of_unit_batches().map(Iterator::collect).unwrap_or_default()
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

    /// `unit`: the size of the mark of a singularity the arm is in; m.
    pub(super) fn push(
        &mut self,
        tick: u64,
        links: &[Placement],
        hand: &Placement,
        desired: Option<&Placement>,
        marks: &[Mark],
        unit: f32,
    ) {
        self.links.resize_with(links.len(), Track::default);
        for (track, at) in self.links.iter_mut().zip(links) {
            track.push(tick, at);
        }
        self.hand.push(tick, hand);
        self.actual.push((tick, hand.p));
        if let Some(desired) = desired {
            self.target.push(tick, desired);
            self.desired.push((tick, desired.p));
        }
        self.marks.resize_with(self.marks.len().max(marks.len()), Default::default);
        for (tracks, mark) in self.marks.iter_mut().zip(marks) {
            // Hidden entities need no pose.
            if mark.look.presence != Presence::Hidden {
                tracks.frame.push(tick, &mark.X_BS);
                tracks.size.ticks.push(tick);
                tracks.size.sizes.push([unit * mark.size; 3]);
            }
            if mark.look.presence == Presence::Inside {
                tracks.label.push(tick, &Placement { p: mark.X_BS.p + Vec3::Z * (1.25 * unit), ..Placement::IDENTITY });
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
