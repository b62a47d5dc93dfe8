mod merge;
mod parts;
mod volume;

use std::io::{self, BufReader};

use re_chunk::external::arrow::array::{Array, AsArray};
use re_chunk::external::arrow::datatypes::{ArrowPrimitiveType, Float32Type, Float64Type};
use re_log_encoding::DecoderApp;
use re_log_types::{LogMsg, StoreKind};

use super::*;
use crate::entity;
use crate::signals::{Limits, Lives, Signal, TickRow, sample};
use crate::sink::RecordError;
use chain::{Chain, Tick as Messages};
use model::{Model, Robot};
use nalgebra::SVector;
use re_chunk::{Chunk, EntityPath};
use shared_types::scenario::Scenario;
use std::path::Path;
use volume::Volume;

/// A chunk every 250 ms.
const OFTEN: Options = Options {
    chunk_s: 0.25,
    picture_hz: 50.0,
    is_live: false,
};

fn puma() -> Robot {
    Robot::builtin("puma560").expect("built in")
}

/// Wrist lock: the joints turn ζ by 90°, then the hand rotates about the direction that was lost.
fn fig5() -> Scenario {
    let text = sim::scenarios::text("fig5-wrist-rotation").expect("built in");
    Scenario::parse("fig5", text, &[]).expect("valid")
}

/// Its messages, tick by tick.
struct Run(Chain, Messages);

impl Run {
    fn new(robot: &Robot) -> Self {
        let chain = Chain::new(robot, &fig5()).expect("accepted");
        Self(chain, Messages::default())
    }

    fn step(&mut self) -> Messages {
        self.0.step(&mut self.1);
        self.1
    }
}

fn about<'a>(scenario: &'a Scenario, robot: &'a Robot) -> RunInfo<'a> {
    RunInfo {
        scenario,
        robot,
        run: "test",
        version: "0",
        seed: 1,
        hops: Some([0, 1, 2, 3]),
        lives: Lives::default(),
    }
}

fn begin(volume: &Volume, robot: &Robot) -> Result<Recording, RecordError> {
    let scenario = fig5();
    Recording::with_storage(volume.clone(), 0, &about(&scenario, robot), OFTEN)
}

fn row(tick: u64, m: &Messages) -> TickRow<'_> {
    TickRow::new(tick, m.lent())
}

/// Whole messages, and whether the stream ended well.
fn read(bytes: &[u8]) -> (Vec<LogMsg>, bool) {
    let mut messages = Vec::new();
    for message in DecoderApp::decode_lazy(BufReader::new(bytes)) {
        match message {
            Ok(message) => messages.push(message),
            Err(_) => return (messages, false),
        }
    }
    (messages, true)
}

fn chunks(messages: &[LogMsg]) -> Vec<Chunk> {
    let data = |message: &LogMsg| match message {
        LogMsg::ArrowMsg(store, arrow) if store.kind() == StoreKind::Recording => {
            Some(Chunk::from_arrow_msg(arrow).expect("a chunk"))
        }
        _ => None,
    };
    messages.iter().filter_map(data).collect()
}

fn of<'a>(chunks: &'a [Chunk], path: &str) -> Vec<&'a Chunk> {
    let path = EntityPath::from(path);
    chunks
        .iter()
        .filter(|chunk| *chunk.entity_path() == path && !chunk.is_static())
        .collect()
}

fn times(chunks: &[&Chunk], timeline: &'static str) -> Vec<i64> {
    chunks
        .iter()
        .flat_map(|chunk| chunk.timelines()[&timeline.into()].times_raw().to_vec())
        .collect()
}

/// The rows of a component; a row that is missing is `None`.
fn rows<T: ArrowPrimitiveType>(
    chunks: &[&Chunk],
    component: &'static str,
) -> Vec<Option<Vec<T::Native>>> {
    let lists = |chunk: &&Chunk| match chunk.components().get(component.into()) {
        Some(column) => (0..column.list_array.len())
            .map(|i| {
                Some(
                    column
                        .list_array
                        .value(i)
                        .as_primitive::<T>()
                        .values()
                        .to_vec(),
                )
                .filter(|row| !row.is_empty())
            })
            .collect::<Vec<_>>(),
        None => vec![None; chunk.num_rows()],
    };
    chunks.iter().flat_map(lists).collect()
}

