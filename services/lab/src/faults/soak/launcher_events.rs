//! Events that the launcher reports during a round.

use std::collections::VecDeque;

use launcher::{Event, Exit};
use runtime::now_ns;

/// Lines that processes wrote on their standard error, kept for a round with a broken guarantee.
const LINES: usize = 500;

/// The events of the launcher while the round went on.
#[derive(Default)]
pub(super) struct LauncherEvents {
    /// Runs that ended by design.
    pub ended: Vec<(String, Exit, u64)>,
    pub silenced: Vec<String>,
    /// Processes that ended rather than send a number that is not finite.
    pub refused: Vec<String>,
    pub lines: VecDeque<String>,
}

/// The words with which a process refuses to send its own result.
pub(super) const REFUSED: &str = "refused its own";

/// The recorder's words for a full volume.
pub(super) const RECORDING_ENDS: &str = "recording ends";

impl LauncherEvents {
    pub(super) fn take(&mut self, event: &Event<'_>) {
        let line = match event {
            Event::Line { process, line } => {
                // Said twice: in the log, and as the reason of its end.
                if line.contains(REFUSED) && line.starts_with("armplane:") {
                    self.refused.push((*process).to_owned());
                }
                format!("{process}: {line}")
            }
            Event::Silenced {
                process, silent, ..
            } => {
                self.silenced.push((*process).to_owned());
                format!(
                    "{process} has done nothing for {} ms and is killed",
                    silent.as_millis()
                )
            }
            Event::Restarted {
                process,
                exit,
                pid,
                incarnation,
            } => {
                self.ended.push(((*process).to_owned(), *exit, now_ns()));
                format!(
                    "{process} ended with {exit} and was started again (start {incarnation}, process {pid})"
                )
            }
            _ => return,
        };
        if self.lines.len() == LINES {
            self.lines.pop_front();
        }
        self.lines.push_back(line);
    }

    /// The last line that contains these words; empty where there is none.
    pub(super) fn words_on(&self, what: &str) -> String {
        self.lines
            .iter()
            .rfind(|line| line.contains(what))
            .cloned()
            .unwrap_or_default()
    }
}
