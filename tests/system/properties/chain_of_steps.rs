//! The steps of the chain, told anything: what acts on the arm stays finite and within the limits.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

use model::Robot;
use shared_types::scenario::{Scenario, Strategy};
use shared_types::wire::Part;
use shared_types::{Checkpoint, ControlState, Layout, Message, PlantState, SensorSample, SingularityReport, StateEstimate, TorqueCommand};

use super::input::{Bytes, Hand, numbers};

/// An arm with its task, under a control law.
type Case = Rc<(Robot, Scenario)>;

thread_local! {
    /// Those met so far; `None` where arm and law do not fit.
    static CASES: RefCell<BTreeMap<(usize, usize, bool), Option<Case>>> = const { RefCell::new(BTreeMap::new()) };
}

/// Every built-in scenario under every law, analysed by its formulas or by number.
fn case(scenario: u8, law: u8, numeric: bool) -> Option<Case> {
    let names: Vec<&str> = sim::scenarios::names().collect();
    let (place, law) = (scenario as usize % names.len(), law as usize % Strategy::ALL.len());
    CASES.with_borrow_mut(|cases| {
        let make = || {
            let mut scenario = Scenario::parse(names[place], sim::scenarios::text(names[place])?, &[]).expect("built in");
            scenario.control.strategy = Strategy::ALL[law];
            scenario.analysis.numeric = numeric;
            // The exact integrator: quick to make, and what happens to the arm is the same.
            scenario.plant.model = shared_types::scenario::PlantModel::Reference;
            let robot = Robot::builtin(&scenario.robot).expect("built in");
            chain::Chain::new(&robot, &scenario).ok().map(|_| Rc::new((robot, scenario)))
        };
        cases.entry((place, law, numeric)).or_insert_with(make).clone()
    })
}

/// Asserts that a torque is finite and within the arm's limits.
fn is_safe(tau: &[f64], robot: &Robot, who: &str) {
    for (joint, (tau, limit)) in tau.iter().zip(&robot.joints).enumerate() {
        assert!(tau.abs() <= limit.effort * (1.0 + 1e-12), "{who}: {tau} N·m at joint {joint}, allowed {}", limit.effort);
    }
    assert!(tau[robot.joints.len()..].iter().all(|tau| *tau == 0.0));
}

/// For any input, tick after tick, the controller's torque is finite and within the limits: messages of any bits, every arm and law.
pub fn controller(bytes: &[u8]) {
    let mut hand = Hand(bytes);
    let Some(case) = case(hand.byte(), hand.byte(), hand.byte() & 1 != 0) else { return };
    let (robot, scenario) = &*case;
    let mut cycle = controller::cycle(robot, scenario).expect("it was accepted before");
    let mut bytes = Bytes(hand.0);
    let (mut state, mut command) = <(ControlState, TorqueCommand)>::default();
    for tick in 0..4 {
        let (mut estimate, mut report): (StateEstimate, SingularityReport) = (bytes.next(), bytes.next());
        (estimate.header.tick, report.header.tick) = (tick, tick);
        cycle.step(&estimate, &report, &mut state, &mut command);
        is_safe(&command.tau, robot, "controller");
        assert_eq!(command.header.tick, tick);
    }
    let mut poisoned = controller::cycle(robot, scenario).expect("it was accepted before");
    poisoned.restore(&bytes.next());
    poisoned.step(&bytes.next(), &bytes.next(), &mut state, &mut command);
    is_safe(&command.tau, robot, "restored controller");
}

/// For any command, the torque that acts on the arm is finite and within the limits, and the sensors' readings are finite.
pub fn drive(bytes: &[u8]) {
    let mut hand = Hand(bytes);
    let Some(case) = case(hand.byte(), 0, false) else { return };
    let (robot, scenario) = &*case;
    let mut cycle = plant::cycle(robot, scenario).expect("it was accepted before");
    let mut bytes = Bytes(hand.0);
    for tick in 0..8 {
        let mut command: TorqueCommand = bytes.next();
        command.phase %= 2;
        cycle.step(Some(&command));
        let (mut sample, mut truth) = <(SensorSample, PlantState)>::default();
        cycle.sample(tick, &mut sample, &mut truth);
        assert!(sample.is_finite() && truth.is_finite(), "{sample:?} {truth:?}");
        is_safe(&sample.tau_drive, robot, "drive");
    }
}

/// Numbers within what a fault's amount may be: what is larger no process need have an answer to.
fn is_sane<M: Layout>(message: &M) -> bool {
    let bytes = bytemuck::bytes_of(message);
    numbers::<M>().into_iter().all(|at| bytemuck::pod_read_unaligned::<f64>(&bytes[at..at + 8]).abs() <= 1e12)
}

/// A process of the chain, and what a run would do about it: an output that is not finite ends it, and its replacement goes on from the
/// checkpoint of the tick before.
struct Life<C> {
    /// Of the last tick whose outputs left.
    checkpoint: Option<C>,
    /// It has been told nothing since its beginning that it need not have an answer to.
    sane: bool,
    /// The edge refuses what is not finite.
    guarded: bool,
}

impl<C: Checkpoint> Life<C> {
    fn new(guarded: bool) -> Self {
        Self { checkpoint: None, sane: true, guarded }
    }

