//! The recorder's recording: parts of bounded length, ended at the first error.

use std::path::PathBuf;

use model::Robot;
use runtime::ProcessError;
use shared_types::job::Job;
use shared_types::scenario::{Record, Scenario};
use shared_types::summary::RecorderSummary;
use viz::{RecordError, Recording, RunInfo, TickRow};

use crate::event::{Event, Level};
use crate::ticks::Row;

/// The recording, as long as it can be written; the first error ends it and is kept.
pub(crate) struct Tape {
    recording: Option<Recording>,
    folder: PathBuf,
    limits: PartLimits,
    /// Its entry in the summary.
    pub(crate) result: RecorderSummary,
}

/// How often the recording is written besides at every checkpoint: a chunk costs the same whatever it holds, and what it holds goes with a run
/// that is killed whole, until `armplane recover`, or with a volume that is full. Often where a viewer watches.
fn options(job: &Job) -> viz::Options {
    let seldom = viz::Options::default();
    viz::Options {
        chunk_s: if job.live { 0.25 } else { seldom.chunk_s },
        is_live: job.live,
        ..seldom
    }
}

/// When a recording continues in another file.
#[derive(Clone, Copy)]
struct PartLimits {
    ticks: u64,
    bytes: u64,
}

impl PartLimits {
    fn new(scenario: &Scenario) -> Self {
        let Record { part_s, part_mb } = scenario.record;
        Self {
            ticks: (part_s * f64::from(scenario.rate_hz)).round().max(1.0) as u64,
            bytes: part_mb.saturating_mul(1_000_000),
        }
    }
}

impl Tape {
    /// None: the recording is made again from the messages.
    pub(crate) fn none(job: &Job) -> Self {
        Self {
            recording: None,
            folder: job.out.clone(),
            limits: PartLimits::new(&job.scenario),
            result: RecorderSummary::default(),
        }
    }

    /// A recording in the job's folder, where the job wants one.
    ///
    /// # Errors
    /// When the file cannot be made.
    pub(crate) fn start(robot: &Robot, job: &Job) -> Result<Self, ProcessError> {
        let tape = Self::none(job);
        if !job.record {
            return Ok(tape);
        }
        let info = RunInfo {
            scenario: &job.scenario,
            robot,
            run: &job.run,
            version: &job.version,
            seed: job.scenario.seed,
            hops: viz::chain_hops(&job.graph),
            lives: viz::Lives::of(&job.graph),
        };
        let failed = |error| {
            ProcessError::setup(format!(
                "cannot take away what stands in the way of the recording in {}: {error}",
                job.out.display()
            ))
        };
        // A folder given with --out may hold an older recording, with more parts.
        viz::cut_behind(&job.out, None).map_err(failed)?;
        let mut tape = Self {
            result: RecorderSummary {
                file: viz::part_name(0),
                ..RecorderSummary::default()
            },
            ..tape
        };
        match Recording::create_part(&job.out, 0, &info, options(job)) {
            Ok(recording) => {
                if let Some(sentence) = recording.lacking() {
                    runtime::complain(&sentence);
                }
                tape.recording = Some(recording);
            }
            Err(error @ RecordError::Arm { .. }) => return Err(ProcessError::setup(error)),
            // A volume without room ends the recording, not the run.
            Err(error) => tape.fail(error),
        }
        Ok(tape)
    }

    /// Adds a tick, without its missing messages.
    pub(crate) fn tick(&mut self, row: &Row) {
        // Those for which there is no room any more count too: they are what the recording lacks.
        self.result.rows += 1;
        let Some(recording) = &mut self.recording else {
            return;
        };
        let row = TickRow::new(row.tick, row.messages().lent());
        let full = recording.part_ticks() >= self.limits.ticks
            || recording.part_bytes() >= self.limits.bytes;
        let turned = if full {
            recording.next_part(&self.folder)
        } else {
            Ok(())
        };
        if full {
            // A file's table of contents grows with it and is gone now.
            runtime::realtime::give_back_memory();
        }
        if let Err(error) = turned.and_then(|()| recording.tick(&row)) {
            self.fail(error);
        }
    }

    pub(crate) fn event(&mut self, event: &Event) {
        let level = match event.level {
            Level::Info => viz::Level::Info,
            Level::Warning => viz::Level::Warning,
            Level::Error => viz::Level::Error,
        };
        if let Some(recording) = &mut self.recording {
            recording.event(event.tick, level, &event.text);
        }
    }

    /// A fault takes effect; its words for the lane and for the headline.
    pub(crate) fn fault_begins(&mut self, tick: u64, number: usize, lane: &str, headline: &str) {
        if let Some(recording) = &mut self.recording {
            recording.fault_begins(tick, number, lane, headline);
        }
    }

    pub(crate) fn fault_ends(&mut self, tick: u64, number: usize) {
        if let Some(recording) = &mut self.recording {
            recording.fault_ends(tick, number);
        }
    }

    /// Keeps the first error; what was written before it stays.
    fn fail(&mut self, error: RecordError) {
        if let Some(recording) = self.recording.take() {
            // A part that could not be followed by another still gets its end.
            let _ = recording.finish();
        }
        let error = error.keeping(self.kept().1);
        runtime::complain(&error);
        self.result.error = error.to_string();
    }

    /// Parts and bytes that can be read, a predecessor's too.
    fn kept(&self) -> (u32, u64) {
        let parts = viz::parts_in(&self.folder);
        (parts.len() as u32, viz::bytes_in(&parts))
    }

    /// Ends the recording.
    pub(crate) fn finish(mut self) -> RecorderSummary {
        if let Some(recording) = self.recording.take()
            && let Err(error) = recording.finish()
        {
            self.fail(error);
        }
        if !self.result.file.is_empty() {
            (self.result.parts, self.result.bytes) = self.kept();
        }
        self.result
    }
}
