//! A run as a Rerun recording.

mod eye;
mod marks;
mod picture;
mod rows;
mod shapes;
mod steered;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use model::{Joint, JointKind, Model, Robot};
use nalgebra::{SMatrix, SVector, Vector3};
use re_sdk_types::archetypes::{
    RecordingInfo, StateChange, StateConfiguration, TextDocument, TextLog,
};
use re_sdk_types::components::TextLogLevel;
use re_sdk_types::{AnyValues, DynamicArchetype};
use rerun::EntityPath;
use rerun::external::arrow::array::{Array, Float64Array, StringArray};
use rerun::log::LogMsg;
use rerun::{ApplicationId, StoreId, StoreKind};
use shared_types::job::Job;
use shared_types::scenario::{Layout, Scenario, Segment};
use shared_types::{MAX_DOF, MAX_SINGULARITIES};

use crate::arm::{Figure, placement, vec3};
use crate::blueprint::{self, BAND_LINES, Eye, Subject, Way};
use crate::entity::{self, Lives};
use crate::manipulability::{at_point, singular_values};
use crate::meshes::Meshes;
use crate::narration::{self, FAULT_COLOUR, History, Moment, NO_FAULT, colour_of};
use crate::run::{Event, Happened, Rival, Tick};
use crate::scene::{Mark, NullMotion};
use crate::signals::{ChainHops, Kept, Limits, Now, Signal, TickRow, chain_hops};
use crate::sink::{RecordError, RrdFile, Sink, activation};
use crate::solid::Placement;
use crate::story::{News, Story};
pub(crate) use eye::Room;
use eye::{Stretches, close_up};
use marks::Shown;
use rows::{Table, Track};

/// Pictures per second.
const PICTURE_HZ: f64 = 50.0;
/// How often a viewer that watches gets more; s of the run.
const LIVE_S: f64 = 0.25;
/// Chunks of a file, about: each costs its schema, and a line of the table of contents.
const CHUNKS: f64 = 200.0;
/// How often a caller hears how far it is; ticks.
const NEWS: u64 = 500;

/// Called with the number of ticks drawn; `false` ends the drawing.
pub type Progress<'a> = &'a mut dyn FnMut(u64) -> bool;

/// Draws a run into an `.rrd` file, which stands in its place when it is whole. Returns a sentence about meshes of the arm that could not be read.
///
/// # Errors
/// [`RecordError`] where the arm cannot be drawn, the file not be written, or `progress` has ended it; nothing is left then.
pub fn write_rrd(
    path: &Path,
    job: &Job,
    robot: &Robot,
    ticks: impl Iterator<Item = Tick>,
    happened: &Happened,
    progress: Progress,
) -> Result<Option<String>, RecordError> {
    let sink = Sink::file(path, &store(job), job.scenario.rate_hz)?;
    draw(
        Recording::new(sink, job, robot, happened, false)?,
        ticks,
        progress,
    )
}

/// Draws a run while it lasts into a viewer that listens at a URL such as `rerun+http://127.0.0.1:9876/proxy`.
///
/// # Errors
/// [`RecordError`] where the arm cannot be drawn, or the URL is none of a viewer.
pub fn show_live(
    url: &str,
    job: &Job,
    robot: &Robot,
    ticks: impl Iterator<Item = Tick>,
    progress: Progress,
) -> Result<Option<String>, RecordError> {
    let sink = Sink::viewer(url, &store(job), job.scenario.rate_hz)?;
    let recording = Recording::new(sink, job, robot, &Happened::default(), true)?;
    draw(recording, ticks, progress)
}

fn draw(
    mut recording: Recording,
    ticks: impl Iterator<Item = Tick>,
    progress: Progress,
) -> Result<Option<String>, RecordError> {
    for (count, tick) in (1..).zip(ticks) {
        recording.tick(&tick.row())?;
        if count % NEWS == 0 && !progress(count) {
            return Err(RecordError::Stopped);
        }
    }
    recording.finish()
}

