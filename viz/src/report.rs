//! A run as one HTML page that needs nothing else, for people without a viewer: `report.html` is the page, this its contents.

mod drawing;
mod plot;
mod recorded;

use minijinja::Environment;
use minijinja::value::{Serde, Value};
use serde_json::json;
use shared_types::job::Job;
use shared_types::summary::{BOUNDARY, Summary};

use crate::blueprint::{ACROSS, ALONG, JOINTS};
use crate::digits::digits;
use crate::facts::Facts;
use crate::narration::Words;
use crate::picture::Picture;
use crate::pose::Rgba;
use crate::run::Source;
use crate::signals::Signal;
use crate::sink::{RecordError, defect};
use crate::tint::{faded, hex, on_paper};
use drawing::{Drawing, WIDTH};
use plot::{Curve, Plot};
use recorded::Recorded;

/// Lines of the log that are shown.
const LOG_LINES: usize = 200;
/// Most bytes of the pictures between which the slider moves, and most of them.
const BYTES: usize = 2_000_000;
const FRAMES: usize = 400;
/// Least |s|/η and least error that a plot shows, and the largest error: what is smaller is as good as zero.
const LEAST: f64 = 1e-4;
const MOST: f64 = 100.0;
const GREY: Rgba = 0x787e8aff;
const BLUE: Rgba = 0x0062b2ff;
/// Colours of the governor's scales.
const SCALES: [Rgba; 3] = [0x0062b2ff, 0x008c68ff, 0xc98c00ff];

/// The contents of the plots.
const PLOTTED: &[Signal] = {
    use Signal::*;
    &[
        Measure,
        PositionError,
        OrientationError,
        TorqueTask,
        TorqueTaskRatio,
        DrawnNull,
        DrawnPosition,
        DrawnSpeed,
        Beta,
        Scale,
        Latency,
        Pressed,
    ]
};

/// The page of a run, HTML; without ticks there are neither pictures nor plots. `lacks`: what its record lacks, in clauses.
///
/// # Errors
/// [`RecordError`] where the arm cannot be drawn, or the source's `progress` has ended it.
pub fn report(summary: &Summary, source: Source, lacks: &[String]) -> Result<String, RecordError> {
    let facts = &Facts::new(source.job, source.robot, source.happened, false)?;
    let recorded = &Recorded::read(facts, source, summary.ticks, PLOTTED)?;
    let class = match summary.outcome.as_str() {
        BOUNDARY => "fair",
        _ if summary.is_success() => "good",
        _ => "bad",
    };
    let log = recorded
        .log
        .iter()
        .take(LOG_LINES)
        .map(|event| json!([event.tick, event.level.name(), event.text]));
    let contents = json!({
        "of": summary,
        "title": facts.title,
        "about": facts.job.scenario.about,
        "slowed": summary.task.slowed(),
        "law": facts.job.scenario.control.strategy.name(),
        "class": class,
        "lacks": lacks,
        "log": log.collect::<Vec<_>>(),
        "more": recorded.log.len().saturating_sub(LOG_LINES),
        "plots": plots(facts, recorded),
        "stage": Drawing::new(facts, recorded).map(|drawing| stage(drawing, recorded, summary)),
    });
    page(&contents).map_err(defect)
}

fn page(contents: &serde_json::Value) -> Result<String, minijinja::Error> {
    let mut environment = Environment::new();
    environment.add_filter("digits", digits);
    for (name, text) in [
        ("report.html", include_str!("report/report.html")),
        ("report.css", include_str!("report/report.css")),
        ("report.js", include_str!("report/report.js")),
    ] {
        environment.add_template(name, text)?;
    }
    environment
        .get_template("report.html")?
        .render(Value::from(Serde(contents)))
}

/// Words as the page shows them: colour and name of the singularity that a line is about, and the line.
fn told(words: &Words, recorded: &Recorded) -> serde_json::Value {
    let of = |(of, text): &(Option<usize>, String)| match of.and_then(|i| recorded.named.get(i)) {
        Some(one) => json!([hex(on_paper(one.colour)), one.name, text]),
        None => json!(["", "", text]),
    };
    json!({ "headline": words.headline, "lines": words.lines.iter().map(of).collect::<Vec<_>>() })
}