fn texts(chunks: &[&Chunk], component: &'static str) -> Vec<String> {
    let text = |chunk: &&Chunk| {
        let column = chunk.components().get(component.into()).into_iter();
        // A row of another component of the same place has none.
        let rows = column.flat_map(|column| {
            let valid = (0..column.list_array.len()).filter(|row| column.list_array.is_valid(*row));
            valid
                .flat_map(|row| {
                    column
                        .list_array
                        .value(row)
                        .as_string::<i32>()
                        .iter()
                        .flatten()
                        .map(str::to_owned)
                        .collect::<Vec<_>>()
                })
                .collect::<Vec<_>>()
        });
        rows.collect::<Vec<_>>()
    };
    chunks.iter().flat_map(text).collect()
}

#[test]
fn every_number_is_read_back() {
    let (volume, robot) = (Volume::new(usize::MAX), puma());
    let mut recording = begin(&volume, &robot).expect("room");
    let mut run = Run::new(&robot);
    let sent: Vec<Messages> = (0..1230).map(|_| run.step()).collect();
    for (tick, m) in sent.iter().enumerate() {
        recording.tick(&row(tick as u64, m)).expect("room");
    }
    let info = recording.finish().expect("room");
    assert_eq!(
        (info.bytes, info.ticks),
        (volume.content().len() as u64, 1230)
    );

    let (messages, whole) = read(&volume.content());
    assert!(whole);
    let data = chunks(&messages);
    let signals = of(&data, entity::SIGNALS);
    assert_eq!(signals.len(), 5, "a chunk every 250 ms and the rest");
    assert_eq!(times(&signals, "tick"), (0..1230).collect::<Vec<i64>>());
    assert_eq!(
        times(&signals, "t"),
        (0..1230).map(|tick| tick * 1_000_000).collect::<Vec<i64>>()
    );
    let q = rows::<Float64Type>(&signals, Signal::Position.name());
    let s = rows::<Float32Type>(&signals, Signal::Measure.name());
    let torque = rows::<Float32Type>(&signals, Signal::TorqueNull.name());
    for (tick, m) in sent.iter().enumerate() {
        assert_eq!(
            q[tick].as_deref(),
            Some(&m.plant_state.q[..6]),
            "tick {tick}"
        );
        assert_eq!(
            s[tick],
            Some(
                m.singularity.singularities[..3]
                    .iter()
                    .map(|one| one.s as f32)
                    .collect()
            ),
            "tick {tick}"
        );
        assert_eq!(
            torque[tick],
            Some(
                m.control_state.tau_null[..6]
                    .iter()
                    .map(|tau| *tau as f32)
                    .collect()
            ),
            "tick {tick}"
        );
    }
}

