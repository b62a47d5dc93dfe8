//! The columns of the wide table, which all formats share.

use std::sync::Arc;

use re_chunk::external::arrow::array::{ArrayRef, Float32Array, Float64Array, Int64Array};
use re_chunk::external::arrow::datatypes::{DataType, Field, Schema};

use crate::read::{About, Rows};
use crate::signals::{Elements, Kept, Limits, Now, Signal, TickRow};

/// A quantity: successive columns.
struct Quantity {
    signal: Signal,
    /// Its columns, after tick and time.
    columns: std::ops::Range<usize>,
    /// The last row's values, for a quaternion: its sign is continuous.
    last: Vec<f64>,
}

/// The columns of the wide table, each `group.quantity.element`: `joint.q.1`, `singularity.s.wrist`; plain ASCII.
pub(super) struct Columns {
    quantities: Vec<Quantity>,
    /// After tick and time: whether each has 64 bits.
    are_wide: Vec<bool>,
    rate_hz: f64,
    /// As many as the arm has joints.
    limits: Limits,
}

impl Columns {
    /// Those of a recording, and with its messages those that come from them, of a steered run (`Some(true)`) or another.
    pub(super) fn new(about: &About, messages: Option<bool>) -> (Self, Schema) {
        let mut columns = Self {
            quantities: Vec::new(),
            are_wide: Vec::new(),
            rate_hz: about.rate_hz(),
            limits: Limits {
                speed: vec![1.0; about.joints],
                ..Limits::default()
            },
        };
        let units = about.properties.get("joint_units");
        let units: Vec<_> = units.iter().flat_map(|all| all.split(' ')).collect();
        let mut fields = vec![
            field("tick", "1", "Tick of the run", DataType::Int64, false),
            field(
                "t_s",
                "s",
                "Time since the first tick",
                DataType::Float64,
                false,
            ),
        ];
        for signal in Signal::ALL.iter().copied() {
            let of = signal.of();
            let has_message =
                messages.is_some_and(|is_steered| is_steered || !of.name.starts_with("servo:"));
            if of.kept == Kept::Drawn || (of.kept == Kept::Message && !has_message) {
                continue;
            }
            let (is_wide, kind) = match of.kept {
                Kept::F64 | Kept::Message => (true, DataType::Float64),
                _ => (false, DataType::Float32),
            };
            let elements = signal.elements(about.joints, &about.singularities);
            for (i, element) in elements.iter().enumerate() {
                // A heading that every tool takes: `hop sensor` is `hop_sensor`.
                let element = element.replace(|c: char| !c.is_ascii_graphic(), "_");
                let name = format!("{}.{element}", of.name.replace(':', "."));
                let does_slide = of.elements == Elements::Joints && units.get(i) == Some(&"m");
                let unit = if does_slide {
                    sliding(of.unit)
                } else {
                    of.unit
                };
                let name = name.trim_end_matches('.');
                fields.push(field(name, unit, signal.about(), kind.clone(), true));
            }
            let first = columns.are_wide.len();
            columns.are_wide.resize(first + elements.len(), is_wide);
            columns.quantities.push(Quantity {
                signal,
                columns: first..columns.are_wide.len(),
                last: Vec::new(),
            });
        }
        let run = about.properties.clone().into_iter().collect();
        (columns, Schema::new_with_metadata(fields, run))
    }

    /// The columns of recorded rows; `messages` gives those of a tick, asked in ascending order.
    pub(super) fn of(
        &mut self,
        rows: &Rows,
        mut messages: impl FnMut(u64, &mut dyn FnMut(&TickRow<'_>)),
    ) -> Vec<ArrayRef> {
        let (width, count) = (self.are_wide.len(), rows.ticks.len());
        let mut table: Vec<Option<f64>> = vec![None; count * width];
        let (mut values, limits) = (Vec::new(), &self.limits);
        for (row, tick) in rows.ticks.iter().enumerate() {
            let out = &mut table[row * width..(row + 1) * width];
            let mut put = |one: &mut Quantity, message: Option<&TickRow>| {
                let of = one.signal.of();
                values.clear();
                match message {
                    None => rows.values(one.signal, row, &mut values),
                    Some(message) => (of.take)(&Now::new(message, limits, None), &mut values),
                }
                if of.elements == Elements::Quaternion && !values.is_empty() {
                    let products = one.last.iter().zip(&values).map(|(a, b)| a * b);
                    if products.sum::<f64>() < 0.0 {
                        values.iter_mut().for_each(|x| *x = -*x);
                    }
                    one.last.clone_from(&values);
                }
                let to = out[one.columns.clone()].iter_mut();
                to.zip(&values).for_each(|(to, value)| *to = Some(*value));
            };
            let is_message = |one: &&mut Quantity| one.signal.of().kept == Kept::Message;
            let quantities = &mut self.quantities;
            let recorded = quantities.iter_mut().filter(|one| !is_message(one));
            recorded.for_each(|one| put(one, None));
            messages(*tick, &mut |message| {
                let told = quantities.iter_mut().filter(is_message);
                told.for_each(|one| put(one, Some(message)));
            });
        }
        let ticks = rows.ticks.iter();
        let times = ticks.clone().map(|tick| *tick as f64 / self.rate_hz);
        let mut columns: Vec<ArrayRef> = vec![
            Arc::new(Int64Array::from_iter_values(ticks.map(|tick| *tick as i64))),
            Arc::new(Float64Array::from_iter_values(times)),
        ];
        columns.extend(
            self.are_wide
                .iter()
                .enumerate()
                .map(|(i, is_wide)| -> ArrayRef {
                    let values = (0..count).map(|row| table[row * width + i]);
                    match is_wide {
                        true => Arc::new(values.collect::<Float64Array>()),
                        false => {
                            let narrow = values.map(|value| value.map(|value| value as f32));
                            Arc::new(narrow.collect::<Float32Array>())
                        }
                    }
                }),
        );
        columns
    }
}

fn field(name: &str, unit: &str, about: &str, kind: DataType, nullable: bool) -> Field {
    let about = [("unit", unit), ("description", about)];
    let about = about.map(|(key, value)| (key.to_owned(), value.to_owned()));
    Field::new(name, kind, nullable).with_metadata(about.into())
}

/// The unit of a joint that slides, where that of one that turns is given.
fn sliding(unit: &'static str) -> &'static str {
    match unit {
        "rad" => "m",
        "rad/s" => "m/s",
        "N*m" => "N",
        other => other,
    }
}
