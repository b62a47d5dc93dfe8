//! One round: a run in real time that is injected, and everything that was seen of it.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::mpsc::{Sender, channel};

use launcher::{End, Event, Exit, Outcome};
use model::Robot;
use recorder::MESSAGES;
use runtime::{ControlPage, FaultRecord, RunDir, now_ns};
use serde::Serialize;
use session::{Failure, load};
use shared_types::fault::{Kind, Way};
use shared_types::graph::Graph;
use shared_types::job::{Job, Mode};
use shared_types::process::Program;
use shared_types::scenario::Scenario;
use shared_types::summary::{Deadlines, Summary};

use super::super::motion::{Guarantee, Motion, SPEED_MARGIN_AT_FULL_TORQUE};
use super::draw::{Act, Planned, Signal};
use super::inject::{Done, Executed, Injector};
use super::judge::{Death, Ended, Evidence, Files, Messages, broken};
use super::launcher_events::{LauncherEvents, RECORDING_ENDS};
use super::read_back::{Stop, left_over, read};

/// A round may take so many times as long as planned, and a little more: whoever is stopped again and again is late at the goal.
const LONGEST: f64 = 1.5;

/// The same for short rounds; s.
const LONGEST_MORE_S: f64 = 10.0;

/// A stop is put down to the latest fault that was in force, or had been so shortly before; s.
const AFTERMATH_S: f64 = 0.15;

/// Number of the signal of a read beyond the end of a mapped file.
const SIGBUS: i32 = rustix::process::Signal::BUS.as_raw();

/// Exit code of a panic.
const PANIC: i32 = 101;

/// A fault or signal, and what came of it.
#[derive(Clone, Debug, Serialize)]
pub struct Injected {
    /// As in the table.
    pub kind: String,
    /// Process of the fault.
    pub process: String,
    /// In words.
    pub what: String,
    /// Since the first tick; s.
    pub at_s: f64,
    /// Tick of the difference.
    pub tick: u64,
    /// How long it lasted; s.
    pub length_s: f64,
    /// Wall-clock time until something detected; ms.
    pub detected_ms: Option<f64>,
    /// Wall-clock time until the process worked again; ms.
    pub recovered_ms: Option<f64>,
    /// How long the drives then did not follow the controller; ms.
    pub stopped_ms: f64,
    pub deaths: u32,
}

/// One round, as it stands in the JSON.
#[derive(Clone, Debug, Serialize)]
pub struct Round {
    /// Number of the round.
    pub round: usize,
    /// Seed.
    pub seed: u64,
    /// Ticks run.
    pub ticks: u64,
    /// Ticks per second.
    pub rate_hz: u32,
    /// `goal reached`, `rest`, `ended` or `interrupted`.
    pub end: &'static str,
    /// Reason of the end.
    pub reason: String,
    /// Faults and signals injected.
    pub injected: Vec<Injected>,
    /// Blows that were drawn and not injected, with the reason.
    pub left_out: BTreeMap<&'static str, u64>,
    /// Stops of the arm.
    pub stops: Vec<Stop>,
    /// Restarts.
    pub restarts: BTreeMap<String, u32>,
    /// Messages compared.
    pub messages: Messages,
    /// Messages per process that were sent but neither received nor refused by the recorder, as far as known of one topic.
    pub not_taken_in: BTreeMap<String, u64>,
    /// Missed deadlines by cause.
    pub deadlines: Deadlines,
    /// Largest torque over its limit.
    pub torque_max_ratio: f64,
    /// Largest change of a torque between two ticks over its limit.
    pub torque_step_max_ratio: f64,
    /// Largest joint speed over its limit.
    pub speed_max_ratio: f64,
    /// Age of the oldest torque in force, ticks.
    pub stale_ticks: u32,
    /// Size of the recording, MB.
    pub recording_mb: f64,
    /// Parts of the recording.
    pub parts: u32,
    /// Guarantees that were broken.
    pub broken: Vec<String>,
}

/// The settings of all rounds.
pub(super) struct Setting<'a> {
    pub robot: &'a Robot,
    /// Prolonged to the length of a round, without faults of its own.
    pub scenario: &'a Scenario,
    pub seconds: f64,
}