#[test]
fn a_recording_shows_what_happened() {
    let (volume, robot) = (Volume::new(usize::MAX), puma());
    let mut recording = begin(&volume, &robot).expect("room");
    let mut run = Run::new(&robot);
    let ticks = 4400;
    for tick in 0..ticks {
        recording.tick(&row(tick, &run.step())).expect("room");
    }
    recording.event(ticks, Level::Info, "the end");
    recording.finish().expect("room");
    let (messages, whole) = read(&volume.content());
    assert!(whole);

    // The blueprint is complete before the first number, so that a viewer that follows the file shows it from the start.
    let first =
        |find: &dyn Fn(&LogMsg) -> bool| messages.iter().position(find).expect("there is one");
    let activated = first(&|message| matches!(message, LogMsg::BlueprintActivationCommand(_)));
    let blueprint = first(&|message| message.store_id().kind() == StoreKind::Blueprint);
    let number = first(
        &|message| matches!(message, LogMsg::ArrowMsg(_, arrow) if Chunk::from_arrow_msg(arrow).is_ok_and(|chunk| *chunk.entity_path() == EntityPath::from(entity::SIGNALS) && !chunk.is_static())),
    );
    assert!(blueprint < activated && activated < number);

    let data = chunks(&messages);
    let wrist = texts(&of(&data, "/wrist"), "StateChange:state");
    assert_eq!(wrist, ["reorient", "track", "recover", "regular"]);
    let elbow = texts(&of(&data, "/elbow"), "StateChange:state");
    assert_eq!(elbow, ["regular"]);
    let log = texts(&of(&data, entity::LOG), "TextLog:text");
    assert_eq!(
        log.first().map(String::as_str),
        Some("2.001 s\u{2003}wrist: reorient → track")
    );
    assert_eq!(
        log.last().map(String::as_str),
        Some("4.400 s\u{2003}the end")
    );
    let words = texts(&of(&data, entity::NOW), "TextDocument:text");
    assert!(
        words.iter().any(|text| text.contains("Wrist lock"))
            && words.iter().any(|text| text.contains("Free: "))
    );

    // The wrist links have ghosts, the upper arm has none; they are gone at the end.
    let instances = |link: usize| -> Vec<usize> {
        let places = |chunk: &&Chunk| {
            let places = chunk
                .components()
                .get("InstancePoses3D:translations".into())
                .map(|column| column.list_array.clone());
            places
                .into_iter()
                .flat_map(|lists| {
                    lists
                        .iter()
                        .flatten()
                        .map(|list| list.len())
                        .collect::<Vec<_>>()
                })
                .collect::<Vec<_>>()
        };
        of(&data, &entity::ghost(link))
            .iter()
            .flat_map(places)
            .collect()
    };
    assert!(instances(3).iter().max() >= Some(&3), "{:?}", instances(3));
    assert!(
        instances(1).is_empty(),
        "the upper arm stood still and has no ghosts"
    );
    assert_eq!(instances(3).last(), Some(&1), "one, too small to see");

    // The picture runs at 50 Hz, and the flange is at the model's pose.
    let flange = of(&data, &entity::link(5));
    let expected: Vec<i64> = (0..ticks as i64).step_by(20).collect();
    assert_eq!(times(&flange, "tick"), expected);
    let mut again = Run::new(&robot);
    let arm = Model::<6>::new(&robot, None).expect("six joints");
    let places = flange.iter().flat_map(|chunk| {
        let list = &chunk.components()[&"Transform3D:translation".into()].list_array;
        (0..list.len())
            .map(|i| {
                list.value(i)
                    .as_fixed_size_list()
                    .value(0)
                    .as_primitive::<Float32Type>()
                    .values()
                    .to_vec()
            })
            .collect::<Vec<_>>()
    });
    let mut tick = 0;
    for (want, place) in expected.iter().zip(places) {
        let mut m = again.step();
        while tick < *want {
            m = again.step();
            tick += 1;
        }
        tick += 1;
        let p = arm.link_poses(&SVector::from_column_slice(&m.plant_state.q[..6]))[5].p;
        assert!(
            p.iter()
                .zip(&place)
                .all(|(a, b)| (*a as f32 - b).abs() < 1e-6),
            "{p} {place:?}"
        );
    }
    // Inside the wrist singularity ζ has been turned by 90°: the sector grows every 8°, and what was lost is free then.
    let mut angles = texts(&of(&data, &entity::swept("wrist")), "LineStrips3D:labels");
    // The lines themselves have no words: those stand on a line of their own.
    angles.retain(|words| !words.is_empty());
    assert!(
        (9..=12).contains(&angles.len()) && angles[0].starts_with("ζ turned "),
        "{angles:?}"
    );
    let why = of(&data, &entity::reason("wrist", 3));
    assert!(!why.is_empty(), "the axis of joint 4 is drawn on its link");
    let ending = messages
        .iter()
        .filter(|message| matches!(message, LogMsg::BlueprintActivationCommand(_)))
        .count();
    assert_eq!(ending, 2, "the layout, and at the end what to play again");
}

