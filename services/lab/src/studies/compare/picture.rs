//! The tables as pictures: small bars, one row a law.

use lines::KINDS;
use shared_types::scenario::{Goal, Scenario};
use viz::plot::{Axis, BLUE, Color, GREY, Page, Panel, RED, Row, digits, numbered};

use super::law::name_of;
use super::score::{Bounds, Score};
use super::sweep::Sweep;
use super::verdict::{failures, margin, verdicts};

/// Height of the row of a law, and of what surrounds the rows; points.
const LAW: f64 = 22.0;
const AROUND: f64 = 84.0;

/// A number of each score: title, value, the bar of S2, logarithmic.
type Metric = (&'static str, fn(&Score) -> f64, Option<f64>, bool);

fn metrics() -> [[Metric; 3]; 3] {
    let (s2, goal) = (Bounds::s2(), Goal::default());
    [
        [
            (
                "error orthogonal to ζ, mm",
                |score| score.orthogonal_max_mm,
                Some(s2.orthogonal_mm),
                true,
            ),
            (
                "error along ζ, mm",
                |score| score.along_max_mm,
                Some(s2.along_mm),
                true,
            ),
            (
                "error at the end, mm",
                |score| score.final_mm,
                Some(goal.position_mm),
                true,
            ),
        ],
        [
            (
                "error orthogonal to ζ, °",
                |score| score.orthogonal_max_deg,
                Some(s2.orthogonal_deg),
                true,
            ),
            (
                "error along ζ, °",
                |score| score.along_max_deg,
                Some(s2.along_deg),
                true,
            ),
            (
                "error at the end, °",
                |score| score.final_deg,
                Some(goal.orientation_deg),
                true,
            ),
        ],
        [
            (
                "peak joint speed, share of limit",
                |score| score.speed_max_ratio,
                Some(1.0),
                false,
            ),
            (
                "largest torque step, share of limit",
                |score| score.torque_step_max_ratio,
                None,
                false,
            ),
            (
                "energy put in by jumps, J",
                |score| score.jump_energy_j,
                Some(0.5),
                true,
            ),
        ],
    ]
}

/// The foot of a logarithmic bar.
const LEAST: f64 = 1e-4;

/// One scenario under each law.
pub(super) fn scenario(scenario: &Scenario, scores: &[Score]) -> Page {
    let names = || scores.iter().map(|score| score.law.clone());
    let rows = metrics().into_iter().map(|metrics| {
        let panels = metrics.iter().enumerate().map(|(column, metric)| {
            let y = if column == 0 {
                Axis::names(names())
            } else {
                Axis {
                    hidden: true,
                    ..Axis::names(names())
                }
            };
            let mut panel = bars(metric, scores, y);
            panel.share = if column == 0 { 1.5 } else { 1.0 };
            panel
        });
        Row::of(LAW * scores.len() as f64 + AROUND, panels)
    });
    let mut notes: Vec<String> = scores
        .iter()
        .zip(verdicts(scores))
        .map(|(score, verdict)| format!("{}: {verdict}", score.law))
        .collect();
    notes.extend(failures(scores).into_iter().chain(margin(scores)));
    Page {
        title: format!("{}, every law on the same plant and seed", scenario.name),
        subtitle: scenario.title.clone(),
        rows: rows.collect(),
        notes,
        width: 1000.0,
    }
}

fn bars((title, value, bar, logarithmic): &Metric, scores: &[Score], y: Axis) -> Panel {
    let finished = || {
        scores
            .iter()
            .filter(|score| score.completed)
            .map(value)
            .chain(*bar)
    };
    let largest = finished().fold(LEAST, f64::max);
    let x = if *logarithmic {
        Axis::default()
            .logarithmic()
            .within(LEAST..10f64.powf((1.5 * largest).log10().ceil()))
    } else {
        Axis::default().within(0.0..1.25 * largest.max(0.8))
    };
    let mut panel = Panel::new(title, x, y);
    for (row, score) in scores.iter().enumerate() {
        if !score.completed {
            panel.bar(row, 0.0, GREY, "stopped".to_owned());
            continue;
        }
        let size = value(score);
        let color = if bar.is_some_and(|bar| size >= bar) {
            RED
        } else {
            BLUE
        };
        panel.bar(row, size, color, digits(size));
    }
    if let Some(bar) = bar {
        panel.dashed(
            &format!("bar: {bar}"),
            GREY,
            &[(*bar, -0.5), (*bar, scores.len() as f64 - 0.5)],
        );
    }
    panel
}

/// Success of each law near each singularity.
pub(super) fn sweep(sweep: &Sweep) -> Page {
    let names = || sweep.laws.iter().map(|(law, _)| law.name().to_owned());
    let near = [None].into_iter().chain(KINDS.map(Some));
    let panels = near.enumerate().map(|(column, near)| {
        let title = near.map_or("all lines".to_owned(), |kind| {
            format!("near {} lock", name_of(kind))
        });
        let y = if column == 0 {
            Axis::names(names())
        } else {
            Axis {
                hidden: true,
                ..Axis::names(names())
            }
        };
        let mut panel = Panel::new(&title, Axis::named("% of the lines").within(0.0..118.0), y);
        let pale = |color: Color| Color { 3: 0.35, ..color };
        for (row, (law, scores)) in sweep.laws.iter().enumerate() {
            let color = numbered(usize::from(!law.is_ours()));
            let share = |so: fn(&Score) -> bool| {
                let (yes, all) = sweep.count(scores, near, so);
                100.0 * yes as f64 / all.max(1) as f64
            };
            let (s1, s2) = (share(|score| score.s1), share(|score| score.s2));
            panel.bar(row, s2, pale(color), format!("{s2:.0}"));
            panel.bar(row, s1, color, String::new());
        }
        panel.share = if column == 0 { 1.5 } else { 1.0 };
        panel
    });
    Page {
        title: format!("{} straight lines through and near each singularity, {} m/s", sweep.near.len(), sweep.speed),
        subtitle: format!("PUMA 560, every law on the same lines, plant and seed ({})", sweep.seed),
        rows: vec![Row::of(24.0 * sweep.laws.len() as f64 + AROUND, panels)],
        notes: vec!["Full bars: S1; with the pale part: S2, which is the number. Their bounds: armplane compare --help.".to_owned()],
        width: 1100.0,
    }
}
