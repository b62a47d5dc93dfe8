//! `armplane drill`: every fault on every process of a real graph, judged by the physics.
//!
//! A fault is requested live, at a tick in the middle of the motion; then the run is repeated from the plan that it left, and must give the same
//! bytes. What the arm did is measured on the simulator's truth, against the same scenario without a fault.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::ExitCode;

use indicatif::{ProgressBar, ProgressStyle};
use launcher::End;
use message_log::LogReader;
use model::Robot;
use runtime::{ControlPage, RunDir, random};
use serde::Serialize;
use shared_types::codes::{DRIVE_ACTIVE, DRIVE_BRAKED};
use shared_types::fault::{Fault, Kind, ScheduledFault, Way};
use shared_types::job::{Job, Mode};
use shared_types::scenario::Scenario;
use shared_types::summary::{Summary, TopicSummary};
use shared_types::{MAX_DOF, Message, PlantState, SensorSample};

use super::failure::Failure;
use super::out::say;
use super::physics::{Motion, Promise, SPEED_MARGIN};
use super::plot::{Axis, Color, Page, Panel, Row};
use super::table::{digits, number, table};
use super::verify::Folder;
use super::{DrillArgs, load, run};

/// One cell of the matrix.
#[derive(Clone, Debug, Default, Serialize)]
struct Cell {
    scenario: String,
    process: String,
    kind: String,
    /// In which way, for the kinds that have several.
    #[serde(rename = "as", skip_serializing_if = "String::is_empty")]
    way: String,
    /// What was done, in words.
    faults: Vec<String>,
    at_tick: u64,
    /// Wall-clock time until something noticed.
    detected_ms: Option<f64>,
    /// Longest age of a torque in force, in ticks.
    stale_ticks: u32,
    torque_max_ratio: f64,
    speed_max_ratio: f64,
    /// Largest change of applied torque in one tick.
    torque_step_max_ratio: f64,
    /// Largest distance in joint space from the path of the run without a fault.
    excursion_max_rad: f64,
    /// From the fault to the first tick of fresh torque after the drives had taken over, or to rest; null where they never had to.
    settled_ms: Option<f64>,
    /// The drives follow the controller again, or never had to stop.
    recovered: bool,
    goal_reached: bool,
    /// At rest, or held by the brakes, at the end.
    safe_stop: bool,
    restarts: u32,
    messages_lost: u64,
    replayed_identically: bool,
    invariants_broken: Vec<String>,
    left_behind: Vec<String>,
}

/// What a run left that the physics can be judged by.
struct Ran {
    summary: Summary,
    topics: BTreeMap<String, TopicSummary>,
    end: End,
    truth: Vec<PlantState>,
    samples: Vec<SensorSample>,
    left_behind: Vec<String>,
}

/// An arm that was led astray is given this time to come back after its task; s.
const TIME_TO_RECOVER_S: f64 = 2.0;

/// What to do to which process; two of them for a pair.
type Plan = Vec<Fault>;

pub(crate) fn drill(args: &DrillArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let folder = Folder::create(args.out.as_deref())?;
    let only = args.only.as_deref().map(Only::parse).transpose().map_err(Failure::Input)?;
    let (mut cells, mut runs) = (Vec::new(), 0);
    for name in &args.scenario {
        let load::Loaded { scenario, robot } = load::scenario(name, &args.set, args.seed)?;
        let drill = Drill::new(&scenario, &robot, folder.path())?;
        let plans = plans(&drill, only.as_ref(), args.pairs);
        if plans.is_empty() {
            return Err(Failure::Input(format!("`{}` is no cell: see `armplane fault --list`", args.only.as_deref().unwrap_or_default())));
        }
        let bar = progress_bar(plans.len() as u64, name);
        let base = drill.run(&drill.job.scenario, &[], true)?;
        runs += 1 + 2 * plans.len();
        for plan in plans {
            bar.set_message(format!("{name}: {}", titles(&plan)));
            cells.push(drill.cell(&plan, &base)?);
            bar.inc(1);
        }
        bar.finish_and_clear();
    }
    let passed = cells.iter().all(|cell: &Cell| cell.invariants_broken.is_empty());
    let machine = serde_json::json!({ "passed": passed, "runs": runs, "cells": cells });
    let text = serde_json::to_string_pretty(&machine).map_err(Failure::work)?;
    if let Some(out) = &args.out {
        let path = out.join("drill.json");
        std::fs::write(&path, &text).map_err(|error| Failure::Work(format!("cannot write {}: {error}", path.display())))?;
        picture(&cells).save(&out.join("drill")).map_err(Failure::work)?;
    }
    if as_json {
        say!("{text}");
    } else {
        tell(&cells, passed, args.out.as_deref());
    }
    Ok(if passed { ExitCode::SUCCESS } else { ExitCode::from(1) })
}

