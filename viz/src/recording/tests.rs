use std::io::{self, Write};
use std::ops::Range;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

use chain::{Chain, Tick as Messages};
use tempfile::TempDir;

use super::*;
use crate::parts::is_complete;
use crate::read::{Found, chunks_of};
use crate::{MergeError, Piece, ReadError, complete, cut_behind, merge, parts_in, read};

/// A chunk every 250 ms.
const OFTEN: Options = Options {
    chunk_s: 0.25,
    picture_hz: 50.0,
    is_live: false,
};

/// Wrist lock: the joints turn ζ by 90°, then the hand rotates about the direction that was lost.
struct Fixture {
    folder: TempDir,
    robot: Robot,
    scenario: Scenario,
    messages: Vec<Messages>,
}

impl Fixture {
    fn new(ticks: usize) -> Self {
        let robot = Robot::builtin("puma560").expect("built in");
        let text = sim::scenarios::text("fig5-wrist-rotation").expect("built in");
        let scenario = Scenario::parse("fig5", text, &[]).expect("valid");
        let mut chain = Chain::new(&robot, &scenario).expect("accepted");
        let mut m = Messages::default();
        let mut step = |tick: usize| {
            assert!(chain.step(&mut m));
            // On one thread nothing is stamped.
            let stamps = &mut m.torque.header.stamps;
            (stamps.received_ns, stamps.sent_ns) = ([100; 8], [100 + tick as u64; 8]);
            m
        };
        let messages = (0..ticks).map(&mut step).collect();
        Self {
            folder: tempfile::tempdir().expect("a folder"),
            robot,
            scenario,
            messages,
        }
    }

    fn info<'a>(&'a self, run: &'a str) -> RunInfo<'a> {
        RunInfo {
            scenario: &self.scenario,
            robot: &self.robot,
            run,
            version: "0",
            seed: 7,
            hops: Some([0, 1, 2, 3]),
            lives: Lives::default(),
        }
    }

    fn path(&self) -> &Path {
        self.folder.path()
    }

    fn part(&self, part: u32) -> Recording {
        Recording::create_part(self.path(), part, &self.info("test"), OFTEN).expect("room")
    }

    fn next_part(&self, recording: &mut Recording) {
        recording.next_part(self.path()).expect("room");
    }

    /// The recording, read back.
    fn content(&self) -> Content {
        Content::of(&parts_in(self.path()))
    }

    fn row(&self, tick: usize) -> TickRow<'_> {
        TickRow::new(tick as u64, self.messages[tick].lent())
    }

    fn record(&self, recording: &mut Recording, ticks: Range<usize>) {
        ticks.for_each(|tick| recording.tick(&self.row(tick)).expect("room"));
    }
}

/// What can be read of a recording.
#[derive(Default)]
struct Content {
    ticks: Vec<u64>,
    states: Vec<(u64, String, String)>,
    log: Vec<(u64, String)>,
    places: Vec<(u64, String, [f32; 3])>,
    damages: usize,
}

impl Content {
    fn of(parts: &[PathBuf]) -> Self {
        let mut content = Self::default();
        let take = |piece: Piece| {
            match piece {
                Piece::Rows(rows) => content.ticks.extend(&rows.ticks),
                Piece::State { tick, lane, state } => content.states.push((tick, lane, state)),
                Piece::Event { tick, level, .. } => content.log.push((tick, level)),
                Piece::Place { tick, of, p, .. } => content.places.push((tick, of.to_owned(), p)),
                Piece::Damaged(_) => content.damages += 1,
                _ => {}
            }
            Ok::<(), ReadError>(())
        };
        if read(parts, take).is_err() {
            content.damages += 1;
        }
        content
    }

    fn one(part: &Path) -> Self {
        Self::of(&[part.to_owned()])
    }

    fn lane(&self, name: &str) -> Vec<&str> {
        let states = self.states.iter().filter(|(_, lane, _)| lane == name);
        states.map(|(.., state)| state.as_str()).collect()
    }
}

/// How many rows each entity has, and how many blueprints there are.
fn rows_at(part: &Path, path: &str) -> usize {
    let mut rows = 0;
    chunks_of(part, |found| {
        if let Found::Chunk(store, chunk) = found
            && (chunk.entity_path().to_string() == path
                || path == "blueprint" && store.kind() == StoreKind::Blueprint)
        {
            rows += chunk.num_rows();
        }
        Ok::<(), ReadError>(())
    })
    .expect("a recording");
    rows
}

