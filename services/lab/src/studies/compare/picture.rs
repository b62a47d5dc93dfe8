//! The tables as pictures: small bars, one row a law.

use lines::KINDS;
use recorder::Bounds;
use shared_types::scenario::Goal;
use viz::plot::{Axis, BLUE, Color, GREY, Page, Panel, RED, Row as Panels, digits, numbered};

use super::verdict::{findings, verdicts};
use super::{Compared, name_of};
use crate::row::Row;

/// Height of the row of a law, and of what surrounds the rows; points.
const LAW: f64 = 22.0;
const AROUND: f64 = 84.0;
/// The foot of a logarithmic bar.
const LEAST: f64 = 1e-4;

/// A number of each row: title, value, the bar of S2, logarithmic.
type Metric = (&'static str, fn(&Row) -> f64, Option<f64>, bool);

fn metrics() -> [[Metric; 3]; 3] {
    let (s2, goal) = (Bounds::s2(), Goal::default());
    let error = |title, of: fn(&Row) -> f64, bar| (title, of, Some(bar), true);
    let [mm, deg]: [[Metric; 3]; 2] = [
        [
            error(
                "error orthogonal to ζ, mm",
                |row| row.task.orthogonal_max_mm,
                s2.orthogonal_mm,
            ),
            error(
                "error along ζ, mm",
                |row| row.task.along_max_mm,
                s2.along_mm,
            ),
            error(
                "error at the end, mm",
                |row| row.task.final_position_mm,
                goal.position_mm,
            ),
        ],
        [
            error(
                "error orthogonal to ζ, °",
                |row| row.task.orthogonal_max_deg,
                s2.orthogonal_deg,
            ),
            error(
                "error along ζ, °",
                |row| row.task.along_max_deg,
                s2.along_deg,
            ),
            error(
                "error at the end, °",
                |row| row.task.final_orientation_deg,
                goal.orientation_deg,
            ),
        ],
    ];
    let loads: [Metric; 3] = [
        (
            "peak joint speed, share of limit",
            |row| row.joints.speed_max_ratio,
            Some(1.0),
            false,
        ),
        (
            "largest torque step, share of limit",
            |row| row.joints.torque_step_max_ratio,
            None,
            false,
        ),
        error(
            "energy put in by jumps, J",
            |row| row.joints.jump_energy_j,
            0.5,
        ),
    ];
    [mm, deg, loads]
}

/// A row of panels with a law a line, named in the first one.
fn by_law(
    height: f64,
    compared: &Compared,
    panels: impl IntoIterator<Item = impl Fn(Axis) -> Panel>,
) -> Panels {
    let names = || compared.laws.iter().map(|(law, _)| law.name().to_owned());
    let panels = panels.into_iter().enumerate().map(|(column, panel)| {
        let is_first = column == 0;
        let mut panel = panel(Axis {
            hidden: !is_first,
            ..Axis::names(names())
        });
        panel.share = if is_first { 1.5 } else { 1.0 };
        panel
    });
    Panels::of(height * compared.laws.len() as f64 + AROUND, panels)
}

pub(super) fn picture(compared: &Compared) -> Page {
    if compared.near.is_empty() {
        one_path(compared)
    } else {
        lines(compared)
    }
}

/// One scenario under each law.
fn one_path(compared: &Compared) -> Page {
    let rows: Vec<Row> = compared.laws.iter().flat_map(|law| law.1.clone()).collect();
    let rows = &rows;
    let panels = metrics().into_iter().map(|metrics| {
        let panels = metrics.map(|metric| move |y| bars(&metric, rows, y));
        by_law(LAW, compared, panels)
    });
    let verdicts = rows.iter().zip(verdicts(rows));
    let verdicts = verdicts.map(|(row, verdict)| format!("{}: {verdict}", row.law));
    Page {
        title: format!(
            "{}, every law on the same plant and seed",
            compared.scenario.name
        ),
        subtitle: compared.scenario.title.clone(),
        rows: panels.collect(),
        notes: verdicts.chain(findings(rows)).collect(),
        width: 1000.0,
    }
}

fn bars((title, value, bar, logarithmic): &Metric, rows: &[Row], y: Axis) -> Panel {
    let finished = rows.iter().filter(|row| row.completed).map(value);
    let largest = finished.chain(*bar).fold(LEAST, f64::max);
    let x = if *logarithmic {
        let decade = 10f64.powf((1.5 * largest).log10().ceil());
        Axis::default().logarithmic().within(LEAST..decade)
    } else {
        Axis::default().within(0.0..1.25 * largest.max(0.8))
    };
    let mut panel = Panel::new(title, x, y);
    for (line, row) in rows.iter().enumerate() {
        let size = value(row);
        let (size, color, text) = match (row.completed, bar) {
            (false, _) => (0.0, GREY, "stopped".to_owned()),
            (true, Some(bar)) if size >= *bar => (size, RED, digits(size)),
            (true, _) => (size, BLUE, digits(size)),
        };
        panel.bar(line, size, color, text);
    }
    if let Some(bar) = bar {
        let ends = [(*bar, -0.5), (*bar, rows.len() as f64 - 0.5)];
        panel.dashed(&format!("bar: {bar}"), GREY, &ends);
    }
    panel
}

/// Success of each law near each singularity.
fn lines(compared: &Compared) -> Page {
    let near = [None].into_iter().chain(KINDS.map(Some));
    let panels = near.map(|near| {
        move |y| {
            let title = near.map_or("all lines".to_owned(), |kind| {
                format!("near {} lock", name_of(kind))
            });
            let mut panel = Panel::new(&title, Axis::named("% of the lines").within(0.0..118.0), y);
            for (line, (law, rows)) in compared.laws.iter().enumerate() {
                let share = |so: fn(&Row) -> bool| {
                    let (yes, all) = compared.count(rows, near, so);
                    100.0 * yes as f64 / all.max(1) as f64
                };
                let (s1, s2) = (share(|row| row.task.s1), share(|row| row.task.s2));
                let color = numbered(usize::from(!law.is_ours()));
                panel.bar(line, s2, Color { 3: 0.35, ..color }, format!("{s2:.0}"));
                panel.bar(line, s1, color, String::new());
            }
            panel
        }
    });
    let (count, speed) = (compared.near.len(), compared.speed);
    let seed = compared.scenario.seed;
    Page {
        title: format!("{count} straight lines through and near each singularity, {speed} m/s"),
        subtitle: format!("PUMA 560, every law on the same lines, plant and seed ({seed})"),
        rows: vec![by_law(LAW + 2.0, compared, panels)],
        notes: vec!["Full bars: S1; with the pale part: S2, which is the number. Their bounds: armplane compare --help.".to_owned()],
        width: 1100.0,
    }
}
