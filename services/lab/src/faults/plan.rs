//! Plans of faults, drawn from a seed: the grid of a drill, and the rounds of a soak.

use std::collections::VecDeque;

use model::Robot;
use runtime::random;
use shared_types::fault::{Fault, Kind, Way};
use shared_types::graph::{Graph, Process, Role};
use shared_types::process::Program;

/// Mean time from one fault of a soak to the next; s.
const MEAN_GAP_S: f64 = 1.4;

/// A round is left in peace for so long at its beginning, and for so long at its end, so that the arm can reach its goal; s.
const CALM_S: [f64; 2] = [1.0, 4.0];

/// A volume is full for so long before that at most, for nothing is recorded after it; s.
const FULL_S: f64 = 6.0;

/// One round in so many ends by design.
const FATAL_ONE_IN: u64 = 4;

/// Deaths of a process in a round: its budget is five restarts, and a stop can turn into one more death.
const MOST_DEATHS: usize = 4;

/// Deaths that spend the budget, and the time from one to the next, in which the replacement has begun to work; s.
const SPENT: (u64, f64) = (6, 0.35);

/// Faults of a round; the rest of the fault table is for deaths that the launcher detects.
const MOST_FAULTS: usize = 48;

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

/// Deals the faults of a soak from a shuffled deck, so that everything comes equally often over all rounds.
pub(super) struct Deck {
    graph: Graph,
    joints: u64,
    rate_hz: f64,
    deck: VecDeque<Fault>,
    fatal: VecDeque<Fault>,
    seed: u64,
    drawn: u64,
}

impl Deck {
    pub(super) fn new(robot: &Robot, graph: Graph, rate_hz: u32, seed: u64) -> Self {
        Self {
            graph,
            joints: robot.dof() as u64,
            rate_hz: f64::from(rate_hz),
            deck: VecDeque::new(),
            fatal: VecDeque::new(),
            seed: seed ^ 0x50a4,
            drawn: 0,
        }
    }

    fn below(&mut self, n: usize) -> usize {
        (self.unit() * n as f64) as usize
    }

