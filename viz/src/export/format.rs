//! A file format of an export, and the table that all formats share.

use std::path::{Path, PathBuf};

use crate::read::{About, ReadError, Rows};
use crate::signals::{Elements, Kept, Limits, Now, Signal, TickRow};

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

/// Some successive ticks' values: one row a tick, one value a column after tick and time; `None` where a message was missing.
pub(super) struct Block {
    pub(super) ticks: Vec<u64>,
    values: Vec<Option<f64>>,
    width: usize,
}

impl Block {
    pub(super) fn rows(&self) -> impl Iterator<Item = (u64, &[Option<f64>])> {
        let values = self.values.chunks(self.width.max(1));
        self.ticks.iter().copied().zip(values)
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

/// A quantity: successive columns.
pub(super) struct Quantity {
    /// Its columns, after tick and time.
    pub(super) columns: std::ops::Range<usize>,
    signal: Signal,
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
    /// As many as the arm has joints.
    limits: Limits,
}

impl Columns {
    /// Those of a recording, and with its messages those that come from them, of a steered run (`Some(true)`) or another; `slides`: which joints slide,
    /// whose units are metres.
    pub(super) fn new(about: &About, messages: Option<bool>, slides: &[bool]) -> Self {
        let mut columns = Self {
            quantities: Vec::new(),
            list: Vec::new(),
            rate_hz: about.rate_hz(),
            properties: about.properties.clone().into_iter().collect(),
            limits: Limits {
                speed: vec![1.0; about.joints],
                ..Limits::default()
            },
        };
        for signal in Signal::ALL.iter().copied() {
            let of = signal.of();
            let has_message =
                messages.is_some_and(|is_steered| is_steered || !of.name.starts_with("servo:"));
            if of.kept == Kept::Drawn || (of.kept == Kept::Message && !has_message) {
                continue;
            }
            let (group, name) = of.name.split_once(':').unwrap_or(("run", of.name));
            let elements = signal.elements(about.joints, &about.singularities);
            let first = columns.list.len();
            let column = |(i, element): (usize, &String)| Column {
                name: match element.as_str() {
                    "" => format!("{group}.{name}"),
                    element => format!("{group}.{name}.{}", ascii(element)),
                },
                unit: match of.elements == Elements::Joints && slides.get(i) == Some(&true) {
                    true => sliding(of.unit),
                    false => of.unit,
                },
                about: signal.about(),
                is_wide: matches!(of.kept, Kept::F64 | Kept::Message),
            };
            columns.list.extend(elements.iter().enumerate().map(column));
            columns.quantities.push(Quantity {
                columns: first..columns.list.len(),
                signal,
                last: Vec::new(),
            });
        }
        columns
    }

    /// `tick`, `t_s`, then the columns' names.
    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        let names = self.list.iter().map(|column| column.name.as_str());
        ["tick", "t_s"].into_iter().chain(names)
    }

    pub(super) fn t_s(&self, tick: u64) -> f64 {
        tick as f64 / self.rate_hz
    }

    /// The values of recorded rows; `messages` gives those of a tick, asked in ascending order.
    pub(super) fn block(
        &mut self,
        rows: &Rows,
        mut messages: impl FnMut(u64, &mut dyn FnMut(&TickRow<'_>)),
    ) -> Block {
        let width = self.list.len();
        let mut block = Block {
            ticks: rows.ticks.clone(),
            values: vec![None; rows.ticks.len() * width],
            width,
        };
        let (mut values, limits) = (Vec::new(), &self.limits);
        for (row, tick) in rows.ticks.iter().enumerate() {
            let out = &mut block.values[row * width..(row + 1) * width];
            let mut put = |quantity: &mut Quantity, message: Option<&TickRow>| {
                values.clear();
                match message {
                    None => rows.values(quantity.signal, row, &mut values),
                    Some(message) => {
                        (quantity.signal.of().take)(&Now::new(message, limits, None), &mut values)
                    }
                }
                if quantity.signal.of().elements == Elements::Quaternion && !values.is_empty() {
                    let products = quantity.last.iter().zip(&values).map(|(a, b)| a * b);
                    if products.sum::<f64>() < 0.0 {
                        values.iter_mut().for_each(|x| *x = -*x);
                    }
                    quantity.last.clone_from(&values);
                }
                let to = out[quantity.columns.clone()].iter_mut();
                to.zip(&values).for_each(|(to, value)| *to = Some(*value));
            };
            let is_message = |quantity: &&mut Quantity| quantity.signal.of().kept == Kept::Message;
            let recorded = self.quantities.iter_mut();
            recorded
                .filter(|one| !is_message(one))
                .for_each(|one| put(one, None));
            let quantities = &mut self.quantities;
            messages(*tick, &mut |message| {
                quantities
                    .iter_mut()
                    .filter(is_message)
                    .for_each(|one| put(one, Some(message)));
            });
        }
        block
    }
}

/// A heading of a table that every tool takes: `hop sensor` is `hop_sensor`.
fn ascii(element: &str) -> String {
    element.replace(|c: char| !c.is_ascii_graphic(), "_")
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