/// Recordings of one robot share their blueprint.
fn store(job: &Job) -> StoreId {
    let application = ApplicationId::new_or_unknown(format!("armplane-{}", job.robot.name));
    StoreId::recording(application, job.run.as_str())
}

/// The blueprint's own store: one per recording.
fn blueprint_store(job: &Job) -> StoreId {
    let store = store(job);
    let id = format!("{}-blueprint", store.recording_id());
    StoreId::new(StoreKind::Blueprint, store.application_id().clone(), id)
}

/// A recording in the making: ticks in, Rerun's rows out.
///
/// One type for every arm: the model has as many places for joints as a message, so that this code is compiled once.
struct Recording<'a> {
    sink: Sink,
    run: Facts<'a>,
    subject: Subject,
    story: Story,
    motion: Motion,
    picture: Picture,
    signals: Table,
    /// Values only drawn, every so many ticks.
    drawn: Table,
    /// Whether the blueprint has been sent: it waits for the first report, which names the singularities.
    is_introduced: bool,
    /// The last tick taken in.
    last: Option<u64>,
}

/// What is known of a run before its first tick, but for what its layout depends on ([`Subject`]).
pub(crate) struct Facts<'a> {
    pub(crate) job: &'a Job,
    rival: Option<&'a Rival>,
    is_live: bool,
    pub(crate) rate_hz: u32,
    /// A chunk is written every so many ticks.
    chunk: u64,
    title: &'a str,
    pub(crate) joint_units: String,
    pub(crate) arm: Model<MAX_DOF>,
    pub(crate) figure: Figure,
    /// About meshes that could not be read.
    lacking: Option<String>,
    /// The axes of the hand's twist that the task has.
    task: [bool; 6],
    limits: Limits,
    hops: Option<ChainHops>,
}

/// How the arm has moved so far.
struct Motion {
    stretches: Stretches,
    room: Room,
    null: NullMotion,
    history: History,
    /// Ticks since the last command.
    unheard: u64,
}

/// The contents of the picture.
#[derive(Default)]
struct Picture {
    marks: [Shown; MAX_SINGULARITIES],
    /// How many ghosts each link has.
    ghosts: [usize; MAX_DOF],
    /// The paths of what is drawn and may be cleared.
    drawn: BTreeSet<String>,
    /// The words last written, to be written again when a fault comes or goes.
    told: String,
    /// The captions in the picture.
    captions: [String; 2],
    /// Places since the last chunk.
    tracks: BTreeMap<String, Track>,
    /// Lines that grow: the last point of a chunk is the first of the next.
    ways: [Vec<(u64, glam::Vec3)>; 5],
}

/// Writes a layout for a run as a `.rbl` file, to be opened beside its recording; `first` names the singularities and places the eye.
///
/// # Errors
/// [`RecordError`] where the file cannot be written, or the robot has more joints than a message.
pub fn save_blueprint(
    path: &Path,
    job: &Job,
    robot: &Robot,
    first: &Tick,
    layout: Layout,
) -> Result<(), RecordError> {
    let facts = Facts::new(job, robot, None, false)?;
    let mut subject = subject(job, robot, &Happened::default(), false);
    subject.pane = blueprint::pane(layout);
    facts.meet(&first.row(), &mut subject);
    let store = blueprint_store(job);
    let mut file = RrdFile::create(path)?;
    file.append(&blueprint::messages(&store, &subject, layout, None)?)?;
    file.append(&[LogMsg::BlueprintActivationCommand(activation(&store))])?;
    file.finish()
}

/// How far guides go on after the last tick, as a share of the time before it. Plots are as long as what they hold: at the end of the lines
/// a legend of short names has room, and hides none of them.
const LEGEND: f64 = 0.3;
/// Seconds that a plot shows by itself: half of them before the cursor.
const PLOTTED_S: f64 = 60.0;
/// Rate of what is only drawn: more than a plot has points across.
const DRAWN_HZ: f64 = 125.0;

