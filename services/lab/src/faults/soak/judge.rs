//! The verdict on a round: the guarantees that hold under every fault.

use launcher::{End, Exit, Failure};
use shared_types::process::Program;

use super::super::motion::Motion;

/// A recorder that dies may cost the record of so much; s.
const LOST_PER_DEATH_S: f64 = 0.1;

/// A process that dies later than this before the end of the run may miss it; s.
const TIME_TO_RETURN_S: f64 = 2.0;

/// The process that makes the ticks: its end is that of the run.
const WORLD: &str = Program::Plant.name();

/// A death that was brought about, and what came of it.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Death {
    /// Process of the fault.
    pub process: String,
    pub what: String,
    /// Before the end of the run; s.
    pub before_end_s: f64,
    pub is_detected: bool,
    pub is_restarted: bool,
}

/// An end of a process that the launcher saw.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ended {
    /// Process of the fault.
    pub process: String,
    pub exit: Exit,
    /// Whether it was brought about.
    pub is_ours: bool,
}

/// Messages of the run, all topics together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Messages {
    /// Sent by all processes.
    pub sent: u64,
    /// Taken in by the recorder.
    pub taken_in: u64,
    /// Refused by the recorder: a number in them was not finite.
    pub refused: u64,
    /// Refused by the recorder: of a dead incarnation.
    pub fenced: u64,
    /// Sent, and neither taken in nor refused.
    pub lost: u64,
    /// In the files, read back.
    pub in_files: u64,
}

/// The content of a round's files, read back.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Files {
    /// Ticks that the recording has numbers of.
    pub rows: u64,
    /// Files that could not be read.
    pub unreadable: Vec<String>,
}

/// All that was seen of a round.
#[derive(Clone, Debug)]
pub(super) struct Evidence {
    pub end: End,
    /// The planned fault that was to end it, if any: its process, and whether it was injected.
    pub fatal: Option<(String, bool)>,
    /// Whether the goal was reached.
    pub goal_reached: bool,
    /// Ticks per second.
    pub rate_hz: u32,
    /// By topic.
    pub topics: u64,
    /// Ticks run.
    pub ticks: u64,
    pub motion: Motion,
    /// Messages compared.
    pub messages: Messages,
    pub files: Files,
    /// How often the recorder was started again.
    pub recorder_deaths: u64,
    /// The tick from which on the recorder's volume was full.
    pub full_at: Option<u64>,
    /// The recorder's report of its recording.
    pub recording_error: String,
    pub deaths: Vec<Death>,
    /// Runs that ended by design.
    pub ended: Vec<Ended>,
    /// Processes that were killed for their silence although nothing had silenced them.
    pub falsely_silenced: Vec<String>,
    pub left_over: Vec<String>,
}

/// The guarantees that a round did not keep, in words.
pub(super) fn broken(seen: &Evidence) -> Vec<String> {
    let mut broken = seen.motion.broken();
    broken.extend(end(seen));
    broken.extend(lives(seen));
    broken.extend(record(seen));
    if !seen.left_over.is_empty() {
        broken.push(format!("left behind: {}", seen.left_over.join(", ")));
    }
    broken
}

/// It ends at its goal or at rest, or at a fatal planned fault or an exhausted restart budget, with a sentence that names the process.
fn end(seen: &Evidence) -> Option<String> {
    let is_spent = |failure: &Failure| matches!(failure, Failure::Died { restarts: 1.., .. });
    // The record of how it ended goes with the volume; and an arm is where a drive that has just failed carries it.
    let is_well = seen.goal_reached
        || seen.full_at.is_some()
        || seen.motion.is_at_rest()
        || seen.motion.ends_with_a_failed_drive();
    match &seen.end {
        End::Interrupted { .. } => None,
        End::Completed if is_well => match &seen.fatal {
            Some((who, true)) if who == WORLD => {
                Some("the end of the plant did not end the run".to_owned())
            }
            _ => None,
        },
        End::Completed => Some("neither the goal nor rest at the end".to_owned()),
        End::Failed(failure) if is_spent(failure) => None,
        End::Failed(Failure::Died { process, .. })
            if seen
                .fatal
                .as_ref()
                .is_some_and(|(who, injected)| *injected && who == process) =>
        {
            None
        }
        End::Failed(failure) => Some(format!(
            "the run failed: {}",
            failure.to_string().lines().next().unwrap_or_default()
        )),
    }
}

