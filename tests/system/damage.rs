//! Results that are not whole: each command that reads or makes them says so, and its exit code does.

use std::path::Path;

use serde_json::Value;

use crate::command::{Desk, assert_nothing_left};

/// A short motion.
const SHORT: &str = "name = \"short\"\nrobot = \"puma560\"\nsettle_s = 0.3\n[start]\nq_deg = [20, -60, 170, 0, 30, 0]\n\
                     [[segment]]\nby_m = [0.01, 0.0, 0.0]\nduration_s = 0.5\n";

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

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

#[test]
fn recover_keeps_a_recording_that_holds_more_than_the_messages() {
    let desk = Desk::new();
    desk.file("short.toml", SHORT);
    let rows = desk.run(&["short.toml", "--out", "r"])["recorder"]["rows"]
        .as_u64()
        .unwrap();
    let (run, rr) = (desk.path().join("r"), |name: &str| {
        std::fs::read(desk.path().join("r").join(name)).unwrap()
    });
    let (recording, log) = (rr("run.rrd"), rr("messages/torque.log"));
    // The second time after a recovery that has moved it already.
    for _ in 0..2 {
        std::fs::remove_file(run.join("summary.json")).unwrap();
        let _ = std::fs::remove_file(run.join("messages/torque.log"));
        let said = desk.armplane(&["recover", "r"]);
        assert!(
            said.code == 1
                && said
                    .err
                    .contains(&format!("has {rows} rows, and stays in earlier/")),
            "{}{}",
            said.out,
            said.err
        );
        assert!(rr("earlier/run.rrd") == recording);
    }
    // Where the messages hold as much, it is made anew, and the other goes.
    std::fs::remove_file(run.join("summary.json")).unwrap();
    std::fs::write(run.join("messages/torque.log"), log).unwrap();
    let said = desk.armplane(&["recover", "r", "--json"]);
    assert_eq!(
        (said.code, json(&said.out)["recorder"]["rows"].as_u64()),
        (0, Some(rows)),
        "{}",
        said.err
    );
    assert!(!run.join("earlier").exists());
}

#[test]
fn messages_in_the_memory_of_a_killed_recorder_are_said_and_are_no_defect() {
    let desk = Desk::new();
    desk.file("short.toml", SHORT);
    let rows = desk.run(&["short.toml", "--out", "r"])["recorder"]["rows"]
        .as_u64()
        .unwrap();
    let run = desk.path().join("r");
    std::fs::remove_file(run.join("summary.json")).unwrap();
    // The last block of each log, where the recording has its rows.
    for log in names(&run.join("messages")) {
        let log = std::fs::OpenOptions::new()
            .write(true)
            .open(run.join("messages").join(log))
            .unwrap();
        log.set_len(log.metadata().unwrap().len() - 200).unwrap();
    }
    let said = desk.armplane(&["recover", "r", "--json"]);
    let summary = json(&said.out);
    let (ticks, reason) = (
        summary["ticks"].as_u64().unwrap(),
        summary["reason"].as_str().unwrap(),
    );
    assert_eq!(
        (said.code, &summary["recorder"]["error"]),
        (0, &"".into()),
        "{}",
        said.err
    );
    assert!(ticks < rows && ticks % 128 == 0, "{ticks} of {rows}");
    assert!(
        reason.ends_with(&format!("has {rows} rows, and stays in earlier/")),
        "{reason}"
    );
    assert!(run.join("earlier/run.rrd").exists());
}

