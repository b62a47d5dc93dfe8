//! The steps of the chain, told anything: what acts on the arm stays finite and within the limits.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;

use bytemuck::{from_bytes, from_bytes_mut, pod_read_unaligned};
use model::Robot;
use process::{Flow, Inputs, Outputs, Packed, Port, Scratch, Step};
use shared_types::process::Program;
use shared_types::scenario::{PlantModel, Scenario, Strategy};
use shared_types::topics::{Each, Topic, named};
use shared_types::wire::Part;
use shared_types::{Message, SensorSample, Target, TorqueCommand};

use super::input::{Bytes, Hand, numbers};

/// The steps in the order of the data.
const CHAIN: [Program; 4] = [
    Program::Plant,
    Program::Estimator,
    Program::Analyzer,
    Program::Controller,
];

/// The last message of each topic.
type Messages = BTreeMap<&'static str, Packed>;

/// A step that begins anew from its first state: to plan a path takes long, to begin anew does not.
struct Begun {
    first: Vec<u8>,
    step: Box<dyn Step>,
    scratch: Scratch,
    /// It has been told nothing since its beginning that it need not have an answer to.
    is_sane: bool,
}

impl Begun {
    fn of(program: Program, robot: &Robot, scenario: &Scenario) -> Option<Self> {
        let (mut first, step) = (Vec::new(), chain::step_of(program, robot, scenario).ok()??);
        step.save(&mut first);
        Some(Self {
            first,
            step,
            scratch: Scratch::default(),
            is_sane: true,
        })
    }

    fn restart(&mut self) {
        self.step.restore(&self.first).expect("its own state");
        self.is_sane = true;
    }

    fn lacks(&self, messages: &Messages) -> bool {
        let mut needed = self.step.reads().iter().filter(|port| port.is_needed);
        needed.any(|port| !messages.contains_key(port.topic))
    }