/// One cell: `PROCESS:KIND`, or `PROCESS:KIND:WAY`.
struct Only {
    process: String,
    kind: Kind,
    way: Option<Way>,
}

impl Only {
    fn parse(text: &str) -> Result<Self, String> {
        let wrong = |reason: String| format!("--only {text}: {reason}");
        let mut parts = text.split(':');
        let (Some(process), Some(kind), way, None) = (parts.next(), parts.next(), parts.next(), parts.next()) else {
            return Err(wrong("give PROCESS:KIND, or PROCESS:KIND:WAY".to_owned()));
        };
        let kind: Kind = kind.parse().map_err(wrong)?;
        if !kind.processes().contains(&process) {
            return Err(wrong(format!("`{kind}` can happen to {}", kind.processes().join(", "))));
        }
        Ok(Self { process: process.to_owned(), kind, way: way.map(str::parse).transpose().map_err(wrong)? })
    }

    fn takes(&self, fault: &Fault) -> bool {
        fault.process == self.process && fault.kind == self.kind && (self.way.is_none() || fault.way == self.way)
    }
}

/// Every kind in every way for every process, and a seeded sample of pairs of them.
fn plans(drill: &Drill<'_>, only: Option<&Only>, pairs: u32) -> Vec<Plan> {
    let mut singles = Vec::new();
    for process in drill.job.graph.process.iter().map(|process| process.name.as_str()) {
        for &kind in Kind::ALL.iter().filter(|kind| kind.processes().contains(&process)) {
            let ways: Vec<_> = kind.ways().map(Some).collect();
            for way in if ways.is_empty() { vec![None] } else { ways } {
                singles.push(Fault { way, ..Fault::new(process, kind) });
            }
        }
    }
    let seed = drill.job.scenario.seed;
    let draw = |index: u64, what: u64| random(seed ^ 0xd411, 16 * index + what);
    let span = drill.span;
    let placed = |fault: &Fault, index: u64, what: u64| {
        // In the middle of the motion, each at another place.
        let at = span / 4 + draw(index, what) % (span / 2).max(1);
        let needs_joint = matches!(fault.kind, Kind::Sensor | Kind::Drive);
        let joint = needs_joint.then(|| 1 + (draw(index, what + 1) % drill.robot.dof() as u64) as u32);
        Fault { at_tick: Some(at), joint, ..fault.clone() }
    };
    if let Some(only) = only {
        let chosen = singles.iter().enumerate().filter(|(_, fault)| only.takes(fault));
        return chosen.map(|(index, fault)| vec![placed(fault, index as u64, 0)]).collect();
    }
    let single = singles.iter().enumerate().map(|(index, fault)| vec![placed(fault, index as u64, 0)]);
    let pair = (0..u64::from(pairs)).map(|index| {
        let index = index + singles.len() as u64;
        let pick = |what: u64| &singles[(draw(index, what) % singles.len() as u64) as usize];
        let first = placed(pick(2), index, 4);
        // Close enough to meet.
        let second = Fault { at_tick: first.at_tick.map(|at| at + draw(index, 6) % 60), ..placed(pick(3), index, 8) };
        vec![first, second]
    });
    single.chain(pair).collect()
}

/// The graph, the scenario without faults, and where runs leave their messages.
struct Drill<'a> {
    job: Job,
    robot: &'a Robot,
    /// Ticks of the task, in the middle of which faults strike.
    span: u64,
    folder: &'a Path,
}

