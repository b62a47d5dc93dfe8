//! Tests of ports and waits between shells of one process: messages delivered, refused and counted.

use std::time::Duration;

use process::Packed;
use shared_types::{Message, PlantState, SensorSample, SingularityReport, StateEstimate};

use crate::bus::depth::{CHAIN_DEPTH, RECORDER_DEPTH};
use crate::bus::error::TopicError;
use crate::bus::format::Format;
use crate::bus::node::join;
use crate::bus::topic::Topic;
use crate::{
    Collector, ControlPage, Count, Hub, Interrupted, Manifest, Mode, Phase, Process, ProcessError,
    Reader, RunDir, SendError, Shell, Stop, Writer, now_ns,
};

mod allocations;
mod declared;
mod hoarder;
mod loans;

/// A run without a launcher: its phases are through, so that shells of one thread need not wait for each other.
struct Stage {
    run: RunDir,
    control_page: ControlPage,
    _hub: Hub,
}

fn stage(mode: Mode) -> Stage {
    stage_of(mode, &["plant", "estimator", "recorder"], |_| ())
}

/// A run of some of three processes, changed before it begins.
fn stage_of(mode: Mode, names: &[&str], change: impl FnOnce(&mut Manifest)) -> Stage {
    let process = |name: &str, reads: &[&str], writes: &[&str]| {
        let own = |names: &[&str]| names.iter().map(ToString::to_string).collect();
        Process {
            name: name.into(),
            reads: own(reads),
            writes: own(writes),
            hop: ["plant", "estimator"].iter().position(|hop| *hop == name),
            ..Process::default()
        }
    };
    let mut processes = vec![
        process("plant", &[], &["sensor"]),
        process("estimator", &["sensor"], &["estimate"]),
        process("recorder", &["sensor"], &[]),
    ];
    processes.retain(|process| names.contains(&process.name.as_str()));
    let mut manifest = Manifest {
        mode,
        rate_hz: 1000,
        wait_limit: Some(Duration::from_millis(50)),
        processes,
        messages: Vec::new(),
        from: 0,
    };
    change(&mut manifest);
    let run = RunDir::create().unwrap();
    manifest.write(&run).unwrap();
    let control_page = ControlPage::create(&run).unwrap();
    let hub = Hub::create(&run, &manifest).unwrap();
    for index in 0..names.len() {
        control_page.process(index).begin_incarnation();
    }
    control_page.begin(Phase::Work);
    Stage {
        run,
        control_page,
        _hub: hub,
    }
}

impl Stage {
    /// The shell of a process that has its declared outputs open, or opens them next.
    fn shell(&self, process: &str) -> Shell {
        let shell = Shell::open(self.run.path(), process).unwrap();
        if process == "estimator" {
            // Its end stays attached to the shell.
            drop(shell.writer::<StateEstimate>().unwrap());
        }
        shell
    }

    /// A plant that sends, and an estimator that reads.
    fn pair(&self) -> (Shell, Writer<SensorSample>, Reader<SensorSample>) {
        let (plant, estimator) = (self.shell("plant"), self.shell("estimator"));
        let ends = (plant.writer().unwrap(), estimator.reader().unwrap());
        (estimator, ends.0, ends.1)
    }
}

fn send<M: Message>(writer: &mut Writer<M>, ticks: impl IntoIterator<Item = u64>) {
    for tick in ticks {
        writer.loan(tick).unwrap();
        writer.send().unwrap();
    }
}

/// The tick of the next message, if there is one.
fn next(inlet: &mut Reader<SensorSample>) -> Result<Option<u64>, Interrupted> {
    inlet
        .next()
        .map(|message| message.map(|message| message.header.tick))
}

/// Likewise of that of a tick.
fn at(inlet: &mut Reader<SensorSample>, tick: u64) -> Result<Option<u64>, Interrupted> {
    inlet
        .at(tick)
        .map(|message| message.map(|message| message.header.tick))
}

fn collected(collector: &mut Collector) -> Vec<u64> {
    let mut ticks = Vec::new();
    let take = |message: &[u8]| ticks.push(Packed::of(message).header().tick);
    collector.collect(take).unwrap();
    ticks
}

/// From whom a wait that has timed out expected something.
fn late(error: &Interrupted) -> Option<&str> {
    match error {
        Interrupted::TimedOut { from, .. } => Some(from),
        _ => None,
    }
}

#[test]
fn in_lockstep_every_tick_is_handed_over_once_and_in_order() {
    let stage = stage(Mode::Lockstep);
    let (estimator, mut sensors, mut inlet) = stage.pair();
    let mut estimates = estimator.writer::<StateEstimate>().unwrap();
    send(&mut sensors, [0, 1, 1, 2]);
    for tick in 0..3 {
        assert_eq!(next(&mut inlet), Ok(Some(tick)));
        send(&mut estimates, [tick]);
    }
    assert_eq!(estimator.count(Count::Repeated), 1);
    send(&mut sensors, [4]);
    let is_lost = Interrupted::Lost {
        process: "estimator".into(),
        topic: "sensor",
        expected: 3,
        found: 4,
    };
    assert_eq!(next(&mut inlet), Err(is_lost));
    // A message of a later tick stays in the buffer.
    assert_eq!(at(&mut inlet, 4), Ok(Some(4)));
}

