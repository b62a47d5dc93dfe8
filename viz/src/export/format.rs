//! A file format of an export, and the table that all formats share.

use std::path::{Path, PathBuf};

use super::fields::{Elements, FIELDS, Field};
use crate::read::{About, ReadError, Rows, Solid};
use crate::signals::{Signal, TickRow};

/// Why an export failed: reading, writing, or the format's own crate.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The recording cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// A file cannot be written.
    #[error("cannot write {path}: {reason}; free space there, or choose another folder with --out")]
    Write {
        /// The file.
        path: PathBuf,
        /// The error of the file system or of the format's crate.
        reason: String,
    },
}

impl ExportError {
    pub(super) fn write(path: &Path) -> impl Fn(&dyn std::fmt::Display) -> Self + use<> {
        let path = path.to_owned();
        move |reason| Self::Write {
            path: path.clone(),
            reason: reason.to_string(),
        }
    }
}

/// A format: what it does with each piece of a recording, which comes in the order of time, kind by kind.
pub(super) trait Format {
    /// Once, before the first numbers.
    fn begin(&mut self, columns: &Columns) -> Result<(), ExportError>;
    fn rows(&mut self, columns: &Columns, block: &Block) -> Result<(), ExportError>;
    fn event(&mut self, event: Event) -> Result<(), ExportError>;
    /// A solid of the picture, in its own frame; only a format that draws takes it.
    fn solid(&mut self, _solid: &Solid) -> Result<(), ExportError> {
        Ok(())
    }
    /// Where something drawn was.
    fn place(&mut self, _place: &Place) -> Result<(), ExportError> {
        Ok(())
    }
    /// Ends the files; their paths.
    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, ExportError>;
}

/// A line of the log, or a change of a lane of the state timeline.
pub(super) struct Event {
    pub(super) tick: u64,
    pub(super) t_s: f64,
    /// `log` or `state`.
    pub(super) kind: &'static str,
    /// The level, or the lane.
    pub(super) subject: String,
    pub(super) text: String,
}

/// Where something drawn was: base axes, m; a unit quaternion.
pub(super) struct Place<'a> {
    pub(super) t_s: f64,
    /// Its path, like `/world/arm/link3`.
    pub(super) of: &'a str,
    pub(super) p: [f32; 3],
    pub(super) xyzw: [f32; 4],
}

/// Some successive ticks' values: one row a tick, one value a column after tick and time; `None` where a message was missing.
pub(super) struct Block {
    pub(super) ticks: Vec<u64>,
    values: Vec<Option<f64>>,
    width: usize,
}

impl Block {
    pub(super) fn rows(&self) -> impl Iterator<Item = (u64, &[Option<f64>])> {
        self.ticks
            .iter()
            .copied()
            .zip(self.values.chunks(self.width.max(1)))
    }
}

/// A column of the wide table.
#[derive(Clone, Debug)]
pub(super) struct Column {
    /// `group.quantity.element`: `joint.q.1`, `singularity.s.wrist`; plain ASCII.
    pub(super) name: String,
    /// As UDUNITS and pint read it; `1` for what has none.
    pub(super) unit: &'static str,
    pub(super) about: &'static str,
    /// Whether it has 64 bits.
    pub(super) is_wide: bool,
}

/// Where a quantity's values come from.
enum Source {
    Signal(Signal),
    Field(&'static Field),
}

/// A quantity: successive columns.
pub(super) struct Quantity {
    /// `joint`, `singularity` and so on.
    pub(super) group: &'static str,
    pub(super) name: &'static str,
    pub(super) about: &'static str,
    pub(super) elements: Vec<String>,
    /// Its columns, after tick and time.
    pub(super) columns: std::ops::Range<usize>,
    source: Source,
    /// The last row's values, for a quaternion: its sign is continuous.
    last: Vec<f64>,
}

/// The columns of the wide table.
pub(super) struct Columns {
    pub(super) quantities: Vec<Quantity>,
    /// After tick and time.
    pub(super) list: Vec<Column>,
    pub(super) rate_hz: f64,
    /// The run's description.
    pub(super) properties: Vec<(String, String)>,
    joints: usize,
}

impl Columns {
    /// Those of a recording, and with its messages those that come from them, of a steered run (`Some(true)`) or another; `slides`: which joints slide,
    /// whose units are metres.
    pub(super) fn new(about: &About, messages: Option<bool>, slides: &[bool]) -> Self {
        let properties = about
            .properties
            .iter()
            .map(|(key, value)| (key.clone(), value.clone()))
            .collect();
        let mut columns = Self {
            quantities: Vec::new(),
            list: Vec::new(),
            rate_hz: about.rate_hz(),
            properties,
            joints: about.joints,
        };
        for signal in Signal::ALL {
            let elements = signal.elements(about.joints, &about.singularities);
            let words = signal.about().trim();
            let is_of_joints = elements.len() == about.joints
                && (signal.name().starts_with("joint:") || signal.name().starts_with("torque:"));
            let slides = if is_of_joints { slides } else { &[] };
            columns.add(
                signal.name(),
                unit(*signal),
                words,
                elements,
                signal.is_wide(),
                slides,
                Source::Signal(*signal),
            );
        }
        let has = |field: &&Field| {
            messages.is_some_and(|is_steered| is_steered || !field.name.starts_with("servo:"))
        };
        for field in FIELDS.iter().filter(has) {
            let elements = field.elements.names(about.joints, &about.singularities);
            let slides = if field.elements == Elements::Joints {
                slides
            } else {
                &[]
            };
            columns.add(
                field.name,
                field.unit,
                field.about,
                elements,
                true,
                slides,
                Source::Field(field),
            );
        }
        columns
    }