impl Setting<'_> {
    fn job(&self, out: &Path, seed: u64) -> Result<Job, Failure> {
        let scenario = Scenario {
            seed,
            fault: Vec::new(),
            ..self.scenario.clone()
        };
        Ok(load::job(
            self.robot,
            scenario,
            load::graph(None)?,
            Mode::Realtime,
            out.to_owned(),
        ))
    }

    /// Runs and judges a round; its files stay in `out`.
    pub(super) fn round(
        &self,
        number: usize,
        seed: u64,
        planned: Vec<Planned>,
        out: &Path,
        progress: &mut dyn FnMut(u64),
    ) -> Result<Round, Failure> {
        let job = self.job(out, seed)?;
        let processes: Vec<String> = job
            .graph
            .process
            .iter()
            .map(|process| process.name.clone())
            .collect();
        let plan = session::plan(&job)?;
        let source = plan
            .children
            .iter()
            .position(|child| child.ends_run)
            .unwrap_or_default();
        let (rate_hz, most_s) = (
            job.scenario.rate_hz,
            LONGEST * self.seconds + LONGEST_MORE_S,
        );
        let mut events = LauncherEvents::default();
        // Before the launch, for the kernel ends the children of a thread that ends.
        let (begun, begins) = channel::<ControlPage>();
        let (go, going) = channel();
        let (graph, mut go): (Graph, Option<Sender<()>>) = (job.graph.clone(), Some(go));
        let mut name = String::new();
        let (launched, injected) = std::thread::scope(|scope| {
            let injector = scope.spawn(move || {
                let Ok(control_page) = begins.recv() else {
                    return (Vec::new(), None);
                };
                let injector = Injector {
                    control_page: &control_page,
                    graph: &graph,
                    source,
                    rate_hz,
                    seed,
                };
                let executed = injector.inject(planned, most_s, &going);
                (executed, Some(control_page))
            });
            let mut begin = |run: &RunDir| {
                run.name().clone_into(&mut name);
                let _ = begun.send(ControlPage::open(run).map_err(Failure::work)?);
                Ok(())
            };
            let launched = session::launch_watched(&job, plan, &mut begin, &mut |event| {
                match event {
                    Event::Go => drop(go.as_ref().map(|go| go.send(()))),
                    Event::Stopping => go = None,
                    Event::Progress { ticks } => progress(*ticks),
                    _ => {}
                }
                events.take(event);
            });
            (go, _) = (None, drop(begun));
            (launched, injector.join())
        });
        let end_ns = now_ns();
        let (outcome, account) = launched?;
        let (executed, Some(control_page)) = injected.unwrap_or_default() else {
            return Err(Failure::Work("the run was never begun".to_owned()));
        };
        let fault_table = control_page.fault_table();
        let accounts: Vec<(usize, FaultRecord)> = fault_table.records().collect();
        let summary = session::summarise(&job, &outcome, account);
        session::keep(out, &job, &summary)?;
        let seen = Seen {
            processes,
            graph: job.graph.clone(),
            executed,
            accounts,
            events,
            outcome,
            summary,
            end_ns,
            run: name,
        };
        let round = seen.judge(self, number, seed, &job, out)?;
        if !round.broken.is_empty() {
            let lines = seen
                .events
                .lines
                .iter()
                .map(|line| format!("{line}\n"))
                .collect::<String>();
            let _ = std::fs::write(out.join("stderr.txt"), lines);
        }
        Ok(round)
    }
}

/// All that is known of a round when it is over.
struct Seen {
    processes: Vec<String>,
    graph: Graph,
    executed: Vec<Executed>,
    accounts: Vec<(usize, FaultRecord)>,
    events: LauncherEvents,
    outcome: Outcome,
    summary: Summary,
    end_ns: u64,
    run: String,
}

