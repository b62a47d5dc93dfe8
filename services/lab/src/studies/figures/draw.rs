//! Chang & Khatib's Figures 1 to 5, drawn from runs just made.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use serde_json::{Value, json};
use session::{Failure, Observer, Results, load};
use shared_types::codes::{KIND_ELBOW, KIND_OVERHEAD, KIND_WRIST};
use viz::plot::{Axis, BLUE, Color, GREY, INK, Page, Panel, PlotError, RED, Row, digits, numbered};
use viz::singularity_ink;

use super::figure::Figure;
use super::locks::three_locks;
use super::trace::{Sample, Trace};
use crate::pool::on_all_cores;

/// The scenarios that the figures show.
const SCENARIOS: [&str; 6] = [
    "fig1-pseudo-inverse",
    "fig2-dynamically-consistent",
    "elbow-in-and-out",
    "overhead-pass",
    "fig4-elbow-and-wrist",
    "fig5-wrist-rotation",
];

/// How many postures of the arm are drawn.
const POSTURES: usize = 9;

/// A figure and its files, SVG and PNG.
pub type Saved = (Figure, [PathBuf; 2]);

/// Runs the scenarios of the figures, with values overridden, and saves pictures and `figures.json` in the folder `out`, or the next
/// free `runs/figures-NNN`. Returns the figures with their files, and the numbers.
///
/// # Errors
/// [`Failure`] where a scenario cannot be run, or a file cannot be written.
pub fn figures(
    settings: &[String],
    out: Option<&Path>,
    observer: Observer<'_>,
) -> Result<(Vec<Saved>, Value), Failure> {
    let loaded = SCENARIOS
        .iter()
        .map(|name| load::scenario(name, settings, None))
        .collect::<Result<Vec<_>, _>>()?;
    let results = Results::create(out, "figures")?;
    let traces = on_all_cores(
        "figures",
        &loaded,
        |loaded| Trace::of(&loaded.robot, &loaded.scenario),
        observer,
    );
    let traces = traces
        .into_iter()
        .collect::<Result<Vec<_>, _>>()
        .map_err(Failure::input)?;
    let [pseudo_inverse, consistent, elbow, overhead, fig4, fig5] = traces.as_slice() else {
        return Err(Failure::work("a figure's run is missing"));
    };
    let figures = [
        null_space(pseudo_inverse, consistent),
        three_locks([
            (KIND_ELBOW, elbow),
            (KIND_WRIST, fig5),
            (KIND_OVERHEAD, overhead),
        ]),
        two_locks(fig4),
        wrist_lock(fig5),
    ];
    let mut numbers = serde_json::Map::new();
    for figure in &figures {
        match (figure.name, &figure.numbers) {
            ("fig1-2", Value::Object(both)) => numbers.extend(both.clone()),
            (name, one) => drop(numbers.insert(name.to_owned(), one.clone())),
        }
    }
    let save = |figure: Figure| {
        figure
            .page
            .save(&results.folder.join(figure.name))
            .map(|files| (figure, files))
    };
    let figures = figures
        .into_iter()
        .map(save)
        .collect::<Result<Vec<_>, PlotError>>()
        .map_err(Failure::work)?;
    let numbers = Value::Object(numbers);
    results.save("figures.json", &numbers)?;
    Ok((figures, numbers))
}

fn time() -> Axis {
    Axis::named("time, s")
}

/// A quantity over time.
fn over_time(trace: &Trace, of: impl Fn(&Sample) -> f64) -> Vec<(f64, f64)> {
    trace
        .samples
        .iter()
        .map(|sample| (sample.t, of(sample)))
        .collect()
}

