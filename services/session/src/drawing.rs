//! A run's record as everything that is made from it: the recording, tables, the page.

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use launcher::Interrupts;
use model::Robot;
use recorder::{MESSAGES, Ticks};
use shared_types::job::Job;
use shared_types::summary::Summary;
use viz::{Happened, RECORDING, RecordError, Source, Tick};

use crate::failure::Failure;
use crate::launch::interrupts;
use crate::progress::{Observer, Progress, say};
use crate::results::Results;
use crate::runs::Run;

/// How long work goes on before its progress is shown.
const QUIET: Duration = Duration::from_secs(1);

/// The remains of a run: its messages, tick by tick, and what is known besides.
pub(crate) struct Record {
    run: Run,
    pub(crate) job: Job,
    pub(crate) robot: Robot,
    /// None yet of a run that still goes on, or whose launcher was killed.
    pub(crate) summary: Option<Summary>,
    ticks: Ticks,
    /// Why its summary cannot be read.
    defect: Option<String>,
}

impl Record {
    /// # Errors
    /// [`Failure::Input`] where no tick of the run can be read.
    pub(crate) fn open(run: &Run) -> Result<Self, Failure> {
        let job = run.job()?;
        if !job.record {
            return Err(Failure::Input(format!(
                "{} has no record; run it again without --no-record",
                run.folder.display()
            )));
        }
        run.check_readable(&job)?;
        let summary = run.summary_if_any();
        let defect = summary.as_ref().err().cloned();
        let record = Self::of(job, &run.folder, summary.ok().flatten())?;
        Ok(Self { defect, ..record })
    }

    /// The record that a job's run has in a folder.
    pub(crate) fn of(
        mut job: Job,
        folder: &Path,
        summary: Option<Summary>,
    ) -> Result<Self, Failure> {
        // Its name identifies the recording: two in one viewer are not one.
        if let Some(summary) = &summary {
            job.run.clone_from(&summary.of.run);
        }
        let robot = Robot::from_source(&job.robot).map_err(Failure::input)?;
        let ticks = Ticks::open(&folder.join(MESSAGES), &job).map_err(Failure::input)?;
        Ok(Self {
            run: Run {
                folder: folder.to_owned(),
            },
            ticks,
            job,
            robot,
            summary,
            defect: None,
        })
    }

    /// Makes something from it, with progress, until a signal comes; returns that, and the clauses about what the record lacks.
    pub(crate) fn make<T>(
        mut self,
        title: &str,
        signals: &mut Interrupts,
        observer: Observer<'_>,
        make: impl FnOnce(Source<'_>) -> T,
    ) -> (T, Read) {
        let (begun, is_shown, last) = (Instant::now(), Cell::new(false), Cell::new(None));
        let length = self.summary.as_ref().map_or(0, |summary| summary.ticks);
        // The messages of a run whose launcher was killed end at different ticks: behind the last whole one nothing was judged.
        let end = self.summary.as_ref().map_or(u64::MAX, |_| length);
        let faults = self
            .summary
            .as_ref()
            .map_or(&[][..], |summary| &summary.faults);
        let made = make(Source {
            job: &self.job,
            robot: &self.robot,
            happened: Happened {
                faults,
                rival: None,
            },
            ticks: &mut read(&mut self.ticks, &last).take_while(|tick| tick.tick < end),
            progress: &mut |count| {
                if !is_shown.get() && begun.elapsed() > QUIET {
                    is_shown.set(true);
                    let unit = "ticks";
                    observer(Progress::Begin {
                        title,
                        length,
                        unit,
                    });
                }
                observer(Progress::Position(count));
                signals.pending().is_none()
            },
        });
        if is_shown.get() {
            observer(Progress::End);
        }
        let has_summary = self.summary.is_some() || self.defect.is_some();
        let mut lacks = self.ticks.damage(self.summary.as_ref());
        lacks.extend(self.defect);
        let error = self.summary.map(|summary| summary.recorder.error);
        lacks.extend(error.filter(|error| !error.is_empty() && !lacks.contains(error)));
        let last = last.get();
        if let Some(last) = last.filter(|_| !has_summary) {
            self.run.say_end(last, observer);
        }
        (made, Read { last, lacks })
    }
}

/// Draws the recording into a file; a sentence about meshes that could not be read goes to the observer.
///
/// # Errors
/// [`RecordError`] where the file cannot be written, or a signal has ended that.
pub(crate) fn draw(
    source: Source<'_>,
    path: &Path,
    observer: Observer<'_>,
) -> Result<(), RecordError> {
    if let Some(sentence) = viz::write_rrd(path, source)? {
        say(observer, sentence);
    }
    Ok(())
}

/// A record that has been read.
pub(crate) struct Read {
    /// The last tick.
    pub(crate) last: Option<u64>,
    /// Its gaps, in clauses.
    pub(crate) lacks: Vec<String>,
}

/// The ticks of a record as pictures and tables are made of them; `last` is the last one read.
fn read<'a>(
    ticks: &'a mut Ticks,
    last: &'a Cell<Option<u64>>,
) -> impl Iterator<Item = Tick> + use<'a> {
    let mut next = ticks.next();
    std::iter::from_fn(move || {
        let row = next.take()?;
        // Those that are noted behind it are its own where it is the last.
        next = ticks.next();
        last.set(Some(row.tick));
        Some(Tick {
            tick: row.tick,
            messages: *row.messages(),
            events: ticks.events().collect(),
        })
    })
}

