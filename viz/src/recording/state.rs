//! The state of a recording in the making, and how a piece of it becomes a chunk.

use glam::Vec3;
use model::{Model, Robot};
use re_chunk::external::arrow::buffer::ScalarBuffer;
use re_chunk::{
    Chunk, ChunkBuilder, ChunkComponents, ChunkId, EntityPath, RowId, TimeColumn, TimePoint,
    Timeline,
};
use re_log_types::{StoreId, TimeCell};
use re_sdk_types::{AsComponents, SerializedComponentColumn};
use shared_types::scenario::{Layout, Scenario};
use shared_types::{MAX_DOF, MAX_SINGULARITIES};

use super::columns::{Picture, Table, Track};
use super::ending::Stretches;
use super::pieces::Room;
use crate::arm::Figure;
use crate::blueprint::Subject;
use crate::entity;
use crate::narration::{History, Situation};
use crate::scene::{Look, NullMotion};
use crate::signals::{ChainHops, LIVES, Limits, Lives};
use crate::sink::{FileInfo, Sink};

/// Which run a recording is of.
#[derive(Clone, Debug)]
pub struct RunInfo<'a> {
    /// The request.
    pub scenario: &'a Scenario,
    /// The arm.
    pub robot: &'a Robot,
    /// Identifies the run, and its recording; unique.
    pub run: &'a str,
    /// Version of armplane that made it.
    pub version: &'a str,
    /// Seed of every random number.
    pub seed: u64,
    /// The chain's places in the stamps: [`chain_hops`](crate::chain_hops) of the run's graph.
    pub hops: Option<ChainHops>,
    /// The processes that have lanes: [`Lives::of`] the run's graph.
    pub lives: Lives,
}

/// How much is recorded, and how often it is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Numbers are written every so many seconds of the run: what a killed process leaves unwritten.
    pub signal_chunk_s: f64,
    /// The picture is written every so many seconds.
    pub picture_chunk_s: f64,
    /// Pictures per second.
    pub picture_hz: f64,
    /// Whether a viewer watches as it is made: the viewer follows the end then, and plays nothing again.
    pub is_live: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            signal_chunk_s: 0.25,
            picture_chunk_s: 1.0,
            picture_hz: 50.0,
            is_live: false,
        }
    }
}

/// How far a recording has come: of every tick before these, it is on file what there is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Written {
    /// Numbers.
    pub signals: u64,
    /// The picture.
    pub picture: u64,
    /// Modes, states and words.
    pub changes: u64,
    /// The last part that has any of it, from 0.
    pub part: u32,
    /// Where in that part all of it ends.
    pub bytes: u64,
}

/// How serious an event is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// As planned.
    Info,
    /// A fault that is being dealt with.
    Warning,
    /// Something failed.
    Error,
}

