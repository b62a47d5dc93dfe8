//! Pictures for people: a page of panels, described once, saved as SVG and as PNG.
//!
//! ```ignore
//! let mut panel = Panel::new("position error, mm", Axis::named("time, s"), Axis::default());
//! panel.line("hand", BLUE, &[(0.0, 1.0), (1.0, 0.5)]);
//! Page { title: "A run".into(), rows: vec![Row::of(220.0, [panel])], ..Page::default() }.save(Path::new("out/run"))?;
//! ```
//!
//! * [`Page`]: title, subtitle, [`Row`]s of [`Panel`]s, and notes (the numbers) below.
//! * [`Panel`]: axes (linear, logarithmic, or names), lines, dashed lines, dots, arms as stick figures, horizontal bars, shaded bands; a legend
//!   of what has a name. `equal` gives both axes the same scale.
//! * [`numbered`]: the colours that tell several lines apart.
//!
//! The axes are drawn here, on plotters' primitives; everything is in points of the page, drawn four times as fine.

use std::ops::Range;
use std::path::{Path, PathBuf};

use plotters::backend::{BitMapBackend, DrawingBackend, SVGBackend};
use plotters::coord::Shift;
use plotters::drawing::{DrawingArea, IntoDrawingArea};
use plotters::element::{Circle, PathElement, Polygon, Text};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color as _, FontStyle, RGBAColor, RGBColor, TextStyle, WHITE, register_font};

/// Pixels drawn per point: smooth curves in the SVG, averaged away in the PNG.
const FINE: u32 = 4;
/// Drawn pixels per pixel of the PNG, which has two for each point.
const SHRINK: u32 = 2;

const FONT: &str = "DejaVu Sans, Verdana, sans-serif";
static SANS: &[u8] = include_bytes!("plot/dejavu-sans-subset.ttf");
static BOLD: &[u8] = include_bytes!("plot/dejavu-sans-bold-subset.ttf");

/// An opaque or translucent colour.
pub(crate) type Color = RGBAColor;

const fn rgb(r: u8, g: u8, b: u8) -> Color {
    RGBAColor(r, g, b, 1.0)
}

/// Text and axes.
pub(crate) const INK: Color = rgb(38, 42, 51);
/// What matters less.
pub(crate) const GREY: Color = rgb(120, 126, 138);
/// Lines behind the data.
pub(crate) const FAINT: Color = rgb(228, 230, 235);
/// Ours.
pub(crate) const BLUE: Color = rgb(0, 98, 178);
/// What went wrong.
pub(crate) const RED: Color = rgb(203, 50, 52);

/// The n-th of eight colours that can be told apart, by the colour-blind too (after Okabe and Ito).
pub(crate) fn numbered(n: usize) -> Color {
    const COLORS: [Color; 8] = [
        BLUE,
        rgb(213, 94, 0),
        rgb(0, 140, 104),
        rgb(184, 92, 150),
        rgb(201, 140, 0),
        rgb(66, 160, 216),
        rgb(110, 110, 118),
        rgb(150, 40, 60),
    ];
    COLORS[n % COLORS.len()]
}

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
pub(crate) enum PlotError {
    /// The file.
    #[error("cannot write {}: {error}; choose another folder with --out", path.display())]
    Write {
        /// Which.
        path: PathBuf,
        /// Why.
        error: std::io::Error,
    },
    /// The drawing.
    #[error("the picture {} cannot be drawn: {reason}", path.display())]
    Draw {
        /// Which.
        path: PathBuf,
        /// Why.
        reason: String,
    },
}

/// A picture.
#[derive(Clone, Debug)]
pub(crate) struct Page {
    pub(crate) title: String,
    pub(crate) subtitle: String,
    pub(crate) rows: Vec<Row>,
    /// Lines of text below.
    pub(crate) notes: Vec<String>,
    /// Points.
    pub(crate) width: f64,
}