/// Every death is detected and recovered, and no process ends unrequested.
fn lives(seen: &Evidence) -> Vec<String> {
    let mut broken = Vec::new();
    for Death {
        process,
        what,
        before_end_s,
        is_detected,
        is_restarted,
    } in seen.deaths.iter().filter(|death| death.process != WORLD)
    {
        let is_due = *before_end_s > TIME_TO_RETURN_S;
        if is_due && !is_detected {
            broken.push(format!("no process detected {what} of the {process}"));
        }
        if is_due && !is_restarted {
            broken.push(format!("the {process} was not started again after {what}"));
        }
    }
    let unasked = seen.ended.iter().filter(|ended| !ended.is_ours);
    broken.extend(
        unasked.map(|Ended { process, exit, .. }| {
            format!("the {process} ended by itself with {exit}")
        }),
    );
    broken.extend(
        seen.falsely_silenced
            .iter()
            .map(|process| format!("the {process} was killed for a silence that was not its own")),
    );
    broken
}

/// Nothing is lost but what a dead recorder could not take in, and everything that was written can be read.
fn record(seen: &Evidence) -> Vec<String> {
    let mut broken = seen.files.unreadable.clone();
    let ticks_allowed =
        (LOST_PER_DEATH_S * f64::from(seen.rate_hz)).ceil() as u64 * seen.recorder_deaths;
    let allowed = ticks_allowed * seen.topics;
    let Messages {
        sent,
        taken_in,
        refused,
        fenced,
        lost,
        in_files,
    } = seen.messages;
    if lost > allowed {
        broken.push(format!(
            "{lost} messages lost, {allowed} are allowed for {} deaths of the recorder",
            seen.recorder_deaths
        ));
    }
    if sent + seen.ended.len() as u64 * seen.topics < taken_in {
        broken.push(format!(
            "{taken_in} messages were taken in, and only {sent} sent"
        ));
    }
    match seen.full_at {
        None if !seen.recording_error.is_empty() => {
            broken.push(format!("the recording broke off: {}", seen.recording_error))
        }
        None => {
            let missing = sent.saturating_sub(refused + fenced + in_files);
            if missing > allowed {
                broken.push(format!(
                    "{missing} messages are not in the files, {allowed} may be missing"
                ));
            }
        }
        Some(full)
            if seen.ticks > full + u64::from(seen.rate_hz) && seen.recording_error.is_empty() =>
        {
            broken.push("no message said that the volume was full".to_owned());
        }
        Some(_) => {}
    }
    // The chunk in hand goes with the volume, and what has come of the next one when that is detected.
    let in_hand = 1.5 * viz::Options::default().chunk_s * f64::from(seen.rate_hz);
    let recorded = seen.full_at.map_or(seen.ticks, |full| {
        full.saturating_sub(in_hand as u64).min(seen.ticks)
    });
    if seen.files.rows + ticks_allowed + 1 < recorded {
        broken.push(format!(
            "the recording has numbers of {} ticks of {recorded}, {ticks_allowed} may be missing",
            seen.files.rows
        ));
    }
    broken
}

#[cfg(test)]
mod tests {
    use super::super::super::motion::{Guarantee, SPEED_MARGIN_AT_FULL_TORQUE};
    use super::*;
    use model::Robot;
    use shared_types::scenario::Scenario;
    use shared_types::{PlantState, codes};

    /// A round without fault, with something about it changed.
    fn judged(corrupt: impl Fn(&mut Evidence)) -> Vec<String> {
        let name = "fig5-wrist-rotation";
        let scenario = Scenario::parse(name, sim::scenarios::text(name).unwrap(), &[]).unwrap();
        let mut motion = Motion::new(Guarantee::new(
            &Robot::builtin("puma560").unwrap(),
            &scenario,
            SPEED_MARGIN_AT_FULL_TORQUE,
            std::iter::empty(),
        ));
        motion.add(&PlantState {
            drive: codes::DRIVE_BRAKED,
            ..PlantState::default()
        });
        let mut seen = Evidence {
            end: End::Completed,
            fatal: None,
            goal_reached: true,
            rate_hz: 1000,
            topics: 5,
            ticks: 10_000,
            motion,
            messages: Messages {
                sent: 50_000,
                taken_in: 50_000,
                in_files: 50_000,
                ..Messages::default()
            },
            files: Files {
                rows: 10_000,
                ..Files::default()
            },
            recorder_deaths: 0,
            full_at: None,
            recording_error: String::new(),
            deaths: Vec::new(),
            ended: Vec::new(),
            falsely_silenced: Vec::new(),
            left_over: Vec::new(),
        };
        corrupt(&mut seen);
        broken(&seen)
    }

