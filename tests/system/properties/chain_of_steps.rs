//! The steps of the chain, told anything: what acts on the arm stays finite and within the limits.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

use bytemuck::{bytes_of, bytes_of_mut};
use model::Robot;
use process::{Flow, Inputs, Outputs, Scratch, Step};
use shared_types::process::Program;
use shared_types::scenario::{Scenario, Strategy};
use shared_types::wire::Part;
use shared_types::{
    AnalyzerCheckpoint, Checkpoint, ControlState, ControllerCheckpoint, EstimatorCheckpoint,
    Layout, Message, ServoState, SingularityReport, StateEstimate, Target, TorqueCommand,
};
use xxhash_rust::xxh3::xxh3_64;

use super::input::{Bytes, Hand, numbers};

/// An arm with its task, under a control law, and the processes that know them: to plan a path takes long, to begin anew from the first state does
/// not. A process that goes on from a state is one that was started again, as far as any message shows.
struct Case {
    robot: Robot,
    scenario: Scenario,
    estimator: RefCell<Begun>,
    analyzer: RefCell<Begun>,
    controller: RefCell<Begun>,
}

/// A step, and its state before the first tick.
struct Begun {
    first: Vec<u8>,
    step: Box<dyn Step>,
    scratch: Scratch,
}

/// Bytes before a saved state: its layout and its checksum.
const HEAD: usize = 16;

impl Begun {
    fn of(program: Program, robot: &Robot, scenario: &Scenario) -> Option<Self> {
        let (mut first, step) = (Vec::new(), chain::step_of(program, robot, scenario).ok()??);
        step.save(&mut first);
        Some(Self {
            first,
            step,
            scratch: Scratch::default(),
        })
    }

    fn restart(&mut self) {
        self.step.restore(&self.first).expect("its own state");
    }

    /// Goes on from a state that was saved whole and means this.
    fn restore(&mut self, state: &impl Checkpoint) {
        let mut saved = self.first[..HEAD].to_vec();
        saved[HEAD / 2..].copy_from_slice(&xxh3_64(bytes_of(state)).to_le_bytes());
        saved.extend_from_slice(bytes_of(state));
        self.step.restore(&saved).expect("of its layout");
    }

    fn saved<C: Checkpoint>(&self) -> C {
        let mut saved = Vec::new();
        self.step.save(&mut saved);
        bytemuck::pod_read_unaligned(&saved[HEAD..])
    }

    /// One tick from one message to another.
    fn answer<I: Message, O: Message>(
        &mut self,
        tick: u64,
        input: Option<&I>,
        out: &mut O,
    ) -> Flow {
        let mut inputs = Inputs::of(tick, &[]);
        input
            .into_iter()
            .for_each(|input| inputs.add(I::TOPIC, bytes_of(input)));
        let mut outputs = Outputs::new(&mut self.scratch);
        outputs.add(O::TOPIC, bytes_of_mut(out));
        self.step.step(&inputs, &mut outputs)
    }

    /// The controller's step, as the process makes it: towards a target where the arm is steered.
    fn control(
        &mut self,
        scenario: &Scenario,
        (estimate, report, target): (&StateEstimate, &SingularityReport, Option<&Target>),
        (servo, state, command): (&mut ServoState, &mut ControlState, &mut TorqueCommand),
    ) {
        let mut inputs = Inputs::of(estimate.header.tick, &[]);
        inputs.add(StateEstimate::TOPIC, bytes_of(estimate));
        inputs.add(SingularityReport::TOPIC, bytes_of(report));
        target
            .into_iter()
            .for_each(|target| inputs.add(Target::TOPIC, bytes_of(target)));
        let mut outputs = Outputs::new(&mut self.scratch);
        if scenario.servo.is_some() {
            outputs.add(ServoState::TOPIC, bytes_of_mut(servo));
        }
        outputs.add(ControlState::TOPIC, bytes_of_mut(state));
        outputs.add(TorqueCommand::TOPIC, bytes_of_mut(command));
        let _ = self.step.step(&inputs, &mut outputs);
    }
}