#[test]
fn a_full_volume_ends_the_recording_at_a_whole_message() {
    let robot = puma();
    let mut run = Run::new(&robot);
    let sent: Vec<Messages> = (0..400).map(|_| run.step()).collect();
    let mut refused_at_once = 0;
    for room in (0..24).map(|k| 22_000 * k + 7_919) {
        let volume = Volume::new(room);
        let mut errors = Vec::new();
        match begin(&volume, &robot) {
            Err(error) => {
                refused_at_once += 1;
                errors.push(error);
            }
            Ok(mut recording) => {
                errors.extend(
                    sent.iter()
                        .enumerate()
                        .filter_map(|(tick, m)| recording.tick(&row(tick as u64, m)).err()),
                );
                errors.extend(recording.finish().err());
            }
        }
        assert_eq!(errors.len(), 1, "one error, once: {errors:?}");
        let RecordError::Write { bytes, source } = &errors[0] else {
            panic!("{:?}", errors[0])
        };
        assert_eq!(source.kind(), io::ErrorKind::StorageFull);
        assert!(
            *bytes <= room as u64 && errors[0].to_string().contains("--no-record"),
            "{}",
            errors[0]
        );
        let content = volume.content();
        assert!(
            content.len() >= *bytes as usize && content.len() <= room,
            "{} bytes of {room}",
            content.len()
        );
        let (messages, whole) = read(&content);
        assert!(
            whole || content.is_empty(),
            "room {room}: the end is not a whole message"
        );
        let data = chunks(&messages);
        let ticks = times(&of(&data, entity::SIGNALS), "tick");
        assert_eq!(
            ticks,
            (0..ticks.len() as i64).collect::<Vec<i64>>(),
            "what is kept is kept whole"
        );
    }
    assert!(
        (1..24).contains(&refused_at_once),
        "both cases are met: {refused_at_once}"
    );
}

#[test]
fn a_killed_recorder_loses_at_most_a_chunk() {
    let (volume, robot) = (Volume::new(usize::MAX), puma());
    let mut recording = begin(&volume, &robot).expect("room");
    let mut run = Run::new(&robot);
    for tick in 0..777 {
        recording.tick(&row(tick, &run.step())).expect("room");
    }
    // After a kill: no footer, and at worst a message cut in two.
    let content = volume.content();
    let kept = |bytes: &[u8]| times(&of(&chunks(&read(bytes).0), entity::SIGNALS), "tick").len();
    assert_eq!(kept(&content), 750, "all but the last, unfinished 250 ms");
    assert!(kept(&content[..content.len() - 3]) >= 500);
}

#[test]
fn missing_messages_leave_gaps_and_are_told() {
    let (volume, robot) = (Volume::new(usize::MAX), puma());
    let mut recording = begin(&volume, &robot).expect("room");
    let mut run = Run::new(&robot);
    for tick in 0..100 {
        let mut m = run.step();
        if tick >= 60 {
            m.singularity.header.incarnation = 2;
        }
        let mut row = row(tick, &m);
        if (20..60).contains(&tick) {
            (row.messages.singularity, row.messages.torque) = (None, None);
        }
        recording.tick(&row).expect("room");
    }
    recording.finish().expect("room");
    let (messages, _) = read(&volume.content());
    let data = chunks(&messages);
    let signals = of(&data, entity::SIGNALS);
    let present: Vec<bool> = rows::<Float32Type>(&signals, Signal::Measure.name())
        .iter()
        .map(Option::is_some)
        .collect();
    assert_eq!(
        present,
        (0..100)
            .map(|tick| !(20..60).contains(&tick))
            .collect::<Vec<bool>>()
    );
    assert!(
        rows::<Float64Type>(&signals, Signal::Position.name())
            .iter()
            .all(Option::is_some)
    );
    assert_eq!(
        texts(&of(&data, "/3.analyzer"), "StateChange:state"),
        ["up", "silent", "restarted"]
    );
    assert_eq!(
        texts(&of(&data, "/2.estimator"), "StateChange:state"),
        ["up"]
    );
    assert_eq!(
        texts(&of(&data, "/4.controller"), "StateChange:state"),
        ["up", "waiting", "up"],
        "it had no input"
    );
    assert!(
        texts(&of(&data, entity::LOG), "TextLog:text")
            .iter()
            .any(|line| line.ends_with("analyzer is back as incarnation 2"))
    );
}