impl Seen {
    fn judge(
        &self,
        setting: &Setting<'_>,
        number: usize,
        seed: u64,
        job: &Job,
        out: &Path,
    ) -> Result<Round, Failure> {
        let rate_hz = job.scenario.rate_hz;
        let faults = self
            .summary
            .faults
            .iter()
            .filter(|fault| fault.occurred)
            .filter_map(|fault| fault.plan.as_ref());
        let (motion, stops, mut files, by_topic) = read(
            Motion::new(Guarantee::new(
                setting.robot,
                &job.scenario,
                SPEED_MARGIN_AT_FULL_TORQUE,
                faults,
            )),
            &out.join(MESSAGES),
        );
        self.read_recording(out, &mut files);
        let mut injected: Vec<Injected> = self
            .executed
            .iter()
            .filter_map(|executed| self.injected(executed, rate_hz))
            .collect();
        blame(&mut injected, &stops, rate_hz);
        let recorder_counts = self
            .outcome
            .processes
            .iter()
            .find(|process| process.name == Program::Recorder.name())
            .map(|one| one.counts);
        let (refused, fenced) =
            recorder_counts.map_or((0, 0), |counts| (counts.refused, counts.fenced));
        let sent = self
            .outcome
            .processes
            .iter()
            .map(|process| process.counts.sent)
            .sum::<u64>();
        let in_files: u64 = by_topic.iter().sum();
        // A recorder that is dead at the end leaves no account, but it leaves its files; where a full volume has ended those, its last words.
        let account = &self.summary.recorder;
        let (taken_in, recording_error) = match (account.messages, self.full_at()) {
            (0, Some(_)) => (
                sent.saturating_sub(refused + fenced),
                self.events.words_on(RECORDING_ENDS),
            ),
            (0, None) => (in_files, String::new()),
            (messages, _) => (messages, account.error.clone()),
        };
        let messages = Messages {
            sent,
            taken_in,
            refused,
            fenced,
            lost: sent.saturating_sub(taken_in + refused + fenced),
            in_files,
        };
        // As `drill` sees it: what it went through on its way is not the goal.
        let (task, goal) = (&self.summary.task, &job.scenario.goal);
        let is_there = task.final_position_mm <= goal.position_mm
            && task.final_orientation_deg <= goal.orientation_deg;
        let goal_reached = self.outcome.end == End::Completed && self.summary.completed && is_there;
        let is_at_rest = motion.is_at_rest();
        let evidence = Evidence {
            end: self.outcome.end.clone(),
            fatal: self.fatal(),
            goal_reached,
            rate_hz,
            topics: by_topic.len() as u64,
            ticks: self.outcome.ticks,
            motion,
            messages,
            files,
            recorder_deaths: self
                .outcome
                .processes
                .iter()
                .find(|one| one.name == Program::Recorder.name())
                .map_or(0, |one| u64::from(one.restarts)),
            full_at: self.full_at(),
            recording_error,
            deaths: self.deaths(),
            ended: self.ended(),
            falsely_silenced: self.falsely_silenced(),
            left_over: left_over(&self.run),
        };
        let end = match &self.outcome.end {
            End::Interrupted { .. } => "interrupted",
            End::Failed(_) => "ended",
            End::Completed if goal_reached => "goal reached",
            End::Completed if is_at_rest => "rest",
            End::Completed => "ended",
        };
        let mut left_out = BTreeMap::new();
        for executed in &self.executed {
            if let Done::LeftOut(why) = executed.done {
                *left_out.entry(why).or_default() += 1;
            }
        }
        Ok(Round {
            round: number,
            seed,
            ticks: self.outcome.ticks,
            rate_hz,
            end,
            reason: self.summary.reason.clone(),
            injected,
            left_out,
            stops,
            restarts: self
                .outcome
                .processes
                .iter()
                .map(|process| (process.name.clone(), process.restarts))
                .collect(),
            messages,
            not_taken_in: self.not_taken_in(job),
            deadlines: self.summary.deadlines.clone(),
            torque_max_ratio: evidence.motion.torque_max_ratio,
            torque_step_max_ratio: evidence.motion.torque_step_max_ratio,
            speed_max_ratio: evidence.motion.speed_max_ratio,
            stale_ticks: evidence.motion.stale_ticks,
            recording_mb: self.summary.recorder.bytes as f64 / 1e6,
            parts: self.summary.recorder.parts,
            broken: broken(&evidence),
        })
    }

