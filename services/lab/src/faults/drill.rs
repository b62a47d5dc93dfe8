//! `armplane drill`: every fault on every process of a real graph.
//!
//! A fault is requested live, at a tick in the middle of the motion. In lockstep the run is then repeated from the plan that it left, and must give the
//! same bytes.

use std::path::Path;

use session::load::{self, Loaded};
use session::{Failure, Observer, Progress, Results};
use shared_types::fault::Fault;
use shared_types::job::Mode;
use shared_types::scenario::Scenario;
use shared_types::summary::Summary;

use super::judge::Cell;
use super::plan::{Only, grid};
use super::run::{Ran, Stage};
use super::show::Drilled;
use super::without::Without;
use crate::folder::Folder;

/// Time for a disturbed arm to return to its goal after the task; s.
const TIME_TO_RECOVER_S: f64 = 2.0;

/// The subject of a drill.
pub struct Request<'a> {
    /// Built-in scenarios' names, or scenario files.
    pub scenarios: &'a [String],
    /// One cell instead of all: `PROCESS:KIND`, or `PROCESS:KIND:WAY`.
    pub only: Option<&'a str>,
    /// How many pairs of faults.
    pub pairs: u32,
    /// Seed of every random number; the scenario's where it is `None`.
    pub seed: Option<u64>,
    /// Values that override those of the scenario.
    pub settings: &'a [String],
    /// The file of a process graph; the scenario's own, or the built-in one, where it is `None`.
    pub graph: Option<&'a Path>,
    /// Lockstep, or real time.
    pub mode: Mode,
    /// A protection that is left out, to show that the drill can fail.
    pub without: Option<Without>,
    /// Where the results go; nowhere where it is `None`.
    pub out: Option<&'a Path>,
}

/// Tries every fault on every process of a real graph.
///
/// # Errors
/// [`Failure`] where a scenario cannot be run, `only` is no cell, or a file cannot be written.
pub fn drill(request: &Request<'_>, observer: Observer<'_>) -> Result<Drilled, Failure> {
    let folder = Folder::create(request.out)?;
    let only = request
        .only
        .map(Only::parse)
        .transpose()
        .map_err(Failure::Input)?;
    let mut cells = Vec::new();
    for name in request.scenarios {
        drill_one(
            request,
            name,
            only.as_ref(),
            folder.path(),
            &mut cells,
            observer,
        )?;
    }
    Drilled::new(cells, request.out)
}

/// Tries every fault in one scenario.
fn drill_one(
    request: &Request<'_>,
    name: &str,
    only: Option<&Only>,
    folder: &Path,
    cells: &mut Vec<Cell>,
    observer: Observer<'_>,
) -> Result<(), Failure> {
    let Loaded {
        scenario,
        robot,
        graph,
    } = load::scenario_in(request.graph, name, request.settings, request.seed)?;
    let span = scenario.planned_ticks();
    let scenario = Scenario {
        fault: Vec::new(),
        // Where the task is over sooner than an arm can come back, the verdict waits.
        settle_s: scenario.settle_s.max(TIME_TO_RECOVER_S),
        ..scenario
    };
    let results = Results::within(folder, "run")?;
    let out = results.folder.clone();
    let mut job = load::job(&robot, scenario, graph, request.mode, out);
    if let Some(without) = request.without {
        without.leave_out(&mut job, &robot)?;
    }
    let stage = Stage {
        results,
        job,
        robot: &robot,
        without: request.without,
    };
    let (graph, seed) = (&stage.job.graph, stage.job.scenario.seed);
    let plans = grid(&robot, graph, seed, span, only, request.pairs);
    if let Some(only) = only.filter(|_| plans.is_empty()) {
        let (cell, remedy) = (request.only.unwrap_or_default(), only.remedy(graph));
        return Err(Failure::Input(format!(
            "`{cell}` does not exist for this graph and arm: {remedy}; see `armplane fault --list`"
        )));
    }
    observer(Progress::Begin {
        title: name,
        length: plans.len() as u64,
        unit: "cells",
    });
    let is_lockstep = request.mode == Mode::Lockstep;
    let base = is_lockstep.then(|| baseline(&stage, name)).transpose()?;
    for plan in plans {
        let title = plan.iter().map(Fault::to_string).collect::<Vec<_>>();
        observer(Progress::Title(&format!("{name}: {}", title.join(" and "))));
        cells.push(cell(&stage, &plan, base.as_ref())?);
        observer(Progress::Step);
    }
    observer(Progress::End);
    Ok(())
}

/// The run without a fault.
fn baseline(stage: &Stage<'_>, name: &str) -> Result<Ran, Failure> {
    let base = stage.run(Vec::new(), &[])?;
    let Summary {
        outcome, reason, ..
    } = &base.summary;
    if outcome == "goal reached" {
        return Ok(base);
    }
    Err(Failure::Work(format!(
        "{name} without a fault does not reach its goal ({outcome}: {reason}), so there is nothing to compare with"
    )))
}

fn cell(stage: &Stage<'_>, plan: &[Fault], base: Option<&Ran>) -> Result<Cell, Failure> {
    let ran = stage.run(Vec::new(), plan)?;
    let Some(base) = base else {
        return stage.judge(&ran, None);
    };
    let faults = ran.summary.faults.iter();
    let left = faults.filter_map(|fault| fault.plan.clone()).collect();
    stage.judge(&ran, Some((base, &stage.run(left, &[])?)))
}
