//! A run as one HTML page that needs nothing else, for people without a viewer.

mod camera;
mod drawing;
mod html;
mod moments;
mod plot;
mod recorded;
mod stage;

use model::Robot;
use shared_types::codes::MODE_REGULAR;
use shared_types::job::Job;
use shared_types::summary::{BOUNDARY, Machine, Summary};

use crate::blueprint::{ACROSS, ALONG, JOINTS};
use crate::digits::digits;
use crate::recording::axis_units;
use crate::run::{Event, Happened, Tick};
use crate::signals::Signal;
use crate::sink::RecordError;
use crate::solid::Rgba;
use crate::tint::{faded, on_paper};
use html::{Html, escaped};
use plot::{Axis, BLUE, Plot, RED, numbered};
use recorded::{Recorded, stretches};
use stage::Stage;

/// Lines of the log that are shown.
const LOG_LINES: usize = 200;

/// The page of a run, HTML; without ticks there are neither pictures nor plots. `lacks`: what its record lacks, in clauses.
///
/// # Errors
/// [`RecordError`] where the arm cannot be drawn.
pub fn report(
    summary: &Summary,
    job: &Job,
    robot: &Robot,
    ticks: impl Iterator<Item = Tick>,
    happened: &Happened,
    lacks: &[String],
) -> Result<String, RecordError> {
    let recorded = &Recorded::read(job, robot, ticks, summary.ticks, happened)?;
    let mut page = Html::default();
    head(&mut page, summary, job, lacks);
    let mut stage = Stage::new(robot, job, recorded);
    if let Some(stage) = &mut stage {
        stage.moments(&mut page, summary);
    }
    if recorded.is_empty() {
        page.add("<p class=\"soft\">There is no recording, hence neither pictures nor plots.</p>");
    } else {
        page.heading("Arm and signals");
        page.add("<div class=\"desk\">");
        if let Some(stage) = &stage {
            stage.slider(&mut page);
        }
        page.add("<div class=\"plots\">");
        plots(&mut page, job, recorded, robot);
        page.add("</div></div>");
    }
    tables(&mut page, summary);
    events(&mut page, summary, recorded);
    provenance(&mut page, summary);
    if let Some(stage) = &mut stage {
        stage.script(&mut page);
    }
    page.add("</body></html>");
    Ok(page.text)
}

/// The run's title, its outcome, and what is missing of it.
fn head(page: &mut Html, summary: &Summary, job: &Job, lacks: &[String]) {
    let title = match job.scenario.title.as_str() {
        "" => escaped(&summary.of.scenario),
        title => escaped(title),
    };
    page.add(format_args!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'\">\
         <title>{title} · armplane</title><style>{}</style></head><body>\n<h1>{title}</h1>",
        include_str!("report/report.css")
    ));
    let (outcome, reason) = (escaped(&summary.outcome), escaped(&summary.reason));
    let class = match summary.outcome.as_str() {
        BOUNDARY => "fair",
        _ if summary.is_success() => "good",
        _ => "bad",
    };
    page.add(format_args!(
        "<p class=\"outcome {class}\">{outcome} — {reason}</p>"
    ));
    if !job.scenario.about.is_empty() {
        page.add(format_args!("<p>{}</p>", escaped(&job.scenario.about)));
    }
    for lack in lacks {
        page.add(format_args!("<p class=\"bad\">{}</p>", escaped(lack)));
    }
}

/// The texts of a row.
macro_rules! row {
    ($($cell:expr),* $(,)?) => { vec![$($cell.to_string()),*] };
}

fn tables(page: &mut Html, summary: &Summary) {
    let task = &summary.task;
    page.heading("Accuracy");
    page.table(
        &["task error", "largest", "orthogonal to ζ", "at the end"],
        [
            row![
                "position, mm",
                digits(task.position_max_mm),
                digits(task.orthogonal_max_mm),
                digits(task.final_position_mm),
            ],
            row![
                "orientation, °",
                digits(task.orientation_max_deg),
                digits(task.orthogonal_max_deg),
                digits(task.final_orientation_deg),
            ],
        ],
    );
    let joints = &summary.joints;
    let percent = |ratio: f64, has_limit: bool| match has_limit {
        true => format!("{:.1} %", 100.0 * ratio),
        false => "no limit".to_owned(),
    };
    let torque = |ratio: f64| percent(ratio, joints.has_torque_limit);
    let step = torque(joints.torque_step_max_ratio);
    let speed = percent(joints.speed_max_ratio, joints.has_speed_limit);
    page.table(
        &["joint load, of the robot's limit", "largest"],
        [
            row!["torque", torque(joints.torque_max_ratio)],
            row!["torque step in one tick", step],
            row!["speed", speed],
        ],
    );
    page.table(
        &[
            "singularity",
            "type",
            "min |s|",
            "inside, ticks",
            "entries",
            "ζ turned, °",
        ],
        summary.singularities.iter().map(|one| {
            let (s, turned) = (digits(one.s_min), digits(one.zeta_turned_deg));
            row![
                one.name,
                one.class,
                s,
                one.inside_ticks,
                one.entries,
                turned
            ]
        }),
    );
}

