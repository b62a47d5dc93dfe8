//! A recording in the making.

use std::fs::File;
use std::path::{Path, PathBuf};

use glam::Vec3;
use model::{Model, Robot};
use nalgebra::SVector;
use re_chunk::external::arrow::array::{Array, ArrayRef, Float32Array, Float64Array, ListArray};
use re_chunk::external::arrow::buffer::{OffsetBuffer, ScalarBuffer};
use re_chunk::external::arrow::datatypes::Field;
use re_chunk::{Chunk, ChunkComponents, ChunkId, EntityPath, RowId, TimeColumn, TimePoint, Timeline};
use re_log_types::{ApplicationId, StoreId, StoreKind, TimeCell};
use re_sdk_types::archetypes::{
    Arrows3D, Clear, InstancePoses3D, LineStrips3D, Mesh3D, Points3D, RecordingInfo, StateChange, StateConfiguration, TextDocument,
    TextLog, Transform3D,
};
use re_sdk_types::components::{AlbedoFactor, Color, Radius, TextLogLevel, Timestamp};
use re_sdk_types::datatypes::Quaternion;
use re_sdk_types::{AsComponents, ComponentDescriptor, SerializedComponentColumn};
use shared_types::codes::{DRIVES, MODES, PHASES, name_of};
use shared_types::messages::SingularityState;
use shared_types::scenario::{Layout, Scenario};
use shared_types::{MAX_SINGULARITIES, Message};

use crate::arm::{Figure, placement, vec3};
use crate::blueprint::{self, Eye, Subject};
use crate::entity;
use crate::manipulability::{Ellipsoid, Half, at_point};
use crate::narration::{self, Situation, States};
use crate::scene::{self, Look, Mark, NullMotion, Presence, differs, glyph, rotation};
use crate::signals::{Limits, SHARES, Signal, TickRow, Width, sample};
use crate::sink::{FileInfo, RecordError, Sink, Storage};
use crate::solid::{Mesh, Placement, Rgba};

/// Which run a recording is of.
#[derive(Clone, Copy, Debug)]
pub struct RunInfo<'a> {
    /// What was asked for.
    pub scenario: &'a Scenario,
    /// The arm.
    pub robot: &'a Robot,
    /// Identifies the run, and its recording; unique.
    pub run: &'a str,
    /// Version of armplane that made it.
    pub version: &'a str,
    /// Seed of every random number.
    pub seed: u64,
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
}