/// The arm at even steps of time, later ones stronger, seen along the third of three axes.
fn postures(
    panel: &mut Panel,
    trace: &Trace,
    range: std::ops::RangeInclusive<f64>,
    axes: [Vector3<f64>; 2],
) {
    let shown: Vec<_> = trace
        .samples
        .iter()
        .filter(|sample| range.contains(&sample.t))
        .collect();
    for k in 0..POSTURES {
        let Some(sample) = shown.get(k * (shown.len().saturating_sub(1)) / (POSTURES - 1)) else {
            continue;
        };
        let joints: Vec<_> = sample
            .arm
            .iter()
            .map(|p| (p.dot(&axes[0]), p.dot(&axes[1])))
            .collect();
        panel.arm(
            BLUE,
            0.18 + 0.82 * k as f64 / (POSTURES - 1) as f64,
            &joints,
        );
    }
}

fn joint_angles(trace: &Trace, title: &str, joints: std::ops::Range<usize>) -> Panel {
    let mut panel = Panel::new(title, time(), Axis::default());
    for (n, i) in joints.enumerate() {
        panel.line(
            &format!("q{}", subscript(i + 1)),
            numbered(n),
            &over_time(trace, |sample| sample.q[i].to_degrees()),
        );
    }
    panel
}

fn pale(color: Color) -> Color {
    Color { 3: 0.09, ..color }
}

fn subscript(n: usize) -> char {
    ['₀', '₁', '₂', '₃', '₄', '₅', '₆', '₇', '₈', '₉'][n % 10]
}

/// How many times as large as the arm its tip's path is drawn.
const MAGNIFIED: f64 = 50.0;

/// Figures 1 and 2: a planar arm whose spare joint moves while its tip should stand still, under both projections on one scale.
fn null_space(pseudo_inverse: &Trace, consistent: &Trace) -> Figure {
    let traces = [
        ("Figure 1: pseudo-inverse", pseudo_inverse, RED),
        ("Figure 2: dynamically consistent", consistent, BLUE),
    ];
    // One frame around both.
    let places = traces.iter().flat_map(|(_, trace, _)| {
        trace
            .samples
            .iter()
            .flat_map(|sample| sample.arm.iter().chain([&sample.p]))
    });
    let (low, high) = places.fold(
        (
            Vector3::repeat(f64::INFINITY),
            Vector3::repeat(f64::NEG_INFINITY),
        ),
        |(low, high), p| (low.inf(p), high.sup(p)),
    );
    let room = 0.06 * (high - low).norm() + MAGNIFIED * 0.009;
    let axis =
        |i: usize| Axis::named(if i == 0 { "m" } else { "" }).within(low[i] - 0.1..high[i] + room);
    let arm = |title: &str, trace: &Trace, color: Color| {
        let mut panel = Panel::new(title, axis(0), axis(1));
        panel.equal = true;
        // The way there; the way back is the same.
        postures(&mut panel, trace, 0.0..=1.0, [Vector3::x(), Vector3::y()]);
        let start = trace
            .samples
            .first()
            .map_or(Vector3::zeros(), |sample| sample.p);
        let way = trace
            .samples
            .iter()
            .map(|sample| start + MAGNIFIED * (sample.p - start))
            .map(|p| (p.x, p.y))
            .collect::<Vec<_>>();
        panel.line(
            &format!("path of the tip, drawn {MAGNIFIED:.0} × as large"),
            color,
            &way,
        );
        panel
    };
    let arms = traces.map(|(title, trace, color)| arm(title, trace, color));
    let both = |title: &str, axis: Axis, of: &dyn Fn(&Sample) -> f64| {
        let mut panel = Panel::new(title, time(), axis);
        for (name, (_, trace, color)) in ["pseudo-inverse", "dynamically consistent"]
            .iter()
            .zip(&traces)
        {
            panel.line(name, *color, &over_time(trace, of));
        }
        panel
    };
    let error = both(
        "error of the tip, mm",
        Axis::default().logarithmic().within(1e-4..100.0),
        &|sample| sample.error_mm[0],
    );
    let force = both(
        "force of the null space on the tip, N",
        Axis::default().logarithmic().within(1e-16..100.0),
        &|sample| sample.coupling_n.map_or(f64::NAN, |force| force.max(1e-16)),
    );
    let angles = joint_angles(pseudo_inverse, "joint angles, °", 0..3);
    let [error_1, error_2] =
        [pseudo_inverse, consistent].map(|trace| trace.largest(|sample| sample.error_mm[0]));
    let [force_1, force_2] = [pseudo_inverse, consistent]
        .map(|trace| trace.largest(|sample| sample.coupling_n.unwrap_or_default()));
    Figure {
        name: "fig1-2",
        page: Page {
            title: "Figures 1 and 2: null-space motion, and its effect on the tip".to_owned(),
            subtitle: "planar arm of three joints: the posture changes and comes back while the tip should stand still (later is darker)"
                .to_owned(),
            rows: vec![Row::of(360.0, arms), Row::of(240.0, [error, force, angles])],
            notes: vec![
                format!(
                    "Largest error of the tip: {} mm with the pseudo-inverse, {} mm dynamically consistent.",
                    digits(error_1),
                    digits(error_2)
                ),
                format!(
                    "The torques meant for the null space push the tip with up to {} N (pseudo-inverse), {} N (dynamically consistent).",
                    digits(force_1),
                    digits(force_2)
                ),
            ],
            width: 980.0,
        },
        numbers: json!({
            "fig1": {"tip_error_max_mm": error_1, "coupling_max_n": force_1, "joint_1_moved_deg": pseudo_inverse.moved_deg(0, 1.0)},
            "fig2": {"tip_error_max_mm": error_2, "coupling_max_n": force_2, "joint_1_moved_deg": consistent.moved_deg(0, 1.0)},
        }),
    }
}