impl<'a> Drill<'a> {
    fn new(scenario: &Scenario, robot: &'a Robot, folder: &'a Path) -> Result<Self, Failure> {
        let span = scenario.planned_ticks();
        // Where the task is over sooner than an arm can come back, the verdict waits.
        let scenario = Scenario { fault: Vec::new(), settle_s: scenario.settle_s.max(TIME_TO_RECOVER_S), ..scenario.clone() };
        let job = load::job(robot, scenario, load::graph(None)?, Mode::Lockstep, folder.join("run"));
        Ok(Self { job, robot, span, folder })
    }

    fn strike(&self, fault: &Fault, seed: u64) -> Result<ScheduledFault, Failure> {
        let place = self.job.graph.process.iter().position(|process| process.name == fault.process).unwrap_or_default();
        fault.schedule(place as u32, self.job.scenario.rate_hz, seed).map_err(|complaint| Failure::Input(complaint.to_string()))
    }

    fn cell(&self, plan: &Plan, base: &Ran) -> Result<Cell, Failure> {
        let live = plan.iter().enumerate().map(|(i, fault)| self.strike(fault, random(self.job.scenario.seed, i as u64)));
        // The picture costs time, and only the recorder's faults concern it.
        let records = plan.iter().any(|fault| fault.process == "recorder");
        let ran = self.run(&self.job.scenario, &live.collect::<Result<Vec<_>, _>>()?, records)?;
        let planned = ran.summary.faults.iter().filter_map(|fault| fault.fault.clone()).collect();
        let again = self.run(&Scenario { fault: planned, ..self.job.scenario.clone() }, &[], records)?;
        Ok(self.judge(plan, base, &ran, &again))
    }

    /// Runs the scenario in its processes.
    fn run(&self, scenario: &Scenario, live: &[ScheduledFault], records: bool) -> Result<Ran, Failure> {
        // What an earlier run left there must not be taken for this one's.
        let _ = std::fs::remove_dir_all(&self.job.out);
        let cannot = |error: std::io::Error| Failure::Work(format!("cannot write to {}: {error}", self.folder.display()));
        std::fs::create_dir_all(&self.job.out).map_err(cannot)?;
        let job = Job { scenario: scenario.clone(), record: records, ..self.job.clone() };
        // As `armplane fault` would request them, before the first tick.
        let mut begin = |run: &RunDir| {
            let control_page = ControlPage::open(run).map_err(Failure::work)?;
            match live.iter().any(|strike| control_page.fault_table().request(strike).is_none()) {
                true => Err(Failure::Work(format!("a run has room for {} faults", runtime::MOST_FAULTS))),
                false => Ok(()),
            }
        };
        let (outcome, account) = run::launch_quietly(&job, run::plan(&job)?, &mut begin, &mut |_| {})?;
        if let End::Interrupted { signal } = &outcome.end {
            return Err(Failure::Work(format!("stopped by {signal}")));
        }
        let own = format!("-{}-", std::process::id());
        let left_behind = RunDir::list().into_iter().map(|run| run.name).filter(|name| name.contains(&own)).collect();
        let summary = run::summarise(&job, &outcome, account);
        let messages = self.job.out.join(recorder::MESSAGES);
        // A full volume ends the messages early, and they are whole up to there.
        let truth = LogReader::open(&messages).map(whole).unwrap_or_default();
        let samples = LogReader::open(&messages).map(whole).unwrap_or_default();
        let topics = summary.topics.clone();
        Ok(Ran { summary, topics, end: outcome.end, truth, samples, left_behind })
    }

