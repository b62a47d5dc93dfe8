//! The columns of the wide table, which all formats share.

use std::sync::Arc;

use rerun::external::arrow::array::{ArrayRef, Float64Array, Int64Array};
use rerun::external::arrow::datatypes::{DataType, Field, Schema};

use crate::facts::Facts;
use crate::run::Tick;
use crate::signals::{Elements, Kept, Signal};

/// A quantity: successive columns.
struct Quantity {
    signal: Signal,
    width: usize,
    /// The last row's values, for a quaternion: its sign is continuous.
    last: Vec<f64>,
}

/// The columns of the wide table, each `group.quantity.element`: `joint.q.1`, `singularity.s.wrist`; plain ASCII.
pub(super) struct Columns(Vec<Quantity>);

impl Columns {
    /// Those of a run with these singularities.
    pub(super) fn new(facts: &Facts, singularities: &[String]) -> (Self, Schema) {
        let scenario = &facts.job.scenario;
        let is_missing = |name: &str| {
            name.starts_with("servo:") && scenario.servo.is_none()
                || name == "force:measured" && !scenario.has_wrist_sensor()
                || name == "force:moment"
                    && (!scenario.has_wrist_sensor() || scenario.plant.face_radius_m == 0.0)
                || name == "force:along_axis" && !scenario.presses()
        };
        let units: Vec<_> = facts.joint_units.split(' ').collect();
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
        let mut quantities = Vec::new();
        for signal in Signal::ALL.iter().copied() {
            let of = signal.of();
            if of.kept == Kept::Drawn || is_missing(of.name) {
                continue;
            }
            let elements = signal.elements(units.len(), singularities);
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
                fields.push(field(name, unit, signal.about(), DataType::Float64, true));
            }
            let (width, last) = (elements.len(), Vec::new());
            quantities.push(Quantity {
                signal,
                width,
                last,
            });
        }
        let run = facts
            .properties()
            .map(|(key, value)| (key.to_owned(), value));
        (
            Self(quantities),
            Schema::new_with_metadata(fields, run.into()),
        )
    }

    /// The columns of these ticks: nothing where a message is missing.
    pub(super) fn of(&mut self, facts: &Facts, ticks: &[Tick]) -> Vec<ArrayRef> {
        let width = self.0.iter().map(|one| one.width).sum();
        let mut columns: Vec<Vec<Option<f64>>> = vec![Vec::with_capacity(ticks.len()); width];
        let mut values = Vec::new();
        for tick in ticks {
            let row = tick.row();
            let now = facts.now(&row);
            let mut out = columns.iter_mut();
            for Quantity {
                signal,
                width,
                last,
            } in &mut self.0
            {
                let of = signal.of();
                values.clear();
                (of.take)(&now, &mut values);
                if of.elements == Elements::Quaternion && !values.is_empty() {
                    let products = last.iter().zip(&values).map(|(a, b)| a * b);
                    if products.sum::<f64>() < 0.0 {
                        values.iter_mut().for_each(|x| *x = -*x);
                    }
                    last.clone_from(&values);
                }
                for (i, column) in out.by_ref().take(*width).enumerate() {
                    column.push(values.get(i).copied());
                }
            }
        }
        let numbers = ticks.iter().map(|tick| tick.tick);
        let times = numbers
            .clone()
            .map(|tick| tick as f64 / f64::from(facts.rate_hz));
        let first: [ArrayRef; 2] = [
            Arc::new(Int64Array::from_iter_values(
                numbers.map(|tick| tick as i64),
            )),
            Arc::new(Float64Array::from_iter_values(times)),
        ];
        let rest = columns.into_iter();
        let rest = rest.map(|column| Arc::new(Float64Array::from(column)) as ArrayRef);
        first.into_iter().chain(rest).collect()
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
