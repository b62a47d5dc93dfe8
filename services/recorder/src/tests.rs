//! Tests of whole, torn, damaged, mixed and joined records, and of the ticks that are made of them.

use std::collections::BTreeSet;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use bytemuck::bytes_of;
use shared_types::event::Event;
use shared_types::layout::MessageLayout;
use shared_types::{PlantState, SensorSample, Target};
use tempfile::TempDir;

use super::*;

const SENSOR: usize = 0;
const STATE: usize = 1;

fn contents_of(run: u64) -> Contents {
    let layouts = vec![
        MessageLayout::of::<SensorSample>(),
        MessageLayout::of::<PlantState>(),
    ];
    Contents::new(run, 1000, layouts)
}

fn contents() -> Contents {
    contents_of(7)
}

/// A place for a record, and the folder that it is in.
fn place() -> (TempDir, PathBuf) {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join(MESSAGES);
    (folder, path)
}

fn sample(tick: u64) -> SensorSample {
    let mut message = SensorSample::default();
    message.header.tick = tick;
    message.header.stamps.sent_ns[0] = 1_000_000 * tick + tick % 7;
    message.q_encoder[2] = (0.1 * tick as f64).sin();
    message.tau_drive[5] = f64::from_bits(0x7ff8_0000_0000_1234);
    message
}

fn state(tick: u64) -> PlantState {
    let mut message = PlantState::default();
    message.header.tick = tick;
    message
}

fn event(tick: u64) -> Event {
    Event {
        tick,
        text: format!("tick {tick}"),
        ..Event::default()
    }
}

/// One sample of each tick, a state of every second one, and an event of every tenth.
fn add(record: &mut RecordWriter, ticks: std::ops::Range<u64>) {
    for tick in ticks {
        record.append(SENSOR, bytes_of(&sample(tick))).unwrap();
        if tick.is_multiple_of(2) {
            record.append(STATE, bytes_of(&state(tick))).unwrap();
        }
        if tick.is_multiple_of(10) {
            record.event(&event(tick)).unwrap();
        }
    }
}

/// A record of chunks that end at these ticks, as bytes, and where each chunk begins and ends.
fn written(path: &Path, contents: &Contents, ends: &[u64]) -> (Vec<u8>, Vec<usize>) {
    let mut record = RecordWriter::create(path, contents).unwrap();
    let mut begin = 0;
    let mut places = vec![record.bytes() as usize];
    for end in ends {
        add(&mut record, begin..*end);
        record.close_chunk().unwrap();
        begin = *end;
        places.push(record.bytes() as usize);
    }
    record.finish().unwrap();
    (std::fs::read(path).unwrap(), places)
}

/// Ticks of the samples, and those of which messages may be missing.
fn read(path: &Path) -> (Vec<u64>, Vec<RangeInclusive<u64>>) {
    let mut record = RecordReader::open(path, &contents()).unwrap();
    let mut ticks = Vec::new();
    while let Some(message) = record.next_of(SENSOR) {
        let tick = tick_of(message);
        assert_eq!(message, bytes_of(&sample(tick)));
        ticks.push(tick);
    }
    (ticks, record.damage().to_vec())
}

#[test]
fn messages_and_events_come_back_and_other_readers_find_them() {
    for compression in [None, Some(mcap::Compression::Lz4)] {
        let (_folder, path) = place();
        let mut contents = contents();
        contents.compression = compression;
        let n = 3000;
        let mut record = RecordWriter::create(&path, &contents).unwrap();
        add(&mut record, 0..n);
        let bytes = record.finish().unwrap();
        assert_eq!(bytes, std::fs::metadata(&path).unwrap().len());
        let (ticks, flaws) = read(&path);
        assert!(ticks == (0..n).collect::<Vec<_>>() && flaws.is_empty());
        let mut record = RecordReader::open(&path, &contents).unwrap();
        let mut next = 0;
        while let Some(item) = record.next_item() {
            if let Item::Event(found) = item {
                assert_eq!(found, event(next));
                next += 10;
            }
        }
        assert!(next == n && record.is_ended && record.has_summary());
        let targets = RecordReader::open(&path, &contents).unwrap();
        assert_eq!(targets.messages::<Target>().count(), 0);

        let file = std::fs::read(&path).unwrap();
        let summary = ::mcap::Summary::read(&file).unwrap().unwrap();
        assert!(summary.chunk_indexes.len() > 3);
        let stats = summary.stats.clone().unwrap();
        assert_eq!(
            (
                stats.channel_message_counts[&1],
                stats.channel_message_counts[&2]
            ),
            (n, n / 2)
        );
        let indexed: usize = summary
            .chunk_indexes
            .iter()
            .flat_map(|chunk| summary.read_message_indexes(&file, chunk).unwrap())
            .map(|(_, entries)| entries.len())
            .sum();
        assert_eq!(indexed as u64, stats.message_count);
        let samples = ::mcap::MessageStream::new(&file).unwrap();
        let samples = samples
            .map(Result::unwrap)
            .filter(|one| one.channel.topic == "/sensor");
        for (sequence, message) in (0..).zip(samples) {
            assert_eq!(
                (u64::from(message.sequence), message.log_time),
                (sequence, sequence * 1_000_000)
            );
            assert_eq!(message.data[..4], [0, 1, 0, 0]);
            assert_eq!(message.data[4..], *bytes_of(&sample(sequence)));
        }
    }
}