#[test]
fn a_recording_at_a_frame_that_the_arm_does_not_have_is_refused() {
    let robot = Robot::builtin("iiwa14").expect("built in");
    let text = sim::scenarios::text("fig5-wrist-rotation").expect("built in");
    let scenario = Scenario::parse("fig5", text, &["frame=\"nowhere\"".to_owned()]);
    let scenario = scenario.expect("valid");
    let run = about(&scenario, &robot);
    let error = Recording::with_storage(Volume::new(usize::MAX), 0, &run, Options::default())
        .err()
        .expect("there is no such frame");
    assert!(
        error.to_string().contains("iiwa14") && error.to_string().contains("nowhere"),
        "{error}"
    );
}

/// An arm of two joints in the places of eight: only its own links are drawn.
#[test]
fn a_smaller_arm_has_its_own_links_only() {
    let (volume, robot) = (
        Volume::new(usize::MAX),
        Robot::builtin("planar2r").expect("built in"),
    );
    begin(&volume, &robot)
        .expect("two joints fit in eight")
        .finish()
        .expect("room");
    let drawn: Vec<_> = chunks(&read(&volume.content()).0)
        .iter()
        .map(|chunk| chunk.entity_path().to_string())
        .collect();
    assert_eq!(
        (0..8)
            .filter(|&joint| drawn.contains(&entity::link(joint)))
            .collect::<Vec<_>>(),
        [0, 1]
    );
}

#[test]
fn a_folder_that_does_not_exist_is_named() {
    let (scenario, robot) = (fig5(), puma());
    let run = about(&scenario, &robot);
    let error = Recording::create(Path::new("/there/is/no/such"), &run)
        .err()
        .expect("no folder");
    assert!(
        error.to_string().contains("/there/is/no/such/run.rrd")
            && error.to_string().contains("--out"),
        "{error}"
    );
}

