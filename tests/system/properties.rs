//! Properties that hold for any input: the same functions are fuzzed in `tests/fuzz` and tried with random inputs here.
#![allow(dead_code, reason = "each fuzz target uses one of them")]

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::rc::Rc;

use bytemuck::Pod;
use message_log::{LogReader, LogWriter};
use model::{Robot, RobotSource};
use runtime::{ControlPage, MAX_PROCESSES, MOST_FAULTS, Manifest, RunDir};
use shared_types::fault::{Fault, Kind};
use shared_types::graph::Graph;
use shared_types::job::Job;
use shared_types::scenario::{Scenario, Strategy};
use shared_types::summary::Summary;
use shared_types::topics::{self, COUNT, Each, TOPICS, Topic};
use shared_types::wire::{Field, Part, Stamps};
use shared_types::{
    Checkpoint, ControlState, Layout, Message, PlantState, SensorSample, SingularityReport, SingularityState, StateEstimate, TorqueCommand,
};

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
    fn next<M: Pod>(&mut self) -> M {
        let mut message = M::zeroed();
        let n = self.0.len().min(size_of::<M>());
        bytemuck::bytes_of_mut(&mut message)[..n].copy_from_slice(&self.0[..n]);
        self.0 = &self.0[n..];
        message
    }
}

/// Where the numbers of a message lie, in bytes from its start.
fn numbers<M: Layout>() -> Vec<usize> {
    fn of(fields: &[Field], begin: usize, found: &mut Vec<usize>) {
        for field in fields {
            let at = begin + field.offset;
            if field.type_name.contains("SingularityState") {
                let each = (at..at + field.size).step_by(size_of::<SingularityState>());
                each.for_each(|begin| of(SingularityState::LAYOUT, begin, found));
            } else if field.type_name.contains("f64") {
                found.extend((at..at + field.size).step_by(8));
            }
        }
    }
    let mut found = Vec::new();
    of(M::FIELDS, 0, &mut found);
    found
}

/// The check at the edge finds every number that is not finite, and no other.
pub fn validation(bytes: &[u8]) {
    fn check<M: Message>(bytes: &[u8]) {
        let message: M = Bytes(bytes).next();
        let begin = size_of::<shared_types::Header>();
        let numbers = numbers::<M>();
        let number = |message: &M, at: usize| bytemuck::pod_read_unaligned::<f64>(&bytemuck::bytes_of(message)[at..at + 8]);
        let is_finite = numbers.iter().all(|at| number(&message, *at).is_finite());
        assert_eq!(message.is_finite(), is_finite, "{message:?}");
        // The rest are integers, and any will do.
        assert!(numbers.first().is_some_and(|first| *first >= begin) && numbers.len() * 8 <= size_of::<M>() - begin);
        let place = bytes.first().map_or(0, |choice| usize::from(*choice)) * numbers.len() / 256;
        for poison in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut poisoned = message;
            bytemuck::bytes_of_mut(&mut poisoned)[numbers[place]..numbers[place] + 8].copy_from_slice(&poison.to_ne_bytes());
            assert!(!poisoned.is_finite(), "{poison} at byte {} is not seen: {poisoned:?}", numbers[place]);
        }
    }
    struct CheckEach<'a>(&'a [u8]);
    impl Each for CheckEach<'_> {
        type Output = ();
        fn each<M: Topic>(&mut self) {
            check::<M>(self.0);
        }
    }
    topics::each(&mut CheckEach(bytes));
    let report: SingularityReport = Bytes(bytes).next();
    if let Ok(read) = control::wire::report::<6>(&report) {
        assert!(read.count <= shared_types::MAX_SINGULARITIES);
    }
}

/// An arm with its task, under a control law.
type Case = Rc<(Robot, Scenario)>;

thread_local! {
    /// Those met so far; `None` where arm and law do not fit.
    static CASES: RefCell<BTreeMap<(usize, usize, bool), Option<Case>>> = const { RefCell::new(BTreeMap::new()) };
    /// A run's directory, for the files in it.
    static RUN: RunDir = RunDir::create().expect("shared memory");
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

/// Takes choices from bytes; zeros where they end.
struct Hand<'a>(&'a [u8]);

