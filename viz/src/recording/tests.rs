use std::collections::BTreeMap;
use std::io::BufReader;

use chain::Chain;
use re_log_encoding::DecoderApp;
use rerun::StoreKind;
use rerun::log::Chunk;
use shared_types::graph::Graph;
use shared_types::job::Mode;
use shared_types::scenario::Scenario;
use shared_types::summary::{FaultSummary, Summary};
use shared_types::topics::ByTopic;

use super::*;

/// The job of a built-in scenario, and its arm.
pub(crate) fn job(name: &str) -> (Job, Robot) {
    let text = sim::scenarios::text(name).expect("built in");
    let scenario = Scenario::parse(name, text, &[]).expect("valid");
    let robot = Robot::builtin(&scenario.robot).expect("built in");
    let job = Job {
        run: "test".to_owned(),
        id: 7,
        version: "0".to_owned(),
        mode: Mode::Lockstep,
        out: "nowhere".into(),
        record: true,
        scenario,
        robot: robot.source.clone(),
        dof: robot.dof() as u32,
        graph: Graph::built_in(false).expect("valid"),
        from: None,
        deaths: Vec::new(),
    };
    (job, robot)
}

/// Draws the first ticks of a wrist lock.
fn draw(
    path: &Path,
    count: u64,
    happened: Happened,
    progress: Progress,
) -> Result<Option<String>, RecordError> {
    made(count, happened, progress, |source| write_rrd(path, source))
}

/// Makes something of these ticks: the joints turn ζ by 90°, then the hand rotates about the direction that was lost.
fn made<T>(
    count: u64,
    happened: Happened,
    progress: Progress,
    make: impl FnOnce(Source) -> T,
) -> T {
    let (job, robot) = job("fig5-wrist-rotation");
    let mut chain = Chain::new(&robot, &job.scenario).expect("accepted");
    let mut whole = chain::Tick::default();
    let mut ticks = (0..count).map(|tick| {
        assert!(chain.step(&mut whole));
        let (mut messages, events): (ByTopic<_>, _) = ((&whole).into(), Vec::new());
        // The chain has a place for them in any run.
        (messages.target, messages.servo_state) = (None, None);
        Tick {
            tick,
            messages,
            events,
        }
    });
    let source = Source {
        job: &job,
        robot: &robot,
        happened,
        ticks: &mut ticks,
        progress,
    };
    make(source)
}

/// The rows of each entity of a file that are not static, and the ticks of its numbers.
fn rows(path: &Path) -> (BTreeMap<String, usize>, Vec<i64>) {
    let file = BufReader::new(std::fs::File::open(path).expect("there"));
    let (mut rows, mut ticks) = (BTreeMap::new(), Vec::new());
    for message in DecoderApp::decode_lazy(file) {
        let LogMsg::ArrowMsg(store, message) = message.expect("whole") else {
            continue;
        };
        let chunk = Chunk::from_arrow_msg(&message).expect("a chunk");
        let path = match store.kind() {
            StoreKind::Blueprint => "blueprint".to_owned(),
            StoreKind::Recording => chunk.entity_path().to_string(),
        };
        if path == entity::SIGNALS && !chunk.is_static() {
            let times = chunk.iter_indices(&"tick".into());
            ticks.extend(times.map(|(tick, _)| tick.as_i64()));
        }
        let known = rows.entry(path).or_default();
        *known += if chunk.is_static() {
            0
        } else {
            chunk.num_rows()
        };
    }
    (rows, ticks)
}

#[test]
fn a_recording_shows_what_happened() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.rrd");
    let fault = FaultSummary {
        tick: 100,
        process: "plant".to_owned(),
        kind: "exit".to_owned(),
        occurred: true,
        recovered_ms: Some(50.0),
        ..FaultSummary::default()
    };
    let happened = Happened {
        faults: &[fault],
        ..Happened::default()
    };
    draw(&path, 4400, happened, &mut |_| true).expect("room");
    let (rows, numbers) = rows(&path);
    assert!(numbers.into_iter().eq(0..4400));
    // The picture runs at 50 Hz. The wrist has ghosts. Inside the wrist singularity ζ has been turned by
    // 90°: the sector grows every 8°, and what was lost is free then. The fault begins and ends.
    for (path, expected) in [
        ("/world/arm/link6", 220..221),
        ("/world/zeta/wrist/sector", 9..15),
        ("/world/arm/link4/why_wrist", 1..5),
        ("/wrist", 4..5),
        (entity::LOG, 3..4),
        (entity::FAULT, 3..4),
        (entity::NOW, 3..30),
        ("blueprint", 60..600),
    ] {
        let rows = rows.get(path).copied().unwrap_or_default();
        assert!(expected.contains(&rows), "{path}: {rows}");
    }
    let is_part = |path: &str| path.parse::<usize>().is_ok();
    let ghosts = rows.iter().filter(|(path, _)| {
        let part = path.strip_prefix("/world/null_motion/");
        part.is_some_and(is_part)
    });
    let most = ghosts.map(|(_, rows)| *rows).max();
    assert!(most.is_some_and(|most| (4..20).contains(&most)), "{most:?}");
    let files = std::fs::read_dir(folder.path()).expect("the folder");
    assert_eq!(files.count(), 1, "no draft is left");
}

#[test]
fn a_recording_or_a_page_that_is_stopped_leaves_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("run.rrd");
    let stopped = draw(&path, 1100, Happened::default(), &mut |count| count < 1000);
    assert!(matches!(stopped, Err(RecordError::Stopped)));
    let page = |source: Source| crate::report(&Summary::default(), source, &[]);
    let stopped = made(1100, Happened::default(), &mut |count| count < 1000, page);
    assert!(matches!(stopped, Err(RecordError::Stopped)));
    let error = RrdFile::create(&folder.path().join("none/run.rrd")).map(drop);
    assert!(matches!(error, Err(RecordError::Write { .. })));
    let files = std::fs::read_dir(folder.path()).expect("the folder");
    assert_eq!(files.count(), 0);
}