#[test]
fn every_number_is_read_back_from_every_part() {
    let run = Fixture::new(600);
    let mut recording = run.part(0);
    // Between two of the ticks at which signals of a lower rate are drawn.
    run.record(&mut recording, 0..123);
    run.next_part(&mut recording);
    // A message that is late by one tick leaves its row empty.
    let row = |tick: usize| {
        let mut row = run.row(tick);
        row.messages.singularity = row.messages.singularity.filter(|_| tick != 163);
        row
    };
    (123..600).for_each(|tick| recording.tick(&row(tick)).expect("room"));
    recording.event(600, Level::Warning, "the end");
    recording.finish().expect("room");
    let limits = Limits::new(&run.robot);
    let mut next = 0;
    let parts = parts_in(run.path());
    read(&parts, |piece| {
        if let Piece::About(about) = &piece {
            let known = (about.joints, &*about.properties["seed"], about.rate_hz());
            assert_eq!(known, (6, "7", 1000.0));
            assert_eq!(about.singularities, ["elbow", "wrist", "overhead"]);
        }
        let Piece::Rows(rows) = piece else {
            return Ok(());
        };
        for (place, tick) in rows.ticks.iter().enumerate() {
            assert_eq!(*tick, next);
            next += 1;
            for signal in Signal::recorded() {
                let kept = signal.of().kept;
                let (mut expected, mut found) = (Vec::new(), Vec::new());
                rows.values(signal, place, &mut found);
                if let Some((of, derive)) = limits.derive(signal) {
                    rows.values(of, place, &mut expected);
                    let values = expected.iter_mut().enumerate();
                    values.for_each(|(i, x)| *x = derive(i, *x));
                } else if kept == Kept::Slow {
                    // Held from the tick at which it was drawn.
                    assert!(!found.is_empty(), "{signal:?} at {tick}");
                    continue;
                } else {
                    let row = row(*tick as usize);
                    (signal.of().take)(&Now::new(&row, &limits, Some([0, 1, 2, 3])), &mut expected);
                }
                let is_right = |(found, expected): (&f64, &f64)| match kept {
                    Kept::F32 => *found == f64::from(*expected as f32),
                    Kept::Short | Kept::Log(_) => {
                        (found - expected).abs() <= 1e-3 * expected.abs() + 1e-6
                    }
                    _ => found == expected,
                };
                let is_same =
                    found.len() == expected.len() && found.iter().zip(&expected).all(is_right);
                assert!(is_same, "{signal:?} at {tick}: {found:?} for {expected:?}");
            }
        }
        Ok::<(), ReadError>(())
    })
    .expect("readable");
    let content = Content::of(&parts);
    assert_eq!(
        (next, content.log.last()),
        (600, Some(&(600, "WARN".to_owned())))
    );
    // Each part says where it begins, and opens alone.
    assert_eq!(content.lane("mode/wrist"), ["reorient", "reorient"]);
    for part in parts {
        assert!(is_complete(&part).expect("the file"));
        assert!(rows_at(&part, "blueprint") > 30 && rows_at(&part, "/world/arm/link6") > 1);
    }
}

#[test]
fn a_recording_shows_what_happened() {
    let run = Fixture::new(4400);
    let mut recording = run.part(0);
    run.record(&mut recording, 0..4400);
    recording.finish().expect("room");
    let content = run.content();
    let modes = ["reorient", "track", "recover", "regular"];
    assert_eq!(content.lane("mode/wrist"), modes);
    assert_eq!((content.log.len(), content.log[0].0), (3, 2001));
    // The picture runs at 50 Hz, and the flange is at the model's pose.
    let arm = Model::<6>::new(&run.robot, None).expect("six joints");
    let flange = content
        .places
        .iter()
        .filter(|(_, of, _)| of == "/world/arm/link6");
    assert_eq!(flange.clone().count(), 220);
    for (tick, _, place) in flange {
        let q = SVector::from_column_slice(&run.messages[*tick as usize].plant_state.q[..6]);
        let p = vec3(&arm.link_poses(&q)[5].p);
        assert!(p.distance(glam::Vec3::from(*place)) < 1e-6, "{p} {place:?}");
    }
    // The wrist links have ghosts, the upper arm, which stood still, has none. Inside the wrist singularity ζ has been turned by 90°: the sector
    // grows every 8°, and what was lost is free then.
    for (path, expected) in [
        ("/world/null_motion/link4", 4..20),
        ("/world/null_motion/link2", 0..1),
        ("/world/zeta/wrist/sector", 9..15),
        ("/world/arm/link4/why_wrist", 1..5),
        (entity::NOW, 3..20),
    ] {
        let rows = rows_at(&run.path().join("run.rrd"), path);
        assert!(expected.contains(&rows), "{path}: {rows}");
    }
}

