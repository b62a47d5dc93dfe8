//! Ports and waits between shells of one process: what they hand over, refuse and count.

use std::time::Duration;

use shared_types::fault::{Fault, Kind, ScheduledFault, Target};
use shared_types::process::Role;
use shared_types::{PlantState, SensorSample, SingularityReport, StateEstimate};

use crate::bus::error::TopicError;
use crate::bus::format::Format;
use crate::bus::node::join;
use crate::bus::topic::Topic;
use crate::{
    CHAIN_DEPTH, Collector, ControlPage, Count, Hub, Interrupted, Manifest, Mode, Origin, Phase,
    Process, ProcessError, RECORDER_DEPTH, RunDir, SendError, Shell, State, Stop, now_ns,
};

mod declared;
mod hoarder;
mod loans;

/// A run without a launcher: its phases are through, so that shells of one thread need not wait for each other.
struct Stage {
    run: RunDir,
    control_page: ControlPage,
    hub: Hub,
}

fn stage(mode: Mode) -> Stage {
    stage_of(mode, &["plant", "estimator", "recorder"])
}

/// A run of some of three processes.
fn stage_of(mode: Mode, names: &[&str]) -> Stage {
    let process = |name: &str, reads: &[&str], writes: &[&str], polled| {
        let own = |names: &[&str]| names.iter().map(ToString::to_string).collect();
        Process {
            name: name.into(),
            reads: own(reads),
            writes: own(writes),
            polled,
            hop: ["plant", "estimator"].iter().position(|hop| *hop == name),
            ..Process::default()
        }
    };
    let mut processes = vec![
        process("plant", &[], &["sensor"], false),
        process("estimator", &["sensor"], &["estimate"], false),
        process("recorder", &["sensor"], &[], true),
    ];
    processes.retain(|process| names.contains(&process.name.as_str()));
    let processes_count = processes.len();
    let manifest = Manifest {
        mode,
        rate_hz: 1000,
        wait_limit: Some(Duration::from_millis(50)),
        processes,
        messages: Vec::new(),
    };
    let run = RunDir::create().unwrap();
    manifest.write(&run).unwrap();
    let control_page = ControlPage::create(&run).unwrap();
    let hub = Hub::create(&run, &manifest).unwrap();
    for index in 0..processes_count {
        control_page.process(index).begin_incarnation();
    }
    control_page.begin(Phase::Work);
    Stage {
        run,
        control_page,
        hub,
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
}

/// A process that faults happen to.
fn on(index: u32) -> Target {
    Target::sending::<SensorSample>(index, if index == 0 { Role::World } else { Role::Stage })
}

fn sample(tick: u64) -> SensorSample {
    let mut sample = SensorSample::default();
    sample.header.tick = tick;
    sample
}

#[test]
fn in_lockstep_every_tick_is_handed_over_once_and_in_order() {
    let stage = stage(Mode::Lockstep);
    let (plant, estimator) = (
        stage.shell("plant"),
        Shell::open(stage.run.path(), "estimator").unwrap(),
    );
    let (mut sensors, mut inlet) = (
        plant.writer().unwrap(),
        estimator.reader::<SensorSample>().unwrap(),
    );
    let mut estimates = estimator.writer::<StateEstimate>().unwrap();
    let mut answer = |tick| {
        let mut estimate = StateEstimate::default();
        estimate.header.tick = tick;
        estimates.send(estimate).unwrap();
    };
    for tick in [0, 1, 1, 2] {
        sensors.send(sample(tick)).unwrap();
    }
    for tick in 0..3 {
        assert_eq!(inlet.next().unwrap().unwrap().header.tick, tick);
        answer(tick);
    }
    assert_eq!(estimator.count(Count::Repeated), 1);
    sensors.send(sample(4)).unwrap();
    let error = inlet.next().unwrap_err();
    assert_eq!(
        error,
        Interrupted::Lost {
            process: "estimator".into(),
            topic: "sensor",
            expected: 3,
            found: 4
        }
    );
    // A message of a later tick stays in the buffer.
    assert_eq!(inlet.at(4).unwrap().unwrap().header.tick, 4);
}

#[test]
fn a_process_that_asks_for_more_and_has_not_answered_is_told_so() {
    let stage = stage(Mode::Lockstep);
    let (plant, estimator) = (stage.shell("plant"), stage.shell("estimator"));
    let (mut sensors, mut inlet) = (
        plant.writer().unwrap(),
        estimator.reader::<SensorSample>().unwrap(),
    );
    [0, 1]
        .into_iter()
        .for_each(|tick| sensors.send(sample(tick)).unwrap());
    assert_eq!(inlet.next().unwrap().unwrap().header.tick, 0);
    let error = inlet.next().unwrap_err();
    assert_eq!(
        error,
        Interrupted::Unsent {
            process: "estimator".into(),
            topic: "estimate".into(),
            tick: 0
        }
    );
    let text = error.to_string();
    assert!(
        text.contains("has not sent topic \"estimate\" of tick 0")
            && text.contains("at every tick"),
        "{text}"
    );
}

#[test]
fn in_real_time_the_newest_counts_and_what_is_passed_over_is_counted() {
    let stage = stage(Mode::Realtime);
    let (plant, estimator) = (stage.shell("plant"), stage.shell("estimator"));
    let (mut sensors, mut inlet) = (
        plant.writer().unwrap(),
        estimator.reader::<SensorSample>().unwrap(),
    );
    sensors.send(sample(0)).unwrap();
    assert_eq!(inlet.next().unwrap().unwrap().header.tick, 0);
    (1..=5).for_each(|tick| sensors.send(sample(tick)).unwrap());
    assert_eq!(inlet.next().unwrap().unwrap().header.tick, 5);
    assert_eq!(estimator.count(Count::Lost), 4);
    (6..=8).for_each(|tick| sensors.send(sample(tick)).unwrap());
    assert_eq!(
        inlet.at(7).unwrap().unwrap().header.tick,
        7,
        "an older one, as asked"
    );
    assert_eq!(inlet.at(8).unwrap().unwrap().header.tick, 8);
    (10..=11).for_each(|tick| sensors.send(sample(tick)).unwrap());
    assert!(
        inlet.at(9).unwrap().is_none(),
        "it will not come any more, and that ends nothing"
    );
    assert_eq!(inlet.next().unwrap().unwrap().header.tick, 11);
}

#[test]
fn every_wait_ends_by_deadline_limit_or_stop() {
    let stage = stage(Mode::Realtime);
    let estimator = stage.shell("estimator");
    let mut inlet = estimator.reader::<SensorSample>().unwrap();
    assert!(
        inlet
            .arriving(0, Some(now_ns() + 1_000_000))
            .unwrap()
            .is_none(),
        "late"
    );
    let error = inlet.at(0).unwrap_err();
    assert!(matches!(&error, Interrupted::TimedOut { process, .. } if process == "estimator"));
    let text = error.to_string();
    assert!(
        text.contains("tick 0 of topic \"sensor\"") && text.contains("is plant alive?"),
        "{text}"
    );
    stage.control_page.request_stop(Stop::Chain);
    assert!(
        inlet.at(0).unwrap().is_none()
            && inlet.next().unwrap().is_none()
            && estimator.is_stopping()
    );
    assert!(!stage.shell("recorder").is_stopping(), "it is stopped last");
}

#[test]
fn a_death_between_sending_and_noting_it_is_not_repeated() {
    let stage = stage(Mode::Realtime);
    let line = stage.control_page.process(1);
    // Ticks 0 to 4 are closed and 5 was sent: by its readers the first tick missed is 6.
    line.set_ticks(5);
    let death = Fault {
        at_tick: Some(6),
        for_ticks: Some(20),
        ..Fault::new("estimator", Kind::Crash)
    }
    .schedule(&on(1), 1000, 0)
    .unwrap();
    let place = stage
        .control_page
        .fault_table()
        .enter(&death, Origin::Planned)
        .unwrap();
    stage
        .control_page
        .fault_table()
        .mark_injected(place, now_ns());
    line.begin_incarnation();
    let (plant, estimator) = (stage.shell("plant"), stage.shell("estimator"));
    let (mut sensors, mut inlet) = (
        plant.writer().unwrap(),
        estimator.reader::<SensorSample>().unwrap(),
    );
    for tick in [7, 25] {
        sensors.send(sample(tick)).unwrap();
        assert!(inlet.next().is_err(), "it is not back before tick 26");
    }
    sensors.send(sample(26)).unwrap();
    assert_eq!(inlet.next().unwrap().unwrap().header.tick, 26);
}

#[test]
fn a_dead_incarnation_is_fenced_off() {
    let stage = stage(Mode::Realtime);
    let (plant, estimator) = (stage.shell("plant"), stage.shell("estimator"));
    let (mut sensors, mut inlet) = (
        plant.writer().unwrap(),
        estimator.reader::<SensorSample>().unwrap(),
    );
    sensors.send(sample(0)).unwrap();
    // The plant dies with its message on the way; the launcher begins the next incarnation.
    stage.control_page.process(0).begin_incarnation();
    sensors.send(sample(1)).unwrap();
    let got = inlet.next().unwrap().unwrap();
    assert_eq!((got.header.tick, got.header.incarnation), (1, 2));
    assert_eq!(estimator.count(Count::Fenced), 1);
}

#[test]
fn a_message_that_is_not_finite_does_not_leave() {
    let stage = stage(Mode::Lockstep);
    let (plant, estimator) = (stage.shell("plant"), stage.shell("estimator"));
    let (mut sensors, mut inlet) = (
        plant.writer().unwrap(),
        estimator.reader::<SensorSample>().unwrap(),
    );
    let mut bad = sample(0);
    bad.q_encoder[3] = f64::NAN;
    let error = sensors.send(bad).unwrap_err();
    assert_eq!(
        error,
        SendError::NotFinite {
            process: "plant".into(),
            topic: "sensor",
            tick: 0,
            field: "q_encoder"
        }
    );
    assert_eq!(plant.count(Count::NotFinite), 1);
    sensors.send(sample(0)).unwrap();
    assert_eq!(inlet.next().unwrap().unwrap().q_encoder[3], 0.0);
}

#[test]
fn stamps_tell_the_way_of_the_data() {
    let stage = stage(Mode::Lockstep);
    let (plant, estimator) = (
        stage.shell("plant"),
        Shell::open(stage.run.path(), "estimator").unwrap(),
    );
    let (mut sensors, mut inlet) = (
        plant.writer().unwrap(),
        estimator.reader::<SensorSample>().unwrap(),
    );
    let mut estimates = estimator.writer::<StateEstimate>().unwrap();
    let key = || {
        let topic = Topic::open(
            &join(&stage.run, "probe", false).unwrap(),
            Format::of::<StateEstimate>(),
        )
        .unwrap();
        topic.receiver(CHAIN_DEPTH).unwrap()
    };
    let probe = key();
    let mut forged = sample(0);
    forged.header.stamps.sent_ns = [7; shared_types::wire::MAX_HOPS];
    sensors.send(forged).unwrap();
    let tick = inlet.next().unwrap().unwrap().header.tick;
    let mut estimate = StateEstimate::default();
    estimate.header.tick = tick;
    estimates.send(estimate).unwrap();
    let stamps = probe.receive().unwrap().unwrap().header().stamps;
    assert!(stamps.sent_ns[0] > 7, "only this hop's own time counts");
    assert!(
        stamps.sent_ns[0] <= stamps.received_ns[1] && stamps.received_ns[1] <= stamps.sent_ns[1]
    );
    assert_eq!(
        (stamps.sent_ns[2], stamps.sent_ns[3]),
        (0, 0),
        "the data has not been there"
    );
    // A message of another tick than the input's does not inherit its way.
    estimate.header.tick = tick + 1;
    estimates.send(estimate).unwrap();
    assert_eq!(
        probe.receive().unwrap().unwrap().header().stamps.sent_ns[0],
        0
    );
}

#[test]
fn a_reader_that_never_reads_blocks_nobody_and_finds_the_newest() {
    let stage = stage(Mode::Realtime);
    let (plant, estimator, recorder) = (
        stage.shell("plant"),
        stage.shell("estimator"),
        stage.shell("recorder"),
    );
    let mut sensors = plant.writer().unwrap();
    let (mut inlet, mut drain) = (
        estimator.reader::<SensorSample>().unwrap(),
        recorder.collector::<SensorSample>().unwrap(),
    );
    let count = 10 * RECORDER_DEPTH as u64;
    (0..count).for_each(|tick| sensors.send(sample(tick)).unwrap());
    assert_eq!(inlet.next().unwrap().unwrap().header.tick, count - 1);
    let mut ticks = Vec::new();
    drain.collect(|m| ticks.push(m.header.tick)).unwrap();
    assert_eq!(
        ticks,
        (count - RECORDER_DEPTH as u64..count).collect::<Vec<_>>()
    );
    assert_eq!(drain.lost(), count - RECORDER_DEPTH as u64);
}

#[test]
fn in_lockstep_the_source_waits_for_the_recorder() {
    let stage = stage_of(Mode::Lockstep, &["plant", "recorder"]);
    let (plant, recorder) = (stage.shell("plant"), stage.shell("recorder"));
    let (mut sensors, mut drain) = (
        plant.writer().unwrap(),
        recorder.collector::<SensorSample>().unwrap(),
    );
    let mut tick_source = plant.tick_source(0);
    let mut sent = 0;
    let error = loop {
        match tick_source.next() {
            Ok(tick) => sensors.send(sample(tick.unwrap())).unwrap(),
            Err(error) => break error,
        }
        sent += 1;
    };
    assert!(
        (1..RECORDER_DEPTH as u64).contains(&sent),
        "{sent} ticks fit into the recorder's buffer"
    );
    assert!(error.to_string().contains("is recorder alive?"), "{error}");
    // Two rounds: the first begins, the second says that the first is taken in.
    assert!(recorder.poll(Duration::ZERO).unwrap());
    drain.collect(|_| {}).unwrap();
    assert!(recorder.poll(Duration::ZERO).unwrap());
    assert_eq!(tick_source.next().unwrap(), Some(sent));
    assert_eq!(drain.lost(), 0);
}

#[test]
fn in_lockstep_the_source_waits_at_the_end_of_a_death_for_who_has_not_died_yet() {
    let stage = stage(Mode::Lockstep);
    let (plant, line) = (stage.shell("plant"), stage.control_page.process(1));
    let death = Fault {
        at_tick: Some(1),
        for_ticks: Some(2),
        ..Fault::new("estimator", Kind::Kill)
    }
    .schedule(&on(1), 1000, 0)
    .unwrap();
    stage
        .control_page
        .fault_table()
        .enter(&death, Origin::Planned)
        .unwrap();
    // It is through with tick 0 and it has had no core since.
    line.set_state(State::Running);
    line.set_ticks(1);
    drop(plant.writer::<SensorSample>().unwrap());
    let mut tick_source = plant.tick_source(0);
    for tick in 0..3 {
        assert_eq!(
            tick_source.next().unwrap(),
            Some(tick),
            "no process waits for a dead one"
        );
    }
    let error = tick_source.next().unwrap_err().to_string();
    assert!(
        error.contains("its turn to begin tick 3") && error.contains("is estimator alive?"),
        "{error}"
    );
    line.set_ticks(3);
    assert_eq!(tick_source.next().unwrap(), Some(3));
}

#[test]
fn a_polled_process_gets_one_more_round_after_the_stop() {
    let stage = stage(Mode::Lockstep);
    let recorder = stage.shell("recorder");
    assert!(recorder.poll(Duration::ZERO).unwrap());
    stage.control_page.request_stop(Stop::Everything);
    assert!(
        recorder.poll(Duration::from_secs(60)).unwrap(),
        "to take in what was on the way"
    );
    assert!(!recorder.poll(Duration::from_secs(60)).unwrap());
}

#[test]
fn another_wire_format_is_refused_with_both_versions() {
    let stage = stage(Mode::Lockstep);
    let manifest = Manifest::read(&stage.run).unwrap();
    let run = RunDir::create().unwrap();
    manifest.write(&run).unwrap();
    let _board = ControlPage::create(&run).unwrap();
    let _hub = Hub::create_speaking(&run, &manifest, 0xabad_cafe).unwrap();
    let error = Shell::open(run.path(), "plant")
        .unwrap()
        .writer::<SensorSample>()
        .map(|_| ())
        .unwrap_err();
    let ours = format!("{:016x}", shared_types::topics::wire_hash());
    assert!(matches!(error, TopicError::WireFormat { .. }));
    assert!(
        error.to_string().contains("00000000abadcafe") && error.to_string().contains(&ours),
        "{error}"
    );
}

#[test]
fn everything_in_shared_memory_is_this_users_alone() {
    use std::os::unix::fs::MetadataExt;
    let stage = stage(Mode::Lockstep);
    let plant = stage.shell("plant");
    let _writer = plant.writer::<SensorSample>().unwrap();
    let _reader = stage.shell("estimator").reader::<SensorSample>().unwrap();
    let beside: Vec<_> = std::fs::read_dir(crate::SHM).unwrap().flatten().collect();
    let ours = beside.iter().filter(|entry| {
        entry
            .file_name()
            .to_string_lossy()
            .starts_with(stage.run.name())
    });
    let modes: Vec<_> = ours
        .map(|entry| (entry.path(), entry.metadata().unwrap().mode() & 0o777))
        .collect();
    assert!(
        modes.len() > 3,
        "the directory and iceoryx2's segments: {modes:?}"
    );
    assert!(modes.iter().all(|(_, mode)| mode & 0o077 == 0), "{modes:?}");
}

#[test]
fn a_reader_of_everything_that_comes_back_gets_what_it_missed_and_nothing_twice() {
    let stage = stage(Mode::Realtime);
    let plant = stage.shell("plant");
    let mut sensors = plant.writer().unwrap();
    let (first, mut taken) = (stage.shell("recorder"), Vec::new());
    let mut drain = first.collector::<SensorSample>().unwrap();
    first.poll(Duration::ZERO).unwrap();
    (0..100).for_each(|tick| sensors.send(sample(tick)).unwrap());
    drain.collect(|message| taken.push(*message)).unwrap();
    assert_eq!(taken.len(), 100);
    // It dies and has to have been at tick 80; meanwhile others come, one of them poisoned, and the writer dies with its last word on the way.
    drop((drain, first));
    (100..200).for_each(|tick| sensors.send(sample(tick)).unwrap());
    stage.control_page.process(2).begin_incarnation();
    let (page, run) = (&stage.control_page, stage.run.path());
    std::thread::scope(|scope| {
        let recorder = scope.spawn(|| {
            let second = Shell::open(run, "recorder").unwrap();
            let mut drain = second.collector::<SensorSample>().unwrap();
            drain.resume(Some(80), 0);
            drain.recall(Some(&taken[80])).unwrap();
            second.poll(Duration::ZERO).unwrap();
            let mut ticks = Vec::new();
            while ticks.last() != Some(&210) {
                drain
                    .collect(|message| ticks.push(message.header.tick))
                    .unwrap();
            }
            (
                ticks,
                [Count::Lost, Count::Repeated, Count::Fenced].map(|count| second.count(count)),
            )
        });
        // The launcher's part, while messages go on: those before the recorder is connected come from the retainer, then from both.
        let mut next = 200;
        while !recorder.is_finished() {
            stage.hub.answer(page).unwrap();
            if next <= 210 && (next < 205 || page.process(2).state() == State::Running) {
                sensors.send(sample(next)).unwrap();
                next += 1;
            }
            if next == 205 {
                page.process(0).begin_incarnation();
            }
            std::thread::sleep(Duration::from_micros(300));
        }
        let (ticks, counts) = recorder.join().unwrap();
        assert_eq!(ticks, (81..=210).collect::<Vec<_>>());
        assert_eq!(counts, [0, 0, 0]);
    });
}

#[test]
fn a_message_that_reached_the_retainer_alone_reaches_its_readers_after_the_death() {
    let stage = stage(Mode::Lockstep);
    let plant = stage.shell("plant");
    let mut sensors = plant.writer::<SensorSample>().unwrap();
    // No other reader is there yet.
    stage.hub.connect().unwrap();
    (0..2).for_each(|tick| sensors.send(sample(tick)).unwrap());
    let (estimator, recorder) = (stage.shell("estimator"), stage.shell("recorder"));
    let (mut reader, mut collector) = (
        estimator.reader::<SensorSample>().unwrap(),
        recorder.collector::<SensorSample>().unwrap(),
    );
    let collected = |collector: &mut Collector<SensorSample>| {
        let mut ticks = Vec::new();
        collector
            .collect(|sample| ticks.push(sample.header.tick))
            .unwrap();
        ticks
    };
    assert!(recorder.poll(Duration::ZERO).unwrap() && collected(&mut collector).is_empty());
    let topics = ["sensor".to_owned()];
    let sent = |tick| stage.hub.outputs_sent(&topics, tick).unwrap();
    assert_eq!((sent(1), sent(2)), (1, 0));
    let place = stage
        .control_page
        .fault_table()
        .enter(&ScheduledFault::death(0, 2, 0, 1000), Origin::Detected)
        .unwrap();
    stage
        .control_page
        .fault_table()
        .mark_injected(place, now_ns());
    // The messages of the replacement arrive in the buffer, behind them.
    sensors.send(sample(102)).unwrap();
    for tick in [0, 1] {
        assert_eq!(reader.at(tick).unwrap().unwrap().header.tick, tick);
    }
    assert_eq!(
        (collected(&mut collector), collected(&mut collector)),
        (vec![0, 1, 102], vec![])
    );
    assert_eq!(reader.next().unwrap().unwrap().header.tick, 102);
    assert_eq!(
        (
            estimator.count(Count::Repeated),
            recorder.count(Count::Repeated)
        ),
        (0, 0)
    );
}

#[test]
fn a_clock_that_is_behind_or_ahead_leaves_the_grid_where_it_is() {
    use shared_types::fault::{Fault, Kind, Way};
    for amount in [-30.0, 30.0] {
        let stage = stage(Mode::Realtime);
        let fault = Fault {
            way: Some(Way::Jump),
            amount: Some(amount),
            at_tick: Some(3),
            for_ticks: Some(20),
            ..Fault::new("plant", Kind::Clock)
        };
        stage.control_page.fault_table().enter(
            &fault.schedule(&on(0), 1000, 0).unwrap(),
            crate::Origin::Planned,
        );
        let plant = stage.shell("plant");
        drop(plant.writer::<SensorSample>().unwrap());
        let mut tick_source = plant.tick_source(0);
        let (began, mut in_time) = (now_ns(), 0);
        for tick in 0..40 {
            assert_eq!(tick_source.next().unwrap(), Some(tick));
            let (now, deadline) = (now_ns(), tick_source.deadline_ns().unwrap());
            assert!(
                deadline < now + 1_000_000,
                "{amount} ms, tick {tick}: {} ns ahead",
                deadline - now
            );
            // A busy machine is late with some wake-ups.
            in_time += u32::from(deadline > now);
        }
        assert!(
            in_time >= 20,
            "{amount} ms: {in_time} of 40 ticks had any time for their torque"
        );
        let took_ms = (now_ns() - began) / 1_000_000;
        assert!(took_ms >= 35, "{amount} ms: it ran through {took_ms} ms");
    }
}
