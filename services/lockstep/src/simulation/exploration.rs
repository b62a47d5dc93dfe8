//! Every schedule of small graphs: no process waits for ever, no tick is lost or answered twice, messages do not depend on the schedule, and the plan
//! that the launcher recovers from deaths at any moment repeats them.

use std::collections::{BTreeMap, BTreeSet, HashSet};

use super::defect::{Defect, digest};
use super::machine::{At, Graph, Place, State};
use crate::protocol::Outage;

impl State {
    /// All states after one step.
    fn next(&self, graph: &Graph, defect: Defect) -> Vec<Self> {
        let mut all = Vec::new();
        for me in 0..graph.reads.len() {
            let mut next = self.clone();
            if next.step(graph, me, defect) {
                all.push(next);
            }
            if me > 0
                && self.kills_left > 0
                && !matches!(self.at[me], At::Dead | At::Detected | At::Done)
            {
                let mut next = self.clone();
                next.kills_left -= 1;
                next.kill(me);
                all.push(next);
            }
        }
        all
    }
}

/// By process, tick and outputs of each death: the plan, and the messages with which a run of it has ended.
type Ends = BTreeMap<Vec<(usize, u64, u32)>, (Vec<Outage>, BTreeSet<BTreeMap<Place, u64>>)>;

/// The results of all schedules.
#[derive(Default)]
struct Explored {
    states: usize,
    ends: Ends,
    /// The first state from which no process can go on.
    stuck: Option<State>,
}

fn explore(graph: &Graph, outages: &[Outage], kills: u32, defect: Defect) -> Explored {
    let first = State::new(graph, outages, kills, defect);
    let (mut seen, mut open, mut explored) = (
        HashSet::from([digest(&first)]),
        vec![first],
        Explored::default(),
    );
    while let Some(state) = open.pop() {
        explored.states += 1;
        if state.broken.is_some() {
            explored.stuck.get_or_insert(state);
            continue;
        }
        if state.has_failed {
            continue;
        }
        if state.at.iter().all(|at| *at == At::Done) {
            let key = state
                .outages
                .iter()
                .map(|outage| (outage.process, outage.at, outage.after_outputs))
                .collect();
            explored
                .ends
                .entry(key)
                .or_insert_with(|| (state.plan(), BTreeSet::new()))
                .1
                .insert(state.retainer);
            continue;
        }
        let next = state.next(graph, defect);
        if next.is_empty() {
            explored.stuck.get_or_insert(state);
            continue;
        }
        open.extend(next.into_iter().filter(|next| seen.insert(digest(next))));
    }
    explored
}

/// Explores deaths at all moments, and each plan that they leave; the states, the plans, and the first defect found.
fn check(graph: &Graph, kills: u32, defect: Defect) -> (usize, usize, Option<String>) {
    let live = explore(graph, &[], kills, defect);
    let (mut states, plans) = (live.states, live.ends.len());
    let mut found = live.stuck.map(|state| {
        format!(
            "{:?}, or no process can go on: {:?} at {:?} with {:?}",
            state.broken, state.at, state.tick, state.outages
        )
    });
    for (plan, messages) in live.ends.values() {
        let planned = explore(graph, plan, 0, defect);
        states += planned.states;
        let again: BTreeSet<_> = planned
            .ends
            .into_values()
            .flat_map(|(_, messages)| messages)
            .collect();
        if found.is_none() && (planned.stuck.is_some() || messages.len() != 1 || again != *messages)
        {
            let stuck = planned.stuck.is_some();
            found = Some(format!(
                "{plan:?}: {} and {} results, stuck: {stuck}",
                messages.len(),
                again.len()
            ));
        }
    }
    (states, plans, found)
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
        let (states, plans, found) = check(&graph, kills, Defect::None);
        println!("{name}: {states} states, {plans} plans of up to {kills} deaths");
        assert_eq!(found, None, "{name}");
        assert!(
            states > 1_000 && plans > 10,
            "{name}: {states} states, {plans} plans"
        );
    }
}

#[test]
fn the_exploration_finds_each_defect_that_is_put_in() {
    for defect in Defect::OF_THE_CHAIN {
        let is_found = |graph: &Graph, kills| {
            let (.., found) = check(graph, kills, defect);
            found.is_some()
        };
        assert!(
            is_found(&chain(), 2) || is_found(&pair(5), 2) || is_found(&leaf(), 0),
            "{defect:?}"
        );
    }
}
