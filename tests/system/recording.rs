//! Uses of a recording: viewing, live viewing, report, export. A script stands in for the viewer.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::bench::assert_kinds;
use crate::command::{Desk, Known, Running, Said, has_python, root, skipped, until};

impl Desk {
    /// `armplane` with another viewer.
    fn with_viewer(&self, viewer: impl AsRef<Path>, args: &str) -> Said {
        let mut command = self.command(args);
        command.env("ARMPLANE_RERUN", viewer.as_ref());
        command.spawn().expect("armplane starts").finish()
    }

    /// A script to be called as the viewer.
    fn viewer(&self, name: &str, text: &str) -> PathBuf {
        let path = self.file(name, format!("#!/bin/sh\n{text}\n"));
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o755)).expect("a mode");
        path
    }

    /// A short run.
    fn short(&self, more: &str) -> Value {
        self.run(&format!("{SHORT} {more}"))
    }
}

const SHORT: &str = "--set segment.0.duration_s=1 --set segment.1.duration_s=1.5";

#[test]
fn without_a_viewer_one_sentence_says_how_to_get_one() {
    let desk = Desk::new();
    desk.short("--out results");
    for args in ["view results", "run --live --out live"] {
        let said = desk.with_viewer("/there/is/no/viewer", args);
        assert_eq!(
            (said.code, said.err.lines().count()),
            (1, 1),
            "{}",
            said.err
        );
        for words in ["rerun-sdk==0.36.3", "/there/is/no/viewer"] {
            assert!(said.err.contains(words), "{}", said.err);
        }
    }
    assert!(!desk.has("live"), "nothing was started");
}