    /// Whether a message leaves; else the process has died of it, and is to be begun anew.
    fn sends<M: Message>(&mut self, message: &M) -> bool {
        if message.is_finite() || !self.guarded {
            return true;
        }
        assert!(!self.sane, "nothing out of range has been said to it: {message:?}");
        // With its replacement, all is well again.
        self.sane = true;
        false
    }

    /// The tick is closed with this checkpoint.
    fn closes(&mut self, save: impl FnOnce(&mut C)) {
        save(self.checkpoint.get_or_insert_with(C::zeroed));
    }

    /// It is started again from a last checkpoint that may have been changed.
    fn tampered(&mut self, hand: &mut Hand<'_>) -> Option<C> {
        let mut last = self.checkpoint?;
        hand.spoil_words(&mut last, 0);
        let is_possible = last.is_finite() || !self.guarded;
        self.sane = if is_possible { is_sane(&last) } else { self.sane };
        is_possible.then_some(last)
    }
}

/// The whole chain under tampering: of every message any number may be replaced on its way, messages are lost, processes start again
/// from a last message that was tampered with. The torque on the arm stays finite and within the limits. Where the edge refuses what is not finite,
/// as it does in a run, no process has anything to say that is not finite, unless it was told what is out of all range; and then its replacement,
/// which goes on from what was said last, is cured.
pub fn fingers(bytes: &[u8]) {
    let mut hand = Hand(bytes);
    let (scenario, law, how) = (hand.byte(), hand.byte(), hand.byte());
    let Some(case) = case(scenario, law, how & 1 != 0) else { return };
    let (robot, scenario) = &*case;
    let is_guarded = how & 2 != 0;
    let fit = "it was accepted before";
    let mut plant = plant::cycle(robot, scenario).expect(fit);
    let estimators = || estimator::cycle(robot, scenario).expect(fit);
    let analyzers = || analyzer::cycle(robot, scenario).expect(fit);
    let controllers = || controller::cycle(robot, scenario).expect(fit);
    let (mut estimator, mut analyzer, mut controller) = (estimators(), analyzers(), controllers());
    let (mut estimating, mut analyzing, mut controlling) = (Life::new(is_guarded), Life::new(is_guarded), Life::new(is_guarded));
    let mut m = chain::Tick::default();
    for tick in 0..48 {
        if hand.0.is_empty() && tick > 8 || plant.is_over() {
            break;
        }
        let (touched, dropped) = (hand.byte(), hand.byte());
        plant.sample(tick, &mut m.sensor, &mut m.plant_state);
        let (mut sample, truth) = (m.sensor, m.plant_state);
        assert!(sample.is_finite() && truth.is_finite(), "{sample:?} {truth:?}");
        is_safe(&sample.tau_drive, robot, "drive");
        let command = 'chain: {
            if touched & 1 != 0 {
                hand.corrupt(&mut sample);
            }
            if dropped & 16 != 0
                && let Some(last) = estimating.tampered(&mut hand)
            {
                estimator = estimators();
                estimator.restore(&last);
            }
            if dropped & 1 != 0 || is_guarded && !sample.is_finite() {
                break 'chain None;
            }
            estimator.step(&sample, &mut m.estimate);
            let mut estimate = m.estimate;
            assert!(estimate.is_finite() || !sample.is_finite(), "the estimator has an answer to everything: {sample:?} {estimate:?}");
            if !estimating.sends(&estimate) {
                break 'chain None;
            }
            estimating.closes(|out| estimator.save(out));
            if touched & 2 != 0 {
                hand.corrupt(&mut estimate);
            }
            if dropped & 32 != 0
                && let Some(last) = analyzing.tampered(&mut hand)
            {
                analyzer = analyzers();
                analyzer.restore(&last);
            }
            if dropped & 2 != 0 || is_guarded && !estimate.is_finite() {
                break 'chain None;
            }
            analyzing.sane &= is_sane(&estimate);
            analyzer.step(&estimate, &mut m.singularity);
            let mut report = m.singularity;
            if !analyzing.sends(&report) {
                analyzer = analyzers();
                analyzing.checkpoint.iter().for_each(|last| analyzer.restore(last));
                break 'chain None;
            }
            analyzing.closes(|out| analyzer.save(out));
            if touched & 4 != 0 {
                hand.corrupt(&mut report);
            }
            if dropped & 64 != 0
                && let Some(last) = controlling.tampered(&mut hand)
            {
                controller = controllers();
                controller.restore(&last);
            }
            if dropped & 4 != 0 || is_guarded && !report.is_finite() {
                break 'chain None;
            }
            controlling.sane &= is_sane(&estimate) && is_sane(&report);
            controller.step(&estimate, &report, &mut m.control_state, &mut m.torque);
            let mut command = m.torque;
            is_safe(&command.tau, robot, "controller");
            assert_eq!(command.header.tick, estimate.header.tick);
            if !(controlling.sends(&m.control_state) && controlling.sends(&command)) {
                controller = controllers();
                controlling.checkpoint.iter().for_each(|last| controller.restore(last));
                break 'chain None;
            }
            controlling.closes(|out| controller.save(out));
            if touched & 8 != 0 {
                hand.corrupt(&mut command);
                command.phase %= 3;
            }
            (dropped & 8 == 0 && (!is_guarded || command.is_finite())).then_some(command)
        };
        plant.step(command.as_ref());
    }
    let (mut sample, mut truth) = (m.sensor, m.plant_state);
    plant.sample(48, &mut sample, &mut truth);
    assert!(sample.is_finite() && truth.is_finite(), "{sample:?} {truth:?}");
}
