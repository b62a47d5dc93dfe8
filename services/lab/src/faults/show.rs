//! The cells of a drill as JSON and as a table.

use std::fmt;
use std::path::Path;

use serde::Serialize;
use session::Failure;
use session::table::{count as plural, number, table};
use shared_types::summary::FaultSummary;
use viz::digits;

use super::judge::{Broken, Cell};
use crate::text::optional;

/// All cells.
#[derive(Serialize)]
pub struct Drilled {
    /// Whether no cell broke a guarantee.
    pub passed: bool,
    /// In the order in which they were tried.
    pub cells: Vec<Cell>,
}

impl Drilled {
    /// Saves the cells.
    pub(super) fn new(cells: Vec<Cell>, out: Option<&Path>) -> Result<Self, Failure> {
        let passed = cells.iter().all(|cell| cell.broken.is_empty());
        let drilled = Self { passed, cells };
        if let Some(out) = out {
            let path = out.join("drill.json");
            let text = serde_json::to_vec_pretty(&drilled).map_err(Failure::work)?;
            files::write(&path, text).map_err(Failure::cannot("write", &path))?;
        }
        Ok(drilled)
    }
}

/// A fault's kind with its way.
fn kind(fault: &FaultSummary) -> String {
    match fault.plan.as_ref().filter(|_| fault.origin != "detected") {
        Some(plan) => plan
            .way
            .map_or(plan.kind.to_string(), |way| format!("{} {way}", plan.kind)),
        None => format!("{} (unplanned)", fault.kind),
    }
}

/// The processes and faults of a cell.
fn names(cell: &Cell) -> [String; 2] {
    let joined = |of: &dyn Fn(&FaultSummary) -> String| {
        cell.faults.iter().map(of).collect::<Vec<_>>().join(" + ")
    };
    [joined(&|fault| fault.process.clone()), joined(&kind)]
}

impl fmt::Display for Drilled {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write_cells(f)?;
        for (place, cell) in (1..).zip(&self.cells) {
            for Broken { check, detail } in &cell.broken {
                let [process, fault] = names(cell);
                writeln!(f, "BROKEN {place}, {process}, {fault}: {check}: {detail}")?;
            }
        }
        let count = |is: &dyn Fn(&Cell) -> bool| self.cells.iter().filter(|cell| is(cell)).count();
        let goal = count(&|cell| cell.goal_reached);
        writeln!(
            f,
            "{} with faults: {goal} reached the goal, {} came to rest or ended, {} broke a guarantee",
            plural(self.cells.len() as u64, "run"),
            self.cells.len() - goal,
            count(&|cell| !cell.broken.is_empty())
        )
    }
}

impl Drilled {
    /// A row for each cell.
    fn write_cells(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = |ratio: f64| number(format!("{:.1} %", ratio * 100.0));
        let mut rows = table(&[
            "process", "fault", "detected", "stale", "torque", "step", "speed", "mrad", "mm",
            "settled", "end",
        ]);
        for cell in &self.cells {
            let ([process, fault], motion) = (names(cell), &cell.motion);
            let excursion = cell.excursion.clone().unwrap_or_default();
            let detected = cell.faults.iter().filter_map(|fault| fault.detected_ms);
            rows.add_row([
                process.into(),
                fault.into(),
                number(optional(detected.reduce(f64::max), digits)),
                number(motion.stale_ticks),
                percent(motion.torque_max_ratio),
                percent(motion.torque_step_max_ratio),
                percent(motion.speed_max_ratio),
                number(digits(1e3 * excursion.excursion_max_rad)),
                number(digits(excursion.excursion_max_mm)),
                number(optional(excursion.settled_ms, digits)),
                cell.end.into(),
            ]);
        }
        writeln!(
            f,
            "{rows}\ndetected, settled: in ms; stale: age of the torque in force, in ticks; torque, step, speed: largest share of the limit; \
             mrad, mm: off the path, joints and end-effector, in lockstep; --json has more"
        )
    }
}
