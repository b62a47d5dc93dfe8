//! `armplane drill`: every fault on every process of a real graph, judged by the physics.
//!
//! A fault is requested live, at a tick in the middle of the motion; then the run is repeated from the plan that it left, and must give the same
//! bytes. The arm's motion is measured on the simulator's truth, against the same scenario without a fault.

use std::collections::BTreeMap;
use std::path::Path;

use launcher::End;
use message_log::LogReader;
use model::Robot;
use runtime::{ControlPage, RunDir, random};
use serde_json::{Value, json};
use session::{Failure, Observer, Progress, load};
use shared_types::codes::{DRIVE_ACTIVE, DRIVE_BRAKED};
use shared_types::fault::{Fault, Kind, ScheduledFault};
use shared_types::graph::Graph;
use shared_types::job::{Job, Mode};
use shared_types::process::Program;
use shared_types::scenario::Scenario;
use shared_types::summary::{Summary, TopicSummary};
use shared_types::{MAX_DOF, Message, PlantState, SensorSample};

use super::super::motion::{Guarantee, Motion, SPEED_MARGIN};
use super::cell::Cell;
use super::fall::fall;
use super::limits::{self, Excursion};
use super::misled::misled;
use super::picture::picture;
use super::plan::{Only, Plan, Terms, plans};
use super::without::Without;
use crate::folder::Folder;

/// The part of a run from which the physics is judged.
struct Ran {
    summary: Summary,
    topics: BTreeMap<String, TopicSummary>,
    end: End,
    truth: Vec<PlantState>,
    samples: Vec<SensorSample>,
    left_behind: Vec<String>,
}

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
    /// A protection that is left out, to show that the drill can fail.
    pub without: Option<Without>,
    /// Where `drill.json` and the heat map go; nowhere where it is `None`.
    pub out: Option<&'a Path>,
}

/// A drill's cells.
pub struct Drilled {
    /// In the order in which they were tried.
    pub cells: Vec<Cell>,
    /// Whether no cell broke a guarantee.
    pub passed: bool,
    /// All of it, for machines.
    pub json: Value,
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
    let (mut cells, mut runs) = (Vec::new(), 0);
    for name in request.scenarios {
        let load::Loaded {
            scenario,
            robot,
            graph,
        } = load::scenario_in(request.graph, name, request.settings, request.seed)?;
        let drill = Drill::new(&scenario, &robot, graph, request.without, folder.path())?;
        let terms = Terms {
            graph: &drill.job.graph,
            seed: drill.job.scenario.seed,
            span: drill.span,
            robot: &robot,
        };
        let plans = plans(&terms, only.as_ref(), request.pairs);
        if let Some(only) = only.as_ref().filter(|_| plans.is_empty()) {
            let cell = request.only.unwrap_or_default();
            return Err(Failure::Input(format!(
                "`{cell}` is no cell of this graph and arm: {}; see `armplane fault --list`",
                only.remedy(terms.graph)
            )));
        }
        observer(Progress::Begin {
            title: name,
            length: plans.len() as u64,
            unit: "cells",
        });
        let base = drill.run(&drill.job.scenario, &[], true)?;
        if base.summary.outcome != "goal reached" {
            let outcome = format!("{}: {}", base.summary.outcome, base.summary.reason);
            return Err(Failure::Work(format!(
                "{name} without a fault does not reach its goal ({outcome}): there is nothing to judge by"
            )));
        }
        runs += 1 + 2 * plans.len();
        for plan in plans {
            observer(Progress::Title(&format!("{name}: {}", titles(&plan))));
            cells.push(drill.cell(&plan, &base)?);
            observer(Progress::Step);
        }
        observer(Progress::End);
    }
    let passed = cells
        .iter()
        .all(|cell: &Cell| cell.invariants_broken.is_empty());
    let json = json!({ "passed": passed, "runs": runs, "cells": cells });
    if let Some(out) = request.out {
        let path = out.join("drill.json");
        let text = serde_json::to_string_pretty(&json).map_err(Failure::work)?;
        std::fs::write(&path, text)
            .map_err(|error| Failure::Work(format!("cannot write {}: {error}", path.display())))?;
        picture(&cells)
            .save(&out.join("drill"))
            .map_err(Failure::work)?;
    }
    Ok(Drilled {
        cells,
        passed,
        json,
    })
}

