//! A run's recording and account made again from the messages that it kept: for a run whose launcher was killed.

use model::Robot;
use runtime::ProcessError;
use shared_types::job::{Job, Mode};
use shared_types::summary::Summary;

use crate::assemble::Row;
use crate::judge::{Judge, Tick};
use crate::message_rows::MessageRows;
use crate::tape::Tape;
use crate::{MESSAGES, summary, take};

/// Writes the recording of a run again, and judges it, from the messages in its folder, to the last that is whole; a run that was killed before its first
/// message has no tick. The damage of a message log stands in the recorder's part of the summary, as its error.
///
/// # Errors
/// [`ProcessError`] where the messages cannot be read, or the recording cannot be written.
pub fn rebuild(robot: &Robot, job: &Job) -> Result<Summary, ProcessError> {
    let mut rows =
        MessageRows::open_left(&job.out.join(MESSAGES), job).map_err(ProcessError::setup)?;
    let mut judge =
        Judge::in_processes(&job.graph, robot, &job.scenario).map_err(ProcessError::setup)?;
    if job.mode == Mode::Realtime {
        judge = judge.on_grid(1_000_000_000 / u64::from(job.scenario.rate_hz));
    }
    let mut tape = Tape::start(robot, job)?;
    // The messages of the topics end at different ticks: rows after the last whole one are left out.
    let mut partial: Vec<Row> = Vec::new();
    while let Some(row) = rows.next_row() {
        if Tick::of(&row.messages().lent()).is_none() {
            partial.push(row.clone());
            continue;
        }
        partial
            .drain(..)
            .for_each(|row| take(&row, &mut judge, &mut tape));
        take(row, &mut judge, &mut tape);
    }
    let mut recorded = tape.finish();
    let damage: Vec<String> = rows
        .damage_so_far()
        .into_iter()
        .map(|(_, damage)| damage)
        .chain([recorded.error])
        .filter(|clause| !clause.is_empty())
        .collect();
    recorded.error = damage.join("; ");
    recorded.not_drawn = rows.not_drawn();
    Ok(summary(
        robot,
        job,
        judge.verdict(),
        &rows.hashes(),
        recorded,
    ))
}
