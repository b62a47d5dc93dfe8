//! Chang & Khatib's Figures 1, 2, 4 and 5, drawn from runs just made.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use nalgebra::Vector3;
use serde_json::{Value, json};
use session::{Failure, Observer, Results, load};
use shared_types::codes::KIND_WRIST;
use viz::plot::{Axis, BLUE, Color, GREY, INK, Page, Panel, PlotError, RED, Row, digits, numbered};

use super::trace::{Sample, Trace};
use crate::pool::on_all_cores;

/// The scenarios that the figures show.
const SCENARIOS: [&str; 4] = ["fig1-pseudo-inverse", "fig2-dynamically-consistent", "fig4-elbow-and-wrist", "fig5-wrist-rotation"];

/// How many postures of the arm are drawn.
const POSTURES: usize = 9;

/// A figure with its numbers.
pub struct Figure {
    /// `fig1`.
    pub name: &'static str,
    /// The picture.
    pub page: Page,
    /// Its numbers.
    pub numbers: Value,
}

/// A figure and its files, SVG and PNG.
pub type Saved = (Figure, [PathBuf; 2]);

/// Runs the scenarios of the figures, with other values laid over them, and saves pictures and `figures.json` in the folder `out`, or the next
/// free `runs/figures-NNN`. Returns the figures with their files, and the numbers.
///
/// # Errors
/// [`Failure`] where a scenario cannot be run, or a file cannot be written.
pub fn figures(settings: &[String], out: Option<&Path>, observer: Observer<'_>) -> Result<(Vec<Saved>, Value), Failure> {
    let loaded = SCENARIOS.iter().map(|name| load::scenario(name, settings, None)).collect::<Result<Vec<_>, _>>()?;
    let results = Results::create(out, "figures")?;
    let traces = on_all_cores("figures", &loaded, |loaded| Trace::of(&loaded.robot, &loaded.scenario), observer);
    let traces = traces.into_iter().collect::<Result<Vec<_>, _>>().map_err(Failure::input)?;
    let [pseudo_inverse, consistent, fig4, fig5] = traces.as_slice() else { return Err(Failure::work("a figure's run is missing")) };
    let figures = [
        null_space(
            "fig1",
            "Figure 1: null-space motion through the pseudo-inverse",
            pseudo_inverse,
            ("dynamically consistent", consistent),
        ),
        null_space("fig2", "Figure 2: null-space motion, dynamically consistent", consistent, ("pseudo-inverse", pseudo_inverse)),
        two_locks(fig4),
        wrist_lock(fig5),
    ];
    let numbers = figures.iter().map(|figure| (figure.name.to_owned(), figure.numbers.clone())).collect();
    let save = |figure: Figure| figure.page.save(&results.folder.join(figure.name)).map(|files| (figure, files));
    let figures = figures.into_iter().map(save).collect::<Result<Vec<_>, PlotError>>().map_err(Failure::work)?;
    let numbers = Value::Object(numbers);
    results.save("figures.json", &numbers)?;
    Ok((figures, numbers))
}

fn time() -> Axis {
    Axis::named("time, s")
}

/// A quantity over time.
fn over_time(trace: &Trace, of: impl Fn(&Sample) -> f64) -> Vec<(f64, f64)> {
    trace.samples.iter().map(|sample| (sample.t, of(sample))).collect()
}

/// The arm at even steps of time, later ones stronger, seen along the third of three axes.
fn postures(panel: &mut Panel, trace: &Trace, range: std::ops::RangeInclusive<f64>, axes: [Vector3<f64>; 2]) {
    let shown: Vec<_> = trace.samples.iter().filter(|sample| range.contains(&sample.t)).collect();
    for k in 0..POSTURES {
        let Some(sample) = shown.get(k * (shown.len().saturating_sub(1)) / (POSTURES - 1)) else { continue };
        let joints: Vec<_> = sample.arm.iter().map(|p| (p.dot(&axes[0]), p.dot(&axes[1]))).collect();
        panel.arm(BLUE, 0.18 + 0.82 * k as f64 / (POSTURES - 1) as f64, &joints);
    }
}

