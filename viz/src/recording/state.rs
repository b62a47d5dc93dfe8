//! The state of a recording in the making.

use glam::Vec3;
use model::{Model, Robot};
use nalgebra::SVector;
use re_chunk::{EntityPath, TimeColumn, TimePoint};
use re_log_types::{StoreId, TimeCell};
use re_sdk_types::{AsComponents, SerializedComponentColumn};
use shared_types::scenario::{Layout, Scenario};
use shared_types::{MAX_DOF, MAX_SINGULARITIES};

use super::columns::{Picture, Table, Track};
use super::ending::Stretches;
use super::pieces::Room;
use crate::arm::{Figure, placement};
use crate::blueprint::Subject;
use crate::narration::{History, Situation};
use crate::scene::{Look, NullMotion};
use crate::signals::{ChainHops, LIVES, Limits, Lives};
use crate::sink::{FileInfo, Sink};
use crate::solid::Placement;

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
    /// A chunk is written every so many seconds of the run: what a killed process leaves unwritten.
    pub chunk_s: f64,
    /// Pictures per second.
    pub picture_hz: f64,
    /// Whether a viewer watches as it is made: the viewer follows the end then, and plays nothing again.
    pub is_live: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            chunk_s: 1.0,
            picture_hz: 50.0,
            is_live: false,
        }
    }
}

/// How far a recording has come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Written {
    /// The first tick of which nothing is on file: everything before it is.
    pub next: u64,
    /// The last part, from 0.
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
    pub(super) run: Facts,
    pub(super) subject: Subject,
    /// The content of the parts before this one.
    pub(super) before: FileInfo,
    pub(super) part: Part,
    pub(super) story: Story,
    /// Another law's run, in a race.
    pub(super) rival: Option<Rival>,
    pub(super) signals: Table,
    /// Values only drawn, every so many ticks.
    pub(super) drawn_table: Table,
    pub(super) picture: Picture,
    /// The last tick taken in.
    pub(super) last: Option<u64>,
    /// The first tick of which nothing is on file.
    pub(super) next: u64,
}

/// What is known of a run before its first tick.
pub(super) struct Facts {
    pub(super) title: Title,
    pub(super) arm: Model<MAX_DOF>,
    pub(super) figure: Figure,
    /// The axes of the hand's twist that the task has.
    pub(super) task: [bool; 6],
    /// Directions that the task has.
    pub(super) directions: usize,
    /// Whether the arm moves in the base's plane only.
    pub(super) planar: bool,
    pub(super) limits: Limits,
    pub(super) hops: Option<ChainHops>,
    pub(super) layout: Layout,
    pub(super) rate_hz: u32,
    pub(super) is_live: bool,
    /// Ticks from one chunk, one picture, one row of what is only drawn to the next.
    pub(super) chunk_every: u64,
    pub(super) picture_every: u64,
    pub(super) drawn_every: u64,
    /// Which segments turn which singularity's ζ, and by how much; degrees.
    pub(super) wanted_turns: Vec<Option<(String, f64)>>,
    /// Which segments rotate the hand, and by how much; degrees.
    pub(super) wanted_rotations: Vec<Option<f64>>,
}

/// What the present part says already: values that are written only on change are written in each part again.
#[derive(Default)]
pub(super) struct Part {
    pub(super) ticks: u64,
    /// The blueprint waits for the first report, which names the singularities.
    pub(super) blueprint_sent: bool,
    pub(super) guides_due: u64,
    pub(super) marks: [Look; MAX_SINGULARITIES],
    /// Whether each singularity's ζ turns, of those whose mark's meshes it has.
    pub(super) drawn: [Option<bool>; MAX_SINGULARITIES],
    /// The sector that ζ of each singularity has swept since the arm entered.
    pub(super) swept: [Option<Swept>; MAX_SINGULARITIES],
    /// The links that show why, of each singularity that they are drawn for.
    pub(super) why: [Vec<usize>; MAX_SINGULARITIES],
    /// Whether it has the mesh of each link's ghosts.
    pub(super) ghost_drawn: [bool; MAX_DOF],
    pub(super) situation: Option<Situation>,
    /// Of a steered arm: the reason last written at the hand, its joint and side; and the way down from there, in the hand's axes.
    pub(super) reason: Option<((u32, u32, u32), Vec3)>,
    pub(super) lanes: Lanes,
}

/// What has happened in the run so far.
pub(super) struct Story {
    pub(super) stretches: Stretches,
    pub(super) room: Room,
    pub(super) motion: NullMotion,
    pub(super) history: History,
    /// On which side of its axis each label is.
    pub(super) sides: [f32; MAX_SINGULARITIES],
    /// How many ghosts each link has.
    pub(super) ghosts: [usize; MAX_DOF],
    /// Faults in force.
    pub(super) faults: Vec<Fault>,
    /// All that the lane of faults has said.
    pub(super) fault_states: Vec<String>,
    /// Ticks since the last command.
    pub(super) unheard: u64,
    pub(super) incarnations: [u32; WRITERS],
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
    pub(super) fn nanoseconds(&self, tick: u64) -> i64 {
        (u128::from(tick) * 1_000_000_000 / u128::from(self.run.rate_hz)) as i64
    }

    /// Where the links are.
    pub(super) fn links(&self, q: &[f64]) -> [Placement; MAX_DOF] {
        let poses = self.run.arm.link_poses(&SVector::from_column_slice(q));
        poses.map(|X| placement(&X))
    }

    /// Adds a row that is written with the next chunks.
    pub(super) fn log(&self, tick: u64, path: impl Into<EntityPath>, archetype: &dyn AsComponents) {
        let at = TimePoint::from([
            ("tick", TimeCell::from_sequence(tick as i64)),
            ("t", TimeCell::from_duration_nanos(self.nanoseconds(tick))),
        ]);
        self.sink.log(at, path, archetype);
    }

    pub(super) fn log_static(&self, path: impl Into<EntityPath>, archetype: &dyn AsComponents) {
        self.sink.log_static(path, archetype);
    }

    /// Rows of one place, gathered as columns.
    pub(super) fn send_columns(
        &self,
        path: &str,
        ticks: &[u64],
        columns: impl IntoIterator<Item = SerializedComponentColumn>,
    ) {
        let times = ticks.iter().map(|tick| self.nanoseconds(*tick));
        let times = [
            TimeColumn::new_sequence("tick", ticks.iter().map(|tick| *tick as i64)),
            TimeColumn::new_duration_nanos("t", times),
        ];
        self.sink.send_columns(path, times, columns);
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
