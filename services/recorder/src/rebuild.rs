//! Rebuilds recording and results from a run's message log, if its launcher was killed.

use message_log::Contents;
use model::Robot;
use runtime::ProcessError;
use shared_types::job::Job;
use shared_types::summary::Summary;

use crate::assemble::Row;
use crate::judge::Tick;
use crate::message_rows::MessageRows;
use crate::tape::Tape;
use crate::{MESSAGES, judge, summary, take};

/// Writes the recording of a run again, and judges it, from the messages in its folder, to the last that is whole; a run that was killed before its first
/// message has no tick. The damage of a message log stands in the recorder's part of the summary, as its error.
///
/// # Errors
/// [`ProcessError`] if the messages cannot be read, or the recording cannot be written.
pub fn rebuild(robot: &Robot, job: &Job) -> Result<Summary, ProcessError> {
    let path = job.out.join(MESSAGES);
    let mut rows = MessageRows::open_left(&path, job).map_err(ProcessError::setup)?;
    let mut judge = judge(robot, job)?;
    let mut tape = Tape::start(robot, job)?;
    // The messages of the topics end at different ticks: rows after the last whole one are left out.
    let mut partial: Vec<Row> = Vec::new();
    while let Some(row) = rows.next_row() {
        if Tick::of(&row.messages().lent()).is_none() {
            partial.push(*row);
            continue;
        }
        partial
            .drain(..)
            .for_each(|row| take(&row, &mut judge, &mut tape));
        take(&row, &mut judge, &mut tape);
    }
    let mut recorded = tape.finish();
    let damage: Vec<String> = rows
        .damage_so_far()
        .into_iter()
        .chain([recorded.error])
        .filter(|clause| !clause.is_empty())
        .collect();
    recorded.error = damage.join("; ");
    let (account, not_drawn) = rows.account();
    recorded.not_drawn = not_drawn;
    // Others shall read it, too.
    match message_log::complete(&path, &Contents::of(job)) {
        Err(error) if damage.is_empty() && !error.is_before_the_first_message() => {
            return Err(ProcessError::setup(error));
        }
        _ => {}
    }
    Ok(summary(job, judge, &account, recorded))
}
