//! Text, lines and places in points of the page.

use plotters::backend::DrawingBackend;
use plotters::coord::Shift;
use plotters::drawing::DrawingArea;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color as _, FontStyle, ShapeStyle, TextStyle};

use super::color::Color;

/// Pixels drawn per point: smooth curves in the SVG, averaged away in the PNG.
pub(super) const FINE: u32 = 4;
pub(super) const FONT: &str = "DejaVu Sans, Verdana, sans-serif";
/// Average width of a character at a font size of one.
pub(super) const CHARACTER: f64 = 0.53;

/// Of several points within a width the first, the least, the largest and the last are drawn.
pub(crate) fn thinned(places: &[(f64, f64)], width: f64) -> Vec<(f64, f64)> {
    let mut out = Vec::new();
    let mut rest = places;
    while let Some(first) = rest.first() {
        let is_near = |place: &&(f64, f64)| (place.0 - first.0).abs() <= width;
        let (column, after) = rest.split_at(rest.iter().take_while(is_near).count());
        rest = after;
        if column.len() <= 4 {
            out.extend(column);
            continue;
        }
        let by_y = |a: &usize, b: &usize| column[*a].1.total_cmp(&column[*b].1);
        let least = (0..column.len()).min_by(by_y).unwrap_or(0);
        let largest = (0..column.len()).max_by(by_y).unwrap_or(0);
        let ends = [least.min(largest), least.max(largest)];
        let mut kept = vec![0, ends[0], ends[1], column.len() - 1];
        kept.dedup();
        out.extend(kept.iter().map(|i| column[*i]));
    }
    out
}

/// Points of the page in drawn pixels.
pub(super) fn fine((x, y): (f64, f64)) -> (i32, i32) {
    let fine = |points: f64| (points * f64::from(FINE)).round() as i32;
    (fine(x), fine(y))
}

/// A line so many points wide.
pub(super) fn stroke(color: Color, width: f64) -> ShapeStyle {
    color.stroke_width(fine((width, 0.0)).0 as u32)
}

/// Letters so many points high.
pub(super) fn style(size: f64, bold: bool, color: Color) -> TextStyle<'static> {
    let weight = if bold {
        FontStyle::Bold
    } else {
        FontStyle::Normal
    };
    TextStyle {
        color: color.to_backend_color(),
        ..TextStyle::from((FONT, 1.2 * size * f64::from(FINE), weight))
    }
}

/// Letters vertically in the middle of their place.
pub(super) fn anchored(size: f64, color: Color, at: HPos) -> TextStyle<'static> {
    style(size, false, color).pos(Pos::new(at, VPos::Center))
}

pub(super) fn said(error: impl ToString) -> String {
    error.to_string()
}

/// A page that is drawn.
pub(super) struct Pen<'a, DB: DrawingBackend> {
    pub(super) area: &'a DrawingArea<DB, Shift>,
    /// Whether the backend joins the pieces of a thick line well; the bitmap's spikes at sharp corners, so it gets them one by one.
    pub(super) joins: bool,
}

impl<DB: DrawingBackend> Pen<'_, DB> {
    /// Text, vertically in the middle of `place`.
    pub(super) fn text(
        &self,
        place: (f64, f64),
        text: &str,
        size: f64,
        bold: bool,
        color: Color,
        at: HPos,
    ) -> Result<(), String> {
        if text.is_empty() {
            return Ok(());
        }
        let style = style(size, bold, color).pos(Pos::new(at, VPos::Center));
        self.area.draw_text(text, &style, fine(place)).map_err(said)
    }
}
