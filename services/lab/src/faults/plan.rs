//! Plans of faults, drawn from a seed: the grid of a drill.

use model::Robot;
use runtime::random;
use shared_types::fault::{Fault, Kind, Way};
use shared_types::graph::{Graph, Process};
use shared_types::process::Program;

/// Whether a fault takes the simulated world with it: then the run ends, cleanly, and there is no arm to be judged any more.
pub(super) fn ends_world(fault: &Fault) -> bool {
    fault.process == Program::Plant.name() && fault.kind.ends_process(fault.way)
}

/// Every kind in every way for every process.
fn every(graph: &Graph) -> Vec<Fault> {
    let mut all = Vec::new();
    for process in &graph.process {
        for &kind in Kind::ALL.iter().filter(|kind| graph.takes(**kind, process)) {
            let mut ways: Vec<_> = kind.ways().map(Some).collect();
            ways.resize(ways.len().max(1), None);
            all.extend(ways.into_iter().map(|way| Fault {
                way,
                ..Fault::new(&process.name, kind)
            }));
        }
    }
    all
}

/// One cell of the grid: `PROCESS:KIND`, or `PROCESS:KIND:WAY`.
pub(super) struct Only {
    process: String,
    kind: Kind,
    way: Option<Way>,
}

impl Only {
    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let wrong = |reason: String| format!("--only {text}: {reason}");
        let parts: Vec<&str> = text.split(':').collect();
        let (process, kind, way) = match parts[..] {
            [process, kind] => (process, kind, None),
            [process, kind, way] => (process, kind, Some(way)),
            _ => return Err(wrong("give PROCESS:KIND, or PROCESS:KIND:WAY".to_owned())),
        };
        Ok(Self {
            process: process.to_owned(),
            kind: kind.parse().map_err(wrong)?,
            way: way.map(str::parse).transpose().map_err(wrong)?,
        })
    }

    /// Where no process of the graph has this cell: the processes that this kind of fault applies to.
    pub(super) fn remedy(&self, graph: &Graph) -> String {
        let takes = |process: &&Process| graph.takes(self.kind, process);
        let names: Vec<&str> = graph
            .process
            .iter()
            .filter(takes)
            .map(|process| process.name.as_str())
            .collect();
        format!("`{}` can happen to {}", self.kind, names.join(", "))
    }

    fn takes(&self, fault: &Fault) -> bool {
        fault.process == self.process
            && fault.kind == self.kind
            && (self.way.is_none() || fault.way == self.way)
    }
}

/// Every fault alone, and a seeded sample of pairs, each in the middle of a task of `span` ticks.
pub(super) fn grid(
    robot: &Robot,
    graph: &Graph,
    seed: u64,
    span: u64,
    only: Option<&Only>,
    pairs: u32,
) -> Vec<Vec<Fault>> {
    let every = every(graph);
    let draw = |index: usize, what: u64| random(seed ^ 0xd411, 16 * index as u64 + what);
    let placed = |fault: &Fault, index: usize, what: u64| Fault {
        at_tick: Some(span / 4 + draw(index, what) % (span / 2).max(1)),
        joint: (fault.kind.concerns_joint())
            .then(|| 1 + (draw(index, what + 1) % robot.dof() as u64) as u32),
        ..fault.clone()
    };
    let is_wanted = |fault: &Fault| only.is_none_or(|only| only.takes(fault));
    let single = every
        .iter()
        .enumerate()
        .filter(|(_, fault)| is_wanted(fault));
    let single = single.map(|(index, fault)| vec![placed(fault, index, 0)]);
    let pairs = if only.is_some() { 0 } else { pairs as usize };
    let pair = (every.len()..every.len() + pairs).map(|index| {
        let pick = |what: u64| &every[(draw(index, what) % every.len() as u64) as usize];
        let first = placed(pick(2), index, 4);
        // Close enough to meet.
        let at_tick = first.at_tick.map(|at| at + draw(index, 6) % 60);
        let second = Fault {
            at_tick,
            ..placed(pick(3), index, 8)
        };
        vec![first, second]
    });
    // A share of a torque limit that a joint has not is no fault.
    let is_one = |plan: &Vec<Fault>| plan.iter().all(|fault| !session::lacks_limit(fault, robot));
    single.chain(pair).filter(is_one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_is_tried_alone_and_can_be_scheduled() {
        let robot = Robot::builtin("puma560").unwrap();
        for is_steered in [false, true] {
            let graph = Graph::built_in(is_steered).unwrap();
            let [grid, again, other] =
                [1, 1, 2].map(|seed| grid(&robot, &graph, seed, 1000, None, 200));
            assert!(
                grid == again && grid != other,
                "a seed draws the same again"
            );
            for fault in grid.iter().flatten() {
                let target = graph.target(&fault.process).unwrap();
                assert!(fault.schedule(&target, 1000, 1).is_ok(), "{fault}");
            }
            let alone = grid.iter().filter(|plan| plan.len() == 1);
            assert_eq!(alone.count(), every(&graph).len());
        }
    }

    #[test]
    fn a_cell_is_named_by_process_kind_and_way() {
        let only = Only::parse("plant:sensor:drift").unwrap();
        let way = |way| Fault {
            way: Some(way),
            ..Fault::new("plant", Kind::Sensor)
        };
        assert!(only.takes(&way(Way::Drift)) && !only.takes(&way(Way::Bias)));
        assert!(Only::parse("recorder:drops").is_err() && Only::parse("recorder").is_err());
    }
}
