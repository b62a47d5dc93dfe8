//! The events of a round of the soak, drawn from a seed, so that a round can be repeated.

use std::collections::VecDeque;

use model::Robot;
use runtime::random;
use shared_types::fault::{Fault, Kind, Way};
use shared_types::graph::{Graph, Process, Role};

/// Mean time from one planned to the next; s.
const MEAN_GAP_S: f64 = 1.4;

/// A round is left in peace for so long at its beginning ...
const CALM_BEFORE_S: f64 = 1.0;

/// ... and for so long at its end, so that the arm can reach its goal; s.
const CALM_AFTER_S: f64 = 4.0;

/// A volume is full for so long before that at most, for nothing is recorded after it; s.
const FULL_S: f64 = 6.0;

/// One round in so many ends by design.
const FATAL_ONE_IN: u64 = 4;

/// Deaths that spend a budget of five restarts.
const SPENT: u32 = 6;

/// Acts on a process from outside, which no fault table lists.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Signal {
    /// SIGKILL.
    Kill,
    /// SIGKILL, and again so many ms later, when the replacement is starting or has just begun.
    KillTwice(u32),
    /// SIGSTOP.
    Stop,
    /// SIGSTOP, and SIGCONT so many ms later.
    StopFor(u32),
}

/// One thing that goes wrong.
#[derive(Clone, Debug, PartialEq)]
#[allow(
    clippy::large_enum_variant,
    reason = "a few dozen of them, drawn once a round"
)]
pub(super) enum Act {
    /// As `armplane fault` requests it.
    Fault(Fault),
    /// By a signal from outside.
    Signal(String, Signal),
}

/// When what goes wrong.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Planned {
    /// Since the first tick; s.
    pub at_s: f64,
    pub act: Act,
    /// The run ends with it, as it is meant to.
    pub is_fatal: bool,
}

impl Act {
    pub(super) fn process(&self) -> &str {
        match self {
            Self::Fault(fault) => &fault.process,
            Self::Signal(process, _) => process,
        }
    }

    /// In which way, for a fault that has several.
    pub(super) fn way(&self) -> Option<Way> {
        if let Self::Fault(fault) = self {
            fault.way
        } else {
            None
        }
    }

    /// Its row in the table.
    pub(super) fn name(&self) -> String {
        match self {
            Self::Fault(Fault {
                kind,
                way: Some(way),
                ..
            }) => format!("{kind} {way}"),
            Self::Fault(Fault { kind, .. }) => kind.to_string(),
            Self::Signal(_, Signal::Kill) => "SIGKILL".to_owned(),
            Self::Signal(_, Signal::KillTwice(_)) => "SIGKILL, and again".to_owned(),
            Self::Signal(_, Signal::Stop) => "SIGSTOP".to_owned(),
            Self::Signal(_, Signal::StopFor(_)) => "SIGSTOP, SIGCONT".to_owned(),
        }
    }

    /// How many deaths of its process it costs.
    pub(super) fn deaths(&self) -> u32 {
        match self {
            Self::Fault(fault) => u32::from(fault.kind.ends_process(fault.way)),
            Self::Signal(_, Signal::Kill | Signal::Stop) => 1,
            Self::Signal(_, Signal::KillTwice(_)) => 2,
            Self::Signal(_, Signal::StopFor(_)) => 0,
        }
    }

    /// With the plant the run ends.
    fn ends_world(&self, graph: &Graph) -> bool {
        is_world(graph, self.process()) && self.deaths() > 0
    }
}

/// Random numbers one after the other.
struct Draws {
    seed: u64,
    drawn: u64,
}

impl Draws {
    fn next(&mut self) -> u64 {
        self.drawn += 1;
        random(self.seed, self.drawn)
    }

    fn below(&mut self, n: u64) -> u64 {
        self.next() % n.max(1)
    }

    /// In [0, 1).
    fn unit(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// As likely to double as to halve.
    fn scaled(&mut self, value: f64, by: f64) -> f64 {
        value * by.powf(2.0 * self.unit() - 1.0)
    }

    fn sign(&mut self) -> f64 {
        if self.next().is_multiple_of(2) {
            1.0
        } else {
            -1.0
        }
    }

    fn shuffle<T>(&mut self, deck: &mut [T]) {
        for i in (1..deck.len()).rev() {
            deck.swap(i, self.below(i as u64 + 1) as usize);
        }
    }
}

/// Deals what goes wrong, so that everything comes equally often over all rounds: a shuffled deck of every kind, process and way.
pub(super) struct FaultDraw {
    draws: Draws,
    graph: Graph,
    joints: u64,
    rate_hz: f64,
    deck: VecDeque<Act>,
    fatal: VecDeque<Act>,
    /// The acts that wait for the end of a round.
    full: VecDeque<Act>,
}

impl FaultDraw {
    pub(super) fn new(robot: &Robot, graph: Graph, rate_hz: u32, seed: u64) -> Self {
        Self {
            draws: Draws {
                seed: seed ^ 0x50a4,
                drawn: 0,
            },
            graph,
            joints: robot.dof() as u64,
            rate_hz: f64::from(rate_hz),
            deck: VecDeque::new(),
            fatal: VecDeque::new(),
            full: VecDeque::new(),
        }
    }