impl Default for Page {
    fn default() -> Self {
        Self { title: String::new(), subtitle: String::new(), rows: Vec::new(), notes: Vec::new(), width: 900.0 }
    }
}

/// Panels side by side.
#[derive(Clone, Debug)]
pub(crate) struct Row {
    /// Points, headings and labels included.
    height: f64,
    panels: Vec<Panel>,
}

impl Row {
    pub(crate) fn of(height: f64, panels: impl IntoIterator<Item = Panel>) -> Self {
        Self { height, panels: panels.into_iter().collect() }
    }
}

/// How values become places.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) enum Scale {
    #[default]
    Linear,
    Logarithmic,
    /// Rows at 0, 1, … from the top.
    Names(Vec<String>),
}

/// One axis of a panel.
#[derive(Clone, Debug, Default)]
pub(crate) struct Axis {
    pub(crate) label: String,
    pub(crate) scale: Scale,
    /// From the data where there is none.
    pub(crate) range: Option<Range<f64>>,
    /// Without line, ticks and labels.
    pub(crate) hidden: bool,
}

impl Axis {
    pub(crate) fn named(label: &str) -> Self {
        Self { label: label.to_owned(), ..Self::default() }
    }

    pub(crate) fn within(mut self, range: Range<f64>) -> Self {
        self.range = Some(range);
        self
    }

    pub(crate) fn logarithmic(mut self) -> Self {
        self.scale = Scale::Logarithmic;
        self
    }

    pub(crate) fn names(names: impl IntoIterator<Item = String>) -> Self {
        Self { scale: Scale::Names(names.into_iter().collect()), ..Self::default() }
    }
}

#[derive(Clone, Debug)]
enum Mark {
    Line { points: Vec<(f64, f64)>, color: Color, width: f64, dashed: bool },
    Dots { points: Vec<(f64, f64)>, color: Color, radius: f64 },
    Bar { row: usize, to: f64, color: Color, text: String },
    Band { x: Range<f64>, color: Color },
    Cell { column: usize, row: usize, color: Color, text: String },
}

/// One diagram.
#[derive(Clone, Debug, Default)]
pub(crate) struct Panel {
    title: String,
    x: Axis,
    y: Axis,
    marks: Vec<Mark>,
    legend: Vec<(String, Color, bool)>,
    /// Both axes with the same scale.
    pub(crate) equal: bool,
    /// Width relative to the others of its row; 0 counts as 1.
    pub(crate) share: f64,
}

impl Panel {
    /// A diagram without data; the title says what goes upwards, and its unit.
    pub(crate) fn new(title: &str, x: Axis, y: Axis) -> Self {
        Self { title: title.to_owned(), x, y, share: 1.0, ..Self::default() }
    }

    /// Shows this range of the y axis.
    pub(crate) fn y_within(&mut self, range: Range<f64>) {
        self.y.range = Some(range);
    }

    fn name(&mut self, name: &str, color: Color, dashed: bool) {
        if !name.is_empty() {
            self.legend.push((name.to_owned(), color, dashed));
        }
    }

    /// A line through the points; named in the legend unless the name is empty.
    pub(crate) fn line(&mut self, name: &str, color: Color, points: &[(f64, f64)]) {
        self.name(name, color, false);
        self.marks.push(Mark::Line { points: points.to_vec(), color, width: 1.6, dashed: false });
    }

    /// The same, thin and dashed: what is wanted, limits.
    pub(crate) fn dashed(&mut self, name: &str, color: Color, points: &[(f64, f64)]) {
        self.name(name, color, true);
        self.marks.push(Mark::Line { points: points.to_vec(), color, width: 1.2, dashed: true });
    }

