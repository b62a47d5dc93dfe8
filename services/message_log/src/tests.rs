//! Tests of whole, truncated, damaged and mixed logs.

use std::ops::Range;
use std::path::{Path, PathBuf};

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

/// A place for a log, and the folder that it is in.
fn place() -> (TempDir, PathBuf) {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join(FILE);
    (folder, path)
}

fn contents() -> Contents {
    contents_of(7)
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

/// One sample of each tick, and a state of every second one.
fn add(log: &mut Writer, ticks: Range<u64>) {
    for tick in ticks {
        log.add(SENSOR, bytemuck::bytes_of(&sample(tick))).unwrap();
        if tick.is_multiple_of(2) {
            log.add(STATE, bytemuck::bytes_of(&state(tick))).unwrap();
        }
    }
}

/// A log of blocks that end at these ticks, as bytes, and where each block begins and ends.
fn written(path: &Path, contents: &Contents, ends: &[u64]) -> (Vec<u8>, Vec<usize>) {
    let mut log = Writer::create(path, contents).unwrap();
    let (mut begin, mut places) = (0, vec![log.place().bytes as usize]);
    for end in ends {
        add(&mut log, begin..*end);
        log.flush().unwrap();
        begin = *end;
        places.push(log.place().bytes as usize);
    }
    log.finish().unwrap();
    (std::fs::read(path).unwrap(), places)
}

/// Ticks of the samples, and the defects: the kind, and the lost samples and states.
fn read(path: &Path) -> (Vec<u64>, Vec<(Defect, u64, u64)>) {
    let log = Log::open(path, &contents()).unwrap();
    let (mut samples, mut ticks, mut gaps) = (log.messages::<SensorSample>(), Vec::new(), 0);
    loop {
        match samples.next_message() {
            Ok(Some(message)) => ticks.push(message.header.tick),
            Ok(None) => break,
            Err(LogError::Lost { lost, .. }) => gaps += lost,
            Err(error) => panic!("{error}"),
        }
    }
    let flaws = log.flaws().iter();
    let flaws: Vec<_> = flaws
        .map(|flaw| (flaw.defect, flaw.lost[SENSOR], flaw.lost[STATE]))
        .collect();
    assert_eq!(gaps, flaws.iter().map(|(_, lost, _)| lost).sum::<u64>());
    (ticks, flaws)
}

fn all_but(end: u64, lost: Range<u64>) -> Vec<u64> {
    (0..end).filter(|tick| !lost.contains(tick)).collect()
}

#[test]
fn messages_come_back_byte_for_byte_and_other_readers_find_them() {
    let (_folder, path) = place();
    let n = 3000;
    let mut log = Writer::create(&path, &contents()).unwrap();
    add(&mut log, 0..n);
    assert_eq!(
        log.finish().unwrap(),
        std::fs::metadata(&path).unwrap().len()
    );
    let log = Log::open(&path, &contents()).unwrap();
    assert!(log.is_ended() && log.has_tail() && log.flaws().is_empty() && log.blocks() > 3);
    let mut samples = log.messages::<SensorSample>();
    for tick in 0..n {
        let found = samples.next_message().unwrap().unwrap();
        assert_eq!(
            bytemuck::bytes_of(&found),
            bytemuck::bytes_of(&sample(tick))
        );
    }
    assert!(samples.next_message().unwrap().is_none());
    assert!(log.messages::<Target>().next_message().unwrap().is_none());

    let file = std::fs::read(&path).unwrap();
    let summary = ::mcap::Summary::read(&file).unwrap().unwrap();
    let stats = summary.stats.clone().unwrap();
    assert_eq!(
        (stats.message_count, stats.channel_message_counts[&1]),
        (n + n / 2, n)
    );
    let indexed: usize = summary
        .chunk_indexes
        .iter()
        .flat_map(|chunk| summary.read_message_indexes(&file, chunk).unwrap())
        .map(|(_, entries)| entries.len())
        .sum();
    assert_eq!(indexed as u64, n + n / 2);
    let mut sequence = 0;
    for message in ::mcap::MessageStream::new(&file).unwrap() {
        let message = message.unwrap();
        if message.channel.topic == "/sensor" {
            assert_eq!(
                (u64::from(message.sequence), message.log_time),
                (sequence, sequence * 1_000_000)
            );
            assert_eq!(message.data[..4], [0, 1, 0, 0]);
            assert_eq!(message.data[4..], *bytemuck::bytes_of(&sample(sequence)));
            sequence += 1;
        }
    }
    assert_eq!(sequence, n);
}

#[test]
fn a_schema_has_the_fields_of_the_message_in_their_order() {
    let head = String::from_utf8_lossy(&contents().head()).into_owned();
    let places = [
        "armplane/msg/SensorSample",
        "ros2msg",
        "armplane/Header header",
        "float64[8] q_encoder",
        "MSG: armplane/Header",
        "uint64[8] received_ns",
        "uint32 incarnation",
        "/sensor",
    ]
    .map(|text| head.find(text).unwrap_or_else(|| panic!("{text}: {head}")));
    assert!(places.is_sorted(), "{places:?}");
}

#[test]
fn a_torn_end_is_the_end_and_a_new_writer_goes_on_behind_it() {
    let (_folder, path) = place();
    let (whole, places) = written(&path, &contents(), &[100, 200]);
    for torn in (places[1]..whole.len()).step_by(7) {
        std::fs::write(&path, &whole[..torn]).unwrap();
        let n = if torn < places[2] { 100 } else { 200 };
        assert_eq!(read(&path), ((0..n).collect(), vec![]), "{torn}");
        complete(&path, &contents()).unwrap();
        assert!(Log::open(&path, &contents()).unwrap().has_tail());
        let file = std::fs::read(&path).unwrap();
        assert_eq!(
            ::mcap::MessageStream::new(&file).unwrap().count() as u64,
            n + n / 2
        );
    }
    std::fs::write(&path, &whole[..places[2] - 1]).unwrap();
    let go_on = |from: &Place| {
        let mut left = Vec::new();
        let log = Writer::resume(&path, &contents(), from, |channel, message| {
            if channel == SENSOR {
                left.push(tick_of(message));
            }
        });
        log.map(|log| (log, left))
    };
    let (mut log, left) = go_on(&Place::default()).unwrap();
    assert_eq!(left, (0..100).collect::<Vec<_>>());
    add(&mut log, 100..150);
    log.flush().unwrap();
    let place = log.place().clone();
    add(&mut log, 150..153);
    log.finish().unwrap();
    for _ in 0..2 {
        // Behind the end that its predecessor gave the log, too.
        let (log, left) = go_on(&place).unwrap();
        assert_eq!(left, [150, 151, 152]);
        log.finish().unwrap();
        assert_eq!(read(&path), ((0..153).collect(), vec![]));
    }
    for (bytes, more) in [(0, 1), (u64::MAX / 2, 0)] {
        let mut wrong = place.clone();
        wrong.bytes += bytes;
        wrong.messages[SENSOR] += more;
        assert!(go_on(&wrong).is_err(), "{wrong:?}");
    }
    let other = Writer::resume(&path, &contents_of(8), &Place::default(), |_, _| ());
    assert!(matches!(other, Err(LogError::OtherRun { .. })));
}

#[test]
fn a_writer_killed_before_it_has_made_its_file_costs_nothing() {
    let (_folder, path) = place();
    let head = contents().head();
    for torn in [None, Some(&head[..3]), Some(&head[..])] {
        torn.into_iter()
            .for_each(|torn| std::fs::write(&path, torn).unwrap());
        let none = |_: usize, _: &[u8]| panic!("there is none");
        let mut log = Writer::resume(&path, &contents(), &Place::default(), none).unwrap();
        add(&mut log, 0..7);
        log.finish().unwrap();
        assert_eq!(read(&path), ((0..7).collect(), vec![]));
    }
    std::fs::remove_file(&path).unwrap();
    let place = Place {
        bytes: 100,
        messages: vec![1, 0],
    };
    assert!(Writer::resume(&path, &contents(), &place, |_, _| ()).is_err());
}

#[test]
fn files_that_are_not_the_runs_are_refused() {
    let (_folder, path) = place();
    let error = || Log::open(&path, &contents()).err().unwrap();
    assert!(error().is_before_the_first_message());
    std::fs::write(&path, b"other bytes").unwrap();
    assert!(matches!(error(), LogError::Damaged { .. }));
    std::fs::write(&path, vec![7; 100_000]).unwrap();
    assert!(matches!(error(), LogError::Damaged { .. }));
    written(&path, &contents_of(8), &[10]);
    assert!(matches!(error(), LogError::OtherRun { .. }));
    let other = Contents::new(7, 1000, vec![MessageLayout::of::<SensorSample>()]);
    let mut log = Writer::create(&path, &other).unwrap();
    log.add(0, bytemuck::bytes_of(&sample(0))).unwrap();
    log.finish().unwrap();
    assert!(matches!(error(), LogError::WireFormat { .. }));
}

#[test]
fn a_bit_that_is_flipped_makes_no_message_wrong_and_costs_only_those_of_its_block() {
    let (_folder, path) = place();
    let ends = [0, 10, 24, 40_u64];
    let (whole, places) = written(&path, &contents(), &ends[1..]);
    for (at, bit) in (0..whole.len()).step_by(3).map(|at| (at, 1 << (at % 8))) {
        let mut damaged = whole.clone();
        damaged[at] ^= bit;
        std::fs::write(&path, &damaged).unwrap();
        let block = places.iter().take_while(|begin| **begin <= at).count();
        let lost = if (1..ends.len()).contains(&block) {
            ends[block - 1]..ends[block]
        } else {
            0..0
        };
        let n = lost.end - lost.start;
        let expected = (all_but(40, lost), vec![(Defect::Damaged, n, n / 2)]);
        assert_eq!(read(&path), expected, "byte {at} of block {block}");
    }
    let (before, behind) = whole.split_at(places[1]);
    std::fs::write(&path, [before, &[7; 5000], behind].concat()).unwrap();
    assert_eq!(
        read(&path),
        ((0..40).collect(), vec![(Defect::Damaged, 0, 0)])
    );
}

#[test]
fn blocks_that_are_missing_repeated_exchanged_or_foreign_are_named_and_the_others_come_in_order() {
    use Defect::{Displaced, Missing, OtherRun, Repeated};
    let (_folder, path) = place();
    let ends = [10, 24, 40, 50_u64];
    let (theirs, _) = written(&path, &contents_of(8), &ends);
    let (whole, places) = written(&path, &contents(), &ends);
    let tail = &whole[places[4]..];
    // Blocks by number; a negative one is the other run's, of the number behind the minus, from 1.
    type Case<'a> = (&'a [i32], Range<u64>, &'a [(Defect, u64)]);
    let cases: [Case; 13] = [
        (&[0, 1, 2, 3], 0..0, &[]),
        (&[0, 2, 3], 10..24, &[(Missing, 14)]),
        (&[1, 2, 3], 0..10, &[(Missing, 10)]),
        (&[0, 1, 2], 40..50, &[(Missing, 10)]),
        (&[3], 0..40, &[(Missing, 40)]),
        (&[], 0..50, &[(Missing, 50)]),
        (&[0, 1, 1, 2, 3], 0..0, &[(Repeated, 0)]),
        (&[0, 1, 2, 3, 0], 0..0, &[(Repeated, 0)]),
        (&[0, 2, 1, 3], 0..0, &[(Displaced, 0)]),
        (&[3, 0, 1, 2], 0..0, &[(Displaced, 0)]),
        (&[0, -2, 2, 3], 10..24, &[(OtherRun, 14)]),
        (&[0, 1, -2, 2, 3], 0..0, &[(OtherRun, 0)]),
        (&[0, 1, 2, -4], 40..50, &[(OtherRun, 10)]),
    ];
    for (blocks, lost, defects) in cases {
        let of = |number: &i32| {
            let (file, at) = match usize::try_from(*number) {
                Ok(at) => (&whole, at),
                Err(_) => (&theirs, number.unsigned_abs() as usize - 1),
            };
            file[places[at]..places[at + 1]].to_vec()
        };
        let blocks_bytes: Vec<u8> = blocks.iter().flat_map(of).collect();
        std::fs::write(&path, [&whole[..places[0]], &blocks_bytes, tail].concat()).unwrap();
        let found = read(&path);
        let kinds: Vec<_> = found
            .1
            .iter()
            .map(|(kind, lost, _)| (*kind, *lost))
            .collect();
        assert_eq!(
            (found.0, &kinds[..]),
            (all_but(50, lost), defects),
            "{blocks:?}"
        );
        let resumed = Writer::resume(&path, &contents(), &Place::default(), |_, _| ());
        assert_eq!(resumed.is_ok(), defects.is_empty(), "{blocks:?}");
    }
}

#[test]
fn a_topic_alone_does_not_wait_for_a_full_chunk() {
    let (_folder, path) = place();
    let mut log = Writer::create(&path, &contents()).unwrap();
    let begin = log.place().bytes;
    add(&mut log, 0..BLOCK as u64 - 1);
    log.end_round(100).unwrap();
    assert_eq!(log.place().bytes, begin);
    add(&mut log, 127..128);
    log.end_round(200).unwrap();
    assert_eq!(log.place().messages, [128, 64]);
    let log = Log::open(&path, &contents()).unwrap();
    assert_eq!((log.blocks(), log.begun(0)), (1, 200));
}

#[test]
fn blocks_of_any_bytes_under_a_right_checksum_are_refused() {
    let (_folder, path) = place();
    let (whole, places) = written(&path, &contents(), &[10]);
    for at in places[0]..places[1] {
        let mut other = whole.clone();
        other[at] = other[at].wrapping_add(1);
        seal(&mut other);
        std::fs::write(&path, &other).unwrap();
        if let Ok(log) = Log::open(&path, &contents()) {
            let mut samples = log.messages::<SensorSample>();
            for _ in 0..100 {
                let _ = samples.next_message();
            }
        }
    }
}