    /// Its outputs of a tick.
    fn answer(&mut self, tick: u64, messages: &Messages) -> (Flow, Vec<(&'static Port, Packed)>) {
        let mut inputs = Inputs::of(tick, &[]);
        for port in self.step.reads() {
            if let Some(message) = messages.get(port.topic) {
                inputs.add(port.topic, message.bytes());
                // The controller answers any finite request of a person.
                self.is_sane &= port.topic == Target::TOPIC || is_sane(port.topic, message);
            }
        }
        let zero = |port: &'static Port| (port, Packed::of(&vec![0; port.bytes]));
        let mut sent: Vec<_> = self.step.writes().iter().map(zero).collect();
        let mut outputs = Outputs::new(&mut self.scratch);
        for (port, message) in &mut sent {
            outputs.add(port.topic, message.bytes_mut());
        }
        let flow = self.step.step(&inputs, &mut outputs);
        let heads = sent.iter_mut().map(|(_, message)| message.header_mut());
        heads.for_each(|header| header.tick = tick);
        (flow, sent)
    }
}

/// An arm with its task, under a control law, and the steps that know them.
struct Case {
    robot: Robot,
    is_steered: bool,
    chain: RefCell<Vec<Begun>>,
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
            scenario.plant.model = PlantModel::Reference;
            let robot = Robot::builtin(&scenario.robot).expect("built in");
            let begun = CHAIN.map(|program| Begun::of(program, &robot, &scenario));
            Some(Rc::new(Case {
                chain: RefCell::new(begun.into_iter().collect::<Option<_>>()?),
                robot,
                is_steered: scenario.servo.is_some(),
            }))
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

/// Asserts that the torques in a message are.
fn holds_safe_torques(port: &Port, message: &Packed, robot: &Robot) {
    match port.topic {
        TorqueCommand::TOPIC => {
            let command: &TorqueCommand = from_bytes(message.bytes());
            is_safe(&command.tau, robot, "controller");
        }
        SensorSample::TOPIC => {
            let sample: &SensorSample = from_bytes(message.bytes());
            is_safe(&sample.tau_drive, robot, "drive");
        }
        _ => {}
    }
}

/// For any input, tick after tick, the controller's torque is finite and within the limits: messages of any bits, every arm and law.
pub fn controller(bytes: &[u8]) {
    let mut hand = Hand(bytes);
    let Some(case) = case(hand.byte(), hand.byte(), hand.byte() & 1 != 0) else {
        return;
    };
    let controller = &mut case.chain.borrow_mut()[3];
    controller.restart();
    let mut bytes = Bytes(hand.0);
    for tick in 0..4 {
        let mut messages = Messages::new();
        for port in controller.step.reads() {
            if port.is_needed || case.is_steered {
                let mut message = Packed::of(&vec![0; port.bytes]);
                bytes.fill(message.bytes_mut());
                message.header_mut().tick = tick;
                messages.insert(port.topic, message);
            }
        }
        for (port, message) in controller.answer(tick, &messages).1 {
            holds_safe_torques(port, &message, &case.robot);
        }
    }
}

/// Whether the numbers of a message are within what a fault's amount may be: what is larger no process need have an answer to.
fn is_sane(topic: &str, message: &Packed) -> bool {
    struct Numbers;
    impl Each for Numbers {
        type Output = Vec<usize>;
        fn each<M: Topic>(&mut self) -> Vec<usize> {
            numbers::<M>()
        }
    }
    let bytes = message.bytes();
    let mut places = named(topic, &mut Numbers).into_iter().flatten();
    places.all(|at| pod_read_unaligned::<f64>(&bytes[at..at + 8]).abs() <= 1e12)
}

/// The whole chain under tampering: of every message any number may be replaced on its way, and messages are lost. The torque on the arm stays finite and
/// within the limits. Where the edge refuses what is not finite, as it does in a run, no process has anything to say that is not finite, unless it was
/// told what is out of all range; and then its replacement, which goes on from its state before, is cured.
pub fn fingers(bytes: &[u8]) {
    let mut hand = Hand(bytes);
    let (scenario, law, how) = (hand.byte(), hand.byte(), hand.byte());
    let Some(case) = case(scenario, law, how & 1 != 0) else {
        return;
    };
    let is_guarded = how & 2 != 0;
    let chain = &mut *case.chain.borrow_mut();
    chain.iter_mut().for_each(Begun::restart);
    let mut messages = Messages::new();
    for tick in 0..=48 {
        if hand.0.is_empty() && tick > 8 {
            break;
        }
        let (touched, dropped) = (hand.byte(), hand.byte());
        messages.retain(|topic, _| [TorqueCommand::TOPIC, Target::TOPIC].contains(topic));
        if case.is_steered && touched & 32 != 0 {
            ask(&mut hand, tick, is_guarded, &mut messages);
        }
        for (place, process) in chain.iter_mut().enumerate() {
            if place > 0 && process.lacks(&messages) {
                continue;
            }
            let mut before = Vec::new();
            process.step.save(&mut before);
            let mut read = process.step.reads().iter();
            let is_told = read.all(|port| {
                let message = messages.get(port.topic);
                message.is_none_or(|message| (port.not_finite)(message.bytes()).is_none())
            });
            let (flow, sent) = process.answer(tick, &messages);
            if flow == Flow::Over {
                return;
            }
            if place == 0 {
                messages.remove(TorqueCommand::TOPIC);
            }
            for (port, mut message) in sent {
                holds_safe_torques(port, &message, &case.robot);
                if (port.not_finite)(message.bytes()).is_some() {
                    let answers_all = place == 0 || place == 1 && is_told;
                    assert!(!answers_all, "{} of {place}: {message:?}", port.topic);
                    if is_guarded {
                        assert!(!process.is_sane, "{} of {place}: {message:?}", port.topic);
                        process.step.restore(&before).expect("its own state");
                        process.is_sane = true;
                        break;
                    }
                }
                if touched & 1 << place != 0 {
                    hand.corrupt(&mut message);
                    if port.topic == TorqueCommand::TOPIC {
                        let command: &mut TorqueCommand = from_bytes_mut(message.bytes_mut());
                        command.phase %= 3;
                    }
                }
                let is_refused = is_guarded && (port.not_finite)(message.bytes()).is_some();
                if dropped & 1 << place == 0 && !is_refused {
                    messages.insert(port.topic, message);
                }
            }
        }
    }
}

/// A request of a person, of any numbers.
fn ask(hand: &mut Hand<'_>, tick: u64, is_guarded: bool, messages: &mut Messages) {
    let zero = || Packed::of(&vec![0; size_of::<Target>()]);
    let mut message = messages.get(Target::TOPIC).cloned().unwrap_or_else(zero);
    hand.spoil_words(&mut message, 0);
    let given: &mut Target = from_bytes_mut(message.bytes_mut());
    (given.header.tick, given.target.kind) = (tick, u32::from(hand.byte() % 6));
    match !is_guarded || given.is_finite() {
        true => messages.insert(Target::TOPIC, message),
        false => messages.remove(Target::TOPIC),
    };
}
