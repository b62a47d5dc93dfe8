//! One diagram: its axes, marks and legend.

use std::ops::Range;

use plotters::backend::DrawingBackend;
use plotters::chart::{ChartBuilder, ChartContext, LabelAreaPosition};
use plotters::coord::cartesian::Cartesian2d;
use plotters::coord::ranged1d::{
    KeyPointHint, KeyPointWeight, NoDefaultFormatting, Ranged, ValueFormatter,
};
use plotters::element::{Circle, DashedPathElement, EmptyElement, PathElement, Rectangle, Text};
use plotters::style::text_anchor::HPos;
use plotters::style::{Color as _, RGBAColor, ShapeStyle};

use super::axis::{Axis, Extent, Scale};
use super::color::{Color, FAINT, GREY, INK, WHITE};
use super::pen::{CHARACTER, FINE, Pen, anchored, fine, said, stroke, style, thinned};

/// Room above a panel for its title and legend, and below for labels; points.
const HEAD: f64 = 44.0;
const FOOT: f64 = 32.0;
/// Line height of a legend that is too long for one line, points.
const LEGEND_LINE: f64 = 15.0;

/// From edge to edge: what is beyond an axis is drawn at its end.
const WHOLE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

#[derive(Clone, Debug)]
enum Mark {
    Line {
        points: Vec<(f64, f64)>,
        color: Color,
        width: f64,
        dashed: bool,
    },
    Dots {
        points: Vec<(f64, f64)>,
        color: Color,
        radius: f64,
    },
    /// Places of the axes; behind everything where it has no text, which stands at the end of a block from the left edge, else in the middle.
    Block {
        x: [f64; 2],
        y: [f64; 2],
        color: Color,
        text: Option<String>,
    },
}

/// One diagram.
#[derive(Clone, Debug, Default)]
pub struct Panel {
    title: String,
    /// Across.
    pub x: Axis,
    /// Upwards.
    pub y: Axis,
    marks: Vec<Mark>,
    legend: Vec<(String, Color, bool)>,
    /// Both axes with the same scale.
    pub equal: bool,
    /// Width relative to the others of its row; 0 counts as 1.
    pub share: f64,
}

impl Panel {
    /// A diagram without data; the title names the vertical quantity and its unit.
    pub fn new(title: &str, x: Axis, y: Axis) -> Self {
        Self {
            title: title.to_owned(),
            x,
            y,
            share: 1.0,
            ..Self::default()
        }
    }

    fn name(&mut self, name: &str, color: Color, dashed: bool) {
        if !name.is_empty() {
            self.legend.push((name.to_owned(), color, dashed));
        }
    }

    /// A line through the points; named in the legend unless the name is empty.
    pub fn line(&mut self, name: &str, color: Color, points: &[(f64, f64)]) {
        self.name(name, color, false);
        self.marks.push(Mark::Line {
            points: points.to_vec(),
            color,
            width: 1.6,
            dashed: false,
        });
    }

    /// The same, thin and dashed: what is wanted, limits.
    pub fn dashed(&mut self, name: &str, color: Color, points: &[(f64, f64)]) {
        self.name(name, color, true);
        self.marks.push(Mark::Line {
            points: points.to_vec(),
            color,
            width: 1.6,
            dashed: true,
        });
    }

    /// Every line measured from its first point.
    pub fn shifted_to_start(mut self) -> Self {
        for mark in &mut self.marks {
            if let Mark::Line { points, .. } = mark
                && let Some((_, first)) = points.first().copied()
            {
                points.iter_mut().for_each(|(_, y)| *y -= first);
            }
        }
        self
    }

    /// Dots.
    pub fn dots(&mut self, color: Color, radius: f64, points: &[(f64, f64)]) {
        self.marks.push(Mark::Dots {
            points: points.to_vec(),
            color,
            radius,
        });
    }

    /// An arm: links and joints, faint or strong by `strength` in [0, 1].
    pub fn arm(&mut self, color: Color, strength: f64, joints: &[(f64, f64)]) {
        let fade = |c: u8| (255.0 - (255.0 - f64::from(c)) * strength) as u8;
        let color = RGBAColor(fade(color.0), fade(color.1), fade(color.2), 1.0);
        self.marks.push(Mark::Line {
            points: joints.to_vec(),
            color,
            width: 1.0 + 2.0 * strength,
            dashed: false,
        });
        self.dots(color, 1.5 + 1.5 * strength, joints);
    }