impl<'a> Recording<'a> {
    /// Begins with what never changes: the run's properties, the arm's figure, styles.
    fn new(
        sink: Sink,
        job: &'a Job,
        robot: &Robot,
        happened: &Happened<'a>,
        is_live: bool,
    ) -> Result<Self, RecordError> {
        let run = Facts::new(job, robot, happened.rival, is_live)?;
        let is_fast = |kept| matches!(kept, Kept::F64 | Kept::F32 | Kept::Short | Kept::Log(_));
        let is_slow = |kept| matches!(kept, Kept::Slow | Kept::Drawn);
        let mut recording = Self {
            sink,
            subject: subject(job, robot, happened, is_live),
            story: Story::new(job, happened),
            motion: Motion {
                stretches: Stretches::default(),
                room: Room::default(),
                null: NullMotion::new(robot.length_m),
                history: History::new(stands_still(&job.scenario)),
                unheard: 0,
            },
            picture: Picture::default(),
            signals: Table::of(is_fast, false),
            drawn: Table::of(is_slow, is_live),
            is_introduced: false,
            last: None,
            run,
        };
        recording.write_properties();
        recording.write_figure();
        recording.style_lanes();
        recording.sink.flush().map(|()| recording)
    }

    /// Takes a tick in. Ticks come in order; one that was lost leaves a gap.
    fn tick(&mut self, row: &TickRow) -> Result<(), RecordError> {
        let is_first = self.last.is_none();
        self.last = Some(row.tick);
        if !self.is_introduced && row.singularity.is_some() {
            self.introduce(row);
        }
        self.gather(row);
        self.write_changes(row);
        if self.run.is_pictured(row.tick) {
            self.see_rival(row.tick);
            self.see(row);
        }
        // Pieces of a line that lets through what is behind it are darker where they meet: as few as can be.
        let is_followed = self.run.is_live && row.tick.is_multiple_of(self.run.every(5.0));
        if is_first || is_followed {
            self.write_guides(row.tick);
        }
        if self.signals.ticks.len() as u64 >= self.run.chunk {
            self.write_gathered();
            self.sink.flush()?;
        }
        Ok(())
    }

    /// The numbers of a tick.
    fn gather(&mut self, row: &TickRow) {
        let now = Now::new(row, &self.run.limits, self.run.hops);
        self.signals.push(&now);
        if !row.tick.is_multiple_of(self.run.every(1.0 / DRAWN_HZ)) {
            return;
        }
        let gravity = row.q().map(|q| self.run.arm.gravity(&SVector::from(*q)));
        self.drawn.push(&Now {
            gravity: gravity.unwrap_or_default().as_slice(),
            sigma: self.run.singular_values(row),
            is_faulty: self.story.fault(row.tick).is_some(),
            ..now
        });
    }

    /// Modes, states, faults and lines, as they change; and the words.
    fn write_changes(&mut self, row: &TickRow) {
        let (sink, mut is_other_fault) = (&self.sink, false);
        self.story.push(row, &mut |tick, news| {
            is_other_fault |= matches!(news, News::State { name: "fault", .. });
            write(sink, tick, &news);
        });
        if is_other_fault {
            self.picture.told.clear();
        }
        self.write_words(row);
    }

    fn write_words(&mut self, row: &TickRow) {
        // A tick or two without a command is not worth a line.
        self.motion.unheard = match row.torque {
            Some(_) => 0,
            None => self.motion.unheard + 1,
        };
        self.motion.history.push(row);
        let told = row.torque.is_some() && row.singularity.is_some() || self.motion.unheard >= 5;
        let is_due = self.picture.told.is_empty() || self.run.is_pictured(row.tick);
        if !told || !is_due || self.run.rival.is_some() {
            return;
        }
        let task = self.run.task.iter().filter(|served| **served);
        let fault = self.story.fault(row.tick);
        let moment = Moment {
            row,
            history: &self.motion.history,
            title: self.run.title,
            joints: self.subject.joints,
            rate_hz: self.run.rate_hz,
            directions: task.count().min(self.subject.joints),
            fault: fault.map(|fault| fault.headline.as_str()),
        };
        let words = moment.markdown();
        if self.picture.told != words {
            let document = TextDocument::from_markdown(words.as_str());
            self.sink.log(row.tick, entity::NOW, &document);
            self.picture.told = words;
        }
    }

