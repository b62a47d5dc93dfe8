//! One random history: a graph, planned and random deaths, slow wake-ups, and the repetition from
//! the plan that it leaves.

use shared_types::random::at as random;
use std::iter;

use super::recorder::Recorder;
use super::world::{DOWN, Graph, Run};
use crate::engine::Process;
use crate::protocol::Outage;

/// Steps after which a history counts as endless.
const MOST_STEPS: u64 = 200_000;
/// How many schedules repeat a history from its plan.
const REPETITIONS: u64 = 2;

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

impl History {
    fn draw(seed: u64) -> Self {
        let draw = |what: u64, most: u64| random(seed, what) % most.max(1);
        let count = 2 + draw(0, 4) as usize;
        let more = (1..count as u64).map(|process| draw(10 + process, 3) as usize);
        let outputs: Vec<usize> = iter::once(0).chain(more).map(|more| 1 + more).collect();
        let reads = |me: usize| {
            // One process in four is not read by the next one.
            let is_passed_over = me > 1 && draw(500 + me as u64, 4) == 0;
            let before = me - 1 - usize::from(is_passed_over);
            let more = (0..before).filter(|other| draw((100 + 10 * me + other) as u64, 3) == 0);
            let output = |writer: usize| {
                let output = draw((200 + 10 * me + writer) as u64, outputs[writer] as u64);
                (writer, output as usize)
            };
            iter::once(before).chain(more).map(output).collect()
        };
        let reads: Vec<Vec<(usize, usize)>> = (0..count)
            .map(|me| if me == 0 { Vec::new() } else { reads(me) })
            .collect();
        let ticks = 4 + draw(1, 28);
        let steps = ticks * (outputs.iter().sum::<usize>() as u64 + count as u64) * 3;
        // The recorder comes after the processes of the graph.
        let victim = |what: u64| 1 + draw(what, count as u64) as usize;
        let planned = |place: u64| {
            let (at, process) = (draw(400 + place, ticks), victim(410 + place));
            let most = outputs.get(process).map_or(0, |outputs| *outputs as u64);
            let after_outputs = draw(420 + place, most) as u32;
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
        let room = match draw(5, 3) {
            0 => draw(6, 40),
            _ => u64::MAX,
        };
        Self {
            graph: Graph {
                reads,
                outputs,
                ticks,
            },
            kills: kills(seed, steps, count as u64),
            planned,
            schedule: random(seed, 4),
            room,
        }
    }

    /// Runs to the end under one schedule.
    fn run(&self, run: &mut Run, kills: &[(u64, usize)], schedule: u64) -> Result<(), String> {
        let count = run.processes.len();
        let mut kills = kills.iter().copied().peekable();
        // In one history of four the recorder is hardly ever awake.
        let is_starved = random(schedule, u64::MAX).is_multiple_of(4);
        for step in 0..MOST_STEPS {
            while let Some((_, victim)) = kills.next_if(|kill| kill.0 <= step) {
                run.kill(victim);
            }
            if run.is_over() {
                let recorder = run.world.recorder.as_mut().filter(|_| !run.has_failed);
                return recorder.and_then(Recorder::lack).map_or(Ok(()), Err);
            }
            let first = random(schedule, step) as usize;
            // A process that sleeps does nothing for a while, as long as others can.
            let draw = |me: usize| random(schedule ^ (1 + me as u64), step / 41);
            let sleeps = |me: usize| match is_starved && me + 1 == count {
                true => draw(me) % 12 > 0,
                false => draw(me).is_multiple_of(3),
            };
            // The last turn: the recorder has looked before the source began to wait.
            let mut order = (0..3 * count).map(|turn| (turn >= count, (first + turn) % count));
            let has_moved = order.any(|(is_late, me)| (is_late || !sleeps(me)) && run.step_of(me));
            if let Some(broken) = run.broken {
                return Err(broken.to_owned());
            }
            if !has_moved {
                let at: Vec<_> = run.processes.iter().map(|one| (one.at, one.tick)).collect();
                return Err(format!("no process can go on: {at:?}"));
            }
        }
        Err("it does not end".to_owned())
    }

    /// Runs it, and repeats it from its plan; how many deaths it had.
    fn check(&self) -> Result<u64, String> {
        let begin = |planned: &[Outage]| self.graph.begin(planned, Some(self.room));
        let mut live = begin(&self.planned);
        self.run(&mut live, &self.kills, self.schedule)?;
        for repetition in 1..=if live.has_failed { 0 } else { REPETITIONS } {
            let mut again = begin(&live.plan());
            self.run(&mut again, &[], random(self.schedule, repetition))
                .map_err(|failure| format!("its plan: {failure}"))?;
            if live.messages() != again.messages() {
                return Err("its plan gives other messages".to_owned());
            }
        }
        let deaths = |one: &Process<_, _>| u64::from(one.progress.incarnation) - 1;
        Ok(live.processes.iter().map(deaths).sum())
    }
}

/// Deaths at random steps: of each the step and the process.
fn kills(seed: u64, steps: u64, processes: u64) -> Vec<(u64, usize)> {
    let draw = |what: u64, most: u64| random(seed, what) % most.max(1);
    let mut kills: Vec<(u64, usize)> = Vec::new();
    for number in 0..draw(2, 6) {
        // Every second one soon after the one before: while that is detected, or its replacement starts.
        let last = kills.last().filter(|_| draw(300 + number, 2) == 0);
        let near = last.map(|last| last.0 + draw(310 + number, 12));
        let step = near.unwrap_or_else(|| draw(320 + number, steps));
        kills.push((step, 1 + draw(330 + number, processes) as usize));
    }
    kills.sort_unstable();
    kills
}

#[test]
fn random_histories_keep_every_guarantee_and_repeat_themselves() {
    let stated = std::env::var("HISTORIES").map(|count| count.parse().expect("a number"));
    let (count, mut deaths) = (stated.unwrap_or(3_000), 0);
    for number in 0..count {
        let history = History::draw(random(1, number));
        match history.check() {
            Ok(more) => deaths += more,
            Err(failure) => panic!("history {number}: {failure}: {history:?}"),
        }
    }
    assert!(deaths > count, "only {deaths} deaths");
}
