//! A run as a Rerun recording: its numbers at the control rate, its pictures 50 times a second, what changes as it changes.

mod draw;
mod marks;
mod rows;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use model::Robot;
use nalgebra::SVector;
use re_sdk_types::archetypes::{
    Clear, RecordingInfo, StateChange, StateConfiguration, TextDocument, TextLog,
};
use re_sdk_types::components::TextLogLevel;
use re_sdk_types::{AnyValues, DynamicArchetype};
use rerun::external::arrow::array::{Array, Float64Array, StringArray};
use rerun::log::LogMsg;
use rerun::{AsComponents, EntityPath};
use shared_types::event::Event;
use shared_types::job::Job;
use shared_types::scenario::Layout;

use crate::blueprint::{self, BAND_LINES, Subject};
use crate::entity;
use crate::eye::Room;
use crate::facts::Facts;
use crate::narration::{self, FAULT_COLOUR, NO_FAULT};
use crate::picture::{Named, Scene};
use crate::run::{Happened, Progress, Source, Tick};
use crate::signals::{Kept, Now, Signal, TickRow};
use crate::sink::{RecordError, RrdFile, Sink, activation};
use crate::story::{News, Story};
use rows::{Table, Track};

/// How often a viewer that watches gets more; s of the run.
const LIVE_S: f64 = 0.25;
/// Chunks of a file, about: each costs its schema, and a line of the table of contents.
const CHUNKS: f64 = 200.0;
/// How often a caller hears how far it is; ticks.
const NEWS: u64 = 500;
/// How far guides go on after the last tick, as a share of the time before it. Plots are as long as what they hold: at the end of the lines
/// a legend of short names has room, and hides none of them.
const LEGEND: f64 = 0.3;
/// Seconds that a plot shows by itself: half of them before the cursor.
const PLOTTED_S: f64 = 60.0;
/// Rate of what is only drawn: more than a plot has points across.
const DRAWN_HZ: f64 = 125.0;
/// Errors for which plots have room as long as a run's own are not known, mm and degrees.
const MOST_ERRORS: [f64; 2] = [1000.0, 180.0];
/// Ticks without a command that are told.
const PATIENCE: u64 = 5;

/// Draws a run into an `.rrd` file, which stands in its place when it is whole. Returns a sentence about meshes of the arm that could not be read.
///
/// # Errors
/// [`RecordError`] where the arm cannot be drawn, the file not be written, or the source's `progress` has ended it; nothing is left then.
pub fn write_rrd(path: &Path, source: Source) -> Result<Option<String>, RecordError> {
    let facts = Facts::new(source.job, source.robot, source.happened.rival, false)?;
    let sink = Sink::file(path, &Facts::store(source.job), facts.rate_hz)?;
    Recording::new(sink, &facts, source.happened)?.draw_all(source.ticks, source.progress)?;
    Ok(facts.lacking)
}

/// Draws a run while it lasts into a viewer that listens at a URL such as `rerun+http://127.0.0.1:9876/proxy`.
///
/// # Errors
/// [`RecordError`] where the arm cannot be drawn, or the URL is none of a viewer.
pub fn show_live(url: &str, source: Source) -> Result<Option<String>, RecordError> {
    let facts = Facts::new(source.job, source.robot, None, true)?;
    let sink = Sink::viewer(url, &Facts::store(source.job), facts.rate_hz)?;
    Recording::new(sink, &facts, source.happened)?.draw_all(source.ticks, source.progress)?;
    Ok(facts.lacking)
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
    let happened = Happened::default();
    let mut scene = Scene::new(&facts, Story::new(job, &happened));
    let mut room = Room::default();
    if let Some(picture) = scene.push(&facts, &first.row(), &mut |_, _| ()) {
        room.push(&facts, &picture);
    }
    let subject = subject(&facts, happened, &scene, &room, layout);
    let (messages, store) = blueprint::messages(&subject, layout, None)?;
    let mut file = RrdFile::create(path)?;
    file.append(&messages)?;
    file.append(&[LogMsg::BlueprintActivationCommand(activation(&store))])?;
    file.finish()
}

fn subject<'a>(
    facts: &'a Facts,
    happened: Happened,
    scene: &'a Scene,
    room: &Room,
    layout: Layout,
) -> Subject<'a> {
    let scenario = &facts.job.scenario;
    let main = room.eye(facts, blueprint::pane(layout));
    Subject {
        facts,
        named: &scene.named,
        has_faults: !scenario.fault.is_empty() || !happened.faults.is_empty() || facts.is_live,
        is_long: (1.0 + LEGEND) * scenario.duration_s() > PLOTTED_S && !facts.is_live,
        main,
        close_up: room.close_up(facts, &main),
        errors: MOST_ERRORS,
    }
}