/// A recording in the making: ticks in, an `.rrd` out.
///
/// One type for every arm: the model has as many places for joints as a message, so that this code is compiled once.
///
/// It may be spread over several files, its parts: each opens alone, all of them together as one recording, because they carry the same
/// recording id. [`next_part`](Self::next_part) turns to a fresh file within a run; [`create_part`](Self::create_part) lets another
/// process take up where one was killed.
///
/// Ensures: nothing blocks but the storage; the first error ends the file at its last whole message and is answered once, by
/// [`tick`](Self::tick) or [`finish`](Self::finish). A killed process leaves a file readable up to its last chunk.
pub struct Recording {
    pub(super) sink: Sink,
    pub(super) store: StoreId,
    pub(super) title: Title,
    /// The content of the parts before this one.
    pub(super) before: FileInfo,
    /// Ticks of this part.
    pub(super) part_ticks: u64,
    pub(super) arm: Model<MAX_DOF>,
    pub(super) figure: Figure,
    /// The axes of the hand's twist that the task has.
    pub(super) task: [bool; 6],
    /// Directions that the task has.
    pub(super) directions: usize,
    /// Whether the arm moves in the base's plane only.
    pub(super) planar: bool,
    pub(super) limits: Limits,
    pub(super) subject: Subject,
    pub(super) layout: Layout,
    pub(super) rate_hz: u32,
    /// The blueprint waits for the first report, which names the singularities.
    pub(super) blueprint_sent: bool,
    pub(super) last: Option<u64>,
    pub(super) written: Written,
    /// The first tick whose modes, states and words are not yet taken in.
    pub(super) changes_next: u64,
    /// Rows of each place that wait to be written.
    pub(super) pending: Vec<(EntityPath, Option<ChunkBuilder>)>,
    /// Another law's run, in a race.
    pub(super) rival: Option<Rival>,
    pub(super) signals: Table,
    /// Values only drawn, every so many ticks.
    pub(super) drawn_table: Table,
    pub(super) drawn_every: u64,
    pub(super) signal_rows: usize,
    pub(super) picture: Picture,
    pub(super) picture_every: u64,
    pub(super) picture_rows: usize,
    pub(super) is_live: bool,
    /// Which segments turn which singularity's ζ, and by how much; degrees.
    pub(super) wanted_turns: Vec<Option<(String, f64)>>,
    /// Which segments rotate the hand, and by how much; degrees.
    pub(super) wanted_rotations: Vec<Option<f64>>,
    pub(super) stretches: Stretches,
    pub(super) room: Room,
    pub(super) guides_due: u64,
    pub(super) marks: [Look; MAX_SINGULARITIES],
    /// Whether each singularity's ζ turns, of those whose mark's meshes this part has.
    pub(super) drawn: [Option<bool>; MAX_SINGULARITIES],
    /// On which side of its axis each label is.
    pub(super) sides: [f32; MAX_SINGULARITIES],
    /// The sector that ζ of each singularity has swept since the arm entered.
    pub(super) swept: [Option<Swept>; MAX_SINGULARITIES],
    /// The links that show why, of each singularity that they are drawn for.
    pub(super) why: [Vec<usize>; MAX_SINGULARITIES],
    pub(super) motion: NullMotion,
    /// How many ghosts each link has.
    pub(super) ghosts: [usize; MAX_DOF],
    /// Whether this part has the mesh of each link's ghosts.
    pub(super) ghost_drawn: [bool; MAX_DOF],
    pub(super) situation: Option<Situation>,
    /// Of a steered arm: the reason last written at the hand, its joint and side; and the way down from there, in the hand's axes.
    pub(super) reason: Option<((u32, u32, u32), Vec3)>,
    pub(super) history: History,
    /// Faults in force.
    pub(super) faults: Vec<Fault>,
    /// All that the lane of faults has said.
    pub(super) fault_states: Vec<String>,
    /// Ticks since the last command.
    pub(super) unheard: u64,
    pub(super) lanes: Lanes,
    pub(super) incarnations: [u32; WRITERS],
    pub(super) hops: Option<ChainHops>,
}