impl Default for Options {
    fn default() -> Self {
        Self { signal_chunk_s: 0.25, picture_chunk_s: 1.0, picture_hz: 50.0 }
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
/// It may be spread over several files, its parts: each opens alone, all of them together as one recording, because they carry the same
/// recording id. [`next_part`](Self::next_part) turns to a fresh file within a run; [`create_part`](Self::create_part) lets another
/// process take up where one was killed.
///
/// Ensures: nothing blocks but the storage; the first error ends the file at its last whole message and is answered once, by
/// [`tick`](Self::tick) or [`finish`](Self::finish). A killed process leaves a file readable up to its last chunk.
pub struct Recording<const N: usize, W: Storage = File> {
    sink: Sink<W>,
    store: StoreId,
    title: Title,
    /// What the parts before this one hold.
    before: FileInfo,
    /// Ticks of this part.
    part_ticks: u64,
    arm: Model<N>,
    figure: Figure,
    /// Whether the arm moves in the base's plane only.
    planar: bool,
    limits: Limits,
    subject: Subject,
    layout: Layout,
    rate_hz: u32,
    /// The blueprint waits for the first report, which names the singularities.
    blueprint_sent: bool,
    last: Option<u64>,
    written: Written,
    signals: Table,
    signal_rows: usize,
    picture: Picture,
    picture_every: u64,
    picture_rows: usize,
    thresholds: Vec<(f64, f64)>,
    guides_due: u64,
    marks: [Look; MAX_SINGULARITIES],
    /// Class of each singularity whose mark's meshes this part has, and whether it turns.
    drawn: [Option<(u32, bool)>; MAX_SINGULARITIES],
    /// ζ and C of each singularity as last drawn into its fan.
    fans: [Option<Vec3>; MAX_SINGULARITIES],
    motion: NullMotion,
    /// How many ghosts each link has.
    ghosts: [usize; N],
    situation: Option<Situation>,
    /// Ticks since the last command.
    unheard: u64,
    lanes: Lanes,
    incarnations: [u32; PROCESSES.len()],
}

/// What a recording says of its run.
struct Title {
    name: String,
    properties: [(&'static str, String); 6],
}

/// Name of a part of a recording in its folder: `run.rrd`, then `run-001.rrd`, `run-002.rrd` and so on.
#[must_use]
pub fn part_name(part: u32) -> String {
    if part == 0 { "run.rrd".to_owned() } else { format!("run-{part:03}.rrd") }
}

/// The parts of a recording that a folder holds, in order; without one that whoever began it did not live to write anything into.
#[must_use]
pub fn parts_in(folder: &Path) -> Vec<PathBuf> {
    let parts = (0..).map(|part| folder.join(part_name(part))).take_while(|path| path.exists());
    parts.filter(|path| !is_blank(path)).collect()
}

/// Whether a file is empty, or no more than the head of a recording.
fn is_blank(path: &Path) -> bool {
    const HEAD: usize = 64;
    let mut head = Vec::new();
    let read = File::open(path).and_then(|file| std::io::Read::read_to_end(&mut std::io::Read::take(file, HEAD as u64), &mut head));
    read.is_ok() && head.len() < HEAD && (head.is_empty() || head.starts_with(b"RRF"))
}

/// Writers of the five messages.
const PROCESSES: [&str; 4] = ["plant", "estimator", "analyzer", "controller"];

/// A size that cannot be seen. Nothing else hides a mesh that is to come back: none would be its own size, and a cleared one had to be
/// written again.
const UNSEEN: f32 = 1e-6;

/// What each lane of the state timeline says.
#[derive(Debug, Default)]
struct Lanes {
    modes: [Option<u32>; MAX_SINGULARITIES],
    drive: Option<u32>,
    phase: Option<u32>,
    life: [Option<&'static str>; PROCESSES.len()],
}

impl<const N: usize> Recording<N> {
    /// Creates the first part in `folder` and writes what never changes: the run's properties, the arm's figure, styles.
    ///
    /// # Errors
    /// [`RecordError`] where the file cannot be made or written, or the robot does not have N joints.
    pub fn create(folder: &Path, run: &RunInfo) -> Result<Self, RecordError> {
        Self::create_part(folder, 0, run, Options::default())
    }

    /// Creates part `part` of the recording of this run: the next one ([`parts_in`]) after the recorder before was killed.
    ///
    /// # Errors
    /// As [`create`](Self::create).
    pub fn create_part(folder: &Path, part: u32, run: &RunInfo, options: Options) -> Result<Self, RecordError> {
        Self::with_storage(create(&folder.join(part_name(part)))?, part, run, options)
    }

    /// Ends the present part and goes on in the next one, which repeats what a part needs to be opened alone.
    ///
    /// # Errors
    /// As [`create`](Self::create); the recording has then ended, its parts are whole.
    pub fn next_part(&mut self, folder: &Path) -> Result<(), RecordError> {
        let file = create(&folder.join(part_name(self.before.parts + 1)))?;
        self.turn_over(file)
    }
}

/// Writes a layout for a run as a `.rbl` file, to be opened beside its recording; `first` names the singularities and places the eye.
///
/// # Errors
/// [`RecordError`] where the file cannot be made or written, or the robot does not have N joints.
pub fn save_blueprint<const N: usize>(path: &Path, run: &RunInfo, first: &TickRow, layout: Layout) -> Result<(), RecordError> {
    let mut recording = Recording::<N, Nowhere>::with_storage(Nowhere, 0, run, Options::default())?;
    recording.tick(first)?;
    recording.save_blueprint(path, layout)
}

/// Takes everything, keeps nothing.
struct Nowhere;

impl std::io::Write for Nowhere {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Storage for Nowhere {
    fn cut(&mut self, _: u64) -> std::io::Result<()> {
        Ok(())
    }

    fn sync(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

fn create(path: &Path) -> Result<File, RecordError> {
    File::create(path).map_err(|source| RecordError::Create { path: path.display().to_string(), source })
}

impl<const N: usize, W: Storage> Recording<N, W> {
    /// [`create_part`](Recording::create_part) for any storage.
    ///
    /// # Errors
    /// As [`create`](Recording::create).
    pub fn with_storage(storage: W, part: u32, run: &RunInfo, options: Options) -> Result<Self, RecordError> {
        let RunInfo { scenario, robot, .. } = *run;
        let frame = Some(scenario.frame.as_str()).filter(|frame| !frame.is_empty());
        let arm =
            Model::<N>::new(robot, frame).map_err(|error| RecordError::Arm { robot: robot.name.clone(), reason: error.to_string() })?;
        let floor_m = scenario.plant.floor_m.map_or(0.0, |height| height as f32);
        let figure = Figure::new(robot, floor_m);
        let rate = f64::from(scenario.rate_hz);
        let every = |seconds: f64| (seconds * rate).round().max(1.0);
        let unlimited = |limits: fn(&model::Joint) -> f64| robot.joints.iter().any(|joint| !limits(joint).is_finite());
        let subject = Subject {
            joints: robot.joints.len(),
            floor_m,
            unlimited_torque: unlimited(|joint| joint.effort),
            unlimited_speed: unlimited(|joint| joint.velocity),
            ..Subject::default()
        };
        let mut recording = Self {
            sink: Sink::new(storage)?,
            store: StoreId::recording(application(robot), run.run),
            title: Title::new(run),
            before: FileInfo { parts: part, ..FileInfo::default() },
            part_ticks: 0,
            arm,
            figure,
            planar: !robot.task.0[2],
            limits: Limits::new(robot),
            subject,
            layout: scenario.view.layout,
            rate_hz: scenario.rate_hz.max(1),
            blueprint_sent: false,
            last: None,
            written: Written::default(),
            signals: Table::default(),
            signal_rows: every(options.signal_chunk_s) as usize,
            picture: Picture::default(),
            picture_every: every(1.0 / options.picture_hz) as u64,
            picture_rows: (options.picture_chunk_s * options.picture_hz).round().max(1.0) as usize,
            thresholds: Vec::new(),
            guides_due: 0,
            marks: Default::default(),
            drawn: Default::default(),
            fans: Default::default(),
            motion: NullMotion::new(robot.length_m),
            ghosts: [0; N],
            situation: None,
            unheard: 0,
            lanes: Lanes::default(),
            incarnations: Default::default(),
        };
        recording.open()?;
        Ok(recording)
    }

    /// What every part begins with.
    fn open(&mut self) -> Result<(), RecordError> {
        self.sink.announce(&self.store);
        self.write_properties();
        self.write_figure();
        self.sink.check()
    }

    /// Ends the present part and goes on in another storage.
    ///
    /// # Errors
    /// As [`create`](Recording::create).
    pub fn turn_over(&mut self, storage: W) -> Result<(), RecordError> {
        self.flush();
        let (chunks, ended) = (self.sink.chunks(), std::mem::replace(&mut self.sink, Sink::new(storage)?));
        let bytes = ended.finish().inspect_err(|_| self.sink.abandon())?;
        let FileInfo { parts, .. } = self.before;
        self.before = FileInfo {
            bytes: self.before.bytes + bytes,
            chunks: self.before.chunks + chunks,
            ticks: self.before.ticks + self.part_ticks,
            parts: parts + 1,
        };
        // What is told when it changes is told again.
        self.part_ticks = 0;
        self.blueprint_sent = false;
        self.guides_due = 0;
        self.marks = Default::default();
        self.drawn = Default::default();
        self.fans = Default::default();
        self.situation = None;
        self.lanes = Lanes::default();
        self.open()
    }

    /// Takes a tick in. Ticks must come in order; a tick that was lost leaves a gap.
    ///
    /// # Errors
    /// [`RecordError`] when it ends the recording, once; ticks after it are not recorded.
    pub fn tick(&mut self, row: &TickRow) -> Result<(), RecordError> {
        if self.sink.is_closed() {
            return Ok(());
        }
        if self.part_ticks == 0 {
            self.write_ghosts(row.tick, true);
            if let (Some(q), Some(turned)) = (row.q(), self.motion.turned(true)) {
                let links = self.arm.link_poses(&SVector::from_column_slice(&q[..N])).map(|X| placement(&X));
                self.write_turned(row.tick, &links, &turned);
            }
        }
        self.part_ticks += 1;
        self.last = Some(row.tick);
        if !self.blueprint_sent && row.singularity.is_some() {
            self.introduce(row);
        }
        // What an earlier part has is not written again.
        if row.tick >= self.written.signals {
            self.signals.push(row.tick, |put| sample(row, &self.limits, put));
        }
        if self.signals.rows() >= self.signal_rows {
            self.write_signals();
        }
        if row.tick >= self.written.changes {
            self.write_changes(row);
            self.written.changes = row.tick + 1;
        }
        if row.tick.is_multiple_of(self.picture_every) && row.tick >= self.written.picture {
            self.see(row);
            if self.picture.rows() >= self.picture_rows {
                self.write_picture();
            }
        }
        if row.tick >= self.guides_due {
            self.guides_due = row.tick + 2 * u64::from(self.rate_hz);
            self.write_guides(row.tick);
        }
        self.sink.check()
    }

    /// How far it has come.
    pub fn written(&self) -> Written {
        self.written
    }

    /// Goes on where an earlier part had come to, which a recorder that was killed has left: ticks that come again are not written again.
    pub fn go_on_after(&mut self, written: Written) {
        self.written = written;
    }

    /// Notes an event.
    pub fn event(&mut self, tick: u64, level: Level, text: &str) {
        let level = match level {
            Level::Info => TextLogLevel::INFO,
            Level::Warning => TextLogLevel::WARN,
            Level::Error => TextLogLevel::ERROR,
        };
        self.log(tick, entity::LOG, &TextLog::new(text).with_level(level));
    }

    /// Writes out what is being gathered.
    pub fn flush(&mut self) {
        self.write_signals();
        self.write_picture();
    }

    /// Size of all parts so far; bytes.
    pub fn bytes(&self) -> u64 {
        self.before.bytes + self.sink.bytes()
    }

    /// Size of the present part; bytes.
    pub fn part_bytes(&self) -> u64 {
        self.sink.bytes()
    }

    /// Ticks in the present part.
    pub fn part_ticks(&self) -> u64 {
        self.part_ticks
    }

    /// Number of the present part, from 0.
    pub fn part(&self) -> u32 {
        self.before.parts
    }

    /// Ends the recording: everything gathered, the footer, and `sync`.
    ///
    /// # Errors
    /// [`RecordError`] where one ended the recording and has not been answered yet; the file is readable nevertheless.
    pub fn finish(mut self) -> Result<FileInfo, RecordError> {
        if !self.blueprint_sent {
            self.introduce(&TickRow::default());
        }
        self.flush();
        if let Some(last) = self.last {
            self.write_guides(last);
        }
        let (before, chunks) = (self.before, self.before.chunks + self.sink.chunks());
        let ticks = before.ticks + self.part_ticks;
        Ok(FileInfo { bytes: before.bytes + self.sink.finish()?, chunks, ticks, parts: before.parts + 1 })
    }

    /// Writes a layout as a `.rbl` file, to be opened beside any recording of the same robot; after the first tick.
    ///
    /// # Errors
    /// [`RecordError`] where the file cannot be made or written.
    pub fn save_blueprint(&self, path: &Path, layout: Layout) -> Result<(), RecordError> {
        let mut sink = Sink::new(create(path)?)?;
        blueprint::send(&mut sink, &self.blueprint(), &self.subject, layout);
        sink.finish().map(drop)
    }

    // What never changes.

    fn write_properties(&mut self) {
        let info = RecordingInfo::new().with_name(self.title.name.as_str());
        // When it began is what the first part says.
        let info = if self.before.parts == 0 { info.with_start_time(Timestamp::now()) } else { info };
        self.log_static(EntityPath::properties(), &info);
        let columns = self.title.properties.clone().map(|(name, value)| {
            (custom(name, Some("run")), std::sync::Arc::new(re_chunk::external::arrow::array::StringArray::from(vec![value])) as ArrayRef)
        });
        let chunk = Chunk::builder(EntityPath::properties().join(&"run".into())).with_row(RowId::new(), TimePoint::default(), columns);
        self.sink.chunk(&self.store, chunk.build());
        let about: Vec<String> = Signal::ALL.iter().map(|signal| format!("`{}`: {}", signal.name(), signal.about().trim())).collect();
        self.log_static("/signals/about", &TextDocument::from_markdown(about.join("\n\n")));
        let limits = [("joint:qdot_limit", &self.limits.speed), ("joint:torque_limit", &self.limits.torque)];
        let columns =
            limits.map(|(name, values)| (custom(name, None), std::sync::Arc::new(Float64Array::from(values.clone())) as ArrayRef));
        let chunk = Chunk::builder(entity::SIGNALS).with_row(RowId::new(), TimePoint::default(), columns);
        self.sink.chunk(&self.store, chunk.build());
    }

    fn write_figure(&mut self) {
        self.log_static(entity::BASE, &mesh3d(&self.figure.base, None));
        for i in 0..N {
            let (solid, pale) = (mesh3d(&self.figure.links[i], None), mesh3d(&self.figure.links[i], Some([150, 205, 255, 70])));
            self.log_static(entity::link(i), &solid);
            self.log_static(entity::ghost(i), &pale);
        }
        let triad = |length: f32, radius: f32, colours: [u32; 3]| {
            Arrows3D::from_vectors([[length, 0.0, 0.0], [0.0, length, 0.0], [0.0, 0.0, length]]).with_colors(colours).with_radii([radius])
        };
        let size = 0.11 * self.figure.reach;
        self.log_static(entity::HAND, &triad(size, 0.03 * size, [0xf05050ff, 0x60d060ff, 0x5090ffff]));
        self.log_static(entity::TARGET, &triad(1.35 * size, 0.018 * size, [0x90f0b0ff; 3]));
        let mut ball = Mesh::default();
        ball.add_sphere(Placement::IDENTITY, 1.0, [255; 4]);
        self.log_static(entity::VELOCITY, &mesh3d(&ball, Some([90, 170, 255, 60])));
        let circle = |x: Vec3, y: Vec3| -> Vec<[f32; 3]> {
            (0..=48)
                .map(|k| {
                    (x * (std::f32::consts::TAU * k as f32 / 48.0).cos() + y * (std::f32::consts::TAU * k as f32 / 48.0).sin()).to_array()
                })
                .collect()
        };
        let net = LineStrips3D::new([circle(Vec3::X, Vec3::Y), circle(Vec3::Y, Vec3::Z), circle(Vec3::Z, Vec3::X)]);
        let net = net.with_colors([Color::from_unmultiplied_rgba(150, 235, 225, 255)]).with_radii([Radius::new_ui_points(1.0)]);
        self.log_static(entity::MOBILITY, &net);
        for (lane, states) in [("drive", narration::DRIVE_STATES), ("phase", narration::PHASE_STATES)] {
            self.style(entity::state(lane), states);
        }
        for process in PROCESSES {
            self.style(entity::state(&format!("process/{process}")), narration::LIFE_STATES);
        }
    }

    fn style(&mut self, path: String, states: States) {
        let names = || states.iter().map(|(name, _)| *name);
        self.log_static(
            path,
            &StateConfiguration::new().with_values(names()).with_labels(names()).with_colors(states.iter().map(|(_, colour)| *colour)),
        );
    }

    /// At a part's first report: names and thresholds, the eye's place, and with them the blueprint.
    fn introduce(&mut self, row: &TickRow) {
        self.blueprint_sent = true;
        if self.subject.singularities.is_empty() {
            self.meet(row);
        }
        let names: Vec<String> = self.subject.singularities.iter().map(|(name, _)| name.clone()).collect();
        let column: ArrayRef = std::sync::Arc::new(re_chunk::external::arrow::array::StringArray::from(names.clone()));
        let components = [(custom(entity::SINGULARITY_NAMES, None), column)];
        let chunk = Chunk::builder(entity::SIGNALS).with_row(RowId::new(), TimePoint::default(), components);
        self.sink.chunk(&self.store, chunk.build());
        for name in names {
            self.style(entity::state(&format!("mode/{name}")), narration::MODE_STATES);
        }
        let store = self.blueprint();
        blueprint::send(&mut self.sink, &store, &self.subject, self.layout);
    }

    fn meet(&mut self, row: &TickRow) {
        for (i, one) in row.singularities().iter().enumerate() {
            let name = shared_types::codes::singularity_name(one.kind, i);
            self.subject.singularities.push((name, narration::colour_of_kind(one.kind, i)));
            if !self.thresholds.contains(&(one.eta_in, one.eta_out)) {
                self.thresholds.push((one.eta_in, one.eta_out));
            }
        }
        self.subject.bands = self.thresholds.len();
        self.subject.widest = self.thresholds.iter().map(|(_, eta_out)| *eta_out).fold(0.0, f64::max);
        let places = row.q().map(|q| self.arm.link_poses(&SVector::from_column_slice(&q[..N])).map(|X| vec3(&X.p)));
        self.subject.eye = eye(places.as_ref().map_or(&[Vec3::X], |places| &places[..]), self.mark_size(), &self.subject, self.planar);
    }

    /// The blueprint's own store: one per recording, the same in every part.
    fn blueprint(&self) -> StoreId {
        StoreId::new(StoreKind::Blueprint, self.store.application_id().clone(), format!("{}-blueprint", self.store.recording_id()))
    }

    // Numbers.

    fn write_signals(&mut self) {
        if let Some((ticks, components)) = self.signals.take() {
            let chunk = self.chunk_of(entity::SIGNALS, &ticks, components);
            self.sink.chunk(&self.store, chunk);
            self.written.signals = ticks.last().map_or(self.written.signals, |last| last + 1);
        }
    }

    /// Lines that never move, as often as a plot needs to draw them.
    fn write_guides(&mut self, tick: u64) {
        let both = |values: Vec<f64>| -> ArrayRef {
            std::sync::Arc::new(Float64Array::from(values.iter().flat_map(|value| [*value, -value]).collect::<Vec<_>>()))
        };
        let columns = [
            (custom("guide:eta_in", None), both(self.thresholds.iter().map(|(eta_in, _)| *eta_in).collect())),
            (custom("guide:eta_out", None), both(self.thresholds.iter().map(|(_, eta_out)| *eta_out).collect())),
        ];
        let chunk = Chunk::builder(entity::GUIDES).with_row(RowId::new(), self.at(tick), columns).build();
        self.sink.chunk(&self.store, chunk);
    }

    // Modes, states and words, as they change.

    fn write_changes(&mut self, row: &TickRow) {
        let life = |header: Option<&shared_types::Header>| header.map_or(0, |header| header.incarnation);
        let plant = row.sensor.map(Message::header).or(row.plant_state.map(Message::header));
        let now = [
            life(plant),
            life(row.estimate.map(Message::header)),
            life(row.singularity.map(Message::header)),
            life(row.torque.map(Message::header)),
        ];
        for (i, incarnation) in now.into_iter().enumerate() {
            let text = match incarnation {
                0 => "silent",
                1 => "up",
                _ => "restarted",
            };
            if incarnation > self.incarnations[i] {
                if self.incarnations[i] > 0 {
                    self.event(row.tick, Level::Warning, &format!("{} is back as incarnation {incarnation}", PROCESSES[i]));
                }
                self.incarnations[i] = incarnation;
            }
            if self.lanes.life[i] != Some(text) {
                self.lanes.life[i] = Some(text);
                self.lane(row.tick, &format!("process/{}", PROCESSES[i]), text);
            }
        }
        if let Some(sensor) = row.sensor
            && self.lanes.drive != Some(sensor.drive)
        {
            self.lanes.drive = Some(sensor.drive);
            self.lane(row.tick, "drive", name_of(DRIVES, sensor.drive));
        }
        if let Some(command) = row.torque {
            if self.lanes.phase != Some(command.phase) {
                self.lanes.phase = Some(command.phase);
                self.lane(row.tick, "phase", name_of(PHASES, command.phase));
            }
            for i in 0..self.subject.singularities.len().min(MAX_SINGULARITIES) {
                let mode = command.mode[i];
                if self.lanes.modes[i] != Some(mode) {
                    let before = self.lanes.modes[i].replace(mode);
                    let name = self.subject.singularities[i].0.clone();
                    self.lane(row.tick, &format!("mode/{name}"), name_of(MODES, mode));
                    if let Some(before) = before {
                        self.event(row.tick, Level::Info, &format!("{name}: {} → {}", name_of(MODES, before), name_of(MODES, mode)));
                    }
                }
            }
        }
        // A tick or two without a command is not worth a line.
        self.unheard = if row.torque.is_some() { 0 } else { self.unheard + 1 };
        let situation = Situation::of(row);
        let told = row.torque.is_some() && row.singularity.is_some() || self.unheard >= 5;
        if told && self.situation != Some(situation) {
            self.situation = Some(situation);
            self.log(row.tick, entity::NOW, &TextDocument::from_markdown(situation.markdown()));
        }
    }

    fn lane(&mut self, tick: u64, lane: &str, state: &str) {
        self.log(tick, entity::state(lane), &StateChange::single(state));
    }

    // The picture.

    fn see(&mut self, row: &TickRow) {
        let Some(q) = row.q() else { return };
        let links = self.arm.link_poses(&SVector::from_column_slice(&q[..N])).map(|X| placement(&X));
        let desired = row.torque.map(|command| pose(&command.p_BE_d, &command.R_BE_d));
        let hand = row
            .plant_state
            .map(|state| pose(&state.p_BE, &state.R_BE))
            .unwrap_or_else(|| placement(&self.arm.forward_kinematics(&SVector::from_column_slice(&q[..N]))));
        let marks: Vec<Mark> =
            row.singularity.map_or(Vec::new(), |report| row.singularities().iter().map(|one| Mark::new(one, report.p_BC)).collect());
        self.write_marks(row.tick, row.singularities(), &marks);
        if self.motion.update(row) {
            self.write_ghosts(row.tick, false);
        }
        if let Some(turned) = self.motion.turned(false) {
            self.write_turned(row.tick, &links, &turned);
        }
        let unit = self.mark_size();
        self.picture.push(row.tick, &links, &hand, desired.as_ref(), &marks, unit);
        if let Some(report) = row.singularity {
            self.see_manipulability(row.tick, q, report.p_BC, row.singularities(), &marks);
        }
    }

    /// What the hand can do, at C, in the half of the twist that the nearest singularity is of.
    fn see_manipulability(&mut self, tick: u64, q: &[f64], p_BC: [f64; 3], singularities: &[SingularityState], marks: &[Mark]) {
        let near = singularities.iter().zip(marks).filter(|(_, mark)| mark.look.presence != Presence::Hidden);
        let nearest = near.map(|(one, _)| one).min_by(|a, b| (a.s.abs() / a.eta_out).total_cmp(&(b.s.abs() / b.eta_out)));
        let half = if nearest.is_some_and(|one| one.angular == 1) { Half::Angular } else { Half::Linear };
        let (q, p_BC) = (SVector::from_column_slice(&q[..N]), nalgebra::Vector3::from(p_BC));
        let J = at_point(self.arm.jacobian(&q), &(p_BC - self.arm.forward_kinematics(&q).p));
        let unit = 0.62 * self.mark_size();
        let (velocity, mobility) =
            (Ellipsoid::velocity(&J, self.arm.velocity(), half), Ellipsoid::mobility(&J, &self.arm.mass_matrix(&q), half));
        for (track, shape) in self.picture.abilities.iter_mut().zip([Some(velocity), mobility]) {
            let Some(Ellipsoid { axes, half_axes }) = shape else { continue };
            track.push(tick, &Placement { R: axes, p: vec3(&p_BC) });
            // Flat, but not so flat that it has no sides.
            track.sizes.push((half_axes.max(Vec3::splat(0.012)) * unit).to_array());
        }
    }

    /// Marks change their looks rarely; their places go with the picture.
    fn write_marks(&mut self, tick: u64, singularities: &[SingularityState], marks: &[Mark]) {
        for (i, (one, mark)) in singularities.iter().zip(marks).enumerate() {
            let Some((name, _)) = self.subject.singularities.get(i) else { return };
            let (name, fan) = (name.clone(), entity::fan(name));
            if self.marks[i] != mark.look {
                self.marks[i] = mark.look;
                self.write_look(tick, &name, i, mark, &narration::label(one, i));
            }
            let inside = mark.look.presence == Presence::Inside;
            let zeta = mark.zeta();
            // Where ζ was on entry, then every 6°: null-space motion that turns it sweeps a fan, and what stays has none.
            let turned = self.fans[i].is_some_and(|last| last.dot(zeta).abs() < 0.9945);
            if !inside {
                self.fans[i] = None;
            } else if self.fans[i].is_none() {
                self.fans[i] = Some(zeta);
            } else if turned {
                let last = self.fans[i].replace(zeta).unwrap_or(zeta);
                let reach = last * (0.9 * self.mark_size());
                let (from, to) = (mark.X_BS.p - reach, mark.X_BS.p + reach);
                let [r, g, b, _] = narration::colour_of_type(mark.look.class);
                let line = LineStrips3D::new([[from.to_array(), to.to_array()]])
                    .with_colors([Color::from_unmultiplied_rgba(r, g, b, 110)])
                    .with_radii([0.0014 * self.figure.reach]);
                self.log(tick, fan, &line);
            }
        }
    }

    /// The mark's solid, the rings where it is entered and, inside, the other axes of the singular frame and the words.
    fn write_look(&mut self, tick: u64, name: &str, i: usize, mark: &Mark, words: &str) {
        let path = entity::singularity(name);
        let [solid, rings, axes, label] = [entity::glyph(name), entity::edge(name), format!("{path}/axes"), entity::label(name)];
        let [r, g, b, _] = narration::colour_of_type(mark.look.class);
        let unit = self.mark_size();
        // Meshes are large: they are written once, later changes are their tint and their size.
        let shape = (mark.look.class, mark.look.angular);
        if self.drawn[i] != Some(shape) && mark.look.presence != Presence::Hidden {
            self.drawn[i] = Some(shape);
            self.log(tick, &*solid, &mesh3d(&glyph(mark.look.angular, [r, g, b, 255]), None));
            self.log(tick, &*rings, &mesh3d(&scene::rings(mark.edge, unit, [255; 4]), None));
        }
        let is_inside = mark.look.presence == Presence::Inside;
        if mark.look.presence == Presence::Hidden {
            for path in [solid, rings] {
                self.log(tick, path, &Transform3D::update_fields().with_scale(UNSEEN));
            }
        } else {
            let opacity = if is_inside { 255 } else { 70 };
            let rim = if is_inside { [255, 110, 110, 255] } else { [190, 195, 205, 255] };
            self.log(tick, solid, &tinted([255, 255, 255, opacity]));
            self.log(tick, &*rings, &tinted(rim));
            self.log(tick, rings, &Transform3D::update_fields().with_scale(1.0));
        }
        if is_inside {
            let frame = Arrows3D::from_vectors([[0.0, 0.5 * unit, 0.0], [0.0, 0.0, 0.5 * unit]]);
            self.log(tick, axes, &frame.with_colors([0xc8d0dcff_u32]).with_radii([0.012 * unit]));
            let point = Points3D::new([[0.0; 3]]).with_radii([Radius::new_ui_points(0.5)]).with_colors([Color::from_rgb(r, g, b)]);
            self.log(tick, label, &point.with_labels([words]).with_show_labels(true));
        } else {
            self.log(tick, axes, &Clear::flat());
            self.log(tick, label, &Clear::flat());
        }
    }

    /// Where the arm has been in the present null-space motion.
    fn write_ghosts(&mut self, tick: u64, all: bool) {
        let postures: Vec<[Placement; N]> =
            self.motion.postures.iter().map(|q| self.arm.link_poses(&SVector::from_column_slice(&q[..N])).map(|X| placement(&X))).collect();
        let (now, before) = match postures.split_last() {
            Some((now, before)) => (Some(now), before),
            None => (None, &[][..]),
        };
        for i in 0..N {
            let places: Vec<&Placement> =
                before.iter().map(|links| &links[i]).filter(|link| now.is_some_and(|now| differs(link, &now[i]))).collect();
            let none_before = std::mem::replace(&mut self.ghosts[i], places.len()) == 0;
            let poses = InstancePoses3D::new();
            let poses = match places.is_empty() {
                true if none_before && !all => continue,
                // No instances would mean the mesh itself, at the origin: one too small to see instead.
                true => poses.with_translations([[0.0; 3]]).with_scales([[UNSEEN; 3]]),
                false => poses
                    .with_translations(places.iter().map(|link| link.p.to_array()))
                    .with_quaternions(places.iter().map(|link| quaternion(link)))
                    .with_scales(vec![[0.985; 3]; places.len()]),
            };
            self.log(tick, entity::ghost(i), &poses);
        }
        let trail = |i: usize| -> Vec<[f32; 3]> { postures.iter().map(|links| links[i].p.to_array()).collect() };
        let moved = |strip: &Vec<[f32; 3]>| strip.windows(2).any(|pair| Vec3::from(pair[0]).distance(Vec3::from(pair[1])) > 0.005);
        let strips: Vec<Vec<[f32; 3]>> = (0..N).map(trail).filter(moved).collect();
        self.log(
            tick,
            entity::TRAIL,
            &LineStrips3D::new(strips)
                .with_colors([Color::from_unmultiplied_rgba(150, 205, 255, 160)])
                .with_radii([0.002 * self.figure.reach]),
        );
    }

    /// How far each joint has turned in the present null-space motion, in the colours that the plots have for them.
    fn write_turned(&mut self, tick: u64, links: &[Placement], turned: &[f64]) {
        let most = turned.iter().fold(0.0f64, |most, angle| most.max(angle.abs()));
        let joints = self.figure.rings.iter().zip(links).zip(turned).zip(blueprint::JOINTS).enumerate();
        let arcs = joints.filter_map(|(i, (((ring, X_BL), angle), [r, g, b, _]))| {
            let ring = ring.as_ref().filter(|_| angle.abs() > 0.06)?;
            // Words at those that move most.
            let words = if angle.abs() > 0.6 * most { format!("q{} {:+.0}°", i + 1, angle.to_degrees()) } else { String::new() };
            Some((scene::turning(ring, X_BL, *angle as f32), Color::from_rgb(r, g, b), words))
        });
        let (mut strips, mut colours, mut words) = (Vec::new(), Vec::new(), Vec::new());
        for (strip, colour, word) in arcs {
            strips.push(strip);
            colours.push(colour);
            words.push(word);
        }
        let radius = 0.004 * self.figure.reach;
        let arcs = LineStrips3D::new(strips).with_colors(colours).with_radii([radius]).with_labels(words).with_show_labels(true);
        self.log(tick, entity::TURNED, &arcs);
    }

    fn write_picture(&mut self) {
        let Some(picture) = self.picture.take() else { return };
        self.written.picture = picture.hand.ticks.last().map_or(self.written.picture, |last| last + 1);
        let mut tracks: Vec<(String, Track)> = Vec::new();
        tracks.extend((0..N).map(entity::link).zip(picture.links));
        tracks.extend([(entity::HAND.to_owned(), picture.hand), (entity::TARGET.to_owned(), picture.target)]);
        let [velocity, mobility] = picture.abilities;
        tracks.extend([(entity::VELOCITY.to_owned(), velocity), (entity::MOBILITY.to_owned(), mobility)]);
        for ((name, _), MarkTracks { frame, size, label }) in self.subject.singularities.iter().zip(picture.marks) {
            tracks.extend([(entity::singularity(name), frame), (entity::glyph(name), size), (entity::label(name), label)]);
        }
        for (path, track) in tracks {
            if !track.ticks.is_empty() {
                let ticks = track.ticks.clone();
                let chunk = self.chunk_of(&path, &ticks, track.columns());
                self.sink.chunk(&self.store, chunk);
            }
        }
        self.write_path(entity::PATH_ACTUAL, &picture.actual, [240, 240, 245, 255], 0.0035);
        self.write_path(entity::PATH_DESIRED, &picture.desired, [110, 235, 150, 255], 0.006);
    }

    /// A path in pieces of a tenth of a second, each a row, so that it grows with the cursor.
    fn write_path(&mut self, path: &str, points: &[(u64, Vec3)], [r, g, b, a]: Rgba, radius: f32) {
        const PIECE: usize = 5;
        let mut chunk = Chunk::builder(path);
        let mut any = false;
        let mut from = 0;
        while from + 1 < points.len() {
            let to = (from + PIECE).min(points.len() - 1);
            let piece: Vec<[f32; 3]> = points[from..=to].iter().map(|(_, p)| p.to_array()).collect();
            if Vec3::from(piece[0]).distance(points[to].1) > 1e-4 {
                let strip = LineStrips3D::new([piece])
                    .with_colors([Color::from_unmultiplied_rgba(r, g, b, a)])
                    .with_radii([radius * self.figure.reach]);
                chunk = chunk.with_archetype(RowId::new(), self.at(points[to].0), &strip);
                any = true;
            }
            from = to;
        }
        if any {
            self.sink.chunk(&self.store, chunk.build());
        }
    }

    fn mark_size(&self) -> f32 {
        0.2 * self.figure.reach
    }

    // Chunks.

    /// A tick's place on both time lines.
    fn at(&self, tick: u64) -> TimePoint {
        TimePoint::from([("tick", TimeCell::from_sequence(tick as i64)), ("t", TimeCell::from_duration_nanos(self.nanoseconds(tick)))])
    }

    fn nanoseconds(&self, tick: u64) -> i64 {
        (u128::from(tick) * 1_000_000_000 / u128::from(self.rate_hz)) as i64
    }

    fn log(&mut self, tick: u64, path: impl Into<EntityPath>, archetype: &dyn AsComponents) {
        let chunk = Chunk::builder(path).with_archetype(RowId::new(), self.at(tick), archetype).build();
        self.sink.chunk(&self.store, chunk);
    }

    fn log_static(&mut self, path: impl Into<EntityPath>, archetype: &dyn AsComponents) {
        let chunk = Chunk::builder(path).with_archetype(RowId::new(), TimePoint::default(), archetype).build();
        self.sink.chunk(&self.store, chunk);
    }

    fn chunk_of(
        &self,
        path: &str,
        ticks: &[u64],
        components: impl IntoIterator<Item = SerializedComponentColumn>,
    ) -> re_chunk::ChunkResult<Chunk> {
        let first = RowId::new();
        let rows: Vec<RowId> = (0..ticks.len()).map(|k| first.incremented_by(k as u64)).collect();
        let column =
            |timeline: Timeline, times: Vec<i64>| (*timeline.name(), TimeColumn::new(Some(true), timeline, ScalarBuffer::from(times)));
        let timelines = [
            column(Timeline::new_sequence("tick"), ticks.iter().map(|tick| *tick as i64).collect()),
            column(Timeline::new_duration("t"), ticks.iter().map(|tick| self.nanoseconds(*tick)).collect()),
        ];
        let components: ChunkComponents = components.into_iter().collect();
        Chunk::from_native_row_ids(ChunkId::new(), path.into(), Some(true), &rows, timelines.into_iter().collect(), components)
    }
}

impl Title {
    fn new(run: &RunInfo) -> Self {
        let RunInfo { scenario, robot, .. } = *run;
        let name = if scenario.title.is_empty() { &scenario.name } else { &scenario.title };
        let properties = [
            ("scenario", scenario.name.clone()),
            ("robot", robot.name.clone()),
            ("run", run.run.to_owned()),
            ("seed", run.seed.to_string()),
            ("rate_hz", scenario.rate_hz.to_string()),
            ("armplane", run.version.to_owned()),
        ];
        Self { name: name.clone(), properties }
    }
}

/// Recordings of one robot share their blueprint.
fn application(robot: &Robot) -> ApplicationId {
    ApplicationId::new_or_unknown(format!("armplane-{}", robot.name))
}

/// A component of ours.
fn custom(name: &'static str, archetype: Option<&'static str>) -> ComponentDescriptor {
    let descriptor = ComponentDescriptor::partial(name);
    archetype.map_or(descriptor.clone(), |archetype| descriptor.with_archetype(archetype.into()))
}

fn pose(p: &[f64; 3], R: &[f64; 9]) -> Placement {
    let R = R.map(|x| x as f32);
    Placement { R: glam::Mat3::from_cols_array(&R), p: Vec3::new(p[0] as f32, p[1] as f32, p[2] as f32) }
}

fn quaternion(at: &Placement) -> Quaternion {
    Quaternion::from_xyzw(rotation(at).to_array())
}

fn mesh3d(mesh: &Mesh, tint: Option<Rgba>) -> Mesh3D {
    let colours = mesh.colours.iter().map(|[r, g, b, a]| Color::from_unmultiplied_rgba(*r, *g, *b, *a));
    let made = Mesh3D::new(mesh.positions.iter().copied())
        .with_vertex_normals(mesh.normals.iter().copied())
        .with_vertex_colors(colours)
        .with_triangle_indices(mesh.triangles.iter().copied());
    match tint {
        Some(tint) => made.with_albedo_factor(albedo(tint)),
        None => made,
    }
}

/// Another tint for a mesh that has been written.
fn tinted(tint: Rgba) -> Mesh3D {
    Mesh3D::update_fields().with_albedo_factor(albedo(tint))
}

fn albedo([r, g, b, a]: Rgba) -> AlbedoFactor {
    AlbedoFactor(re_sdk_types::datatypes::Rgba32::from_unmultiplied_rgba(r, g, b, a))
}

/// An eye that sees the arm from floor to hand, with room for a mark of that size at the hand: off to the side of the plane in which the arm
/// reaches out, a little above; a planar arm from above.
fn eye(places: &[Vec3], mark: f32, subject: &Subject, planar: bool) -> Eye {
    // Half of Rerun's field of view; the sphere is roomier than the arm in it.
    let distance = |radius: f32| 0.88 * radius / 27.5f32.to_radians().sin();
    let hand = places.last().copied().unwrap_or(Vec3::X);
    let foot = if planar { Vec3::ZERO } else { Vec3::Z * subject.floor_m.min(0.0) };
    // Above the mark are its words.
    let room = [hand + Vec3::splat(mark), hand - Vec3::splat(mark), hand + Vec3::Z * (1.5 * mark), foot];
    let (low, high) = places.iter().chain(&room).fold((Vec3::ZERO, Vec3::ZERO), |(low, high), p| (low.min(*p), high.max(*p)));
    let (look_at, radius) = ((low + high) / 2.0, (high - low).length() / 2.0);
    if planar {
        return Eye { position: look_at + Vec3::new(0.0, -0.25, 1.0).normalize() * distance(radius), look_at, up: Vec3::Y };
    }
    let heading = hand.with_z(0.0).normalize_or(Vec3::X);
    let side = Vec3::new(heading.y, -heading.x, 0.0);
    let position = look_at + (heading * 0.7 + side + Vec3::Z * 0.38).normalize() * distance(radius);
    Eye { position, look_at, up: Vec3::Z }
}

/// Rows of signals, gathered.
#[derive(Default)]
struct Table {
    ticks: Vec<u64>,
    columns: Vec<Column>,
}

/// One signal's rows: values end to end, and where each row ends. A row without its message is an empty list, not a null: no plot draws a
/// line across it then.
struct Column {
    signal: Signal,
    wide: Vec<f64>,
    narrow: Vec<f32>,
    ends: Vec<i32>,
    /// Whether there has been a value, in this chunk or before.
    seen: bool,
}

impl Table {
    fn rows(&self) -> usize {
        self.ticks.len()
    }

    fn push(&mut self, tick: u64, fill: impl FnOnce(&mut dyn FnMut(Signal, &mut dyn Iterator<Item = f64>))) {
        if self.columns.is_empty() {
            self.columns = Signal::ALL.iter().map(|signal| Column::new(*signal)).collect();
        }
        self.ticks.push(tick);
        let columns = &mut self.columns;
        fill(&mut |signal, values| {
            let column = &mut columns[signal as usize];
            match signal.width() {
                Width::F64 => column.wide.extend(values),
                Width::F32 => column.narrow.extend(values.map(|value| value as f32)),
                Width::Share => column.narrow.extend(values.map(|value| (value * SHARES).round() as f32 / SHARES as f32)),
            }
        });
        for column in columns {
            let (end, before) = ((column.wide.len() + column.narrow.len()) as i32, column.ends.last().copied().unwrap_or(0));
            column.seen |= end > before;
            column.ends.push(end);
        }
    }

    /// The rows gathered, as columns; `None` where there are none.
    fn take(&mut self) -> Option<(Vec<u64>, Vec<SerializedComponentColumn>)> {
        if self.ticks.is_empty() {
            return None;
        }
        let ticks = std::mem::take(&mut self.ticks);
        let columns = self.columns.iter_mut().filter_map(|column| {
            let next = Column { seen: column.seen, ..Column::new(column.signal) };
            std::mem::replace(column, next).build()
        });
        Some((ticks, columns.collect()))
    }
}

impl Column {
    fn new(signal: Signal) -> Self {
        Self { signal, wide: Vec::new(), narrow: Vec::new(), ends: vec![0], seen: false }
    }

    fn build(self) -> Option<SerializedComponentColumn> {
        if !self.seen {
            return None;
        }
        let values: ArrayRef = match self.signal.width() {
            Width::F64 => std::sync::Arc::new(Float64Array::from(self.wide)),
            Width::F32 | Width::Share => std::sync::Arc::new(Float32Array::from(self.narrow)),
        };
        let field = std::sync::Arc::new(Field::new_list_field(values.data_type().clone(), true));
        let list = ListArray::new(field, OffsetBuffer::new(ScalarBuffer::from(self.ends)), values, None);
        Some(SerializedComponentColumn::new(list, custom(self.signal.name(), None)))
    }
}

/// Places over time.
#[derive(Default)]
struct Track {
    ticks: Vec<u64>,
    translations: Vec<[f32; 3]>,
    quaternions: Vec<[f32; 4]>,
    /// Empty for what never changes its size.
    sizes: Vec<[f32; 3]>,
}

impl Track {
    fn push(&mut self, tick: u64, at: &Placement) {
        self.ticks.push(tick);
        self.translations.push(at.p.to_array());
        self.quaternions.push(rotation(at).to_array());
    }

    fn columns(self) -> Vec<SerializedComponentColumn> {
        let mut transform = Transform3D::update_fields();
        if !self.translations.is_empty() {
            let quaternions = self.quaternions.into_iter().map(Quaternion::from_xyzw);
            transform = transform.with_many_translation(self.translations).with_many_quaternion(quaternions);
        }
        if !self.sizes.is_empty() {
            transform = transform.with_many_scale(self.sizes);
        }
        transform.columns_of_unit_batches().map(Iterator::collect).unwrap_or_default()
    }
}

/// A singularity's frame at C, the size of its mark there, and the words above it.
#[derive(Default)]
struct MarkTracks {
    frame: Track,
    size: Track,
    label: Track,
}

/// What was seen since the last chunk.
#[derive(Default)]
struct Picture {
    links: Vec<Track>,
    hand: Track,
    target: Track,
    /// Of each singularity.
    marks: Vec<MarkTracks>,
    /// Ellipsoids of velocity and mobility.
    abilities: [Track; 2],
    /// The paths' points; the last of a chunk is the first of the next.
    actual: Vec<(u64, Vec3)>,
    desired: Vec<(u64, Vec3)>,
}

impl Picture {
    fn rows(&self) -> usize {
        self.hand.ticks.len()
    }

    /// `unit`: the size of the mark of a singularity the arm is in; m.
    fn push(&mut self, tick: u64, links: &[Placement], hand: &Placement, desired: Option<&Placement>, marks: &[Mark], unit: f32) {
        self.links.resize_with(links.len(), Track::default);
        for (track, at) in self.links.iter_mut().zip(links) {
            track.push(tick, at);
        }
        self.hand.push(tick, hand);
        self.actual.push((tick, hand.p));
        if let Some(desired) = desired {
            self.target.push(tick, desired);
            self.desired.push((tick, desired.p));
        }
        self.marks.resize_with(self.marks.len().max(marks.len()), Default::default);
        for (tracks, mark) in self.marks.iter_mut().zip(marks) {
            // What is hidden need not be anywhere.
            if mark.look.presence != Presence::Hidden {
                tracks.frame.push(tick, &mark.X_BS);
                tracks.size.ticks.push(tick);
                tracks.size.sizes.push([unit * mark.size; 3]);
            }
            if mark.look.presence == Presence::Inside {
                tracks.label.push(tick, &Placement { p: mark.X_BS.p + Vec3::Z * (1.25 * unit), ..Placement::IDENTITY });
            }
        }
    }

    fn take(&mut self) -> Option<Self> {
        if self.rows() == 0 {
            return None;
        }
        let mut next = Self::default();
        next.actual.extend(self.actual.last());
        next.desired.extend(self.desired.last());
        Some(std::mem::replace(self, next))
    }
}

#[cfg(test)]
mod tests;