    fn block(&mut self, x: [f64; 2], y: [f64; 2], color: Color, text: Option<String>) {
        self.marks.push(Mark::Block { x, y, color, text });
    }

    /// A horizontal bar in a row of a [`Scale::Names`] axis, from the left edge, with a text at its end.
    pub fn bar(&mut self, row: usize, to: f64, color: Color, text: String) {
        let x = [f64::NEG_INFINITY, self.x.place(to)];
        self.block(x, around(row, 0.32), color, Some(text));
    }

    /// A square of a map whose axes are both [`Scale::Names`].
    pub fn cell(&mut self, column: usize, row: usize, color: Color, text: String) {
        self.block(around(column, 0.49), around(row, 0.49), color, Some(text));
    }

    /// A shaded stretch of the x axis, behind what is drawn after it.
    pub fn band(&mut self, name: &str, color: Color, x: Range<f64>) {
        if !self.legend.iter().any(|(known, ..)| known == name) {
            self.name(name, color, false);
        }
        let x = [x.start, x.end].map(|x| self.x.place(x));
        self.block(x, WHOLE, color, None);
    }

    /// A shaded stretch of the y axis, from its lower end to a value.
    pub fn floor(&mut self, name: &str, color: Color, to: f64) {
        self.name(name, color, false);
        let y = [f64::NEG_INFINITY, self.y.place(to)];
        self.block(WHOLE, y, color, None);
    }

    /// Lines by their names.
    pub(crate) fn named(&self) -> impl Iterator<Item = (&str, Color)> {
        let all = self.legend.iter().filter(|(_, colour, _)| colour.3 == 1.0);
        all.map(|(name, colour, _)| (name.as_str(), *colour))
    }

    /// The scale of the vertical axis: values, or their logarithms.
    pub(crate) fn span(&self) -> Range<f64> {
        self.data().1
    }

    /// The data's range, each axis by its own scale.
    fn data(&self) -> (Range<f64>, Range<f64>) {
        let (mut x, mut y) = (Extent::default(), Extent::default());
        for mark in &self.marks {
            match mark {
                Mark::Line { points, .. } | Mark::Dots { points, .. } => {
                    points.iter().for_each(|point| {
                        x.add(self.x.place(point.0));
                        y.add(self.y.place(point.1));
                    })
                }
                Mark::Block { x: ends, text, .. } if text.is_some() => x.add(ends[1]),
                Mark::Block { .. } => {}
            }
        }
        let (x, y) = (self.x.span(x, false), self.y.span(y, true));
        // Names go down a page, and to the right.
        (
            if matches!(self.x.scale, Scale::Names(_)) {
                x.end..x.start
            } else {
                x
            },
            y,
        )
    }
}

/// How places of an axis become pixels, and where its ticks are.
struct Coordinate {
    span: Range<f64>,
    ticks: Vec<(f64, String)>,
}