    fn judge(&self, plan: &Plan, base: &Ran, ran: &Ran, again: &Ran) -> Cell {
        let joined = |of: &dyn Fn(&Fault) -> String| plan.iter().map(of).collect::<Vec<_>>().join(" + ");
        let at_tick = plan.iter().filter_map(|fault| fault.at_tick).min().unwrap_or_default();
        // Where the messages end early and the topics are the fault-free ones, the arm did what it did without a fault.
        let is_base = !base.topics.is_empty() && ran.topics == base.topics;
        let truth = if is_base { &base.truth } else { &ran.truth };
        let mut motion = Motion::new(Promise::new(
            self.robot,
            &self.job.scenario,
            SPEED_MARGIN,
            ran.summary.faults.iter().filter_map(|one| one.fault.as_ref()),
        ));
        truth.iter().for_each(|state| motion.add(state));
        ran.samples.iter().for_each(|sample| motion.add_age(sample));
        let mut cell = Cell {
            scenario: self.job.scenario.name.clone(),
            process: joined(&|fault| fault.process.clone()),
            kind: joined(&|fault| fault.kind.name().to_owned()),
            way: joined(&|fault| fault.way.map(|way| way.name().to_owned()).unwrap_or_default()),
            faults: plan.iter().map(ToString::to_string).collect(),
            at_tick,
            detected_ms: ran.summary.faults.iter().filter_map(|fault| fault.detected_ms).reduce(f64::max),
            stale_ticks: motion.stale_ticks,
            torque_max_ratio: motion.torque_max_ratio,
            speed_max_ratio: motion.speed_max_ratio,
            torque_step_max_ratio: motion.torque_step_max_ratio,
            excursion_max_rad: excursion(&base.truth, truth),
            settled_ms: settled(truth, at_tick).map(|ticks| ticks as f64 * 1e3 / f64::from(self.job.scenario.rate_hz)),
            restarts: ran.summary.processes.iter().map(|process| process.restarts).sum(),
            messages_lost: ran.summary.recorder.lost,
            replayed_identically: ran.topics == again.topics && ran.summary.ticks == again.summary.ticks,
            left_behind: ran.left_behind.iter().chain(&again.left_behind).cloned().collect(),
            ..Cell::default()
        };
        let last = truth.last();
        let ends_world = plan.iter().any(ends_world);
        let (task, goal) = (&ran.summary.task, &self.job.scenario.goal);
        cell.goal_reached =
            ran.summary.completed && task.final_position_mm <= goal.position_mm && task.final_orientation_deg <= goal.orientation_deg;
        cell.recovered = ran.end == End::Completed && last.is_some_and(|state| state.drive == DRIVE_ACTIVE);
        cell.safe_stop = motion.is_at_rest();
        cell.invariants_broken = motion.broken();
        let mut broken = |is_broken: bool, what: String| {
            if is_broken {
                cell.invariants_broken.push(what);
            }
        };
        let (goal_reached, safe_stop) = (cell.goal_reached, cell.safe_stop);
        broken(!goal_reached && !safe_stop && !ends_world, "neither the goal nor rest at the end".to_owned());
        broken(ends_world && !matches!(ran.end, End::Failed(_)), "the end of the plant did not end the run".to_owned());
        let failed = match &ran.end {
            End::Failed(failure) if !ends_world => failure.to_string().lines().next().map(ToOwned::to_owned),
            _ => None,
        };
        broken(failed.is_some(), format!("the run failed: {}", failed.unwrap_or_default()));
        let lost = cell.messages_lost;
        broken(lost > 0, format!("{lost} messages lost by the recorder in lockstep"));
        broken(!cell.replayed_identically, "the saved plan gives other bytes".to_owned());
        let left = cell.left_behind.join(", ");
        broken(!left.is_empty(), format!("left in shared memory: {left}"));
        cell
    }
}

/// All messages of a topic, to the last whole block.
fn whole<M: Message>(mut kept: LogReader<M>) -> Vec<M> {
    std::iter::from_fn(|| kept.next_message().ok().flatten()).collect()
}

/// Whether a fault takes the simulated world with it: then the run ends, cleanly, and there is no arm to be judged any more.
fn ends_world(fault: &Fault) -> bool {
    let is_end = match fault.kind {
        Kind::Kill | Kind::Crash => true,
        Kind::Hang => fault.way == Some(Way::ForEver),
        _ => false,
    };
    fault.process == "plant" && is_end
}

/// Largest distance in joint space from the base's path; rad. Not the time lost on it: each posture is compared with those that the base had
/// taken by then, back to the one that matched last.
fn excursion(base: &[PlantState], truth: &[PlantState]) -> f64 {
    let apart = |a: &PlantState, b: &PlantState| (0..MAX_DOF).fold(0.0_f64, |most, i| most.max((a.q[i] - b.q[i]).abs()));
    let (mut most, mut from) = (0.0_f64, 0);
    for state in truth {
        let to = (state.header.tick as usize).min(base.len().saturating_sub(1));
        let nearest = (from.min(to)..=to).filter_map(|k| Some((k, apart(state, base.get(k)?))));
        let Some((k, distance)) = nearest.min_by(|a, b| a.1.total_cmp(&b.1)) else { continue };
        (most, from) = (most.max(distance), k);
    }
    most
}

