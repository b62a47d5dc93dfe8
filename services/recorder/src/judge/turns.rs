//! Null-space turns of singular directions: planned and actual.

use shared_types::codes;
use shared_types::summary::TurnSummary;

use super::tick::Tick;

/// Follows each null-space turn from its announcement to its end.
#[derive(Debug, Default)]
pub(super) struct TurnMeter {
    turns: Vec<Turn>,
}

/// A null-space turn, followed while it lasts.
#[derive(Debug)]
struct Turn {
    summary: TurnSummary,
    q_start: Vec<f64>,
    /// `ControlState::planned` and the task segment: a segment announces one turn of a singularity.
    announced: (u32, u32),
    /// Whether the last command announced it.
    is_open: bool,
}

impl TurnMeter {
    /// Takes in a tick of an arm of `n` joints.
    pub(super) fn tick(&mut self, tick: &Tick<'_>, n: usize) {
        let command = tick.control;
        let place = (command.planned as usize).wrapping_sub(1);
        let announced = (command.planned, command.segment);
        let is_new = self
            .turns
            .last()
            .is_none_or(|turn| turn.announced != announced);
        if let Some(singularity) = tick.report.listed().get(place)
            && is_new
        {
            let summary = TurnSummary {
                tick: command.header.tick,
                singularity: codes::singularity_name(singularity.kind, place).to_owned(),
                planned: command.planned_dq[..n].to_vec(),
                planned_s: command.planned_s,
                ..TurnSummary::default()
            };
            self.turns.push(Turn {
                summary,
                q_start: tick.truth.q[..n].to_vec(),
                announced,
                is_open: true,
            });
        }
        if let Some(turn) = self.turns.last_mut() {
            // A command that only brings the arm to rest announces nothing; the turn goes on after it.
            let goes_on = command.planned != 0;
            if turn.is_open || goes_on {
                // In place: nothing is allocated per tick.
                turn.summary.actual.clear();
                turn.summary.actual.extend(
                    turn.q_start
                        .iter()
                        .zip(&tick.truth.q)
                        .map(|(from, to)| to - from),
                );
                turn.summary.actual_ticks = command.header.tick.saturating_sub(turn.summary.tick);
            }
            turn.is_open = goes_on;
        }
    }

    pub(super) fn finish(self) -> Vec<TurnSummary> {
        self.turns.into_iter().map(|turn| turn.summary).collect()
    }
}