    /// Every line measured from its first point.
    pub(crate) fn shifted_to_start(mut self) -> Self {
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
    pub(crate) fn dots(&mut self, color: Color, radius: f64, points: &[(f64, f64)]) {
        self.marks.push(Mark::Dots { points: points.to_vec(), color, radius });
    }

    /// An arm: links and joints, faint or strong by `strength` in [0, 1].
    pub(crate) fn arm(&mut self, color: Color, strength: f64, joints: &[(f64, f64)]) {
        let fade = |c: u8| (255.0 - (255.0 - f64::from(c)) * strength) as u8;
        let color = rgb(fade(color.0), fade(color.1), fade(color.2));
        self.marks.push(Mark::Line { points: joints.to_vec(), color, width: 1.0 + 2.0 * strength, dashed: false });
        self.dots(color, 1.5 + 1.5 * strength, joints);
    }

    /// A horizontal bar in a row of a [`Scale::Names`] axis, from the left edge, with a text at its end.
    pub(crate) fn bar(&mut self, row: usize, to: f64, color: Color, text: String) {
        self.marks.push(Mark::Bar { row, to, color, text });
    }

    /// A square of a map whose axes are both [`Scale::Names`].
    pub(crate) fn cell(&mut self, column: usize, row: usize, color: Color, text: String) {
        self.marks.push(Mark::Cell { column, row, color, text });
    }

    /// A shaded stretch of the x axis, behind what is drawn after it.
    pub(crate) fn band(&mut self, name: &str, color: Color, x: Range<f64>) {
        if !self.legend.iter().any(|(known, ..)| known == name) {
            self.name(name, color, false);
        }
        self.marks.push(Mark::Band { x, color });
    }

    /// What the data span, each axis by its own scale.
    fn data(&self) -> (Range<f64>, Range<f64>) {
        let (mut x, mut y) = (Extent::default(), Extent::default());
        for mark in &self.marks {
            match mark {
                Mark::Line { points, .. } | Mark::Dots { points, .. } => points.iter().for_each(|point| {
                    x.add(self.x.place(point.0));
                    y.add(self.y.place(point.1));
                }),
                Mark::Bar { to, .. } => x.add(self.x.place(*to)),
                Mark::Band { .. } | Mark::Cell { .. } => {}
            }
        }
        let (x, y) = (self.x.span(x, false), self.y.span(y, true));
        // Names go down a page, and to the right.
        (if matches!(self.x.scale, Scale::Names(_)) { x.end..x.start } else { x }, y)
    }
}

/// The least and the largest of what is finite.
#[derive(Clone, Copy, Default)]
struct Extent(Option<(f64, f64)>);

impl Extent {
    fn add(&mut self, value: f64) {
        if value.is_finite() {
            let (low, high) = self.0.unwrap_or((value, value));
            self.0 = Some((low.min(value), high.max(value)));
        }
    }
}

impl Axis {
    /// Where a value lies before the axis is stretched over the page.
    fn place(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Logarithmic => value.log10(),
            _ => value,
        }
    }

    /// The range shown: the one asked for, or the data's, with air around it where `airy`.
    fn span(&self, data: Extent, airy: bool) -> Range<f64> {
        if let Scale::Names(names) = &self.scale {
            return names.len() as f64 - 0.5..-0.5;
        }
        if let Some(range) = &self.range {
            return self.place(range.start)..self.place(range.end);
        }
        let (low, high) = data.0.unwrap_or((0.0, 1.0));
        let size = high - low;
        let air = if size < 1e-12 { 0.5 * high.abs().max(1e-3) } else { f64::from(u8::from(airy)) * 0.06 * size };
        low - air..high + air
    }

    /// Places and labels of the ticks, at most `most` of them.
    fn ticks(&self, span: &Range<f64>, most: f64) -> Vec<(f64, String)> {
        let (low, high) = (span.start.min(span.end), span.start.max(span.end));
        let step = nice((high - low) / most.max(1.0));
        match &self.scale {
            Scale::Names(names) => names.iter().enumerate().map(|(i, name)| (i as f64, name.clone())).collect(),
            Scale::Linear => multiples(low, high, step).map(|x| (x, fixed(x, step))).collect(),
            Scale::Logarithmic => {
                let step = step.ceil();
                multiples(low, high, step).map(|x| (x, decade(x))).collect()
            }
        }
    }
}

