//! A run as one HTML page that needs nothing else, for people without a viewer.

mod camera;
mod drawing;
mod html;
mod moments;
mod path;
mod poses;
mod recorded;
mod solids;
mod stage;

use std::path::{Path, PathBuf};

use model::{Robot, RobotSource};
use shared_types::job::{Job, RobotText};
use shared_types::summary::{Machine, Summary};

use crate::blueprint::{ACROSS, ALONG, JOINTS};
use crate::plot::{Axis, Color, PlotError, RED, digits, numbered};
use crate::read::ReadError;
use crate::shortfall::Reading;
use crate::signals::Signal;
use crate::tint::ink;
use drawing::Named;
use html::{Html, escaped};
use recorded::Recorded;
use stage::Stage;

/// Lines of the log that are shown.
const LOG_LINES: usize = 200;

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The recording cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// A plot cannot be drawn.
    #[error(transparent)]
    Plot(#[from] PlotError),
}

/// A run's page.
#[derive(Clone, Debug)]
pub struct Report {
    /// HTML.
    pub text: String,
    /// Clauses: the shortfall of its recording, and the damage of its messages; the page says them, too.
    pub lacks: Vec<String>,
}

/// The page of a run; `parts` are its recording's files, none where there is no recording, `damage` what its message logs lack, in clauses. Errors name
/// `path`, where the page shall go.
///
/// # Errors
/// [`ReportError`] where the recording cannot be read or a plot not be drawn.
pub fn report(
    summary: &Summary,
    job: &Job,
    parts: &[PathBuf],
    damage: &[String],
    path: &Path,
) -> Result<Report, ReportError> {
    let mut reading = Reading::default();
    let recorded = &Recorded::read(parts, summary, &mut reading)?;
    let shortfall = reading
        .shortfall(parts, Some(summary))
        .map(|shortfall| shortfall.to_string());
    let lacks: Vec<String> = shortfall
        .into_iter()
        .chain(damage.iter().cloned())
        .collect();
    let mut page = Html::default();
    let title = if job.scenario.title.is_empty() {
        &summary.scenario
    } else {
        &job.scenario.title
    };
    let title = escaped(title);
    page.add(format_args!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'\">\
         <title>{title} · armplane</title><style>{}</style></head><body>\n<h1>{title}</h1>",
        include_str!("report/report.css")
    ));
    let good = summary.outcome == "goal reached";
    page.add(format_args!(
        "<p class=\"outcome {}\">{} — {}</p>",
        if good { "good" } else { "bad" },
        escaped(&summary.outcome),
        escaped(&summary.reason)
    ));
    if !job.scenario.about.is_empty() {
        page.add(format_args!("<p>{}</p>", escaped(&job.scenario.about)));
    }
    for lack in &lacks {
        page.add(format_args!("<p class=\"bad\">{}</p>", escaped(lack)));
    }
    let singularities = Named::all(&recorded.singularities);
    let RobotText {
        name,
        description,
        urdf,
    } = job.robot.clone();
    let robot = Robot::from_source(&RobotSource {
        name,
        description,
        urdf,
    })
    .ok();
    let mut stage = robot
        .as_ref()
        .and_then(|robot| Stage::new(robot, job, recorded, &singularities));
    if let Some(stage) = &mut stage {
        stage.moments(&mut page, job, summary, recorded, &singularities);
    }
    if recorded.lines.is_empty() {
        page.add(format_args!(
            "<p class=\"soft\">There is no recording, hence neither pictures nor plots.</p>"
        ));
    } else {
        page.heading("Arm and signals");
        page.add(format_args!("<div class=\"desk\">"));
        if let Some(stage) = &stage {
            stage.slider(&mut page, recorded.end_s);
        }
        page.add(format_args!("<div class=\"plots\">"));
        let turns = robot.is_none_or(|robot| robot.task.0[3..].contains(&true));
        plots(&mut page, job, recorded, &singularities, turns, path)?;
        page.add(format_args!("</div></div>"));
    }
    tables(&mut page, summary);
    happened(&mut page, summary, recorded);
    provenance(&mut page, summary);
    if let Some(stage) = &mut stage {
        stage.script(&mut page);
    }
    page.add(format_args!("</body></html>"));
    Ok(Report {
        text: page.text,
        lacks,
    })
}