/// Ticks from the fault until the drives follow the controller again, or have braked for good; `None` where they never left it.
fn settled(truth: &[PlantState], at_tick: u64) -> Option<u64> {
    let after = || truth.iter().filter(|state| state.header.tick >= at_tick);
    let last = after().filter(|state| state.drive != DRIVE_ACTIVE).map(|state| state.header.tick).next_back()?;
    let is_back = after().any(|state| state.header.tick > last);
    let rest = || after().find(|state| state.drive == DRIVE_BRAKED).map(|state| state.header.tick);
    Some(if is_back { last + 1 } else { rest().unwrap_or(last) } - at_tick)
}

fn titles(plan: &Plan) -> String {
    plan.iter().map(title).collect::<Vec<_>>().join(" and ")
}

fn title(fault: &Fault) -> String {
    match fault.way {
        Some(way) => format!("{} {} ({way})", fault.process, fault.kind),
        None => format!("{} {}", fault.process, fault.kind),
    }
}

fn progress_bar(cells: u64, name: &str) -> ProgressBar {
    let style = ProgressStyle::with_template("{wide_bar:.cyan/dim} {pos}/{len} cells  {eta}  {msg}");
    let bar = ProgressBar::new(cells).with_message(name.to_owned());
    style.map_or(bar.clone(), |style| bar.with_style(style))
}

fn tell(cells: &[Cell], passed: bool, out: Option<&Path>) {
    let headings = [
        "process",
        "fault",
        "noticed, ms",
        "stale",
        "torque",
        "speed",
        "step",
        "off path, mrad",
        "back after, ms",
        "end",
        "starts",
        "lost",
        "again",
        "",
    ];
    let mut rows = table(&headings);
    for cell in cells {
        let name = if cell.way.trim_matches([' ', '+']).is_empty() { cell.kind.clone() } else { format!("{} ({})", cell.kind, cell.way) };
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
            number(format!("{:.0} %", cell.speed_max_ratio * 100.0)),
            number(format!("{:.1} %", cell.torque_step_max_ratio * 100.0)),
            number(digits(cell.excursion_max_rad * 1e3)),
            number(optional(cell.settled_ms)),
            end.into(),
            number(cell.restarts),
            number(cell.messages_lost),
            if cell.replayed_identically { "same" } else { "OTHER" }.into(),
            cell.invariants_broken.join("; ").into(),
        ]);
    }
    say!("{rows}");
    let broken = cells.iter().filter(|cell| !cell.invariants_broken.is_empty()).count();
    let goals = cells.iter().filter(|cell| cell.goal_reached).count();
    say!(
        "{} cells: {goals} reached the goal, {} came to rest or ended cleanly, {broken} broke an invariant",
        cells.len(),
        cells.len() - goals
    );
    if let Some(out) = out {
        say!("{}/drill.json, drill.svg, drill.png", out.display());
    }
    if !passed {
        say!("a promise is broken: see the last column");
    }
}

/// White to blue by the size of a value on a logarithmic scale; red where an invariant is broken.
fn shade(value: f64, range: std::ops::Range<f64>, is_broken: bool) -> Color {
    use super::plot::{BLUE, RED};
    if is_broken {
        return RED;
    }
    let share = ((value.max(1e-12) / range.start).ln() / (range.end / range.start).ln()).clamp(0.0, 1.0);
    let mix = |c: u8| (248.0 + (f64::from(c) - 248.0) * share) as u8;
    Color { 0: mix(BLUE.0), 1: mix(BLUE.1), 2: mix(BLUE.2), 3: 1.0 }
}

