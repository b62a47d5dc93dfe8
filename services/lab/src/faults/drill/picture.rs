//! The cells as two heat maps.

use viz::plot::{Axis, BLUE, Color, Page, Panel, RED, Row, digits};

use super::cell::Cell;

/// Colour of a fault that cannot happen to a process.
const NONE: Color = Color {
    0: 222,
    1: 224,
    2: 229,
    3: 1.0,
};

/// White to blue by the size of a value on a logarithmic scale; red where a guarantee is broken.
fn shade(value: f64, range: std::ops::Range<f64>, is_broken: bool) -> Color {
    if is_broken {
        return RED;
    }
    let share =
        ((value.max(1e-12) / range.start).ln() / (range.end / range.start).ln()).clamp(0.0, 1.0);
    let mix = |c: u8| (248.0 + (f64::from(c) - 248.0) * share) as u8;
    Color {
        0: mix(BLUE.0),
        1: mix(BLUE.1),
        2: mix(BLUE.2),
        3: 1.0,
    }
}

/// Two maps, faults downwards and processes to the right: how far the arm left its path, and how quickly the fault was detected.
pub(super) fn picture(cells: &[Cell]) -> Page {
    let singles: Vec<&Cell> = cells.iter().filter(|cell| cell.faults.len() == 1).collect();
    let (mut processes, mut faults) = (Vec::<String>::new(), Vec::<String>::new());
    let name = |cell: &Cell| {
        if cell.way.is_empty() {
            cell.kind.clone()
        } else {
            format!("{} {}", cell.kind, cell.way)
        }
    };
    for cell in &singles {
        for (names, name) in [
            (&mut processes, cell.process.clone()),
            (&mut faults, name(cell)),
        ] {
            if !names.contains(&name) {
                names.push(name);
            }
        }
    }
    let place = |title: &str, value: &dyn Fn(&Cell) -> Option<f64>, range: std::ops::Range<f64>| {
        let mut panel = Panel::new(
            title,
            Axis::names(processes.clone()),
            Axis::names(faults.clone()),
        );
        for (column, process) in processes.iter().enumerate() {
            for (row, fault) in faults.iter().enumerate() {
                if !singles
                    .iter()
                    .any(|cell| cell.process == *process && name(cell) == *fault)
                {
                    panel.cell(column, row, NONE, "n/a".to_owned());
                }
            }
        }
        for cell in &singles {
            let column = processes
                .iter()
                .position(|process| *process == cell.process)
                .unwrap_or_default();
            let row = faults
                .iter()
                .position(|fault| *fault == name(cell))
                .unwrap_or_default();
            let value = value(cell);
            let color = shade(
                value.unwrap_or(0.0),
                range.clone(),
                !cell.invariants_broken.is_empty(),
            );
            panel.cell(column, row, color, value.map_or("–".to_owned(), digits));
        }
        panel
    };
    let off_path = place(
        "largest distance from the fault-free path, mrad",
        &|cell| Some(cell.excursion_max_rad * 1e3),
        0.01..100.0,
    );
    let detected = place(
        "time until the fault is detected, ms",
        &|cell| cell.detected_ms,
        0.01..1000.0,
    );
    let broken = cells
        .iter()
        .filter(|cell| !cell.invariants_broken.is_empty())
        .count();
    let scenarios: std::collections::BTreeSet<_> =
        cells.iter().map(|cell| cell.scenario.as_str()).collect();
    Page {
        title: "Effect of each fault".to_owned(),
        subtitle: format!(
            "{}: {} cells, {broken} with a broken guarantee (red); lockstep, each repeated from its saved plan",
            scenarios.into_iter().collect::<Vec<_>>().join(", "),
            cells.len()
        ),
        rows: vec![Row::of(
            80.0 + 19.0 * faults.len() as f64,
            [off_path, detected],
        )],
        notes: vec![
            "n/a: this fault cannot happen to this process. –: nothing detected it.".to_owned(),
        ],
        width: 1100.0,
    }
}