fn tables(page: &mut Html, summary: &Summary) {
    let task = &summary.task;
    page.heading("Accuracy");
    let of = |values: [f64; 3]| values.map(digits);
    let row = |name: &str, values: [f64; 3]| [vec![name.to_owned()], of(values).to_vec()].concat();
    page.table(
        &["task error", "largest", "orthogonal to ζ", "at the end"],
        &[
            row(
                "position, mm",
                [
                    task.position_max_mm,
                    task.orthogonal_max_mm,
                    task.final_position_mm,
                ],
            ),
            row(
                "orientation, °",
                [
                    task.orientation_max_deg,
                    task.orthogonal_max_deg,
                    task.final_orientation_deg,
                ],
            ),
        ],
    );
    let joints = &summary.joints;
    let percent = |ratio: f64, has_limit: bool| {
        if has_limit {
            format!("{:.1} %", 100.0 * ratio)
        } else {
            "no limit".to_owned()
        }
    };
    page.table(
        &["joint load, of the robot's limit", "largest"],
        &[
            vec![
                "torque".to_owned(),
                percent(joints.torque_max_ratio, joints.has_torque_limit),
            ],
            vec![
                "torque step in one tick".to_owned(),
                percent(joints.torque_step_max_ratio, joints.has_torque_limit),
            ],
            vec![
                "speed".to_owned(),
                percent(joints.speed_max_ratio, joints.has_speed_limit),
            ],
        ],
    );
    let singularities: Vec<Vec<String>> = summary
        .singularities
        .iter()
        .map(|one| {
            vec![
                one.name.clone(),
                one.class.clone(),
                digits(one.s_min),
                one.inside_ticks.to_string(),
                one.entries.to_string(),
                digits(one.zeta_turned_deg),
            ]
        })
        .collect();
    page.table(
        &[
            "singularity",
            "type",
            "min |s|",
            "inside, ticks",
            "entries",
            "ζ turned, °",
        ],
        &singularities,
    );
}

/// Least |s|/η and least error that a plot shows: what is smaller is as good as zero.
const LEAST: f64 = 1e-4;

