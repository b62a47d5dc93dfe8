//! A recording read back: its numbers row by row, its events and states, from the files themselves.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use re_chunk::external::arrow::array::{Array, AsArray, ListArray};
use re_chunk::external::arrow::datatypes::{Float32Type, Float64Type};
use re_chunk::{Chunk, ChunkComponentSlicer};

use re_log_types::{StoreId, StoreKind};

use crate::entity;
use crate::frames::Frames;
use crate::signals::{Kept, Limits, Signal, from_logarithm};

/// Why a recording cannot be read back.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file cannot be opened.
    #[error("cannot open the recording {path}: {source}")]
    Open {
        /// Which.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// It is no recording, or not one of armplane's.
    #[error("{path} is not a recording of armplane: {reason}")]
    NotARecording {
        /// Which.
        path: PathBuf,
        /// The defect.
        reason: String,
    },
}

/// The static description of a run in its recording.
#[derive(Clone, Debug, Default)]
pub struct About {
    /// `scenario`, `robot`, `run`, `seed`, `rate_hz`, `armplane`, `joint_units`.
    pub properties: BTreeMap<String, String>,
    /// Joints of the arm.
    pub joints: usize,
    /// Names of the singularities, in order.
    pub singularities: Vec<String>,
    limits: Arc<Limits>,
}

impl About {
    /// The control rate; 1/s.
    #[must_use]
    pub fn rate_hz(&self) -> f64 {
        self.properties
            .get("rate_hz")
            .and_then(|text| text.parse().ok())
            .filter(|rate| *rate > 0.0)
            .unwrap_or(1000.0)
    }
}

/// A piece of a recording, in the order of the file.
#[derive(Debug)]
pub enum Piece<'a> {
    /// The run's description; at the beginning of each part, before its numbers.
    About(&'a About),
    /// Numbers.
    Rows(&'a Rows),
    /// A line of the log.
    Event {
        /// When.
        tick: u64,
        /// `INFO`, `WARN` or `ERROR`.
        level: String,
        /// The line.
        text: String,
    },
    /// A lane of the state timeline changed.
    State {
        /// When.
        tick: u64,
        /// `mode/wrist`, `process/plant`, `drive`, `phase` and so on.
        lane: String,
        /// Its new state.
        state: String,
    },
    /// Where something drawn was.
    Place {
        /// When.
        tick: u64,
        /// Its path, like `/world/arm/link3`.
        of: &'a str,
        /// Its origin; base axes, m.
        p: [f32; 3],
        /// Its rotation, a unit quaternion.
        xyzw: [f32; 4],
    },
    /// The lost motion at a mark, from the tick at which the arm enters the neighbourhood; empty from the one at which it leaves.
    Lost {
        /// When.
        tick: u64,
        /// Its path.
        of: &'a str,
        /// Its words.
        text: String,
    },
    /// The rest of a file cannot be read; the next file follows.
    Damaged(Damage<'a>),
}

/// Where a file stops making sense. The file of a killed recorder is no such place: it just ends.
#[derive(Debug)]
pub struct Damage<'a> {
    path: &'a Path,
    bytes: u64,
    reason: String,
}

impl std::fmt::Display for Damage<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            path,
            bytes,
            reason,
        } = self;
        write!(
            f,
            "{} is damaged before its byte {bytes} ({reason}); what follows there is left out",
            path.display()
        )
    }
}

/// Progress of reading a recording.
#[derive(Clone, Copy, Debug)]
pub enum ReadNews<'a> {
    /// So many rows more are read.
    Rows(u64),
    /// A part of the recording cannot be read.
    Damaged(&'a Damage<'a>),
}

/// Some successive ticks' numbers.
#[derive(Debug, Default)]
pub struct Rows {
    /// Their ticks.
    pub ticks: Vec<u64>,
    columns: Vec<(Signal, ListArray)>,
    /// Those of a lower rate, of the chunk before and of this one.
    slow: [Arc<Slow>; 2],
    limits: Arc<Limits>,
}

/// Signals of a lower rate than the ticks'.
#[derive(Debug, Default)]
struct Slow {
    ticks: Vec<u64>,
    columns: Vec<(Signal, ListArray)>,
}

/// For how many ticks a signal of a lower rate holds at most.
const HELD: u64 = 64;

