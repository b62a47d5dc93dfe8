//! A sweep's report as one picture: distributions, and a map over two keys.

use std::ops::Range;

use viz::plot::{Axis, BLUE, Color, GREY, Page, Panel, Row, digits, numbered};

use super::cell::Cell;
use super::read_back::{SHOWN, Table};
use super::row::OUTCOME;
use super::spec::{Scale, Spec, is_in_name, unit_of};

/// Height of a row of distributions, and of a row of the map; points.
const CURVES: f64 = 230.0;
const CELL: f64 = 26.0;
/// The foot of a logarithmic axis relative to its end.
const DECADES: f64 = 1e-5;

/// Most values of a key that a map shows one by one; others are gathered in classes, at most as many.
const CLASSES: usize = 10;
/// Runs that a cell of a map has on average, where values are gathered in fewer classes.
const RUNS_PER_CELL: f64 = 5.0;

/// The picture: the map is over two keys, coloured by a column.
pub(super) fn page(
    title: String,
    subtitle: String,
    table: &Table,
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
        [x, y] => rows.push(maps(table, spec, x, y, by)),
        [x] => rows.push(Row::of(CURVES, [dots(table, x, by)])),
        _ => {}
    }
    let notes = vec![
        "Curves: share of the runs with at most this value. Map: median over the runs of a cell."
            .to_owned(),
    ];
    Page {
        title,
        subtitle,
        rows,
        notes,
        width: 1200.0,
    }
}

/// The share of the runs that a value covers.
fn distribution(table: &Table, column: &str) -> Panel {
    let ordered: Vec<f64> = table
        .ordered(column)
        .into_iter()
        .filter(|value| value.is_finite())
        .collect();
    let (least, largest) = (
        ordered.first().copied().unwrap_or(0.0),
        ordered.last().copied().unwrap_or(1.0),
    );
    let spans_decades = least >= 0.0 && largest > 20.0 * least.max(largest * DECADES);
    let foot = least.max(largest * DECADES);
    let axis = Axis::default();
    // Whole decades: their ends have labels.
    let decade = |value: f64, to: fn(f64) -> f64| 10f64.powf(to(value.log10()));
    let axis = if spans_decades {
        axis.logarithmic()
            .within(decade(foot, f64::floor)..decade(largest, f64::ceil))
    } else {
        axis
    };
    let mut panel = Panel::new(&titled(column), axis, Axis::named("").within(0.0..1.0));
    let count = ordered.len() as f64;
    // A step at each value, thinned to what a picture shows.
    let every = ordered.len().div_ceil(500).max(1);
    let mut points = vec![];
    for (place, value) in ordered
        .iter()
        .enumerate()
        .filter(|(place, _)| place % every == 0 || place + 1 == ordered.len())
    {
        let value = if spans_decades {
            value.max(foot)
        } else {
            *value
        };
        points.extend([
            (value, place as f64 / count),
            (value, (place + 1) as f64 / count),
        ]);
    }
    panel.line("", BLUE, &points);
    panel
}

/// One key against the column.
fn dots(table: &Table, key: &str, by: &str) -> Panel {
    let mut panel = Panel::new(&titled(by), Axis::named(&titled(key)), Axis::default());
    let points = table
        .column(key)
        .iter()
        .zip(table.column(by))
        .filter_map(|(x, y)| Some((x.number()?, y.number()?)));
    panel.dots(numbered(0), 2.5, &points.collect::<Vec<_>>());
    panel
}

/// Two maps: the share of goals reached, and the median of the column.
fn maps(table: &Table, spec: &Spec, x: &str, y: &str, by: &str) -> Row {
    let classes = |key: &str| {
        let scale = spec
            .key
            .iter()
            .find(|one| one.key == key)
            .map(|one| one.scale)
            .unwrap_or_default();
        Classes::of(table.column(key), scale)
    };
    let (across, down) = (classes(x), classes(y));
    let mut members = vec![Vec::new(); across.names.len() * down.names.len()];
    for row in 0..table.rows {
        if let (Some(column), Some(line)) = (
            across.class(&table.column(x)[row]),
            down.class(&table.column(y)[row]),
        ) {
            members[line * across.names.len() + column].push(row);
        }
    }
    let panel = |title: String,
                 value: &dyn Fn(&[usize]) -> Option<f64>,
                 shade: &dyn Fn(f64, Range<f64>) -> f64| {
        let values: Vec<Option<f64>> = members.iter().map(|rows| value(rows)).collect();
        let finite = || {
            values
                .iter()
                .flatten()
                .copied()
                .filter(|value| value.is_finite())
        };
        let range =
            finite().fold(f64::INFINITY, f64::min)..finite().fold(f64::NEG_INFINITY, f64::max);
        let mut panel = Panel::new(
            &title,
            Axis::names(across.names.iter().cloned()),
            Axis::names(down.names.iter().cloned()),
        );
        for (place, value) in values.iter().enumerate() {
            let (column, line) = (place % across.names.len(), place / across.names.len());
            let color = value.map_or(pale(GREY, 0.1), |value| {
                pale(BLUE, shade(value, range.clone()))
            });
            panel.cell(column, line, color, value.map_or("–".to_owned(), digits));
        }
        panel
    };
    let reached = |rows: &[usize]| {
        let is =
            |row: &&usize| table.column(OUTCOME)[**row] == Cell::Text("goal reached".to_owned());
        (!rows.is_empty())
            .then(|| 100.0 * rows.iter().filter(is).count() as f64 / rows.len() as f64)
    };
    let median = |rows: &[usize]| {
        let mut values: Vec<f64> = rows
            .iter()
            .filter_map(|row| table.column(by)[*row].number())
            .collect();
        values.sort_by(f64::total_cmp);
        values
            .get(values.len().div_ceil(2).saturating_sub(1))
            .copied()
    };
    let by_size = |value: f64, range: Range<f64>| {
        let foot = range.start.max(range.end * DECADES).max(f64::MIN_POSITIVE);
        if range.end <= foot {
            0.0
        } else {
            ((value.max(foot) / foot).ln() / (range.end / foot).ln()).clamp(0.0, 1.0)
        }
    };
    let first = panel(
        format!(
            "goal reached, % — across: {}, down: {}",
            titled(x),
            titled(y)
        ),
        &reached,
        &|value, _| value / 100.0,
    );
    let second = panel(format!("{}, median", titled(by)), &median, &by_size);
    Row::of(84.0 + CELL * down.names.len() as f64, [first, second])
}

