//! The columns of the wide table, which all formats share.

use std::sync::Arc;

use rerun::external::arrow::array::{ArrayRef, Float64Array, Int64Array, RecordBatch};
use rerun::external::arrow::datatypes::{DataType, Field, Schema, SchemaRef};
use rerun::external::arrow::error::ArrowError;

use crate::facts::{Facts, slides};
use crate::run::Tick;
use crate::signals::{Elements, Kept, Now, Signal};
use crate::story::Named;

/// A quantity: successive columns.
struct Quantity {
    signal: Signal,
    width: usize,
    /// The last row's values, for a quaternion: its sign is continuous.
    last: Vec<f64>,
}

/// The columns of the wide table, each `group.quantity.element`: `joint.q.1`, `singularity.s.wrist`; plain ASCII.
pub(super) struct Columns {
    quantities: Vec<Quantity>,
    schema: SchemaRef,
}

impl Columns {
    /// Those of a run with these singularities.
    pub(super) fn new(facts: &Facts, singularities: &[Named]) -> Self {
        let scenario = &facts.job.scenario;
        let has_sensor = scenario.has_wrist_sensor();
        let is_missing = |name: &str| match name {
            "force:measured" => !has_sensor,
            "force:moment" => !has_sensor || scenario.plant.face_radius_m == 0.0,
            "force:along_axis" => !scenario.presses(),
            _ => name.starts_with("servo:") && scenario.servo.is_none(),
        };
        let time = "Time since the first tick";
        let mut fields = vec![
            field("tick", "1", "Tick of the run", DataType::Int64, false),
            field("t_s", "s", time, DataType::Float64, false),
        ];
        let mut quantities = Vec::new();
        for signal in Signal::ALL.iter().copied() {
            let of = signal.of();
            if of.kept == Kept::Drawn || is_missing(of.name) {
                continue;
            }
            let elements = signal.elements(facts.joints(), singularities);
            for (i, element) in elements.iter().enumerate() {
                // A heading that every tool takes: `hop sensor` is `hop_sensor`.
                let element = element.replace(|c: char| !c.is_ascii_graphic(), "_");
                let name = format!("{}.{element}", of.name.replace(':', "."));
                let unit = match of.elements {
                    Elements::Joints if slides(&facts.robot.joints[i]) => sliding(of.unit),
                    _ => of.unit,
                };
                let name = name.trim_end_matches('.');
                fields.push(field(name, unit, signal.about(), DataType::Float64, true));
            }
            quantities.push(Quantity {
                signal,
                width: elements.len(),
                last: Vec::new(),
            });
        }
        let run = facts
            .properties()
            .map(|(key, value)| (key.to_owned(), value));
        Self {
            quantities,
            schema: Arc::new(Schema::new_with_metadata(fields, run.into())),
        }
    }

    /// The columns of these ticks: nothing where a message is missing.
    pub(super) fn of(&mut self, facts: &Facts, ticks: &[Tick]) -> Result<RecordBatch, ArrowError> {
        let rate_hz = f64::from(facts.rate_hz);
        let numbers = ticks.iter().map(|tick| tick.tick as i64);
        let times = ticks.iter().map(|tick| tick.tick as f64 / rate_hz);
        let mut all: Vec<ArrayRef> = vec![
            Arc::new(Int64Array::from_iter_values(numbers)),
            Arc::new(Float64Array::from_iter_values(times)),
        ];
        let mut values = Vec::new();
        for one in &mut self.quantities {
            let of = one.signal.of();
            let mut columns = vec![Vec::new(); one.width];
            for tick in ticks {
                values.clear();
                (of.take)(&Now::new(tick, facts), &mut values);
                if of.elements == Elements::Quaternion && !values.is_empty() {
                    let products = one.last.iter().zip(&values).map(|(a, b)| a * b);
                    if products.sum::<f64>() < 0.0 {
                        values.iter_mut().for_each(|x| *x = -*x);
                    }
                    one.last.clone_from(&values);
                }
                for (i, column) in columns.iter_mut().enumerate() {
                    column.push(values.get(i).copied());
                }
            }
            for column in columns {
                all.push(Arc::new(Float64Array::from(column)));
            }
        }
        RecordBatch::try_new(Arc::clone(&self.schema), all)
    }
}

fn field(name: &str, unit: &str, about: &str, kind: DataType, nullable: bool) -> Field {
    let about = [("unit", unit), ("description", about)]
        .map(|(key, value)| (key.to_owned(), value.to_owned()));
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
