//! Plotters' primitives in points of the page.

use std::ops::Range;

use plotters::backend::DrawingBackend;
use plotters::coord::Shift;
use plotters::drawing::DrawingArea;
use plotters::element::{Circle, PathElement, Polygon, Text};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color as _, FontStyle, RGBColor, TextStyle};

use super::color::Color;

/// Pixels drawn per point: smooth curves in the SVG, averaged away in the PNG.
pub(super) const FINE: u32 = 4;
pub(super) const FONT: &str = "DejaVu Sans, Verdana, sans-serif";
/// Average width of a character at a font size of one.
pub(super) const CHARACTER: f64 = 0.53;

/// Several points within half a point's width: the first, the least, the largest and the last of them are drawn.
pub(super) fn thinned(places: impl Iterator<Item = (f64, f64)>) -> Vec<(f64, f64)> {
    let mut out: Vec<(f64, f64)> = Vec::new();
    let mut column: Vec<(f64, f64)> = Vec::new();
    let mut flush = |column: &mut Vec<(f64, f64)>| {
        if column.len() > 4 {
            let by_y = |a: &usize, b: &usize| column[*a].1.total_cmp(&column[*b].1);
            let (least, largest) = (
                (0..column.len()).min_by(by_y).unwrap_or(0),
                (0..column.len()).max_by(by_y).unwrap_or(0),
            );
            let kept = [0, least.min(largest), least.max(largest), column.len() - 1];
            out.extend(kept.map(|i| column[i]));
        } else {
            out.append(column);
        }
        column.clear();
    };
    for place in places {
        if column
            .first()
            .is_some_and(|first| (first.0 - place.0).abs() > 0.5)
        {
            flush(&mut column);
        }
        column.push(place);
    }
    flush(&mut column);
    out
}

/// A line cut into dashes of five points with gaps of three.
pub(super) fn dashes(places: &[(f64, f64)]) -> Vec<Vec<(f64, f64)>> {
    let mut out = vec![vec![]];
    let (mut on, mut left) = (true, 5.0);
    for ends in places.windows(2) {
        let [mut a, b] = [ends[0], ends[1]];
        loop {
            let (dx, dy) = (b.0 - a.0, b.1 - a.1);
            let length = dx.hypot(dy);
            let step = length.min(left);
            let next = if length > 0.0 {
                (a.0 + dx * step / length, a.1 + dy * step / length)
            } else {
                b
            };
            if let (true, Some(dash)) = (on, out.last_mut()) {
                if dash.is_empty() {
                    dash.push(a);
                }
                dash.push(next);
            }
            left -= step;
            a = next;
            if left > 0.0 {
                break;
            }
            on = !on;
            left = if on { 5.0 } else { 3.0 };
            if on {
                out.push(vec![]);
            }
        }
    }
    out
}

/// Plotters' primitives in points of the page.
pub(super) struct Pen<'a, DB: DrawingBackend> {
    pub(super) area: &'a DrawingArea<DB, Shift>,
    /// Whether the backend joins the pieces of a thick line well; the bitmap's spikes at sharp corners, so it gets them one by one.
    pub(super) joins: bool,
}

impl<DB: DrawingBackend> Pen<'_, DB> {
    fn fine((x, y): (f64, f64)) -> (i32, i32) {
        (
            (x * f64::from(FINE)).round() as i32,
            (y * f64::from(FINE)).round() as i32,
        )
    }

    pub(super) fn line(
        &self,
        places: &[(f64, f64)],
        color: Color,
        width: f64,
    ) -> Result<(), String> {
        if places.len() < 2 {
            return Ok(());
        }
        let style = color.stroke_width((width * f64::from(FINE)).round() as u32);
        let path: Vec<_> = places.iter().copied().map(Self::fine).collect();
        let mut pieces = path.windows(if self.joins { path.len() } else { 2 });
        pieces
            .try_for_each(|piece| self.area.draw(&PathElement::new(piece, style)))
            .map_err(|error| error.to_string())
    }

    pub(super) fn dot(&self, place: (f64, f64), radius: f64, color: Color) -> Result<(), String> {
        let radius = (radius * f64::from(FINE)).round() as i32;
        self.area
            .draw(&Circle::new(Self::fine(place), radius, color.filled()))
            .map_err(|error| error.to_string())
    }

    pub(super) fn block(&self, x: Range<f64>, y: Range<f64>, color: Color) -> Result<(), String> {
        let corners = [
            (x.start, y.start),
            (x.end, y.start),
            (x.end, y.end),
            (x.start, y.end),
        ]
        .map(Self::fine);
        self.area
            .draw(&Polygon::new(corners.to_vec(), color))
            .map_err(|error| error.to_string())
    }

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
        let weight = if bold {
            FontStyle::Bold
        } else {
            FontStyle::Normal
        };
        let font = (FONT, 1.2 * size * f64::from(FINE), weight);
        let color = RGBColor(color.0, color.1, color.2);
        let style = TextStyle::from(font)
            .color(&color)
            .pos(Pos::new(at, VPos::Center));
        self.area
            .draw(&Text::new(text.to_owned(), Self::fine(place), style))
            .map_err(|error| error.to_string())
    }
}