/// The graph, the scenario without faults, and where runs leave their messages.
struct Drill<'a> {
    job: Job,
    robot: &'a Robot,
    without: Option<Without>,
    /// Ticks of the task, in the middle of which faults are injected.
    span: u64,
    folder: &'a Path,
}

impl<'a> Drill<'a> {
    fn new(
        scenario: &Scenario,
        robot: &'a Robot,
        graph: Graph,
        without: Option<Without>,
        folder: &'a Path,
    ) -> Result<Self, Failure> {
        let span = scenario.planned_ticks();
        // Where the task is over sooner than an arm can come back, the verdict waits.
        let scenario = Scenario {
            fault: Vec::new(),
            settle_s: scenario.settle_s.max(TIME_TO_RECOVER_S),
            ..scenario.clone()
        };
        let mut job = load::job(robot, scenario, graph, Mode::Lockstep, folder.join("run"));
        without
            .iter()
            .try_for_each(|without| without.leave_out(&mut job))?;
        Ok(Self {
            job,
            robot,
            without,
            span,
            folder,
        })
    }

    fn scheduled(&self, fault: &Fault, seed: u64) -> Result<ScheduledFault, Failure> {
        let target = self.job.graph.target(&fault.process);
        let target = target.ok_or_else(|| {
            Failure::Input(format!("the graph has no process `{}`", fault.process))
        })?;
        fault
            .schedule(&target, self.job.scenario.rate_hz, seed)
            .map_err(|complaint| Failure::Input(complaint.to_string()))
    }

    fn cell(&self, plan: &Plan, base: &Ran) -> Result<Cell, Failure> {
        let live = plan
            .iter()
            .enumerate()
            .map(|(i, fault)| self.scheduled(fault, random(self.job.scenario.seed, i as u64)));
        // The picture costs time, and only the recorder's faults concern it.
        let records = plan
            .iter()
            .any(|fault| fault.process == Program::Recorder.name());
        let ran = self.run(
            &self.job.scenario,
            &live.collect::<Result<Vec<_>, _>>()?,
            records,
        )?;
        let planned = ran
            .summary
            .faults
            .iter()
            .filter_map(|fault| fault.plan.clone())
            .collect();
        let again = self.run(
            &Scenario {
                fault: planned,
                ..self.job.scenario.clone()
            },
            &[],
            records,
        )?;
        self.judge(plan, base, &ran, &again)
    }

