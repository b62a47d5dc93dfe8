//! A recording in the making, from its first tick to its end.

mod eye;
mod lanes;
mod marks;
mod picture;
mod rows;
mod shapes;
mod steered;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use model::{Joint, JointKind, Model, Robot};
use nalgebra::{SMatrix, SVector, Vector3};
use re_chunk::external::arrow::array::{Array, Float64Array, StringArray};
use re_chunk::{EntityPath, TimeColumn, TimePoint};
use re_log_types::{ApplicationId, StoreId, StoreKind, TimeCell};
use re_sdk_types::archetypes::{RecordingInfo, TextDocument, TextLog};
use re_sdk_types::components::{TextLogLevel, Timestamp};
use re_sdk_types::{AnyValues, AsComponents, DynamicArchetype, SerializedComponentColumn};
use shared_types::scenario::{Layout, Scenario, Segment, View};
use shared_types::{MAX_DOF, MAX_SINGULARITIES};

use crate::arm::{Figure, placement, vec3};
use crate::blueprint::{self, BAND_LINES, Eye, Subject, Way};
use crate::entity::{self, Lives};
use crate::manipulability::{at_point, singular_values};
use crate::meshes::Meshes;
use crate::narration::{History, colour_of};
use crate::parts::{create, part_name};
use crate::scene::{Mark, NullMotion};
use crate::signals::{ChainHops, Kept, Limits, Now, Signal, TickRow};
use crate::sink::{RecordError, Sink, Storage};
use crate::solid::Placement;
pub(crate) use eye::Room;
use eye::{Stretches, close_up};
use lanes::{Fault, LANES};
use marks::Shown;
use rows::{Table, Track};

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
    sink: Sink,
    store: StoreId,
    run: Facts,
    subject: Subject,
    /// Number of the present part.
    number: u32,
    part: Part,
    story: Story,
    /// The last words on both laws, in a race.
    rival: Option<String>,
    signals: Table,
    /// Values only drawn, every so many ticks.
    drawn: Table,
    /// Places since the last chunk.
    tracks: BTreeMap<String, Track>,
    /// Lines that grow: the last point of a chunk is the first of the next.
    ways: [Vec<(u64, glam::Vec3)>; 5],
    /// The last tick taken in.
    last: Option<u64>,
    /// The first tick of which nothing is on file.
    next: u64,
}