    /// In [0, 1).
    fn unit(&mut self) -> f64 {
        self.drawn += 1;
        (random(self.seed, self.drawn) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// As likely to double as to halve.
    fn scaled(&mut self, value: f64, by: f64) -> f64 {
        value * by.powf(2.0 * self.unit() - 1.0)
    }

    fn ticks(&self, seconds: f64) -> u64 {
        (seconds * self.rate_hz).round().max(1.0) as u64
    }

    /// The faults of the next round of so many seconds, and whether it is to end by design.
    pub(super) fn round(&mut self, seconds: f64) -> Vec<Fault> {
        let [from, calm] = CALM_S.map(|s| s.min(0.25 * seconds));
        let (to, mut at_s, mut plan) = (seconds - calm, from, Vec::<Fault>::new());
        while plan.len() < MOST_FAULTS {
            at_s -= MEAN_GAP_S * (1.0 - self.unit()).ln();
            if at_s >= to {
                break;
            }
            let fault = self.next();
            let deaths = plan
                .iter()
                .filter(|one| one.process == fault.process && one.kind.takes_down());
            if fault.kind.takes_down() && deaths.count() >= MOST_DEATHS {
                self.deck.push_back(fault);
                continue;
            }
            let late_s = (to - FULL_S * self.unit()).max(at_s);
            let fault_s = if fault.kind == Kind::DiskFull {
                late_s
            } else {
                at_s
            };
            plan.push(self.detailed(fault, fault_s));
        }
        if self.below(FATAL_ONE_IN as usize) == 0 {
            self.end(&mut plan, to + 0.2 * calm);
        }
        plan
    }

    fn next(&mut self) -> Fault {
        loop {
            match self.deck.pop_front() {
                Some(fault) if ends_world(&fault) => self.fatal.push_back(fault),
                Some(fault) => return fault,
                None => {
                    let mut all = every(&self.graph);
                    for i in (1..all.len()).rev() {
                        all.swap(i, self.below(i + 1));
                    }
                    self.deck = all.into();
                }
            }
        }
    }

    /// The end of a round: the plant's, or that of a budget.
    fn end(&mut self, plan: &mut Vec<Fault>, at_s: f64) {
        if self.below(2) == 0
            && let Some(fault) = self.fatal.pop_front()
        {
            plan.push(self.detailed(fault, at_s));
            return;
        }
        let mortal = self
            .graph
            .process
            .iter()
            .filter(|process| process.role() != Role::World);
        let mortal: Vec<String> = mortal.map(|process| process.name.clone()).collect();
        let process = mortal[self.below(mortal.len())].clone();
        for death in 0..SPENT.0 {
            let kill = Fault::new(&process, Kind::Kill);
            plan.push(self.detailed(kill, at_s + SPENT.1 * death as f64));
        }
    }

    /// With a time, and with lengths, amounts and places of its own.
    fn detailed(&mut self, fault: Fault, at_s: f64) -> Fault {
        let target = self.graph.target(&fault.process);
        let (fields, reads) = target
            .map(|target| (target.fields, target.reads))
            .unwrap_or_default();
        let (kind, usual_s) = (fault.kind, fault.kind.usual_length_s());
        let for_s = usual_s.is_finite().then(|| self.scaled(usual_s, 5.0));
        let usual = fault.way.map_or(0.0, |way| kind.usual_amount(way));
        let is_signed = matches!(fault.way, Some(Way::Bias | Way::Drift));
        let sign = if is_signed && self.below(2) == 0 {
            -1.0
        } else {
            1.0
        };
        let amount = (usual > 0.0).then(|| sign * self.scaled(usual, 3.0));
        let is_part = kind.has_probability() && self.below(2) == 0;
        let field = (kind == Kind::Corrupt).then(|| {
            let fields: Vec<_> = fields.iter().filter(|field| field.is_number()).collect();
            let field = fields[self.below(fields.len())];
            format!(
                "{}[{}]",
                field.name,
                self.below(field.size / size_of::<f64>())
            )
        });
        let is_late = kind == Kind::Delay;
        Fault {
            at_tick: Some(self.ticks(at_s)),
            for_ticks: for_s.map(|s| self.ticks(s)),
            amount,
            probability: is_part.then(|| 0.05 + 0.95 * self.unit()),
            field,
            topic: (kind == Kind::Cut).then(|| reads[self.below(reads.len())].clone()),
            delay_ticks: is_late.then(|| 1 + self.below(10) as u64),
            jitter_ticks: is_late.then(|| self.below(6) as u64),
            joint: kind
                .concerns_joint()
                .then(|| 1 + self.below(self.joints as usize) as u32),
            ..fault
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_of_every_plan_can_be_scheduled_and_comes() {
        let robot = Robot::builtin("puma560").unwrap();
        for is_steered in [false, true] {
            let graph = Graph::built_in(is_steered).unwrap();
            let deal = |seed| {
                let mut deck = Deck::new(&robot, graph.clone(), 1000, seed);
                (0..30).map(|_| deck.round(60.0)).collect::<Vec<_>>()
            };
            let rounds = deal(7);
            assert!(
                rounds == deal(7) && rounds != deal(8),
                "a seed deals the same again"
            );
            let grid = grid(&robot, &graph, 1, 1000, None, 200);
            for fault in rounds.iter().chain(&grid).flatten() {
                let target = graph.target(&fault.process).unwrap();
                assert!(fault.schedule(&target, 1000, 1).is_ok(), "{fault}");
            }
            for plans in [&rounds, &grid] {
                let has = |fault: &Fault| {
                    let is_it = |one: &Fault| {
                        (&one.process, one.kind, one.way) == (&fault.process, fault.kind, fault.way)
                    };
                    plans.iter().flatten().any(is_it)
                };
                assert!(
                    every(&graph)
                        .iter()
                        .all(|fault| ends_world(fault) || has(fault))
                );
            }
            for round in &rounds {
                let early = |fault: &Fault| fault.at_tick < Some(50_000);
                assert!(
                    round.len() > 15
                        && !round.iter().any(|fault| ends_world(fault) && early(fault))
                );
            }
            let is_fatal = |round: &&Vec<Fault>| {
                round
                    .iter()
                    .filter(|fault| fault.at_tick > Some(56_000))
                    .count()
                    > 0
            };
            assert!(
                (2..15).contains(&rounds.iter().filter(is_fatal).count()),
                "rounds that end by design"
            );
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
