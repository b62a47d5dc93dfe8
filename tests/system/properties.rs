//! What must hold for any input whatever: the same functions are fuzzed in `tests/fuzz` and tried with random inputs here.
#![allow(dead_code, reason = "each fuzz target uses one of them")]

use std::cell::RefCell;

use model::{Robot, RobotSource};
use shared_types::graph::Graph;
use shared_types::scenario::Scenario;
use shared_types::wire::Part;
use shared_types::{Message, SingularityReport, StateEstimate, TorqueCommand};

/// A scenario is refused with a sentence, or it is valid: written out and read again it is the same.
pub fn scenario(text: &str) {
    match Scenario::parse("fuzz.toml", text, &[]) {
        Ok(scenario) => {
            let again = toml::to_string(&scenario).expect("a scenario can be written");
            assert_eq!(Scenario::parse("fuzz.toml", &again, &[]).expect("and read again"), scenario);
            assert!(scenario.duration_s().is_finite() && scenario.dt_s() > 0.0);
        }
        Err(error) => assert!(error.to_string().starts_with("fuzz.toml"), "{error}"),
    }
}

/// A graph is refused with a sentence, or it is one.
pub fn graph(text: &str) {
    match Graph::parse("fuzz.toml", text) {
        Ok(graph) => assert!(!graph.process.is_empty()),
        Err(error) => assert!(error.to_string().starts_with("fuzz.toml"), "{error}"),
    }
}

/// A URDF is refused with a sentence, or its arm can be computed with.
pub fn urdf(text: &str) {
    let source = RobotSource { name: "fuzz".to_owned(), description: String::new(), urdf: text.to_owned() };
    match Robot::from_source(&source) {
        Ok(robot) => assert!(robot.joints.iter().all(|joint| joint.lower <= joint.upper && joint.effort >= 0.0), "{robot:?}"),
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}

/// Fills messages from bytes, and with zeros where they end.
struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn next<M: Message>(&mut self) -> M {
        let mut message = M::zeroed();
        let n = self.0.len().min(size_of::<M>());
        bytemuck::bytes_of_mut(&mut message)[..n].copy_from_slice(&self.0[..n]);
        self.0 = &self.0[n..];
        message
    }
}

/// The check at the edge finds every number that is not finite, and no other.
pub fn validation(bytes: &[u8]) {
    fn check<M: Message>(bytes: &[u8]) {
        let message: M = Bytes(bytes).next();
        let begin = size_of::<shared_types::Header>();
        // Integers lie among the numbers: bits that would be an infinity there are none.
        let words: &[u64] = bytemuck::cast_slice(&bytemuck::bytes_of(&message)[begin..]);
        let is_clean = words.iter().all(|word| f64::from_bits(*word).is_finite());
        assert!(!is_clean || message.is_finite(), "{message:?}");
        let mut poisoned = message;
        let place = bytes.first().copied().unwrap_or(0) as usize % 8;
        bytemuck::bytes_of_mut(&mut poisoned)[begin + 8 * place..begin + 8 * place + 8].copy_from_slice(&f64::NAN.to_ne_bytes());
        assert!(!poisoned.is_finite(), "a NaN among the first eight numbers is not seen: {poisoned:?}");
    }
    check::<shared_types::SensorSample>(bytes);
    check::<shared_types::PlantState>(bytes);
    check::<StateEstimate>(bytes);
    check::<TorqueCommand>(bytes);
    let report: SingularityReport = Bytes(bytes).next();
    let _ = (report.is_finite(), control::wire::report::<6>(&report));
}

const SCENARIO: &str = "fig5-wrist-rotation";

fn built_in() -> (Robot, Scenario) {
    let scenario = Scenario::parse(SCENARIO, sim::scenarios::text(SCENARIO).expect("built in"), &[]).expect("valid");
    (Robot::builtin(&scenario.robot).expect("built in"), scenario)
}

thread_local! {
    static BUILT_IN: (Robot, Scenario) = built_in();
    static PLANT: RefCell<Option<Box<dyn plant::Step>>> = const { RefCell::new(None) };
}

/// Asserts that a torque is finite and within the arm's limits.
fn is_safe(tau: &[f64], robot: &Robot, who: &str) {
    for (joint, (tau, limit)) in tau.iter().zip(&robot.joints).enumerate() {
        assert!(tau.abs() <= limit.effort * (1.0 + 1e-12), "{who}: {tau} N·m at joint {joint}, allowed {}", limit.effort);
    }
    assert!(tau[robot.joints.len()..].iter().all(|tau| *tau == 0.0));
}

/// Whatever the controller is told, tick after tick, its torque is finite and within the limits.
pub fn controller(bytes: &[u8]) {
    BUILT_IN.with(|(robot, scenario)| {
        let mut cycle = controller::cycle(robot, scenario).expect("built in");
        let mut bytes = Bytes(bytes);
        for tick in 0..4 {
            let (mut estimate, mut report): (StateEstimate, SingularityReport) = (bytes.next(), bytes.next());
            (estimate.header.tick, report.header.tick) = (tick, tick);
            let command = cycle.step(&estimate, &report);
            is_safe(&command.tau, robot, "controller");
            assert_eq!(command.header.tick, tick);
        }
        let mut poisoned = controller::cycle(robot, scenario).expect("built in");
        poisoned.resume(&bytes.next());
        is_safe(&poisoned.step(&bytes.next(), &bytes.next()).tau, robot, "resumed controller");
    });
}

/// Whatever the drive is told, what acts on the arm is finite and within the limits, and what the sensors say is finite.
pub fn drive(bytes: &[u8]) {
    BUILT_IN.with(|(robot, scenario)| {
        PLANT.with_borrow_mut(|plant| {
            // The arm goes on from where the last input left it, for a while: any state is one that it can be in.
            let mut cycle =
                plant.take().filter(|cycle| !cycle.is_over()).unwrap_or_else(|| plant::cycle(robot, scenario).expect("built in"));
            let mut bytes = Bytes(bytes);
            for tick in 0..8 {
                let mut command: TorqueCommand = bytes.next();
                command.phase %= 2;
                cycle.step(Some(&command));
                let (sample, truth) = cycle.sample(tick);
                assert!(sample.is_finite() && truth.is_finite(), "{sample:?} {truth:?}");
                is_safe(&sample.tau_drive, robot, "drive");
            }
            *plant = Some(cycle);
        });
    });
}