#[test]
fn a_recording_is_read_back() {
    let folder = std::env::temp_dir().join(format!("armplane-read-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let (scenario, robot) = (fig5(), puma());
    let about = RunInfo {
        seed: 7,
        ..about(&scenario, &robot)
    };
    let mut recording = Recording::create(&folder, &about).expect("room");
    let mut run = Run::new(&robot);
    let sent: Vec<Messages> = (0..250).map(|_| run.step()).collect();
    for (tick, m) in sent.iter().enumerate() {
        // Between two of the ticks at which signals of a lower rate are drawn.
        if tick == 123 {
            recording.next_part(&folder).expect("room");
        }
        let mut row = row(tick as u64, m);
        row.messages.singularity = row.singularity.filter(|_| tick != 60);
        recording.tick(&row).expect("room");
    }
    recording.event(250, Level::Warning, "the end");
    recording.finish().expect("room");

    let (mut ticks, mut q5, mut s, mut log, mut wrist, mut slow) = (
        Vec::new(),
        Vec::new(),
        Vec::new(),
        Vec::new(),
        Vec::new(),
        Vec::new(),
    );
    let done = crate::read::read(&parts_in(&folder), |piece| {
        match piece {
            crate::Piece::About(about) => {
                assert_eq!(
                    (
                        about.joints,
                        about.properties["seed"].as_str(),
                        about.rate_hz()
                    ),
                    (6, "7", 1000.0)
                );
                assert_eq!(about.singularities, ["elbow", "wrist", "overhead"]);
            }
            crate::Piece::Rows(rows) => {
                for (row, tick) in rows.ticks.iter().enumerate() {
                    ticks.push(*tick);
                    let mut values = Vec::new();
                    rows.values(Signal::Position, row, &mut values);
                    q5.push(values[4]);
                    values.clear();
                    rows.values(Signal::Measure, row, &mut values);
                    s.push(values.get(1).copied());
                    values.clear();
                    rows.values(Signal::SingularValues, row, &mut values);
                    slow.push(values.len());
                }
            }
            crate::Piece::Event { tick, level, text } => log.push((tick, level, text)),
            crate::Piece::State { tick, lane, state } if lane == "mode/wrist" => {
                wrist.push((tick, state))
            }
            crate::Piece::State { .. }
            | crate::Piece::Place { .. }
            | crate::Piece::Label { .. } => {}
            crate::Piece::Damaged(damage) => panic!("{damage}"),
            crate::Piece::Solid(solid) => assert!(
                !solid.corners().is_empty() && solid.corners().len() == solid.colours().len()
            ),
        }
        Ok::<(), crate::ReadError>(())
    });
    let whole = std::fs::read(folder.join(part_name(0))).expect("part 0");
    std::fs::write(folder.join("torn.rrd"), &whole[..whole.len() / 4]).expect("a file");
    let mut torn = 0;
    let torn_end = crate::read::read(&[folder.join("torn.rrd")], |piece| {
        torn += if let crate::Piece::Rows(rows) = piece {
            rows.ticks.len()
        } else {
            0
        };
        Ok::<(), crate::ReadError>(())
    });
    // A flipped bit anywhere: it is read, or that is said; nothing panics.
    let mut damages = Vec::new();
    for place in (0..whole.len()).step_by(whole.len() / 200) {
        let mut bytes = whole.clone();
        bytes[place] ^= 0x41;
        std::fs::write(folder.join("damaged.rrd"), bytes).expect("a file");
        let read = crate::read::read(&[folder.join("damaged.rrd")], |piece| {
            match piece {
                crate::Piece::Damaged(damage) => damages.push(damage.to_string()),
                crate::Piece::Rows(rows) => (0..rows.ticks.len())
                    .for_each(|row| rows.values(Signal::Position, row, &mut Vec::new())),
                _ => {}
            }
            Ok::<(), crate::ReadError>(())
        });
        damages.extend(read.err().map(|error| error.to_string()));
    }
    std::fs::write(folder.join("other.rrd"), b"not a recording").expect("a file");
    let other = crate::read::read(&[folder.join("other.rrd")], |_| {
        Ok::<(), crate::ReadError>(())
    });
    std::fs::remove_dir_all(&folder).expect("ours");

    done.expect("readable");
    assert_eq!(ticks, (0..250).collect::<Vec<u64>>());
    assert_eq!(slow, [6; 250], "signals of a lower rate at every tick");
    for (k, m) in sent.iter().enumerate() {
        assert_eq!(q5[k], m.plant_state.q[4]);
        assert_eq!(
            s[k],
            (k != 60).then_some(f64::from(m.singularity.singularities[1].s as f32)),
            "tick {k}"
        );
    }
    assert_eq!(
        log.last(),
        Some(&(250, "WARN".to_owned(), "the end".to_owned()))
    );
    assert_eq!(
        wrist,
        [(0, "reorient".to_owned()), (123, "reorient".to_owned())],
        "each part says where it begins"
    );
    torn_end.expect("a torn end is an end");
    assert!(torn < 120, "{torn}");
    assert!(
        damages
            .iter()
            .any(|damage| damage.contains("damaged.rrd is damaged before its byte ")),
        "{damages:?}"
    );
    assert!(
        other
            .unwrap_err()
            .to_string()
            .contains("other.rrd is not a recording")
    );
}

#[test]
fn every_signal_names_its_elements() {
    let robot = puma();
    let limits = Limits::new(&robot);
    let mut m = Run::new(&robot).step();
    // On one thread nothing is stamped.
    m.torque.header.stamps.received_ns = [1; 8];
    m.torque.header.stamps.sent_ns = [1; 8];
    let names: Vec<String> = ["elbow", "wrist", "overhead"].map(str::to_owned).into();
    let mut seen = 0;
    sample(
        &row(0, &m),
        &limits,
        Some([0, 1, 2, 3]),
        |signal, values| {
            seen += 1;
            assert_eq!(
                values.len(),
                signal.elements(6, &names).len(),
                "{}",
                signal.name()
            );
        },
    );
    assert_eq!(seen, Signal::ALL.iter().filter(|signal| limits.derive(**signal).is_none() && **signal != Signal::SingularValues).count());
}
