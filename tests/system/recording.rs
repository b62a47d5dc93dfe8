//! Uses of a recording: viewing, live viewing, report, export. A script stands in for the viewer.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::command::{Args, Desk, Known, Said, assert_nothing_left, finish, skipped};

impl Desk {
    /// `armplane` with another viewer.
    fn with_viewer(&self, viewer: &Path, args: impl Args) -> Said {
        let mut command = self.command(args);
        command.env("ARMPLANE_RERUN", viewer);
        finish(command.spawn().expect("armplane starts"))
    }

    /// A script to be called as the viewer.
    fn viewer(&self, name: &str, text: &str) -> PathBuf {
        let path = self.file(name, &format!("#!/bin/sh\n{text}\n"));
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).expect("a mode");
        path
    }
}

const SHORT: &str = "--set segment.0.duration_s=1 --set segment.1.duration_s=1.5";

#[test]
fn without_a_viewer_one_sentence_says_how_to_get_one() {
    let desk = Desk::new();
    desk.run(&format!("{SHORT} --out results"));
    let said = desk.with_viewer(Path::new("/there/is/no/viewer"), "view results");
    assert_eq!(
        (said.code, said.err.lines().count()),
        (1, 1),
        "{}",
        said.err
    );
    assert!(
        said.err.contains("pip install rerun-sdk==0.36.3")
            && said.err.contains("/there/is/no/viewer"),
        "{}",
        said.err
    );
    let live = desk.with_viewer(Path::new("/there/is/no/viewer"), "run --live --out live");
    assert!(
        live.code == 1 && live.err.contains("pip install"),
        "{}",
        live.err
    );
    assert!(!desk.path().join("live").exists(), "nothing was started");
}

/// Only with the viewer proper, its software driver and Pillow: a picture is taken of it.
#[test]
fn the_real_viewer_shows_the_layout_that_was_asked_for() {
    let viewer = std::env::var_os("ARMPLANE_RERUN").unwrap_or_else(|| "rerun".into());
    let answers = |command: &mut Command| {
        command
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
            .is_ok_and(|status| status.success())
    };
    if !answers(Command::new(viewer).arg("--version")) {
        return skipped("there is no Rerun viewer");
    }
    if !Path::new("/usr/share/vulkan/icd.d/lvp_icd.x86_64.json").exists()
        || !answers(Command::new("python3").args(["-c", "import PIL"]))
    {
        return skipped(
            "there is no software Vulkan driver, or no Pillow, to take a picture of the viewer with",
        );
    }
    let desk = Desk::new();
    desk.run(&format!("{SHORT} --out results"));
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/pictures/shown.py");
    // The share of the upper left pane that is the ground of a view of the arm.
    let shown = |layout: &str| {
        let mut command = Command::new("python3");
        command
            .arg(&script)
            .arg("shown.png")
            .arg(env!("CARGO_BIN_EXE_armplane"))
            .args(["view", "results"])
            .args(layout.words());
        let said = command
            .current_dir(desk.path())
            .output()
            .expect("python3 starts");
        let text = String::from_utf8_lossy(&said.stdout);
        text.trim().parse::<f64>().unwrap_or_else(|error| {
            panic!("{error}: {text}{}", String::from_utf8_lossy(&said.stderr))
        })
    };
    let (control, timing) = (shown(""), shown("--layout timing"));
    assert!(
        control > 0.5,
        "the arm is in the upper left of the layout `control`: {control}"
    );
    assert!(
        timing < 0.1,
        "latencies are in the upper left of the layout `timing`: {timing}"
    );
}