#[test]
fn a_schema_has_the_fields_of_the_message_in_their_order() {
    let (_folder, path) = place();
    written(&path, &contents(), &[1]);
    let file = std::fs::read(&path).unwrap();
    let summary = ::mcap::Summary::read(&file).unwrap().unwrap();
    let schema = |topic: &str| {
        let channel = summary.channels.values().find(|one| one.topic == topic);
        let schema = channel.unwrap().schema.clone().unwrap();
        let text = String::from_utf8_lossy(&schema.data).into_owned();
        (schema.name.clone(), text)
    };
    let (name, text) = schema("/sensor");
    assert_eq!(name, "armplane/msg/SensorSample");
    let places = [
        "armplane/Header header",
        "float64[8] q_encoder",
        "MSG: armplane/Header",
        "uint64[8] received_ns",
        "uint32 incarnation",
    ]
    .map(|part| text.find(part).unwrap_or_else(|| panic!("{part}: {text}")));
    assert!(places.is_sorted(), "{places:?}");
    assert_eq!(schema("/events").0, "rcl_interfaces/msg/Log");
    assert_eq!(schema("/robot_description").0, "std_msgs/msg/String");
}

#[test]
fn a_torn_end_is_the_end_and_a_record_goes_on_from_any_counts() {
    let (_folder, path) = place();
    let (whole, places) = written(&path, &contents(), &[100, 200]);
    for torn in (places[1]..whole.len()).step_by(97) {
        std::fs::write(&path, &whole[..torn]).unwrap();
        let n = if torn < places[2] { 100 } else { 200 };
        // Within the indices behind a chunk its messages are there.
        let (ticks, flaws) = read(&path);
        assert!(
            ticks.len() as u64 >= n && flaws.is_empty(),
            "{torn} of {places:?}: {} {flaws:?}",
            ticks.len()
        );
    }
}

/// A cut of a tick, of processes that have saved these many bytes.
fn cut(tick: u64, bytes: usize) -> Cut {
    Cut {
        tick,
        processes: vec![("plant".to_owned(), vec![tick as u8; bytes])],
    }
}

#[test]
fn a_record_goes_on_from_its_newest_usable_cut() {
    let (_folder, path) = place();
    let newest = |is_usable: &dyn Fn(u64) -> bool| {
        let cut = Cut::newest(&path, &contents(), is_usable).unwrap();
        cut.map(|cut| cut.tick)
    };
    let any = |_| true;
    let mut record = RecordWriter::create(&path, &contents()).unwrap();
    let mut next = 0;
    for tick in [50, 100] {
        // Some messages of later ticks are there before all of the earlier ones have come.
        add(&mut record, next..tick + 10);
        record.cut(&cut(tick, 300_000)).unwrap();
        next = tick + 10;
    }
    add(&mut record, next..150);
    record.close_chunk().unwrap();
    assert_eq!(newest(&any), Some(100));
    assert_eq!(newest(&|tick| tick != 100), Some(50));
    assert_eq!(newest(&|_| false), None);
    // Not behind a hole, wherever it is: of each byte one bit is flipped.
    let whole = std::fs::read(&path).unwrap();
    let mut found = BTreeSet::new();
    for at in (0..whole.len()).step_by(9973) {
        let mut damaged = whole.clone();
        damaged[at] ^= 1 << (at % 8);
        std::fs::write(&path, damaged).unwrap();
        let tick = newest(&any);
        let mut record = RecordReader::open_before(&path, &contents(), tick.unwrap_or(0)).unwrap();
        while record.next_item().is_some() {}
        assert_eq!(record.damage(), [], "byte {at}: {tick:?}");
        found.insert(tick);
    }
    assert_eq!(found, BTreeSet::from([None, Some(50), Some(100)]));
    std::fs::write(&path, whole).unwrap();
    // Another record that begins with all before its newest cut.
    let (_folder, other) = place();
    let mut earlier = RecordReader::open_before(&path, &contents(), 100).unwrap();
    let again = RecordWriter::continuing(&other, &contents_of(8), &mut earlier).unwrap();
    again.finish().unwrap();
    let mut again = RecordReader::open(&other, &contents_of(8)).unwrap();
    let mut cuts = Vec::new();
    let mut samples = 0..100;
    while let Some(item) = again.next_item() {
        match item {
            Item::Message {
                channel: SENSOR,
                message,
            } => assert_eq!(Some(tick_of(message)), samples.next()),
            Item::Message { .. } => {}
            Item::Cut(one) => cuts.push(one.tick),
            Item::Event(event) => panic!("the judge says it again: {event:?}"),
        }
    }
    assert_eq!((cuts, samples.next()), (vec![50, 100], None));
}