impl Hand<'_> {
    fn take<const N: usize>(&mut self) -> [u8; N] {
        let mut taken = [0; N];
        let n = self.0.len().min(N);
        taken[..n].copy_from_slice(&self.0[..n]);
        self.0 = &self.0[n..];
        taken
    }

    fn byte(&mut self) -> u8 {
        self.take::<1>()[0]
    }

    /// A number that makes trouble, or the old one moved, or any.
    fn number(&mut self, old: f64) -> f64 {
        const HARD: [f64; 16] = [
            0.0,
            -0.0,
            1e-310,
            f64::EPSILON,
            1.0,
            -1.0,
            std::f64::consts::PI,
            1e6,
            -1e9,
            1e18,
            1e154,
            -1e200,
            f64::MAX,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::NAN,
        ];
        let how = self.byte();
        match how >> 6 {
            0 => HARD[how as usize % HARD.len()],
            1 => old * HARD[how as usize % HARD.len()],
            2 => old + (f64::from(how & 63) - 31.5) * 1e-3,
            _ => f64::from_ne_bytes(self.take()),
        }
    }

    /// Puts a number somewhere in a message, stamps left out: no computation reads them.
    fn corrupt<M: Message>(&mut self, message: &mut M) {
        self.spoil_words(message, size_of::<Stamps>() / 8);
    }

    /// Puts a number somewhere behind the first words.
    fn spoil_words<M: Pod>(&mut self, message: &mut M, first: usize) {
        let words: &mut [u64] = bytemuck::cast_slice_mut(bytemuck::bytes_of_mut(message));
        let words = &mut words[first..];
        for _ in 0..=self.byte() % 4 {
            let place = u16::from_ne_bytes(self.take()) as usize % words.len();
            words[place] = self.number(f64::from_bits(words[place])).to_bits();
        }
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

    /// It is started again from a last checkpoint that somebody may have changed.
    fn tampered(&mut self, hand: &mut Hand<'_>) -> Option<C> {
        let mut last = self.checkpoint?;
        hand.spoil_words(&mut last, 0);
        let is_possible = last.is_finite() || !self.guarded;
        self.sane = if is_possible { is_sane(&last) } else { self.sane };
        is_possible.then_some(last)
    }
}

/// The whole chain with somebody's fingers in it: of every message any number may be replaced on its way, messages are lost, processes start again
/// from a last message that was tampered with. What acts on the arm stays finite and within the limits. Where the edge refuses what is not finite,
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

/// A file of kept messages of any bytes is read to its end or refused with a sentence, and a writer that continues it corrupts nothing.
pub fn message_log(bytes: &[u8]) {
    fn check<M: Message>(bytes: &[u8], run: &Path) {
        let path = run.join(format!("{}.log", M::TOPIC));
        let read = || -> Result<Vec<M>, String> {
            let mut kept = LogReader::<M>::open(run).map_err(|error| error.to_string())?;
            let mut messages = Vec::new();
            while let Some(message) = kept.next_message().map_err(|error| error.to_string())? {
                messages.push(message);
            }
            Ok(messages)
        };
        let more: [M; 3] = [M::zeroed(); 3];
        std::fs::write(&path, bytes).expect("shared memory");
        let before = read();
        match LogWriter::<M>::resume(run, 0, |_| {}) {
            Ok(mut keep) => {
                more.iter().for_each(|message| keep.add(message).expect("shared memory"));
                keep.finish().expect("shared memory");
                let expected = before.map(|messages| [&messages[..], &more].concat());
                let bytes = |messages: Vec<M>| bytemuck::cast_slice::<M, u8>(&messages).to_vec();
                assert_eq!(read().map(bytes), expected.map(bytes), "what was there is there, and what came is behind it");
            }
            Err(error) => assert!(before.is_err_and(|sentence| !sentence.is_empty()), "{error}"),
        }
    }
    // With a right head, or with none: a fuzzer would have to find twenty-four bytes first.
    let (choice, rest) = bytes.split_first().unwrap_or((&0, &[]));
    RUN.with(|run| {
        let run = run.path();
        let with_head = |head: Vec<u8>| if choice & 8 != 0 { [head, rest.to_vec()].concat() } else { rest.to_vec() };
        fn head<M: Message>(run: &Path) -> Vec<u8> {
            LogWriter::<M>::create(run).and_then(LogWriter::finish).expect("shared memory");
            std::fs::read(run.join(format!("{}.log", M::TOPIC))).expect("shared memory")
        }
        struct CheckKept<'a>(&'a dyn Fn(Vec<u8>) -> Vec<u8>, &'a Path);
        impl Each for CheckKept<'_> {
            type Output = ();
            fn each<M: Topic>(&mut self) {
                check::<M>(&(self.0)(head::<M>(self.1)), self.1);
            }
        }
        topics::named(TOPICS[usize::from(*choice) % COUNT], &mut CheckKept(&with_head, run));
    });
}

/// A manifest as a run has it, but shorter.
pub const MANIFEST: &str = r#"{"mode":"lockstep","rate_hz":1000,"wait_limit":{"secs":10,"nanos":0},"processes":[
{"name":"plant","reads":["torque"],"writes":["sensor"],"polled":false,"makes_ticks":true,"core":0,"priority":80},
{"name":"controller","reads":["sensor"],"writes":["torque"],"polled":false,"core":null,"priority":null}]}"#;