/// `turns`: whether the task has an orientation.
fn plots(
    page: &mut Html,
    job: &Job,
    recorded: &Recorded,
    singularities: &[Named],
    turns: bool,
    path: &Path,
) -> Result<(), PlotError> {
    let rate_hz = f64::from(job.scenario.rate_hz.max(1));
    let joint = |name: &str| format!("q{name}");
    let joints: Vec<Color> = JOINTS.map(ink).to_vec();
    let own: Vec<Color> = singularities.iter().map(|one| ink(one.colour)).collect();
    let analysis = &job.scenario.analysis;

    let mut near = recorded.blank(
        "|s|/η: how near to each singularity",
        Axis::default().logarithmic().within(1e-3..30.0),
    );
    near.floor("treated as singular", Color { 3: 0.13, ..RED }, 1.0);
    for (i, one) in singularities.iter().enumerate() {
        let shade = Color { 3: 0.13, ..own[i] };
        recorded
            .stretches(&format!("mode/{}", one.name), "regular", rate_hz)
            .into_iter()
            .for_each(|stretch| near.band("", shade, stretch));
    }
    recorded.draw_scaled(&mut near, Signal::Measure, &own, |i, s| {
        let eta = singularities
            .get(i)
            .map_or(1.0, |one| analysis.eta_in.of(one.kind));
        (s.abs() / eta.max(1e-12)).clamp(LEAST, 1e6)
    });
    page.broad_figure(
        path,
        near,
        "Below 1 the arm is treated as singular. Upright bands: control there is not the regular one (blending, tracking by null-space \
         motion, reorienting, holding).",
    )?;

    let errors = [ink(ACROSS), ink(ALONG)];
    let error = |title: &str, signal, tolerance: f64, most: f64| {
        let mut panel = recorded.blank(title, Axis::default().logarithmic().within(LEAST..most));
        recorded.draw_scaled(&mut panel, signal, &errors, |_, value| {
            value.clamp(LEAST, most)
        });
        if tolerance < most {
            panel.dashed(
                "goal",
                RED,
                &[(0.0, tolerance), (recorded.end_s, tolerance)],
            );
        }
        panel
    };
    let goal = &job.scenario.goal;
    let position = error(
        "position error, mm",
        Signal::PositionError,
        goal.position_mm,
        100.0,
    );
    let orientation = error(
        "orientation error, °",
        Signal::OrientationError,
        goal.orientation_deg,
        100.0,
    );
    page.figure(
        path,
        std::iter::once(position).chain(turns.then_some(orientation)),
        "Desired against true pose, orthogonal to and along the singular directions ζ that the arm is inside of.",
    )?;

    let (torque, of) = recorded.over_limit(
        [Signal::TorqueTaskRatio, Signal::TorqueNullRatio],
        [Signal::TorqueTask, Signal::TorqueNull],
        "N·m",
    );
    let task = recorded.panel(
        &format!("hand torque, with gravity{of}"),
        torque[0],
        Axis::default(),
        &joints,
        joint,
    );
    let null = recorded.panel(
        &format!("null-space torque{of}"),
        torque[1],
        Axis::default(),
        &joints,
        joint,
    );
    let range = recorded.panel(
        "joints between their limits ±1",
        Signal::PositionInRange,
        Axis::default().within(-1.05..1.05),
        &joints,
        joint,
    );
    let ([speed], of) = recorded.over_limit([Signal::SpeedRatio], [Signal::Speed], "rad/s");
    let speed = recorded.panel(
        &format!("joint speeds{of}"),
        speed,
        Axis::default(),
        &joints,
        joint,
    );
    page.figure(
        path,
        [task, null, range, speed],
        "The joints; colours are the same in all four.",
    )?;

    let mut scale = recorded.blank(
        "β (1: hand, 0: null space) and governor",
        Axis::default().within(-0.05..1.05),
    );
    recorded.draw(&mut scale, Signal::Beta, &own, |name| format!("β {name}"));
    for (i, line) in recorded
        .lines
        .get(Signal::Scale.name())
        .into_iter()
        .flatten()
        .enumerate()
    {
        scale.dashed(&line.name, numbered(i + 4), &line.points);
    }
    let latency = recorded.panel(
        "latency per hop, µs",
        Signal::Latency,
        Axis::default().logarithmic(),
        &joints,
        str::to_owned,
    );
    page.figure(
        path,
        [scale, latency],
        "The share of the hand in control (β), and how fast path time, task torque and null-space torque are let through; and the hops of each tick, the \
         whole chain among them: in lockstep they say how fast the machine is, not how punctual.",
    )
}

/// The run's own description.
fn facts(page: &mut Html, summary: &Summary) {
    let simulated_s = summary.ticks as f64 / f64::from(summary.rate_hz.max(1));
    page.facts(&[
        ("scenario", summary.scenario.clone()),
        ("robot", summary.robot.clone()),
        ("mode", format!("{}, seed {}", summary.mode, summary.seed)),
        (
            "length",
            format!(
                "{} ticks at {} Hz: {simulated_s:.3} s of the arm's time in {:.2} s",
                summary.ticks, summary.rate_hz, summary.wall_s
            ),
        ),
        ("run", summary.run.clone()),
    ]);
}

