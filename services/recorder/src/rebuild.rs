//! Joins the files of a run's record, and judges the run from them: when a recorder was replaced, or the launcher was killed.

use std::path::{Path, PathBuf};

use model::Robot;
use runtime::ProcessError;
use shared_types::job::Job;
use shared_types::summary::{RecorderSummary, Summary};

use crate::contents::Contents;
use crate::cut::Cut;
use crate::error::RecordError;
use crate::event::{Event, Source};
use crate::judge::Tick;
use crate::reader::{RecordReader, part};
use crate::ticks::{Row, Ticks};
use crate::writer::RecordWriter;
use crate::{MESSAGES, judge, remove_parts, summary, take};

/// Whether a recorder was replaced while it wrote this job's record.
pub fn is_in_parts(job: &Job) -> bool {
    part(&job.out.join(MESSAGES), 2).exists()
}

/// Judges a run from the record in its folder, and joins the record's files: to the last tick, or, where the run did not come to its end, to the last one
/// that is whole; a run that was killed before its first message has no tick. The damage of a record stands in the recorder's part of the summary, as its error; a damaged record stays as it is.
///
/// # Errors
/// [`ProcessError`] if the messages cannot be read, or the recording cannot be written.
pub fn rebuild(robot: &Robot, job: &Job, is_ended: bool) -> Result<Summary, ProcessError> {
    let path = job.out.join(MESSAGES);
    let mut ticks = Ticks::open_left(&path, job).map_err(ProcessError::setup)?;
    let mut judge = judge(robot, job)?;
    let mut rows = 0;
    let mut copy = Copy::begin(&path, &Contents::of(job), &ticks);
    ticks.cuts();
    // The messages of the topics end at different ticks: rows after the last whole one are left out.
    let mut partial: Vec<Box<Row>> = Vec::new();
    while let Some(row) = ticks.next_with(|channel, message| {
        copy.write(|record| record.append(channel, message));
    }) {
        tell(faults(&mut ticks), &mut copy);
        keep(ticks.cuts(), &mut copy);
        let is_whole = is_ended || Tick::of(&row.messages().lent()).is_some();
        partial.push(row);
        if is_whole {
            for row in partial.drain(..) {
                let events = take(&row, &mut judge);
                rows += 1;
                tell(events.into_iter(), &mut copy);
            }
        }
    }
    tell(faults(&mut ticks), &mut copy);
    keep(ticks.cuts(), &mut copy);
    let damage = ticks.damage_so_far();
    let copied = match damage.is_empty() {
        true => copy.finish(),
        false => copy.abandon(),
    };
    let clauses = damage.into_iter().chain([copied]);
    let clauses: Vec<String> = clauses.filter(|clause| !clause.is_empty()).collect();
    let recorded = RecorderSummary {
        rows,
        error: clauses.join("; "),
        bytes: std::fs::metadata(&path).map_or(0, |file| file.len()),
        ..RecorderSummary::default()
    };
    Ok(summary(job, judge, ticks.assembler(), recorded))
}

/// The events that have been read, but for the judge's, which says them again.
fn faults(ticks: &mut Ticks) -> impl Iterator<Item = Event> {
    ticks.events().filter(|one| one.source != Source::Judge)
}

fn tell(events: impl Iterator<Item = Event>, copy: &mut Copy<'_>) {
    for event in events {
        copy.write(|record| record.event(&event));
    }
}

fn keep(cuts: Vec<Cut>, copy: &mut Copy<'_>) {
    for cut in cuts {
        copy.write(|record| record.cut(&cut));
    }
}

/// A record that is written again, whole; it takes the place of the old one when it is there.
struct Copy<'a> {
    path: &'a Path,
    writer: Option<RecordWriter>,
    error: String,
}

impl<'a> Copy<'a> {
    /// None of a record that is whole already.
    fn begin(path: &'a Path, contents: &Contents, ticks: &Ticks) -> Self {
        let mut copy = Self {
            path,
            writer: None,
            error: String::new(),
        };
        let is_needed = |record: &RecordReader| !record.has_summary() || part(path, 2).exists();
        if ticks.record().is_some_and(is_needed) {
            match RecordWriter::create(&path.with_added_extension("tmp"), contents) {
                Ok(writer) => copy.writer = Some(writer),
                Err(error) => copy.error = error.to_string(),
            }
        }
        copy
    }

    fn write(&mut self, write: impl FnOnce(&mut RecordWriter) -> Result<(), RecordError>) {
        if let Some(writer) = &mut self.writer
            && let Err(error) = write(writer)
        {
            self.error = error.to_string();
            self.remove();
        }
    }

    /// Puts it into the place of the old one; why that has failed, or nothing.
    fn finish(mut self) -> String {
        if let Some(writer) = self.writer.take() {
            let placed = writer.finish().and_then(|_| {
                std::fs::rename(self.unfinished(), self.path)
                    .map_err(RecordError::file("replace", self.path))
            });
            match placed {
                Ok(()) => remove_parts(self.path),
                Err(error) => {
                    self.error = error.to_string();
                    self.remove();
                }
            }
        }
        self.error
    }

    fn abandon(mut self) -> String {
        self.remove();
        self.error
    }

    fn remove(&mut self) {
        self.writer = None;
        let _ = std::fs::remove_file(self.unfinished());
    }

    fn unfinished(&self) -> PathBuf {
        self.path.with_added_extension("tmp")
    }
}