/// What is known of a run before its first tick, but for what its layout depends on ([`Subject`]).
struct Facts {
    options: Options,
    layout: Layout,
    segments: Vec<Segment>,
    rate_hz: u32,
    title: String,
    properties: [(&'static str, String); 7],
    arm: Model<MAX_DOF>,
    figure: Figure,
    /// About meshes that could not be read.
    lacking: Option<String>,
    /// The axes of the hand's twist that the task has.
    task: [bool; 6],
    limits: Limits,
    hops: Option<ChainHops>,
}

/// What the present part says already: values that are written only on change are written in each part again.
#[derive(Default)]
struct Part {
    ticks: u64,
    /// The blueprint waits for the first report, which names the singularities.
    blueprint_sent: bool,
    marks: [Shown; MAX_SINGULARITIES],
    /// How many ghosts each link has.
    ghosts: [usize; MAX_DOF],
    /// The paths of what is drawn and may be cleared.
    drawn: BTreeSet<String>,
    /// The words last written, to be written again when a fault comes or goes.
    told: String,
    /// The captions in the picture.
    captions: [String; 2],
    lanes: [&'static str; LANES],
    fault: Option<String>,
    /// Until when each process with a lane counts as restarted.
    fresh_until: [u64; entity::LIVES],
}

/// What has happened in the run so far.
struct Story {
    stretches: Stretches,
    room: Room,
    motion: NullMotion,
    history: History,
    /// Faults in force.
    faults: Vec<Fault>,
    /// All that the lane of faults has said.
    fault_states: Vec<String>,
    /// Ticks since the last command.
    unheard: u64,
    /// For how many ticks each writer's message has been missing, and its incarnation.
    missing: [u64; entity::LIVES],
    incarnations: [u32; entity::LIVES],
}

/// Writes a layout for a run as a `.rbl` file, to be opened beside its recording; `first` names the singularities and places the eye.
///
/// # Errors
/// [`RecordError`] where the file cannot be made or written, or the robot has more joints than a message.
pub fn save_blueprint(
    path: &Path,
    run: &RunInfo,
    first: &TickRow,
    layout: Layout,
) -> Result<(), RecordError> {
    let scenario = Scenario {
        view: View { layout },
        ..run.scenario.clone()
    };
    let run = RunInfo {
        scenario: &scenario,
        ..run.clone()
    };
    let mut recording = Recording::with_storage(std::io::sink(), 0, &run, Options::default())?;
    recording.tick(first)?;
    let mut sink = Sink::new(Box::new(create(path)?), &recording.blueprint())?;
    sink.send_blueprint(
        &recording.blueprint(),
        blueprint::layout(&recording.subject, layout, None),
    );
    sink.finish().map(drop)
}

/// How far guides go on after the last tick, as a share of the time before it. Plots are as long as what they hold: at the end of the lines
/// a legend of short names has room, and hides none of them.
const LEGEND: f64 = 0.3;
/// Seconds that a plot shows by itself: half of them before the cursor.
const PLOTTED_S: f64 = 60.0;
/// Rate of what is only drawn: more than a plot has points across.
const DRAWN_HZ: f64 = 125.0;

impl Recording {
    /// Creates the first part in `folder` and writes what never changes: the run's properties, the arm's figure, styles.
    ///
    /// # Errors
    /// [`RecordError`] where the file cannot be made or written, or the robot has more joints than a message.
    pub fn create(folder: &Path, run: &RunInfo) -> Result<Self, RecordError> {
        Self::create_part(folder, 0, run, Options::default())
    }

    /// Creates part `part` of the recording of this run: the next one ([`parts_in`](crate::parts_in)) after the recorder before was killed.
    ///
    /// # Errors
    /// As [`create`](Self::create).
    pub fn create_part(
        folder: &Path,
        part: u32,
        run: &RunInfo,
        options: Options,
    ) -> Result<Self, RecordError> {
        Self::with_storage(create(&folder.join(part_name(part)))?, part, run, options)
    }

    /// [`create_part`](Recording::create_part) for any storage.
    ///
    /// # Errors
    /// As [`create`](Recording::create).
    pub fn with_storage(
        storage: impl Storage + 'static,
        part: u32,
        run: &RunInfo,
        options: Options,
    ) -> Result<Self, RecordError> {
        let run_facts = Facts::new(run, options)?;
        // Recordings of one robot share their blueprint.
        let application = ApplicationId::new_or_unknown(format!("armplane-{}", run.robot.name));
        let store = StoreId::recording(application, run.run);
        let is_seldom = |kept| matches!(kept, Kept::Slow | Kept::Drawn);
        let mut recording = Self {
            sink: Sink::new(Box::new(storage), &store)?,
            store,
            number: part,
            subject: subject(run, options),
            part: Part::default(),
            story: Story::new(run),
            rival: None,
            signals: Table::of(
                |kept| matches!(kept, Kept::F64 | Kept::F32 | Kept::Short | Kept::Log(_)),
                false,
            ),
            drawn: Table::of(is_seldom, options.is_live),
            tracks: BTreeMap::new(),
            ways: Default::default(),
            last: None,
            next: 0,
            run: run_facts,
        };
        recording.open()?;
        Ok(recording)
    }

    /// The beginning of every part.
    fn open(&mut self) -> Result<(), RecordError> {
        self.write_properties();
        self.write_figure();
        self.style_lanes();
        self.sink.flush();
        self.sink.check()
    }

    /// Ends the present part and goes on in the next one, which repeats what a part needs to be opened alone.
    ///
    /// # Errors
    /// As [`create`](Self::create); the recording has then ended, its parts are whole.
    pub fn next_part(&mut self, folder: &Path) -> Result<(), RecordError> {
        let storage = create(&folder.join(part_name(self.number + 1)))?;
        self.last
            .into_iter()
            .for_each(|last| self.write_guides(last));
        self.flush();
        // The part's end comes first: who follows the files goes on as soon as the next one holds something.
        self.sink.finish()?;
        self.sink = Sink::new(Box::new(storage), &self.store)?;
        self.number += 1;
        self.part = Part::default();
        self.open()
    }

    /// Takes a tick in. Ticks must come in order; a tick that was lost leaves a gap, and one that is on file already is left out.
    ///
    /// # Errors
    /// [`RecordError`] when it ends the recording, once; ticks after it are not recorded.
    pub fn tick(&mut self, row: &TickRow) -> Result<(), RecordError> {
        if self.sink.is_closed() {
            return Ok(());
        }
        self.last = Some(row.tick);
        if row.tick < self.next {
            return Ok(());
        }
        if self.part.ticks == 0 {
            self.write_ghosts(row.tick);
            if let Some(q) = row.q() {
                self.write_turned(row.tick, &self.links(q), true);
            }
        }
        self.part.ticks += 1;
        if !self.part.blueprint_sent && row.singularity.is_some() {
            self.introduce(row);
        }
        self.gather(row);
        self.write_changes(row);
        if self.is_pictured(row.tick) {
            self.see(row);
        }
        // Pieces of a line that lets through what is behind it are darker where they meet: as few as can be.
        let is_followed = self.run.options.is_live && row.tick.is_multiple_of(self.every(5.0));
        if self.part.ticks == 1 || is_followed {
            self.write_guides(row.tick);
        }
        if self.signals.ticks.len() as u64 >= self.every(self.run.options.chunk_s) {
            self.flush();
        }
        self.sink.check()
    }

    /// A sentence about meshes of the arm that could not be read.
    #[must_use]
    pub fn lacking(&self) -> Option<&str> {
        self.run.lacking.as_deref()
    }

    /// The numbers of a tick.
    fn gather(&mut self, row: &TickRow) {
        let now = Now::new(row, &self.run.limits, self.run.hops);
        self.signals.push(&now);
        if !row.tick.is_multiple_of(self.every(1.0 / DRAWN_HZ)) {
            return;
        }
        let gravity = row
            .q()
            .map(|q| self.run.arm.gravity(&SVector::from(*q)))
            .unwrap_or_default();
        let mut faults = self.story.faults.iter();
        let now = Now {
            gravity: gravity.as_slice(),
            sigma: self.singular_values(row),
            is_faulty: faults.any(|fault| fault.until.is_none_or(|until| row.tick < until)),
            ..now
        };
        self.drawn.push(&now);
    }

    /// The Jacobian at the point that the report is of.
    fn jacobian(&self, q: &SVector<f64, MAX_DOF>, p_BC: [f64; 3]) -> SMatrix<f64, 6, MAX_DOF> {
        let r_EC = Vector3::from(p_BC) - self.run.arm.forward_kinematics(q).p;
        at_point(self.run.arm.jacobian(q), &r_EC)
    }

    /// Singular values of the unit-scaled Jacobian in the posture that has been analysed, the estimated one: the law has no use for them, so they are
    /// computed where they are drawn.
    fn singular_values(&self, row: &TickRow) -> Option<[f64; 6]> {
        let report = row.singularity?;
        let q = row
            .estimate
            .map(|estimate| &estimate.q)
            .or_else(|| row.q())?;
        let J = self.jacobian(&SVector::from(*q), report.p_BC);
        Some(singular_values(&J, report.length_m, &self.run.task))
    }

    /// How far it has come.
    pub fn written(&self) -> Written {
        Written {
            next: self.next,
            part: self.number,
            bytes: self.part_bytes(),
        }
    }

    /// Goes on where an earlier part had come to, which a recorder that was killed has left: ticks that come again are not written again. What is behind
    /// that place is taken away before, by [`cut_behind`](crate::cut_behind).
    pub fn go_on_after(&mut self, written: Written) {
        self.next = written.next;
    }

    /// Notes an event.
    pub fn event(&mut self, tick: u64, level: Level, text: &str) {
        let level = match level {
            Level::Info => TextLogLevel::INFO,
            Level::Warning => TextLogLevel::WARN,
            Level::Error => TextLogLevel::ERROR,
        };
        // The viewer's column of times cuts them: the line has its own.
        let t_s = self.nanoseconds(tick) as f64 * 1e-9;
        let text = format!("{t_s:.3}{}{text}", entity::AFTER_TIME);
        self.log(tick, entity::LOG, &TextLog::new(text).with_level(level));
    }

    /// Writes out what is being gathered.
    pub fn flush(&mut self) {
        self.write_picture();
        // Values held between their rows come first, so that readers of the signals have them.
        let drawn = self.drawn.take();
        self.send_columns(entity::DRAWN, &drawn.0, drawn.1);
        let (ticks, columns) = self.signals.take();
        self.send_columns(entity::SIGNALS, &ticks, columns);
        self.next = ticks.last().map_or(self.next, |last| last + 1);
        self.sink.flush();
    }

    /// Size of the present part; bytes.
    pub fn part_bytes(&self) -> u64 {
        self.sink.bytes()
    }

    /// Ticks in the present part.
    pub fn part_ticks(&self) -> u64 {
        self.part.ticks
    }

    /// Ends the recording: everything gathered, the footer, and `sync`.
    ///
    /// # Errors
    /// [`RecordError`] where one ended the recording and has not been answered yet; the file is readable nevertheless.
    pub fn finish(mut self) -> Result<(), RecordError> {
        if !self.part.blueprint_sent {
            self.introduce(&TickRow::default());
        }
        self.flush();
        if let Some(last) = self.last {
            let is_live = self.run.options.is_live;
            let beyond = if is_live { 0.0 } else { LEGEND };
            self.write_guides(last + (beyond * self.part.ticks as f64) as u64);
            // A viewer that follows a live run must not loop.
            if !is_live {
                self.write_ending(last);
            }
        }
        self.sink.finish().map(drop)
    }

    fn nanoseconds(&self, tick: u64) -> i64 {
        (u128::from(tick) * 1_000_000_000 / u128::from(self.run.rate_hz)) as i64
    }

    /// Ticks in so many seconds, at least one.
    fn every(&self, seconds: f64) -> u64 {
        (seconds * f64::from(self.run.rate_hz)).round().max(1.0) as u64
    }

    /// Whether a tick has a picture.
    fn is_pictured(&self, tick: u64) -> bool {
        tick.is_multiple_of(self.every(1.0 / self.run.options.picture_hz))
    }

    /// Where the links are.
    fn links(&self, q: &[f64; MAX_DOF]) -> [Placement; MAX_DOF] {
        let poses = self.run.arm.link_poses(&SVector::from(*q));
        poses.map(|X| placement(&X))
    }

    /// Adds a row that is written with the next chunks.
    fn log(&self, tick: u64, path: impl AsRef<str>, archetype: &dyn AsComponents) {
        self.sink.stream.set_timepoint(TimePoint::from([
            ("tick", TimeCell::from_sequence(tick as i64)),
            ("t", TimeCell::from_duration_nanos(self.nanoseconds(tick))),
        ]));
        self.sink
            .done(self.sink.stream.log(path.as_ref(), archetype));
    }

    fn log_static(&self, path: impl Into<EntityPath>, archetype: &dyn AsComponents) {
        self.sink.done(self.sink.stream.log_static(path, archetype));
    }

    /// Rows of one place, gathered as columns; nothing where there are none.
    fn send_columns(&self, path: &str, ticks: &[u64], columns: Vec<SerializedComponentColumn>) {
        let times = ticks.iter().map(|tick| self.nanoseconds(*tick));
        let times = [
            TimeColumn::new_sequence("tick", ticks.iter().map(|tick| *tick as i64)),
            TimeColumn::new_duration_nanos("t", times),
        ];
        if !ticks.is_empty() {
            self.sink
                .done(self.sink.stream.send_columns(path, times, columns));
        }
    }

    fn write_properties(&mut self) {
        let info = RecordingInfo::new().with_name(self.run.title.as_str());
        // The first part holds the time of its beginning.
        let info = match self.number {
            0 => info.with_start_time(Timestamp::now()),
            _ => info,
        };
        self.log_static(EntityPath::properties(), &info);
        let properties = self.run.properties.iter();
        let properties = properties.fold(DynamicArchetype::new("run"), |all, (name, value)| {
            all.with_component_from_data(*name, array(StringArray::from_iter([Some(value)])))
        });
        self.log_static(EntityPath::properties().join(&"run".into()), &properties);
        let recorded = Signal::recorded().filter(|signal| signal.of().kept != Kept::Derived);
        let about: Vec<String> = recorded
            .map(|signal| format!("`{}`: {}", signal.component(), signal.about()))
            .collect();
        let about = TextDocument::from_markdown(about.join("\n\n"));
        self.log_static("/signals/about", &about);
        let limits = self
            .run
            .limits
            .named()
            .map(|(name, values)| (name, values.clone()));
        self.log_static(entity::SIGNALS, &numbers(limits));
    }

    /// At a part's first report: names and thresholds, the eye's place, and with them the blueprint.
    fn introduce(&mut self, row: &TickRow) {
        self.part.blueprint_sent = true;
        if self.subject.singularities.is_empty() {
            self.meet(row);
        }
        let names = self.subject.singularities.iter().map(|(name, _)| name);
        let names = array(StringArray::from_iter_values(names));
        let names = AnyValues::default().with_component_from_data(entity::SINGULARITY_NAMES, names);
        self.log_static(entity::SIGNALS, &names);
        self.style_modes();
        let layout = blueprint::layout(&self.subject, self.run.layout, None);
        self.sink.send_blueprint(&self.blueprint(), layout);
    }

    fn meet(&mut self, row: &TickRow) {
        for (i, one) in row.singularities().iter().enumerate() {
            let name = shared_types::codes::singularity_name(one.kind, i).to_owned();
            self.subject
                .singularities
                .push((name, colour_of(one.kind, i)));
            let outer = one.eta_out / one.eta_in.max(1e-9);
            if !self.subject.outer.contains(&outer) {
                self.subject.outer.push(outer);
            }
        }
        let corners = |q| self.run.figure.corners(&self.links(q)).collect();
        let corners: Vec<_> = row.q().map_or_else(Vec::new, corners);
        self.story.room = Room::of(&corners);
        self.subject.eye = self.eye();
        self.subject.close_up = self.near_by(row);
    }

    /// An eye that sees all of the arm's way so far.
    fn eye(&self) -> Eye {
        self.story
            .room
            .eye(self.mark_size(), &self.subject, !self.run.task[2])
    }

    /// An eye near the hand that stands still, or near the nearest singularity.
    fn near_by(&self, row: &TickRow) -> Eye {
        let (main, unit) = (self.subject.eye, self.mark_size());
        if self.subject.stands_still {
            // From where the arm is seen, onto the hand.
            let hand =
                |q: &[f64; MAX_DOF]| vec3(&self.run.arm.forward_kinematics(&SVector::from(*q)).p);
            let hand = row.q().map_or(glam::Vec3::X, hand);
            let away = (main.position - main.look_at).normalize_or(glam::Vec3::Z) * (5.5 * unit);
            return Eye {
                position: hand + away,
                look_at: hand,
                up: main.up,
            };
        }
        let nearness = |one: &shared_types::SingularityState| one.s.abs() / one.eta_in;
        let near = row.singularities().iter();
        let near = near.min_by(|a, b| nearness(a).total_cmp(&nearness(b)));
        near.zip(row.singularity).map_or(main, |(one, report)| {
            let mark = Mark::new(one, report.p_BC);
            close_up(mark.X_BS.p, [mark.zeta(); 2], glam::Vec3::ZERO, unit, &main)
        })
    }

    /// The layout again with what is known at the end only: the stretch to repeat, the eyes, and a bar for faults that nobody planned.
    fn write_ending(&mut self, last: u64) {
        let before = blueprint::layout(&self.subject, self.run.layout, None);
        // A way that no plan told: an eye that sees all of it.
        let (main, planned) = (self.eye(), self.subject.eye);
        if main.position.distance(planned.position) > 0.05 * main.position.distance(main.look_at) {
            self.subject.eye = main;
        }
        let (story, unit) = (&self.story, self.mark_size());
        let ending = match self.run.layout {
            Layout::Control if !self.subject.stands_still => {
                let stretch = story.stretches.ending(self.run.rate_hz, last, unit, &main);
                let hand = || Some(((0, last), story.room.close_up(unit, &main)?));
                stretch.or_else(hand)
            }
            _ => None,
        };
        let ((first, last), close_up) = ending.unwrap_or(((0, last), self.subject.close_up));
        self.subject.close_up = close_up;
        self.subject.faults |= !self.story.fault_states.is_empty();
        let repeated = (self.nanoseconds(first), self.nanoseconds(last));
        let after = blueprint::layout(&self.subject, self.run.layout, Some(repeated));
        let chunks = blueprint::changed(&before, after);
        self.sink.send_blueprint(&self.blueprint(), chunks);
    }

    /// The blueprint's own store: one per recording, the same in every part.
    fn blueprint(&self) -> StoreId {
        let id = format!("{}-blueprint", self.store.recording_id());
        StoreId::new(
            StoreKind::Blueprint,
            self.store.application_id().clone(),
            id,
        )
    }

    /// Lines that never move, as often as a plot needs to draw them.
    fn write_guides(&self, tick: u64) {
        let [position, orientation] = self.subject.goal.map(|goal| goal.into_iter().collect());
        let band = |k: usize| -3.1 * k as f64 / BAND_LINES as f64;
        let guides = [
            ("guide:zero", vec![0.0]),
            ("guide:band", (0..BAND_LINES).map(band).collect()),
            (
                "guide:edge",
                self.subject
                    .outer
                    .iter()
                    .map(|ratio| ratio.log10())
                    .collect(),
            ),
            ("guide:goal_position", position),
            ("guide:goal_orientation", orientation),
        ];
        self.log(tick, entity::GUIDES, &numbers(guides));
    }
}

fn array(values: impl Array + 'static) -> re_chunk::external::arrow::array::ArrayRef {
    std::sync::Arc::new(values)
}

/// Components of our own.
fn numbers<const N: usize>(columns: [(&'static str, Vec<f64>); N]) -> AnyValues {
    columns
        .into_iter()
        .fold(AnyValues::default(), |all, (name, values)| {
            all.with_component_from_data(name, array(Float64Array::from(values)))
        })
}

impl Facts {
    fn new(run: &RunInfo, options: Options) -> Result<Self, RecordError> {
        let RunInfo {
            scenario, robot, ..
        } = *run;
        let arm = Model::new(robot, scenario.frame()).map_err(|error| RecordError::Arm {
            robot: robot.name.clone(),
            reason: error.to_string(),
        })?;
        let (meshes, lacking) = Meshes::of(robot);
        let title = match scenario.title.as_str() {
            "" => &scenario.name,
            _ => &scenario.title,
        };
        Ok(Self {
            options,
            layout: scenario.view.layout,
            segments: scenario.segment.clone(),
            rate_hz: scenario.rate_hz.max(1),
            title: title.clone(),
            properties: [
                ("scenario", scenario.name.clone()),
                ("robot", robot.name.clone()),
                ("run", run.run.to_owned()),
                ("seed", run.seed.to_string()),
                ("rate_hz", scenario.rate_hz.to_string()),
                ("armplane", run.version.to_owned()),
                ("joint_units", joint_units(robot).join(" ")),
            ],
            arm,
            figure: Figure::new(robot, floor_m(scenario), &meshes),
            lacking,
            task: robot.task.0,
            limits: Limits::new(robot),
            hops: run.hops,
        })
    }
}

impl Story {
    fn new(run: &RunInfo) -> Self {
        Self {
            stretches: Stretches::default(),
            room: Room::default(),
            motion: NullMotion::new(run.robot.length_m),
            history: History::new(stands_still(run.scenario)),
            faults: Vec::new(),
            fault_states: Vec::new(),
            unheard: 0,
            missing: Default::default(),
            incarnations: Default::default(),
        }
    }
}

pub(crate) fn floor_m(scenario: &Scenario) -> f32 {
    scenario.plant.floor_m.map_or(0.0, |height| height as f32)
}

/// Whether the task is null-space motion alone: every segment holds the hand, and some change the posture.
fn stands_still(scenario: &Scenario) -> bool {
    let holds = |one: &Segment| {
        Segment {
            posture_deg: None,
            posture_q: None,
            ..one.clone()
        } == Segment {
            duration_s: one.duration_s,
            branch: one.branch,
            ..Segment::default()
        }
    };
    scenario.segment.iter().all(holds) && scenario.segment.iter().any(|one| one.posture().is_some())
}

/// The unit of each joint's positions.
fn joint_units(robot: &Robot) -> Vec<&'static str> {
    let unit = |joint: &Joint| match joint.kind {
        JointKind::Prismatic => "m",
        _ => "rad",
    };
    robot.joints.iter().map(unit).collect()
}

/// Units of speeds and of loads, where joints have no limits.
pub(crate) fn axis_units(robot: &Robot) -> [&'static str; 2] {
    match joint_units(robot).contains(&"m") {
        true => [", rad/s or m/s", ", N·m or N"],
        false => [", rad/s", ", N·m"],
    }
}

/// What a layout depends on, but for the singularities, which the first report names.
fn subject(run: &RunInfo, options: Options) -> Subject {
    let RunInfo {
        scenario, robot, ..
    } = *run;
    let judged = |bound: f64, most: f64| Some(bound).filter(|bound| *bound < most);
    let goal = &scenario.goal;
    Subject {
        lives: run.lives.clone(),
        joints: robot.joints.len(),
        units: axis_units(robot),
        floor_m: floor_m(scenario),
        pane: blueprint::pane(scenario.view.layout),
        goal: [
            judged(goal.position_mm, 1000.0),
            judged(goal.orientation_deg, 180.0),
        ],
        faults: !scenario.fault.is_empty() || options.is_live,
        is_long: (1.0 + LEGEND) * scenario.duration_s() > PLOTTED_S && !options.is_live,
        stands_still: stands_still(scenario),
        without_orientation: !robot.task.0[3..].contains(&true),
        ways: scenario.segment.iter().filter_map(Way::of).collect(),
        unlimited_torque: robot.joints.iter().any(|joint| !joint.effort.is_finite()),
        unlimited_speed: robot.joints.iter().any(|joint| !joint.velocity.is_finite()),
        ..Subject::default()
    }
}

#[cfg(test)]
mod tests;
