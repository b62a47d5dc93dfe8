//! The steps of the chain, told anything: what acts on the arm stays finite and within the limits.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

use model::Robot;
use shared_types::scenario::{Scenario, Strategy};
use shared_types::wire::Part;
use shared_types::{
    AnalyzerCheckpoint, Checkpoint, ControlState, ControllerCheckpoint, EstimatorCheckpoint,
    Layout, Message, ServoState, SingularityReport, StateEstimate, Target, TorqueCommand,
};

use super::input::{Bytes, Hand, numbers};

/// An arm with its task, under a control law, and the processes that know them: to plan a path takes long, to begin anew from the first checkpoint does
/// not. A process that goes on from a checkpoint is one that was started again, as far as any message shows.
struct Case {
    robot: Robot,
    scenario: Scenario,
    estimator: RefCell<Begun<dyn estimator::Step, EstimatorCheckpoint>>,
    analyzer: RefCell<Begun<dyn analyzer::Step, AnalyzerCheckpoint>>,
    controller: RefCell<Begun<dyn controller::Step, ControllerCheckpoint>>,
}

/// A step, and its checkpoint before the first tick.
struct Begun<S: ?Sized, C> {
    first: C,
    step: Box<S>,
}

impl Case {
    /// Where arm and law fit.
    fn new(robot: Robot, scenario: Scenario) -> Option<Self> {
        let (estimator, analyzer, controller) = (
            estimator::cycle(&robot, &scenario).ok()?,
            analyzer::cycle(&robot, &scenario).ok()?,
            controller::cycle(&robot, &scenario).ok()?,
        );
        plant::cycle(&robot, &scenario).ok()?;
        let (mut first, mut second, mut third) = <(
            EstimatorCheckpoint,
            AnalyzerCheckpoint,
            ControllerCheckpoint,
        )>::default();
        estimator.save(&mut first);
        analyzer.save(&mut second);
        controller.save(&mut third);
        Some(Self {
            robot,
            scenario,
            estimator: RefCell::new(Begun {
                first,
                step: estimator,
            }),
            analyzer: RefCell::new(Begun {
                first: second,
                step: analyzer,
            }),
            controller: RefCell::new(Begun {
                first: third,
                step: controller,
            }),
        })
    }
}

/// The controller's step, as the process makes it: towards a target where the arm is steered.
fn control(
    step: &mut dyn controller::Step,
    scenario: &Scenario,
    (estimate, report, target): (&StateEstimate, &SingularityReport, Option<&Target>),
    (servo, state, command): (&mut ServoState, &mut ControlState, &mut TorqueCommand),
) {
    match scenario.servo {
        Some(_) => step.steer((estimate, report), target, servo, state, command),
        None => step.step(estimate, report, state, command),
    }
}

/// By scenario, law and analysis; `None` where arm and law do not fit.
type Cases = BTreeMap<(usize, usize, bool), Option<Rc<Case>>>;

thread_local! {
    /// Those met so far.
    static CASES: RefCell<Cases> = const { RefCell::new(BTreeMap::new()) };
}

/// Every built-in scenario under every law, analysed by its formulas or by number.
fn case(scenario: u8, law: u8, numeric: bool) -> Option<Rc<Case>> {
    let names: Vec<&str> = sim::scenarios::names().collect();
    let (place, law) = (
        scenario as usize % names.len(),
        law as usize % Strategy::ALL.len(),
    );
    CASES.with_borrow_mut(|cases| {
        let make = || {
            let mut scenario =
                Scenario::parse(names[place], sim::scenarios::text(names[place])?, &[])
                    .expect("built in");
            scenario.control.strategy = Strategy::ALL[law];
            scenario.analysis.numeric = numeric;
            // The exact integrator: quick to make, and what happens to the arm is the same.
            scenario.plant.model = shared_types::scenario::PlantModel::Reference;
            let robot = Robot::builtin(&scenario.robot).expect("built in");
            Case::new(robot, scenario).map(Rc::new)
        };
        cases
            .entry((place, law, numeric))
            .or_insert_with(make)
            .clone()
    })
}

/// Asserts that a torque is finite and within the arm's limits.
fn is_safe(tau: &[f64], robot: &Robot, who: &str) {
    for (joint, (tau, limit)) in tau.iter().zip(&robot.joints).enumerate() {
        assert!(
            tau.abs() <= limit.effort * (1.0 + 1e-12),
            "{who}: {tau} N·m at joint {joint}, allowed {}",
            limit.effort
        );
    }
    assert!(tau[robot.joints.len()..].iter().all(|tau| *tau == 0.0));
}

/// For any input, tick after tick, the controller's torque is finite and within the limits: messages of any bits, every arm and law.
pub fn controller(bytes: &[u8]) {
    let mut hand = Hand(bytes);
    let Some(case) = case(hand.byte(), hand.byte(), hand.byte() & 1 != 0) else {
        return;
    };
    let Case {
        robot, scenario, ..
    } = &*case;
    let Begun { first, step } = &mut *case.controller.borrow_mut();
    step.restore(first);
    let mut bytes = Bytes(hand.0);
    let (mut servo, mut state, mut command) =
        <(ServoState, ControlState, TorqueCommand)>::default();
    let mut target: Option<Target> = None;
    for tick in 0..4 {
        let (mut estimate, mut report): (StateEstimate, SingularityReport) =
            (bytes.next(), bytes.next());
        (estimate.header.tick, report.header.tick) = (tick, tick);
        if scenario.servo.is_some() {
            target = Some(bytes.next());
        }
        control(
            step.as_mut(),
            scenario,
            (&estimate, &report, target.as_ref()),
            (&mut servo, &mut state, &mut command),
        );
        is_safe(&command.tau, robot, "controller");
        assert_eq!(command.header.tick, tick);
    }
    step.restore(&bytes.next());
    control(
        step.as_mut(),
        scenario,
        (&bytes.next(), &bytes.next(), target.as_ref()),
        (&mut servo, &mut state, &mut command),
    );
    is_safe(&command.tau, robot, "restored controller");
}