/// White to the colour.
fn pale(color: Color, share: f64) -> Color {
    let mix = |c: u8| (248.0 + (f64::from(c) - 248.0) * share) as u8;
    Color {
        0: mix(color.0),
        1: mix(color.1),
        2: mix(color.2),
        3: 1.0,
    }
}

/// A name with its unit, where the name does not end in it.
fn titled(column: &str) -> String {
    match unit_of(column) {
        Some(unit) if unit != "1" && !is_in_name(column) => format!("{column}, {unit}"),
        _ => column.to_owned(),
    }
}

/// The values of a key as classes of a map.
struct Classes {
    names: Vec<String>,
    /// Upper ends, for numbers that are gathered; the values themselves otherwise.
    ends: Vec<f64>,
    texts: Vec<String>,
}

impl Classes {
    fn of(cells: &[Cell], scale: Scale) -> Self {
        let numbers: Option<Vec<f64>> = cells
            .iter()
            .map(|cell| {
                if matches!(cell, Cell::Boolean(_)) {
                    None
                } else {
                    cell.number()
                }
            })
            .collect();
        let Some(mut numbers) = numbers else {
            let mut texts: Vec<String> = cells.iter().map(ToString::to_string).collect();
            texts.sort();
            texts.dedup();
            return Self {
                names: texts.clone(),
                ends: Vec::new(),
                texts,
            };
        };
        numbers.sort_by(f64::total_cmp);
        numbers.dedup();
        if numbers.len() <= CLASSES {
            return Self {
                names: numbers.iter().map(|number| digits(*number)).collect(),
                ends: numbers,
                texts: Vec::new(),
            };
        }
        let count = ((cells.len() as f64 / RUNS_PER_CELL).sqrt() as usize).clamp(3, CLASSES);
        let (low, high) = (numbers[0], numbers[numbers.len() - 1]);
        let is_log = scale == Scale::Log && low > 0.0;
        let end = |class: usize| {
            let share = class as f64 / count as f64;
            if is_log {
                low * (high / low).powf(share)
            } else {
                low + (high - low) * share
            }
        };
        let mut ends: Vec<f64> = (1..=count).map(end).collect();
        ends[count - 1] = high;
        let middle = |class: usize| {
            if is_log {
                (end(class) * end(class + 1)).sqrt()
            } else {
                0.5 * (end(class) + end(class + 1))
            }
        };
        Self {
            names: (0..count).map(|class| digits(middle(class))).collect(),
            ends,
            texts: Vec::new(),
        }
    }

    fn class(&self, cell: &Cell) -> Option<usize> {
        match cell.number() {
            Some(number) if !self.ends.is_empty() => {
                self.ends.iter().position(|end| number <= *end)
            }
            _ => self.texts.iter().position(|text| *text == cell.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_value_is_in_one_class() {
        let few = Classes::of(
            &[Cell::Whole(3), Cell::Whole(1), Cell::Whole(3)],
            Scale::Linear,
        );
        assert_eq!((few.names.len(), few.class(&Cell::Whole(3))), (2, Some(1)));
        let cells: Vec<Cell> = (0..1000)
            .map(|i| Cell::Number(10f64.powf(f64::from(i) / 333.0)))
            .collect();
        let many = Classes::of(&cells, Scale::Log);
        let counts = cells.iter().fold([0; CLASSES], |mut counts, cell| {
            counts[many.class(cell).unwrap()] += 1;
            counts
        });
        assert!(
            counts.iter().all(|count| (99..=101).contains(count)),
            "{counts:?}"
        );
        let words = Classes::of(
            &[Cell::Text("ur5".into()), Cell::Text("puma560".into())],
            Scale::Linear,
        );
        assert_eq!(words.class(&Cell::Text("ur5".into())), Some(1));
    }
}