    /// Runs the scenario in its processes.
    fn run(
        &self,
        scenario: &Scenario,
        live: &[ScheduledFault],
        records: bool,
    ) -> Result<Ran, Failure> {
        // Files of an earlier run must not be taken for this one's.
        let _ = std::fs::remove_dir_all(&self.job.out);
        let cannot = |error: std::io::Error| {
            Failure::Work(format!(
                "cannot write to {}: {error}",
                self.folder.display()
            ))
        };
        std::fs::create_dir_all(&self.job.out).map_err(cannot)?;
        let job = Job {
            scenario: scenario.clone(),
            record: records,
            ..self.job.clone()
        };
        // As `armplane fault` would request them, before the first tick.
        let mut begin = |run: &RunDir| {
            let control_page = ControlPage::open(run).map_err(Failure::work)?;
            match live
                .iter()
                .any(|scheduled| control_page.fault_table().request(scheduled).is_none())
            {
                true => Err(Failure::Work(format!(
                    "a run has room for {} faults",
                    runtime::MOST_WHEN_REQUESTED
                ))),
                false => Ok(()),
            }
        };
        let mut processes = session::plan(&job)?;
        self.without
            .iter()
            .for_each(|without| without.leave_out_of(&mut processes));
        let (outcome, account) = session::launch_watched(&job, processes, &mut begin, &mut |_| {})?;
        if let End::Interrupted { signal } = &outcome.end {
            return Err(Failure::Work(format!("stopped by {signal}")));
        }
        let own = format!("-{}-", std::process::id());
        let left_behind = RunDir::list()
            .into_iter()
            .map(|run| run.name)
            .filter(|name| name.contains(&own))
            .collect();
        let summary = session::summarise(&job, &outcome, account);
        let messages = self.job.out.join(recorder::MESSAGES);
        // A full volume ends the messages early, and they are whole up to there.
        let truth = LogReader::open(&messages).map(whole).unwrap_or_default();
        let samples = LogReader::open(&messages).map(whole).unwrap_or_default();
        let topics = summary.topics.clone();
        Ok(Ran {
            summary,
            topics,
            end: outcome.end,
            truth,
            samples,
            left_behind,
        })
    }

    fn judge(&self, plan: &Plan, base: &Ran, ran: &Ran, again: &Ran) -> Result<Cell, Failure> {
        let joined =
            |of: &dyn Fn(&Fault) -> String| plan.iter().map(of).collect::<Vec<_>>().join(" + ");
        let at_tick = plan
            .iter()
            .filter_map(|fault| fault.at_tick)
            .min()
            .unwrap_or_default();
        // Where the messages end early and the topics are the fault-free ones, the arm did what it did without a fault.
        let is_base = !base.topics.is_empty() && ran.topics == base.topics;
        let truth = if is_base { &base.truth } else { &ran.truth };
        let mut motion = Motion::new(Guarantee::new(
            self.robot,
            &self.job.scenario,
            SPEED_MARGIN,
            ran.summary
                .faults
                .iter()
                .filter_map(|one| one.plan.as_ref()),
        ));
        truth.iter().for_each(|state| motion.add(state));
        ran.samples.iter().for_each(|sample| motion.add_age(sample));
        let tick_ms = 1e3 / f64::from(self.job.scenario.rate_hz);
        let allowed = self.allowed(plan, base)?;
        let mut cell = Cell {
            scenario: self.job.scenario.name.clone(),
            process: joined(&|fault| fault.process.clone()),
            kind: joined(&|fault| fault.kind.name().to_owned()),
            way: joined(&|fault| {
                fault
                    .way
                    .map(|way| way.name().to_owned())
                    .unwrap_or_default()
            }),
            faults: plan.iter().map(ToString::to_string).collect(),
            at_tick,
            detected_ms: ran
                .summary
                .faults
                .iter()
                .filter_map(|fault| fault.detected_ms)
                .reduce(f64::max),
            stale_ticks: motion.stale_ticks,
            stale_ms: f64::from(motion.stale_ticks) * tick_ms,
            torque_max_ratio: motion.torque_max_ratio,
            speed_max_ratio: motion.speed_max_ratio,
            torque_step_max_ratio: motion.torque_step_max_ratio,
            excursion_max_rad: excursion(&base.truth, truth, joints_apart),
            excursion_max_mm: 1e3 * excursion(&base.truth, truth, hands_apart),
            excursion_allowed_rad: allowed.joint_rad,
            excursion_allowed_mm: allowed.hand_mm,
            settled_ms: settled(truth, at_tick).map(|ticks| ticks as f64 * tick_ms),
            restarts: ran
                .summary
                .processes
                .iter()
                .map(|process| process.restarts)
                .sum(),
            messages_lost: ran.summary.recorder.lost,
            replayed_identically: ran.topics == again.topics
                && ran.summary.ticks == again.summary.ticks,
            left_behind: ran
                .left_behind
                .iter()
                .chain(&again.left_behind)
                .cloned()
                .collect(),
            ..Cell::default()
        };
        let last = truth.last();
        let ends_world = plan.iter().any(ends_world);
        let task = &ran.summary.task;
        cell.goal_reached = ran.summary.completed
            && limits::is_goal(task.final_position_mm, task.final_orientation_deg);
        cell.recovered =
            ran.end == End::Completed && last.is_some_and(|state| state.drive == DRIVE_ACTIVE);
        cell.safe_stop = motion.is_at_rest();
        cell.invariants_broken = motion
            .broken()
            .into_iter()
            .chain(limits::broken(&cell))
            .collect();
        let mut broken = |is_broken: bool, what: String| {
            if is_broken {
                cell.invariants_broken.push(what);
            }
        };
        // Nothing of a dead incarnation is taken in: it leaves no trace in any message.
        let is_zombie = plan.iter().all(|fault| fault.kind == Kind::Zombie);
        broken(
            is_zombie && !is_base,
            "messages of a dead incarnation have changed the run".to_owned(),
        );
        let (goal_reached, safe_stop) = (cell.goal_reached, cell.safe_stop);
        broken(
            !goal_reached && !safe_stop && !ends_world,
            "neither the goal nor rest at the end".to_owned(),
        );
        broken(
            ends_world && !matches!(ran.end, End::Failed(_)),
            "the end of the plant did not end the run".to_owned(),
        );
        let failed = match &ran.end {
            End::Failed(failure) if !ends_world => {
                failure.to_string().lines().next().map(ToOwned::to_owned)
            }
            _ => None,
        };
        broken(
            failed.is_some(),
            format!("the run failed: {}", failed.unwrap_or_default()),
        );
        let lost = cell.messages_lost;
        broken(
            lost > 0,
            format!("{lost} messages lost by the recorder in lockstep"),
        );
        broken(
            !cell.replayed_identically,
            "the saved plan gives other bytes".to_owned(),
        );
        let left = cell.left_behind.join(", ");
        broken(!left.is_empty(), format!("left in shared memory: {left}"));
        Ok(cell)
    }

