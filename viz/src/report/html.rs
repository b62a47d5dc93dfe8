//! HTML elements of a report.

use std::fmt::{Display, Write};

use super::plot::Plot;

/// A page in the making.
#[derive(Default)]
pub(super) struct Html {
    pub(super) text: String,
}

impl Html {
    pub(super) fn add(&mut self, text: impl Display) {
        let _ = writeln!(self.text, "{text}");
    }

    pub(super) fn heading(&mut self, text: &str) {
        self.add(format_args!("<h2>{}</h2>", escaped(text)));
    }

    pub(super) fn facts(&mut self, facts: &[(&str, String)]) {
        self.add("<dl>");
        for (name, value) in facts {
            self.add(format_args!("<dt>{name}</dt><dd>{}</dd>", escaped(value)));
        }
        self.add("</dl>");
    }

    /// A table; columns of numbers are right-aligned.
    pub(super) fn table(&mut self, headings: &[&str], rows: impl IntoIterator<Item = Vec<String>>) {
        let rows: Vec<Vec<String>> = rows.into_iter().collect();
        let is_number = |cell: &String| cell.starts_with(|c: char| c.is_ascii_digit() || c == '-');
        let class = |column: usize| {
            let numeric = column > 0 && rows.iter().all(|row| is_number(&row[column]));
            if numeric { " class=\"n\"" } else { "" }
        };
        let class: Vec<&str> = (0..headings.len()).map(class).collect();
        self.add("<div class=\"wide\"><table><tr>");
        for (heading, class) in headings.iter().zip(&class) {
            self.add(format_args!("<th{class}>{}</th>", escaped(heading)));
        }
        self.add("</tr>");
        for row in &rows {
            let cells = row.iter().zip(&class);
            let cells = cells.map(|(cell, class)| format!("<td{class}>{}</td>", escaped(cell)));
            self.add(format_args!("<tr>{}</tr>", cells.collect::<String>()));
        }
        self.add("</table></div>");
    }

    /// A table, or what to say where there is nothing in it.
    pub(super) fn some(
        &mut self,
        none: &str,
        headings: &[&str],
        rows: impl IntoIterator<Item = Vec<String>>,
    ) {
        let mut rows = rows.into_iter().peekable();
        if rows.peek().is_some() {
            self.table(headings, rows);
        } else if !none.is_empty() {
            self.add(format_args!("<p>{}</p>", escaped(none)));
        }
    }

    /// Plots side by side, or below one another where the page is narrow.
    pub(super) fn figure(&mut self, plots: impl IntoIterator<Item = Plot>, caption: &str) {
        let plots = plots.into_iter().map(|plot| plot.svg([350.0, 200.0]));
        self.add(format_args!(
            "<figure><div class=\"panels\">{}</div><figcaption>{}</figcaption></figure>",
            plots.collect::<String>(),
            escaped(caption)
        ));
    }

    /// One plot as wide as the page, drawn anew for a narrow one.
    pub(super) fn broad_figure(&mut self, plot: &Plot, caption: &str) {
        self.add(format_args!(
            "<figure><div class=\"broad\">{}</div><div class=\"slim\">{}</div><figcaption>{}</figcaption></figure>",
            plot.svg([700.0, 240.0]),
            plot.svg([350.0, 220.0]),
            escaped(caption)
        ));
    }
}

pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