#[test]
fn in_real_time_a_replaced_recorder_gets_the_last_messages_once() {
    let stage = stage(Mode::Realtime);
    let (_estimator, mut sensors, _inlet) = stage.pair();
    let first = stage.shell("recorder");
    let mut drain = first.collector("sensor").unwrap();
    send(&mut sensors, 0..5);
    assert_eq!(collected(&mut drain), (0..5).collect::<Vec<_>>());
    // It has written three of them, and nobody reads while two more come.
    drop((first, drain));
    send(&mut sensors, 5..7);
    stage.control_page.process(2).begin_incarnation();
    let second = stage.shell("recorder");
    let mut drain = second.collector("sensor").unwrap();
    drain.go_on(Some(2));
    send(&mut sensors, 7..8);
    assert_eq!(collected(&mut drain), (3..8).collect::<Vec<_>>());
    assert_eq!(second.count(Count::Lost), 0);
}

#[test]
fn the_end_of_a_run_waits_for_a_recorder_that_came_after_the_last_message() {
    let stage = stage(Mode::Realtime);
    let plant = stage.shell("plant");
    let mut sensors = plant.writer::<SensorSample>().unwrap();
    send(&mut sensors, 0..5);
    stage.control_page.process(2).begin_incarnation();
    let recorder = stage.shell("recorder");
    let mut drain = recorder.collector("sensor").unwrap();
    drain.go_on(Some(2));
    assert_eq!(drain.collect(|_| ()), Ok(false));
    plant
        .shared
        .wait_for_record(5, now_ns() + 20_000_000)
        .unwrap();
    assert_eq!(collected(&mut drain), [3, 4]);
    assert_eq!(drain.collect(|_| ()), Ok(true));
}

#[test]
fn in_real_time_a_replacement_is_not_held_up_by_messages_of_before() {
    let stage = stage(Mode::Realtime);
    let mut sensors = stage.shell("plant").writer::<SensorSample>().unwrap();
    send(&mut sensors, 0..100);
    stage.control_page.process(1).begin_incarnation();
    let estimator = stage.shell("estimator");
    let mut inlet = estimator.reader().unwrap();
    // It looks before the writer has connected to it, and given it the last messages.
    assert_eq!(late(&next(&mut inlet).unwrap_err()), Some("plant"));
    send(&mut sensors, [100]);
    assert_eq!(at(&mut inlet, 100), Ok(Some(100)));
    send(&mut sensors, [101]);
    assert_eq!(next(&mut inlet), Ok(Some(101)));
}

#[test]
fn a_process_that_asks_for_more_and_has_not_answered_is_told_so() {
    let stage = stage(Mode::Lockstep);
    let (_estimator, mut sensors, mut inlet) = stage.pair();
    send(&mut sensors, [0, 1]);
    assert_eq!(next(&mut inlet), Ok(Some(0)));
    let unsent = Interrupted::Unsent {
        process: "estimator".into(),
        topic: "estimate".into(),
        tick: 0,
    };
    assert_eq!(next(&mut inlet), Err(unsent));
}

#[test]
fn in_real_time_the_newest_counts_and_what_is_passed_over_is_counted() {
    let stage = stage(Mode::Realtime);
    let (estimator, mut sensors, mut inlet) = stage.pair();
    send(&mut sensors, [0]);
    assert_eq!(next(&mut inlet), Ok(Some(0)));
    send(&mut sensors, 1..=5);
    assert_eq!(next(&mut inlet), Ok(Some(5)));
    assert_eq!(estimator.count(Count::Lost), 4);
    send(&mut sensors, 6..=8);
    assert_eq!(at(&mut inlet, 7), Ok(Some(7)), "an older one, as asked");
    assert_eq!(at(&mut inlet, 8), Ok(Some(8)));
    send(&mut sensors, 10..=11);
    assert_eq!(at(&mut inlet, 9), Ok(None), "it will not come any more");
    assert_eq!(next(&mut inlet), Ok(Some(11)));
}

#[test]
fn every_wait_ends_by_deadline_limit_or_stop() {
    let stage = stage(Mode::Realtime);
    let (estimator, _sensors, mut inlet) = stage.pair();
    let deadline = Some(now_ns() + 1_000_000);
    assert!(inlet.arriving(0, deadline).unwrap().is_none(), "late");
    assert_eq!(late(&at(&mut inlet, 0).unwrap_err()), Some("plant"));
    stage.control_page.request_stop(Stop::Chain);
    assert_eq!((at(&mut inlet, 0), next(&mut inlet)), (Ok(None), Ok(None)));
    assert!(estimator.is_stopping());
    assert!(!stage.shell("recorder").is_stopping(), "it is stopped last");
}