/// Figure 4: elbow and wrist locked at once, moved along ζ of the elbow.
fn two_locks(trace: &Trace) -> Figure {
    let zeta = trace.zeta_at_start(0);
    // Seen from the side: the arm's own plane.
    let up = Vector3::z();
    let horizontal = (zeta - up * zeta.dot(&up))
        .try_normalize(1e-9)
        .unwrap_or_else(Vector3::x);
    let horizontal = if trace
        .samples
        .first()
        .is_some_and(|sample| sample.p.dot(&horizontal) < 0.0)
    {
        -horizontal
    } else {
        horizontal
    };
    let mut arm = Panel::new(
        "from the side, m (later is darker)",
        Axis::default(),
        Axis::default(),
    );
    arm.equal = true;
    postures(&mut arm, trace, 0.0..=2.0, [horizontal, up]);

    let start = trace
        .samples
        .first()
        .map_or(Vector3::zeros(), |sample| sample.p);
    let mut along = Panel::new("way of the hand along ζ, mm", time(), Axis::default());
    let way = |p: &Vector3<f64>| (p - start).dot(&zeta) * 1e3;
    along.line("true", BLUE, &over_time(trace, |sample| way(&sample.p)));
    along.dashed("wanted", INK, &over_time(trace, |sample| way(&sample.p_d)));

    let mut error = Panel::new("position error, mm", time(), Axis::default());
    // By ζ at the start, which stays the direction of the task.
    let along_zeta = |sample: &Sample| (sample.p_d - sample.p).dot(&zeta).abs() * 1e3;
    let orthogonal_zeta = |sample: &Sample| {
        (sample.p_d - sample.p - zeta * zeta.dot(&(sample.p_d - sample.p))).norm() * 1e3
    };
    error.line("along ζ", RED, &over_time(trace, along_zeta));
    error.line("orthogonal to ζ", BLUE, &over_time(trace, orthogonal_zeta));
    let mut turn = Panel::new("orientation error, °", time(), Axis::default());
    turn.line("", BLUE, &over_time(trace, |sample| sample.error_deg[0]));
    let mut measures = Panel::new("singularity measures", time(), Axis::default());
    measures.band(
        "in both neighbourhoods",
        pale(BLUE),
        0.0..trace.inside_until(0).min(trace.inside_until(1)),
    );
    for (place, (name, kind)) in [("elbow", KIND_ELBOW), ("wrist", KIND_WRIST)]
        .into_iter()
        .enumerate()
    {
        let color = singularity_ink(kind);
        measures.line(name, color, &over_time(trace, |sample| sample.s[place]));
    }
    // Joints 2 and 5 turn by nearly the same angle: the one is dashed over the other.
    let mut angles = Panel::new("joint angles from the start, °", time(), Axis::default());
    for i in [0, 1, 2, 3, 5] {
        angles.line(
            &format!("q{}", subscript(i + 1)),
            numbered(i),
            &over_time(trace, |sample| sample.q[i].to_degrees()),
        );
    }
    angles.dashed(
        "q₅",
        numbered(4),
        &over_time(trace, |sample| sample.q[4].to_degrees()),
    );
    let angles = angles.shifted_to_start();
    let (along_mm, orthogonal_mm) = (trace.largest(along_zeta), trace.largest(orthogonal_zeta));
    let orientation = trace.largest(|sample| sample.error_deg[0]);
    let (end_mm, moved) = (
        trace.last(|sample| sample.error_mm[0]),
        trace.last(|sample| way(&sample.p)),
    );
    Figure {
        name: "fig4",
        page: Page {
            title: "Figure 4: elbow and wrist locked at once".to_owned(),
            subtitle: "PUMA 560, stretched: the hand moves along the direction that the elbow has lost, all else held".to_owned(),
            rows: vec![Row::of(280.0, [arm, along, error]), Row::of(250.0, [turn, measures, angles])],
            notes: vec![format!(
                "Moved {} mm inwards along ζ; largest error along ζ {} mm, orthogonal to ζ {} mm, orientation {}°; at the end {} mm.",
                digits(moved.abs()),
                digits(along_mm),
                digits(orthogonal_mm),
                digits(orientation),
                digits(end_mm)
            )],
            width: 980.0,
        },
        numbers: json!({"moved_mm": moved, "along_max_mm": along_mm, "orthogonal_max_mm": orthogonal_mm, "orientation_max_deg": orientation, "final_mm": end_mm}),
    }
}