#[test]
fn files_that_are_not_the_runs_are_refused() {
    let (_folder, path) = place();
    let error = || RecordReader::open(&path, &contents()).err().unwrap();
    assert!(error().is_absent());
    for bytes in [b"other bytes".to_vec(), vec![7; 100_000]] {
        std::fs::write(&path, bytes).unwrap();
        assert!(matches!(error(), RecordError::Damaged { .. }));
    }
    written(&path, &contents_of(8), &[10]);
    assert!(matches!(error(), RecordError::OtherRun { .. }));
    let other = vec![
        MessageLayout::of::<SensorSample>(),
        MessageLayout::of::<Target>(),
    ];
    let writer = RecordWriter::create(&path, &Contents::new(7, 1000, other)).unwrap();
    writer.finish().unwrap();
    assert!(matches!(error(), RecordError::WireFormat { .. }));
    for torn in [&[][..], &::mcap::MAGIC[..3]] {
        std::fs::write(&path, torn).unwrap();
        assert!(error().is_absent(), "killed before the first message");
    }
}

#[test]
fn a_bit_that_is_flipped_makes_no_message_wrong_and_costs_only_those_of_its_chunk() {
    let (_folder, path) = place();
    let ends = [0, 10, 24, 40_u64];
    let (whole, places) = written(&path, &contents(), &ends[1..]);
    for (at, bit) in (0..whole.len()).step_by(17).map(|at| (at, 1 << (at % 8))) {
        let mut damaged = whole.clone();
        damaged[at] ^= bit;
        std::fs::write(&path, &damaged).unwrap();
        let (ticks, flaws) = read(&path);
        let chunk = places.iter().take_while(|begin| **begin <= at).count();
        let of_chunk = if (1..ends.len()).contains(&chunk) {
            ends[chunk - 1]..ends[chunk]
        } else {
            0..0
        };
        let lost: Vec<u64> = (0..40).filter(|tick| !ticks.contains(tick)).collect();
        assert!(
            lost.is_empty() || lost == of_chunk.clone().collect::<Vec<_>>(),
            "byte {at} of chunk {chunk}: {lost:?}"
        );
        let told = lost.is_empty() || flaws == [of_chunk.start..=of_chunk.end - 1];
        // A last chunk that is no chunk any more is a torn end.
        let is_last = of_chunk.end == 40 && flaws.is_empty();
        assert!(told || is_last, "byte {at}: {flaws:?}");
    }
    let (before, behind) = whole.split_at(places[1]);
    std::fs::write(&path, [before, &[7; 5000], behind].concat()).unwrap();
    assert_eq!(read(&path), ((0..40).collect(), vec![10..=10]));
}

#[test]
fn chunks_that_are_missing_repeated_exchanged_or_foreign_are_named_and_passed_over() {
    let (_folder, path) = place();
    let ends = [10, 24, 40, 50_u64];
    let (theirs, _) = written(&path, &contents_of(8), &ends);
    let (whole, places) = written(&path, &contents(), &ends);
    let tail = &whole[places[4]..];
    type Case<'a> = (&'a [usize], std::ops::Range<u64>, &'a [RangeInclusive<u64>]);
    let cases: [Case<'_>; 8] = [
        (&[0, 1, 2, 3], 0..0, &[]),
        (&[0, 2, 3], 10..24, &[10..=23]),
        (&[1, 2, 3], 0..10, &[0..=9]),
        (&[3], 0..40, &[0..=39]),
        (&[0, 1, 1, 2, 3], 0..0, &[10..=23]),
        (&[0, 1, 2, 3, 0], 0..0, &[0..=9]),
        (&[0, 2, 1, 3], 10..24, &[10..=23]),
        (&[3, 0, 1, 2], 0..40, &[0..=39]),
    ];
    for (chunks, lost, flaws) in cases {
        let of = |chunk: &usize| &whole[places[*chunk]..places[chunk + 1]];
        let chunks_bytes: Vec<u8> = chunks.iter().flat_map(of).copied().collect();
        std::fs::write(&path, [&whole[..places[0]], &chunks_bytes, tail].concat()).unwrap();
        let left: Vec<u64> = (0..50).filter(|tick| !lost.contains(tick)).collect();
        assert_eq!(read(&path), (left, flaws.to_vec()), "{chunks:?}");
    }
    // The beginning of another run's, amid ours.
    let foreign = &theirs[..places[1]];
    std::fs::write(
        &path,
        [&whole[..places[2]], foreign, &whole[places[2]..]].concat(),
    )
    .unwrap();
    let (ticks, flaws) = read(&path);
    assert!(ticks.len() == 50 && flaws == [0..=9, 24..=24], "{flaws:?}");
}