/// Only with the viewer proper, its software driver and Pillow: a picture is taken of it.
#[test]
fn the_real_viewer_shows_the_layout_that_was_asked_for() {
    let viewer = std::env::var_os("ARMPLANE_RERUN").unwrap_or_else(|| "rerun".into());
    let version = Command::new(viewer).arg("--version").output();
    let driver = Path::new("/usr/share/vulkan/icd.d/lvp_icd.x86_64.json");
    if !version.is_ok_and(|said| said.status.success()) || !driver.exists() || !has_python("PIL") {
        return skipped(
            "there is no Rerun viewer, no software Vulkan driver, or no Pillow to take a picture with",
        );
    }
    let desk = Desk::new();
    desk.short("--out results");
    // The share of the upper left pane that is the ground of a view of the arm.
    let shown = |layout: &str| {
        let mut python = desk.program("python3");
        python
            .arg(root().join("docs/pictures/shown.py"))
            .arg("shown.png");
        python.args([env!("CARGO_BIN_EXE_armplane"), "view", "results"]);
        let said = python
            .args(layout.split_whitespace())
            .output()
            .expect("python3 starts");
        let text = String::from_utf8_lossy(&said.stdout);
        text.trim()
            .parse::<f64>()
            .unwrap_or_else(|error| panic!("{error}: {said:?}"))
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
    let viewer = desk.viewer(
        "viewer.sh",
        "echo \"$@\" > seen; [ \"$1\" = - ] && cat > got; true",
    );
    let seen = |args: &str| {
        assert_eq!(desk.with_viewer(&viewer, args).code, 0, "{args}");
        desk.read("seen").trim().to_owned()
    };
    desk.short("");
    desk.short("");
    let folder = "runs/fig5-wrist-rotation-002";
    let recording = format!("{folder}/run.rrd");
    assert_eq!(seen("view"), format!("{recording} --bind 127.0.0.1"));
    // It is made of the record: again where it is missing.
    let made = desk.bytes(&recording).len();
    desk.remove(&recording);
    assert_eq!(seen("view"), format!("{recording} --bind 127.0.0.1"));
    assert!(desk.bytes(&recording).len().abs_diff(made) < 5_000);
    // The viewer shows the layout it reads last: it gets the recording first, in one stream.
    assert_eq!(
        seen("view fig5-wrist-rotation-001 --layout timing"),
        "- --bind 127.0.0.1"
    );
    let files =
        ["run.rrd", "timing.rbl"].map(|name| format!("runs/fig5-wrist-rotation-001/{name}"));
    assert_kinds(&desk, &[&files[1]]);
    assert!(desk.bytes("got") == files.map(|file| desk.bytes(file)).concat());
    std::fs::copy(desk.at(&recording), desk.at("mine.rrd")).expect("a copy");
    assert_eq!(seen("view mine.rrd"), "mine.rrd --bind 127.0.0.1");
    let old = desk.viewer("old.sh", "[ \"$1\" = --version ] && echo rerun-cli 0.20.1");
    let failing = desk.viewer("failing.sh", "exit 3");
    for (viewer, words) in [
        (&old, ["0.20", "rerun-sdk==0.36.3"]),
        (&failing, ["failing.sh", ""]),
    ] {
        let said = desk.with_viewer(viewer, "view");
        let is_said = words.iter().all(|words| said.err.contains(words));
        assert!(
            is_said && (said.code == 1 || viewer == &old),
            "{}",
            said.err
        );
    }
}

/// Of a run that goes on `view` shows what its record holds, and leaves its folder alone.
#[test]
fn a_living_run_is_viewed_to_a_tick() {
    let desk = Desk::new();
    let viewer = desk.viewer("viewer.sh", "[ \"$1\" = --version ] || cp \"$1\" seen.rrd");
    let run = desk.start("run --set segment.1.duration_s=300 --mode realtime --out r");
    until("a second of the run", || run.ticks() > 1_000);
    let said = desk.with_viewer(&viewer, "view r");
    assert!(said.code == 0 && said.err.contains("tick "), "{}", said.err);
    assert!(desk.bytes("seen.rrd").len() > 100_000 && !desk.has("r/run.rrd"));
    run.interrupt();
    assert!(desk.has("r/run.rrd"));
}

#[test]
fn no_process_waits_for_a_viewer_that_is_closed_or_stuck() {
    let desk = Desk::new();
    let began = Instant::now();
    let plain = desk.short("");
    let alone = began.elapsed();
    let stuck = "[ \"$1\" = --version ] || echo $$ > pid; exec sleep 600";
    for text in ["exit 0", stuck] {
        let viewer = desk.viewer("viewer.sh", text);
        let began = Instant::now();
        let said = desk.with_viewer(&viewer, &format!("run --live --json --out live {SHORT}"));
        let shown = began.elapsed();
        assert!(
            shown < 2 * alone + Duration::from_millis(1500),
            "{text}: {shown:?} in place of {alone:?}"
        );
        assert_eq!(
            (said.code, said.err.lines().count()),
            (0, 1),
            "{}",
            said.err
        );
        assert_eq!(said.json()["topics"], plain["topics"], "{text}");
    }
    let pid = desk.read("pid");
    Command::new("kill").arg(pid.trim()).status().expect("kill");
}

#[test]
fn csv_has_a_row_for_every_tick() {
    let desk = Desk::new();
    let summary = desk.short("--out results");
    desk.succeeds("export results --out tables --json");
    let table = desk.read("tables/signals.csv");
    let mut rows = table
        .lines()
        .map(|line| line.split(',').collect::<Vec<_>>());
    let names = rows.next().expect("headings");
    let columns = [
        "tick",
        "singularity.s.wrist",
        "joint.q.5",
        "error.position_mm.orthogonal",
        "latency.us.sensor_to_torque",
        "hand.position.x",
    ];
    let columns = columns.map(|name| names.iter().position(|known| *known == name).expect(name));
    let (mut count, mut end) = (0, [0.0; 3]);
    for row in rows {
        assert_eq!(row.len(), names.len());
        end = [0, 1, 2].map(|i| row[columns[i]].parse::<f64>().expect("a number"));
        assert_eq!(end[0], f64::from(count));
        count += 1;
    }
    assert_eq!(count, summary["ticks"], "nothing is lost in lockstep");
    assert!(
        (end[1] - end[2].sin()).abs() < 1e-3,
        "the wrist's measure is sin q5: {end:?}"
    );
    let events = desk.read("tables/events.csv");
    assert!(events.contains("state,mode/wrist,reorient"), "{events}");
}

#[test]
fn a_report_stands_alone() {
    let desk = Desk::new();
    let summary = desk.short("--out results");
    desk.succeeds("report results");
    let page = desk.read("results/report.html");
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
    assert!(page.len() < 5_000_000, "{} bytes", page.len());
    // Plots, poses of the arm, a slider, and its line in every plot.
    for (part, least, most) in [
        ("<svg", 4, usize::MAX),
        ("<figure class=\"pose\"", 3, 5),
        ("class=\"cursor\"", 8, usize::MAX),
    ] {
        let count = page.matches(part).count();
        assert!((least..=most).contains(&count), "{count} of {part}");
    }
    assert!(
        page.find("class=\"poses\"").unwrap() < page.find("<h2>").unwrap(),
        "the page begins with the arm"
    );
    for expected in [
        "default-src 'none'",
        "class=\"line\"",
        "type=\"range\"",
        "<b>Locked</b>",
        "<b>End</b>",
        "goal reached",
        "wrist",
        "type 2",
        "reorient",
        summary["topics"]["torque"]["hash"].text(),
        env!("CARGO_PKG_VERSION"),
        "Linux",
    ] {
        assert!(page.contains(expected), "{expected} is not in the page");
    }
    desk.short("--out plain --no-record");
    desk.succeeds("report plain --out plain.html");
    assert!(!desk.read("plain.html").contains("class=\"line\""));
}

/// Of a record that was cut what is left is exported, with a sentence about the rest.
#[test]
fn a_record_that_lacks_something_is_said_to() {
    let desk = Desk::new();
    let ticks = desk.short("--out run")["ticks"].count();
    let whole = desk.bytes("run/messages.mcap");
    let again = "`armplane run run/scenario.toml`";
    for bytes in [0, whole.len() / 2, whole.len() - whole.len() / 4] {
        desk.file("run/messages.mcap", &whole[..bytes]);
        let code = if bytes > 0 { 1 } else { 2 };
        for format in ["csv", "parquet", "rrd"] {
            let out = format!("out-{bytes}-{format}");
            let args = format!("export run --format {format} --out {out}");
            let said = desk.refuses(code, &args, again);
            assert_eq!(said.err.lines().count(), 1, "{bytes}: {}", said.err);
            assert_eq!(desk.has(&out), code == 1, "{bytes} {format}");
            if code == 1 && format == "csv" {
                let rows = desk.read(format!("{out}/signals.csv")).lines().count() as u64 - 1;
                assert!(rows > 100 && rows < ticks, "{rows} of {ticks}");
            }
        }
        desk.refuses(1, "report run --out page.html", again);
    }
    assert!(desk.read("page.html").contains("messages.mcap"));
    desk.remove("run/run.rrd");
    desk.file("run/messages.mcap", b"");
    desk.refuses(2, "view run", again);
    desk.file("run/messages.mcap", &whole);
    desk.succeeds("export run --out out");
}

/// A table, a page and a recording stand in their places whole or not at all.
#[test]
fn an_export_that_is_cut_leaves_nothing() {
    let desk = Desk::new();
    desk.run("--set segment.1.duration_s=60 --out run");
    for (format, file) in [("csv", "out/signals.csv"), ("rrd", "out/run.rrd")] {
        let export = desk.start(&format!("export run --format {format} --out out"));
        until("a beginning", || desk.has(format!("{file}.tmp")));
        export.signal("TERM");
        let said = export.finish();
        assert_eq!(said.code, 1, "{}", said.err);
        assert!(desk.names("out").is_empty(), "{:?}", desk.names("out"));
    }
}

#[test]
fn ticks_without_an_answer_of_a_dead_process_are_rows_of_the_recording() {
    let desk = Desk::new();
    let death = "{process=\"estimator\",kind=\"kill\",at_tick=500}";
    let run = |more: &str| {
        let fault = format!("fault=[{death}{more}]");
        let said = desk.armplane(&format!("run --json {SHORT} --set {fault} --out run"));
        let rows = said.json()["recorder"]["rows"].count();
        (said.json(), rows)
    };
    let (summary, rows) = run("");
    let count = |topic: &str| summary["topics"][topic]["count"].count();
    // The estimator is away for 100 ticks.
    let counts = [
        summary["ticks"].count(),
        count("sensor"),
        count("estimate") + 100,
    ];
    assert_eq!(counts, [rows; 3]);
    // A recorder that is killed counts on, and one whose volume is full.
    for kind in ["kill", "disk-full"] {
        let more = format!(",{{process=\"recorder\",kind=\"{kind}\",at_tick=900}}");
        assert_eq!(run(&more).1, rows, "{kind}");
    }
}
