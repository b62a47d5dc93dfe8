//! The files of a recording.

use super::*;

#[test]
fn every_part_opens_alone_and_all_together() {
    let (first, second, robot) = (Volume::new(usize::MAX), Volume::new(usize::MAX), puma());
    let mut recording = begin(&first, &robot).expect("room");
    let mut run = Run::new(&robot);
    for tick in 0..300 {
        if tick == 130 {
            recording.turn_over(second.clone()).expect("room");
            assert_eq!((recording.part(), recording.part_ticks()), (1, 0));
        }
        recording.tick(&row(tick, &run.step())).expect("room");
    }
    let info = recording.finish().expect("room");
    assert_eq!(
        (info.parts, info.ticks, info.bytes as usize),
        (2, 300, first.content().len() + second.content().len())
    );

    let parts = [first, second].map(|volume| read(&volume.content()));
    let ids = parts.each_ref().map(|(messages, whole)| {
        assert!(*whole, "a part ends with its footer");
        let mut ids: Vec<String> = messages
            .iter()
            .map(|message| format!("{:?}", message.store_id()))
            .collect();
        ids.sort();
        ids.dedup();
        ids
    });
    assert_eq!(ids[0], ids[1], "one recording and one blueprint");
    let data = parts.each_ref().map(|(messages, _)| chunks(messages));
    let ticks = data
        .each_ref()
        .map(|data| times(&of(data, entity::SIGNALS), "tick"));
    assert_eq!(
        ticks,
        [(0..130).collect::<Vec<i64>>(), (130..300).collect()],
        "no tick is lost or told twice"
    );
    let statics = data.each_ref().map(|data| {
        let mut paths: Vec<String> = data
            .iter()
            .filter(|chunk| chunk.is_static())
            .map(|chunk| chunk.entity_path().to_string())
            .collect();
        paths.sort();
        paths
    });
    assert!(
        statics[0] == statics[1] && statics[0].contains(&entity::link(5)),
        "{statics:?}"
    );
    // Values that rarely change are written again at the beginning of each part.
    assert_eq!(
        texts(&of(&data[1], "/wrist"), "StateChange:state"),
        ["reorient"]
    );
    assert!(
        times(&of(&data[1], entity::NOW), "tick").first() == Some(&130)
            && times(&of(&data[1], entity::GUIDES), "tick")[0] == 130
    );
    let log = texts(&of(&data[1], entity::LOG), "TextLog:text");
    assert_eq!(log, Vec::<String>::new(), "nothing has changed");
    let ends = data
        .each_ref()
        .map(|data| times(&of(data, entity::GUIDES), "tick").last().copied());
    assert_eq!(
        ends,
        [Some(0), Some(299 + 51)],
        "the last part's guides leave a legend room beside 170 ticks"
    );
}

#[test]
fn a_recorder_that_takes_up_writes_the_next_part_of_the_same_recording() {
    let (killed, taken_up, robot) = (Volume::new(usize::MAX), Volume::new(usize::MAX), puma());
    let scenario = fig5();
    let about = about(&scenario, &robot);
    let mut run = Run::new(&robot);
    let messages: Vec<Messages> = (0..200).map(|_| run.step()).collect();
    let mut recording = begin(&killed, &robot).expect("room");
    (0..100).for_each(|tick| {
        recording
            .tick(&row(tick as u64, &messages[tick]))
            .expect("room")
    });
    std::mem::forget(recording);
    let mut recording = Recording::with_storage(taken_up.clone(), 1, &about, OFTEN).expect("room");
    (100..200).for_each(|tick| {
        recording
            .tick(&row(tick as u64, &messages[tick]))
            .expect("room")
    });
    assert_eq!(recording.finish().expect("room").parts, 2);
    let [before, after] = [killed, taken_up].map(|volume| read(&volume.content()).0);
    let id = |messages: &[LogMsg]| messages[0].store_id().clone();
    assert_eq!(id(&before), id(&after));
    assert_eq!(
        times(&of(&chunks(&after), entity::SIGNALS), "tick"),
        (100..200).collect::<Vec<i64>>()
    );
}

#[test]
fn rows_behind_the_place_that_a_killed_recorder_noted_are_written_once() {
    let folder = tempfile::tempdir().expect("a folder");
    let robot = puma();
    let scenario = fig5();
    let about = about(&scenario, &robot);
    let mut run = Run::new(&robot);
    let messages: Vec<Messages> = (0..900).map(|_| run.step()).collect();
    let record = |recording: &mut Recording, ticks: std::ops::Range<usize>| {
        ticks.for_each(|tick| {
            recording
                .tick(&row(tick as u64, &messages[tick]))
                .expect("room")
        });
    };
    let part = |part| Recording::create_part(folder.path(), part, &about, OFTEN).expect("room");
    let mut killed = part(0);
    record(&mut killed, 0..300);
    killed.next_part(folder.path()).expect("room");
    record(&mut killed, 300..600);
    let noted = killed.written();
    assert_eq!((noted.part, noted.next), (1, 550));
    record(&mut killed, 600..700);
    killed.next_part(folder.path()).expect("room");
    record(&mut killed, 700..900);
    killed.flush();
    std::mem::forget(killed);

    cut_behind(folder.path(), Some(&noted)).expect("files of ours");
    let mut replacement = part(noted.part + 1);
    replacement.go_on_after(noted);
    // From its last checkpoint on.
    record(&mut replacement, 400..900);
    assert_eq!(replacement.finish().expect("room").parts, 3);
    let of_part = |part| {
        let bytes = std::fs::read(folder.path().join(part_name(part))).expect("a part");
        times(&of(&chunks(&read(&bytes).0), entity::SIGNALS), "tick")
    };
    assert_eq!(
        (0..3).flat_map(of_part).collect::<Vec<_>>(),
        (0..900).collect::<Vec<i64>>()
    );

    cut_behind(folder.path(), None).expect("files of ours");
    assert_eq!(
        parts_in(folder.path()),
        Vec::<std::path::PathBuf>::new(),
        "where no place is known"
    );
}

#[test]
fn parts_are_found_by_name() {
    let folder = std::env::temp_dir().join(format!("armplane-parts-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let write = |part: u32, bytes: usize| {
        std::fs::write(folder.join(part_name(part)), vec![0; bytes]).expect("a file")
    };
    for part in [0, 1, 3] {
        write(part, 100);
    }
    let found = parts_in(&folder);
    // A recorder that was killed before it wrote anything: the next one takes the place.
    write(1, 0);
    let without = parts_in(&folder);
    // One that was killed before its first chunk.
    let named = [&b"RRF2"[..], &[0; 129]].concat();
    std::fs::write(folder.join(part_name(0)), named).expect("a file");
    write(1, 100);
    let behind = parts_in(&folder);
    std::fs::remove_dir_all(&folder).expect("ours");
    assert_eq!(
        found,
        ["run.rrd", "run-001.rrd"].map(|name| folder.join(name)),
        "up to the first gap"
    );
    assert_eq!(without, [folder.join("run.rrd")]);
    assert_eq!(behind, [folder.join("run-001.rrd")]);
}
