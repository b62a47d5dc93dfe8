//! HTML elements of a report.

use std::fmt::{Display, Write};
use std::path::Path;

use crate::plot::{Color, Page, Panel, PlotError, Row, Scale};

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

    /// Panels side by side, or below one another where the page is narrow.
    pub(super) fn figure(
        &mut self,
        path: &Path,
        panels: impl IntoIterator<Item = Panel>,
        caption: &str,
    ) -> Result<(), PlotError> {
        let panels: Vec<String> = panels
            .into_iter()
            .map(|panel| picture(path, panel, [350.0, 200.0]))
            .collect::<Result<_, _>>()?;
        self.add(format_args!(
            "<figure><div class=\"panels\">{}</div><figcaption>{}</figcaption></figure>",
            panels.concat(),
            escaped(caption)
        ));
        Ok(())
    }

    /// One panel as wide as the page, drawn anew for a narrow one.
    pub(super) fn broad_figure(
        &mut self,
        path: &Path,
        panel: Panel,
        caption: &str,
    ) -> Result<(), PlotError> {
        let (broad, slim) = (
            picture(path, panel.clone(), [700.0, 240.0])?,
            picture(path, panel, [350.0, 220.0])?,
        );
        self.add(format_args!(
            "<figure><div class=\"broad\">{broad}</div><div class=\"slim\">{slim}</div><figcaption>{}</figcaption></figure>",
            escaped(caption)
        ));
        Ok(())
    }
}

/// A panel as an SVG element of a width and height; points. A line in it, not seen at first, shows the time chosen on the page, and its attributes
/// say where its data is and what its lines are called: the page reads values off the lines by them.
fn picture(path: &Path, panel: Panel, [width, height]: [f64; 2]) -> Result<String, PlotError> {
    let named = panel.named().map(|(name, colour)| (name, hex(colour)));
    let names = serde_json::json!(named.collect::<Vec<_>>()).to_string();
    let (span, log) = (panel.span(), u8::from(panel.y.scale == Scale::Logarithmic));
    let page = Page {
        rows: vec![Row::of(height, [panel])],
        width,
        ..Page::default()
    };
    let (svg, [x, y]) = page.svg(path)?;
    let svg = svg.trim_start_matches(|c| c != '<').trim_end();
    let open = svg.trim_end_matches("</svg>");
    let data = format!(
        "<svg data-x=\"{} {}\" data-y=\"{} {} {} {} {log}\" data-names=\"{}\"",
        x.start,
        x.end,
        y.start,
        y.end,
        span.start,
        span.end,
        escaped(&names)
    );
    let open = open.replacen("<svg", &data, 1);
    Ok(format!(
        "{open}<path class=\"cursor\" d=\"M0 {}V{}\" transform=\"translate({} 0)\"/></svg>",
        y.end, y.start, x.start
    ))
}

/// As plotters writes it.
fn hex(colour: Color) -> String {
    format!("#{:02X}{:02X}{:02X}", colour.0, colour.1, colour.2)
}

pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