#[test]
fn missing_messages_leave_gaps_and_are_told() {
    let mut run = Fixture::new(100);
    let late = &mut run.messages[60..];
    late.iter_mut()
        .for_each(|m| m.singularity.header.incarnation = 2);
    let mut recording = run.part(0);
    for tick in 0..100 {
        let mut row = run.row(tick);
        if (20..60).contains(&tick) {
            (row.messages.singularity, row.messages.torque) = (None, None);
        }
        recording.tick(&row).expect("room");
    }
    recording.finish().expect("room");
    let content = run.content();
    for (process, states) in [
        ("analyzer", &["up", "silent", "restarted"][..]),
        ("estimator", &["up"]),
        ("controller", &["up", "waiting", "up"]),
    ] {
        assert_eq!(content.lane(&format!("process/{process}")), states);
    }
    assert_eq!(content.log[0], (60, "WARN".to_owned()));
}

/// A volume with so much room, which fills up in the middle of a write as real ones do.
#[derive(Clone)]
struct Volume {
    bytes: Arc<Mutex<Vec<u8>>>,
    room: usize,
}

impl Write for Volume {
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        let mut bytes = self.bytes.lock().expect("one thread");
        let fits = buffer.len().min(self.room - bytes.len());
        bytes.extend(&buffer[..fits]);
        match fits {
            0 => Err(io::ErrorKind::StorageFull.into()),
            fits => Ok(fits),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Storage for Volume {
    fn cut(&mut self, bytes: u64) -> io::Result<()> {
        self.bytes
            .lock()
            .expect("one thread")
            .truncate(bytes as usize);
        Ok(())
    }

    fn sync(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_full_volume_ends_the_recording_at_a_whole_message() {
    let run = Fixture::new(400);
    let kept = run.path().join("kept.rrd");
    let mut refused_at_once = 0;
    for room in (0..24).map(|k| 22_000 * k + 7_919) {
        let volume = Volume {
            bytes: Arc::default(),
            room,
        };
        let mut errors = Vec::new();
        match Recording::with_storage(volume.clone(), 0, &run.info("test"), OFTEN) {
            Err(error) => {
                refused_at_once += 1;
                errors.push(error);
            }
            Ok(mut recording) => {
                errors.extend((0..400).filter_map(|tick| recording.tick(&run.row(tick)).err()));
                errors.extend(recording.finish().err());
            }
        }
        // One error, once.
        let [RecordError::Write { bytes, source }] = &errors[..] else {
            panic!("{errors:?}")
        };
        let content = volume.bytes.lock().expect("one thread").clone();
        assert_eq!(source.kind(), io::ErrorKind::StorageFull);
        assert!(content.len() as u64 >= *bytes && content.len() <= room);
        std::fs::write(&kept, &content).expect("a file");
        let ticks = Content::one(&kept).ticks;
        assert!(ticks.iter().copied().eq(0..ticks.len() as u64));
        if !ticks.is_empty() {
            // All that is left is whole messages: with an end it is read to the last byte.
            complete(&kept).expect("room");
            assert!(is_complete(&kept).expect("the file"));
            assert_eq!(Content::one(&kept).ticks, ticks);
        }
    }
    assert!(
        (1..24).contains(&refused_at_once),
        "both cases are met: {refused_at_once}"
    );
}

#[test]
fn a_killed_recorder_loses_at_most_a_chunk_and_its_files_are_completed_and_merged() {
    let run = Fixture::new(1200);
    let mut recording = run.part(0);
    run.record(&mut recording, 0..600);
    run.next_part(&mut recording);
    run.record(&mut recording, 600..1199);
    std::mem::forget(recording);
    let parts = parts_in(run.path());
    let count = |part: &PathBuf| Content::one(part).ticks.len();
    let [first, last] = &parts[..] else {
        panic!("{parts:?}")
    };
    // All but the last, unfinished 250 ms.
    assert_eq!((count(first), count(last)), (600, 500));
    let bytes = std::fs::read(last).expect("bytes");
    // Killed while it wrote: at worst a message cut in two.
    let torn = run.path().join("torn.rrd");
    for end in (bytes.len() / 20..bytes.len()).step_by(bytes.len() / 40) {
        std::fs::write(&torn, &bytes[..end]).expect("a file");
        let content = Content::one(&torn);
        let is_whole = [0, 250, 500].contains(&content.ticks.len());
        assert!(is_whole && content.damages == 0, "{end}");
    }
    // A part that cannot be read to its end keeps its bytes: there may be more in them than we can read.
    let mut damaged = bytes.clone();
    damaged[bytes.len() / 2..][..4000].fill(0xff);
    std::fs::write(&torn, &damaged).expect("a file");
    complete(&torn).expect("nothing to write");
    assert_eq!(std::fs::read(&torn).expect("bytes"), damaged);
    std::fs::remove_file(&torn).expect("ours");

    let whole_before = std::fs::read(first).expect("bytes");
    parts.iter().for_each(|part| complete(part).expect("room"));
    assert!(is_complete(last).expect("the file") && count(last) == 500);
    assert_eq!(std::fs::read(first).expect("bytes"), whole_before);
    let files = std::fs::read_dir(run.path()).expect("the folder");
    assert_eq!(files.count(), 2, "no draft is left");

    let whole = run.path().join("whole.rrd");
    let mut reading = crate::Reading::default();
    merge(&parts, &whole, |news| reading.add(news)).expect("room");
    assert!(reading.rows() == 1100 && is_complete(&whole).expect("the file"));
    assert_eq!(count(&whole), 1100);
    // Constants are there once, everything else is kept.
    let sum: usize = parts.iter().map(|part| rows_at(part, entity::LOG)).sum();
    assert_eq!(
        (
            rows_at(&whole, entity::LOG),
            rows_at(&whole, "/world/arm/base")
        ),
        (sum, 1)
    );
    assert!(rows_at(&whole, "blueprint") > 30);
    let other = tempfile::tempdir().expect("a folder");
    let foreign = Recording::create(other.path(), &run.info("other")).expect("room");
    foreign.finish().expect("room");
    let foreign = [first.clone(), other.path().join("run.rrd")];
    let merged = merge(&foreign, &whole, |_| {});
    assert!(
        matches!(merged, Err(MergeError::Foreign { .. })),
        "{merged:?}"
    );
}

#[test]
fn rows_behind_the_place_that_a_killed_recorder_noted_are_written_once() {
    let run = Fixture::new(900);
    let mut killed = run.part(0);
    run.record(&mut killed, 0..300);
    run.next_part(&mut killed);
    run.record(&mut killed, 300..600);
    let noted = killed.written();
    assert_eq!((noted.part, noted.next), (1, 550));
    run.record(&mut killed, 600..700);
    run.next_part(&mut killed);
    run.record(&mut killed, 700..900);
    killed.flush();
    std::mem::forget(killed);

    cut_behind(run.path(), Some(&noted)).expect("files of ours");
    let mut replacement = run.part(noted.part + 1);
    replacement.go_on_after(noted);
    // From its last checkpoint on.
    run.record(&mut replacement, 400..900);
    replacement.finish().expect("room");
    let parts = parts_in(run.path());
    assert_eq!(
        (parts.len(), Content::of(&parts).ticks),
        (3, (0..900).collect())
    );

    // Where no place is known.
    cut_behind(run.path(), None).expect("files of ours");
    assert!(parts_in(run.path()).is_empty());
}

#[test]
fn a_flipped_bit_anywhere_is_read_or_told_and_nothing_panics() {
    let run = Fixture::new(260);
    let mut recording = run.part(0);
    run.record(&mut recording, 0..260);
    recording.finish().expect("room");
    let whole = std::fs::read(run.path().join("run.rrd")).expect("bytes");
    let damaged = run.path().join("damaged.rrd");
    let mut damages = 0;
    for place in (0..whole.len()).step_by(whole.len() / 200) {
        let mut bytes = whole.clone();
        bytes[place] ^= 0x41;
        std::fs::write(&damaged, bytes).expect("a file");
        damages += Content::one(&damaged).damages;
    }
    assert!(damages > 20, "{damages}");
    std::fs::write(&damaged, b"not a recording").expect("a file");
    let read = read(&[damaged], |_| Ok::<(), ReadError>(()));
    assert!(
        matches!(read, Err(ReadError::NotARecording { .. })),
        "{read:?}"
    );
}

#[test]
fn parts_are_found_by_name() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = |part: u32| folder.path().join(part_name(part));
    let write = |part: u32, bytes: &[u8]| std::fs::write(path(part), bytes).expect("a file");
    [0, 1, 3].iter().for_each(|part| write(*part, &[1; 100]));
    assert_eq!(
        parts_in(folder.path()),
        [path(0), path(1)],
        "up to the first gap"
    );
    // Recorders that were killed before they wrote anything, and before their first chunk: the next ones take their places.
    write(1, &[]);
    write(2, &[&b"RRF2"[..], &[0; 129]].concat());
    assert_eq!(parts_in(folder.path()), [path(0), path(3)]);
}
