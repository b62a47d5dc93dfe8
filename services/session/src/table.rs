//! Tables for people: in the terminal's width, or 100 columns.

pub use comfy_table::{Cell, Color};
use std::collections::HashSet;
use std::fmt;

use comfy_table::{
    CellAlignment, ColumnConstraint, ContentArrangement, LineStyle, Table, TableStyle, Width,
};

/// Columns of text that goes into a file or to another program.
const WIDTH: u16 = 100;
/// A text is wrapped to no less than this, unless it has shorter lines.
const TEXT: u16 = 20;
/// Blanks between two columns.
const GAP: u16 = 2;

/// Lines above, below, and under the headings; none between rows.
const STYLE: TableStyle = TableStyle::new()
    .top_border(LineStyle::none().fill('─').junction('─'))
    .header_separator(LineStyle::none().fill('─').junction('─'))
    .bottom_border(LineStyle::none().fill('─').junction('─'));

/// A table with these headings.
pub fn table(headings: &[&str]) -> Fitted {
    Fitted {
        headings: headings.iter().map(Cell::new).collect(),
        rows: Vec::new(),
    }
}

/// A table whose cells break between words only. Columns for which the terminal has no room follow below the others, beside those that name the rows.
pub struct Fitted {
    headings: Vec<Cell>,
    rows: Vec<Vec<Cell>>,
}

impl Fitted {
    /// Adds a row.
    pub fn add_row(&mut self, cells: impl IntoIterator<Item = impl Into<Cell>>) {
        self.rows.push(cells.into_iter().map(Into::into).collect());
    }

    /// Whether it has no row.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// The lines of a table without rules, which fit so many columns of a terminal, and the headings of those for which there is no room.
    pub fn lines(&self, width: usize, is_coloured: bool) -> (Vec<String>, Vec<String>) {
        let mut parts = self.parts(u16::try_from(width).unwrap_or(u16::MAX));
        let (first, mut table) = parts.next().unwrap_or_default();
        if is_coloured {
            table.enforce_styling();
        } else {
            table.force_no_tty();
        }
        let rest = parts.flat_map(|(columns, _)| columns);
        let rest = rest.filter(|column| !first.contains(column));
        let rest = rest.map(|column| self.headings[column].content());
        let lines = table.lines().filter(|line| !line.starts_with('─'));
        (lines.collect(), rest.collect())
    }

    /// The least width of each column.
    fn needs(&self, width: u16) -> Vec<u16> {
        let widths = |rows: Vec<Vec<Cell>>| {
            let mut table = Table::new();
            table.add_rows(rows).column_max_content_widths()
        };
        let one_a_line = |cell: &Cell| Cell::new(cell.content().replace(' ', "\n"));
        let words = self.rows.iter().chain([&self.headings]);
        let words = words.map(|row| row.iter().map(one_a_line).collect());
        let mut texts = widths(self.rows.clone());
        texts.resize(self.headings.len(), 0);
        let both = widths(words.collect()).into_iter().zip(texts);
        // Two columns have room in any terminal.
        both.map(|(word, text)| {
            word.max(text.min(TEXT))
                .min((width / 2).saturating_sub(GAP))
        })
        .collect()
    }

    /// How many of the first columns tell the rows apart.
    fn names(&self) -> usize {
        let apart = |columns: &usize| {
            let names = self.rows.iter().map(|row| &row[..*columns]);
            names.collect::<HashSet<_>>().len() == self.rows.len()
        };
        (1..self.headings.len()).find(apart).unwrap_or(1)
    }

    /// The columns of each part of the table that fits so many columns of a terminal.
    fn bands(&self, width: u16, needs: &[u16]) -> Vec<Vec<usize>> {
        let names: Vec<usize> = (0..self.names()).collect();
        let room = names
            .iter()
            .fold(width, |room, name| room.saturating_sub(needs[*name] + GAP));
        let (mut bands, mut left) = (Vec::new(), room);
        let mut band = names.clone();
        for (column, need) in needs.iter().enumerate().skip(names.len()) {
            if *need > left && left < room {
                bands.push(std::mem::replace(&mut band, names.clone()));
                left = room;
            }
            left = left.saturating_sub(*need + GAP);
            band.push(column);
        }
        bands.push(band);
        bands
    }

    /// The parts that fit so many columns of a terminal, and the columns of each.
    fn parts(&self, width: u16) -> impl Iterator<Item = (Vec<usize>, Table)> {
        let needs = self.needs(width);
        let bands = self.bands(width, &needs).into_iter();
        bands.map(move |band| {
            let part = self.part(&band, width, &needs);
            (band, part)
        })
    }

    fn part(&self, columns: &[usize], width: u16, needs: &[u16]) -> Table {
        let of = |row: &Vec<Cell>| columns.iter().map(|i| row[*i].clone()).collect::<Vec<_>>();
        let mut table = Table::new();
        table
            .load_style(STYLE)
            .set_content_arrangement(ContentArrangement::Dynamic)
            .set_width(width)
            .set_header(of(&self.headings))
            .add_rows(self.rows.iter().map(of));
        let widths = table.column_max_content_widths();
        let is_wide = widths.iter().map(|text| text + GAP).sum::<u16>() > width + GAP;
        for (column, place) in table.column_iter_mut().zip(columns) {
            // Between columns there is one blank without any.
            let padding = u16::from(Some(place) != columns.last());
            column.set_padding((0, padding));
            if is_wide {
                let need = Width::Fixed(needs[*place] + padding);
                column.set_constraint(ColumnConstraint::LowerBoundary(need));
            }
        }
        table
    }
}

impl fmt::Display for Fitted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = Table::new().width().unwrap_or(WIDTH);
        let parts: Vec<_> = self.parts(width).map(|(_, part)| part.trim_fmt()).collect();
        f.write_str(&parts.join("\n"))
    }
}

/// A right-aligned cell, for numbers: unbroken, with its sign and unit.
pub fn number(text: impl ToString) -> Cell {
    Cell::new(text.to_string().replace(' ', "\u{a0}")).set_alignment(CellAlignment::Right)
}

/// A number of things: `1 line`, `2 lines`.
pub fn count(number: u64, thing: &str) -> String {
    format!("{number} {thing}{}", if number == 1 { "" } else { "s" })
}

/// A file's size.
pub fn size(bytes: u64) -> String {
    match bytes {
        0..1_000 => format!("{bytes} B"),
        1_000..1_000_000 => format!("{:.1} kB", bytes as f64 / 1e3),
        _ => format!("{:.1} MB", bytes as f64 / 1e6),
    }
}
