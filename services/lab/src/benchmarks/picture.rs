//! The distributions of a bench as a picture.

use viz::plot::{Axis, Page, Panel, Row as PlotRow, numbered};

use super::distribution::Row;

/// One panel for each bench, placement and payload: how long the slowest share of samples took.
pub fn picture(rows: &[Row], machine: &str) -> Page {
    type Key<'a> = (&'a str, &'a str, usize);
    let mut panels: Vec<(Key<'_>, Panel, usize)> = Vec::new();
    for row in rows {
        let key = (row.bench.as_str(), row.placement.as_str(), row.payload_bytes);
        let place = panels.iter().position(|(known, ..)| *known == key).unwrap_or_else(|| {
            let bytes = if row.payload_bytes > 0 { format!(", {} bytes", row.payload_bytes) } else { String::new() };
            let title = format!("{}, {}{bytes}; µs", row.bench, row.placement);
            panels.push((key, Panel::new(&title, Axis::named("share above: 10 to the minus"), Axis::default().logarithmic()), 0));
            panels.len() - 1
        });
        let (_, panel, lines) = &mut panels[place];
        panel.line(&row.mechanism, numbered(*lines), &row.distribution.curve);
        *lines += 1;
    }
    for (key, panel, _) in &mut panels {
        // Whole powers of ten, so that there are at least two to read.
        let of_panel = rows.iter().filter(|row| *key == (row.bench.as_str(), row.placement.as_str(), row.payload_bytes));
        let times = || of_panel.clone().flat_map(|row| &row.distribution.curve).map(|point| point.1).filter(|time| *time > 0.0);
        let (least, most) = (times().fold(f64::INFINITY, f64::min), times().fold(0.0, f64::max));
        if most > 0.0 {
            panel.y_within(10_f64.powf(least.log10().floor())..10_f64.powf(most.log10().ceil()));
        }
    }
    let mut panels: Vec<Panel> = panels.into_iter().map(|(_, panel, _)| panel).collect();
    let mut pairs = Vec::new();
    while !panels.is_empty() {
        let rest = panels.split_off(panels.len().min(2));
        pairs.push(PlotRow::of(240.0, std::mem::replace(&mut panels, rest)));
    }
    Page {
        title: "armplane bench".to_owned(),
        subtitle: format!("0: all samples, 2: the slowest hundredth, 3: the slowest thousandth. {}", machine),
        rows: pairs,
        width: 1600.0,
        ..Page::default()
    }
}