impl Ranged for Coordinate {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    /// What is beyond the axis is drawn at its end.
    fn map(&self, place: &f64, (from, to): (i32, i32)) -> i32 {
        let share = (place - self.span.start) / (self.span.end - self.span.start);
        from + (share.clamp(0.0, 1.0) * f64::from(to - from)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        match hint.weight() {
            KeyPointWeight::Bold => self.ticks.iter().map(|(place, _)| *place).collect(),
            KeyPointWeight::Any => Vec::new(),
        }
    }

    fn range(&self) -> Range<f64> {
        self.span.clone()
    }
}

impl ValueFormatter<f64> for Coordinate {
    fn format_ext(&self, value: &f64) -> String {
        let tick = self.ticks.iter().find(|(place, _)| place == value);
        tick.map_or(String::new(), |(_, label)| label.clone())
    }
}

type Chart<'a, DB> = ChartContext<'a, DB, Cartesian2d<Coordinate, Coordinate>>;

impl Panel {
    /// Draws the diagram into a rectangle of the page, points, and answers where its data is, pixels.
    pub(super) fn paint<DB: DrawingBackend>(
        &self,
        pen: &Pen<'_, DB>,
        outer_x: Range<f64>,
        outer_y: Range<f64>,
    ) -> Result<(Range<i32>, Range<i32>), String> {
        let width = outer_x.end - outer_x.start;
        let head = HEAD + self.paint_head(pen, (outer_x.start, outer_y.start), width)?;
        let height = outer_y.end - outer_y.start - head - FOOT;
        let (mut x, mut y) = self.data();
        let labels = self.y.ticks(&y, height / 34.0);
        let labels = labels.iter().map(|(_, text)| text.chars().count()).max();
        let left = match labels {
            Some(most) if most > 0 && !self.y.hidden => most as f64 * 11.0 * CHARACTER + 12.0,
            _ => 0.0,
        };
        if self.equal {
            // The axis with room to spare shows more.
            let scale = ((x.end - x.start) / (width - left)).max((y.end - y.start) / height);
            let grow = |range: &Range<f64>, room: f64| {
                let (middle, half) = (0.5 * (range.start + range.end), 0.5 * scale * room);
                middle - half..middle + half
            };
            (x, y) = (grow(&x, width - left), grow(&y, height));
        }
        let corner = fine((outer_x.start, outer_y.start + head));
        let area = pen.area.clone();
        let area = area.shrink(corner, fine((width, height + FOOT)));
        let mut chart = ChartBuilder::on(&area)
            .set_label_area_size(LabelAreaPosition::Left, fine((left, 0.0)).0)
            .set_label_area_size(LabelAreaPosition::Bottom, fine((FOOT, 0.0)).0)
            .build_cartesian_2d(
                Coordinate {
                    ticks: self.x.ticks(&x, (width - left) / 62.0),
                    span: x,
                },
                Coordinate {
                    ticks: self.y.ticks(&y, height / 34.0),
                    span: y,
                },
            )
            .map_err(said)?;
        let is_behind = |mark: &&Mark| matches!(mark, Mark::Block { text: None, .. });
        let (behind, marks): (Vec<_>, Vec<_>) = self.marks.iter().partition(is_behind);
        for mark in behind {
            self.paint_mark(&mut chart, mark, pen.joins)?;
        }
        self.paint_axes(&mut chart)?;
        if !self.x.hidden {
            let place = (outer_x.end, outer_y.end - FOOT + 24.0);
            pen.text(place, &self.x.label, 11.0, false, GREY, HPos::Right)?;
        }
        for mark in marks {
            self.paint_mark(&mut chart, mark, pen.joins)?;
        }
        Ok(chart.plotting_area().get_pixel_range())
    }

    /// Title and legend; how much room its further lines take, points.
    fn paint_head<DB: DrawingBackend>(
        &self,
        pen: &Pen<'_, DB>,
        (left, top): (f64, f64),
        width: f64,
    ) -> Result<f64, String> {
        pen.text((left, top + 8.0), &self.title, 12.0, true, INK, HPos::Left)?;
        let (mut right, mut down) = (0.0, 0.0);
        for (name, color, is_dashed) in &self.legend {
            let long = 19.0 + name.chars().count() as f64 * 11.0 * CHARACTER;
            if right > 0.0 && right + long > width {
                (right, down) = (0.0, down + LEGEND_LINE);
            }
            let (x, y) = (left + right, top + 26.0 + down);
            let ends = [fine((x, y)), fine((x + 14.0, y))];
            // Of a shade, a patch that can be told from the paper.
            let patch = Color {
                3: color.3.sqrt(),
                ..*color
            };
            let width = if color.3 < 1.0 { 9.0 } else { 3.0 };
            let drawn = match is_dashed {
                true => pen.area.draw(&dashed(ends.to_vec(), stroke(*color, 1.4))),
                false => pen.area.draw(&PathElement::new(ends, stroke(patch, width))),
            };
            drawn.map_err(said)?;
            pen.text((x + 19.0, y), name, 11.0, false, INK, HPos::Left)?;
            right += long + 14.0;
        }
        Ok(down)
    }

    fn paint_axes<DB: DrawingBackend>(&self, chart: &mut Chart<'_, DB>) -> Result<(), String> {
        let is_named = matches!(self.y.scale, Scale::Names(_));
        let ink = if is_named { INK } else { GREY };
        let mut mesh = chart.configure_mesh();
        mesh.axis_style(Color { 3: 0.0, ..GREY })
            .bold_line_style(stroke(FAINT, 0.8))
            .x_label_style(style(11.0, false, GREY))
            .y_label_style(style(11.0, false, ink))
            .set_tick_mark_size(LabelAreaPosition::Bottom, 11)
            .set_tick_mark_size(LabelAreaPosition::Left, 14);
        if self.x.hidden {
            mesh.disable_x_mesh().disable_x_axis();
        }
        if self.y.hidden || is_named {
            mesh.disable_y_mesh();
        }
        mesh.draw().map_err(said)?;
        if self.x.hidden {
            return Ok(());
        }
        let (x, y) = (chart.x_range(), chart.y_range().start);
        let axis = PathElement::new([(x.start, y), (x.end, y)], stroke(GREY, 0.8));
        chart.draw_series([axis]).map(drop).map_err(said)
    }

