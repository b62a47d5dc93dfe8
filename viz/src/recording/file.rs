//! A recording from its first tick to its end: parts, ticks, events.

use model::Model;
use nalgebra::{SVector, Vector3};
use re_log_types::StoreId;
use re_sdk_types::archetypes::TextLog;
use re_sdk_types::components::TextLogLevel;
use shared_types::scenario::{Layout, Scenario, Segment};
use shared_types::{MAX_DOF, MAX_SINGULARITIES};
use std::path::Path;

use super::columns::{Picture, Table};
use super::ending::Stretches;
use super::parts::{create, part_name};
use super::pieces::{Room, application};
use super::state::{Facts, Level, Options, Part, Recording, RunInfo, Story, Title, Written};
use super::write::LEGEND;
use crate::arm::Figure;
use crate::blueprint::{Subject, Way};
use crate::manipulability::{at_point, singular_values};
use crate::narration::History;
use crate::scene::NullMotion;
use crate::signals::{Drawn, Limits, Signal, TickRow, draw, sample};
use crate::sink::{FileInfo, RecordError, Sink, Storage};
use crate::{blueprint, entity};

impl Recording {
    /// Creates the first part in `folder` and writes what never changes: the run's properties, the arm's figure, styles.
    ///
    /// # Errors
    /// [`RecordError`] where the file cannot be made or written, or the robot has more joints than a message.
    pub fn create(folder: &Path, run: &RunInfo) -> Result<Self, RecordError> {
        Self::create_part(folder, 0, run, Options::default())
    }

    /// Creates part `part` of the recording of this run: the next one ([`parts_in`]) after the recorder before was killed.
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
/// [`RecordError`] where the file cannot be made or written, or the robot has more joints than a message.
pub fn save_blueprint(
    path: &Path,
    run: &RunInfo,
    first: &TickRow,
    layout: Layout,
) -> Result<(), RecordError> {
    let mut recording = Recording::with_storage(Nowhere, 0, run, Options::default())?;
    recording.tick(first)?;
    recording.save_blueprint(path, layout)
}

/// Seconds that a plot shows by itself: half of them before the cursor.
const PLOTTED_S: f64 = 60.0;

/// Rate of what is only drawn: more than a plot has points across.
const DRAWN_HZ: f64 = 125.0;

/// Whether the task is null-space motion alone: every segment holds the hand, and some change the posture.
fn stands_still(scenario: &Scenario) -> bool {
    let holds = |one: &Segment| {
        Segment {
            posture_deg: None,
            ..one.clone()
        } == Segment {
            duration_s: one.duration_s,
            branch: one.branch,
            ..Segment::default()
        }
    };
    scenario.segment.iter().all(holds)
        && scenario.segment.iter().any(|one| one.posture_deg.is_some())
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

impl Recording {
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
        let facts = Facts::new(run, options)?;
        let store = StoreId::recording(application(run.robot), run.run);
        let mut recording = Self {
            sink: Sink::new(Box::new(storage), &store)?,
            store,
            before: FileInfo {
                parts: part,
                ..FileInfo::default()
            },
            subject: subject(run, options),
            part: Part::default(),
            story: Story::new(run),
            rival: None,
            signals: Table::of_signals(),
            drawn_table: Table::of_drawn(options.is_live),
            picture: Picture::default(),
            last: None,
            next: 0,
            run: facts,
        };
        recording.open()?;
        Ok(recording)
    }

    /// The beginning of every part.
    fn open(&mut self) -> Result<(), RecordError> {
        self.write_properties();
        self.write_figure();
        self.sink.flush();
        self.sink.check()
    }

    /// Ends the present part and goes on in another storage.
    ///
    /// # Errors
    /// As [`create`](Recording::create).
    pub fn turn_over(&mut self, storage: impl Storage + 'static) -> Result<(), RecordError> {
        self.flush();
        let chunks = self.sink.chunks();
        // The part's end comes first: who follows the files goes on as soon as the next one holds something.
        let bytes = self.sink.finish()?;
        self.sink = Sink::new(Box::new(storage), &self.store)?;
        self.before = FileInfo {
            bytes: self.before.bytes + bytes,
            chunks: self.before.chunks + chunks,
            ticks: self.before.ticks + self.part.ticks,
            parts: self.before.parts + 1,
        };
        self.part = Part::default();
        self.open()
    }

    /// Singular values of the unit-scaled Jacobian in the posture that has been analysed, the estimated one: the law has no use for them, so they are
    /// computed where they are drawn.
    fn singular_values(&self, row: &TickRow) -> Option<[f64; 6]> {
        let (report, q) = (
            row.singularity?,
            row.estimate
                .map(|estimate| &estimate.q[..])
                .or_else(|| row.q())?,
        );
        let q = SVector::from_column_slice(q);
        let J = at_point(
            self.run.arm.jacobian(&q),
            &(Vector3::from(report.p_BC) - self.run.arm.forward_kinematics(&q).p),
        );
        Some(singular_values(&J, report.length_m, &self.run.task))
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
            self.write_ghosts(row.tick, true);
            if let (Some(q), Some(turned)) = (row.q(), self.story.motion.turned(true)) {
                let links = self.links(q);
                self.write_turned(row.tick, &links, &turned);
            }
        }
        self.part.ticks += 1;
        if !self.part.blueprint_sent && row.singularity.is_some() {
            self.introduce(row);
        }
        self.gather(row);
        self.write_changes(row);
        if row.tick.is_multiple_of(self.run.picture_every) {
            self.see(row);
        }
        if row.tick >= self.part.guides_due {
            self.part.guides_due = row.tick + 5 * u64::from(self.run.rate_hz);
            self.write_guides(row.tick);
        }
        if self.signals.rows() as u64 >= self.run.chunk_every {
            self.flush();
        }
        self.sink.check()
    }

