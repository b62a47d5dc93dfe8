//! The times of a bench as pictures: one for each question that it answers.

use viz::plot::{Axis, BLUE, Color, GREY, Page, Panel, Row as PlotRow, digits, numbered};

use super::distribution::Row;

/// A benchmark and the question that its picture answers.
const QUESTIONS: [(&str, &str); 7] = [
    (
        "hop",
        "How long does a message take from one process to another?",
    ),
    (
        "cycle",
        "How long do the messages of one tick take around four processes?",
    ),
    ("paced", "How late is what happens on a grid of ticks?"),
    ("model", "How long does the arm's dynamics take?"),
    (
        "control",
        "How long does a tick of estimator, analyzer and controller take?",
    ),
    ("plant", "How long does the simulated arm take for a tick?"),
    ("record", "How much work is a tick for the recorder?"),
];

/// Height of a bar's row, and of what surrounds the rows; points.
const BAR: f64 = 24.0;
const AROUND: f64 = 84.0;

/// Height of a plot over the size of the payload; points.
const CURVES: f64 = 420.0;
/// The legend of the marks.
const BARS: &str = "blue: half of the samples are quicker; grey, and in brackets: 99 of 100 are";
const LINES: &str = "lines: half of the samples are quicker; dashed: 99 of 100 are";

/// Pictures with the names of their benchmarks: a bar for each mechanism, in µs.
pub fn pictures(rows: &[Row], machine: &str) -> Vec<(String, Page)> {
    let mut benches: Vec<&str> = rows.iter().map(|row| row.bench.as_str()).collect();
    benches.sort_unstable();
    benches.dedup();
    benches
        .into_iter()
        .map(|bench| (bench.replace(' ', "-"), picture(bench, rows, machine)))
        .collect()
}

fn picture(bench: &str, rows: &[Row], machine: &str) -> Page {
    let of_bench: Vec<&Row> = rows.iter().filter(|row| row.bench == bench).collect();
    // One scale for all panels, in whole powers of ten.
    let times = || {
        of_bench
            .iter()
            .flat_map(|row| [row.distribution.p50_us, row.distribution.p99_us])
            .filter(|time| *time > 0.0)
    };
    let (least, most) = (
        times().fold(f64::INFINITY, f64::min),
        times().fold(0.0, f64::max),
    );
    let range = if most > 0.0 {
        10_f64.powf((0.8 * least).log10().floor())..10_f64.powf((1.5 * most).log10().ceil())
    } else {
        0.1..10.0
    };
    let mut keys: Vec<(&str, usize)> = Vec::new();
    for row in &of_bench {
        if !keys.contains(&(row.placement.as_str(), row.payload_bytes)) {
            keys.push((&row.placement, row.payload_bytes));
        }
    }
    // Many sizes are an axis of their own: a picture for each would be a page of bars.
    let sizes = |placement: &str| keys.iter().filter(|(of, _)| *of == placement).count();
    let mut by_size: Vec<&str> = Vec::new();
    for (placement, _) in &keys {
        if sizes(placement) > 2 && !by_size.contains(placement) {
            by_size.push(placement);
        }
    }
    keys.retain(|(placement, _)| !by_size.contains(placement));
    let curves = by_size
        .iter()
        .map(|placement| over_size(placement, &of_bench, range.clone()));
    let mut pairs: Vec<PlotRow> = curves
        .collect::<Vec<_>>()
        .chunks(2)
        .map(|pair| PlotRow::of(CURVES, pair.to_vec()))
        .collect();
    let bars: Vec<(usize, Panel)> = keys
        .iter()
        .map(|(placement, bytes)| {
            let shown: Vec<&&Row> = of_bench
                .iter()
                .filter(|row| row.placement == *placement && row.payload_bytes == *bytes)
                .collect();
            let title = if *bytes > 0 {
                format!("{placement}, {bytes} bytes")
            } else {
                (*placement).to_owned()
            };
            let names = Axis::names(shown.iter().map(|row| row.mechanism.clone()));
            let mut panel = Panel::new(
                &title,
                Axis::named("µs").logarithmic().within(range.clone()),
                names,
            );
            for (place, row) in shown.iter().enumerate() {
                let times = &row.distribution;
                panel.bar(
                    place,
                    times.p99_us,
                    Color { 3: 0.35, ..GREY },
                    String::new(),
                );
                panel.bar(
                    place,
                    times.p50_us,
                    BLUE,
                    format!("{} ({})", digits(times.p50_us), digits(times.p99_us)),
                );
            }
            (shown.len(), panel)
        })
        .collect();
    for pair in bars.chunks(2) {
        let most = pair.iter().map(|(bars, _)| *bars).max().unwrap_or(1);
        pairs.push(PlotRow::of(
            AROUND + BAR * most as f64,
            pair.iter().map(|(_, panel)| panel.clone()),
        ));
    }
    let legend = match (by_size.is_empty(), keys.is_empty()) {
        (true, _) => BARS.to_owned(),
        (_, true) => LINES.to_owned(),
        _ => format!("{LINES}; {BARS}"),
    };
    let question = QUESTIONS
        .iter()
        .find(|(known, _)| bench.starts_with(known))
        .map_or(bench, |(_, question)| *question);
    Page {
        title: question.to_owned(),
        subtitle: format!("{legend}. {machine}"),
        rows: pairs,
        width: 1100.0,
        ..Page::default()
    }
}