    /// Writes out what is being gathered.
    fn write_gathered(&mut self) {
        self.write_picture();
        for (path, table) in [
            (entity::DRAWN, &mut self.drawn),
            (entity::SIGNALS, &mut self.signals),
        ] {
            let (ticks, columns) = table.take();
            self.sink.send_columns(path, &ticks, columns);
        }
    }

    /// Ends the recording; a sentence about meshes of the arm that could not be read.
    fn finish(mut self) -> Result<Option<String>, RecordError> {
        if !self.is_introduced {
            self.introduce(&TickRow::default());
        }
        self.write_gathered();
        if let Some(last) = self.last {
            let beyond = if self.run.is_live { 0.0 } else { LEGEND };
            self.write_guides(last + (beyond * last as f64) as u64);
            // A viewer that follows a live run must not loop.
            if !self.run.is_live {
                self.write_ending(last);
            }
        }
        self.sink.finish().map(|()| self.run.lacking)
    }

    fn write_properties(&self) {
        let info = RecordingInfo::new().with_name(self.run.title);
        self.sink.log_static(EntityPath::properties(), &info);
        let properties = self.run.properties().into_iter();
        let properties = properties.fold(DynamicArchetype::new("run"), |all, (name, value)| {
            all.with_component_from_data(name, array(StringArray::from_iter([Some(value)])))
        });
        let path = EntityPath::properties().join(&"run".into());
        self.sink.log_static(path, &properties);
        let recorded = Signal::recorded();
        let about = recorded.map(|signal| format!("`{}`: {}", signal.component(), signal.about()));
        let about = TextDocument::from_markdown(about.collect::<Vec<_>>().join("\n\n"));
        self.sink.log_static("/signals/about", &about);
        let limits = self.run.limits.named();
        let limits = limits.map(|(name, values)| (name, values.clone()));
        self.sink.log_static(entity::SIGNALS, &numbers(limits));
    }

    /// At the first report: names and thresholds, the eye's place, and with them the blueprint.
    fn introduce(&mut self, row: &TickRow) {
        self.is_introduced = true;
        self.motion.room = self.run.meet(row, &mut self.subject);
        let names = self.subject.singularities.iter().map(|(name, _)| name);
        let names = array(StringArray::from_iter_values(names));
        let names = AnyValues::default().with_component_from_data(entity::SINGULARITY_NAMES, names);
        self.sink.log_static(entity::SIGNALS, &names);
        for (name, _) in &self.subject.singularities {
            self.style(format!("/{name}"), narration::MODE_STATES);
        }
        self.send_blueprint(None);
    }

    fn send_blueprint(&self, repeated: Option<(i64, i64)>) {
        let (store, layout) = (
            blueprint_store(self.run.job),
            self.run.job.scenario.view.layout,
        );
        let messages = blueprint::messages(&store, &self.subject, layout, repeated);
        self.sink.send_blueprint(messages, &store);
    }

    fn style_lanes(&self) {
        let faults = self.story.faults.iter();
        let faults = faults.map(|fault| (fault.lane.as_str(), FAULT_COLOUR));
        let faults: Vec<_> = faults.chain([NO_FAULT]).collect();
        self.style(entity::FAULT.to_owned(), &faults);
        self.style(entity::DRIVE.to_owned(), narration::DRIVE_STATES);
        self.style(entity::PHASE.to_owned(), narration::PHASE_STATES);
        for life in self.subject.lives.named() {
            self.style(entity::life(life), narration::LIFE_STATES);
        }
    }

    fn style(&self, path: String, states: &[(&str, u32)]) {
        let names = || states.iter().map(|(name, _)| *name);
        let configuration = StateConfiguration::new()
            .with_values(names())
            .with_labels(names())
            .with_colors(states.iter().map(|(_, colour)| *colour));
        self.sink.log_static(path, &configuration);
    }