    /// How far the arm may go: where a drive or a sensor fails, from the speeds that it has without a fault.
    fn allowed(&self, plan: &Plan, base: &Ran) -> Result<Excursion, Failure> {
        let rate_hz = f64::from(self.job.scenario.rate_hz);
        let length_s = |fault: &Fault| {
            fault
                .for_ticks
                .map_or(fault.kind.usual_length_s(), |ticks| ticks as f64 / rate_hz)
        };
        let fastest = |joint: usize| {
            base.truth
                .iter()
                .fold(0.0_f64, |most, state| most.max(state.qdot[joint].abs()))
        };
        let speed: Vec<f64> = (0..MAX_DOF).map(fastest).collect();
        let mut most = Excursion::ORDINARY;
        for fault in plan {
            most = most.or(match fault.kind {
                Kind::Drive => fall(
                    self.robot,
                    self.job.scenario.frame(),
                    &speed,
                    length_s(fault),
                )
                .map_err(Failure::input)?,
                Kind::Sensor => {
                    misled(self.robot, &self.job.scenario, &speed).map_err(Failure::input)?
                }
                _ => Excursion::NONE,
            });
        }
        Ok(most)
    }
}

/// All messages of a topic, to the last whole block.
fn whole<M: Message>(mut log: LogReader<M>) -> Vec<M> {
    std::iter::from_fn(|| log.next_message().ok().flatten()).collect()
}

/// Whether a fault takes the simulated world with it: then the run ends, cleanly, and there is no arm to be judged any more.
fn ends_world(fault: &Fault) -> bool {
    fault.process == Program::Plant.name() && fault.kind.ends_process(fault.way)
}

/// Largest difference of a joint; rad.
fn joints_apart(a: &PlantState, b: &PlantState) -> f64 {
    (0..MAX_DOF).fold(0.0_f64, |most, i| most.max((a.q[i] - b.q[i]).abs()))
}