/// A manifest of any bytes is refused with a sentence, or one that a run can be held by.
pub fn manifest(bytes: &[u8]) {
    RUN.with(|run| {
        std::fs::write(run.path().join("manifest.json"), bytes).expect("shared memory");
        match Manifest::read(run) {
            Ok(manifest) => {
                assert!(manifest.period_ns() > 0 && manifest.processes.len() <= MAX_PROCESSES);
                for topic in manifest.topics() {
                    let woken = manifest.woken_by(topic).chain(manifest.writer_of(topic));
                    woken.for_each(|index| assert!(index < manifest.processes.len()));
                }
                manifest.write(run).expect("what was read can be written");
                assert_eq!(Manifest::read(run).expect("and read again"), manifest);
            }
            Err(error) => assert!(!error.to_string().is_empty()),
        }
    });
}

/// For any bytes on a run's control page, a reader stays within bounds: counts, times, the arm's state, every fault in the fault table.
pub fn control_page(bytes: &[u8]) {
    RUN.with(|run| {
        let path = run.path().join("control_page");
        let _ = std::fs::remove_file(&path);
        drop(ControlPage::create(run).expect("shared memory"));
        let file = std::fs::OpenOptions::new().write(true).open(&path).expect("shared memory");
        let size = file.metadata().expect("shared memory").len();
        let mut hand = Hand(bytes);
        while !hand.0.is_empty() {
            // Behind the mark by which a control page is known.
            let (place, word) = (u64::from(u32::from_ne_bytes(hand.take())), hand.take::<8>());
            file.write_all_at(&word, 8 + 8 * (place % (size / 8 - 1))).expect("shared memory");
        }
        let control_page = ControlPage::open(run).expect("its size and mark are right");
        let _ = (control_page.stop(), control_page.live_state());
        for index in 0..MAX_PROCESSES {
            let line = control_page.process(index);
            let (step, age) = (line.step(), line.age());
            let _ = (line.state(), line.counts(), line.pid(), step.count(), step.since(&age).quantile_us(0.99), age.longest_us());
        }
        let accounts: Vec<_> = control_page.fault_table().records().collect();
        assert!(accounts.len() <= MOST_FAULTS);
        for (_, account) in accounts {
            for process in ["plant", "controller", "recorder", "nobody"] {
                if let Some(fault) = account.scheduled.fault(process) {
                    let _ = (fault.to_string(), fault.schedule(account.scheduled.process, 1000, 1));
                }
            }
        }
        let scheduled = Fault::new("controller", Kind::Kill).schedule(3, 1000, 7).expect("a fault that makes sense");
        if let Some(place) = control_page.fault_table().request(&scheduled) {
            assert!(place < MOST_FAULTS && !control_page.fault_table().is_in_force(place));
        }
        control_page.fault_table().mark_detected(3, 5, 5);
        control_page.ring_all();
    });
}

/// A job as a run leaves it.
pub fn job() -> String {
    let job = Job {
        run: "armplane-0-1-1-0".to_owned(),
        version: "0.1.0".to_owned(),
        mode: shared_types::job::Mode::Lockstep,
        out: "runs/fig5-wrist-rotation-001".into(),
        record: true,
        messages: true,
        live: false,
        scenario: Scenario::parse("fig5", sim::scenarios::text("fig5-wrist-rotation").expect("built in"), &[]).expect("valid"),
        robot: Default::default(),
        graph: Graph::parse("graph.toml", include_str!("../../services/graph.toml")).expect("valid"),
    };
    serde_json::to_string(&job).expect("a job can be written")
}

/// A results folder's description of its run is refused with a sentence, or describes a possible run.
pub fn results(bytes: &[u8]) {
    if let Ok(job) = serde_json::from_slice::<Job>(bytes) {
        match job.check() {
            Ok(()) => {
                assert!((50..=20_000).contains(&job.scenario.rate_hz) && job.scenario.duration_s() <= 36_000.0);
                assert!(job.graph.writer("torque").is_some());
                let again = serde_json::to_vec(&job).expect("a job can be written");
                assert_eq!(serde_json::from_slice::<Job>(&again).expect("and read again"), job);
            }
            Err(complaint) => assert!(!complaint.to_string().is_empty()),
        }
    }
    if let Ok(summary) = serde_json::from_slice::<Summary>(bytes) {
        let again = serde_json::to_vec(&summary).expect("a summary can be written");
        assert!(serde_json::from_slice::<Summary>(&again).is_ok());
    }
}
