//! `armplane export`: a recording's numbers and events for other tools, and its layout for the viewer.

#[cfg(feature = "mcap")]
mod mcap;
#[cfg(feature = "parquet")]
mod parquet;

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use indicatif::{ProgressBar, ProgressStyle};
use model::with_dof;
use shared_types::scenario::Layout;
use viz::{About, Piece, ReadError, Rows, RunInfo, Signal, TickRow};

use super::failure::Failure;
use super::out::say;
use super::runs::Run;
use super::{ExportArgs, ExportFormat, load};

/// Why an export failed: reading, writing, or the format's own crate.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ExportError {
    #[error(transparent)]
    Read(#[from] ReadError),
    #[error("cannot write {path}: {reason}; free space there, or choose another folder with --out")]
    Write { path: PathBuf, reason: String },
}

impl ExportError {
    fn write(path: &Path) -> impl Fn(&dyn std::fmt::Display) -> Self + use<> {
        let path = path.to_owned();
        move |reason| Self::Write { path: path.clone(), reason: reason.to_string() }
    }
}

/// A format: what it does with each piece of a recording, which comes in the order of time, kind by kind.
trait Format {
    /// Once, before the first numbers.
    fn begin(&mut self, columns: &Columns) -> Result<(), ExportError>;
    fn rows(&mut self, columns: &Columns, rows: &Rows) -> Result<(), ExportError>;
    fn event(&mut self, event: &Event) -> Result<(), ExportError>;
    /// Ends the files; their paths.
    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, ExportError>;
}

/// A line of the log, or a change of a lane of the state timeline.
struct Event {
    tick: u64,
    t_s: f64,
    /// `log` or `state`.
    kind: &'static str,
    /// The level, or the lane.
    subject: String,
    text: String,
}

/// The columns of the wide table: each signal with its elements.
struct Columns {
    signals: Vec<(Signal, Vec<String>)>,
    rate_hz: f64,
}

impl Columns {
    fn new(about: &About) -> Self {
        let elements = |signal: Signal| (signal, signal.elements(about.joints, &about.singularities));
        Self { signals: Signal::ALL.iter().map(|signal| elements(*signal)).collect(), rate_hz: about.rate_hz() }
    }

    /// `tick`, `t_s`, then `group.quantity.element`: `joint.q.1`, `singularity.s.wrist`.
    fn names(&self) -> Vec<String> {
        let of = |(signal, elements): &(Signal, Vec<String>)| -> Vec<String> {
            let base = signal.name().replace(':', ".");
            elements.iter().map(|element| if element.is_empty() { base.clone() } else { format!("{base}.{element}") }).collect()
        };
        ["tick", "t_s"].map(str::to_owned).into_iter().chain(self.signals.iter().flat_map(of)).collect()
    }

    fn t_s(&self, tick: u64) -> f64 {
        tick as f64 / self.rate_hz
    }

    /// A row's values after tick and time, `None` where a message was missing; `values` is scratch.
    fn each_value(&self, rows: &Rows, row: usize, values: &mut Vec<f64>, mut put: impl FnMut(usize, Signal, Option<f64>)) {
        let mut column = 0;
        for (signal, elements) in &self.signals {
            values.clear();
            rows.values(*signal, row, values);
            for i in 0..elements.len() {
                put(column, *signal, values.get(i).copied());
                column += 1;
            }
        }
    }
}