    fn died(process: &str, restarts: u32) -> End {
        let (process, exit, last_words) = (process.to_owned(), Exit::Signal(9), Vec::new());
        End::Failed(Failure::Died {
            process,
            pid: 1,
            exit,
            tick: 1,
            restarts,
            suspect: None,
            last_words,
        })
    }

    fn death(is_detected: bool, is_restarted: bool, before_end_s: f64) -> Vec<Death> {
        vec![Death {
            process: "analyzer".to_owned(),
            what: "SIGKILL".to_owned(),
            before_end_s,
            is_detected,
            is_restarted,
        }]
    }

    #[test]
    fn a_round_that_keeps_everything_is_not_accused() {
        let fine =
            |corrupt: &dyn Fn(&mut Evidence)| assert_eq!(judged(corrupt), Vec::<String>::new());
        fine(&|_| ());
        fine(&|seen| seen.end = died("controller", 5));
        fine(&|seen| (seen.end, seen.fatal) = (died("plant", 0), Some(("plant".to_owned(), true))));
        fine(&|seen| seen.goal_reached = false);
        fine(&|seen| {
            (
                seen.recorder_deaths,
                seen.messages.lost,
                seen.messages.in_files,
                seen.files.rows,
            ) = (1, 500, 49_500, 9_900)
        });
        fine(&|seen| seen.deaths = death(false, false, 0.5));
        fine(&|seen| {
            (seen.full_at, seen.recording_error, seen.files.rows) =
                (Some(5_000), "the disk is full".to_owned(), 4_650)
        });
    }

    #[test]
    fn every_guarantee_that_is_broken_is_caught() {
        let caught = |words: &str, corrupt: &dyn Fn(&mut Evidence)| {
            let broken = judged(corrupt);
            assert!(
                broken.len() == 1 && broken[0].contains(words),
                "{words}: {broken:?}"
            );
        };
        caught("501 messages lost, 500", &|seen| {
            (
                seen.recorder_deaths,
                seen.messages.lost,
                seen.messages.in_files,
            ) = (1, 501, 49_500)
        });
        caught("1 messages lost, 0", &|seen| seen.messages.lost = 1);
        caught("1 messages are not in the files", &|seen| {
            seen.messages.in_files -= 1
        });
        caught("only 50000 sent", &|seen| seen.messages.taken_in += 1);
        caught("of 9898 ticks of 10000", &|seen| {
            (seen.recorder_deaths, seen.files.rows) = (1, 9_898)
        });
        caught("cannot read", &|seen| {
            seen.files.unreadable.push("cannot read run.rrd".to_owned())
        });
        caught("broke off: full", &|seen| {
            seen.recording_error = "full".to_owned()
        });
        caught("no message said", &|seen| seen.full_at = Some(5_000));
        let due = 5_000 - (1.5 * viz::Options::default().chunk_s * 1000.0) as u64;
        let (words, rows) = (format!("of {} ticks of {due}", due - 75), due - 75);
        caught(&words, &|seen| {
            (seen.full_at, seen.recording_error, seen.files.rows) =
                (Some(5_000), "the disk is full".to_owned(), rows);
        });
        caught("left behind: armplane-0", &|seen| {
            seen.left_over.push("armplane-0".to_owned())
        });
        caught("no process detected SIGKILL of the analyzer", &|seen| {
            seen.deaths = death(false, true, 9.0)
        });
        caught("the analyzer was not started again", &|seen| {
            seen.deaths = death(true, false, 9.0)
        });
        caught("ended by itself with exit code 1", &|seen| {
            seen.ended.push(Ended {
                process: "estimator".to_owned(),
                exit: Exit::Code(1),
                is_ours: false,
            });
        });
        caught("not its own", &|seen| {
            seen.falsely_silenced.push("controller".to_owned())
        });
        caught("did not end the run", &|seen| {
            seen.fatal = Some(("plant".to_owned(), true))
        });
        caught("the run failed: plant", &|seen| seen.end = died("plant", 0));
        caught("the run failed: plant", &|seen| {
            (seen.end, seen.fatal) = (died("plant", 0), Some(("controller".to_owned(), true)))
        });
        caught("neither the goal nor rest", &|seen| {
            seen.goal_reached = false;
            let moving = PlantState {
                qdot: [0.3; shared_types::MAX_DOF],
                ..PlantState::default()
            };
            seen.motion.add(&moving);
        });
    }
}