/// 1, 2 or 5 times a power of ten, at least `size`.
fn nice(size: f64) -> f64 {
    let power = 10f64.powf(size.max(1e-300).log10().floor());
    power * [1.0, 2.0, 5.0, 10.0].into_iter().find(|factor| factor * power >= size * (1.0 - 1e-9)).unwrap_or(10.0)
}

fn multiples(low: f64, high: f64, step: f64) -> impl Iterator<Item = f64> {
    let (first, slack) = ((low / step - 1e-6).ceil(), high + 1e-6 * step);
    (0..200).map(move |k| (first + f64::from(k)) * step).take_while(move |x| *x <= slack)
}

/// A tick's value with the digits that its step needs.
fn fixed(value: f64, step: f64) -> String {
    let value = if value.abs() < 1e-9 * step { 0.0 } else { value };
    if !(1e-4..1e5).contains(&step) {
        return format!("{value:.0e}").replace('-', "−");
    }
    let digits = (-step.log10() - 0.001).ceil().max(0.0) as usize;
    format!("{value:.digits$}").replace('-', "−")
}

fn decade(exponent: f64) -> String {
    match exponent.round() as i32 {
        -2 => "0.01".to_owned(),
        -1 => "0.1".to_owned(),
        0 => "1".to_owned(),
        1 => "10".to_owned(),
        2 => "100".to_owned(),
        n => {
            let digits = n
                .abs()
                .to_string()
                .chars()
                .map(|c| ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][c as usize - 48])
                .collect::<String>();
            format!("10{}{digits}", if n < 0 { "⁻" } else { "" })
        }
    }
}

/// Margin of the page, points.
const MARGIN: f64 = 22.0;
/// Room between panels, points.
const GAP: f64 = 28.0;
/// Line height of notes, points.
const NOTE: f64 = 17.0;
/// Room above a panel for its title and legend, and below for labels; points.
const HEAD: f64 = 44.0;
const FOOT: f64 = 32.0;
/// Line height of a legend that is too long for one line, points.
const LEGEND_LINE: f64 = 15.0;
/// Average width of a character at a font size of one.
const CHARACTER: f64 = 0.53;

impl Page {
    /// The picture as an SVG element.
    ///
    /// # Errors
    /// [`PlotError`] where it cannot be drawn; `path` is what the error names.
    pub(crate) fn svg(&self, path: &Path) -> Result<String, PlotError> {
        register_font(FONT, FontStyle::Normal, SANS).map_err(|_| draw_error(path, "its font is broken"))?;
        register_font(FONT, FontStyle::Bold, BOLD).map_err(|_| draw_error(path, "its font is broken"))?;
        let size = (self.width as u32 * FINE, self.height() as u32 * FINE);
        let mut svg = String::new();
        self.paint(&SVGBackend::with_string(&mut svg, size).into_drawing_area(), true).map_err(|reason| draw_error(path, reason))?;
        let fine = format!("width=\"{}\" height=\"{}\"", size.0, size.1);
        Ok(svg.replacen(&fine, &format!("width=\"{}\" height=\"{}\"", size.0 / FINE, size.1 / FINE), 1))
    }

    /// Saves the picture as `path.svg` and `path.png`.
    ///
    /// # Errors
    /// [`PlotError`] where a file cannot be written.
    pub(crate) fn save(&self, path: &Path) -> Result<[PathBuf; 2], PlotError> {
        let svg = self.svg(path)?;
        let svg_path = path.with_added_extension("svg");
        write(&svg_path, svg.as_bytes())?;

        let size = (self.width as u32 * FINE, self.height() as u32 * FINE);
        let mut pixels = vec![255; size.0 as usize * size.1 as usize * 3];
        self.paint(&BitMapBackend::with_buffer(&mut pixels, size).into_drawing_area(), false).map_err(|reason| draw_error(path, reason))?;
        let png_path = path.with_added_extension("png");
        write(&png_path, &png(&pixels, size).map_err(|error| draw_error(&png_path, error))?)?;
        Ok([svg_path, png_path])
    }