/// A recording in the making: ticks in, Rerun's rows out.
struct Recording<'a> {
    sink: Sink,
    run: &'a Facts<'a>,
    happened: Happened<'a>,
    scene: Scene,
    room: Room,
    signals: Table,
    /// Values only drawn, every so many ticks.
    drawn: Table,
    /// A chunk is written every so many ticks.
    chunk: u64,
    /// Ticks since the last command.
    unheard: u64,
    /// By its path, what an entity shows that is written when that changes.
    shown: BTreeMap<String, String>,
    /// The paths of the strokes of the last picture.
    strokes: BTreeSet<String>,
    /// Places since the last chunk.
    tracks: BTreeMap<String, Track>,
    /// Lines that grow: the last point of a chunk is the first of the next.
    ways: [Vec<(u64, glam::Vec3)>; 5],
    /// Whether the blueprint has been sent: it waits for the first report, which names the singularities.
    is_introduced: bool,
    /// The last tick taken in.
    last: Option<u64>,
}

impl<'a> Recording<'a> {
    /// Begins with what never changes: the run's properties, the arm, styles.
    fn new(sink: Sink, run: &'a Facts, happened: Happened<'a>) -> Result<Self, RecordError> {
        let is_fast = |kept| matches!(kept, Kept::F64 | Kept::F32 | Kept::Short | Kept::Log(_));
        let is_slow = |kept| matches!(kept, Kept::Slow | Kept::Drawn);
        let chunk_s = match run.is_live {
            true => LIVE_S,
            false => (run.job.scenario.duration_s() / CHUNKS).clamp(1.0, 10.0),
        };
        let mut recording = Self {
            sink,
            run,
            happened,
            scene: Scene::new(run, Story::new(run.job, &happened)),
            room: Room::default(),
            signals: Table::of(is_fast, false),
            drawn: Table::of(is_slow, run.is_live),
            chunk: run.every(chunk_s),
            unheard: 0,
            shown: BTreeMap::new(),
            strokes: BTreeSet::new(),
            tracks: BTreeMap::new(),
            ways: Default::default(),
            is_introduced: false,
            last: None,
        };
        recording.write_properties();
        recording.write_arm();
        recording.style_lanes();
        recording.sink.flush().map(|()| recording)
    }

    fn draw_all(
        mut self,
        ticks: &mut dyn Iterator<Item = Tick>,
        progress: Progress,
    ) -> Result<(), RecordError> {
        for (count, tick) in (1..).zip(ticks) {
            self.tick(&tick.row())?;
            if count % NEWS == 0 && !progress(count) {
                return Err(RecordError::Stopped);
            }
        }
        self.finish()
    }

