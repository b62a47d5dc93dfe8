//! One random history: a graph, deaths at random steps and planned ones, processes that are slow to wake, and the repetition from the plan it leaves.

use shared_types::random::at as random;

use super::defect::Defect;
use super::machine::{At, DOWN, Graph, State};
use super::recorder::Recorder;
use crate::protocol::Outage;

/// Steps after which a history counts as endless.
const MOST_STEPS: u64 = 200_000;
/// How many schedules repeat a history from its plan.
const REPETITIONS: u64 = 2;

/// The result of a history.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Deaths, planned ones included.
    pub deaths: u64,
    /// Steps of all processes and of the launcher.
    pub steps: u64,
    /// The guarantee that was broken, with the smallest history found that breaks one.
    pub failure: Option<String>,
}

/// A history before it is run.
#[derive(Clone, Debug)]
struct History {
    graph: Graph,
    /// Deaths that no plan has: the step, and the process.
    kills: Vec<(u64, usize)>,
    planned: Vec<Outage>,
    schedule: u64,
    /// Blocks of the message logs for which the recorder's volume has room.
    room: u64,
}

/// Runs the history of a number, and repeats it from its plan.
#[must_use]
pub fn history(seed: u64, number: u64, defect: Defect) -> Outcome {
    let history = History::draw(random(seed, number));
    let mut outcome = history.check(defect);
    if outcome.failure.is_some() {
        let (smallest, failure) = history.shrink(defect);
        outcome.failure = failure.map(|failure| {
            format!(
                "history {number} of seed {seed}: {failure}; smallest: {}",
                smallest.in_words()
            )
        });
    }
    outcome
}

impl History {
    fn draw(seed: u64) -> Self {
        let draw = |what: u64, most: u64| random(seed, what) % most.max(1);
        let count = 2 + draw(0, 4) as usize;
        let outputs: Vec<usize> = (0..count)
            .map(|process| {
                if process == 0 {
                    1
                } else {
                    1 + draw(10 + process as u64, 3) as usize
                }
            })
            .collect();
        let reads = |me: usize| {
            // One process in four is not read by the next one.
            let before = me.saturating_sub(if me > 1 && draw(500 + me as u64, 4) == 0 {
                2
            } else {
                1
            });
            let more = (0..before).filter(|other| draw((100 + 10 * me + other) as u64, 3) == 0);
            let inputs = std::iter::once(before).chain(more);
            inputs
                .map(|writer| {
                    (
                        writer,
                        draw((200 + 10 * me + writer) as u64, outputs[writer] as u64) as usize,
                    )
                })
                .collect()
        };
        let reads: Vec<Vec<(usize, usize)>> = (0..count)
            .map(|me| if me == 0 { Vec::new() } else { reads(me) })
            .collect();
        let ticks = 4 + draw(1, 28);
        let steps = ticks * (outputs.iter().sum::<usize>() as u64 + count as u64) * 3;
        // The recorder comes after the processes of the graph.
        let victim = |what: u64| 1 + draw(what, count as u64) as usize;
        let mut kills: Vec<(u64, usize)> = Vec::new();
        for number in 0..draw(2, 6) {
            // Every second one soon after the one before: while that is detected, or its replacement starts.
            let near = kills
                .last()
                .filter(|_| draw(300 + number, 2) == 0)
                .map(|last| last.0 + draw(310 + number, 12));
            kills.push((
                near.unwrap_or_else(|| draw(320 + number, steps)),
                victim(330 + number),
            ));
        }
        kills.sort_unstable();
        let planned = |place: u64| {
            let (at, process) = (draw(400 + place, ticks), victim(410 + place));
            let after_outputs = draw(
                420 + place,
                outputs.get(process).map_or(0, |outputs| *outputs as u64),
            ) as u32;
            let until = at + 1 + draw(430 + place, 2 * DOWN);
            Outage {
                place: place as usize,
                process,
                at,
                until,
                has_struck: false,
                is_death: true,
                is_unplanned: false,
                after_outputs,
            }
        };
        let planned = (0..draw(3, 4)).map(planned).collect();
        // One volume in three fills.
        let room = if draw(5, 3) == 0 {
            draw(6, 40)
        } else {
            u64::MAX
        };
        Self {
            graph: Graph {
                reads,
                outputs,
                ticks,
            },
            kills,
            planned,
            schedule: random(seed, 4),
            room,
        }
    }