/// A recording's description of its run.
pub(super) struct Title {
    pub(super) name: String,
    pub(super) properties: [(&'static str, String); 6],
}

/// A fault in force: its number, its words for the lane and for the headline, and when it is over, as soon as that is known.
pub(super) struct Fault {
    pub(super) number: usize,
    pub(super) lane: String,
    pub(super) headline: String,
    pub(super) until: Option<u64>,
}

/// The sector that ζ has swept.
#[derive(Clone, Debug)]
pub(super) struct Swept {
    /// ζ at successive steps, from entry on.
    pub(super) directions: Vec<Vec3>,
    /// The hand when ζ had been turned.
    pub(super) freed: Option<glam::Mat3>,
    /// Degrees of the rotation about the old ζ when last told.
    pub(super) told_deg: f32,
    /// Whether the arm has left the singularity behind.
    pub(super) is_over: bool,
}

/// How many of the processes with a lane write a topic: all but the recorder.
pub(super) const WRITERS: usize = LIVES - 1;

/// The text of each lane of the state timeline.
#[derive(Debug, Default)]
pub(super) struct Lanes {
    pub(super) modes: [Option<u32>; MAX_SINGULARITIES],
    pub(super) drive: Option<u32>,
    pub(super) phase: Option<u32>,
    pub(super) life: [Option<&'static str>; WRITERS],
    /// Ticks for which each writer's message has been missing.
    pub(super) missing: [u64; WRITERS],
    /// Until when each writer, and the recorder, counts as restarted.
    pub(super) fresh_until: [u64; LIVES],
    pub(super) recorder: Option<&'static str>,
    pub(super) fault: Option<String>,
}

impl Recording {
    /// A tick's place on both time lines.
    pub(super) fn at(&self, tick: u64) -> TimePoint {
        TimePoint::from([
            ("tick", TimeCell::from_sequence(tick as i64)),
            ("t", TimeCell::from_duration_nanos(self.nanoseconds(tick))),
        ])
    }

    pub(super) fn nanoseconds(&self, tick: u64) -> i64 {
        (u128::from(tick) * 1_000_000_000 / u128::from(self.rate_hz)) as i64
    }

    /// Adds a row that is written with others of its place: a chunk costs more than a thousand bytes, whatever it holds.
    pub(super) fn log(
        &mut self,
        tick: u64,
        path: impl Into<EntityPath>,
        archetype: &dyn AsComponents,
    ) {
        let (path, at) = (path.into(), self.at(tick));
        // A handful, told apart by their hashes: to order them by their paths would cost more than a row.
        let place = self
            .pending
            .iter()
            .position(|(known, _)| *known == path)
            .unwrap_or_else(|| {
                self.pending.push((path.clone(), None));
                self.pending.len() - 1
            });
        let (_, waiting) = &mut self.pending[place];
        let rows = waiting.take().unwrap_or_else(|| Chunk::builder(path));
        *waiting = Some(rows.with_archetype(RowId::new(), at, archetype));
    }

    /// Writes the rows that wait: those of the picture, or all others, too.
    pub(super) fn write_pending(&mut self, is_picture: bool) {
        let world = EntityPath::from(entity::WORLD);
        for (path, rows) in std::mem::take(&mut self.pending) {
            match rows {
                Some(rows) if path.starts_with(&world) == is_picture => {
                    self.sink.chunk(&self.store, rows.build())
                }
                rows => self.pending.push((path, rows)),
            }
        }
        if !is_picture {
            self.written.changes = self.changes_next;
        }
    }

    pub(super) fn log_static(&mut self, path: impl Into<EntityPath>, archetype: &dyn AsComponents) {
        let chunk = Chunk::builder(path)
            .with_archetype(RowId::new(), TimePoint::default(), archetype)
            .build();
        self.sink.chunk(&self.store, chunk);
    }

    pub(super) fn chunk_of(
        &self,
        path: &str,
        ticks: &[u64],
        components: impl IntoIterator<Item = SerializedComponentColumn>,
    ) -> re_chunk::ChunkResult<Chunk> {
        let first = RowId::new();
        let rows: Vec<RowId> = (0..ticks.len())
            .map(|k| first.incremented_by(k as u64))
            .collect();
        let column = |timeline: Timeline, times: Vec<i64>| {
            (
                *timeline.name(),
                TimeColumn::new(Some(true), timeline, ScalarBuffer::from(times)),
            )
        };
        let timelines = [
            column(
                Timeline::new_sequence("tick"),
                ticks.iter().map(|tick| *tick as i64).collect(),
            ),
            column(
                Timeline::new_duration("t"),
                ticks.iter().map(|tick| self.nanoseconds(*tick)).collect(),
            ),
        ];
        let components: ChunkComponents = components.into_iter().collect();
        Chunk::from_native_row_ids(
            ChunkId::new(),
            path.into(),
            Some(true),
            &rows,
            timelines.into_iter().collect(),
            components,
        )
    }
}

impl Title {
    pub(super) fn new(run: &RunInfo) -> Self {
        let RunInfo {
            scenario, robot, ..
        } = *run;
        let name = if scenario.title.is_empty() {
            &scenario.name
        } else {
            &scenario.title
        };
        let properties = [
            ("scenario", scenario.name.clone()),
            ("robot", robot.name.clone()),
            ("run", run.run.to_owned()),
            ("seed", run.seed.to_string()),
            ("rate_hz", scenario.rate_hz.to_string()),
            ("armplane", run.version.to_owned()),
        ];
        Self {
            name: name.clone(),
            properties,
        }
    }
}

/// The other law's arm since the last chunk, and the last words on both.
#[derive(Default)]
pub(super) struct Rival {
    pub(super) links: Vec<Track>,
    pub(super) path: Vec<(u64, Vec3)>,
    pub(super) words: String,
}