#[test]
fn a_recording_with_one_other_bit_or_of_another_run_is_not_taken_for_the_runs() {
    let desk = Desk::new();
    desk.file("short.toml", SHORT);
    for (run, seed) in [("r", "1"), ("other", "2")] {
        desk.run(&["short.toml", "--seed", seed, "--out", run]);
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
        for command in [
            &["report", "r"][..],
            &["export", "r", "--format", "csv", "--out", "csv"],
        ] {
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
    for command in [
        &["report", "r"][..],
        &["export", "r", "--format", "csv", "--out", "csv"],
    ] {
        let said = desk.armplane(command);
        assert!(
            said.code == 1 && said.err.contains("run-001.rrd is no file of this run"),
            "{command:?}: {}",
            said.err
        );
    }
    std::fs::remove_file(further).unwrap();
    for command in [
        &["report", "r"][..],
        &["export", "r", "--format", "csv", "--out", "csv"],
    ] {
        let said = desk.armplane(command);
        assert_eq!(said.code, 0, "{command:?}: {}", said.err);
    }
}

#[test]
fn recover_says_which_log_is_damaged_and_what_that_costs() {
    let desk = Desk::new();
    desk.file("short.toml", SHORT);
    let whole = desk.run(&["short.toml", "--out", "r"]);
    let run = desk.path().join("r");
    as_of_a_killed_launcher(&run);
    let said = desk.armplane(&["recover", "r", "--json"]);
    let again = json(&said.out);
    assert_eq!(
        (said.code, &again["topics"], &again["ticks"]),
        (0, &whole["topics"], &whole["ticks"]),
        "{}",
        said.err
    );

    let log = run.join("messages/sensor.log");
    let written = std::fs::read(&log).unwrap();
    let mut damaged = written.clone();
    damaged[written.len() / 2] ^= 4;
    std::fs::write(&log, &damaged).unwrap();
    as_of_a_killed_launcher(&run);
    let said = desk.armplane(&["recover", "r", "--json"]);
    let again = json(&said.out);
    let sentence = again["recorder"]["error"].as_str().unwrap();
    assert!(
        sentence.starts_with("sensor.log is damaged at tick ")
            && sentence.ends_with("its messages of 128 ticks are lost"),
        "{sentence}"
    );
    assert!(
        said.code == 1
            && said
                .err
                .contains(&format!("the results are not whole: {sentence}")),
        "{}",
        said.err
    );
    assert_eq!(
        again["topics"]["sensor"]["count"].as_u64().unwrap() + 128,
        whole["topics"]["sensor"]["count"].as_u64().unwrap()
    );
    assert_eq!(
        again["topics"]["torque"], whole["topics"]["torque"],
        "the other logs are whole"
    );
    for command in [
        &["export", "r"][..],
        &["report", "r"],
        &["replay", "r", "--process", "estimator"],
    ] {
        let said = desk.armplane(command);
        assert!(
            said.code == 1 && (said.err.clone() + &said.out).contains("sensor.log is damaged"),
            "{command:?}: {}{}",
            said.out,
            said.err
        );
    }

    // The first bytes of a log, and all of it.
    for (bytes, words) in [
        (
            &b"other bytes than those of a log"[..],
            "torque.log is damaged at tick 0",
        ),
        (b"", "torque.log is missing or empty: its messages of "),
    ] {
        std::fs::write(&log, &written).unwrap();
        std::fs::write(run.join("messages/torque.log"), bytes).unwrap();
        as_of_a_killed_launcher(&run);
        let said = desk.armplane(&["recover", "r"]);
        assert!(
            said.code == 1 && said.err.contains(words) && said.err.lines().count() == 1,
            "{}{}",
            said.out,
            said.err
        );
    }
}

/// The head of a message log, and its blocks.
fn blocks(log: &Path) -> (Vec<u8>, Vec<Vec<u8>>) {
    let file = std::fs::read(log).unwrap();
    let (head, mut rest) = file.split_at(40);
    let mut blocks = Vec::new();
    while rest.len() >= 48 {
        let number = |at: usize| u32::from_le_bytes(rest[at..at + 4].try_into().unwrap()) as usize;
        // Bytes behind the head; and in the upper half of a word how many logs the run has.
        let (block, behind) = rest.split_at(48 + 8 * (number(24) >> 16) + number(4));
        blocks.push(block.to_vec());
        rest = behind;
    }
    assert!(
        rest.is_empty() && blocks.len() > 6,
        "{} blocks",
        blocks.len()
    );
    (head.to_vec(), blocks)
}

#[test]
fn blocks_that_are_missing_repeated_exchanged_or_of_another_run_are_named_by_each_command() {
    let desk = Desk::new();
    desk.file("short.toml", SHORT);
    let whole = desk.run(&["short.toml", "--out", "r"]);
    desk.run(&["short.toml", "--out", "other"]);
    let (run, ticks) = (desk.path().join("r"), whole["ticks"].as_u64().unwrap());
    let kept: Vec<(String, Vec<u8>)> = names(&run)
        .into_iter()
        .filter(|name| name != "messages")
        .map(|name| (name.clone(), std::fs::read(run.join(name)).unwrap()))
        .collect();
    let log = run.join("messages/sensor.log");
    let file = std::fs::read(&log).unwrap();
    let ((head, ours), (other_head, theirs)) = (
        blocks(&log),
        blocks(&desk.path().join("other/messages/sensor.log")),
    );
    let torque = std::fs::read(run.join("messages/torque.log")).unwrap();
    let of = |blocks: &[&[Vec<u8>]]| [head.clone(), blocks.concat().concat()].concat();
    let last = ours.len() - 2;
    let rest = ticks - 128 * last as u64;
    for (bytes, clause) in [
        (of(&[&ours[..2], &ours[3..]]), "sensor.log lacks blocks at tick 256: its messages of 128 ticks are lost".to_owned()),
        (of(&[&ours[..last]]), format!("sensor.log lacks blocks at tick {}: its messages of {rest} ticks are lost", ticks - rest)),
        (of(&[]), format!("sensor.log lacks blocks at tick 0: its messages of {ticks} ticks are lost")),
        (of(&[&ours[..2], &ours[1..]]), "sensor.log holds blocks twice at tick 128: no message is lost".to_owned()),
        (
            of(&[&ours[..1], &ours[2..3], &ours[1..2], &ours[3..]]),
            "sensor.log holds blocks out of their order at tick 128: no message is lost".to_owned(),
        ),
        (
            of(&[&ours[..1], &theirs[1..2], &ours[2..]]),
            "sensor.log holds blocks of another run at tick 128: its messages of 128 ticks are lost".to_owned(),
        ),
        ([other_head, theirs.concat()].concat(), format!("sensor.log is the log of another run: its messages of {ticks} ticks are lost")),
        (torque, format!("sensor.log is another log of its run, renamed: its messages of {ticks} ticks are lost")),
        (Vec::new(), format!("sensor.log is missing or empty: its messages of {ticks} ticks are lost")),
        // A bit of the head of the last block, which is not taken for one that its writer was killed in.
        (
            {
                let mut flipped = file.clone();
                let end = ours[last + 1].len() + ours[last].len();
                let place = flipped.len() - end + 4;
                flipped[place] ^= 0x80;
                flipped
            },
            format!("sensor.log is damaged at tick {}: its messages of {rest} ticks are lost", ticks - rest),
        ),
    ] {
        kept.iter().for_each(|(name, bytes)| std::fs::write(run.join(name), bytes).unwrap());
        std::fs::write(&log, &bytes).unwrap();
        for process in ["estimator", "controller"] {
            let said = desk.armplane(&["replay", "r", "--process", process]);
            let words = said.out.clone() + &said.err;
            assert!(said.code == 1 && words.contains(&clause), "{clause}: {process}: {}: {words}", said.code);
        }
        let said = desk.armplane(&["export", "r", "--out", "e"]);
        // Where the whole log is none of the run, its columns are left out, and the reason is the reader's.
        let is_whole_log = clause.contains("is the log of another") || clause.contains("renamed") || clause.contains("missing or empty");
        let expected = if is_whole_log { "messages/sensor.log" } else { &*clause };
        assert!(said.code == 1 && said.err.contains(expected), "{clause}: {}: {}", said.code, said.err);
        let said = desk.armplane(&["report", "r"]);
        assert!(said.code == 1 && said.err.contains(&clause) && said.err.lines().count() == 1, "{clause}: {}: {}", said.code, said.err);
        let page = std::fs::read_to_string(run.join("report.html")).unwrap();
        assert!(page.contains(&format!("<p class=\"bad\">{clause}")), "the page says it, too: {clause}");
        as_of_a_killed_launcher(&run);
        let said = desk.armplane(&["replay", "r", "--process", "estimator"]);
        assert!(said.code == 1 && (said.out + &said.err).contains(&clause), "{clause}: of a killed launcher");
        let said = desk.armplane(&["recover", "r", "--json"]);
        assert_eq!((said.code, json(&said.out)["recorder"]["error"].as_str()), (1, Some(&*clause)), "{}", said.err);
    }
    std::fs::write(&log, &file).unwrap();
    as_of_a_killed_launcher(&run);
    let said = desk.armplane(&["recover", "r", "--json"]);
    let again = json(&said.out);
    assert_eq!(
        (said.code, &again["topics"]),
        (0, &whole["topics"]),
        "{}",
        said.err
    );
    // Of a run whose logs are gone: not what a run without them gives as its reason.
    std::fs::remove_dir_all(run.join("messages")).unwrap();
    let said = desk.armplane(&["replay", "r"]);
    assert!(
        said.code == 1
            && said.err.contains("holds 0 of")
            && said.err.contains("makes the run again"),
        "{}",
        said.err
    );
    assert!(
        !said.err.contains("--no-messages") && said.err.lines().count() == 1,
        "{}",
        said.err
    );
}

#[test]
fn a_link_in_the_place_of_a_log_is_refused_with_a_remedy_that_recover_has() {
    let desk = Desk::new();
    desk.file("short.toml", SHORT);
    desk.run(&["short.toml", "--out", "r"]);
    let run = desk.path().join("r");
    as_of_a_killed_launcher(&run);
    let (log, elsewhere) = (
        run.join("messages/sensor.log"),
        desk.file("elsewhere", "mine"),
    );
    std::fs::remove_file(&log).unwrap();
    std::os::unix::fs::symlink(&elsewhere, &log).unwrap();
    let said = desk.armplane(&["recover", "r"]);
    assert!(
        said.code == 2
            && said.err.contains("sensor.log")
            && said.err.contains("recover the run again"),
        "{}",
        said.err
    );
    assert!(!said.err.contains("--out"), "{}", said.err);
    assert_eq!(std::fs::read_to_string(elsewhere).unwrap(), "mine");
}

#[test]
fn a_folder_that_is_used_again_holds_nothing_of_its_former_run() {
    let desk = Desk::new();
    desk.file("short.toml", SHORT);
    desk.file(
        "targets.csv",
        "# armplane targets 1, length mm\n0, twist, base, 0.3, 100 0 0 0 0 0.2\n0.3, end\n",
    );
    let said = desk.armplane(&[
        "servo",
        "puma560",
        "--from",
        "targets.csv",
        "--out",
        "r",
        "--json",
    ]);
    let run = desk.path().join("r");
    assert!(
        said.code == 0
            && run.join("targets.csv").exists()
            && run.join("messages/target.log").exists(),
        "{}",
        said.err
    );
    desk.run(&["short.toml", "--out", "r"]);
    desk.run(&["short.toml", "--out", "fresh"]);
    for folder in ["", "messages"] {
        assert_eq!(
            names(&run.join(folder)),
            names(&desk.path().join("fresh").join(folder)),
            "{folder}"
        );
    }
    desk.run(&["short.toml", "--out", "r", "--no-messages"]);
    assert!(
        !run.join("messages").exists(),
        "{:?}",
        names(&run.join("messages"))
    );
    // A run from its own folder reads its files before they are replaced.
    let first = json(
        &desk
            .armplane(&[
                "servo",
                "puma560",
                "--from",
                "targets.csv",
                "--out",
                "s",
                "--json",
            ])
            .out,
    );
    let again = desk.run(&["s/scenario.toml", "--out", "s"]);
    assert_eq!(first["topics"], again["topics"]);
    // Files with the names of results, in a folder of which no run has been, are not the program's.
    std::fs::create_dir(desk.path().join("mine")).unwrap();
    desk.file("mine/targets.csv", "mine");
    desk.run(&["short.toml", "--out", "mine"]);
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
    let said = desk.armplane(&["run", "short.toml", "--out", "r", "--json"]);
    let summary = json(&said.out);
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
    let desk = Desk::new();
    desk.file("short.toml", SHORT);
    desk.run(&["short.toml", "--out", "r"]);
    let run = desk.path().join("r");
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
    let pipe = |name: &str| {
        std::fs::remove_file(run.join(name)).unwrap();
        assert!(
            std::process::Command::new("mkfifo")
                .arg(run.join(name))
                .status()
                .unwrap()
                .success()
        );
    };
    std::fs::remove_file(run.join("job.json")).unwrap();
    ["report", "export", "replay"]
        .iter()
        .for_each(|command| said(command, &[1, 2], "r has no job.json", again));
    restore();
    pipe("job.json");
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
    pipe("summary.json");
    said(
        "report",
        &[2],
        "it is a named pipe",
        "remove r/summary.json, and `armplane recover r` makes it from its messages",
    );
    let refused = desk.armplane(&["recover", "r"]);
    assert!(
        refused.code == 2 && refused.err.contains("remove it, and recover the run again"),
        "{}",
        refused.err
    );
    std::fs::remove_file(run.join("summary.json")).unwrap();
    assert_eq!(desk.armplane(&["recover", "r"]).code, 0);
    std::fs::create_dir(desk.path().join("none")).unwrap();
    let said = desk.armplane(&["replay", "none"]);
    assert!(
        said.code == 2
            && said
                .err
                .contains("none is not the folder of a run (it has no job.json): give the folder"),
        "{}",
        said.err
    );
}