/// Least |s|/η and least error that a plot shows: what is smaller is as good as zero.
const LEAST: f64 = 1e-4;

fn plots(page: &mut Html, job: &Job, recorded: &Recorded, robot: &Robot) {
    let turns = robot.task.0[3..].contains(&true);
    let units = axis_units(robot);
    let own: Vec<Rgba> = recorded
        .singularities
        .iter()
        .map(|one| on_paper(one.colour))
        .collect();
    page.broad_figure(
        &nearness(recorded, &own),
        "Below 1 the arm is treated as singular. Upright bands: control there is not the regular one (blending, tracking by null-space \
         motion, reorienting, holding).",
    );
    page.figure(
        errors(job, recorded, turns),
        "Desired against true pose, orthogonal to and along the singular directions ζ that the arm is inside of.",
    );
    page.figure(
        joints(recorded, units),
        "The joints; colours are the same in all four.",
    );
    let axis = Axis::within(-0.05..1.05);
    let title = "β (1: hand, 0: null space) and governor";
    let beta = |name: &str| format!("β {name}");
    let mut scale = recorded.panel(title, Signal::Beta, axis, &own, beta);
    for (i, line) in recorded.of(Signal::Scale).enumerate() {
        scale.line(&line.name, numbered(i + 4), line.points.clone(), true);
    }
    let (title, axis) = ("latency per hop, µs", Axis::default().logarithmic());
    let latency = recorded.panel(
        title,
        Signal::Latency,
        axis,
        &JOINTS.map(on_paper),
        str::to_owned,
    );
    page.figure(
        [scale, latency],
        "The share of the hand in control (β), and how fast path time, task torque and null-space torque are let through; and the hops of each tick, the \
         whole chain among them: in lockstep they say how fast the machine is, not how punctual.",
    );
}

/// Position error and, of a task that `turns`, orientation error, each with its goal.
fn errors(job: &Job, recorded: &Recorded, turns: bool) -> impl Iterator<Item = Plot> {
    const MOST: f64 = 100.0;
    let goal = &job.scenario.goal;
    let all = [
        (
            "position error, mm",
            Signal::PositionError,
            goal.position_mm,
        ),
        (
            "orientation error, °",
            Signal::OrientationError,
            goal.orientation_deg,
        ),
    ];
    let count = if turns { 2 } else { 1 };
    all.into_iter()
        .take(count)
        .map(|(title, signal, tolerance)| {
            let axis = Axis::within(LEAST..MOST).logarithmic();
            let mut panel = recorded.blank(title, axis);
            let colours = [ACROSS, ALONG].map(on_paper);
            let within = |_, value: f64| value.clamp(LEAST, MOST);
            recorded.draw(&mut panel, signal, &colours, str::to_owned, within);
            if tolerance < MOST {
                let ends = vec![(0.0, tolerance), (recorded.end_s(), tolerance)];
                panel.line("goal", RED, ends, true);
            }
            panel
        })
}

/// How near the arm is to each singularity, in units of its neighbourhood.
fn nearness(recorded: &Recorded, own: &[Rgba]) -> Plot {
    let axis = Axis::within(1e-3..30.0).logarithmic();
    let mut near = recorded.blank("|s|/η: how near to each singularity", axis);
    near.floor("treated as singular", faded(BLUE, 33), 1.0);
    let all = &recorded.singularities;
    for (one, colour) in all.iter().zip(own) {
        for stretch in stretches(&one.modes, recorded.last, |mode| *mode == MODE_REGULAR) {
            let [from, to] = [stretch.start, stretch.end].map(|tick| recorded.seconds(tick));
            near.band("", faded(*colour, 33), from..to);
        }
    }
    let of = |i: usize, s: f64| (s.abs() / all.get(i).map_or(1.0, |one| one.eta)).clamp(LEAST, 1e6);
    recorded.draw(&mut near, Signal::Measure, own, str::to_owned, of);
    near
}