    /// The events of the next round of so many seconds, in order.
    pub(super) fn round(&mut self, seconds: f64) -> Vec<Planned> {
        let calm = |s: f64| s.min(0.25 * seconds);
        let (from, to) = (calm(CALM_BEFORE_S), seconds - calm(CALM_AFTER_S));
        let is_disk = |act: &Act| matches!(act, Act::Fault(fault) if fault.kind == Kind::DiskFull);
        let (mut planned, mut at_s) = (Vec::new(), from);
        loop {
            at_s -= MEAN_GAP_S * (1.0 - self.draws.unit()).ln();
            if at_s >= to {
                break;
            }
            let is_late = at_s >= to - FULL_S;
            let waiting = if is_late { self.full.pop_front() } else { None };
            let Some(act) = waiting.or_else(|| self.next_act()) else {
                break;
            };
            if act.ends_world(&self.graph) {
                self.fatal.push_back(act);
            } else if is_disk(&act) && !is_late {
                self.full.push_back(act);
            } else {
                let act = self.detailed(act);
                planned.push(Planned {
                    at_s,
                    act,
                    is_fatal: false,
                });
            }
        }
        if self.draws.below(FATAL_ONE_IN) == 0 {
            self.end(&mut planned, to + 0.2 * (seconds - to));
        }
        planned
    }

    /// The end of a round: the plant's, or that of a budget.
    fn end(&mut self, planned: &mut Vec<Planned>, at_s: f64) {
        if self.draws.next().is_multiple_of(2)
            && let Some(act) = self.fatal.pop_front()
        {
            let act = self.detailed(act);
            return planned.push(Planned {
                at_s,
                act,
                is_fatal: true,
            });
        }
        let is_mortal = |process: &&Process| process.role() != Role::World;
        let mortal: Vec<_> = self
            .graph
            .process
            .iter()
            .filter(is_mortal)
            .map(|process| process.name.clone())
            .collect();
        let process = mortal[self.draws.below(mortal.len() as u64) as usize].clone();
        for k in 0..SPENT {
            // Its pause is over by then, and its replacement at work.
            let act = Act::Signal(process.clone(), Signal::Kill);
            planned.push(Planned {
                at_s: at_s + 0.35 * f64::from(k),
                act,
                is_fatal: true,
            });
        }
    }

    fn next_act(&mut self) -> Option<Act> {
        if self.deck.is_empty() {
            let mut deck = every(&self.graph);
            self.draws.shuffle(&mut deck);
            self.deck = deck.into();
        }
        self.deck.pop_front()
    }

    /// With lengths, amounts and places of its own.
    fn detailed(&mut self, act: Act) -> Act {
        match act {
            Act::Fault(fault) => Act::Fault(self.detailed_fault(fault)),
            Act::Signal(process, Signal::KillTwice(_)) => {
                Act::Signal(process, Signal::KillTwice(1 + self.draws.below(80) as u32))
            }
            Act::Signal(process, Signal::StopFor(_)) => {
                // A process stopped for a tenth of a second is replaced; the plant has no replacement.
                let most_ms = if is_world(&self.graph, &process) {
                    50
                } else {
                    250
                };
                Act::Signal(
                    process,
                    Signal::StopFor(1 + self.draws.below(most_ms) as u32),
                )
            }
            signal => signal,
        }
    }

