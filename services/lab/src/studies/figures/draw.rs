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
    let traces: Result<Vec<_>, _> = traces.into_iter().collect();
    let traces = traces.map_err(Failure::input)?;
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

/// A curve over time: its name, its colour, its values.
type Curve<'a> = (&'a str, Color, &'a dyn Fn(&Sample) -> f64);

/// Quantities over time.
fn curves(title: &str, trace: &Trace, curves: &[Curve<'_>]) -> Panel {
    let mut panel = Panel::new(title, Axis::named("time, s"), Axis::default());
    for (name, color, of) in curves {
        panel.line(name, *color, &trace.over_time(of));
    }
    panel
}

/// One quantity of some joints, in degrees.
fn joints(title: &str, trace: &Trace, which: &[usize], of: fn(&Sample) -> &[f64]) -> Panel {
    let mut panel = curves(title, trace, &[]);
    for i in which {
        let values = trace.over_time(&|sample: &Sample| of(sample)[*i].to_degrees());
        panel.line(SUBSCRIPTED[*i], numbered(i - which[0]), &values);
    }
    panel
}

const SUBSCRIPTED: [&str; 6] = ["q₁", "q₂", "q₃", "q₄", "q₅", "q₆"];

/// A picture without a distorted scale.
fn undistorted(title: &str, x: Axis, y: Axis) -> Panel {
    let mut panel = Panel::new(title, x, y);
    panel.equal = true;
    panel
}

/// Moments at even steps of time, each with its strength: later ones are darker.
fn moments(trace: &Trace, from: f64, to: f64) -> impl Iterator<Item = (f64, &Sample)> {
    let within = trace.samples.iter();
    let within: Vec<_> = within
        .filter(|sample| (from..=to).contains(&sample.t))
        .collect();
    let last = within.len().saturating_sub(1);
    (0..POSTURES).filter_map(move |k| {
        let sample = within.get(k * last / (POSTURES - 1))?;
        Some((0.18 + 0.82 * k as f64 / (POSTURES - 1) as f64, *sample))
    })
}

/// The smallest box around both.
fn frame(traces: [&Trace; 2]) -> (Vector3<f64>, Vector3<f64>) {
    let samples = traces.into_iter().flat_map(|trace| &trace.samples);
    let places = samples.flat_map(|sample| sample.arm.iter().chain([&sample.p]));
    let none = Vector3::repeat(f64::INFINITY);
    places.fold((none, -none), |(low, high), p| (low.inf(p), high.sup(p)))
}

/// The arm during half a swing, and the path of its tip.
fn swing(mut panel: Panel, trace: &Trace, color: Color) -> Panel {
    let axes = [Vector3::x(), Vector3::y()];
    postures(&mut panel, moments(trace, 0.0, SWING_S), axes);
    let start = trace.start();
    let samples = trace.samples.iter();
    let path = samples.map(|sample| start + MAGNIFIED * (sample.p - start));
    let path: Vec<_> = path.map(|p| (p.x, p.y)).collect();
    let name = format!("path of the tip, drawn {MAGNIFIED:.0} × as large");
    panel.line(&name, color, &path);
    panel
}

/// How ζ and the hand turn; until `change` the hand stands still.
fn turns(trace: &Trace, change: f64, [zeta, hand]: [&dyn Fn(&Sample) -> f64; 2]) -> Panel {
    let mut turn = curves("turns, °", trace, &[]);
    turn.band("turning ζ", pale(BLUE), 0.0..change);
    let pink = singularity_ink(KIND_WRIST);
    turn.line("ζ", pink, &trace.over_time(zeta));
    let about = trace.over_time(hand);
    turn.line("hand about ζ as it was", numbered(0), &about);
    turn
}

/// The arm in these moments, seen along the normal of two axes.
fn seen<'a>(
    title: &str,
    moments: impl Iterator<Item = (f64, &'a Sample)>,
    axes: [Vector3<f64>; 2],
) -> Panel {
    let mut panel = undistorted(title, Axis::default(), Axis::default());
    postures(&mut panel, moments, axes);
    panel
}

/// The measures of elbow and wrist, and while both are inside their neighbourhoods.
fn measures(trace: &Trace) -> Panel {
    let mut measures = curves("singularity measures", trace, &[]);
    let until = trace.inside_until(0).min(trace.inside_until(1));
    measures.band("in both neighbourhoods", pale(BLUE), 0.0..until);
    for (place, name, kind) in [(0, "elbow", KIND_ELBOW), (1, "wrist", KIND_WRIST)] {
        let s = trace.over_time(&|sample: &Sample| sample.s[place]);
        measures.line(name, singularity_ink(kind), &s);
    }
    measures
}

/// The arm at these moments, seen along the third of three axes.
fn postures<'a>(
    panel: &mut Panel,
    moments: impl Iterator<Item = (f64, &'a Sample)>,
    axes: [Vector3<f64>; 2],
) {
    for (strength, sample) in moments {
        let arm = sample.arm.iter();
        let arm: Vec<_> = arm.map(|p| (p.dot(&axes[0]), p.dot(&axes[1]))).collect();
        panel.arm(BLUE, strength, &arm);
    }
}

fn pale(color: Color) -> Color {
    Color { 3: 0.09, ..color }
}

/// A figure with rows of panels of these heights.
fn figure(
    name: &'static str,
    [title, subtitle]: [&str; 2],
    rows: Vec<Row>,
    notes: Vec<String>,
    numbers: Value,
) -> Figure {
    Figure {
        name,
        page: Page {
            title: title.to_owned(),
            subtitle: subtitle.to_owned(),
            rows,
            notes,
            width: 980.0,
        },
        numbers,
    }
}

/// Half a swing of the null space; s.
const SWING_S: f64 = 0.33;
/// How many times as large as the arm its tip's path is drawn.
const MAGNIFIED: f64 = 50.0;

/// Figures 1 and 2: a planar arm whose null space swings in an attractive potential without dissipation while its tip should stand still, under both
/// projections on one scale.
fn null_space(pseudo_inverse: &Trace, consistent: &Trace) -> Figure {
    let traces = [
        ("Figure 1: pseudo-inverse", pseudo_inverse, RED),
        ("Figure 2: dynamically consistent", consistent, BLUE),
    ];
    let (low, high) = frame([pseudo_inverse, consistent]);
    let room = 0.06 * (high - low).norm() + MAGNIFIED * 0.009;
    let axis = |i: usize, name| Axis::named(name).within(low[i] - 0.1..high[i] + room);
    let arms = traces.map(|(title, trace, color)| {
        swing(undistorted(title, axis(0, "m"), axis(1, "")), trace, color)
    });
    let both = |title: &str, least: f64, of: &dyn Fn(&Sample) -> f64| {
        let mut panel = curves(title, pseudo_inverse, &[("pseudo-inverse", RED, of)]);
        let other = consistent.over_time(of);
        panel.line("dynamically consistent", BLUE, &other);
        panel.y = Axis::default().logarithmic().within(least..100.0);
        panel
    };
    let error = |sample: &Sample| sample.error_mm[0];
    let force = |sample: &Sample| sample.coupling_n.map_or(f64::NAN, |force| force.max(1e-16));
    let below = [
        both("error of the tip, mm", 1e-4, &error),
        both("force of the null space on the tip, N", 1e-16, &force),
    ];
    let angles = traces.map(|(title, trace, _)| {
        let title = format!("{title}: joint angles, °");
        joints(&title, trace, &[0, 1, 2], |sample| &sample.q)
    });
    let swings = |trace: &Trace| [0.0, 1.0].map(|from| trace.swing_deg(1, from..from + 1.0));
    let of = |trace: &Trace| {
        let force = |sample: &Sample| sample.coupling_n.unwrap_or_default();
        (trace.largest(error), trace.largest(force))
    };
    let [one, two] = [of(pseudo_inverse), of(consistent)];
    let [mm, n, mm_2, n_2] = [one.0, one.1, two.0, two.1].map(digits);
    let numbers = |(error, force): (f64, f64), trace: &Trace| json!({"tip_error_max_mm": error, "coupling_max_n": force, "joint_2_swings_deg": swings(trace)});
    figure(
        "fig1-2",
        [
            "Figures 1 and 2: null-space motion, and its effect on the tip",
            "planar arm of three joints: the null space swings in an attractive potential without dissipation while the tip should stand still; above, half a swing (later is darker)",
        ],
        vec![
            Row::of(360.0, arms),
            Row::of(240.0, below),
            Row::of(200.0, angles),
        ],
        vec![
            format!(
                "Largest error of the tip: {mm} mm with the pseudo-inverse, {mm_2} mm dynamically consistent."
            ),
            format!(
                "The torques meant for the null space push the tip with up to {n} N (pseudo-inverse), {n_2} N (dynamically consistent)."
            ),
        ],
        json!({"fig1": numbers(one, pseudo_inverse), "fig2": numbers(two, consistent)}),
    )
}

/// Figure 4: elbow and wrist locked at once, moved along ζ of the elbow.
fn two_locks(trace: &Trace) -> Figure {
    let zeta = trace.zeta_at_start(0);
    // Seen from the side: the arm's own plane.
    let up = Vector3::z();
    let horizontal = trace.outwards((zeta - up * zeta.dot(&up)).try_normalize(1e-9));
    let title = "from the side, m (later is darker)";
    let arm = seen(title, moments(trace, 0.0, 2.0), [horizontal, up]);
    let start = trace.start();
    let way = |p: &Vector3<f64>| (p - start).dot(&zeta) * 1e3;
    let true_way = |sample: &Sample| way(&sample.p);
    let title = "way of the hand along ζ, mm";
    let mut along = curves(title, trace, &[("true", BLUE, &true_way)]);
    let wanted = trace.over_time(&|sample: &Sample| way(&sample.p_d));
    along.dashed("wanted", INK, &wanted);

    // By ζ at the start, which stays the direction of the task.
    let along_zeta = |sample: &Sample| (sample.p_d - sample.p).dot(&zeta).abs() * 1e3;
    let orthogonal_zeta = |sample: &Sample| {
        (sample.p_d - sample.p - zeta * zeta.dot(&(sample.p_d - sample.p))).norm() * 1e3
    };
    let error = curves(
        "position error, mm",
        trace,
        &[
            ("along ζ", RED, &along_zeta),
            ("orthogonal to ζ", BLUE, &orthogonal_zeta),
        ],
    );
    let orientation = |sample: &Sample| sample.error_deg[0];
    let turn = curves("orientation error, °", trace, &[("", BLUE, &orientation)]);
    // Joints 2 and 5 turn by nearly the same angle: the one is dashed over the other.
    let title = "joint angles from the start, °";
    let mut angles = joints(title, trace, &[0, 1, 2, 3, 5], |sample| &sample.q);
    let fifth = trace.over_time(&|sample: &Sample| sample.q[4].to_degrees());
    angles.dashed(SUBSCRIPTED[4], numbered(4), &fifth);
    let (along_mm, orthogonal_mm) = (trace.largest(along_zeta), trace.largest(orthogonal_zeta));
    let orientation = trace.largest(orientation);
    let end_mm = trace.last(|sample| sample.error_mm[0]);
    let moved = trace.last(true_way);
    figure(
        "fig4",
        [
            "Figure 4: elbow and wrist locked at once",
            "PUMA 560, stretched: the hand moves along the direction that the elbow has lost, all else held",
        ],
        vec![
            Row::of(280.0, [arm, along, error]),
            Row::of(250.0, [turn, measures(trace), angles.shifted_to_start()]),
        ],
        vec![format!(
            "Moved {} mm inwards along ζ; largest error along ζ {} mm, orthogonal to ζ {} mm, orientation {}°; at the end {} mm.",
            digits(moved.abs()),
            digits(along_mm),
            digits(orthogonal_mm),
            digits(orientation),
            digits(end_mm)
        )],
        json!({"moved_mm": moved, "along_max_mm": along_mm, "orthogonal_max_mm": orthogonal_mm, "orientation_max_deg": orientation, "final_mm": end_mm}),
    )
}

/// Figure 5: wrist lock, ζ turned by null-space motion, then a rotation about the direction that was lost.
fn wrist_lock(trace: &Trace) -> Figure {
    let (place, change) = (trace.place_of(KIND_WRIST), trace.phase_change());
    let zeta = trace.zeta_at_start(place);
    // Seen along ζ at the start: the rotation that was impossible is in the plane of the page.
    let up = (Vector3::z() - zeta * zeta.z)
        .try_normalize(1e-9)
        .unwrap_or_else(Vector3::x);
    let horizontal = trace.outwards(Some(up.cross(&zeta)));
    let turning = moments(trace, change, f64::INFINITY);
    let title = "the hand turns, along the old ζ, m";
    let arm = seen(title, turning, [horizontal, up]);
    let turned = |sample: &Sample| sample.zeta[place].angle(&zeta).to_degrees();
    let before = |sample: &Sample| match sample.t <= change {
        true => turned(sample),
        false => f64::NAN,
    };
    let first = trace.samples.first();
    let rotated = |sample: &Sample| sample.turned_about(&zeta, first).to_degrees();
    let turn = turns(trace, change, [&before, &rotated]);
    let wrist = [3, 4, 5];
    let title = "wrist joints from the start, °";
    let mut angles = joints(title, trace, &wrist, |sample| &sample.q).shifted_to_start();
    let end = trace.last(|sample| sample.t);
    angles.dashed("", GREY, &[(0.0, 0.0), (end, 0.0)]);
    let title = "wrist joint rates, °/s";
    let rates = joints(title, trace, &wrist, |sample| &sample.qdot);
    let mm = |sample: &Sample| sample.error_mm[0];
    let deg = |sample: &Sample| sample.error_deg[0];
    let errors = [
        curves("position error, mm", trace, &[("", RED, &mm)]),
        curves("orientation error, °", trace, &[("", RED, &deg)]),
    ];
    let zeta_turned = trace.largest(|sample| before(sample).max(0.0));
    let (mm, deg) = (trace.largest(mm), trace.largest(deg));
    let [position, orientation] = [mm, deg].map(digits);
    let hand_turned = trace.last(rotated);
    let [q4, q5, q6] = wrist.map(|i| trace.moved_deg(i, f64::INFINITY));
    figure(
        "fig5",
        [
            "Figure 5: wrist lock",
            "PUMA 560: joints 4 and 6 turn the singular direction ζ while the hand stands still; then the hand rotates about it",
        ],
        vec![
            Row::of(300.0, [null_motion(trace, place), arm, turn]),
            Row::of(240.0, [angles, rates]),
            Row::of(220.0, errors),
        ],
        vec![
            format!(
                "ζ turned by {zeta_turned:.2}°; then the hand by {hand_turned:.2}°. Joint 4 moved by {q4:.2}°, joint 5 by {q5:.2}°, joint 6 by {q6:.2}°."
            ),
            format!("Largest errors: position {position} mm, orientation {orientation}°."),
        ],
        json!({"zeta_turned_deg": zeta_turned, "hand_turned_deg": hand_turned.rem_euclid(TAU.to_degrees()), "q4_moved_deg": q4, "q5_moved_deg": q5, "q6_moved_deg": q6,
            "position_max_mm": mm, "orientation_max_deg": deg}),
    )
}

/// Seen along axis 6, which the null motion turns about: ζ goes round, the hand stays.
fn null_motion(trace: &Trace, place: usize) -> Panel {
    let pink = singularity_ink(KIND_WRIST);
    let axis = || Axis {
        hidden: true,
        ..Axis::default().within(-1.3..1.3)
    };
    let mut null = undistorted("null motion, seen along axis 6", axis(), axis());
    let first = trace.samples.first();
    let [across, upwards] = [0, 1].map(|i| first.map_or_else(Vector3::x, |sample| sample.axis(i)));
    let on_page = |v: &Vector3<f64>, size: f64| {
        [-size, size].map(|size| (size * v.dot(&across), size * v.dot(&upwards)))
    };
    for (strength, sample) in moments(trace, 0.0, trace.phase_change()) {
        null.arm(pink, strength, &on_page(&sample.zeta[place], 1.15));
        null.arm(BLUE, strength, &on_page(&sample.axis(0), 0.6));
    }
    null.line("ζ (later is darker)", pink, &[]);
    null.line("the hand's x axis", BLUE, &[]);
    null
}