fn joint_angles(trace: &Trace, title: &str, joints: std::ops::Range<usize>) -> Panel {
    let mut panel = Panel::new(title, time(), Axis::default());
    for (n, i) in joints.enumerate() {
        panel.line(&format!("q{}", subscript(i + 1)), numbered(n), &over_time(trace, |sample| sample.q[i].to_degrees()));
    }
    panel
}

fn pale(color: Color) -> Color {
    Color { 3: 0.09, ..color }
}

fn subscript(n: usize) -> char {
    ['₀', '₁', '₂', '₃', '₄', '₅', '₆', '₇', '₈', '₉'][n % 10]
}

/// Figures 1 and 2: a planar arm whose spare joint moves while its tip should stand still.
fn null_space(name: &'static str, title: &str, trace: &Trace, other: (&str, &Trace)) -> Figure {
    let mut arm = Panel::new("postures, m (later is darker)", Axis::default(), Axis::default());
    arm.equal = true;
    // The way there; the way back is the same.
    postures(&mut arm, trace, 0.0..=1.0, [Vector3::x(), Vector3::y()]);
    let start = trace.samples.first().map_or(Vector3::zeros(), |sample| sample.p);
    let way: Vec<_> = trace.samples.iter().map(|sample| (sample.p - start) * 1e3).map(|way| (way.x, way.y)).collect();
    let mut path = Panel::new("path of the tip, mm", Axis::default().within(-10.0..10.0), Axis::default().within(-10.0..10.0));
    path.equal = true;
    path.line("", RED, &way);
    path.dots(INK, 2.5, &[(0.0, 0.0)]);
    let mut error = Panel::new("error of the tip, mm", time(), Axis::default().logarithmic().within(1e-4..100.0));
    let tip = |trace| over_time(trace, |sample: &Sample| sample.error_mm[0]);
    error.dashed(other.0, GREY, &tip(other.1));
    error.line("this figure", RED, &tip(trace));
    let angles = joint_angles(trace, "joint angles, °", 0..3);
    let [largest, others] = [trace, other.1].map(|trace| trace.largest(|sample| sample.error_mm[0]));
    Figure {
        name,
        page: Page {
            title: title.to_owned(),
            subtitle: "planar arm of three joints: the posture changes and comes back while the tip should stand still".to_owned(),
            rows: vec![Row::of(330.0, [arm, path]), Row::of(240.0, [error, angles])],
            notes: vec![format!("Largest error of the tip {} mm; {} {} mm.", digits(largest), other.0, digits(others))],
            width: 820.0,
        },
        numbers: json!({"tip_error_max_mm": largest, "joint_1_moved_deg": trace.moved_deg(0, 1.0)}),
    }
}