/// Figure 5: wrist lock, ζ turned by null-space motion, then a rotation about the direction that was lost.
fn wrist_lock(trace: &Trace) -> Figure {
    let place = trace.place_of(KIND_WRIST);
    let zeta = trace.zeta_at_start(place);
    // Seen along ζ at the start: the rotation that was impossible is in the plane of the page.
    let up = (Vector3::z() - zeta * zeta.z)
        .try_normalize(1e-9)
        .unwrap_or_else(Vector3::x);
    let horizontal = up.cross(&zeta);
    let horizontal = if trace
        .samples
        .first()
        .is_some_and(|sample| sample.p.dot(&horizontal) < 0.0)
    {
        -horizontal
    } else {
        horizontal
    };
    let mut arm = Panel::new(
        "the hand turns, along the old ζ, m",
        Axis::default(),
        Axis::default(),
    );
    arm.equal = true;
    postures(
        &mut arm,
        trace,
        trace.phase_change()..=f64::INFINITY,
        [horizontal, up],
    );

    // Seen along axis 6, which the null motion turns about: ζ goes round, the hand stays.
    let pink = singularity_ink(KIND_WRIST);
    let mut null = Panel::new(
        "null motion, seen along axis 6",
        Axis::default().within(-1.3..1.3),
        Axis::default().within(-1.3..1.3),
    );
    (null.equal, null.x.hidden, null.y.hidden) = (true, true, true);
    let first = trace.samples.first();
    let [across, upwards] = [0, 1].map(|i| first.map_or_else(Vector3::x, |sample| sample.axis(i)));
    let on_page = |v: &Vector3<f64>, size: f64| {
        [-1.0, 1.0].map(|side| (side * size * v.dot(&across), side * size * v.dot(&upwards)))
    };
    let shown: Vec<&Sample> = trace
        .samples
        .iter()
        .filter(|sample| sample.t <= trace.phase_change())
        .collect();
    for k in 0..POSTURES {
        let Some(sample) = shown.get(k * shown.len().saturating_sub(1) / (POSTURES - 1)) else {
            continue;
        };
        let strength = 0.18 + 0.82 * k as f64 / (POSTURES - 1) as f64;
        null.arm(pink, strength, &on_page(&sample.zeta[place], 1.15));
        null.arm(BLUE, strength, &on_page(&sample.axis(0), 0.6));
    }
    null.line("ζ (later is darker)", pink, &[]);
    null.line("the hand's x axis", BLUE, &[]);

    let turned = |sample: &Sample| sample.zeta[place].angle(&zeta).to_degrees();
    let rotated = |sample: &Sample| {
        sample
            .turned_about(&zeta, trace.samples.first())
            .to_degrees()
    };
    let mut turn = Panel::new("turns, °", time(), Axis::default());
    turn.band("turning ζ", pale(BLUE), 0.0..trace.phase_change());
    turn.line(
        "ζ",
        pink,
        &over_time(trace, |sample| {
            if sample.t <= trace.phase_change() {
                turned(sample)
            } else {
                f64::NAN
            }
        }),
    );
    turn.line(
        "hand about ζ as it was",
        numbered(0),
        &over_time(trace, rotated),
    );
    let mut angles = joint_angles(trace, "wrist joints from the start, °", 3..6).shifted_to_start();
    angles.dashed(
        "",
        GREY,
        &[
            (0.0, 0.0),
            (trace.samples.last().map_or(0.0, |sample| sample.t), 0.0),
        ],
    );
    let mut position = Panel::new("position error, mm", time(), Axis::default());
    position.line("", RED, &over_time(trace, |sample| sample.error_mm[0]));
    let mut orientation = Panel::new("orientation error, °", time(), Axis::default());
    orientation.line("", RED, &over_time(trace, |sample| sample.error_deg[0]));
    let mut rates = Panel::new("wrist joint rates, °/s", time(), Axis::default());
    for (n, i) in (3..6).enumerate() {
        rates.line(
            &format!("q{}", subscript(i + 1)),
            numbered(n),
            &over_time(trace, |sample| sample.qdot[i].to_degrees()),
        );
    }
    let zeta_turned = trace
        .samples
        .iter()
        .filter(|sample| sample.t <= trace.phase_change())
        .map(turned)
        .fold(0.0, f64::max);
    let [q4, q5, q6] = [3, 4, 5].map(|i| trace.moved_deg(i, f64::INFINITY));
    let (mm, deg) = (
        trace.largest(|sample| sample.error_mm[0]),
        trace.largest(|sample| sample.error_deg[0]),
    );
    Figure {
        name: "fig5",
        page: Page {
            title: "Figure 5: wrist lock".to_owned(),
            subtitle: "PUMA 560: joints 4 and 6 turn the singular direction ζ while the hand stands still; then the hand rotates about it"
                .to_owned(),
            rows: vec![Row::of(300.0, [null, arm, turn]), Row::of(240.0, [angles, rates]), Row::of(220.0, [position, orientation])],
            notes: vec![
                format!(
                    "ζ turned by {zeta_turned:.2}°; then the hand by {:.2}°. Joint 4 moved by {q4:.2}°, joint 5 by {q5:.2}°, joint 6 by {q6:.2}°.",
                    trace.last(rotated)
                ),
                format!("Largest errors: position {} mm, orientation {}°.", digits(mm), digits(deg)),
            ],
            width: 980.0,
        },
        numbers: json!({"zeta_turned_deg": zeta_turned, "hand_turned_deg": trace.last(rotated).rem_euclid(TAU.to_degrees()), "q4_moved_deg": q4, "q5_moved_deg": q5, "q6_moved_deg": q6,
            "position_max_mm": mm, "orientation_max_deg": deg}),
    }
}
