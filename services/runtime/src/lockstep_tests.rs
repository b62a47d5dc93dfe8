//! Small graphs with random outages under random scheduling: no wait for ever, every tick closed once, and messages that do not depend on
//! the order in which processes run.

use std::collections::{BTreeMap, BTreeSet};

use super::*;
use shared_types::random::at as random;

/// Ticks of a simulated run.
const TICKS: u64 = 40;

/// Where a process is between two steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum At {
    /// Dead; the launcher starts it again at some step.
    Dead,
    /// At the beginning of its tick in hand.
    Tick,
    /// The tick source, waiting for the torque of its tick.
    Torque,
    /// It has sent its message and not closed the tick.
    Sent,
    /// Through with all ticks.
    Done,
}

/// A run in one thread: the source is process 0, process i > 0 reads `reads[i]`, the last one writes the torque.
struct Run {
    reads: Vec<Vec<usize>>,
    progress: Vec<Progress>,
    at: Vec<At>,
    tick: Vec<u64>,
    outages: Vec<Outage>,
    has_faults: bool,
    /// By writer and tick: the incarnation that sent.
    sent: BTreeMap<(usize, u64), u32>,
    /// Closings by process.
    closed: Vec<BTreeSet<u64>>,
}

impl View for Run {
    fn processes(&self) -> usize {
        self.reads.len()
    }
    fn role(&self, process: usize) -> Role {
        Role { makes_ticks: process == 0, polled: false, is_leaf: false }
    }
    fn progress(&self, process: usize) -> Progress {
        self.progress[process]
    }
    fn has_faults(&self) -> bool {
        self.has_faults
    }
    fn outages(&self) -> impl Iterator<Item = Outage> {
        self.outages.iter().copied()
    }
    fn is_lockstep(&self) -> bool {
        true
    }
}

impl Run {
    fn new(reads: &[Vec<usize>], outages: &[Outage]) -> Self {
        let count = reads.len();
        let progress = Progress { ticks: 0, incarnation: 1, is_running: true, awaits_progress: false };
        Self {
            reads: reads.to_vec(),
            progress: vec![progress; count],
            at: vec![At::Tick; count],
            tick: vec![0; count],
            outages: outages.to_vec(),
            has_faults: !outages.is_empty(),
            sent: BTreeMap::new(),
            closed: vec![BTreeSet::new(); count],
        }
    }

    fn protocol(&self, me: usize) -> Protocol<'_, Self> {
        Protocol::new(self, me)
    }

    fn close(&mut self, me: usize) {
        let tick = self.tick[me];
        assert!(self.closed[me].insert(tick), "process {me} closes tick {tick} twice");
        self.progress[me].ticks = tick + 1;
        self.tick[me] = tick + 1;
        self.at[me] = if tick + 1 == TICKS { At::Done } else { At::Tick };
    }

    fn fall(&mut self, me: usize, place: usize) {
        self.outages[place].has_struck = true;
        self.progress[me].is_running = false;
        self.at[me] = At::Dead;
    }

    /// One step of a process; whether it could take any.
    fn step(&mut self, me: usize) -> bool {
        match (self.at[me], me) {
            (At::Done, _) => false,
            (At::Dead, _) => {
                self.progress[me].incarnation += 1;
                if let Some(outage) = self.protocol(me).downfall_at_start() {
                    self.fall(me, outage.place);
                    return true;
                }
                let back = self.protocol(me).returns_at();
                self.progress[me].ticks = self.protocol(me).skips_to(back).unwrap_or(self.progress[me].ticks);
                self.tick[me] = self.progress[me].ticks;
                self.progress[me].is_running = true;
                self.at[me] = if self.tick[me] >= TICKS { At::Done } else { At::Tick };
                true
            }
            (At::Sent, 0) => {
                let tick = self.tick[0];
                assert!(self.closed[0].insert(tick), "the source closes tick {tick} twice");
                self.progress[0].ticks = tick + 1;
                self.at[0] = At::Torque;
                true
            }
            (At::Sent, _) => {
                self.close(me);
                true
            }
            (At::Tick, 0) => {
                let tick = self.tick[0];
                if self.protocol(0).holds_back(tick).is_some() {
                    return false;
                }
                self.sent.insert((0, tick), 1);
                self.at[0] = At::Sent;
                true
            }
            (At::Torque, _) => {
                let (last, tick) = (self.reads.len() - 1, self.tick[0]);
                let is_over = self.sent.contains_key(&(last, tick)) || self.protocol(0).has_closed(Some(last), tick);
                if is_over {
                    self.tick[0] = tick + 1;
                    self.at[0] = if tick + 1 == TICKS { At::Done } else { At::Tick };
                }
                is_over
            }
            (At::Tick, _) => {
                let tick = self.tick[me];
                let (mut has_all, mut is_first) = (true, true);
                for writer in self.reads[me].clone() {
                    let has_it = self.sent.contains_key(&(writer, tick));
                    if !has_it && !self.protocol(me).has_closed(Some(writer), tick) {
                        return false;
                    }
                    if std::mem::take(&mut is_first)
                        && let Some(outage) = self.protocol(me).downfall(tick)
                    {
                        self.fall(me, outage.place);
                        return true;
                    }
                    has_all &= has_it;
                    if !has_it {
                        break;
                    }
                }
                if has_all {
                    let again = self.sent.insert((me, tick), self.progress[me].incarnation);
                    assert_eq!(again, None, "process {me} sends tick {tick} twice");
                    self.at[me] = At::Sent;
                } else {
                    self.close(me);
                }
                true
            }
        }
    }

    /// Runs to the end under one schedule.
    fn finish(&mut self, seed: u64) {
        let count = self.reads.len();
        for step in 0.. {
            if self.at.iter().all(|at| *at == At::Done) {
                return;
            }
            let begin = random(seed, step) as usize;
            let moved = (0..count).any(|i| self.step((begin + i) % count));
            assert!(moved, "nobody can go on: {:?} at {:?} with {:?}", self.at, self.tick, self.outages);
        }
    }
}