    fn height(&self) -> f64 {
        let rows: f64 = self.rows.iter().map(|row| row.height).sum();
        self.heading() + rows + NOTE * self.notes.len() as f64 + MARGIN
    }

    fn heading(&self) -> f64 {
        MARGIN + if self.title.is_empty() { 0.0 } else { 24.0 } + if self.subtitle.is_empty() { 0.0 } else { 20.0 }
    }

    fn paint<DB: DrawingBackend>(&self, area: &DrawingArea<DB, Shift>, joins: bool) -> Result<(), String> {
        area.fill(&WHITE).map_err(|error| error.to_string())?;
        let pen = Pen { area, joins };
        pen.text((MARGIN, MARGIN + 6.0), &self.title, 17.0, true, INK, HPos::Left)?;
        pen.text((MARGIN, MARGIN + 29.0), &self.subtitle, 12.0, false, GREY, HPos::Left)?;
        let mut top = self.heading();
        for row in &self.rows {
            let shares: f64 = row.panels.iter().map(|panel| panel.share).sum();
            let room = self.width - 2.0 * MARGIN + GAP;
            let mut left = MARGIN;
            for panel in &row.panels {
                let width = room * panel.share / shares;
                panel.paint(&pen, left..left + width - GAP, top..top + row.height)?;
                left += width;
            }
            top += row.height;
        }
        for (i, note) in self.notes.iter().enumerate() {
            pen.text((MARGIN, top + NOTE * (i as f64 + 0.6)), &note.replace(" -", " −"), 12.0, false, INK, HPos::Left)?;
        }
        area.present().map_err(|error| error.to_string())
    }
}

