//! A run as a Rerun recording: its numbers at the control rate, its pictures 50 times a second, what changes as it changes.

mod draw;
mod marks;
mod rows;

use std::collections::BTreeMap;
use std::path::Path;

use model::{Joint, Robot};
use re_sdk_types::archetypes::{
    Clear, RecordingInfo, StateChange, StateConfiguration, TextDocument, TextLog,
};
use re_sdk_types::components::TextLogLevel;
use re_sdk_types::{AnyValues, DynamicArchetype};
use rerun::external::arrow::array::{Array, ArrayRef, Float64Array, StringArray};
use rerun::log::LogMsg;
use rerun::{AsComponents, EntityPath};
use shared_types::codes::{self, DRIVES, MODES, PHASES};
use shared_types::event::Event;
use shared_types::job::Job;
use shared_types::scenario::Layout;

use crate::blueprint::{self, BAND_LINES, LEGEND};
use crate::entity;
use crate::facts::{Facts, range};
use crate::narration::{
    DRIVE_COLOURS, FAULT_COLOUR, LIFE_STATES, MODE_COLOURS, NO_FAULT, PHASE_COLOURS,
};
use crate::picture::Scene;
use crate::pose::Rgba;
use crate::run::{Happened, Progress, Source, Tick};
use crate::signals::{Kept, Now, Signal};
use crate::sink::{RecordError, RrdFile, Sink, activation};
use crate::story::{Named, News};
use rows::{Table, Track};

/// How often a viewer that watches gets more; s of the run.
const LIVE_S: f64 = 0.25;
/// Chunks of a file, about: each costs its schema, and a line of the table of contents.
const CHUNKS: f64 = 200.0;
/// How often a caller hears how far it is; ticks.
const NEWS: u64 = 500;
/// Rate of what is only drawn: more than a plot has points across.
const DRAWN_HZ: f64 = 125.0;
/// Ticks without a command that are told.
const PATIENCE: u64 = 5;

/// Draws a run into an `.rrd` file, which stands in its place when it is whole. Returns a sentence about meshes of the arm that could not be read.
///
/// # Errors
/// [`RecordError`] where the arm cannot be drawn, the file not be written, or the source's `progress` has ended it; nothing is left then.
pub fn write_rrd(path: &Path, source: Source) -> Result<Option<String>, RecordError> {
    let facts = Facts::new(source.job, source.robot, source.happened, false)?;
    let sink = Sink::file(path, &facts)?;
    Recording::new(sink, &facts)?.draw_all(source.ticks, source.progress)?;
    Ok(facts.lacking)
}

/// Draws a run while it lasts into a viewer that listens at a URL such as `rerun+http://127.0.0.1:9876/proxy`.
///
/// # Errors
/// [`RecordError`] where the arm cannot be drawn, or the URL is none of a viewer.
pub fn show_live(url: &str, source: Source) -> Result<Option<String>, RecordError> {
    let facts = Facts::new(source.job, source.robot, source.happened, true)?;
    let sink = Sink::viewer(url, &facts)?;
    Recording::new(sink, &facts)?.draw_all(source.ticks, source.progress)?;
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
    let facts = Facts::new(job, robot, Happened::default(), false)?;
    let mut scene = Scene::new(&facts);
    scene.push(&facts, first, &mut |_, _| ());
    let (messages, store) = blueprint::messages(&facts, &scene, layout, None)?;
    let mut file = RrdFile::create(path)?;
    file.append(&messages)?;
    file.append(&[LogMsg::BlueprintActivationCommand(activation(&store))])?;
    file.finish()
}