/// Figure 4: elbow and wrist locked at once, moved along ζ of the elbow.
fn two_locks(trace: &Trace) -> Figure {
    let zeta = trace.zeta_at_start(0);
    // Seen from the side: the arm's own plane.
    let up = Vector3::z();
    let horizontal = (zeta - up * zeta.dot(&up)).try_normalize(1e-9).unwrap_or_else(Vector3::x);
    let horizontal = if trace.samples.first().is_some_and(|sample| sample.p.dot(&horizontal) < 0.0) { -horizontal } else { horizontal };
    let mut arm = Panel::new("from the side, m (later is darker)", Axis::default(), Axis::default());
    arm.equal = true;
    postures(&mut arm, trace, 0.0..=2.0, [horizontal, up]);

    let start = trace.samples.first().map_or(Vector3::zeros(), |sample| sample.p);
    let mut along = Panel::new("way of the hand along ζ, mm", time(), Axis::default());
    let way = |p: &Vector3<f64>| (p - start).dot(&zeta) * 1e3;
    along.line("true", BLUE, &over_time(trace, |sample| way(&sample.p)));
    along.dashed("wanted", INK, &over_time(trace, |sample| way(&sample.p_d)));

    let mut error = Panel::new("position error, mm", time(), Axis::default());
    // By ζ at the start, which stays the direction of the task.
    let along_zeta = |sample: &Sample| (sample.p_d - sample.p).dot(&zeta).abs() * 1e3;
    let orthogonal_zeta = |sample: &Sample| (sample.p_d - sample.p - zeta * zeta.dot(&(sample.p_d - sample.p))).norm() * 1e3;
    error.line("along ζ", RED, &over_time(trace, along_zeta));
    error.line("orthogonal to ζ", BLUE, &over_time(trace, orthogonal_zeta));
    let mut turn = Panel::new("orientation error, °", time(), Axis::default());
    turn.line("", BLUE, &over_time(trace, |sample| sample.error_deg[0]));
    let mut measures = Panel::new("singularity measures", time(), Axis::default());
    measures.band("in both neighbourhoods", pale(BLUE), 0.0..trace.inside_until(0).min(trace.inside_until(1)));
    for (place, (name, color)) in [("elbow", numbered(0)), ("wrist", numbered(1))].into_iter().enumerate() {
        measures.line(name, color, &over_time(trace, |sample| sample.s[place]));
    }
    let angles = joint_angles(trace, "joint angles from the start, °", 0..6).shifted_to_start();
    let (along_mm, orthogonal_mm) = (trace.largest(along_zeta), trace.largest(orthogonal_zeta));
    let orientation = trace.largest(|sample| sample.error_deg[0]);
    let (end_mm, moved) = (trace.last(|sample| sample.error_mm[0]), trace.last(|sample| way(&sample.p)));
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
    let up = (Vector3::z() - zeta * zeta.z).try_normalize(1e-9).unwrap_or_else(Vector3::x);
    let horizontal = up.cross(&zeta);
    let horizontal = if trace.samples.first().is_some_and(|sample| sample.p.dot(&horizontal) < 0.0) { -horizontal } else { horizontal };
    let mut arm = Panel::new("seen along ζ, m (later is darker)", Axis::default(), Axis::default());
    arm.equal = true;
    postures(&mut arm, trace, trace.phase_change()..=f64::INFINITY, [horizontal, up]);

    let turned = |sample: &Sample| sample.zeta[place].angle(&zeta).to_degrees();
    let rotated = |sample: &Sample| sample.turned_about(&zeta, trace.samples.first()).to_degrees();
    let mut turn = Panel::new("turns, °", time(), Axis::default());
    turn.band("turning ζ", pale(BLUE), 0.0..trace.phase_change());
    turn.line("ζ", numbered(1), &over_time(trace, |sample| if sample.t <= trace.phase_change() { turned(sample) } else { f64::NAN }));
    turn.line("hand about ζ as it was", numbered(0), &over_time(trace, rotated));
    let mut angles = joint_angles(trace, "wrist joints from the start, °", 3..6).shifted_to_start();
    angles.dashed("", GREY, &[(0.0, 0.0), (trace.samples.last().map_or(0.0, |sample| sample.t), 0.0)]);
    let mut position = Panel::new("position error, mm", time(), Axis::default());
    position.line("", RED, &over_time(trace, |sample| sample.error_mm[0]));
    let mut orientation = Panel::new("orientation error, °", time(), Axis::default());
    orientation.line("", RED, &over_time(trace, |sample| sample.error_deg[0]));
    let mut rates = Panel::new("wrist joint rates, °/s", time(), Axis::default());
    for (n, i) in (3..6).enumerate() {
        rates.line(&format!("q{}", subscript(i + 1)), numbered(n), &over_time(trace, |sample| sample.qdot[i].to_degrees()));
    }
    let zeta_turned = trace.samples.iter().filter(|sample| sample.t <= trace.phase_change()).map(turned).fold(0.0, f64::max);
    let [q4, q5, q6] = [3, 4, 5].map(|i| trace.moved_deg(i, f64::INFINITY));
    let (mm, deg) = (trace.largest(|sample| sample.error_mm[0]), trace.largest(|sample| sample.error_deg[0]));
    Figure {
        name: "fig5",
        page: Page {
            title: "Figure 5: wrist lock".to_owned(),
            subtitle: "PUMA 560: joints 4 and 6 turn the singular direction ζ while the hand stands still; then the hand rotates about it"
                .to_owned(),
            rows: vec![Row::of(280.0, [arm, turn, angles]), Row::of(250.0, [position, orientation, rates])],
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