impl Panel {
    fn paint<DB: DrawingBackend>(&self, pen: &Pen<'_, DB>, outer_x: Range<f64>, outer_y: Range<f64>) -> Result<(), String> {
        let (mut x, mut y) = self.data();
        let legend = self.legend_places(outer_x.end - outer_x.start);
        let head = HEAD + legend.last().map_or(0.0, |(_, down)| *down);
        let y_ticks = self.y.ticks(&y, (outer_y.end - outer_y.start - head - FOOT) / 34.0);
        let labels = if self.y.hidden { 0.0 } else { y_ticks.iter().map(|(_, text)| text.chars().count()).max().unwrap_or(0) as f64 };
        let frame_x = outer_x.start + if labels > 0.0 { labels * 11.0 * CHARACTER + 12.0 } else { 0.0 }..outer_x.end;
        let frame_y = outer_y.end - FOOT..outer_y.start + head;
        let (width, height) = (frame_x.end - frame_x.start, frame_y.start - frame_y.end);
        if self.equal {
            // The axis with room to spare shows more.
            let scale = ((x.end - x.start) / width).max((y.end - y.start) / height);
            let grow = |range: &Range<f64>, room: f64| {
                let (middle, half) = (0.5 * (range.start + range.end), 0.5 * scale * room);
                middle - half..middle + half
            };
            (x, y) = (grow(&x, width), grow(&y, height));
        }
        let to = |range: &Range<f64>, frame: &Range<f64>, place: f64| {
            frame.start + ((place - range.start) / (range.end - range.start)).clamp(0.0, 1.0) * (frame.end - frame.start)
        };
        let at_x = |value: f64| to(&x, &frame_x, self.x.place(value));
        let at_y = |value: f64| to(&y, &frame_y, self.y.place(value));

        pen.text((outer_x.start, outer_y.start + 8.0), &self.title, 12.0, true, INK, HPos::Left)?;
        for mark in &self.marks {
            if let Mark::Band { x, color } = mark {
                pen.block(at_x(x.start)..at_x(x.end), frame_y.end..frame_y.start, *color)?;
            }
        }
        let named_rows = matches!(self.y.scale, Scale::Names(_));
        if !self.x.hidden {
            for (tick, text) in self.x.ticks(&x, width / 62.0) {
                let place = to(&x, &frame_x, tick);
                pen.line(&[(place, frame_y.start), (place, frame_y.end)], FAINT, 0.8)?;
                pen.text((place, frame_y.start + 10.0), &text, 11.0, false, GREY, HPos::Center)?;
            }
            pen.line(&[(frame_x.start, frame_y.start), (frame_x.end, frame_y.start)], GREY, 0.8)?;
            pen.text((frame_x.end, frame_y.start + 24.0), &self.x.label, 11.0, false, GREY, HPos::Right)?;
        }
        if !self.y.hidden {
            for (tick, text) in self.y.ticks(&y, height / 34.0) {
                let place = to(&y, &frame_y, tick);
                if !named_rows {
                    pen.line(&[(frame_x.start, place), (frame_x.end, place)], FAINT, 0.8)?;
                }
                let color = if named_rows { INK } else { GREY };
                pen.text((frame_x.start - 7.0, place), &text, 11.0, false, color, HPos::Right)?;
            }
        }
        for mark in &self.marks {
            match mark {
                Mark::Band { .. } => {}
                Mark::Cell { column, row, color, text } => {
                    let half = |span: &Range<f64>, room: f64| 0.5 * room / (span.end - span.start).abs().max(1.0) - 1.0;
                    let (middle, across, up) = ((at_x(*column as f64), at_y(*row as f64)), half(&x, width), half(&y, height));
                    pen.block(middle.0 - across..middle.0 + across, middle.1 - up..middle.1 + up, *color)?;
                    let bright = 0.299 * f64::from(color.0) + 0.587 * f64::from(color.1) + 0.114 * f64::from(color.2) > 150.0;
                    pen.text(middle, text, 10.0, false, if bright { INK } else { rgb(255, 255, 255) }, HPos::Center)?;
                }
                Mark::Line { points, color, width, dashed } => {
                    for stretch in points.split(|(x, y)| !self.x.place(*x).is_finite() || !self.y.place(*y).is_finite()) {
                        let places = thinned(stretch.iter().map(|(x, y)| (at_x(*x), at_y(*y))));
                        if *dashed {
                            dashes(&places).iter().try_for_each(|dash| pen.line(dash, *color, *width))?;
                        } else {
                            pen.line(&places, *color, *width)?;
                        }
                    }
                }
                Mark::Dots { points, color, radius } => {
                    for (x, y) in points {
                        pen.dot((at_x(*x), at_y(*y)), *radius, *color)?;
                    }
                }
                Mark::Bar { row, to, color, text } => {
                    let (middle, half) = (at_y(*row as f64), 0.32 * height / (y.start - y.end).abs().max(1.0));
                    let end = at_x(*to);
                    pen.block(frame_x.start..end, middle - half..middle + half, *color)?;
                    // Inside the bar where there is no room behind it.
                    let long = text.chars().count() as f64 * 11.0 * CHARACTER + 6.0;
                    if end + long > frame_x.end {
                        pen.text((end - 5.0, middle), text, 11.0, false, rgb(255, 255, 255), HPos::Right)?;
                    } else {
                        pen.text((end + 5.0, middle), text, 11.0, false, INK, HPos::Left)?;
                    }
                }
            }
        }
        for ((name, color, dashed), (right, down)) in self.legend.iter().zip(legend) {
            let (left, y) = (outer_x.start + right, outer_y.start + 26.0 + down);
            if *dashed {
                dashes(&[(left, y), (left + 14.0, y)]).iter().try_for_each(|dash| pen.line(dash, *color, 1.4))?;
            } else {
                pen.line(&[(left, y), (left + 14.0, y)], *color, 3.0)?;
            }
            pen.text((left + 19.0, y), name, 11.0, false, INK, HPos::Left)?;
        }
        Ok(())
    }

