//! A sweep's report as one picture: distributions, and a map over two keys.

use std::ops::Range;

use toml::Value;
use viz::plot::{Axis, BLUE, GREY, Page, Panel, Row, digits, numbered};

use super::columns::{Columns, OUTCOME, number, shown};
use super::spec::{Scale, Spec};
use super::units::titled;
use crate::text::{quantile, tinted};

/// Results whose distributions are shown.
pub(super) const SHOWN: [&str; 8] = [
    "position_max_mm",
    "orthogonal_max_mm",
    "orientation_max_deg",
    "orthogonal_max_deg",
    "final_position_mm",
    "speed_max_ratio",
    "torque_max_ratio",
    "torque_step_max_ratio",
];

/// Height of a row of distributions, and of a row of the map; points.
const CURVES: f64 = 230.0;
const CELL: f64 = 26.0;
/// The foot of a logarithmic axis relative to its end.
const DECADES: f64 = 1e-5;
/// Most points of a curve.
const POINTS: usize = 500;
/// Most values of a key that a map shows one by one; others are gathered in classes, at most as many.
const CLASSES: usize = 10;
/// Runs that a cell of a map has on average, where values are gathered in fewer classes.
const RUNS_PER_CELL: f64 = 5.0;

/// The picture: the map is over two keys, coloured by a column.
pub(super) fn page(
    title: String,
    subtitle: String,
    table: &Columns,
    spec: &Spec,
    map: &[&str],
    by: &str,
) -> Page {
    let curves = SHOWN.chunks(4).map(|columns| {
        Row::of(
            CURVES,
            columns.iter().map(|column| distribution(table, column)),
        )
    });
    let mut rows: Vec<Row> = curves.collect();
    match map {
        [x, y] => rows.push(maps(table, spec, [x, y], by)),
        [x] => rows.push(Row::of(CURVES, [dots(table, x, by)])),
        _ => {}
    }
    Page {
        title,
        subtitle,
        rows,
        notes: vec!["Curves: share of the runs with at most this value. Map: median over the runs of a cell.".to_owned()],
        width: 1200.0,
    }
}

/// The share of the runs that a value covers.
fn distribution(table: &Columns, column: &str) -> Panel {
    let mut ordered = table.ordered(column);
    ordered.retain(|value| value.is_finite());
    let (least, largest) = (
        quantile(ordered.iter().copied(), 0.0),
        quantile(ordered.iter().copied(), 1.0),
    );
    let foot = least.max(largest * DECADES);
    let spans_decades = least >= 0.0 && largest > 20.0 * foot;
    // Whole decades: their ends have labels.
    let decade = |value: f64, to: fn(f64) -> f64| 10f64.powf(to(value.log10()));
    let axis = match spans_decades {
        true => Axis::default()
            .logarithmic()
            .within(decade(foot, f64::floor)..decade(largest, f64::ceil)),
        false => Axis::default(),
    };
    let mut panel = Panel::new(&titled(column), axis, Axis::named("").within(0.0..1.0));
    let count = ordered.len();
    // A step at each value, thinned to what a picture shows.
    let every = count.div_ceil(POINTS).max(1);
    let steps = ordered
        .iter()
        .enumerate()
        .filter(|(place, _)| place % every == 0 || place + 1 == count);
    let points = steps.flat_map(|(place, value)| {
        let value = if spans_decades {
            value.max(foot)
        } else {
            *value
        };
        [place, place + 1].map(|below| (value, below as f64 / count as f64))
    });
    panel.line("", BLUE, &points.collect::<Vec<_>>());
    panel
}

/// One key against the column.
fn dots(table: &Columns, key: &str, by: &str) -> Panel {
    let mut panel = Panel::new(&titled(by), Axis::named(&titled(key)), Axis::default());
    let both = table.get(key).iter().zip(table.get(by));
    let points = both.filter_map(|(x, y)| Some((number(x.as_ref())?, number(y.as_ref())?)));
    panel.dots(numbered(0), 2.5, &points.collect::<Vec<_>>());
    panel
}

