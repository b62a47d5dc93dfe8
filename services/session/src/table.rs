//! Tables for people: in the terminal's width, or 100 columns.

pub use comfy_table::Cell;
use comfy_table::{CellAlignment, ContentArrangement, LineStyle, Table, TableStyle};

/// Lines above, below, and under the headings; none between rows.
const STYLE: TableStyle = TableStyle::new()
    .top_border(LineStyle::none().fill('─').junction('─'))
    .header_separator(LineStyle::none().fill('─').junction('─'))
    .bottom_border(LineStyle::none().fill('─').junction('─'));

/// A table with these headings, fitted to the terminal.
#[must_use]
pub fn table(headings: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_style(STYLE).set_content_arrangement(ContentArrangement::Dynamic);
    table.set_header(headings.iter().map(Cell::new));
    table
}

/// A table that fits into 100 columns where there is no terminal to fit it to.
#[must_use]
pub fn fitted(headings: &[&str]) -> Table {
    let mut table = table(headings);
    if table.width().is_none() {
        table.set_width(100);
    }
    table
}

/// A right-aligned cell, for numbers.
pub fn number(text: impl ToString) -> Cell {
    Cell::new(text).set_alignment(CellAlignment::Right)
}