    /// Where the names of the legend stand, to the right of and below its first, in as many lines as they need in a width; points.
    fn legend_places(&self, width: f64) -> Vec<(f64, f64)> {
        let (mut right, mut down) = (0.0, 0.0);
        let place = |(name, ..): &(String, Color, bool)| {
            let long = 19.0 + name.chars().count() as f64 * 11.0 * CHARACTER;
            if right > 0.0 && right + long > width {
                (right, down) = (0.0, down + LEGEND_LINE);
            }
            let at = (right, down);
            right += long + 14.0;
            at
        };
        self.legend.iter().map(place).collect()
    }
}

/// What several points in one half of a point's width show: the first, the least, the largest and the last of them.
fn thinned(places: impl Iterator<Item = (f64, f64)>) -> Vec<(f64, f64)> {
    let mut out: Vec<(f64, f64)> = Vec::new();
    let mut column: Vec<(f64, f64)> = Vec::new();
    let mut flush = |column: &mut Vec<(f64, f64)>| {
        if column.len() > 4 {
            let by_y = |a: &usize, b: &usize| column[*a].1.total_cmp(&column[*b].1);
            let (least, largest) = ((0..column.len()).min_by(by_y).unwrap_or(0), (0..column.len()).max_by(by_y).unwrap_or(0));
            let kept = [0, least.min(largest), least.max(largest), column.len() - 1];
            out.extend(kept.map(|i| column[i]));
        } else {
            out.append(column);
        }
        column.clear();
    };
    for place in places {
        if column.first().is_some_and(|first| (first.0 - place.0).abs() > 0.5) {
            flush(&mut column);
        }
        column.push(place);
    }
    flush(&mut column);
    out
}