#[test]
fn view_opens_the_latest_run_and_another_layout() {
    let desk = Desk::new();
    let viewer = desk.viewer("viewer.sh", "echo \"$@\" > seen");
    desk.run(SHORT);
    desk.run(&format!("{SHORT} --set record.part_s=1.2"));
    assert_eq!(desk.with_viewer(&viewer, "view").code, 0);
    let seen = desk.read("seen");
    let folder = "runs/fig5-wrist-rotation-002";
    let parts = ["run.rrd", "run-001.rrd", "run-002.rrd"].map(|name| format!("{folder}/{name}"));
    assert_eq!(seen.trim(), format!("{} --bind 127.0.0.1", parts.join(" ")));
    assert_eq!(
        desk.with_viewer(&viewer, "view fig5-wrist-rotation-001 --layout timing")
            .code,
        0
    );
    let layout = std::fs::read(desk.path().join("runs/fig5-wrist-rotation-001/timing.rbl"))
        .expect("the layout");
    assert_eq!(&layout[..4], b"RRF2", "a Rerun blueprint");
    // The viewer shows the layout it reads last: it gets the recording first, in one stream.
    let reading = desk.viewer(
        "reading.sh",
        "echo \"$@\" > seen; [ \"$1\" = - ] && cat > got; true",
    );
    assert_eq!(
        desk.with_viewer(&reading, "view fig5-wrist-rotation-001 --layout timing")
            .code,
        0
    );
    assert_eq!(desk.read("seen").trim(), "- --bind 127.0.0.1");
    let recording = std::fs::read(desk.path().join("runs/fig5-wrist-rotation-001/run.rrd"))
        .expect("the recording");
    let layout = std::fs::read(desk.path().join("runs/fig5-wrist-rotation-001/timing.rbl"))
        .expect("the layout");
    let got = std::fs::read(desk.path().join("got")).expect("what the viewer has read");
    assert!(
        got.len() == recording.len() + layout.len()
            && got.starts_with(&recording)
            && got.ends_with(&layout)
    );
    std::fs::copy(
        desk.path().join(folder).join("run.rrd"),
        desk.path().join("mine.rrd"),
    )
    .expect("a copy");
    assert_eq!(desk.with_viewer(&viewer, "view mine.rrd").code, 0);
    assert_eq!(desk.read("seen").trim(), "mine.rrd --bind 127.0.0.1");
    let old = desk.viewer("old.sh", "[ \"$1\" = --version ] && echo rerun-cli 0.20.1");
    let said = desk.with_viewer(&old, "view");
    assert!(
        said.err.contains("is 0.20") && said.err.contains("pip install rerun-sdk==0.36.3"),
        "{}",
        said.err
    );
    let failing = desk.viewer("failing.sh", "exit 3");
    let said = desk.with_viewer(&failing, "view");
    assert!(
        said.code == 1 && said.err.contains("failing.sh"),
        "{}",
        said.err
    );
}

#[test]
fn live_passes_on_every_byte_of_every_part() {
    let desk = Desk::new();
    let viewer = desk.viewer(
        "viewer.sh",
        "[ \"$1\" = - ] && cat > got.draft && mv got.draft got",
    );
    let said = desk.with_viewer(
        &viewer,
        &format!("run --live --out results --set record.part_s=1.2 {SHORT}"),
    );
    // On a busy machine it gets the rest after the command has ended.
    assert!(
        said.code == 0 && said.err.lines().count() <= 1,
        "{}",
        said.err
    );
    assert_nothing_left(said.launcher);
    crate::command::until("the viewer to have everything", || {
        desk.path().join("got").exists()
    });
    let parts = ["run.rrd", "run-001.rrd", "run-002.rrd"]
        .map(|name| std::fs::read(desk.path().join("results").join(name)).expect("a part"));
    assert!(
        std::fs::read(desk.path().join("got")).expect("bytes") == parts.concat(),
        "what was shown is what is kept"
    );
}

#[test]
fn no_process_waits_for_a_viewer_that_is_closed_or_stuck() {
    let desk = Desk::new();
    let began = Instant::now();
    let plain = desk.run(SHORT);
    let alone = began.elapsed();
    for (name, text, expected) in [
        ("closed.sh", "exit 0", "closed"),
        (
            "stuck.sh",
            "[ \"$1\" = --version ] || echo $$ > pid; exec sleep 600",
            "has not read everything",
        ),
    ] {
        let viewer = desk.viewer(name, text);
        let began = Instant::now();
        let said = desk.with_viewer(
            &viewer,
            &format!(
                "run --live --json --out {} {SHORT}",
                name.trim_end_matches(".sh")
            ),
        );
        let shown = began.elapsed();
        assert!(
            shown < 2 * alone + Duration::from_millis(1500),
            "{name}: {shown:?} in place of {alone:?}"
        );
        assert!(
            said.code == 0
                && said.err.contains(expected)
                && said.err.contains("the recording is complete"),
            "{name}: {}",
            said.err
        );
        let summary = said.json();
        assert_eq!(
            summary["topics"], plain["topics"],
            "the same run, to the byte"
        );
    }
    let pid = desk.read("pid");
    Command::new("kill").arg(pid.trim()).status().expect("kill");
}