    fn not_taken_in(&self, job: &Job) -> BTreeMap<String, u64> {
        let taken_in = |process: &str| {
            let writes = job
                .graph
                .process
                .iter()
                .find(|one| one.name == process)
                .map(|one| one.writes.as_slice())
                .unwrap_or_default();
            writes
                .iter()
                .filter_map(|topic| Some(self.summary.topics.get(topic)?.count))
                .sum::<u64>()
        };
        let of = |process: &launcher::ProcessOutcome| {
            (
                process.name.clone(),
                process.counts.sent.saturating_sub(taken_in(&process.name)),
            )
        };
        self.outcome
            .processes
            .iter()
            .map(of)
            .filter(|(_, count)| *count > 0)
            .collect()
    }

    /// Counts the ticks that the recording has numbers of.
    fn read_recording(&self, out: &Path, files: &mut Files) {
        let mut has = vec![false; self.outcome.ticks as usize + 1];
        for part in viz::parts_in(out) {
            let each = |piece: viz::Piece<'_>| {
                match piece {
                    viz::Piece::Rows(rows) => {
                        for tick in &rows.ticks {
                            if let Some(place) = has.get_mut(*tick as usize) {
                                *place = true;
                            }
                        }
                    }
                    viz::Piece::Damaged(damage) => files.unreadable.push(damage.to_string()),
                    _ => {}
                }
                Ok::<(), viz::ReadError>(())
            };
            if let Err(error) = viz::read(std::slice::from_ref(&part), each) {
                files.unreadable.push(error.to_string());
            }
        }
        files.rows = has.iter().filter(|has| **has).count() as u64;
    }

    fn index_of(&self, process: &str) -> Option<usize> {
        self.processes.iter().position(|known| known == process)
    }

    fn account(&self, executed: &Executed) -> Option<&FaultRecord> {
        let Done::Requested(place) = executed.done else {
            return None;
        };
        self.accounts
            .iter()
            .find(|(known, _)| *known == place)
            .map(|(_, account)| account)
    }

    /// The entry in which the launcher detected what a signal did.
    fn detected(&self, executed: &Executed) -> Option<&FaultRecord> {
        let index = self.index_of(executed.planned.act.process())?;
        let of_it = |account: &&FaultRecord| {
            account.scheduled.process as usize == index && account.detected_ns > executed.at_ns
        };
        let takes_down =
            |account: &&FaultRecord| account.scheduled.kind().is_some_and(Kind::takes_down);
        self.accounts
            .iter()
            .map(|(_, account)| account)
            .filter(of_it)
            .filter(takes_down)
            .min_by_key(|account| account.detected_ns)
    }

    /// The record of a fault or signal; `None` where it was left out, or the run was over before it was due.
    fn injected(&self, executed: &Executed, rate_hz: u32) -> Option<Injected> {
        let act = &executed.planned.act;
        let since_ms =
            |from: u64, to: u64| (to > from && from > 0).then(|| (to - from) as f64 * 1e-6);
        let (what, tick, length_s, detected_ms, recovered_ms) = match (act, &executed.done) {
            (_, Done::LeftOut(_)) => return None,
            (Act::Fault(_), _) => {
                let account = self
                    .account(executed)
                    .filter(|account| account.injected_ns > 0)?;
                let fault = account
                    .scheduled
                    .fault(act.process(), &self.graph.target(act.process())?)?;
                let length_s = fault
                    .for_ticks
                    .map_or(0.0, |ticks| ticks as f64 / f64::from(rate_hz));
                let FaultRecord {
                    injected_ns,
                    detected_ns,
                    recovered_ns,
                    ..
                } = *account;
                (
                    fault.to_string(),
                    account.scheduled.at,
                    length_s,
                    since_ms(injected_ns, detected_ns),
                    since_ms(injected_ns, recovered_ns),
                )
            }
            (Act::Signal(process, signal), Done::Signalled) => {
                let account = if act.deaths() > 0 {
                    self.detected(executed)
                } else {
                    None
                };
                let length_s = if let Signal::StopFor(ms) = signal {
                    f64::from(*ms) * 1e-3
                } else {
                    0.1
                };
                let since = |ns: Option<u64>| ns.and_then(|ns| since_ms(executed.at_ns, ns));
                let (detected, recovered) = (
                    account.map(|one| one.detected_ns),
                    account.map(|one| one.recovered_ns),
                );
                (
                    format!("{signal:?} of the {process}"),
                    executed.tick,
                    length_s,
                    since(detected),
                    since(recovered),
                )
            }
            _ => return None,
        };
        let (kind, process) = (act.name(), act.process().to_owned());
        Some(Injected {
            kind,
            process,
            what,
            at_s: tick as f64 / f64::from(rate_hz),
            tick,
            length_s,
            detected_ms,
            recovered_ms,
            stopped_ms: 0.0,
            deaths: act.deaths(),
        })
    }

    fn has_injected(&self, executed: &Executed) -> bool {
        match executed.done {
            Done::Requested(_) => self
                .account(executed)
                .is_some_and(|account| account.injected_ns > 0),
            Done::Signalled => true,
            Done::LeftOut(_) => false,
        }
    }

    /// The planned that was to end the run, and whether it fell.
    fn fatal(&self) -> Option<(String, bool)> {
        // A busy machine may have continued the plant too late.
        if let Some(stopped) = self
            .events
            .silenced
            .iter()
            .find(|process| *process == Program::Plant.name() && self.was_stopped(process))
        {
            return Some((stopped.clone(), true));
        }
        let mut fatal = self
            .executed
            .iter()
            .filter(|executed| executed.planned.is_fatal);
        let first = fatal.next()?;
        let has_injected =
            self.has_injected(first) || fatal.any(|executed| self.has_injected(executed));
        Some((first.planned.act.process().to_owned(), has_injected))
    }

    fn full_at(&self) -> Option<u64> {
        let full = |(_, account): &(usize, FaultRecord)| {
            account.scheduled.kind() == Some(Kind::DiskFull) && account.injected_ns > 0
        };
        self.accounts
            .iter()
            .filter(|account| full(account))
            .map(|(_, account)| account.scheduled.at)
            .min()
    }

    /// Every death that was brought about: by the fault table, by a signal.
    fn deaths(&self) -> Vec<Death> {
        let is_restarted = |process: &str, at_ns: u64| {
            self.events
                .ended
                .iter()
                .any(|(who, _, ns)| who == process && *ns > at_ns)
        };
        let before_end_s = |at_ns: u64| self.end_ns.saturating_sub(at_ns) as f64 * 1e-9;
        let mut deaths = Vec::new();
        for executed in self
            .executed
            .iter()
            .filter(|executed| executed.planned.act.deaths() > 0 && self.has_injected(executed))
        {
            let process = executed.planned.act.process().to_owned();
            let (at_ns, is_detected) = match self.account(executed) {
                Some(account) => (account.injected_ns, account.detected_ns > 0),
                None => (
                    executed.at_ns,
                    self.detected(executed).is_some() || self.is_explained(executed),
                ),
            };
            let is_restarted = is_restarted(&process, at_ns);
            deaths.push(Death {
                what: executed.planned.act.name(),
                before_end_s: before_end_s(at_ns),
                is_detected,
                is_restarted,
                process,
            });
        }
        deaths
    }

    /// A death in the middle of a fault that had taken the process down is no entry of its own.
    fn is_explained(&self, executed: &Executed) -> bool {
        let index = self.index_of(executed.planned.act.process());
        let explains = |account: &FaultRecord| {
            let is_its = Some(account.scheduled.process as usize) == index
                && account.scheduled.kind().is_some_and(Kind::takes_down);
            is_its
                && account.injected_ns > 0
                && account.detected_ns > 0
                && (account.recovered_ns == 0 || account.recovered_ns > executed.at_ns)
        };
        self.accounts.iter().any(|(_, account)| explains(account))
    }

    /// The ends that the launcher saw, each with whether something of ours explains it.
    fn ended(&self) -> Vec<Ended> {
        let mut ended: Vec<Ended> = Vec::new();
        for (process, exit, _) in &self.events.ended {
            let so_far = |exits: &dyn Fn(Exit) -> bool| {
                ended
                    .iter()
                    .filter(|one| one.process == *process && exits(one.exit))
                    .count()
            };
            let injected = || {
                self.executed
                    .iter()
                    .filter(|one| one.planned.act.process() == process && self.has_injected(one))
            };
            let by = |way: Way| {
                injected()
                    .filter(|one| one.planned.act.way() == Some(way))
                    .count()
            };
            let (panics, bus_errors) = (by(Way::Panic), by(Way::BusError));
            let kills: usize = injected()
                .map(|one| one.planned.act.deaths() as usize)
                .sum::<usize>()
                - panics
                - bus_errors;
            // A stop that lasts too long ends with a kill; a stopped process killed by a second planned dies once.
            let silenced = self
                .events
                .silenced
                .iter()
                .filter(|one| *one == process)
                .count();
            // Numbers far out of range may end in one that is not finite; then a process stops rather than send it.
            let is_corrupted = self.executed.iter().any(
                |one| matches!(&one.planned.act, Act::Fault(fault) if fault.kind == Kind::Corrupt),
            );
            let refused = if is_corrupted {
                self.events
                    .refused
                    .iter()
                    .filter(|one| *one == process)
                    .count()
            } else {
                0
            };
            let is_ours = match exit {
                Exit::Signal(9) => so_far(&|exit| exit == Exit::Signal(9)) < kills + silenced,
                Exit::Signal(SIGBUS) => so_far(&|exit| exit == Exit::Signal(SIGBUS)) < bus_errors,
                Exit::Code(PANIC) => so_far(&|exit| exit == Exit::Code(PANIC)) < panics,
                Exit::Code(1) => so_far(&|exit| exit == Exit::Code(1)) < refused,
                _ => false,
            };
            ended.push(Ended {
                process: process.clone(),
                exit: *exit,
                is_ours,
            });
        }
        ended
    }

    /// Processes killed for their silence that no fault had stopped.
    fn falsely_silenced(&self) -> Vec<String> {
        self.events
            .silenced
            .iter()
            .filter(|process| !self.was_stopped(process))
            .cloned()
            .collect()
    }

    fn was_stopped(&self, process: &str) -> bool {
        let stops = |act: &Act| match act {
            Act::Fault(fault) => fault.kind == Kind::Hang,
            Act::Signal(_, signal) => matches!(signal, Signal::Stop | Signal::StopFor(_)),
        };
        self.executed.iter().any(|executed| {
            executed.planned.act.process() == process
                && stops(&executed.planned.act)
                && self.has_injected(executed)
        })
    }
}

