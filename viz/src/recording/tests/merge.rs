//! The parts of a recording in one file, and the end of a part whose recorder was killed.

use super::*;
use crate::frames::Frames;
use crate::recording::merge::is_complete;
use crate::{MergeError, ReadNews, complete, merge};

/// A recording of two parts of 600 ticks, the last without an end: its recorder was killed.
fn two_parts(folder: &Path, run: &str) -> [std::path::PathBuf; 2] {
    let robot = puma();
    let scenario = fig5();
    let info = RunInfo {
        scenario: &scenario,
        robot: &robot,
        run,
        version: "0",
        seed: 1,
        hops: Some([0, 1, 2, 3]),
        lives: Lives::default(),
    };
    let (mut recording, mut messages) = (
        Recording::create(folder, &info).expect("room"),
        Run::new(&robot),
    );
    for tick in 0..1200 {
        if tick == 600 {
            recording.next_part(folder).expect("room");
        }
        recording.tick(&row(tick, &messages.step())).expect("room");
    }
    recording.flush();
    std::mem::forget(recording);
    [0, 1].map(|part| folder.join(part_name(part)))
}

fn chunks_of(path: &Path) -> Vec<Chunk> {
    let mut frames = Frames::open(path).expect("the file");
    let stored = std::iter::from_fn(|| frames.next_chunk().expect("whole"));
    let of_recording = stored.filter(|(store, _)| store.kind() == StoreKind::Recording);
    of_recording.map(|(_, chunk)| chunk).collect()
}

fn ticks_of(path: &Path) -> Vec<i64> {
    times(&of(&chunks_of(path), entity::SIGNALS), "tick")
}

#[test]
fn a_part_of_a_killed_recorder_gets_its_footer_and_loses_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let [first, last] = two_parts(folder.path(), "one");
    assert!(is_complete(&first).expect("the file") && !is_complete(&last).expect("the file"));
    let before = [&first, &last].map(|part| {
        (
            std::fs::read(part).expect("bytes"),
            ticks_of(part),
            chunks_of(part).len(),
        )
    });
    complete(&first).expect("room");
    complete(&last).expect("room");
    assert!(is_complete(&last).expect("the file"));
    assert_eq!(
        std::fs::read(&first).expect("bytes"),
        before[0].0,
        "a whole part is not touched"
    );
    assert_eq!(
        (ticks_of(&last), chunks_of(&last).len()),
        (before[1].1.clone(), before[1].2)
    );
    assert_eq!(
        std::fs::read_dir(folder.path())
            .expect("the folder")
            .count(),
        2,
        "no draft is left"
    );
    // A part that cannot be read to its end keeps its bytes: there may be more in them than we can read.
    let mut damaged = before[1].0.clone();
    let middle = damaged.len() / 2;
    damaged[middle..middle + 4000].fill(0xff);
    std::fs::write(&last, &damaged).expect("room");
    complete(&last).expect("nothing to write");
    assert_eq!(std::fs::read(&last).expect("bytes"), damaged);
    assert_eq!(
        std::fs::read_dir(folder.path())
            .expect("the folder")
            .count(),
        2,
        "no draft is left"
    );
}

#[test]
fn parts_are_merged_with_every_row_and_constants_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let parts = two_parts(folder.path(), "one");
    let whole = folder.path().join("whole.rrd");
    let mut rows = 0;
    let bytes = merge(&parts, &whole, |news| match news {
        ReadNews::Rows(more) => rows += more,
        ReadNews::Damaged(damage) => panic!("{damage}"),
    });
    let bytes = bytes.expect("room");
    assert_eq!(rows, 1200);
    assert_eq!(bytes, std::fs::metadata(&whole).expect("the file").len());
    assert!(is_complete(&whole).expect("the file"));
    assert_eq!(ticks_of(&whole), (0..1200).collect::<Vec<_>>());
    let (messages, is_whole) = read(&std::fs::read(&whole).expect("bytes"));
    assert!(is_whole);
    let data = chunks(&messages);
    let figures = |path: &Path| {
        let link = EntityPath::from(entity::link(1));
        chunks_of(path)
            .iter()
            .filter(|chunk| chunk.is_static() && *chunk.entity_path() == link)
            .count()
    };
    assert_eq!(
        (figures(&parts[0]), figures(&parts[1]), figures(&whole)),
        (1, 1, 1)
    );
    let moving = |chunks: &[Chunk]| chunks.iter().filter(|chunk| !chunk.is_static()).count();
    assert_eq!(
        moving(&data),
        parts
            .iter()
            .map(|part| moving(&chunks_of(part)))
            .sum::<usize>()
    );
    assert!(
        messages
            .iter()
            .any(|message| matches!(message, LogMsg::BlueprintActivationCommand(_))),
        "it has its layout"
    );

    let other = tempfile::tempdir().expect("a folder");
    let [foreign, _] = two_parts(other.path(), "two");
    let error = merge(&[parts[0].clone(), foreign], &whole, |_| {}).expect_err("two recordings");
    assert!(matches!(error, MergeError::Foreign { .. }), "{error}");
}