/// A line cut into dashes of five points with gaps of three.
fn dashes(places: &[(f64, f64)]) -> Vec<Vec<(f64, f64)>> {
    let mut out = vec![vec![]];
    let (mut on, mut left) = (true, 5.0);
    for ends in places.windows(2) {
        let [mut a, b] = [ends[0], ends[1]];
        loop {
            let (dx, dy) = (b.0 - a.0, b.1 - a.1);
            let length = dx.hypot(dy);
            let step = length.min(left);
            let next = if length > 0.0 { (a.0 + dx * step / length, a.1 + dy * step / length) } else { b };
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
struct Pen<'a, DB: DrawingBackend> {
    area: &'a DrawingArea<DB, Shift>,
    /// Whether the backend joins the pieces of a thick line well; the bitmap's spikes at sharp corners, so it gets them one by one.
    joins: bool,
}

impl<DB: DrawingBackend> Pen<'_, DB> {
    fn fine((x, y): (f64, f64)) -> (i32, i32) {
        ((x * f64::from(FINE)).round() as i32, (y * f64::from(FINE)).round() as i32)
    }

    fn line(&self, places: &[(f64, f64)], color: Color, width: f64) -> Result<(), String> {
        if places.len() < 2 {
            return Ok(());
        }
        let style = color.stroke_width((width * f64::from(FINE)).round() as u32);
        let path: Vec<_> = places.iter().copied().map(Self::fine).collect();
        let mut pieces = path.windows(if self.joins { path.len() } else { 2 });
        pieces.try_for_each(|piece| self.area.draw(&PathElement::new(piece, style))).map_err(|error| error.to_string())
    }

    fn dot(&self, place: (f64, f64), radius: f64, color: Color) -> Result<(), String> {
        let radius = (radius * f64::from(FINE)).round() as i32;
        self.area.draw(&Circle::new(Self::fine(place), radius, color.filled())).map_err(|error| error.to_string())
    }

    fn block(&self, x: Range<f64>, y: Range<f64>, color: Color) -> Result<(), String> {
        let corners = [(x.start, y.start), (x.end, y.start), (x.end, y.end), (x.start, y.end)].map(Self::fine);
        self.area.draw(&Polygon::new(corners.to_vec(), color)).map_err(|error| error.to_string())
    }

    /// Text, vertically in the middle of `place`.
    fn text(&self, place: (f64, f64), text: &str, size: f64, bold: bool, color: Color, at: HPos) -> Result<(), String> {
        if text.is_empty() {
            return Ok(());
        }
        let weight = if bold { FontStyle::Bold } else { FontStyle::Normal };
        let font = (FONT, 1.2 * size * f64::from(FINE), weight);
        let color = RGBColor(color.0, color.1, color.2);
        let style = TextStyle::from(font).color(&color).pos(Pos::new(at, VPos::Center));
        self.area.draw(&Text::new(text.to_owned(), Self::fine(place), style)).map_err(|error| error.to_string())
    }
}

fn draw_error(path: &Path, reason: impl ToString) -> PlotError {
    PlotError::Draw { path: path.to_owned(), reason: reason.to_string() }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), PlotError> {
    std::fs::write(path, bytes).map_err(|error| PlotError::Write { path: path.to_owned(), error })
}

/// The finely drawn pixels averaged, as a PNG.
fn png(fine: &[u8], (width, height): (u32, u32)) -> Result<Vec<u8>, png::EncodingError> {
    let (w, h, n) = ((width / SHRINK) as usize, (height / SHRINK) as usize, SHRINK as usize);
    let mut pixels = Vec::with_capacity(w * h * 3);
    for y in 0..h {
        for x in 0..w {
            for c in 0..3 {
                let block = (0..n).flat_map(|j| (0..n).map(move |i| ((n * y + j) * width as usize + n * x + i) * 3 + c));
                pixels.push((block.map(|at| u32::from(fine[at])).sum::<u32>() / (SHRINK * SHRINK)) as u8);
            }
        }
    }
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, w as u32, h as u32);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header()?.write_image_data(&pixels)?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers_within_the_range() {
        let labels = |axis: &Axis, span: Range<f64>| axis.ticks(&span, 5.0).into_iter().map(|(_, text)| text).collect::<Vec<_>>();
        assert_eq!(labels(&Axis::default(), -1.0..1.0), ["−1.0", "−0.5", "0.0", "0.5", "1.0"]);
        assert_eq!(labels(&Axis::default().logarithmic(), -4.0..2.0), ["10⁻⁴", "0.01", "1", "100"]);
    }

    #[test]
    fn a_picture_is_saved_twice_and_thinning_keeps_the_extremes() {
        let folder = tempfile::tempdir().unwrap();
        let mut panel = Panel::new("x < y & z", Axis::named("time, s"), Axis::default());
        let wave: Vec<_> = (0..20_000).map(|k| (f64::from(k), if k == 7777 { 9.0 } else { 0.0 })).collect();
        panel.line("spike", BLUE, &wave);
        panel.dashed("wanted", GREY, &[(0.0, f64::NAN), (1.0, 1.0), (19_000.0, 2.0)]);
        let page = Page { title: "Test".to_owned(), rows: vec![Row::of(200.0, [panel])], ..Page::default() };
        let [svg, png] = page.save(&folder.path().join("a.b")).unwrap();
        let svg = std::fs::read_to_string(svg).unwrap();
        assert!(svg.contains("x &lt; y &amp; z") && svg.len() < 100_000 && svg.starts_with("<svg width=\"900\""), "{}", svg.len());
        assert!(std::fs::read(png).unwrap().starts_with(b"\x89PNG"));
        assert!(thinned(wave.into_iter().map(|(x, y)| (x * 0.04, y))).iter().any(|(_, y)| *y == 9.0));
    }

    #[test]
    fn a_folder_that_is_not_there_is_said() {
        let error = Page::default().save(Path::new("/nowhere/at/all")).unwrap_err().to_string();
        assert!(error.contains("cannot write /nowhere/at/all.svg"), "{error}");
    }
}