/// A few moments side by side, and the pictures between which the slider moves.
fn stage(mut drawing: Drawing, recorded: &Recorded, summary: &Summary) -> serde_json::Value {
    let ground = drawing.ground();
    let faults = summary.faults.iter().filter(|fault| fault.occurred);
    let mut moments = Vec::new();
    for (tick, name) in recorded.moments(faults.map(|fault| fault.tick).min()) {
        let Some(picture) = recorded.picture(tick) else {
            continue;
        };
        let paths = [ground.clone(), drawing.at(picture)].concat();
        moments.push(json!({
            "name": name, "t": recorded.seconds(tick), "paths": paths,
            "fault": recorded.fault(tick), "words": told(&picture.words, recorded),
        }));
    }
    // Paths as the script reads them: the paint's number in two digits, then the path; a bar between.
    let markup = |paths: Vec<(usize, String)>| {
        let one = |(paint, path): &(usize, String)| format!("{:02}{path}", paint.min(&99));
        paths.iter().map(one).collect::<Vec<_>>().join("|")
    };
    let all = &recorded.pictures;
    let one = markup(drawing.at(&all[all.len() / 2])).len().max(1);
    let stride = all.len().div_ceil((BYTES / one).clamp(2, FRAMES));
    let some = all.iter().step_by(stride).chain(all.last());
    let frame = |picture: &Picture| (recorded.seconds(picture.tick), markup(drawing.at(picture)));
    let (times, frames): (Vec<_>, Vec<_>) = some.map(frame).unzip();
    let words = all.chunk_by(|a, b| a.words == b.words).map(|same| {
        json!([
            recorded.seconds(same[0].tick),
            told(&same[0].words, recorded)
        ])
    });
    let words: Vec<_> = words.collect();
    json!({
        "moments": moments, "width": WIDTH, "height": drawing.height, "paints": drawing.paints, "end_s": recorded.end_s(),
        "data": { "t": times, "p": drawing.paints, "g": markup(ground), "w": words, "f": frames },
    })
}

/// All plots, each with the caption of the row that it ends.
fn plots(facts: &Facts, recorded: &Recorded) -> Vec<serde_json::Value> {
    let own: Vec<Rgba> = recorded
        .named
        .iter()
        .map(|one| on_paper(one.colour))
        .collect();
    let of = |title, signal, colours: &[Rgba]| panel(recorded, title, signal, colours, "");
    let lines = [GREY, BLUE].map(on_paper);
    let force = of("force along its axis, N", Signal::Pressed, &lines);
    let lines = JOINTS.map(on_paper);
    let latency = Plot {
        is_logarithmic: true,
        ..of("latency per hop, µs", Signal::Latency, &lines)
    };
    let rows = [
        (
            vec![nearness(recorded, facts.job, &own)],
            "Below 1 the arm enters a lock, which it leaves a little farther out. Upright bands: control there is not the regular one (blending, tracking by null-space motion, reorienting, holding).",
        ),
        (
            errors(facts, recorded),
            "Desired against true pose, orthogonal to and along the singular directions ζ that the arm is inside of.",
        ),
        (
            vec![force],
            "The force of the segment along its axis: the set-point, and the simulator's true contact.",
        ),
        (
            joints(facts, recorded),
            "The joints; colours are the same in all four.",
        ),
        (
            vec![shares(recorded, &own), latency],
            "The share of the hand in control (β), and how fast path time, task torque and null-space torque are let through; and the hops of each tick, the \
             whole chain among them: in lockstep they say how fast the machine is, not how punctual.",
        ),
    ];
    let row = |(plots, caption): (Vec<Plot>, &str)| {
        let is_alone = plots.len() == 1;
        let plots = plots
            .iter()
            .filter(|plot| !plot.curves.is_empty())
            .map(|plot| drawn(plot, is_alone));
        json!({ "plots": plots.collect::<Vec<_>>(), "caption": caption })
    };
    // A goal is a line, too: without a record there is no plot.
    if recorded.lines.is_empty() {
        return Vec::new();
    }
    rows.into_iter()
        .map(row)
        .filter(|row| !row["plots"][0].is_null())
        .collect()
}

/// A plot as the page has it; one alone in its row as wide as the page, and drawn anew for a narrow one.
fn drawn(plot: &Plot, is_alone: bool) -> serde_json::Value {
    let sizes: &[[f64; 2]] = if is_alone {
        &[[700.0, 190.0], [350.0, 170.0]]
    } else {
        &[[350.0, 150.0]]
    };
    let drawings = sizes.iter().map(|size| plot.drawing(*size));
    json!({
        "title": plot.title, "drawings": drawings.collect::<Vec<_>>(),
        "floor": plot.floor.map(|(_, colour)| hex(colour)),
        "has_fault": !plot.faults.is_empty(),
        "has_gap": plot.bands.iter().any(|(_, colour)| colour | 0xff == GREY),
    })
}

