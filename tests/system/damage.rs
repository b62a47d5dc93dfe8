//! Results that are not whole: each command that reads or makes them says so, and its exit code does.

use std::path::{Path, PathBuf};

use message_log::{Contents, FILE as MESSAGES, Log, Writer};
use serde_json::Value;

use crate::command::{Desk, Known, assert_nothing_left};
use crate::pipes::make_pipe;

/// A short motion.
const SHORT: &str = "name = \"short\"\nrobot = \"puma560\"\nsettle_s = 0.3\n[start]\nq_deg = [20, -60, 170, 0, 30, 0]\n\
                     [[segment]]\nby_m = [0.01, 0.0, 0.0]\nduration_s = 0.5\n";

/// Takes away what a killed launcher does not leave.
fn as_of_a_killed_launcher(run: &Path) {
    for name in ["summary.json", "scenario.toml", "run.rrd"] {
        std::fs::remove_file(run.join(name)).unwrap();
    }
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// Ticks of a block.
const EACH: u64 = 50;

/// The message log of a run, written again in blocks of some ticks; where each block begins, and where the last one ends.
fn in_blocks(run: &Path) -> (Vec<u8>, Vec<usize>) {
    let job = serde_json::from_slice(&std::fs::read(run.join("job.json")).unwrap()).unwrap();
    let (path, contents) = (run.join(MESSAGES), Contents::of(&job));
    let log = Log::open(&path, &contents).unwrap();
    let topics = contents.layouts().iter();
    let mut rows: Vec<_> = topics.map(|layout| log.rows(&layout.topic)).collect();
    let again = run.join("again.mcap");
    let mut writer = Writer::create(&again, &contents).unwrap();
    let mut places = vec![writer.place().bytes as usize];
    let (mut tick, mut is_over) = (0, false);
    while !is_over {
        for (channel, rows) in rows.iter_mut().enumerate() {
            match rows.next_row().unwrap() {
                Some(row) => writer.add(channel, row).unwrap(),
                None => is_over = true,
            }
        }
        tick += 1;
        if tick % EACH == 0 || is_over {
            writer.flush().unwrap();
            places.push(writer.place().bytes as usize);
        }
    }
    places.dedup();
    writer.finish().unwrap();
    let file = std::fs::read(&again).unwrap();
    std::fs::rename(again, path).unwrap();
    (file, places)
}

/// A desk with a run in `r`, the folder of the run, and its summary.
fn with_run() -> (Desk, PathBuf, Value) {
    let desk = Desk::new();
    desk.file("short.toml", SHORT);
    let summary = desk.run("short.toml --out r");
    let run = desk.path().join("r");
    (desk, run, summary)
}

#[test]
fn recover_keeps_a_recording_that_holds_more_than_the_messages() {
    let (desk, run, summary) = with_run();
    let rows = summary["recorder"]["rows"].count();
    let rr = |name: &str| std::fs::read(run.join(name)).unwrap();
    let (log, places) = in_blocks(&run);
    let recording = rr("run.rrd");
    // Cut off between two blocks, as no launcher leaves it that was killed; then gone, after a recovery that has moved the recording already.
    for left in [Some(&log[..places[5]]), None] {
        std::fs::remove_file(run.join("summary.json")).unwrap();
        match left {
            Some(left) => std::fs::write(run.join(MESSAGES), left).unwrap(),
            None => std::fs::remove_file(run.join(MESSAGES)).unwrap(),
        }
        desk.refuses(
            1,
            "recover r",
            &[&format!("has {rows} rows, and stays in earlier/")],
        );
        assert!(rr("earlier/run.rrd") == recording);
    }
    // Where the messages hold as much, it is made anew, and the other goes.
    std::fs::remove_file(run.join("summary.json")).unwrap();
    std::fs::write(run.join(MESSAGES), log).unwrap();
    let said = desk.succeeds("recover r --json");
    assert_eq!(said.json()["recorder"]["rows"].as_u64(), Some(rows));
    assert!(!run.join("earlier").exists());
}

#[test]
fn messages_in_the_memory_of_a_killed_recorder_are_said_and_are_no_defect() {
    let (desk, run, summary) = with_run();
    let rows = summary["recorder"]["rows"].count();
    let (file, places) = in_blocks(&run);
    std::fs::remove_file(run.join("summary.json")).unwrap();
    // Within the last block, where the recording has its rows.
    let torn = places[places.len() - 1] - 200;
    std::fs::write(run.join(MESSAGES), &file[..torn]).unwrap();
    let said = desk.armplane("recover r --json");
    let summary = said.json();
    let (ticks, reason) = (summary["ticks"].count(), summary["reason"].text());
    assert_eq!(
        (said.code, &summary["recorder"]["error"]),
        (0, &"".into()),
        "{}",
        said.err
    );
    assert!(ticks < rows && ticks % EACH == 0, "{ticks} of {rows}");
    assert!(
        reason.contains(&format!("has {rows} rows, and stays in earlier/")),
        "{reason}"
    );
    assert!(run.join("earlier/run.rrd").exists());
}

#[test]
fn a_recording_with_one_other_bit_or_of_another_run_is_not_taken_for_the_runs() {
    let desk = Desk::new();
    desk.file("short.toml", SHORT);
    for (run, seed) in [("r", "1"), ("other", "2")] {
        desk.run(&format!("short.toml --seed {seed} --out {run}"));
    }
    let path = desk.path().join("r/run.rrd");
    let (written, of_another) = (
        std::fs::read(&path).unwrap(),
        std::fs::read(desk.path().join("other/run.rrd")).unwrap(),
    );
    let flipped = |at: usize| {
        let mut bytes = written.clone();
        bytes[at] ^= 1;
        bytes
    };
    let longer = [&written[..], b"more"].concat();
    let n = written.len();
    for bytes in [
        of_another,
        longer,
        flipped(n / 5),
        flipped(n / 2),
        flipped(4 * n / 5),
    ] {
        std::fs::write(&path, &bytes).unwrap();
        for command in ["report r", "export r --format csv --out csv"] {
            let said = desk.armplane(command);
            assert!(
                [1, 2].contains(&said.code)
                    && said.err.contains("run.rrd")
                    && said.err.contains("makes the run again"),
                "{command:?}: {}",
                said.err
            );
        }
    }
    std::fs::write(&path, &written).unwrap();
    let further = desk.path().join("r/run-001.rrd");
    std::fs::copy(desk.path().join("other/run.rrd"), &further).unwrap();
    for command in ["report r", "export r --format csv --out csv"] {
        desk.refuses(1, command, &["run-001.rrd is no file of this run"]);
    }
    std::fs::remove_file(further).unwrap();
    for command in ["report r", "export r --format csv --out csv"] {
        desk.succeeds(command);
    }
}

#[test]
fn blocks_that_are_missing_repeated_exchanged_or_of_another_run_are_named_by_each_command() {
    let (desk, run, whole) = with_run();
    desk.run("short.toml --out other");
    let ticks = whole["ticks"].count();
    let (file, places) = in_blocks(&run);
    // Of other lengths: its stamps are others.
    let (other, others) = in_blocks(&desk.path().join("other"));
    let names = names(&run).into_iter().filter(|name| name != MESSAGES);
    let kept: Vec<_> = names
        .map(|name| (name.clone(), std::fs::read(run.join(name)).unwrap()))
        .collect();
    let last = places.len() - 2;
    let rest = ticks - EACH * last as u64;
    let block = |number: usize| &file[places[number]..places[number + 1]];
    let of = |blocks: &[usize]| {
        let blocks = blocks.iter().map(|number| block(*number));
        let parts = std::iter::once(&file[..places[0]]).chain(blocks);
        let end = [&file[places[last + 1]..]];
        parts.chain(end).collect::<Vec<_>>().concat()
    };
    let all: Vec<usize> = (0..=last).collect();
    let without = |number: usize| [&all[..number], &all[number + 1..]].concat();
    let mut theirs = file.clone();
    theirs.splice(places[1]..places[2], other[others[1]..others[2]].to_vec());
    let flipped = |at: usize| {
        let mut bytes = file.clone();
        bytes[at] ^= 0x80;
        bytes
    };
    let lost = |words: &str, tick: u64, n: u64| {
        format!("messages.mcap {words} at tick {tick}: its messages of {n} ticks are lost")
    };
    let harmless = |words: &str, tick: u64| {
        format!("messages.mcap {words} at tick {tick}: no message is lost")
    };
    // The last three of a run whose summary tells what there was.
    for (bytes, clause, is_known) in [
        (of(&without(2)), lost("lacks blocks", 100, EACH), true),
        (
            of(&[&all[..2], &all[1..]].concat()),
            harmless("holds blocks twice", 50),
            true,
        ),
        (
            of(&[&[0, 2, 1], &all[3..]].concat()),
            harmless("holds blocks out of their order", 100),
            true,
        ),
        (theirs, lost("holds blocks of another run", 50, EACH), true),
        (
            flipped((places[3] + places[4]) / 2),
            lost("is damaged", 150, EACH),
            true,
        ),
        (
            file[..places[last]].to_vec(),
            lost("lacks blocks", ticks - rest, rest),
            false,
        ),
        (
            other,
            format!(
                "messages.mcap is the log of another run: its messages of {ticks} ticks are lost"
            ),
            false,
        ),
        (
            Vec::new(),
            format!("messages.mcap is missing or empty: its messages of {ticks} ticks are lost"),
            false,
        ),
    ] {
        let put_back = || {
            for (name, bytes) in &kept {
                std::fs::write(run.join(name), bytes).unwrap();
            }
            std::fs::write(run.join(MESSAGES), &bytes).unwrap();
        };
        put_back();
        for process in ["estimator", "controller"] {
            let said = desk.armplane(&format!("replay r --process {process}"));
            let words = said.out.clone() + &said.err;
            assert!(
                said.code == 1 && words.contains(&clause),
                "{clause}: {words}"
            );
        }
        // Where the whole log is none of the run, its columns are left out, and the reason is the reader's.
        let said = desk.armplane("export r --out e");
        let is_none = !clause.contains(" at tick ");
        let expected = if is_none { MESSAGES } else { &*clause };
        assert!(
            said.code == 1 && said.err.contains(expected),
            "{clause}: {}",
            said.err
        );
        let said = desk.armplane("report r");
        assert!(
            said.code == 1 && said.err.contains(&clause),
            "{clause}: {}",
            said.err
        );
        let page = std::fs::read_to_string(run.join("report.html")).unwrap();
        assert!(page.contains(&clause), "the page says it, too: {clause}");
        if is_known {
            as_of_a_killed_launcher(&run);
            let said = desk.armplane("recover r --json");
            let error = &said.json()["recorder"]["error"];
            assert_eq!((said.code, error), (1, &Value::from(&*clause)));
        }
    }
    for (name, bytes) in &kept {
        std::fs::write(run.join(name), bytes).unwrap();
    }
    std::fs::write(run.join(MESSAGES), &file).unwrap();
    as_of_a_killed_launcher(&run);
    let said = desk.succeeds("recover r --json");
    assert_eq!(said.json()["topics"], whole["topics"]);
}

#[test]
fn a_link_in_the_place_of_a_log_is_refused_with_a_remedy_that_recover_has() {
    let (desk, run, _) = with_run();
    as_of_a_killed_launcher(&run);
    let (log, elsewhere) = (run.join(MESSAGES), desk.file("elsewhere", "mine"));
    std::fs::remove_file(&log).unwrap();
    std::os::unix::fs::symlink(&elsewhere, &log).unwrap();
    let said = desk.armplane("recover r");
    assert!(
        said.code == 2 && said.err.contains(MESSAGES) && said.err.contains("recover the run again"),
        "{}",
        said.err
    );
    assert!(!said.err.contains("--out"), "{}", said.err);
    assert_eq!(std::fs::read_to_string(elsewhere).unwrap(), "mine");
}

#[test]
fn a_folder_that_is_used_again_holds_nothing_of_its_former_run() {
    let desk = Desk::new();
    let run = desk.path().join("r");
    desk.file("short.toml", SHORT);
    desk.file(
        "targets.csv",
        "# armplane targets 1, length mm\n0, twist, base, 0.3, 100 0 0 0 0 0.2\n0.3, end\n",
    );
    let said = desk.armplane("servo puma560 --from targets.csv --out r --json");
    assert!(
        said.code == 0 && run.join("targets.csv").exists() && run.join(MESSAGES).exists(),
        "{}",
        said.err
    );
    desk.succeeds("report r");
    for format in ["csv", "parquet", "rrd", "rbl"] {
        desk.succeeds(&format!("export r --format {format}"));
    }
    desk.file("r/notes.html", "mine");
    desk.run("short.toml --out r");
    desk.run("short.toml --out fresh");
    std::fs::remove_file(run.join("notes.html")).unwrap();
    assert_eq!(names(&run), names(&desk.path().join("fresh")));
    desk.run("short.toml --out r --no-messages");
    assert!(!run.join(MESSAGES).exists());
    // A run from its own folder reads its files before they are replaced.
    let first = desk
        .armplane("servo puma560 --from targets.csv --out s --json")
        .json();
    let again = desk.run("s/scenario.toml --out s");
    assert_eq!(first["topics"], again["topics"]);
    // Files with the names of results, in a folder of which no run has been, are not the program's.
    std::fs::create_dir(desk.path().join("mine")).unwrap();
    desk.file("mine/targets.csv", "mine");
    desk.run("short.toml --out mine");
    assert_eq!(
        std::fs::read_to_string(desk.path().join("mine/targets.csv")).unwrap(),
        "mine"
    );
}

#[test]
fn a_recording_that_a_full_volume_ends_is_in_the_exit_code() {
    let desk = Desk::new();
    desk.file(
        "short.toml",
        &(SHORT.to_owned()
            + "[[fault]]\nprocess = \"recorder\"\nkind = \"disk-full\"\nat_tick = 300\n"),
    );
    let said = desk.armplane("run short.toml --out r --json");
    let summary = said.json();
    assert_eq!(summary["outcome"], "goal reached");
    assert!(
        said.code == 1
            && said.err.contains("the results are not whole")
            && said.err.contains("the recording ends early")
            && said.err.contains(&format!(
                "has {} bytes",
                std::fs::metadata(desk.path().join("r/run.rrd"))
                    .unwrap()
                    .len()
            )),
        "{}",
        said.err
    );
    assert_nothing_left(said.launcher);
}

#[test]
fn a_run_without_its_job_or_its_summary_is_told_with_a_remedy_that_helps() {
    let (desk, run, _) = with_run();
    let kept = ["job.json", "summary.json", "scenario.toml"]
        .map(|name| (run.join(name), std::fs::read(run.join(name)).unwrap()));
    let restore = || {
        for (path, bytes) in &kept {
            let _ = std::fs::remove_file(path).or_else(|_| std::fs::remove_dir(path));
            std::fs::write(path, bytes).unwrap();
        }
    };
    let said = |command: &str, codes: &[i32], defect: &str, remedy: &str| {
        let said = desk.armplane(&[command, "r"]);
        let sentence = said.err.lines().last().unwrap_or_default();
        assert!(
            codes.contains(&said.code),
            "{command}: {}: {}",
            said.code,
            said.err
        );
        assert!(
            sentence.contains(defect) && sentence.ends_with(remedy),
            "{command}: {sentence}\n{defect}\n{remedy}"
        );
    };
    let again = "; `armplane run r/scenario.toml` makes the run again";
    std::fs::remove_file(run.join("job.json")).unwrap();
    ["report", "export", "replay"]
        .iter()
        .for_each(|command| said(command, &[1, 2], "r has no job.json", again));
    restore();
    make_pipe(&run.join("job.json"));
    let defect = "r/job.json: it is a named pipe, not a regular file";
    ["report", "export", "replay"]
        .iter()
        .for_each(|command| said(command, &[1, 2], defect, again));
    // A killed launcher leaves this: no scenario, and no summary.
    std::fs::remove_file(run.join("summary.json")).unwrap();
    std::fs::remove_file(run.join("scenario.toml")).unwrap();
    said("recover", &[2], defect, "; run its scenario again");
    restore();
    std::fs::remove_file(run.join("summary.json")).unwrap();
    said(
        "report",
        &[2],
        "r has no summary.json",
        "`armplane recover r` makes it from its messages",
    );
    restore();
    make_pipe(&run.join("summary.json"));
    said(
        "report",
        &[2],
        "it is a named pipe",
        "remove r/summary.json, and `armplane recover r` makes it from its messages",
    );
    desk.refuses(2, "recover r", &["remove it, and recover the run again"]);
    std::fs::remove_file(run.join("summary.json")).unwrap();
    desk.succeeds("recover r");
    std::fs::create_dir(desk.path().join("none")).unwrap();
    desk.refuses(
        2,
        "replay none",
        &["none is not the folder of a run (it has no job.json): give the folder"],
    );
}