/// A line for each mechanism: its times over the size of what it carries.
fn over_size(placement: &str, rows: &[&Row], range: std::ops::Range<f64>) -> Panel {
    let rows: Vec<&Row> = rows
        .iter()
        .filter(|row| row.placement == placement)
        .copied()
        .collect();
    let mut mechanisms: Vec<&str> = Vec::new();
    for row in &rows {
        if !mechanisms.contains(&row.mechanism.as_str()) {
            mechanisms.push(&row.mechanism);
        }
    }
    let x = Axis::named("bytes").logarithmic();
    let mut panel = Panel::new(
        &format!("{placement}, µs"),
        x,
        Axis::default().logarithmic().within(range),
    );
    for (place, mechanism) in mechanisms.into_iter().enumerate() {
        let mut points: Vec<&Row> = rows
            .iter()
            .filter(|row| row.mechanism == mechanism)
            .copied()
            .collect();
        points.sort_by_key(|row| row.payload_bytes);
        let of = |time: fn(&Row) -> f64| {
            points
                .iter()
                .map(|row| (row.payload_bytes as f64, time(row)))
                .collect::<Vec<_>>()
        };
        let (color, median) = (numbered(place), of(|row| row.distribution.p50_us));
        panel.line(mechanism, color, &median);
        panel.dots(color, 2.5, &median);
        panel.dashed("", color, &of(|row| row.distribution.p99_us));
    }
    panel
}

#[cfg(test)]
mod tests {
    use super::super::distribution::{Distribution, histogram};
    use super::*;

    #[test]
    fn each_question_has_a_picture_of_its_own() {
        let mut times = histogram();
        (1..=1000).for_each(|nanoseconds| times.saturating_record(nanoseconds));
        let rows =
            ["hop", "model", "hop"].map(|bench| Row::alone(bench, "x", Distribution::of(&times)));
        let pictures = pictures(&rows, "a machine");
        assert_eq!(
            pictures
                .iter()
                .map(|(name, _)| name.as_str())
                .collect::<Vec<_>>(),
            ["hop", "model"]
        );
        assert!(
            pictures
                .iter()
                .all(|(_, page)| page.title.ends_with('?') && page.rows.len() == 1),
            "{pictures:?}"
        );
    }

    #[test]
    fn many_sizes_are_an_axis_and_not_a_page_of_bars() {
        let mut times = histogram();
        (1..=1000).for_each(|nanoseconds| times.saturating_record(nanoseconds));
        let row = |placement: &str, payload_bytes| Row {
            placement: placement.to_owned(),
            payload_bytes,
            ..Row::alone("hop", "pipe", Distribution::of(&times))
        };
        let sizes = [64, 4096, 416, 1 << 20];
        let rows: Vec<Row> = ["same core", "cross core"]
            .iter()
            .flat_map(|placement| sizes.map(|bytes| row(placement, bytes)))
            .collect();
        let page = pictures(&rows, "a machine").remove(0).1;
        assert!(
            page.rows.len() == 1 && page.subtitle.starts_with(LINES),
            "both placements side by side: {page:?}"
        );
        let rows: Vec<Row> = rows.into_iter().chain([row("not pinned", 64)]).collect();
        let page = pictures(&rows, "a machine").remove(0).1;
        assert!(
            page.rows.len() == 2 && page.subtitle.contains(BARS),
            "one size is a bar: {page:?}"
        );
    }
}