/// The share of the hand in control, and what governor and limits let through.
fn shares(recorded: &Recorded, own: &[Rgba]) -> Plot {
    let title = "β (1: hand, 0: null space) and governor";
    let mut plot = panel(recorded, title, Signal::Beta, own, "β ");
    plot.range = Some(-0.05..1.05);
    plot.curves.extend(
        recorded
            .of(Signal::Scale)
            .iter()
            .zip(SCALES)
            .map(|(line, colour)| Curve {
                name: line.name.clone(),
                colour,
                is_dashed: true,
                points: line.points.clone(),
            }),
    );
    plot
}

/// A diagram of a signal's lines, with the faults and gaps in it; `prefix`: before the names of the lines.
fn panel(recorded: &Recorded, title: &str, signal: Signal, colours: &[Rgba], prefix: &str) -> Plot {
    let lines = recorded.of(signal);
    let gaps = lines.iter().max_by_key(|line| line.gaps.len());
    let gaps = gaps.into_iter().flat_map(|line| line.gaps.clone());
    let curve = |(line, colour): (&recorded::Line, &Rgba)| Curve {
        name: format!("{prefix}{}", line.name),
        colour: *colour,
        is_dashed: false,
        points: line.points.clone(),
    };
    Plot {
        title: title.to_owned(),
        end_s: recorded.end_s(),
        curves: lines
            .iter()
            .zip(colours.iter().cycle())
            .map(curve)
            .collect(),
        bands: gaps.map(|gap| (gap, faded(GREY, 77))).collect(),
        faults: recorded.faulty(),
        ..Plot::default()
    }
}

/// Position error and, of a task that turns the hand, orientation error, each with its goal.
fn errors(facts: &Facts, recorded: &Recorded) -> Vec<Plot> {
    let goal = &facts.job.scenario.goal;
    let of = |title, signal, tolerance: f64| {
        let mut plot = panel(recorded, title, signal, &[ACROSS, ALONG].map(on_paper), "");
        (plot.is_logarithmic, plot.range) = (true, Some(LEAST..MOST));
        for point in plot.curves.iter_mut().flat_map(|curve| &mut curve.points) {
            point.1 = point.1.clamp(LEAST, MOST);
        }
        plot.curves.extend((tolerance < MOST).then(|| Curve {
            name: "goal".to_owned(),
            colour: GREY,
            is_dashed: true,
            points: vec![(0.0, tolerance), (recorded.end_s(), tolerance)],
        }));
        plot
    };
    let mut plots = vec![of(
        "position error, mm",
        Signal::PositionError,
        goal.position_mm,
    )];
    if facts.turns() {
        let (title, signal) = ("orientation error, °", Signal::OrientationError);
        plots.push(of(title, signal, goal.orientation_deg));
    }
    plots
}

/// How near the arm is to each singularity, in units of its neighbourhood.
fn nearness(recorded: &Recorded, job: &Job, own: &[Rgba]) -> Plot {
    let title = "|s|/η: how near to each singularity";
    let mut near = panel(recorded, title, Signal::Measure, own, "");
    (near.is_logarithmic, near.range) = (true, Some(1e-3..30.0));
    near.floor = Some((1.0, faded(BLUE, 33)));
    for (curve, one) in near.curves.iter_mut().zip(&recorded.named) {
        let eta = job.scenario.analysis.eta_in.of(one.kind).max(1e-12);
        for point in &mut curve.points {
            point.1 = (point.1.abs() / eta).clamp(LEAST, 1e6);
        }
    }
    for (named, colour) in recorded.named.iter().zip(own) {
        near.bands.extend(
            recorded
                .irregular(named)
                .into_iter()
                .map(|one| (one, faded(*colour, 33))),
        );
    }
    near
}

/// Torques, positions and speeds of the joints: over their limits, or, where some joint has none, themselves.
fn joints(facts: &Facts, recorded: &Recorded) -> Vec<Plot> {
    use Signal::*;
    let [speed, load] = facts.axis_units();
    let task = if facts.is_limited(|joint| joint.effort) {
        TorqueTaskRatio
    } else {
        TorqueTask
    };
    let colours = JOINTS.map(on_paper);
    let of =
        |title, unit, signal| panel(recorded, &format!("{title}{unit}"), signal, &colours, "q");
    let mut range = of("joints between their limits ±1", "", DrawnPosition);
    range.range = Some(-1.05..1.05);
    vec![
        of("hand torque, with gravity", load, task),
        of("null-space torque", load, DrawnNull),
        range,
        of("joint speeds", speed, DrawnSpeed),
    ]
}
