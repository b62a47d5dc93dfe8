//! Tries every schedule of small graphs. No process may wait for ever, no tick may be lost or
//! answered twice, messages must not depend on the schedule, and the plan that the launcher
//! recovers after deaths at any moment must repeat them.

use std::collections::{BTreeMap, BTreeSet, HashSet};

use super::world::{Graph, Run, Sent, digest};
use crate::protocol::Outage;

/// All runs after one step, of a process or of death.
fn next(run: &Run, kills: u32) -> Vec<(Run, u32)> {
    let mut all = Vec::new();
    for me in 0..run.processes.len() {
        let mut stepped = run.clone();
        if stepped.step_of(me) {
            all.push((stepped, kills));
        }
        if me > 0 && kills > 0 && run.is_alive(me) {
            let mut killed = run.clone();
            killed.kill(me);
            all.push((killed, kills - 1));
        }
    }
    all
}

/// By process, tick and outputs of each death: the plan, and the messages with which a run of it has ended.
type Ends = BTreeMap<Vec<(usize, u64, u32)>, (Vec<Outage>, BTreeSet<Vec<Vec<Sent>>>)>;

/// The results of all schedules.
#[derive(Default)]
struct Explored {
    states: usize,
    ends: Ends,
    /// Of the first run that breaks a guarantee, or in which no process can go on.
    failure: Option<String>,
}

fn explore(graph: &Graph, outages: &[Outage], kills: u32) -> Explored {
    let first = (graph.begin(outages, None), kills);
    let (mut seen, mut open, mut explored) = (
        HashSet::from([digest(&first)]),
        vec![first],
        Explored::default(),
    );
    while let Some((run, kills)) = open.pop() {
        explored.states += 1;
        let next = next(&run, kills);
        if run.broken.is_some() || next.is_empty() && !run.is_over() {
            let at: Vec<_> = run.processes.iter().map(|one| (one.at, one.tick)).collect();
            let failure = format!(
                "{:?}, or all wait: {at:?} with {:?}",
                run.broken, run.outages
            );
            explored.failure.get_or_insert(failure);
        } else if !run.is_over() {
            open.extend(next.into_iter().filter(|next| seen.insert(digest(next))));
        } else if !run.has_failed {
            let death = |outage: &Outage| (outage.process, outage.at, outage.after_outputs);
            let key = run.outages.iter().map(death).collect();
            let end = explored.ends.entry(key);
            end.or_insert_with(|| (run.plan(), BTreeSet::new()))
                .1
                .insert(run.messages());
        }
    }
    explored
}

/// Explores deaths at all moments, and each plan that they leave: the states, and the plans.
fn check(graph: &Graph, kills: u32) -> (usize, usize) {
    let live = explore(graph, &[], kills);
    assert_eq!(live.failure, None);
    let mut states = live.states;
    for (plan, messages) in live.ends.values() {
        let planned = explore(graph, plan, 0);
        states += planned.states;
        assert_eq!((planned.failure, messages.len()), (None, 1), "{plan:?}");
        let again = planned
            .ends
            .into_values()
            .flat_map(|(_, messages)| messages);
        assert_eq!(again.collect::<BTreeSet<_>>(), *messages, "{plan:?}");
    }
    (states, live.ends.len())
}

fn pair(ticks: u64) -> Graph {
    Graph {
        reads: vec![vec![], vec![(0, 0)]],
        outputs: vec![1, 2],
        ticks,
    }
}

fn chain() -> Graph {
    Graph {
        reads: vec![vec![], vec![(0, 0)], vec![(1, 0), (0, 0)]],
        outputs: vec![1, 1, 2],
        ticks: 4,
    }
}

/// A chain beside a process whose messages no process reads.
fn leaf() -> Graph {
    Graph {
        reads: vec![vec![], vec![(0, 0)], vec![(0, 0)]],
        outputs: vec![1, 1, 1],
        ticks: 6,
    }
}

/// The default graph without its recorder.
fn default_graph() -> Graph {
    Graph {
        reads: vec![vec![], vec![(0, 0)], vec![(1, 0)], vec![(2, 0), (1, 0)]],
        outputs: vec![1, 1, 1, 2],
        ticks: 4,
    }
}

#[test]
fn deaths_at_every_moment_of_every_schedule_are_repeated_by_their_plan() {
    let graphs = [
        ("pair", pair(5), 4),
        ("pair", pair(8), 3),
        ("chain", chain(), 3),
        ("leaf", leaf(), 2),
        ("default", default_graph(), 2),
    ];
    for (name, graph, kills) in graphs {
        let (states, plans) = check(&graph, kills);
        println!("{name}: {states} states, {plans} plans of up to {kills} deaths");
        assert!(states > 1_000 && plans > 10, "{name}: {states}, {plans}");
    }
}