/// Draws the recording of a run that is over into its folder. A signal ends that, and a sentence says how to get it.
///
/// # Errors
/// [`Failure::Work`] where it cannot be drawn.
pub(crate) fn draw_results(
    job: &Job,
    summary: &Summary,
    observer: Observer<'_>,
    signals: &mut Interrupts,
) -> Result<(), Failure> {
    if !job.record || summary.ticks == 0 {
        return Ok(());
    }
    let folder = &job.out;
    let record = Record::of(job.clone(), folder, Some(summary.clone()))?;
    let remedy = || format!("`armplane view {}` makes it", folder.display());
    let file = folder.join(RECORDING);
    let (drawn, _) = record.make(RECORDING, signals, observer, |source| {
        draw(source, &file, observer)
    });
    match drawn {
        Ok(()) => Ok(()),
        Err(RecordError::Stopped) => {
            let remedy = remedy();
            say(
                observer,
                format_args!("{RECORDING} was not finished: {remedy}"),
            );
            Ok(())
        }
        Err(error) => Err(Failure::Work(format!("{error}; then {}", remedy()))),
    }
}

/// A recording to be shown.
pub struct Shown {
    /// Its file.
    pub file: PathBuf,
    /// The gaps of the record, in one sentence.
    pub lack: Option<String>,
    /// The folder of a recording of a run that still goes on; it goes when this is dropped.
    _passing: Option<tempfile::TempDir>,
}

/// The recording of a run, made where it is missing. Of a run that still goes on as far as its record holds it, beside the user's files; a sentence says
/// to which tick.
///
/// # Errors
/// [`Failure`] where there is no record, or the recording cannot be made.
pub fn shown(run: &Run, observer: Observer<'_>) -> Result<Shown, Failure> {
    let file = run.folder.join(RECORDING);
    let is_alive = run.is_alive();
    if file.exists() && !is_alive {
        return Ok(Shown {
            file,
            lack: None,
            _passing: None,
        });
    }
    let record = Record::open(run)?;
    // Its launcher may be about to draw it.
    let _folder = (!is_alive)
        .then(|| Results::of_run(&run.folder))
        .transpose()?;
    let passing = is_alive
        .then(tempfile::tempdir)
        .transpose()
        .map_err(Failure::work)?;
    let file = passing
        .as_ref()
        .map_or(file, |folder| folder.path().join(RECORDING));
    let mut signals = interrupts()?;
    let (drawn, Read { lacks, .. }) = record.make(RECORDING, &mut signals, observer, |source| {
        draw(source, &file, observer)
    });
    drawn.map_err(Failure::work)?;
    Ok(Shown {
        file,
        lack: (!lacks.is_empty()).then(|| run.with_remedy(&lacks.join("; "))),
        _passing: passing,
    })
}