#[test]
fn a_message_that_is_not_finite_does_not_leave() {
    let stage = stage(Mode::Lockstep);
    let (_estimator, mut sensors, mut inlet) = stage.pair();
    sensors.loan(0).unwrap().q_encoder[3] = f64::NAN;
    let refused = SendError::NotFinite {
        process: "plant".into(),
        topic: "sensor",
        tick: 0,
        field: "q_encoder",
    };
    assert_eq!(sensors.send(), Err(refused));
    assert_eq!(stage.control_page.process(0).count(Count::NotFinite), 1);
    send(&mut sensors, [0]);
    assert_eq!(inlet.next().unwrap().unwrap().q_encoder[3], 0.0);
}

#[test]
fn stamps_tell_the_way_of_the_data() {
    let stage = stage(Mode::Lockstep);
    let (estimator, mut sensors, mut inlet) = stage.pair();
    let mut estimates = estimator.writer::<StateEstimate>().unwrap();
    let bus = join(&stage.run, "probe", false).unwrap();
    let topic = Topic::open(&bus, Format::of::<StateEstimate>()).unwrap();
    let probe = topic.receiver(CHAIN_DEPTH).unwrap();
    let mut stamps_of = |tick| {
        send(&mut estimates, [tick]);
        probe.receive().unwrap().unwrap().header().stamps
    };
    let forged = sensors.loan(0).unwrap();
    forged.header.stamps.sent_ns = [7; shared_types::wire::MAX_HOPS];
    sensors.send().unwrap();
    assert_eq!(next(&mut inlet), Ok(Some(0)));
    let shared_types::Stamps {
        received_ns,
        sent_ns,
        ..
    } = stamps_of(0);
    assert!(sent_ns[0] > 7, "only this hop's own time counts");
    assert!(sent_ns[0] <= received_ns[1] && received_ns[1] <= sent_ns[1]);
    assert_eq!(sent_ns[2..4], [0, 0], "the data has not been there");
    // A message of another tick than the input's does not inherit its way.
    assert_eq!(stamps_of(1).sent_ns[0], 0);
}

#[test]
fn a_reader_that_never_reads_blocks_nobody_and_finds_the_newest() {
    let stage = stage(Mode::Realtime);
    let (_estimator, mut sensors, mut inlet) = stage.pair();
    let recorder = stage.shell("recorder");
    let mut drain = recorder.collector("sensor").unwrap();
    let (count, depth) = (10 * RECORDER_DEPTH as u64, RECORDER_DEPTH as u64);
    send(&mut sensors, 0..count);
    assert_eq!(next(&mut inlet), Ok(Some(count - 1)));
    assert_eq!(
        collected(&mut drain),
        (count - depth..count).collect::<Vec<_>>()
    );
    assert_eq!(recorder.count(Count::Lost), count - depth);
}

#[test]
fn in_lockstep_the_source_waits_for_the_recorder() {
    let stage = stage_of(Mode::Lockstep, &["plant", "recorder"], |_| ());
    let (plant, recorder) = (stage.shell("plant"), stage.shell("recorder"));
    let mut sensors = plant.writer::<SensorSample>().unwrap();
    let mut drain = recorder.collector("sensor").unwrap();
    let mut tick_source = plant.tick_source(0);
    let mut sent = 0;
    let error = loop {
        match tick_source.next() {
            Ok(tick) => send(&mut sensors, tick),
            Err(error) => break error,
        }
        sent += 1;
    };
    assert!((1..RECORDER_DEPTH as u64).contains(&sent), "{sent} ticks");
    assert_eq!(late(&error), Some("recorder"));
    // Two rounds: the first begins, the second says that the first is taken in.
    assert!(recorder.poll(Duration::ZERO).unwrap());
    collected(&mut drain);
    assert!(recorder.poll(Duration::ZERO).unwrap());
    assert_eq!(tick_source.next().unwrap(), Some(sent));
    assert_eq!(recorder.count(Count::Lost), 0);
}

#[test]
fn a_polled_process_gets_one_more_round_after_the_stop() {
    let stage = stage(Mode::Lockstep);
    let recorder = stage.shell("recorder");
    assert!(recorder.poll(Duration::ZERO).unwrap());
    stage.control_page.request_stop(Stop::Everything);
    // To take in what was on the way.
    assert!(recorder.poll(Duration::from_secs(60)).unwrap());
    assert!(!recorder.poll(Duration::from_secs(60)).unwrap());
}

#[test]
fn another_wire_format_is_refused_with_both_versions() {
    let manifest = Manifest::read(&stage(Mode::Lockstep).run).unwrap();
    let run = RunDir::create().unwrap();
    manifest.write(&run).unwrap();
    let _page = ControlPage::create(&run).unwrap();
    let other = Format {
        layout: 0xabad_cafe,
        ..Format::of::<SensorSample>()
    };
    let bus = join(&run, "launcher", true).unwrap();
    let _topic = Topic::create(&bus, other, 1, false).unwrap();
    let plant = Shell::open(run.path(), "plant").unwrap();
    match plant.writer::<SensorSample>().map(drop) {
        Err(TopicError::WireFormat { found, ours, .. }) => assert_eq!(
            (found.as_str(), ours),
            ("00000000abadcafe", shared_types::topics::wire_hash())
        ),
        other => panic!("{other:?}"),
    }
}