/// A chain in which each process reads the one before it and, by chance, earlier ones.
fn graph(seed: u64) -> Vec<Vec<usize>> {
    let count = 2 + (random(seed, 0) % 4) as usize;
    let reads = |me: usize| {
        let more = (0..me.saturating_sub(1)).filter(|other| random(seed, (10 * me + other) as u64).is_multiple_of(3));
        std::iter::once(me.saturating_sub(1)).chain(more).collect()
    };
    (0..count).map(|me| if me == 0 { Vec::new() } else { reads(me) }).collect()
}

fn outages(seed: u64, processes: usize) -> Vec<Outage> {
    let draw = |index: u64| random(seed ^ 0xfa57, index);
    let outage = |place: usize| {
        let number = 10 * place as u64;
        let at = draw(number) % (TICKS - 8);
        Outage {
            place,
            process: 1 + (draw(number + 1) as usize) % (processes - 1),
            at,
            until: at + 1 + draw(number + 2) % 7,
            has_struck: false,
            is_death: true,
            is_unplanned: false,
            after_outputs: 0,
        }
    };
    (0..(draw(999) % 4) as usize).map(outage).collect()
}

#[test]
fn no_process_waits_for_ever_and_messages_do_not_depend_on_the_schedule() {
    let mut deaths = 0;
    for seed in 0..4_000 {
        let reads = graph(seed);
        let outages = outages(seed, reads.len());
        let run = |schedule: u64| {
            let mut run = Run::new(&reads, &outages);
            run.finish(schedule);
            run
        };
        let (one, other) = (run(seed), run(!seed));
        assert_eq!(one.sent, other.sent, "seed {seed}: {reads:?} {outages:?}");
        for (process, closed) in one.closed.iter().enumerate() {
            let is_missing = |tick: &u64| !closed.contains(tick) && !one.protocol(process).is_down(process, *tick);
            assert_eq!((0..TICKS).find(is_missing), None, "seed {seed}: process {process} never closes it; {reads:?} {outages:?}");
        }
        deaths += one.progress.iter().map(|progress| progress.incarnation - 1).sum::<u32>();
    }
    assert!(deaths > 4_000, "only {deaths} deaths");
}

#[test]
fn a_process_that_dies_again_before_it_answers_has_the_incarnation_of_both_deaths() {
    let death = |place, at, until| Outage {
        place,
        process: 1,
        at,
        until,
        has_struck: false,
        is_death: true,
        is_unplanned: false,
        after_outputs: 0,
    };
    let mut run = Run::new(&[vec![], vec![0]], &[death(0, 5, 10), death(1, 5, 12)]);
    run.finish(3);
    assert_eq!(run.progress[1].incarnation, 3);
    assert_eq!((run.sent.get(&(1, 4)), run.sent.get(&(1, 11)), run.sent.get(&(1, 12))), (Some(&1), None, Some(&3)));
}

#[test]
fn without_faults_nobody_reports_and_only_a_recorder_holds_back() {
    struct Healthy;
    impl View for Healthy {
        fn processes(&self) -> usize {
            3
        }
        fn role(&self, process: usize) -> Role {
            Role { makes_ticks: process == 0, polled: process == 2, is_leaf: false }
        }
        fn progress(&self, _: usize) -> Progress {
            Progress { ticks: 7, incarnation: 1, is_running: true, awaits_progress: true }
        }
        fn has_faults(&self) -> bool {
            false
        }
        fn outages(&self) -> impl Iterator<Item = Outage> {
            std::iter::empty()
        }
        fn is_lockstep(&self) -> bool {
            true
        }
    }
    let source = Protocol::new(&Healthy, 0);
    assert_eq!((source.reports_to(), source.returns_at(), source.downfall(7)), (Report::Nobody, 0, None));
    assert_eq!((source.holds_back(7 + RECORDER_LAG), source.holds_back(8 + RECORDER_LAG)), (None, Some(2)));
    assert!(source.has_closed(Some(1), 6) && !source.has_closed(Some(1), 7) && !source.has_closed(None, 0));
    assert!(source.is_settled(7) && !source.is_settled(8));
}