/// A recording in the making: ticks in, Rerun's rows out.
struct Recording<'a> {
    sink: Sink,
    run: &'a Facts<'a>,
    scene: Scene,
    signals: Table,
    /// Values only drawn, every so many ticks.
    drawn: Table,
    /// A chunk is written every so many ticks.
    chunk: u64,
    /// Ticks since the last command.
    unheard: u64,
    /// By its path, what an entity shows that is written when that changes.
    shown: BTreeMap<String, String>,
    /// The strokes of the last picture, by their paths.
    strokes: BTreeMap<String, String>,
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
    fn new(sink: Sink, run: &'a Facts) -> Result<Self, RecordError> {
        let chunk_s = if run.is_live {
            LIVE_S
        } else {
            (run.job.scenario.duration_s() / CHUNKS).clamp(1.0, 10.0)
        };
        let mut recording = Self {
            sink,
            run,
            scene: Scene::new(run),
            signals: Table::of(entity::SIGNALS, false),
            drawn: Table::of(entity::DRAWN, run.is_live),
            chunk: run.every(chunk_s),
            unheard: 0,
            shown: BTreeMap::new(),
            strokes: BTreeMap::new(),
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
            self.tick(&tick)?;
            if count % NEWS == 0 && !progress(count) {
                return Err(RecordError::Stopped);
            }
        }
        self.finish()
    }

    /// Takes a tick in. Ticks come in order; one that was lost leaves a gap.
    fn tick(&mut self, row: &Tick) -> Result<(), RecordError> {
        let (sink, mut is_other_fault) = (&self.sink, false);
        let picture = self.scene.push(self.run, row, &mut |tick, news| {
            is_other_fault |= matches!(news, News::State { name: "fault", .. });
            write(sink, tick, &news);
        });
        let now = Now {
            is_faulty: self.scene.story.fault(row.tick).is_some(),
            ..Now::new(row, self.run)
        };
        self.signals.push(&now);
        if row.tick.is_multiple_of(self.run.every(1.0 / DRAWN_HZ)) {
            self.drawn.push(&now);
        }
        self.unheard = row.torque.map_or(self.unheard + 1, |_| 0);
        if let Some(picture) = &picture {
            self.draw(row, picture);
            if !self.is_introduced && row.singularity.is_some() {
                self.introduce()?;
            }
        }
        // A tick or two without a command is not worth a line.
        let is_told = row.torque.is_some() && row.singularity.is_some() || self.unheard >= PATIENCE;
        let is_race = self.run.happened.rival.is_some();
        if is_told && !is_race && (picture.is_some() || is_other_fault) {
            let words = self.scene.words(self.run, row);
            self.tell_now(row.tick, &words.markdown(&self.scene.story.named));
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

    /// Shows the words about the present tick, in Markdown.
    fn tell_now(&mut self, tick: u64, words: &str) {
        let document = || TextDocument::from_markdown(words);
        self.show(tick, entity::NOW.to_owned(), words.to_owned(), document);
    }

    /// Writes an entity where it shows something else than before.
    fn show<A: AsComponents>(
        &mut self,
        tick: u64,
        path: String,
        key: String,
        make: impl FnOnce() -> A,
    ) {
        if self.shown.get(&path) != Some(&key) {
            self.sink.log(tick, &path, &make());
            self.shown.insert(path, key);
        }
    }

    /// An entity shows nothing any more.
    fn hide(&mut self, tick: u64, path: &str) {
        if self.shown.remove(path).is_some() {
            self.sink.log(tick, path, &Clear::flat());
        }
    }

    /// Writes out what is being gathered.
    fn write_gathered(&mut self) {
        self.write_tracks();
        for table in [&mut self.drawn, &mut self.signals] {
            let (ticks, columns) = table.take();
            self.sink.send_columns(table.entity, &ticks, columns);
        }
    }

    fn finish(mut self) -> Result<(), RecordError> {
        if !self.is_introduced {
            self.introduce()?;
        }
        self.write_gathered();
        if let Some(last) = self.last {
            let beyond = if self.run.is_live { 0.0 } else { LEGEND };
            self.write_guides(last + (beyond * last as f64) as u64);
            // A viewer that follows a live run must not loop. Now the eyes see a way that no plan told.
            if !self.run.is_live {
                let ticks = self.scene.room.repeated(self.run.rate_hz, last);
                self.send_blueprint(Some(ticks.map(|tick| self.sink.nanoseconds(tick))))?;
            }
        }
        self.sink.finish()
    }

    fn write_properties(&self) {
        let info = RecordingInfo::new().with_name(self.run.title);
        self.sink.log_static(EntityPath::properties(), &info);
        let properties = self.run.properties().into_iter().fold(
            DynamicArchetype::new("run"),
            |all, (name, value)| {
                all.with_component_from_data(name, array(StringArray::from_iter([Some(value)])))
            },
        );
        let path = EntityPath::properties().join(&"run".into());
        self.sink.log_static(path, &properties);
        let about = Signal::ALL
            .iter()
            .filter(|signal| !matches!(signal.of().kept, Kept::Drawn | Kept::Table))
            .map(|signal| format!("`{}`: {}", signal.component(), signal.about()));
        let about = TextDocument::from_markdown(about.collect::<Vec<_>>().join("\n\n"));
        self.sink.log_static("/signals/about", &about);
        let of = |value: fn(&Joint) -> f64| self.run.robot.joints.iter().map(value).collect();
        let limits = [
            ("joint:qdot_limit", of(|joint| joint.velocity)),
            ("joint:torque_limit", of(|joint| joint.effort)),
            ("joint:q_centre", of(|joint| range(joint)[0])),
            ("joint:q_half_range", of(|joint| range(joint)[1])),
        ];
        self.sink.log_static(entity::SIGNALS, &numbers(limits));
    }

    /// At the first report: names of the singularities, and with them the blueprint.
    fn introduce(&mut self) -> Result<(), RecordError> {
        self.is_introduced = true;
        let named = &self.scene.story.named;
        let names = array(StringArray::from_iter_values(
            named.iter().map(|one| &one.name),
        ));
        let names = AnyValues::default().with_component_from_data("singularity:names", names);
        self.sink.log_static(entity::SIGNALS, &names);
        for one in named {
            self.style(format!("/{}", one.name), names_of(MODES).zip(MODE_COLOURS));
        }
        self.send_blueprint(None)
    }

    fn send_blueprint(&self, repeated: Option<[i64; 2]>) -> Result<(), RecordError> {
        let layout = self.run.job.scenario.view.layout;
        let (messages, store) = blueprint::messages(self.run, &self.scene, layout, repeated)?;
        self.sink.send_blueprint(messages, &store);
        Ok(())
    }

    fn style_lanes(&self) {
        let faults = self
            .scene
            .story
            .faults
            .iter()
            .map(|fault| (fault.lane.as_str(), FAULT_COLOUR));
        self.style(entity::FAULT, faults.chain([NO_FAULT]));
        self.style(entity::DRIVE, names_of(DRIVES).zip(DRIVE_COLOURS));
        self.style(entity::PHASE, names_of(PHASES).zip(PHASE_COLOURS));
        for life in entity::lives(&self.run.job.graph) {
            self.style(entity::life(&life), LIFE_STATES);
        }
    }

    fn style<'s>(
        &self,
        path: impl Into<EntityPath>,
        states: impl IntoIterator<Item = (&'s str, Rgba)>,
    ) {
        let (names, colours): (Vec<_>, Vec<_>) = states.into_iter().unzip();
        let configuration = StateConfiguration::new()
            .with_values(names.iter().copied())
            .with_labels(names.iter().copied())
            .with_colors(colours);
        self.sink.log_static(path, &configuration);
    }

    /// Lines that never move, as often as a plot needs to draw them.
    fn write_guides(&self, tick: u64) {
        let scenario = &self.run.job.scenario;
        let bound = |bound: f64, most: f64| {
            if bound < most {
                vec![bound.log10()]
            } else {
                Vec::new()
            }
        };
        let band = |k: usize| -3.1 * k as f64 / BAND_LINES as f64;
        let (analysis, goal) = (&scenario.analysis, &scenario.goal);
        let edge = |one: &Named| {
            let (outer, inner) = (analysis.eta_out.of(one.kind), analysis.eta_in.of(one.kind));
            (outer / inner.max(1e-9)).log10()
        };
        let guides = [
            ("guide:zero", vec![0.0]),
            ("guide:band", (0..BAND_LINES).map(band).collect()),
            (
                "guide:edge",
                self.scene.story.named.iter().map(edge).collect(),
            ),
            ("guide:goal_position", bound(goal.position_mm, 1000.0)),
            ("guide:goal_orientation", bound(goal.orientation_deg, 180.0)),
        ];
        self.sink.log(tick, entity::GUIDES, &numbers(guides));
    }
}

fn names_of(codes: &'static [codes::Named]) -> impl Iterator<Item = &'static str> {
    codes.iter().map(|(_, name)| *name)
}

fn array(values: impl Array + 'static) -> ArrayRef {
    std::sync::Arc::new(values)
}

/// Components of our own.
fn numbers(columns: impl IntoIterator<Item = (&'static str, Vec<f64>)>) -> AnyValues {
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
            let line = line.with_level(TextLogLevel::from(level.name()));
            sink.log(tick, entity::LOG, &line);
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;
