//! Null-space turns of singular directions: as planned, and as they went.

use serde::{Deserialize, Serialize};
use shared_types::codes;
use shared_types::summary::TurnSummary;

use super::tick::{Tick, active};

/// Follows each null-space turn from its announcement to its end.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct TurnMeter {
    turns: Vec<Turn>,
}

/// A null-space turn, followed while it lasts.
#[derive(Debug, Serialize, Deserialize)]
struct Turn {
    summary: TurnSummary,
    q_start: Vec<f64>,
    /// `ControlState::planned` while it lasts, and the task segment; 0 once it is over.
    planned: u32,
    segment: u32,
}

impl TurnMeter {
    /// Takes in a tick of an arm of `n` joints.
    pub(super) fn tick(&mut self, tick: &Tick<'_>, n: usize) {
        let command = tick.control;
        let place = (command.planned as usize).wrapping_sub(1);
        let going_on =
            self.turns.last().is_some_and(|turn| turn.planned != 0 && (turn.planned, turn.segment) == (command.planned, command.segment));
        if let Some(singularity) = active(tick.report).get(place)
            && !going_on
        {
            let summary = TurnSummary {
                tick: command.header.tick,
                singularity: codes::singularity_name(singularity.kind, place),
                planned_deg: command.planned_dq[..n].iter().map(|by| by.to_degrees()).collect(),
                planned_s: command.planned_s,
                ..TurnSummary::default()
            };
            let turn = Turn { summary, q_start: tick.truth.q[..n].to_vec(), planned: command.planned, segment: command.segment };
            self.turns.push(turn);
        }
        if let Some(turn) = self.turns.last_mut()
            && turn.planned != 0
        {
            // In place: nothing is allocated per tick.
            turn.summary.moved_deg.clear();
            turn.summary.moved_deg.extend(turn.q_start.iter().zip(&tick.truth.q).map(|(from, to)| (to - from).to_degrees()));
            turn.summary.took_ticks = command.header.tick.saturating_sub(turn.summary.tick);
            if command.planned == 0 {
                turn.planned = 0;
            }
        }
    }

    pub(super) fn finish(self) -> Vec<TurnSummary> {
        self.turns.into_iter().map(|turn| turn.summary).collect()
    }
}