    /// The numbers of a tick.
    fn gather(&mut self, row: &TickRow) {
        let (limits, hops) = (&self.run.limits, self.run.hops);
        self.signals.push(row.tick, |put| {
            sample(row, limits, hops, |signal, values| {
                put(signal as usize, values)
            })
        });
        if !row.tick.is_multiple_of(self.run.drawn_every) {
            return;
        }
        let gravity = row
            .q()
            .map(|q| self.run.arm.gravity(&SVector::from_column_slice(q)))
            .unwrap_or_default();
        let sigma = self.singular_values(row);
        let mut faults = self.story.faults.iter();
        let is_faulty = faults.any(|fault| fault.until.is_none_or(|until| row.tick < until));
        self.drawn_table.push(row.tick, |put| {
            draw(row, limits, gravity.as_slice(), |drawn, values| {
                put(drawn as usize, values)
            });
            if is_faulty {
                put(Drawn::Fault as usize, &[0.0]);
            }
            let mut put =
                |signal: Signal, values: &[f64]| put(Drawn::ALL.len() + signal as usize, values);
            sample(row, limits, hops, &mut put);
            if let Some(sigma) = &sigma {
                put(Signal::SingularValues, &sigma[..limits.dof().min(6)]);
            }
        });
    }

    /// How far it has come.
    pub fn written(&self) -> Written {
        Written {
            next: self.next,
            part: self.part(),
            bytes: self.part_bytes(),
        }
    }