    /// The layout again with what is known at the end only: the stretch to repeat, and the eyes.
    fn write_ending(&mut self, last: u64) {
        // A way that no plan told: an eye that sees all of it.
        let (main, planned) = (
            self.run.eye(&self.motion.room, &self.subject),
            self.subject.eye,
        );
        if main.position.distance(planned.position) > 0.05 * main.position.distance(main.look_at) {
            self.subject.eye = main;
        }
        let (motion, unit) = (&self.motion, self.run.mark_size());
        let ending = match self.run.job.scenario.view.layout {
            Layout::Control if !self.subject.stands_still => {
                let stretch = motion.stretches.ending(self.run.rate_hz, last, unit, &main);
                let hand = || Some(((0, last), motion.room.close_up(unit, &main)?));
                stretch.or_else(hand)
            }
            _ => None,
        };
        let ((first, last), close_up) = ending.unwrap_or(((0, last), self.subject.close_up));
        self.subject.close_up = close_up;
        let [first, last] = [first, last].map(|tick| self.sink.nanoseconds(tick));
        self.send_blueprint(Some((first, last)));
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
        self.sink.log(tick, entity::GUIDES, &numbers(guides));
    }
}

fn array(values: impl Array + 'static) -> rerun::external::arrow::array::ArrayRef {
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

/// A piece of the run's story.
fn write(sink: &Sink, tick: u64, news: &News) {
    match news {
        News::State { path, state, .. } => sink.log(tick, path, &StateChange::single(*state)),
        News::Line(Event { level, text, .. }) => {
            // The viewer's column of times cuts them: the line has its own.
            let t_s = sink.nanoseconds(tick) as f64 * 1e-9;
            let line = TextLog::new(format!("{t_s:.3} s\u{2003}{text}"));
            sink.log(
                tick,
                entity::LOG,
                &line.with_level(TextLogLevel::from(level.name())),
            );
        }
    }
}

impl<'a> Facts<'a> {
    pub(crate) fn new(
        job: &'a Job,
        robot: &Robot,
        rival: Option<&'a Rival>,
        is_live: bool,
    ) -> Result<Self, RecordError> {
        let scenario = &job.scenario;
        let arm = Model::new(robot, scenario.frame()).map_err(|error| RecordError::Arm {
            robot: robot.name.clone(),
            reason: error.to_string(),
        })?;
        let (meshes, lacking) = Meshes::of(robot);
        let title = match scenario.title.as_str() {
            "" => &scenario.name,
            _ => &scenario.title,
        };
        let rate_hz = scenario.rate_hz.max(1);
        let chunk_s = match is_live {
            true => LIVE_S,
            false => (scenario.duration_s() / CHUNKS).clamp(1.0, 10.0),
        };
        Ok(Self {
            job,
            rival,
            is_live,
            rate_hz,
            chunk: ticks_in(chunk_s, rate_hz),
            title,
            joint_units: joint_units(robot).join(" "),
            arm,
            figure: Figure::new(robot, floor_m(scenario), &meshes),
            lacking,
            task: robot.task.0,
            limits: Limits::new(robot),
            hops: chain_hops(&job.graph),
        })
    }

    /// The run in a few words, by their names.
    pub(crate) fn properties(&self) -> [(&'static str, String); 7] {
        let Job {
            run,
            version,
            scenario,
            robot,
            ..
        } = self.job;
        [
            ("scenario", scenario.name.clone()),
            ("robot", robot.name.clone()),
            ("run", run.clone()),
            ("seed", scenario.seed.to_string()),
            ("rate_hz", scenario.rate_hz.to_string()),
            ("armplane", version.clone()),
            ("joint_units", self.joint_units.clone()),
        ]
    }

    /// All that the numbers of a tick are computed from, but for what is only drawn.
    pub(crate) fn now<'n, 'm>(&'n self, row: &'n TickRow<'m>) -> Now<'n, 'm> {
        let now = Now::new(row, &self.limits, self.hops);
        Now {
            sigma: self.singular_values(row),
            ..now
        }
    }

    /// Ticks in so many seconds, at least one.
    fn every(&self, seconds: f64) -> u64 {
        ticks_in(seconds, self.rate_hz)
    }

    /// Whether a tick has a picture.
    pub(crate) fn is_pictured(&self, tick: u64) -> bool {
        tick.is_multiple_of(self.every(1.0 / PICTURE_HZ))
    }

    /// The poses of the links.
    pub(crate) fn links(&self, q: &[f64; MAX_DOF]) -> [Placement; MAX_DOF] {
        let poses = self.arm.link_poses(&SVector::from(*q));
        poses.map(|X| placement(&X))
    }

    /// The Jacobian at the point that the report is of.
    fn jacobian(&self, q: &SVector<f64, MAX_DOF>, p_BC: [f64; 3]) -> SMatrix<f64, 6, MAX_DOF> {
        let r_EC = Vector3::from(p_BC) - self.arm.forward_kinematics(q).p;
        at_point(self.arm.jacobian(q), &r_EC)
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
        Some(singular_values(&J, report.length_m, &self.task))
    }

    /// Half the length of the mark of a singularity the arm is in; m.
    fn mark_size(&self) -> f32 {
        0.12 * self.figure.reach
    }

    /// Lines of marks and of turned joints; m.
    fn fine(&self) -> f32 {
        0.003 * self.figure.reach
    }

    /// Names, thresholds and places of the first report; the room that the arm takes.
    fn meet(&self, row: &TickRow, subject: &mut Subject) -> Room {
        for (i, one) in row.singularities().iter().enumerate() {
            let name = shared_types::codes::singularity_name(one.kind, i).to_owned();
            subject.singularities.push((name, colour_of(one.kind, i)));
            let outer = one.eta_out / one.eta_in.max(1e-9);
            if !subject.outer.contains(&outer) {
                subject.outer.push(outer);
            }
        }
        let corners = |q| self.figure.corners(&self.links(q)).collect();
        let corners: Vec<_> = row.q().map_or_else(Vec::new, corners);
        let room = Room::of(&corners);
        subject.eye = self.eye(&room, subject);
        subject.close_up = self.near_by(row, subject);
        room
    }

    /// An eye that sees all of the arm's way so far.
    fn eye(&self, room: &Room, subject: &Subject) -> Eye {
        room.eye(self.mark_size(), subject, !self.task[2])
    }

    /// An eye near the hand that stands still, or near the nearest singularity.
    fn near_by(&self, row: &TickRow, subject: &Subject) -> Eye {
        let (main, unit) = (subject.eye, self.mark_size());
        if subject.stands_still {
            // From where the arm is seen, onto the hand.
            let hand =
                |q: &[f64; MAX_DOF]| vec3(&self.arm.forward_kinematics(&SVector::from(*q)).p);
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
}

fn ticks_in(seconds: f64, rate_hz: u32) -> u64 {
    (seconds * f64::from(rate_hz)).round().max(1.0) as u64
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
fn subject(job: &Job, robot: &Robot, happened: &Happened, is_live: bool) -> Subject {
    let scenario = &job.scenario;
    let judged = |bound: f64, most: f64| Some(bound).filter(|bound| *bound < most);
    let goal = &scenario.goal;
    Subject {
        lives: Lives::of(&job.graph),
        joints: robot.joints.len(),
        units: axis_units(robot),
        floor_m: floor_m(scenario),
        pane: blueprint::pane(scenario.view.layout),
        goal: [
            judged(goal.position_mm, 1000.0),
            judged(goal.orientation_deg, 180.0),
        ],
        faults: !scenario.fault.is_empty() || !happened.faults.is_empty() || is_live,
        is_long: (1.0 + LEGEND) * scenario.duration_s() > PLOTTED_S && !is_live,
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