impl Slow {
    /// The row that holds at a tick.
    fn row(&self, tick: u64) -> Option<usize> {
        let row = self
            .ticks
            .partition_point(|known| *known <= tick)
            .checked_sub(1)?;
        (tick - self.ticks[row] < HELD).then_some(row)
    }
}

impl Rows {
    /// The row of signals of a lower rate that holds at a tick: at the beginning of a chunk the last one of the chunk before.
    fn slow_row(&self, tick: u64) -> Option<(&Vec<(Signal, ListArray)>, usize)> {
        self.slow
            .iter()
            .rev()
            .find_map(|slow| Some((&slow.columns, slow.row(tick)?)))
    }

    /// The values of a signal in a row, appended to `into`; nothing where its messages were missing.
    pub fn values(&self, signal: Signal, row: usize, into: &mut Vec<f64>) {
        if let Some((of, derive)) = self.limits.derive(signal) {
            let first = into.len();
            self.values(of, row, into);
            into[first..]
                .iter_mut()
                .enumerate()
                .for_each(|(i, value)| *value = derive(i, *value));
            return;
        }
        let (columns, row) = match signal.of().kept {
            Kept::Slow => match self.ticks.get(row).and_then(|tick| self.slow_row(*tick)) {
                Some(found) => found,
                None => return,
            },
            _ => (&self.columns, row),
        };
        let Some((_, lists)) = columns.iter().find(|(known, _)| *known == signal) else {
            return;
        };
        if !lists.is_valid(row) {
            return;
        }
        let range = lists.value_offsets()[row] as usize..lists.value_offsets()[row + 1] as usize;
        if let Some(all) = lists.values().as_primitive_opt::<Float64Type>() {
            into.extend_from_slice(&all.values()[range]);
        } else if let Some(all) = lists.values().as_primitive_opt::<Float32Type>() {
            let value = match signal.of().kept {
                Kept::Log(_) => from_logarithm,
                _ => f64::from,
            };
            into.extend(all.values()[range].iter().map(|x| value(*x)));
        }
    }
}

/// A chunk of a file with its store, or the place from which on it cannot be read.
pub(crate) enum Found<'a> {
    Chunk(StoreId, Box<Chunk>),
    Damaged(Damage<'a>),
}

/// Hands on the chunks of a file; a torn end is its end.
pub(crate) fn chunks_of<'a, E: From<ReadError>>(
    path: &'a Path,
    mut each: impl FnMut(Found<'a>) -> Result<(), E>,
) -> Result<(), E> {
    let path_buf = || path.to_owned();
    let mut frames = Frames::open(path).map_err(|source| ReadError::Open {
        path: path_buf(),
        source,
    })?;
    let mut any = false;
    let reason = loop {
        match frames.next_chunk() {
            Ok(Some((store, chunk))) => {
                any = true;
                each(Found::Chunk(store, Box::new(chunk)))?;
            }
            Ok(None) if any => return Ok(()),
            Ok(None) => break "it is empty".to_owned(),
            Err(reason) if any => {
                let (bytes, reason) = (frames.place(), reason);
                return each(Found::Damaged(Damage {
                    path,
                    bytes,
                    reason,
                }));
            }
            Err(reason) => break reason,
        }
    };
    let path = path_buf();
    Err(ReadError::NotARecording { path, reason }.into())
}

/// Reads the parts of a recording and hands on piece by piece what is in them; a torn end of a file is its end.
///
/// # Errors
/// [`ReadError`] where a file cannot be opened or holds no recording, or what `each` answers.
pub fn read<E: From<ReadError>>(
    parts: &[PathBuf],
    mut each: impl FnMut(Piece) -> Result<(), E>,
) -> Result<(), E> {
    let (mut about, mut slow) = (About::default(), <[Arc<Slow>; 2]>::default());
    for path in parts {
        let mut introduced = false;
        chunks_of(path, |found| match found {
            Found::Damaged(damage) => each(Piece::Damaged(damage)),
            Found::Chunk(store, _) if store.kind() != StoreKind::Recording => Ok(()),
            Found::Chunk(_, chunk) if chunk.is_static() => {
                learn(&chunk, &mut about);
                Ok(())
            }
            Found::Chunk(_, chunk) if *chunk.entity_path() == entity::SIGNALS.into() => {
                if !std::mem::replace(&mut introduced, true) {
                    each(Piece::About(&about))?;
                }
                each(Piece::Rows(&Rows {
                    ticks: ticks(&chunk),
                    columns: columns(&chunk),
                    slow: slow.clone(),
                    limits: Arc::clone(&about.limits),
                }))
            }
            Found::Chunk(_, chunk) if *chunk.entity_path() == entity::DRAWN.into() => {
                slow.swap(0, 1);
                slow[1] = Arc::new(Slow {
                    ticks: ticks(&chunk),
                    columns: columns(&chunk),
                });
                Ok(())
            }
            Found::Chunk(_, chunk) => changes(&chunk, &mut each),
        })?;
    }
    Ok(())
}

