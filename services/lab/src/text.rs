//! Rows as text: one printer of tables for every experiment, and quantiles of a few values.

use session::table::{Cell, Fitted, number, table};

/// The cell of a row.
type Of<'a, R> = Box<dyn Fn(&R) -> Cell + 'a>;

/// The columns of a table by their headings.
pub(crate) struct Columns<'a, R>(Vec<(&'a str, Of<'a, R>)>);

impl<'a, R> Columns<'a, R> {
    pub(crate) fn new() -> Self {
        Self(Vec::new())
    }

    /// Adds a column of text.
    pub(crate) fn text<T: ToString>(mut self, heading: &'a str, of: impl Fn(&R) -> T + 'a) -> Self {
        self.0
            .push((heading, Box::new(move |row| of(row).to_string().into())));
        self
    }

    /// Adds a column of numbers, to the right.
    pub(crate) fn number<T: ToString>(
        mut self,
        heading: &'a str,
        of: impl Fn(&R) -> T + 'a,
    ) -> Self {
        self.0.push((heading, Box::new(move |row| number(of(row)))));
        self
    }

    /// A line a row.
    pub(crate) fn print(&self, rows: impl IntoIterator<Item = R>) -> Fitted {
        let headings: Vec<&str> = self.0.iter().map(|(heading, _)| *heading).collect();
        let mut printed = table(&headings);
        for row in rows {
            printed.add_row(self.0.iter().map(|(_, of)| of(&row)));
        }
        printed
    }
}

/// A share of a whole, as a percentage.
pub(crate) fn percent(share: f64) -> String {
    format!("{:.0} %", share * 100.0)
}

/// A value that may be none.
pub(crate) fn optional<T>(value: Option<T>, text: impl FnOnce(T) -> String) -> String {
    value.map_or_else(|| "–".to_owned(), text)
}

/// The value that a share of the values does not exceed; 0 without any.
pub(crate) fn quantile(values: impl IntoIterator<Item = f64>, share: f64) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    let place = (share * values.len() as f64).ceil() as usize;
    values
        .get(place.saturating_sub(1))
        .copied()
        .unwrap_or_default()
}
