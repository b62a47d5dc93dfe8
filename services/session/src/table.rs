//! Tables for people: in the terminal's width, or 100 columns.

pub use comfy_table::Cell;
use std::fmt;

use comfy_table::{
    CellAlignment, ColumnConstraint, ContentArrangement, LineStyle, Table, TableStyle, Width,
};

/// Columns of text that goes into a file or to another program.
const WIDTH: u16 = 100;

/// Columns left and right of a cell, together.
const PADDING: u16 = 2;

/// Lines above, below, and under the headings; none between rows.
const STYLE: TableStyle = TableStyle::new()
    .top_border(LineStyle::none().fill('─').junction('─'))
    .header_separator(LineStyle::none().fill('─').junction('─'))
    .bottom_border(LineStyle::none().fill('─').junction('─'));

/// A table with these headings, as wide as the terminal, or [`WIDTH`] columns without a terminal.
#[must_use]
pub fn table(headings: &[&str]) -> Fitted {
    let mut table = Table::new();
    table
        .load_style(STYLE)
        .set_content_arrangement(ContentArrangement::Dynamic);
    if table.width().is_none() {
        table.set_width(WIDTH);
    }
    let mut fitted = Fitted {
        table,
        widest: vec![0; headings.len()],
    };
    let headings: Vec<Cell> = headings.iter().map(Cell::new).collect();
    fitted.note(&headings);
    fitted.table.set_header(headings);
    fitted
}

/// A table whose cells break between words only.
pub struct Fitted {
    table: Table,
    /// The longest word of each column, in characters.
    widest: Vec<usize>,
}

impl Fitted {
    /// Adds a row.
    pub fn add_row(&mut self, cells: impl IntoIterator<Item = impl Into<Cell>>) {
        let cells: Vec<Cell> = cells.into_iter().map(Into::into).collect();
        self.note(&cells);
        self.table.add_row(cells);
    }

    fn note(&mut self, cells: &[Cell]) {
        for (widest, cell) in self.widest.iter_mut().zip(cells) {
            let longest = |text: String| text.split(' ').map(|word| word.chars().count()).max();
            *widest = (*widest).max(longest(cell.content()).unwrap_or(0));
        }
    }
}

impl fmt::Display for Fitted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut table = self.table.clone();
        let natural: u16 = table
            .column_max_content_widths()
            .iter()
            .map(|width| width + PADDING)
            .sum();
        if table.width().is_none_or(|width| natural <= width) {
            return table.fmt(f);
        }
        for (column, widest) in table.column_iter_mut().zip(&self.widest) {
            // A path or a name that is as wide as the table breaks all the same.
            let least = u16::try_from(*widest).unwrap_or(WIDTH).min(WIDTH / 3) + PADDING;
            column.set_constraint(ColumnConstraint::LowerBoundary(Width::Fixed(least)));
        }
        table.fmt(f)
    }
}

/// A right-aligned cell, for numbers: unbroken, with its sign and unit.
pub fn number(text: impl ToString) -> Cell {
    Cell::new(text.to_string().replace(' ', "\u{a0}")).set_alignment(CellAlignment::Right)
}

/// A file's size.
#[must_use]
pub fn size(bytes: u64) -> String {
    match bytes {
        0..1_000 => format!("{bytes} B"),
        1_000..1_000_000 => format!("{:.1} kB", bytes as f64 / 1e3),
        _ => format!("{:.1} MB", bytes as f64 / 1e6),
    }
}