/// Two maps, faults downwards and processes to the right: how far the arm left its path, and how quickly something noticed.
fn picture(cells: &[Cell]) -> Page {
    let singles: Vec<&Cell> = cells.iter().filter(|cell| cell.faults.len() == 1).collect();
    let (mut processes, mut faults) = (Vec::<String>::new(), Vec::<String>::new());
    let name = |cell: &Cell| if cell.way.is_empty() { cell.kind.clone() } else { format!("{} {}", cell.kind, cell.way) };
    for cell in &singles {
        for (names, name) in [(&mut processes, cell.process.clone()), (&mut faults, name(cell))] {
            if !names.contains(&name) {
                names.push(name);
            }
        }
    }
    let place = |title: &str, value: &dyn Fn(&Cell) -> Option<f64>, range: std::ops::Range<f64>| {
        let mut panel = Panel::new(title, Axis::names(processes.clone()), Axis::names(faults.clone()));
        for cell in &singles {
            let column = processes.iter().position(|process| *process == cell.process).unwrap_or_default();
            let row = faults.iter().position(|fault| *fault == name(cell)).unwrap_or_default();
            let value = value(cell);
            let color = shade(value.unwrap_or(0.0), range.clone(), !cell.invariants_broken.is_empty());
            panel.cell(column, row, color, value.map_or("–".to_owned(), digits));
        }
        panel
    };
    let off_path = place("largest distance from the fault-free path, mrad", &|cell| Some(cell.excursion_max_rad * 1e3), 0.01..100.0);
    let noticed = place("time until something noticed, ms", &|cell| cell.detected_ms, 0.01..1000.0);
    let broken = cells.iter().filter(|cell| !cell.invariants_broken.is_empty()).count();
    let scenarios: std::collections::BTreeSet<_> = cells.iter().map(|cell| cell.scenario.as_str()).collect();
    Page {
        title: "What each fault does".to_owned(),
        subtitle: format!(
            "{}: {} cells, {broken} with a broken invariant (red); lockstep, each repeated from its saved plan",
            scenarios.into_iter().collect::<Vec<_>>().join(", "),
            cells.len()
        ),
        rows: vec![Row::of(80.0 + 19.0 * faults.len() as f64, [off_path, noticed])],
        width: 1100.0,
        ..Page::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::codes::DRIVE_HOLDING;

    fn state(tick: u64, q: f64, drive: u32) -> PlantState {
        let mut state = PlantState { drive, ..PlantState::default() };
        (state.header.tick, state.q[0]) = (tick, q);
        state
    }

    #[test]
    fn time_lost_is_no_excursion_and_a_detour_is() {
        let base: Vec<_> = (0..100).map(|k| state(k, k as f64, DRIVE_ACTIVE)).collect();
        // Ten ticks late from tick 50 on.
        let late: Vec<_> = (0..110).map(|k| state(k, if k < 50 { k as f64 } else { (k - 10).max(50) as f64 }, DRIVE_ACTIVE)).collect();
        assert_eq!(excursion(&base, &late), 0.0);
        let detour: Vec<_> = (0..100).map(|k| state(k, if k == 99 { 102.5 } else { k as f64 }, DRIVE_ACTIVE)).collect();
        assert_eq!(excursion(&base, &detour), 3.5);
    }

    #[test]
    fn it_is_settled_when_the_drives_follow_again_or_brake() {
        let of = |drives: &[u32]| drives.iter().enumerate().map(|(k, drive)| state(k as u64, 0.0, *drive)).collect::<Vec<_>>();
        assert_eq!(settled(&of(&[DRIVE_ACTIVE; 5]), 2), None);
        assert_eq!(settled(&of(&[DRIVE_ACTIVE, DRIVE_ACTIVE, DRIVE_HOLDING, DRIVE_HOLDING, DRIVE_ACTIVE]), 1), Some(3));
        assert_eq!(settled(&of(&[DRIVE_ACTIVE, DRIVE_HOLDING, DRIVE_BRAKED, DRIVE_BRAKED]), 1), Some(1));
    }

    #[test]
    fn a_cell_is_named_by_process_kind_and_way() {
        let only = Only::parse("plant:sensor:drift").unwrap();
        assert!(only.takes(&Fault { way: Some(Way::Drift), ..Fault::new("plant", Kind::Sensor) }));
        assert!(!only.takes(&Fault { way: Some(Way::Bias), ..Fault::new("plant", Kind::Sensor) }));
        let wrong = |text: &str| Only::parse(text).err().unwrap_or_default();
        assert!(wrong("recorder:drop").contains("can happen to plant"));
        assert!(wrong("recorder").contains("PROCESS:KIND"));
    }
}