    #[allow(clippy::too_many_arguments, reason = "the parts of one quantity")]
    fn add(
        &mut self,
        name: &'static str,
        unit: &'static str,
        about: &'static str,
        elements: Vec<String>,
        is_wide: bool,
        slides: &[bool],
        source: Source,
    ) {
        let (group, name) = name.split_once(':').unwrap_or(("run", name));
        let first = self.list.len();
        self.list
            .extend(elements.iter().enumerate().map(|(i, element)| {
                let unit = if slides.get(i).copied().unwrap_or(false) {
                    sliding(unit)
                } else {
                    unit
                };
                let name = if element.is_empty() {
                    format!("{group}.{name}")
                } else {
                    format!("{group}.{name}.{}", ascii(element))
                };
                Column {
                    name,
                    unit,
                    about,
                    is_wide,
                }
            }));
        self.quantities.push(Quantity {
            group,
            name,
            about,
            elements,
            columns: first..self.list.len(),
            source,
            last: Vec::new(),
        });
    }

    /// `tick`, `t_s`, then the columns' names.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        ["tick", "t_s"]
            .into_iter()
            .chain(self.list.iter().map(|column| column.name.as_str()))
    }

    pub(super) fn t_s(&self, tick: u64) -> f64 {
        tick as f64 / self.rate_hz
    }

    /// The values of recorded rows; `messages` gives those of a tick, asked in ascending order.
    pub(super) fn block<'a>(
        &mut self,
        rows: &Rows,
        mut messages: impl FnMut(u64, &mut dyn FnMut(&TickRow<'_>)) + 'a,
    ) -> Block {
        let width = self.list.len();
        let mut block = Block {
            ticks: rows.ticks.clone(),
            values: vec![None; rows.ticks.len() * width],
            width,
        };
        let mut values = Vec::new();
        for (row, tick) in rows.ticks.iter().enumerate() {
            let out = &mut block.values[row * width..(row + 1) * width];
            let put = |quantity: &Quantity, values: &[f64], out: &mut [Option<f64>]| {
                out[quantity.columns.clone()]
                    .iter_mut()
                    .zip(values)
                    .for_each(|(to, value)| *to = Some(*value));
            };
            for quantity in &self.quantities {
                if let Source::Signal(signal) = quantity.source {
                    values.clear();
                    rows.values(signal, row, &mut values);
                    put(quantity, &values, out);
                }
            }
            let (joints, quantities) = (self.joints, &mut self.quantities);
            messages(*tick, &mut |message| {
                for quantity in quantities.iter_mut() {
                    let Source::Field(field) = quantity.source else {
                        continue;
                    };
                    values.clear();
                    (field.take)(message, joints, &mut values);
                    if field.elements == Elements::Quaternion && !values.is_empty() {
                        if quantity
                            .last
                            .iter()
                            .zip(&values)
                            .map(|(a, b)| a * b)
                            .sum::<f64>()
                            < 0.0
                        {
                            values.iter_mut().for_each(|x| *x = -*x);
                        }
                        quantity.last.clone_from(&values);
                    }
                    put(quantity, &values, out);
                }
            });
        }
        block
    }
}

/// A heading of a table that every tool takes: `hop sensor` is `hop_sensor`.
fn ascii(element: &str) -> String {
    element
        .chars()
        .map(|c| if c.is_ascii_graphic() { c } else { '_' })
        .collect()
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

/// The unit of a signal, as UDUNITS and pint read it.
fn unit(signal: Signal) -> &'static str {
    match signal {
        Signal::Position | Signal::Auxiliary | Signal::AuxiliaryReference => "rad",
        Signal::Speed => "rad/s",
        Signal::TorqueTask | Signal::TorqueNull => "N*m",
        Signal::PositionError => "mm",
        Signal::OrientationError => "deg",
        Signal::Contact => "N",
        Signal::Latency => "us",
        Signal::PositionInRange
        | Signal::SpeedRatio
        | Signal::TorqueTaskRatio
        | Signal::TorqueNullRatio
        | Signal::Measure
        | Signal::Beta
        | Signal::SingularValues
        | Signal::Scale => "1",
    }
}
