//! The cells of a drill or a soak as JSON and as tables.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use serde::Serialize;
use session::Failure;
use session::table::{Cell as TableCell, count as plural, number, table};
use shared_types::summary::FaultSummary;
use viz::digits;

use super::judge::{Broken, Cell};
use crate::text::quantile;

/// All cells.
#[derive(Serialize)]
pub struct Drilled {
    /// Whether no cell broke a guarantee.
    pub passed: bool,
    /// Seed of the rounds of a soak.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// The signal that ended it before its time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub interrupted: Option<&'static str>,
    /// By kind of fault.
    pub kinds: Vec<Kind>,
    /// In the order in which they were tried.
    pub cells: Vec<Cell>,
}

/// All faults of one kind.
#[derive(Serialize)]
pub struct Kind {
    /// Kind and way.
    pub kind: String,
    /// How often it came to pass.
    pub times: usize,
    /// Median and largest time to detection, ms.
    pub detected_ms: Option<[f64; 2]>,
    /// Median and largest time until a process that was down worked again, ms.
    pub recovered_ms: Option<[f64; 2]>,
}

impl Drilled {
    /// Adds the cells up, and saves them.
    pub(super) fn new(
        cells: Vec<Cell>,
        seed: Option<u64>,
        interrupted: Option<&'static str>,
        out: Option<&Path>,
    ) -> Result<Self, Failure> {
        let mut by_kind = BTreeMap::<String, Vec<&FaultSummary>>::new();
        for fault in cells
            .iter()
            .flat_map(|cell| &cell.faults)
            .filter(|fault| fault.occurred)
        {
            by_kind.entry(kind(fault)).or_default().push(fault);
        }
        let times = |faults: &[&FaultSummary], of: fn(&FaultSummary) -> Option<f64>| {
            let times: Vec<f64> = faults.iter().filter_map(|fault| of(fault)).collect();
            (!times.is_empty())
                .then(|| [0.5, 1.0].map(|share| quantile(times.iter().copied(), share)))
        };
        let kinds = by_kind.into_iter().map(|(kind, faults)| Kind {
            kind,
            times: faults.len(),
            detected_ms: times(&faults, |fault| fault.detected_ms),
            recovered_ms: times(&faults, |fault| fault.recovered_ms),
        });
        let passed = cells.iter().all(|cell| cell.broken.is_empty());
        let drilled = Self {
            passed,
            seed,
            interrupted,
            kinds: kinds.collect(),
            cells,
        };
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

/// The processes and faults of a cell: one or two, or how many.
fn names(cell: &Cell) -> [String; 2] {
    if cell.faults.len() > 2 {
        return [String::from("all"), format!("{} faults", cell.faults.len())];
    }
    let joined = |of: &dyn Fn(&FaultSummary) -> String| {
        cell.faults.iter().map(of).collect::<Vec<_>>().join(" + ")
    };
    [joined(&|fault| fault.process.clone()), joined(&kind)]
}

impl fmt::Display for Drilled {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write_cells(f)?;
        if let Some(seed) = self.seed {
            self.write_kinds(f, seed)?;
        }
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

fn optional(value: Option<f64>) -> TableCell {
    number(value.map_or(String::from("–"), digits))
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
            rows.add_row([
                process.into(),
                fault.into(),
                optional(
                    cell.faults
                        .iter()
                        .filter_map(|fault| fault.detected_ms)
                        .reduce(f64::max),
                ),
                number(motion.stale_ticks),
                percent(motion.torque_max_ratio),
                percent(motion.torque_step_max_ratio),
                percent(motion.speed_max_ratio),
                number(digits(1e3 * excursion.excursion_max_rad)),
                number(digits(excursion.excursion_max_mm)),
                optional(excursion.settled_ms),
                cell.end.into(),
            ]);
        }
        writeln!(
            f,
            "{rows}\ndetected, settled: in ms; stale: age of the torque in force, in ticks; torque, step, speed: largest share of the limit; \
             mrad, mm: off the path, joints and end-effector, in lockstep; --json has more"
        )
    }

    /// A row for each kind of fault, and the messages of all runs.
    fn write_kinds(&self, f: &mut fmt::Formatter<'_>, seed: u64) -> fmt::Result {
        let mut rows = table(&[
            "fault",
            "times",
            "detected, ms",
            "at most",
            "recovered, ms",
            "at most",
        ]);
        for kind in &self.kinds {
            let pair = |times: Option<[f64; 2]>| {
                [0, 1].map(|place| optional(times.map(|times| times[place])))
            };
            let times = [pair(kind.detected_ms), pair(kind.recovered_ms)].concat();
            rows.add_row(
                [kind.kind.as_str().into(), number(kind.times)]
                    .into_iter()
                    .chain(times),
            );
        }
        let sum = |of: fn(&Cell) -> u64| self.cells.iter().map(of).sum::<u64>();
        writeln!(
            f,
            "{rows}\nseed {seed}: {} faults, {} restarts; {} messages sent, {} refused as not finite, {} of dead incarnations, {} lost",
            sum(|cell| cell.faults.len() as u64),
            sum(|cell| u64::from(cell.restarts)),
            sum(|cell| cell.messages.sent),
            sum(|cell| cell.messages.refused),
            sum(|cell| cell.messages.fenced),
            sum(|cell| cell.messages.lost)
        )
    }
}