#[test]
fn csv_has_a_row_for_every_tick_of_every_part() {
    let desk = Desk::new();
    let summary = desk.run(&format!("{SHORT} --set record.part_s=1.2 --out results"));
    assert_eq!(summary["recorder"]["parts"], 3);
    desk.succeeds("export results --out tables --json");
    let table = desk.read("tables/signals.csv");
    let mut lines = table.lines();
    let names: Vec<&str> = lines.next().expect("headings").split(',').collect();
    let column = |name: &str| {
        names
            .iter()
            .position(|known| *known == name)
            .unwrap_or_else(|| panic!("no {name} in {names:?}"))
    };
    let (tick, s, q5) = (
        column("tick"),
        column("singularity.s.wrist"),
        column("joint.q.5"),
    );
    column("error.position_mm.orthogonal");
    column("latency.us.sensor_to_torque");
    column("hand.position.x");
    let rows: Vec<Vec<f64>> = lines
        .map(|line| {
            let fields: Vec<&str> = line.split(',').collect();
            assert_eq!(fields.len(), names.len());
            [tick, s, q5]
                .map(|column| fields[column].parse().expect("a number"))
                .to_vec()
        })
        .collect();
    assert_eq!(
        rows.len() as u64,
        summary["ticks"].count(),
        "nothing is lost in lockstep"
    );
    assert!(rows.iter().enumerate().all(|(k, row)| row[0] == k as f64));
    let end = rows.last().expect("rows");
    assert!(
        (end[1] - end[2].sin()).abs() < 1e-3,
        "the wrist's measure is sin q5: {end:?}"
    );
    let events = desk.read("tables/events.csv");
    assert!(
        events
            .lines()
            .any(|line| line.contains("state,mode/wrist,reorient")),
        "{events}"
    );
}

#[test]
fn a_report_stands_alone() {
    let desk = Desk::new();
    let summary = desk.run(&format!("{SHORT} --out results"));
    desk.succeeds("report results");
    let page = desk.read("results/report.html");
    assert!(
        page.matches("<svg").count() >= 4 && page.contains("<polyline"),
        "plots"
    );
    for foreign in [
        "<script ",
        "<link",
        "src=",
        "url(",
        "@import",
        "fetch(",
        "import(",
        "XMLHttpRequest",
        "<img",
        "<iframe",
    ] {
        assert!(!page.contains(foreign), "{foreign}");
    }
    assert!(
        page.contains("default-src 'none'") && page.len() < 5_000_000,
        "no network, and {} bytes",
        page.len()
    );
    let poses = page.matches("<figure class=\"pose\"").count();
    assert!(
        (3..=5).contains(&poses) && page.contains("<b>Locked</b>") && page.contains("<b>End</b>"),
        "{poses} poses"
    );
    assert!(
        page.find("class=\"poses\"").unwrap() < page.find("<h2>").unwrap(),
        "the page begins with the arm"
    );
    assert!(
        page.matches("class=\"cursor\"").count() >= 8 && page.contains("type=\"range\""),
        "a slider, and its line in every plot"
    );
    let hash = summary["topics"]["torque"]["hash"].text();
    for expected in [
        "goal reached",
        "wrist",
        "type 2",
        "reorient",
        hash,
        env!("CARGO_PKG_VERSION"),
        "Linux",
        "No fault, refusal or loss.",
    ] {
        assert!(page.contains(expected), "{expected} is not in the page");
    }
    desk.run(&format!("{SHORT} --out plain --no-record"));
    desk.succeeds("report plain --out plain.html");
    assert!(desk.read("plain.html").contains("There is no recording"));
}

#[test]
fn a_folder_that_is_no_run_is_named_in_one_sentence() {
    let desk = Desk::new();
    std::fs::create_dir(desk.path().join("empty")).expect("a folder");
    desk.run(&format!("{SHORT} --out plain --no-record"));
    for (args, expected) in [
        ("view", "there is no run under runs/"),
        ("report nowhere", "there is no run nowhere"),
        ("export empty", "not the folder of a run"),
        ("export plain", "without --no-record"),
        ("view plain", "without --no-record"),
        ("view plain --layout pretty", "control, timing and faults"),
    ] {
        desk.refuses(2, args, &[expected]);
    }
    std::fs::write(desk.path().join("plain/run.rrd"), "not a recording").expect("a file");
    desk.refuses(2, "export plain", &["is not a recording of armplane"]);
}