impl Case {
    /// Where arm and law fit.
    fn new(robot: Robot, scenario: Scenario) -> Option<Self> {
        let of = |program| Begun::of(program, &robot, &scenario).map(RefCell::new);
        let (estimator, analyzer, controller) = (
            of(Program::Estimator)?,
            of(Program::Analyzer)?,
            of(Program::Controller)?,
        );
        of(Program::Plant)?;
        Some(Self {
            robot,
            scenario,
            estimator,
            analyzer,
            controller,
        })
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
    let step = &mut *case.controller.borrow_mut();
    step.restart();
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
        step.control(
            scenario,
            (&estimate, &report, target.as_ref()),
            (&mut servo, &mut state, &mut command),
        );
        is_safe(&command.tau, robot, "controller");
        assert_eq!(command.header.tick, tick);
    }
    step.restore(&bytes.next::<ControllerCheckpoint>());
    step.control(
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
    fn closes(&mut self, state: C) {
        self.checkpoint = Some(state);
    }

    /// Its replacement goes on from the last tick.
    fn revives(&self, process: &mut Begun) {
        match &self.checkpoint {
            Some(last) => process.restore(last),
            None => process.restart(),
        }
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
    let plant = Begun::of(Program::Plant, robot, scenario);
    let mut plant = plant.expect("it was accepted before");
    let estimator = &mut *case.estimator.borrow_mut();
    let analyzer = &mut *case.analyzer.borrow_mut();
    let controller = &mut *case.controller.borrow_mut();
    for step in [&mut *estimator, &mut *analyzer, &mut *controller] {
        step.restart();
    }
    let (mut estimating, mut analyzing, mut controlling) = (
        Life::<EstimatorCheckpoint>::new(is_guarded),
        Life::<AnalyzerCheckpoint>::new(is_guarded),
        Life::<ControllerCheckpoint>::new(is_guarded),
    );
    let mut target: Option<Target> = None;
    let mut m = chain::Tick::default();
    let mut command: Option<TorqueCommand> = None;
    for tick in 0..48 {
        if hand.0.is_empty() && tick > 8 {
            break;
        }
        let (touched, dropped) = (hand.byte(), hand.byte());
        if !sample_of(&mut plant, tick, command.as_ref(), &mut m) {
            break;
        }
        let (mut sample, truth) = (m.sensor, m.plant_state);
        assert!(
            sample.is_finite() && truth.is_finite(),
            "{sample:?} {truth:?}"
        );
        is_safe(&sample.tau_drive, robot, "drive");
        command = 'chain: {
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
            let _ = estimator.answer(tick, Some(&sample), &mut m.estimate);
            let mut estimate = m.estimate;
            assert!(
                estimate.is_finite() || !sample.is_finite(),
                "the estimator has an answer to everything: {sample:?} {estimate:?}"
            );
            if !estimating.sends(&estimate) {
                break 'chain None;
            }
            estimating.closes(estimator.saved());
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
            let _ = analyzer.answer(tick, Some(&estimate), &mut m.singularity);
            let mut report = m.singularity;
            if !analyzing.sends(&report) {
                analyzing.revives(analyzer);
                break 'chain None;
            }
            analyzing.closes(analyzer.saved());
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
            controller.control(
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
                controlling.revives(controller);
                break 'chain None;
            }
            controlling.closes(controller.saved());
            if touched & 8 != 0 {
                hand.corrupt(&mut command);
                command.phase %= 3;
            }
            (dropped & 8 == 0 && (!is_guarded || command.is_finite())).then_some(command)
        };
    }
    sample_of(&mut plant, 48, command.as_ref(), &mut m);
    let (sample, truth) = (m.sensor, m.plant_state);
    assert!(
        sample.is_finite() && truth.is_finite(),
        "{sample:?} {truth:?}"
    );
}

/// The plant's step on the torque of the tick before; whether its task goes on.
fn sample_of(
    plant: &mut Begun,
    tick: u64,
    command: Option<&TorqueCommand>,
    m: &mut chain::Tick,
) -> bool {
    let mut inputs = Inputs::of(tick, &[]);
    let command = command.into_iter();
    command.for_each(|command| inputs.add(TorqueCommand::TOPIC, bytes_of(command)));
    let mut outputs = Outputs::new(&mut plant.scratch);
    outputs.add(
        shared_types::SensorSample::TOPIC,
        bytes_of_mut(&mut m.sensor),
    );
    outputs.add(
        shared_types::PlantState::TOPIC,
        bytes_of_mut(&mut m.plant_state),
    );
    plant.step.step(&inputs, &mut outputs) == Flow::Go
}