    fn detailed_fault(&mut self, fault: Fault) -> Fault {
        let (fields, reads) = self
            .graph
            .target(&fault.process)
            .map(|target| (target.fields, target.reads))
            .unwrap_or_default();
        let (kind, draws) = (fault.kind, &mut self.draws);
        let usual_s = kind.usual_length_s();
        let ticks = |s: f64| (s * self.rate_hz).round().max(1.0) as u64;
        let for_ticks = usual_s
            .is_finite()
            .then(|| ticks(draws.scaled(usual_s, 5.0)));
        let usual = fault.way.map_or(0.0, |way| kind.usual_amount(way));
        let amount = match (kind, fault.way) {
            _ if kind.usual_ms() > 0.0 => Some(draws.scaled(kind.usual_ms(), 3.0)),
            (Kind::Clock, _) => Some(draws.scaled(usual, 10.0) * draws.sign()),
            (_, Some(Way::Bias | Way::Drift)) => Some(draws.scaled(usual, 3.0) * draws.sign()),
            _ if usual > 0.0 => Some(draws.scaled(usual, 3.0)),
            _ => None,
        };
        let probability = (kind.has_probability() && draws.next().is_multiple_of(2))
            .then(|| 0.05 + 0.95 * draws.unit());
        let field = (kind == Kind::Corrupt).then(|| {
            let fields: Vec<_> = fields.iter().filter(|field| field.is_number()).collect();
            let field = fields[draws.below(fields.len() as u64) as usize];
            format!(
                "{}[{}]",
                field.name,
                draws.below((field.size / size_of::<f64>()) as u64)
            )
        });
        let topic =
            (kind == Kind::Cut).then(|| reads[draws.below(reads.len() as u64) as usize].clone());
        Fault {
            topic,
            for_ticks,
            amount,
            probability,
            field,
            delay_ticks: (kind == Kind::Delay).then(|| 1 + draws.below(10)),
            jitter_ticks: (kind == Kind::Delay).then(|| draws.below(6)),
            joint: kind
                .concerns_joint()
                .then(|| 1 + draws.below(self.joints) as u32),
            ..fault
        }
    }
}

/// Every kind in every way for every process, and every signal.
fn every(graph: &Graph) -> Vec<Act> {
    let mut acts = Vec::new();
    for process in &graph.process {
        for &kind in Kind::ALL.iter().filter(|kind| graph.takes(**kind, process)) {
            let ways: Vec<_> = kind.ways().map(Some).collect();
            let ways = if ways.is_empty() { vec![None] } else { ways };
            acts.extend(ways.into_iter().map(|way| {
                Act::Fault(Fault {
                    way,
                    ..Fault::new(&process.name, kind)
                })
            }));
        }
        let signals = [
            Signal::Kill,
            Signal::KillTwice(0),
            Signal::Stop,
            Signal::StopFor(0),
        ];
        acts.extend(
            signals
                .into_iter()
                .map(|signal| Act::Signal(process.name.clone(), signal)),
        );
    }
    acts
}

/// Whether a process makes the ticks.
fn is_world(graph: &Graph, process: &str) -> bool {
    graph
        .process(process)
        .is_some_and(|process| process.role() == Role::World)
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::graph::BUILT_IN;
    use std::collections::BTreeSet;

    fn draw(seed: u64) -> FaultDraw {
        FaultDraw::new(
            &Robot::builtin("puma560").unwrap(),
            Graph::parse("graph.toml", BUILT_IN).unwrap(),
            1000,
            seed,
        )
    }

    #[test]
    fn a_seed_deals_the_same_again_and_every_fault_makes_sense() {
        let deal = |seed| {
            let mut faults = draw(seed);
            (0..30).map(|_| faults.round(60.0)).collect::<Vec<_>>()
        };
        assert_eq!(deal(7), deal(7));
        assert_ne!(deal(7), deal(8));
        let graph = Graph::parse("graph.toml", BUILT_IN).unwrap();
        for planned in deal(7).concat() {
            if let Act::Fault(fault) = &planned.act {
                fault
                    .schedule(&graph.target(&fault.process).unwrap(), 1000, 1)
                    .unwrap_or_else(|complaint| panic!("{fault}: {complaint}"));
            }
        }
    }

    #[test]
    fn everything_comes_and_only_what_is_meant_to_ends_a_run() {
        let mut faults = draw(1);
        let graph = faults.graph.clone();
        let rounds: Vec<_> = (0..30).map(|_| faults.round(60.0)).collect();
        let name = |act: &Act| format!("{} {}", act.process(), act.name());
        let dealt: BTreeSet<_> = rounds
            .iter()
            .flatten()
            .map(|planned| name(&planned.act))
            .collect();
        let missing: Vec<_> = every(&graph)
            .iter()
            .filter(|act| !act.ends_world(&graph))
            .map(name)
            .filter(|one| !dealt.contains(one))
            .collect();
        assert!(missing.is_empty(), "{missing:?}");
        for round in &rounds {
            assert!(round.iter().all(|planned| !planned.act.ends_world(&graph)
                || planned.is_fatal && planned.at_s > 50.0));
            assert!(round.len() > 15, "{} planned", round.len());
        }
        let ended = rounds
            .iter()
            .filter(|round| round.iter().any(|planned| planned.is_fatal))
            .count();
        assert!(
            (2..15).contains(&ended),
            "{ended} of 30 rounds end by design"
        );
    }
}