#[test]
fn the_last_messages_of_a_torn_record_are_found() {
    let (_folder, path) = place();
    written(&path, &contents(), &[40]);
    let file = std::fs::read(&path).unwrap();
    std::fs::write(&path, &file[..file.len() - 30]).unwrap();
    let last = RecordReader::last_ticks(&path, &contents()).unwrap();
    assert_eq!(last, [Some(39), Some(38)]);
}

#[test]
fn errors_beyond_all_numbers_do_not_cost_the_account() {
    let mut summary = Summary {
        ticks: 7,
        ..Summary::default()
    };
    summary.task.position_rms_mm = f64::INFINITY;
    summary.task.final_orientation_deg = f64::NAN;
    summary.joints.q_end = vec![0.5, f64::NEG_INFINITY];
    let read: Summary = serde_json::from_slice(&super::written(&summary).unwrap()).unwrap();
    assert_eq!(
        (
            read.ticks,
            read.task.position_rms_mm,
            read.task.final_orientation_deg
        ),
        (7, f64::MAX, f64::MAX)
    );
    assert_eq!(read.joints.q_end, [0.5, f64::MAX]);
    assert_eq!(
        read.not_finite,
        [
            "joints.q_end.1",
            "task.final_orientation_deg",
            "task.position_rms_mm"
        ]
    );
}

/// The ticks that are given out now, or at the end, and which of them are whole.
fn given(assembler: &mut Assembler, is_over: bool) -> Vec<(u64, bool)> {
    let next = || {
        if is_over {
            assembler.rest()
        } else {
            assembler.next_row()
        }
    };
    let rows = std::iter::from_fn(next);
    let has_all =
        |row: &Row| row.messages().sensor.is_some() && row.messages().plant_state.is_some();
    rows.map(|row| (row.tick, has_all(&row))).collect()
}

#[test]
fn ticks_come_whole_and_in_order_and_a_topic_that_is_ahead_is_waited_for() {
    let mut assembler = Assembler::new(&contents());
    (0..1024).for_each(|tick| assembler.take(SENSOR, bytes_of(&sample(tick))));
    assert!(given(&mut assembler, false).is_empty());
    (0..1024).for_each(|tick| assembler.take(STATE, bytes_of(&state(tick))));
    let all: Vec<_> = (0..1024).map(|tick| (tick, true)).collect();
    assert_eq!(given(&mut assembler, false), all);
    assembler.take(STATE, bytes_of(&state(3)));
    assert!(given(&mut assembler, true).is_empty(), "given out already");
    assert_eq!(assembler.accounts()[STATE].hash.count(), 1025);
}

#[test]
fn missing_messages_cost_their_tick_alone() {
    let mut assembler = Assembler::new(&contents());
    // Of 3 to 5 nothing comes, and of 6 half; one has a tick from nowhere.
    let whole = |tick: u64| !(3..=6).contains(&tick);
    let n = 6000;
    for tick in (0..n).filter(|tick| whole(*tick) || *tick == 6) {
        assembler.take(SENSOR, bytes_of(&sample(tick)));
    }
    assembler.take(SENSOR, bytes_of(&sample(1 << 40)));
    for tick in (0..n).filter(|tick| whole(*tick)) {
        assembler.take(STATE, bytes_of(&state(tick)));
    }
    let mut ticks = given(&mut assembler, false);
    ticks.extend(given(&mut assembler, true));
    let mut expected: Vec<_> = (0..n).map(|tick| (tick, whole(tick))).collect();
    expected.push((1 << 40, false));
    assert_eq!(ticks, expected);
}

#[test]
fn a_tick_is_whole_without_the_topics_that_nobody_reads() {
    let mut assembler = Assembler::new(&contents());
    assembler.leave_out(STATE);
    assembler.take(SENSOR, bytes_of(&sample(0)));
    assert_eq!(given(&mut assembler, false), [(0, false)]);
}