/// Torques, positions and speeds of the joints: over their limits, or, where the limits are infinite, hence all is 0, themselves.
fn joints(recorded: &Recorded, [speed_unit, load_unit]: [&'static str; 2]) -> [Plot; 4] {
    let has = |signals: &[Signal]| signals.iter().any(|signal| recorded.moves(*signal));
    let panel = |title: &str, signal, axis| {
        let name = |name: &str| format!("q{name}");
        recorded.panel(title, signal, axis, &JOINTS.map(on_paper), name)
    };
    use Signal::*;
    let (task, null, of) =
        match has(&[TorqueTask, TorqueNull]) && !has(&[TorqueTaskRatio, TorqueNullRatio]) {
            true => (TorqueTask, TorqueNull, load_unit),
            false => (TorqueTaskRatio, TorqueNullRatio, " / limit"),
        };
    let (speed, speed_of) = match has(&[Speed]) && !has(&[SpeedRatio]) {
        true => (Speed, speed_unit),
        false => (SpeedRatio, " / limit"),
    };
    let range = Axis::within(-1.05..1.05);
    [
        panel(
            &format!("hand torque, with gravity{of}"),
            task,
            Axis::default(),
        ),
        panel(&format!("null-space torque{of}"), null, Axis::default()),
        panel("joints between their limits ±1", PositionInRange, range),
        panel(&format!("joint speeds{speed_of}"), speed, Axis::default()),
    ]
}

/// The run's own description.
fn facts(page: &mut Html, summary: &Summary) {
    let simulated_s = summary.ticks as f64 / f64::from(summary.of.rate_hz.max(1));
    page.facts(&[
        ("scenario", summary.of.scenario.clone()),
        ("robot", summary.of.robot.clone()),
        (
            "mode",
            format!("{}, seed {}", summary.of.mode, summary.of.seed),
        ),
        (
            "length",
            format!(
                "{} ticks at {} Hz: {simulated_s:.3} s of the arm's time in {:.2} s",
                summary.ticks, summary.of.rate_hz, summary.pace.wall_s
            ),
        ),
        ("run", summary.of.run.clone()),
    ]);
}

fn events(page: &mut Html, summary: &Summary, recorded: &Recorded) {
    page.heading("Modes and faults");
    let modes = summary.modes.iter();
    let modes = modes.map(|change| row![change.tick, change.singularity, change.mode]);
    page.some("No mode changed.", &["tick", "singularity", "mode"], modes);
    let faults = summary.faults.iter();
    page.some(
        "No fault, refusal or loss.",
        &["tick", "process", "fault", "what happened"],
        faults.map(|fault| row![fault.tick, fault.process, fault.kind, fault.detail]),
    );
    if let Some(deadlines) = &summary.deadlines {
        page.add(format_args!(
            "<p>{} deadlines missed of {}.</p>",
            deadlines.missed, deadlines.total
        ));
        let causes = deadlines.by_cause.iter();
        let causes = causes.map(|(cause, count)| row![cause, count]);
        page.some("", &["cause", "missed"], causes);
    }
    let latency = summary.latency_us.iter().map(|(hop, l)| {
        let [p50, p99, p999, max] = [l.p50, l.p99, l.p999, l.max].map(digits);
        row![hop, l.count, p50, p99, p999, max]
    });
    page.some(
        "",
        &["latency, µs", "samples", "p50", "p99", "p99.9", "max"],
        latency,
    );
    if recorded.log.is_empty() {
        return;
    }
    page.heading("Log");
    let lines = recorded.log.iter().take(LOG_LINES);
    let lines = lines.map(|Event { tick, level, text }| row![tick, level.name(), text]);
    page.table(&["tick", "level", "what"], lines);
    if recorded.log.len() > LOG_LINES {
        page.add(format_args!(
            "<p class=\"soft\">{} more lines are in the recording.</p>",
            recorded.log.len() - LOG_LINES
        ));
    }
}

fn provenance(page: &mut Html, summary: &Summary) {
    page.heading("Provenance");
    facts(page, summary);
    let Machine { cpu, cores, kernel } = &summary.machine;
    let recorder = &summary.recorder;
    let recording = match (recorder.file.as_str(), recorder.error.as_str()) {
        ("", "") => "none".to_owned(),
        (file, "") => format!("{file}, {:.1} MB", recorder.bytes as f64 / 1e6),
        (_, error) => error.to_owned(),
    };
    let machine = match cpu.as_str() {
        "" => "not recorded".to_owned(),
        cpu => format!("{cpu}, {cores} cores, {kernel}"),
    };
    let messages = format!("{} received, {} lost", recorder.messages, recorder.lost);
    page.facts(&[
        ("armplane", summary.of.version.clone()),
        ("machine", machine),
        ("recording", recording),
        ("messages", messages),
    ]);
    let processes = summary.processes.iter();
    page.some(
        "",
        &["process", "pid", "restarts", "exit"],
        processes.map(|one| row![one.name, one.pid, one.restarts, one.exit]),
    );
    let topics = summary.topics.iter();
    page.some(
        "",
        &["topic", "messages", "hash of the contents"],
        topics.map(|(name, topic)| row![name, topic.count, topic.hash]),
    );
}