/// Distance of the end-effectors; m.
fn hands_apart(a: &PlantState, b: &PlantState) -> f64 {
    (0..3)
        .map(|i| (a.p_BE[i] - b.p_BE[i]).powi(2))
        .sum::<f64>()
        .sqrt()
}

/// Largest distance from the base's path. Not the time lost on it: each state is compared with those that the base had come to by then, back to the
/// one that matched last.
fn excursion(
    base: &[PlantState],
    truth: &[PlantState],
    apart: fn(&PlantState, &PlantState) -> f64,
) -> f64 {
    let (mut most, mut from) = (0.0_f64, 0);
    for state in truth {
        let to = (state.header.tick as usize).min(base.len().saturating_sub(1));
        let nearest = (from.min(to)..=to).filter_map(|k| Some((k, apart(state, base.get(k)?))));
        let Some((k, distance)) = nearest.min_by(|a, b| a.1.total_cmp(&b.1)) else {
            continue;
        };
        (most, from) = (most.max(distance), k);
    }
    most
}

/// Ticks from the fault until the drives follow the controller again, or have braked for good; `None` where they never left it.
fn settled(truth: &[PlantState], at_tick: u64) -> Option<u64> {
    let after = || truth.iter().filter(|state| state.header.tick >= at_tick);
    let last = after()
        .filter(|state| state.drive != DRIVE_ACTIVE)
        .map(|state| state.header.tick)
        .next_back()?;
    let is_back = after().any(|state| state.header.tick > last);
    let rest = || {
        after()
            .find(|state| state.drive == DRIVE_BRAKED)
            .map(|state| state.header.tick)
    };
    Some(
        if is_back {
            last + 1
        } else {
            rest().unwrap_or(last)
        } - at_tick,
    )
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

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::codes::DRIVE_HOLDING;

    fn state(tick: u64, q: f64, drive: u32) -> PlantState {
        let mut state = PlantState {
            drive,
            ..PlantState::default()
        };
        (state.header.tick, state.q[0]) = (tick, q);
        state
    }

    #[test]
    fn time_lost_is_no_excursion_and_a_detour_is() {
        let base: Vec<_> = (0..100).map(|k| state(k, k as f64, DRIVE_ACTIVE)).collect();
        // Ten ticks late from tick 50 on.
        let late: Vec<_> = (0..110)
            .map(|k| {
                state(
                    k,
                    if k < 50 {
                        k as f64
                    } else {
                        (k - 10).max(50) as f64
                    },
                    DRIVE_ACTIVE,
                )
            })
            .collect();
        assert_eq!(excursion(&base, &late, joints_apart), 0.0);
        let detour: Vec<_> = (0..100)
            .map(|k| state(k, if k == 99 { 102.5 } else { k as f64 }, DRIVE_ACTIVE))
            .collect();
        assert_eq!(excursion(&base, &detour, joints_apart), 3.5);
    }

    #[test]
    fn it_is_settled_when_the_drives_follow_again_or_brake() {
        let of = |drives: &[u32]| {
            drives
                .iter()
                .enumerate()
                .map(|(k, drive)| state(k as u64, 0.0, *drive))
                .collect::<Vec<_>>()
        };
        assert_eq!(settled(&of(&[DRIVE_ACTIVE; 5]), 2), None);
        assert_eq!(
            settled(
                &of(&[
                    DRIVE_ACTIVE,
                    DRIVE_ACTIVE,
                    DRIVE_HOLDING,
                    DRIVE_HOLDING,
                    DRIVE_ACTIVE
                ]),
                1
            ),
            Some(3)
        );
        assert_eq!(
            settled(
                &of(&[DRIVE_ACTIVE, DRIVE_HOLDING, DRIVE_BRAKED, DRIVE_BRAKED]),
                1
            ),
            Some(1)
        );
    }
}
