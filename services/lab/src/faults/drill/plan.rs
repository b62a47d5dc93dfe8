//! The plans of a drill: every kind of fault in every way on every process, and pairs.

use model::Robot;
use runtime::random;
use shared_types::fault::{Fault, Kind, Way};
use shared_types::graph::Graph;

/// Faults and their processes; two of them for a pair.
pub(super) type Plan = Vec<Fault>;

/// One cell: `PROCESS:KIND`, or `PROCESS:KIND:WAY`.
pub(super) struct Only {
    process: String,
    kind: Kind,
    way: Option<Way>,
}

impl Only {
    /// Where no process of the graph has this cell: the processes that this kind of fault applies to.
    pub(super) fn remedy(&self, graph: &Graph) -> String {
        let names: Vec<&str> = graph
            .process
            .iter()
            .filter(|process| graph.takes(self.kind, process))
            .map(|process| process.name.as_str())
            .collect();
        format!("`{}` can happen to {}", self.kind, names.join(", "))
    }

    pub(super) fn parse(text: &str) -> Result<Self, String> {
        let wrong = |reason: String| format!("--only {text}: {reason}");
        let mut parts = text.split(':');
        let (Some(process), Some(kind), way, None) =
            (parts.next(), parts.next(), parts.next(), parts.next())
        else {
            return Err(wrong("give PROCESS:KIND, or PROCESS:KIND:WAY".to_owned()));
        };
        let kind: Kind = kind.parse().map_err(wrong)?;
        Ok(Self {
            process: process.to_owned(),
            kind,
            way: way.map(str::parse).transpose().map_err(wrong)?,
        })
    }

    fn takes(&self, fault: &Fault) -> bool {
        fault.process == self.process
            && fault.kind == self.kind
            && (self.way.is_none() || fault.way == self.way)
    }
}

/// The subject of a plan.
pub(super) struct Terms<'a> {
    /// The graph.
    pub graph: &'a Graph,
    /// Of when the faults are injected, and of the pairs.
    pub seed: u64,
    /// Ticks of the task, in the middle of which faults are injected.
    pub span: u64,
    /// The arm.
    pub robot: &'a Robot,
}

/// Every kind in every way for every process, and a seeded sample of pairs of them.
pub(super) fn plans(terms: &Terms<'_>, only: Option<&Only>, pairs: u32) -> Vec<Plan> {
    let mut singles = Vec::new();
    for process in &terms.graph.process {
        for &kind in Kind::ALL
            .iter()
            .filter(|kind| terms.graph.takes(**kind, process))
        {
            let ways: Vec<_> = kind.ways().map(Some).collect();
            for way in if ways.is_empty() { vec![None] } else { ways } {
                singles.push(Fault {
                    way,
                    ..Fault::new(&process.name, kind)
                });
            }
        }
    }
    let seed = terms.seed;
    let draw = |index: u64, what: u64| random(seed ^ 0xd411, 16 * index + what);
    let span = terms.span;
    let placed = |fault: &Fault, index: u64, what: u64| {
        // In the middle of the motion, each at another place.
        let at = span / 4 + draw(index, what) % (span / 2).max(1);
        let needs_joint = fault.kind.concerns_joint();
        let joint =
            needs_joint.then(|| 1 + (draw(index, what + 1) % terms.robot.dof() as u64) as u32);
        Fault {
            at_tick: Some(at),
            joint,
            ..fault.clone()
        }
    };
    // A share of a torque limit that a joint has not is no fault.
    let is_one = |plan: &Plan| {
        plan.iter()
            .all(|fault| !session::lacks_limit(fault, terms.robot))
    };
    if let Some(only) = only {
        let chosen = singles
            .iter()
            .enumerate()
            .filter(|(_, fault)| only.takes(fault));
        return chosen
            .map(|(index, fault)| vec![placed(fault, index as u64, 0)])
            .filter(is_one)
            .collect();
    }
    let single = singles
        .iter()
        .enumerate()
        .map(|(index, fault)| vec![placed(fault, index as u64, 0)]);
    let pair = (0..u64::from(pairs)).map(|index| {
        let index = index + singles.len() as u64;
        let pick = |what: u64| &singles[(draw(index, what) % singles.len() as u64) as usize];
        let first = placed(pick(2), index, 4);
        // Close enough to meet.
        let second = Fault {
            at_tick: first.at_tick.map(|at| at + draw(index, 6) % 60),
            ..placed(pick(3), index, 8)
        };
        vec![first, second]
    });
    single.chain(pair).filter(is_one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cell_of_every_graph_can_be_scheduled() {
        let robot = Robot::builtin("puma560").unwrap();
        for is_steered in [false, true] {
            let graph = Graph::built_in(is_steered).unwrap();
            let plans = plans(
                &Terms {
                    graph: &graph,
                    seed: 1,
                    span: 1000,
                    robot: &robot,
                },
                None,
                200,
            );
            for fault in plans.iter().flatten() {
                let target = graph.target(&fault.process).unwrap();
                assert!(
                    fault.schedule(&target, 1000, 1).is_ok(),
                    "{fault}: {:?}",
                    fault.schedule(&target, 1000, 1)
                );
            }
            let has = |process: &str, kind: Kind| {
                plans
                    .iter()
                    .flatten()
                    .any(|fault| fault.process == process && fault.kind == kind)
            };
            assert!(has("plant", Kind::Corrupt) && has("controller", Kind::Corrupt));
            assert_eq!(
                (has("operator", Kind::Kill), has("operator", Kind::Corrupt)),
                (is_steered, false),
                "its targets have no number"
            );
        }
    }

    #[test]
    fn a_cell_is_named_by_process_kind_and_way() {
        let only = Only::parse("plant:sensor:drift").unwrap();
        assert!(only.takes(&Fault {
            way: Some(Way::Drift),
            ..Fault::new("plant", Kind::Sensor)
        }));
        assert!(!only.takes(&Fault {
            way: Some(Way::Bias),
            ..Fault::new("plant", Kind::Sensor)
        }));
        let wrong = |text: &str| Only::parse(text).err().unwrap_or_default();
        assert!(wrong("recorder:drops").contains("there is no `drops`"));
        assert!(wrong("recorder").contains("PROCESS:KIND"));
    }
}