/// Of a recording that was cut what is left is exported, with a sentence about the rest.
#[test]
fn a_recording_that_lacks_something_is_said_to() {
    let desk = Desk::new();
    let ticks = desk.run(&format!("{SHORT} --out run"))["ticks"].count();
    let path = desk.path().join("run/run.rrd");
    let whole = std::fs::read(&path).expect("bytes");
    let cut = |bytes: usize| std::fs::write(&path, &whole[..bytes]).expect("room");
    for bytes in [0, 5_000, whole.len() / 2, whole.len() - 1] {
        cut(bytes);
        for format in ["csv", "parquet", "rrd"] {
            let out = format!("out-{bytes}-{format}");
            let said = desk.armplane(&format!("export run --format {format} --out {out}"));
            assert_eq!(said.err.lines().count(), 1, "{bytes}: {}", said.err);
            assert!(
                said.err
                    .contains("`armplane run run/scenario.toml` makes the run again"),
                "{bytes}: {}",
                said.err
            );
            let is_left = desk.path().join(&out).exists();
            assert_eq!(
                (said.code, is_left),
                if bytes > 5_000 { (1, true) } else { (2, false) },
                "{bytes} {format}: {}",
                said.err
            );
            if is_left && format == "csv" {
                let rows = desk.read(&format!("{out}/signals.csv")).lines().count() - 1;
                assert!(rows > 100 && (rows as u64) <= ticks, "{rows} of {ticks}");
                assert!(
                    said.err.contains(&format!("{rows} of {ticks} rows")),
                    "{}",
                    said.err
                );
            }
        }
        let said = desk.armplane("report run --out page.html");
        assert!(
            (1..=2).contains(&said.code) && said.err.contains("makes the run again"),
            "{bytes}: {}",
            said.err
        );
    }
    assert!(
        desk.read("page.html")
            .contains(" rows of the recording can be read"),
        "the page says it, too"
    );
    cut(whole.len());
    desk.succeeds("export run --out out");
    std::fs::remove_file(&path).expect("the file");
    let said = desk.armplane("view run");
    assert!(
        said.code == 2 && said.err.contains("0 of ") && !said.err.contains("--no-record"),
        "{}",
        said.err
    );
}

#[test]
fn ticks_without_an_answer_of_a_dead_process_are_rows_of_the_recording() {
    let desk = Desk::new();
    let fault = "fault=[{process=\"estimator\",kind=\"kill\",at_tick=500}]";
    let run = |fault: &str, out: &str| -> serde_json::Value {
        let said = desk.armplane(&format!("run --json {SHORT} --set {fault} --out {out}"));
        said.json()
    };
    let summary = run(fault, "run");
    let (ticks, rows) = (
        summary["ticks"].count(),
        summary["recorder"]["rows"].count(),
    );
    let count = |topic: &str| summary["topics"][topic]["count"].as_u64();
    assert_eq!(
        (rows, count("sensor"), count("estimate")),
        (ticks, Some(ticks), Some(ticks - 100)),
        "the estimator is away for 100 ticks"
    );
    let path = desk.path().join("run/run.rrd");
    let whole = std::fs::read(&path).expect("bytes");
    std::fs::write(&path, &whole[..whole.len() - 1]).expect("room");
    for command in ["export", "report"] {
        desk.refuses(1, &[command, "run"], &[&format!("{rows} of {rows} rows")]);
    }
    // A recorder that is killed counts on, and one whose volume is full.
    for (name, kind) in [("killed", "kill"), ("full", "disk-full")] {
        let more = fault.replace(
            ']',
            &format!(",{{process=\"recorder\",kind=\"{kind}\",at_tick=900}}]"),
        );
        let summary = run(&more, name);
        assert_eq!(
            summary["recorder"]["rows"].as_u64(),
            Some(rows),
            "{name}: {}",
            summary["recorder"]
        );
    }
}