    /// Goes on where an earlier part had come to, which a recorder that was killed has left: ticks that come again are not written again. What is behind
    /// that place is taken away before, by [`cut_behind`](super::parts::cut_behind).
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
        let text = format!(
            "{:.3}{}{text}",
            self.nanoseconds(tick) as f64 * 1e-9,
            entity::AFTER_TIME
        );
        self.log(tick, entity::LOG, &TextLog::new(text).with_level(level));
    }

    /// Writes out what is being gathered.
    pub fn flush(&mut self) {
        self.write_picture();
        // Values held between their rows come first, so that readers of the signals have them.
        if let Some((ticks, columns)) = self.drawn_table.take() {
            self.send_columns(entity::DRAWN, &ticks, columns);
        }
        if let Some((ticks, columns)) = self.signals.take() {
            self.send_columns(entity::SIGNALS, &ticks, columns);
            self.next = ticks.last().map_or(self.next, |last| last + 1);
        }
        self.sink.flush();
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
        self.part.ticks
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
        if !self.part.blueprint_sent {
            self.introduce(&TickRow::default());
        }
        self.flush();
        if let Some(last) = self.last {
            self.write_guides(last);
            if !self.run.is_live {
                self.write_guides(last + (LEGEND * self.part.ticks as f64) as u64);
            }
            self.write_ending(last);
        }
        let (before, chunks) = (self.before, self.before.chunks + self.sink.chunks());
        let ticks = before.ticks + self.part.ticks;
        Ok(FileInfo {
            bytes: before.bytes + self.sink.finish()?,
            chunks,
            ticks,
            parts: before.parts + 1,
        })
    }

    /// Writes a layout as a `.rbl` file, to be opened beside any recording of the same robot; after the first tick.
    ///
    /// # Errors
    /// [`RecordError`] where the file cannot be made or written.
    pub fn save_blueprint(&self, path: &Path, layout: Layout) -> Result<(), RecordError> {
        let store = self.blueprint();
        let mut sink = Sink::new(Box::new(create(path)?), &store)?;
        blueprint::send(&sink, &store, &self.subject, layout);
        sink.finish().map(drop)
    }
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
        let rate = f64::from(scenario.rate_hz);
        let every = |seconds: f64| (seconds * rate).round().max(1.0) as u64;
        let segments = || scenario.segment.iter();
        Ok(Self {
            title: Title::new(run),
            arm,
            figure: Figure::new(robot, floor_m(scenario)),
            task: robot.task.0,
            directions: robot
                .task
                .0
                .iter()
                .filter(|served| **served)
                .count()
                .min(robot.joints.len()),
            planar: !robot.task.0[2],
            limits: Limits::new(robot),
            hops: run.hops,
            layout: scenario.view.layout,
            rate_hz: scenario.rate_hz.max(1),
            is_live: options.is_live,
            chunk_every: every(options.chunk_s),
            picture_every: every(1.0 / options.picture_hz),
            drawn_every: every(1.0 / DRAWN_HZ),
            wanted_turns: segments()
                .map(|one| one.reorient.as_ref())
                .map(|turn| turn.map(|turn| (turn.singularity.clone(), turn.by_deg)))
                .collect(),
            wanted_rotations: segments()
                .map(|one| one.turn.as_ref().map(|turn| turn.by_deg))
                .collect(),
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
            sides: [1.0; MAX_SINGULARITIES],
            ghosts: [0; MAX_DOF],
            faults: Vec::new(),
            fault_states: Vec::new(),
            unheard: 0,
            incarnations: Default::default(),
        }
    }
}

fn floor_m(scenario: &Scenario) -> f32 {
    scenario.plant.floor_m.map_or(0.0, |height| height as f32)
}

/// What a layout depends on, but for the singularities, which the first report names.
fn subject(run: &RunInfo, options: Options) -> Subject {
    let RunInfo {
        scenario, robot, ..
    } = *run;
    let unlimited = |limits: fn(&model::Joint) -> f64| {
        robot.joints.iter().any(|joint| !limits(joint).is_finite())
    };
    let judged = |bound: f64, most: f64| Some(bound).filter(|bound| *bound < most);
    Subject {
        lives: run.lives.clone(),
        joints: robot.joints.len(),
        floor_m: floor_m(scenario),
        goal: [
            judged(scenario.goal.position_mm, 1000.0),
            judged(scenario.goal.orientation_deg, 180.0),
        ],
        faults: !scenario.fault.is_empty() || options.is_live,
        is_long: (1.0 + LEGEND) * scenario.duration_s() > PLOTTED_S && !options.is_live,
        stands_still: stands_still(scenario),
        without_orientation: !robot.task.0[3..].contains(&true),
        ways: scenario.segment.iter().filter_map(Way::of).collect(),
        unlimited_torque: unlimited(|joint| joint.effort),
        unlimited_speed: unlimited(|joint| joint.velocity),
        ..Subject::default()
    }
}