    /// Takes a tick in. Ticks come in order; one that was lost leaves a gap.
    fn tick(&mut self, row: &TickRow) -> Result<(), RecordError> {
        let (sink, mut is_other_fault) = (&self.sink, false);
        let picture = self.scene.push(self.run, row, &mut |tick, news| {
            is_other_fault |= matches!(news, News::State { name: "fault", .. });
            write(sink, tick, &news);
        });
        self.gather(row);
        self.unheard = row.torque.map_or(self.unheard + 1, |_| 0);
        if let Some(picture) = &picture {
            self.room.push(self.run, picture);
            self.draw(row, picture);
        }
        if !self.is_introduced && row.singularity.is_some() && picture.is_some() {
            self.introduce();
        }
        // A tick or two without a command is not worth a line.
        let is_told = row.torque.is_some() && row.singularity.is_some() || self.unheard >= PATIENCE;
        if is_told && self.run.rival.is_none() && (picture.is_some() || is_other_fault) {
            let words = self
                .scene
                .words(self.run, row)
                .markdown(row.singularities());
            let document = |_: &Self| TextDocument::from_markdown(words.as_str());
            self.show(
                row.tick,
                entity::NOW.to_owned(),
                Some(words.clone()),
                document,
            );
        }
        let is_first = self.last.replace(row.tick).is_none();
        // Pieces of a line that lets through what is behind it are darker where they meet: as few as can be.
        let is_followed = self.run.is_live && row.tick.is_multiple_of(self.run.every(5.0));
        if is_first || is_followed {
            self.write_guides(row.tick);
        }
        if self.signals.ticks.len() as u64 >= self.chunk {
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
            is_faulty: self.scene.story.fault(row.tick).is_some(),
            ..now
        });
    }

    /// Writes an entity where it shows something else than before; `None`: nothing.
    fn show<A: AsComponents>(
        &mut self,
        tick: u64,
        path: String,
        key: Option<String>,
        make: impl FnOnce(&Self) -> A,
    ) {
        if self.shown.get(&path) == key.as_ref() {
            return;
        }
        match key {
            Some(key) => {
                self.sink.log(tick, &path, &make(self));
                self.shown.insert(path, key);
            }
            None => {
                self.sink.log(tick, &path, &Clear::flat());
                self.shown.remove(&path);
            }
        }
    }

    /// Writes out what is being gathered.
    fn write_gathered(&mut self) {
        self.write_tracks();
        for (path, table) in [
            (entity::DRAWN, &mut self.drawn),
            (entity::SIGNALS, &mut self.signals),
        ] {
            let (ticks, columns) = table.take();
            self.sink.send_columns(path, &ticks, columns);
        }
    }

    fn finish(mut self) -> Result<(), RecordError> {
        if !self.is_introduced {
            self.introduce();
        }
        self.write_gathered();
        if let Some(last) = self.last {
            let beyond = if self.run.is_live { 0.0 } else { LEGEND };
            self.write_guides(last + (beyond * last as f64) as u64);
            // A viewer that follows a live run must not loop. Now the eyes see a way that no plan told.
            if !self.run.is_live {
                let (first, last) = self.room.repeated(self.run.rate_hz, last);
                let ticks = [first, last].map(|tick| self.sink.nanoseconds(tick));
                self.send_blueprint(Some(ticks.into()));
            }
        }
        self.sink.finish()
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

    /// At the first report: names of the singularities, and with them the blueprint.
    fn introduce(&mut self) {
        self.is_introduced = true;
        let names = self.scene.named.iter().map(|one| &one.name);
        let names = array(StringArray::from_iter_values(names));
        let names = AnyValues::default().with_component_from_data(entity::SINGULARITY_NAMES, names);
        self.sink.log_static(entity::SIGNALS, &names);
        for one in &self.scene.named {
            self.style(format!("/{}", one.name), narration::MODE_STATES);
        }
        self.send_blueprint(None);
    }

    fn send_blueprint(&self, repeated: Option<(i64, i64)>) {
        let layout = self.run.job.scenario.view.layout;
        let mut subject = subject(self.run, self.happened, &self.scene, &self.room, layout);
        if repeated.is_some() {
            subject.errors = self.scene.errors;
        }
        self.sink
            .send_blueprint(blueprint::messages(&subject, layout, repeated));
    }

    fn style_lanes(&self) {
        let faults = self.scene.story.faults.iter();
        let faults = faults.map(|fault| (fault.lane.as_str(), FAULT_COLOUR));
        let faults: Vec<_> = faults.chain([NO_FAULT]).collect();
        self.style(entity::FAULT.to_owned(), &faults);
        self.style(entity::DRIVE.to_owned(), narration::DRIVE_STATES);
        self.style(entity::PHASE.to_owned(), narration::PHASE_STATES);
        for life in entity::lives(&self.run.job.graph) {
            self.style(entity::life(&life), narration::LIFE_STATES);
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

    /// Lines that never move, as often as a plot needs to draw them.
    fn write_guides(&self, tick: u64) {
        let scenario = &self.run.job.scenario;
        let bound = |bound: f64, most: f64| match bound < most {
            true => vec![bound.log10()],
            false => Vec::new(),
        };
        let band = |k: usize| -3.1 * k as f64 / BAND_LINES as f64;
        let analysis = &scenario.analysis;
        let edge = |one: &Named| {
            let (outer, inner) = (analysis.eta_out.of(one.kind), analysis.eta_in.of(one.kind));
            (outer / inner.max(1e-9)).log10()
        };
        let guides = [
            ("guide:zero", vec![0.0]),
            ("guide:band", (0..BAND_LINES).map(band).collect()),
            ("guide:edge", self.scene.named.iter().map(edge).collect()),
            (
                "guide:goal_position",
                bound(scenario.goal.position_mm, 1000.0),
            ),
            (
                "guide:goal_orientation",
                bound(scenario.goal.orientation_deg, 180.0),
            ),
        ];
        self.sink.log(tick, entity::GUIDES, &numbers(guides));
    }
}

fn array(values: impl Array + 'static) -> rerun::external::arrow::array::ArrayRef {
    std::sync::Arc::new(values)
}

/// Components of our own.
fn numbers<const N: usize>(columns: [(&'static str, Vec<f64>); N]) -> AnyValues {
    let columns = columns.into_iter();
    columns.fold(AnyValues::default(), |all, (name, values)| {
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
            let line = line.with_level(TextLogLevel::from(level.name()));
            sink.log(tick, entity::LOG, &line);
        }
    }
}

#[cfg(test)]
mod tests;