pub(crate) fn export(args: &ExportArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let run = Run::find(args.run.as_deref())?;
    let out = args.out.clone().unwrap_or_else(|| run.folder.clone());
    std::fs::create_dir_all(&out).map_err(|error| Failure::Input(format!("cannot write to {}: {error}", out.display())))?;
    let files = match args.format {
        ExportFormat::Rbl => {
            let layout = args.layout.map_or_else(|| run.job().map(|job| job.scenario.view.layout), Ok)?;
            let path = out.join(format!("{}.rbl", layout.name()));
            save_blueprint(&run, layout, &path)?;
            vec![path]
        }
        _ if args.layout.is_some() => return Err(Failure::Input("--layout goes with --format rbl only".to_owned())),
        format => write(run.recording()?, opened(format, &out)?).map_err(Failure::work)?,
    };
    if as_json {
        let files: Vec<_> = files
            .iter()
            .map(|path| serde_json::json!({"file": path, "bytes": std::fs::metadata(path).map_or(0, |file| file.len())}))
            .collect();
        say!("{}", serde_json::json!({"files": files}));
    } else {
        for path in files {
            say!("{}  {:.1} MB", path.display(), std::fs::metadata(&path).map_or(0, |file| file.len()) as f64 / 1e6);
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn opened(format: ExportFormat, out: &Path) -> Result<Box<dyn Format>, Failure> {
    match format {
        ExportFormat::Csv => Ok(Box::new(Csv::create(out).map_err(Failure::work)?)),
        #[cfg(feature = "parquet")]
        ExportFormat::Parquet => Ok(Box::new(parquet::Parquet::create(out).map_err(Failure::work)?)),
        #[cfg(feature = "mcap")]
        ExportFormat::Mcap => Ok(Box::new(mcap::Mcap::create(out).map_err(Failure::work)?)),
        #[allow(unreachable_patterns, reason = "which formats are left depends on the features")]
        other => {
            let name = other.name();
            Err(Failure::Input(format!(
                "this build has no {name}: build it with `cargo build --release --features {name}` (`parquet,mcap` for both), or use --format csv"
            )))
        }
    }
}

/// Reads the recording once and hands it to the format.
fn write(parts: &[PathBuf], mut format: Box<dyn Format>) -> Result<Vec<PathBuf>, ExportError> {
    let bar = ProgressBar::new_spinner().with_message("rows");
    if let Ok(style) = ProgressStyle::with_template("{spinner} {pos} {msg}  {per_sec}") {
        bar.set_style(style);
    }
    let mut columns: Option<Columns> = None;
    let mut rate_hz = 1000.0;
    viz::read(parts, |piece| {
        let mut event = |tick: u64, kind, subject, text| format.event(&Event { tick, t_s: tick as f64 / rate_hz, kind, subject, text });
        match (piece, &columns) {
            (Piece::About(about), None) => {
                rate_hz = about.rate_hz();
                format.begin(columns.insert(Columns::new(about)))
            }
            (Piece::Rows(rows), Some(columns)) => {
                bar.inc(rows.ticks.len() as u64);
                format.rows(columns, rows)
            }
            (Piece::Event { tick, level, text }, _) => event(tick, "log", level, text),
            (Piece::State { tick, lane, state }, _) => event(tick, "state", lane, state),
            (Piece::Damaged(damage), _) => {
                bar.suspend(|| eprintln!("{damage}"));
                Ok(())
            }
            _ => Ok(()),
        }
    })?;
    bar.finish_and_clear();
    format.finish()
}

/// The layout of a run as a `.rbl`: the first tick is computed again, which names the singularities and places the eye.
pub(crate) fn save_blueprint(run: &Run, layout: Layout, path: &Path) -> Result<(), Failure> {
    let job = run.job()?;
    let robot = load::robot_of(&job.robot).map_err(Failure::input)?;
    let first = chain::Chain::new(&robot, &chain::without_faults(&job.scenario)).map_err(Failure::input)?.step();
    let info = RunInfo { scenario: &job.scenario, robot: &robot, run: &job.run, version: &job.version, seed: job.scenario.seed };
    let row = TickRow::new(0, first.lent());
    with_dof!(robot.dof(), N => viz::save_blueprint::<N>(path, &info, &row, layout)).unwrap_or(Ok(())).map_err(Failure::work)
}

/// `signals.csv`, one wide table, and `events.csv`.
struct Csv {
    signals: Sheet,
    events: Sheet,
}

struct Sheet {
    path: PathBuf,
    writer: csv::Writer<File>,
}

impl Sheet {
    fn create(path: PathBuf) -> Result<Self, ExportError> {
        let writer = csv::Writer::from_path(&path).map_err(|error| ExportError::write(&path)(&error))?;
        Ok(Self { path, writer })
    }

    fn line<T: AsRef<[u8]>>(&mut self, fields: impl IntoIterator<Item = T>) -> Result<(), ExportError> {
        self.writer.write_record(fields).map_err(|error| ExportError::write(&self.path)(&error))
    }

    fn finish(mut self) -> Result<PathBuf, ExportError> {
        self.writer.flush().map_err(|error| ExportError::write(&self.path)(&error))?;
        Ok(self.path)
    }
}

impl Csv {
    fn create(out: &Path) -> Result<Self, ExportError> {
        let mut events = Sheet::create(out.join("events.csv"))?;
        events.line(["tick", "t_s", "kind", "subject", "text"])?;
        Ok(Self { signals: Sheet::create(out.join("signals.csv"))?, events })
    }
}

impl Format for Csv {
    fn begin(&mut self, columns: &Columns) -> Result<(), ExportError> {
        self.signals.line(columns.names())
    }

    fn rows(&mut self, columns: &Columns, rows: &Rows) -> Result<(), ExportError> {
        let mut values = Vec::new();
        for (row, tick) in rows.ticks.iter().enumerate() {
            let mut fields = vec![tick.to_string(), columns.t_s(*tick).to_string()];
            columns.each_value(rows, row, &mut values, |_, signal, value| {
                // The shortest text that reads back as the same number, in the signal's own width.
                let text = |value: f64| if signal.is_wide() { value.to_string() } else { (value as f32).to_string() };
                fields.push(value.map_or(String::new(), text));
            });
            self.signals.line(fields)?;
        }
        Ok(())
    }

    fn event(&mut self, event: &Event) -> Result<(), ExportError> {
        self.events.line([event.tick.to_string(), event.t_s.to_string(), event.kind.to_owned(), event.subject.clone(), event.text.clone()])
    }

    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, ExportError> {
        Ok(vec![self.signals.finish()?, self.events.finish()?])
    }
}