fn happened(page: &mut Html, summary: &Summary, recorded: &Recorded) {
    page.heading("Modes and faults");
    let modes: Vec<Vec<String>> = summary
        .modes
        .iter()
        .map(|change| {
            vec![
                change.tick.to_string(),
                change.singularity.clone(),
                change.mode.clone(),
            ]
        })
        .collect();
    page.some("No mode changed.", &["tick", "singularity", "mode"], &modes);
    let faults: Vec<Vec<String>> = summary
        .faults
        .iter()
        .map(|fault| {
            vec![
                fault.tick.to_string(),
                fault.process.clone(),
                fault.kind.clone(),
                fault.detail.clone(),
            ]
        })
        .collect();
    page.some(
        "No fault, refusal or loss.",
        &["tick", "process", "fault", "what happened"],
        &faults,
    );
    if summary.deadlines.total > 0 {
        page.add(format_args!(
            "<p>{} deadlines missed of {}.</p>",
            summary.deadlines.missed, summary.deadlines.total
        ));
        let causes: Vec<Vec<String>> = summary
            .deadlines
            .by_cause
            .iter()
            .map(|(cause, count)| vec![cause.clone(), count.to_string()])
            .collect();
        page.some("", &["cause", "missed"], &causes);
    }
    let latency: Vec<Vec<String>> = summary
        .latency_us
        .iter()
        .map(|(hop, l)| {
            vec![
                hop.clone(),
                l.count.to_string(),
                digits(l.p50),
                digits(l.p99),
                digits(l.p999),
                digits(l.max),
            ]
        })
        .collect();
    page.some(
        "",
        &["latency, µs", "samples", "p50", "p99", "p99.9", "max"],
        &latency,
    );
    if !recorded.log.is_empty() {
        page.heading("Log");
        let lines: Vec<Vec<String>> = recorded
            .log
            .iter()
            .take(LOG_LINES)
            .map(|(tick, level, text)| vec![tick.to_string(), level.clone(), text.clone()])
            .collect();
        page.table(&["tick", "level", "what"], &lines);
        if recorded.log.len() > LOG_LINES {
            page.add(format_args!(
                "<p class=\"soft\">{} more lines are in the recording.</p>",
                recorded.log.len() - LOG_LINES
            ));
        }
    }
}

fn provenance(page: &mut Html, summary: &Summary) {
    page.heading("Provenance");
    facts(page, summary);
    let Machine { cpu, cores, kernel } = &summary.machine;
    let recording = match (
        summary.recorder.file.as_str(),
        summary.recorder.error.as_str(),
    ) {
        ("", "") => "none".to_owned(),
        (file, "") => format!(
            "{file}, {:.1} MB, {} part(s)",
            summary.recorder.bytes as f64 / 1e6,
            summary.recorder.parts.max(1)
        ),
        (_, error) => error.to_owned(),
    };
    page.facts(&[
        ("armplane", summary.version.clone()),
        (
            "machine",
            if cpu.is_empty() {
                "not recorded".to_owned()
            } else {
                format!("{cpu}, {cores} cores, {kernel}")
            },
        ),
        ("recording", recording),
        (
            "messages",
            format!(
                "{} received, {} lost",
                summary.recorder.messages, summary.recorder.lost
            ),
        ),
    ]);
    let processes: Vec<Vec<String>> = summary
        .processes
        .iter()
        .map(|one| {
            vec![
                one.name.clone(),
                one.pid.to_string(),
                one.restarts.to_string(),
                one.exit.clone(),
            ]
        })
        .collect();
    page.some("", &["process", "pid", "restarts", "exit"], &processes);
    let topics: Vec<Vec<String>> = summary
        .topics
        .iter()
        .map(|(name, topic)| vec![name.clone(), topic.count.to_string(), topic.hash.clone()])
        .collect();
    page.some("", &["topic", "messages", "hash of the contents"], &topics);
}