    fn paint_mark<DB: DrawingBackend>(
        &self,
        chart: &mut Chart<'_, DB>,
        mark: &Mark,
        joins: bool,
    ) -> Result<(), String> {
        let place = |(x, y): &(f64, f64)| (self.x.place(*x), self.y.place(*y));
        match mark {
            Mark::Line {
                points,
                color,
                width,
                dashed,
            } => {
                let places: Vec<_> = points.iter().map(place).collect();
                paint_line(chart, &places, stroke(*color, *width), *dashed, joins)
            }
            Mark::Dots {
                points,
                color,
                radius,
            } => {
                let dot = |point| Circle::new(place(point), fine((*radius, 0.0)).0, color.filled());
                chart
                    .draw_series(points.iter().map(dot))
                    .map(drop)
                    .map_err(said)
            }
            Mark::Block { x, y, color, text } => {
                let block = Rectangle::new([(x[0], y[0]), (x[1], y[1])], color.filled());
                chart.draw_series([block]).map_err(said)?;
                let Some(text) = text else { return Ok(()) };
                paint_words(chart, *x, (y[0] + y[1]) / 2.0, *color, text)
            }
        }
    }
}

/// From a row's or a column's middle to both sides.
fn around(place: usize, half: f64) -> [f64; 2] {
    [place as f64 - half, place as f64 + half]
}

/// A line, interrupted where a place is not finite.
fn paint_line<DB: DrawingBackend>(
    chart: &mut Chart<'_, DB>,
    places: &[(f64, f64)],
    style: ShapeStyle,
    is_dashed: bool,
    joins: bool,
) -> Result<(), String> {
    let (x, pixels) = (chart.x_range(), chart.plotting_area().dim_in_pixel().0);
    let half_point = 0.5 * f64::from(FINE) * (x.end - x.start) / f64::from(pixels);
    let stretches = places.split(|(x, y)| !x.is_finite() || !y.is_finite());
    for stretch in stretches.filter(|stretch| stretch.len() > 1) {
        let line = thinned(stretch, half_point);
        let size = if joins { line.len() } else { 2 };
        let drawn = if is_dashed {
            chart.draw_series([dashed(line, style)]).map(drop)
        } else {
            let pieces = line.windows(size);
            let pieces = pieces.map(|piece| PathElement::new(piece, style));
            chart.draw_series(pieces).map(drop)
        };
        drawn.map_err(said)?;
    }
    Ok(())
}

/// The text of a block in a row: at its end where it begins at the left edge, else in its middle.
fn paint_words<DB: DrawingBackend>(
    chart: &mut Chart<'_, DB>,
    [start, end]: [f64; 2],
    row: f64,
    color: Color,
    text: &str,
) -> Result<(), String> {
    let words = |aside: f64, size, ink, at| {
        Text::new(text.to_owned(), fine((aside, 0.0)), anchored(size, ink, at))
    };
    // Inside a bar where there is no room behind it.
    let long = text.chars().count() as f64 * 11.0 * CHARACTER + 6.0;
    let (right, _) = chart.plotting_area().get_pixel_range();
    let (at, _) = chart.backend_coord(&(end, row));
    let [r, g, b] = [color.0, color.1, color.2].map(f64::from);
    let (place, words) = if start.is_finite() {
        let is_bright = 0.299 * r + 0.587 * g + 0.114 * b > 150.0;
        let ink = if is_bright { INK } else { WHITE };
        ((start + end) / 2.0, words(0.0, 10.0, ink, HPos::Center))
    } else if at + fine((long, 0.0)).0 > right.end {
        (end, words(-5.0, 11.0, WHITE, HPos::Right))
    } else {
        (end, words(5.0, 11.0, INK, HPos::Left))
    };
    let words = EmptyElement::at((place, row)) + words;
    chart.draw_series([words]).map(drop).map_err(said)
}

/// Dashes of five points with gaps of three.
fn dashed<C: Clone>(
    points: Vec<C>,
    style: ShapeStyle,
) -> DashedPathElement<std::vec::IntoIter<C>, u32> {
    DashedPathElement::new(points, 5 * FINE, 3 * FINE, style)
}