/// Two maps: the share of goals reached, and the median of the column.
fn maps(table: &Columns, spec: &Spec, keys: [&str; 2], by: &str) -> Row {
    let [across, down] = keys.map(|key| {
        let scale = spec
            .key
            .iter()
            .find(|one| one.key == key)
            .map(|one| one.scale);
        Classes::of(table.get(key), scale.unwrap_or_default())
    });
    let cells = Cells::of(table, keys, [across, down]);
    let reached = |rows: &[usize]| {
        let reached = rows
            .iter()
            .filter(|row| table.shown(OUTCOME, **row) == "goal reached")
            .count();
        (!rows.is_empty()).then(|| 100.0 * reached as f64 / rows.len() as f64)
    };
    let median = |rows: &[usize]| {
        let values: Vec<f64> = rows
            .iter()
            .filter_map(|row| number(table.value(by, *row)))
            .collect();
        (!values.is_empty()).then(|| quantile(values, 0.5))
    };
    let by_size = |value: f64, range: Range<f64>| {
        let foot = range.start.max(range.end * DECADES).max(f64::MIN_POSITIVE);
        match range.end > foot {
            true => ((value.max(foot) / foot).ln() / (range.end / foot).ln()).clamp(0.0, 1.0),
            false => 0.0,
        }
    };
    let [x, y] = keys.map(titled);
    let title = format!("goal reached, % — across: {x}, down: {y}");
    let first = cells.panel(&title, reached, |value, _| value / 100.0);
    let second = cells.panel(&format!("{}, median", titled(by)), median, by_size);
    Row::of(84.0 + CELL * cells.down.0.len() as f64, [first, second])
}

/// The rows of a table by the classes of two keys.
struct Cells {
    across: Classes,
    down: Classes,
    /// The rows of each cell, line by line.
    rows: Vec<Vec<usize>>,
}

impl Cells {
    fn of(table: &Columns, keys: [&str; 2], [across, down]: [Classes; 2]) -> Self {
        let mut rows = vec![Vec::new(); across.0.len() * down.0.len()];
        for row in 0..table.rows() {
            let [column, line] = [(&across, keys[0]), (&down, keys[1])]
                .map(|(classes, key)| classes.class(table.value(key, row)));
            if let (Some(column), Some(line)) = (column, line) {
                rows[line * across.0.len() + column].push(row);
            }
        }
        Self { across, down, rows }
    }

    /// A value of every cell, in a colour that `shade` gives within the range of all.
    fn panel(
        &self,
        title: &str,
        value: impl Fn(&[usize]) -> Option<f64>,
        shade: fn(f64, Range<f64>) -> f64,
    ) -> Panel {
        let values: Vec<Option<f64>> = self.rows.iter().map(|rows| value(rows)).collect();
        let finite = values.iter().flatten().filter(|value| value.is_finite());
        let range = finite.fold(f64::INFINITY..f64::NEG_INFINITY, |range, value| {
            range.start.min(*value)..range.end.max(*value)
        });
        let names = |classes: &Classes| Axis::names(classes.0.iter().map(|(name, _)| name.clone()));
        let mut panel = Panel::new(title, names(&self.across), names(&self.down));
        let width = self.across.0.len();
        for (place, value) in values.iter().enumerate() {
            let color = value.map_or(tinted(GREY, 0.1), |value| {
                tinted(BLUE, shade(value, range.clone()))
            });
            let text = value.map_or("–".to_owned(), digits);
            panel.cell(place % width, place / width, color, text);
        }
        panel
    }
}

/// The values of a key as classes of a map: of each its name, and its upper end where it is one of numbers.
struct Classes(Vec<(String, Option<f64>)>);

impl Classes {
    fn of(cells: &[Option<Value>], scale: Scale) -> Self {
        let as_number = |cell: &Option<Value>| number(cell.as_ref().filter(|cell| !cell.is_bool()));
        let Some(mut numbers) = cells.iter().map(as_number).collect::<Option<Vec<f64>>>() else {
            let mut texts: Vec<String> = cells.iter().map(|cell| shown(cell.as_ref())).collect();
            texts.sort();
            texts.dedup();
            return Self(texts.into_iter().map(|text| (text, None)).collect());
        };
        numbers.sort_by(f64::total_cmp);
        numbers.dedup();
        if numbers.len() <= CLASSES {
            return Self(
                numbers
                    .iter()
                    .map(|end| (digits(*end), Some(*end)))
                    .collect(),
            );
        }
        let count = ((cells.len() as f64 / RUNS_PER_CELL).sqrt() as usize).clamp(3, CLASSES);
        let (low, high) = (numbers[0], numbers[numbers.len() - 1]);
        let at = |class: f64| match scale {
            Scale::Log if low > 0.0 => low * (high / low).powf(class / count as f64),
            _ => low + (high - low) * class / count as f64,
        };
        let class = |class: usize| {
            let end = if class + 1 == count {
                high
            } else {
                at(class as f64 + 1.0)
            };
            (digits(at(class as f64 + 0.5)), Some(end))
        };
        Self((0..count).map(class).collect())
    }

    fn class(&self, cell: Option<&Value>) -> Option<usize> {
        let (value, text) = (number(cell), shown(cell));
        let is_in = |(name, end): &(String, Option<f64>)| match (value, end) {
            (Some(value), Some(end)) => value <= *end,
            _ => *name == text,
        };
        self.0.iter().position(is_in)
    }
}
