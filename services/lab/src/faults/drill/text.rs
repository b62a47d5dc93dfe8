//! The drill's cells as text for people.

use std::fmt;

use session::table::{number, table};
use viz::plot::digits;

use super::matrix::Drilled;

/// A row a cell, how many ended how, and whether a guarantee does not hold.
impl fmt::Display for Drilled {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let headings = [
            "process", "fault", "detected", "stale", "torque", "step", "mrad", "mm", "settled",
            "end", "again",
        ];
        let mut rows = table(&headings);
        for cell in &self.cells {
            let name = if cell.way.trim_matches([' ', '+']).is_empty() {
                cell.kind.clone()
            } else {
                format!("{} ({})", cell.kind, cell.way)
            };
            let end = match (cell.goal_reached, cell.safe_stop) {
                (true, _) => "goal",
                (false, true) => "rest",
                (false, false) => "ended",
            };
            let optional = |value: Option<f64>| value.map_or(String::from("–"), digits);
            rows.add_row([
                cell.process.clone().into(),
                name.into(),
                number(optional(cell.detected_ms)),
                number(cell.stale_ticks),
                number(format!("{:.0} %", cell.torque_max_ratio * 100.0)),
                number(format!("{:.1} %", cell.torque_step_max_ratio * 100.0)),
                number(digits(cell.excursion_max_rad * 1e3)),
                number(digits(cell.excursion_max_mm)),
                number(optional(cell.settled_ms)),
                end.into(),
                if cell.replayed_identically {
                    "same"
                } else {
                    "OTHER"
                }
                .into(),
            ]);
        }
        writeln!(f, "{rows}")?;
        writeln!(
            f,
            "stale: ticks without a fresh torque; torque, step: largest share of a limit, of a change in a tick;\n\
             mrad, mm: off the path, joints and hand; detected, settled: after so many ms;\n\
             again: whether a repetition has the same bytes; --json has more"
        )?;
        for cell in self
            .cells
            .iter()
            .filter(|cell| !cell.invariants_broken.is_empty())
        {
            writeln!(
                f,
                "{}, {} {}: {}",
                cell.process,
                cell.kind,
                cell.way,
                cell.invariants_broken.join("; ")
            )?;
        }
        let broken = self
            .cells
            .iter()
            .filter(|cell| !cell.invariants_broken.is_empty())
            .count();
        let goals = self.cells.iter().filter(|cell| cell.goal_reached).count();
        writeln!(
            f,
            "{} {}: {goals} reached the goal, {} came to rest or ended cleanly, {broken} broke a guarantee",
            self.cells.len(),
            if self.cells.len() == 1 {
                "cell"
            } else {
                "cells"
            },
            self.cells.len() - goals
        )?;
        if !self.passed {
            writeln!(
                f,
                "a guarantee does not hold: see the lines below the table"
            )?;
        }
        Ok(())
    }
}