/// Numbers within what a fault's amount may be: what is larger no process need have an answer to.
fn is_sane<M: Layout>(message: &M) -> bool {
    let bytes = bytemuck::bytes_of(message);
    numbers::<M>()
        .into_iter()
        .all(|at| bytemuck::pod_read_unaligned::<f64>(&bytes[at..at + 8]).abs() <= 1e12)
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
        Self {
            checkpoint: None,
            sane: true,
            guarded,
        }
    }

    /// Whether a message leaves; else the process has died of it, and is to be begun anew.
    fn sends<M: Message>(&mut self, message: &M) -> bool {
        if message.is_finite() || !self.guarded {
            return true;
        }
        assert!(
            !self.sane,
            "nothing out of range has been said to it: {message:?}"
        );
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
        self.sane = if is_possible {
            is_sane(&last)
        } else {
            self.sane
        };
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
    let Some(case) = case(scenario, law, how & 1 != 0) else {
        return;
    };
    let Case {
        robot, scenario, ..
    } = &*case;
    let is_guarded = how & 2 != 0;
    let mut plant = plant::cycle(robot, scenario).expect("it was accepted before");
    let Begun {
        first: first_estimator,
        step: estimator,
    } = &mut *case.estimator.borrow_mut();
    let Begun {
        first: first_analyzer,
        step: analyzer,
    } = &mut *case.analyzer.borrow_mut();
    let Begun {
        first: first_controller,
        step: controller,
    } = &mut *case.controller.borrow_mut();
    estimator.restore(first_estimator);
    analyzer.restore(first_analyzer);
    controller.restore(first_controller);
    let (mut estimating, mut analyzing, mut controlling) = (
        Life::new(is_guarded),
        Life::new(is_guarded),
        Life::new(is_guarded),
    );
    let mut target: Option<Target> = None;
    let mut m = chain::Tick::default();
    for tick in 0..48 {
        if hand.0.is_empty() && tick > 8 || plant.is_over() {
            break;
        }
        let (touched, dropped) = (hand.byte(), hand.byte());
        plant.sample(tick, &mut m.sensor, &mut m.plant_state);
        let (mut sample, truth) = (m.sensor, m.plant_state);
        assert!(
            sample.is_finite() && truth.is_finite(),
            "{sample:?} {truth:?}"
        );
        is_safe(&sample.tau_drive, robot, "drive");
        let command = 'chain: {
            if touched & 1 != 0 {
                hand.corrupt(&mut sample);
            }
            if dropped & 16 != 0
                && let Some(last) = estimating.tampered(&mut hand)
            {
                estimator.restore(&last);
            }
            if dropped & 1 != 0 || is_guarded && !sample.is_finite() {
                break 'chain None;
            }
            estimator.step(&sample, &mut m.estimate);
            let mut estimate = m.estimate;
            assert!(
                estimate.is_finite() || !sample.is_finite(),
                "the estimator has an answer to everything: {sample:?} {estimate:?}"
            );
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
                analyzer.restore(&last);
            }
            if dropped & 2 != 0 || is_guarded && !estimate.is_finite() {
                break 'chain None;
            }
            analyzing.sane &= is_sane(&estimate);
            analyzer.step(&estimate, &mut m.singularity);
            let mut report = m.singularity;
            if !analyzing.sends(&report) {
                analyzer.restore(analyzing.checkpoint.as_ref().unwrap_or(first_analyzer));
                break 'chain None;
            }
            analyzing.closes(|out| analyzer.save(out));
            if touched & 4 != 0 {
                hand.corrupt(&mut report);
            }
            if dropped & 64 != 0
                && let Some(last) = controlling.tampered(&mut hand)
            {
                controller.restore(&last);
            }
            if dropped & 4 != 0 || is_guarded && !report.is_finite() {
                break 'chain None;
            }
            controlling.sane &= is_sane(&estimate) && is_sane(&report);
            if scenario.servo.is_some() && touched & 32 != 0 {
                // The controller answers any finite request of a person.
                let mut given = target.unwrap_or_default();
                hand.spoil_words(&mut given, 0);
                (given.header.tick, given.target.kind) = (tick, u32::from(hand.byte() % 6));
                target = Some(given).filter(|given| !is_guarded || given.is_finite());
            }
            control(
                controller.as_mut(),
                scenario,
                (&estimate, &report, target.as_ref()),
                (&mut m.servo_state, &mut m.control_state, &mut m.torque),
            );
            let mut command = m.torque;
            is_safe(&command.tau, robot, "controller");
            assert_eq!(command.header.tick, estimate.header.tick);
            let is_steered = scenario.servo.is_some();
            if !(controlling.sends(&m.control_state)
                && controlling.sends(&command)
                && (!is_steered || controlling.sends(&m.servo_state)))
            {
                controller.restore(controlling.checkpoint.as_ref().unwrap_or(first_controller));
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
    assert!(
        sample.is_finite() && truth.is_finite(),
        "{sample:?} {truth:?}"
    );
}