    /// Runs to the end under one schedule.
    fn run(
        &self,
        planned: &[Outage],
        kills: &[(u64, usize)],
        schedule: u64,
        defect: Defect,
    ) -> Result<(State, u64), String> {
        let count = self.graph.reads.len() + 1;
        let mut state = State::new(&self.graph, planned, 0, defect).with_recorder(
            &self.graph,
            self.room,
            defect,
        );
        let mut kills = kills.iter().copied().peekable();
        // In one history of four the recorder is hardly ever awake.
        let is_starved = random(schedule, u64::MAX).is_multiple_of(4);
        for step in 0..MOST_STEPS {
            while let Some((_, victim)) = kills.next_if(|kill| kill.0 <= step) {
                state.kill(victim);
            }
            if state.has_failed || state.at.iter().all(|at| *at == At::Done) {
                let lack = state
                    .recorder
                    .as_mut()
                    .filter(|_| !state.has_failed)
                    .and_then(Recorder::lack);
                return lack.map_or(Ok((state, step)), Err);
            }
            let first = random(schedule, step) as usize;
            // A process that sleeps does nothing for a while, as long as others can.
            let draw = |me: usize| random(schedule ^ (1 + me as u64), step / 41);
            let sleeps = |me: usize| {
                if is_starved && me + 1 == count {
                    draw(me) % 12 > 0
                } else {
                    draw(me).is_multiple_of(3)
                }
            };
            // The last turn: the recorder has looked before the source began to wait.
            let mut order = (0..3 * count).map(|turn| (turn >= count, (first + turn) % count));
            let has_moved = order.any(|(is_late, me)| {
                (is_late || !sleeps(me)) && state.step(&self.graph, me, defect)
            });
            if let Some(broken) = state.broken {
                return Err(broken.to_owned());
            }
            if !has_moved {
                return Err(format!(
                    "no process can go on: {:?} at ticks {:?}",
                    state.at, state.tick
                ));
            }
        }
        Err("it does not end".to_owned())
    }

    fn check(&self, defect: Defect) -> Outcome {
        let (live, steps) = match self.run(&self.planned, &self.kills, self.schedule, defect) {
            Ok(ended) => ended,
            Err(failure) => {
                return Outcome {
                    failure: Some(failure),
                    ..Outcome::default()
                };
            }
        };
        let mut outcome = Outcome {
            deaths: live
                .progress
                .iter()
                .map(|one| u64::from(one.incarnation) - 1)
                .sum(),
            steps,
            failure: None,
        };
        for repetition in 1..=if live.has_failed { 0 } else { REPETITIONS } {
            match self.run(&live.plan(), &[], random(self.schedule, repetition), defect) {
                Ok((again, more)) => {
                    outcome.steps += more;
                    let differs = |place| live.retainer.get(place) != again.retainer.get(place);
                    if let Some(place) = live
                        .retainer
                        .keys()
                        .chain(again.retainer.keys())
                        .filter(|place| differs(*place))
                        .min_by_key(|place| place.2)
                    {
                        let (process, output, tick) = place;
                        outcome.failure = Some(format!(
                            "its plan gives another message {output} of process {process} at tick {tick}"
                        ));
                    }
                }
                Err(failure) => outcome.failure = Some(format!("its plan: {failure}")),
            }
        }
        outcome
    }

    /// The smallest history that still fails, of those with one death or some ticks fewer at a time.
    fn shrink(mut self, defect: Defect) -> (Self, Option<String>) {
        let mut failure = self.check(defect).failure;
        loop {
            let without_kill = (0..self.kills.len()).map(|place| {
                let mut smaller = self.clone();
                smaller.kills.remove(place);
                smaller
            });
            let without_plan = (0..self.planned.len()).map(|place| {
                let mut smaller = self.clone();
                smaller.planned.remove(place);
                smaller
                    .planned
                    .iter_mut()
                    .enumerate()
                    .for_each(|(place, outage)| outage.place = place);
                smaller
            });
            let shorter = (1..self.graph.ticks).map(|ticks| {
                let mut smaller = self.clone();
                smaller.graph.ticks = ticks;
                smaller
            });
            let found = without_kill
                .chain(without_plan)
                .chain(shorter)
                .find_map(|one| one.check(defect).failure.map(|failure| (one, failure)));
            match found {
                Some((smaller, why)) => (self, failure) = (smaller, Some(why)),
                None => return (self, failure),
            }
        }
    }

    fn in_words(&self) -> String {
        let Graph {
            reads,
            outputs,
            ticks,
        } = &self.graph;
        let planned: Vec<_> = self
            .planned
            .iter()
            .map(|one| (one.process, one.at, one.until, one.after_outputs))
            .collect();
        let room = if self.room == u64::MAX {
            String::new()
        } else {
            format!(", room for {} blocks", self.room)
        };
        let graph = format!("{ticks} ticks, outputs {outputs:?}, reads {reads:?}{room}");
        format!(
            "{graph}, killed at (step, process) {:?}, planned (process, at, until, after) {planned:?}",
            self.kills
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn random_histories_keep_every_guarantee_and_repeat_themselves() {
        let mut deaths = 0;
        for number in 0..3_000 {
            let outcome = history(1, number, Defect::None);
            assert_eq!(outcome.failure, None);
            deaths += outcome.deaths;
        }
        assert!(deaths > 3_000, "only {deaths} deaths");
    }

    #[test]
    fn each_defect_that_is_put_in_is_found_and_shrunk() {
        for defect in Defect::all() {
            let found = (0..3_000).find_map(|number| history(1, number, defect).failure);
            let found = found.unwrap_or_else(|| panic!("{defect:?} is not found"));
            println!("{defect:?}: {found}");
            assert!(found.contains("smallest"), "{found}");
        }
    }
}