/// Words, states and places, as they change.
fn changes<E>(chunk: &Chunk, each: &mut impl FnMut(Piece) -> Result<(), E>) -> Result<(), E> {
    let of = &chunk.entity_path().to_string();
    if of == entity::LOG {
        let (levels, lines) = (told(chunk, "TextLog:level"), told(chunk, "TextLog:text"));
        for ((_, level), (tick, text)) in levels.zip(lines) {
            // The viewer's line begins with its time.
            let (_, text) = text.split_once(entity::AFTER_TIME).unwrap_or(("", &text));
            let text = text.to_owned();
            each(Piece::Event { tick, level, text })?;
        }
    }
    for (tick, state) in told(chunk, "StateChange:state") {
        let lane = entity::lane(of);
        each(Piece::State { tick, lane, state })?;
    }
    let places = values::<[f32; 3]>(chunk, "Transform3D:translation");
    let turns = values::<[f32; 4]>(chunk, "Transform3D:quaternion");
    for ((tick, p), (_, xyzw)) in places.zip(turns) {
        if let ([p, ..], [xyzw, ..]) = (p, xyzw) {
            let (p, xyzw) = (*p, *xyzw);
            each(Piece::Place { tick, of, p, xyzw })?;
        }
    }
    for (tick, text) in told(chunk, "Arrows3D:labels") {
        each(Piece::Lost { tick, of, text })?;
    }
    Ok(())
}

/// The run's description in static chunks.
fn learn(chunk: &Chunk, about: &mut About) {
    let at = chunk.entity_path().to_string();
    if at == entity::SIGNALS {
        for (name, limits) in Arc::make_mut(&mut about.limits).named() {
            if let Some(values) = chunk.iter_slices::<f64>(name.into()).next() {
                *limits = values.to_vec();
            }
        }
        about.joints = about.limits.torque.len();
        for names in chunk.iter_slices::<String>(entity::SINGULARITY_NAMES.into()) {
            about.singularities = names.iter().map(ToString::to_string).collect();
        }
    }
    for name in chunk.components().keys().filter(|_| at.ends_with("/run")) {
        if let Some([text, ..]) = chunk.iter_slices::<String>(*name).next().as_deref() {
            let key = name.as_str().strip_prefix("run:").unwrap_or(name.as_str());
            about.properties.insert(key.to_owned(), text.to_string());
        }
    }
}

fn ticks(chunk: &Chunk) -> Vec<u64> {
    let times = chunk.iter_indices(&"tick".into());
    times.map(|(tick, _)| tick.as_i64().max(0) as u64).collect()
}

/// The rows of a component with their ticks.
fn values<'a, S: ChunkComponentSlicer + 'a>(
    chunk: &'a Chunk,
    component: &'static str,
) -> impl Iterator<Item = (u64, S::Item<'a>)> {
    let times = chunk.iter_component_indices("tick".into(), component.into());
    let ticks = times.map(|(tick, _)| tick.as_i64().max(0) as u64);
    ticks.zip(chunk.iter_slices::<S>(component.into()))
}

/// The texts of a component with their ticks.
fn told(chunk: &Chunk, component: &'static str) -> impl Iterator<Item = (u64, String)> {
    let rows = values::<String>(chunk, component);
    rows.filter_map(|(tick, texts)| Some((tick, texts.first()?.to_string())))
}

/// The signals that a chunk has.
fn columns(chunk: &Chunk) -> Vec<(Signal, ListArray)> {
    let column = |signal: Signal| {
        let column = chunk.components().get(signal.component().into())?;
        Some((signal, column.list_array.clone()))
    };
    Signal::recorded().filter_map(column).collect()
}