/// Puts each stop down to the latest fault that was in force when it began.
fn blame(injected: &mut [Injected], stops: &[Stop], rate_hz: u32) {
    let rate = f64::from(rate_hz);
    for stop in stops {
        let lasts =
            |planned: &Injected| planned.tick + ((planned.length_s + AFTERMATH_S) * rate) as u64;
        let was_in_force =
            |planned: &&mut Injected| (planned.tick..=lasts(planned)).contains(&stop.from);
        if let Some(planned) = injected
            .iter_mut()
            .filter(was_in_force)
            .max_by_key(|planned| planned.tick)
        {
            planned.stopped_ms += (stop.until - stop.from) as f64 * 1e3 / rate;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stop_is_put_down_to_the_latest_blow_that_was_in_force() {
        let planned = |tick: u64, length_s: f64| Injected {
            kind: String::new(),
            process: String::new(),
            what: String::new(),
            at_s: 0.0,
            tick,
            length_s,
            detected_ms: None,
            recovered_ms: None,
            stopped_ms: 0.0,
            deaths: 0,
        };
        let mut injected = [planned(100, 0.5), planned(300, 0.1), planned(900, 0.1)];
        let stops = [
            Stop {
                from: 350,
                until: 400,
            },
            Stop {
                from: 600,
                until: 610,
            },
            Stop {
                from: 800,
                until: 820,
            },
        ];
        blame(&mut injected, &stops, 1000);
        assert_eq!(
            injected.map(|planned| planned.stopped_ms),
            [10.0, 50.0, 0.0]
        );
    }
}
