//! One diagram: its axes, marks and legend.

use std::ops::Range;

use plotters::backend::DrawingBackend;
use plotters::style::text_anchor::HPos;

use super::axis::{Axis, Extent, Scale};
use super::color::{Color, FAINT, GREY, INK, rgb};
use super::pen::{CHARACTER, Pen, dashes, thinned};

/// Room above a panel for its title and legend, and below for labels; points.
const HEAD: f64 = 44.0;
const FOOT: f64 = 32.0;
/// Line height of a legend that is too long for one line, points.
const LEGEND_LINE: f64 = 15.0;
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
    Bar {
        row: usize,
        to: f64,
        color: Color,
        text: String,
    },
    Band {
        x: Range<f64>,
        color: Color,
    },
    Floor {
        to: f64,
        color: Color,
    },
    Cell {
        column: usize,
        row: usize,
        color: Color,
        text: String,
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

    /// Shows this range of the y axis.
    pub fn y_within(&mut self, range: Range<f64>) {
        self.y.range = Some(range);
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
            width: 1.2,
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
        let color = rgb(fade(color.0), fade(color.1), fade(color.2));
        self.marks.push(Mark::Line {
            points: joints.to_vec(),
            color,
            width: 1.0 + 2.0 * strength,
            dashed: false,
        });
        self.dots(color, 1.5 + 1.5 * strength, joints);
    }

    /// A horizontal bar in a row of a [`Scale::Names`] axis, from the left edge, with a text at its end.
    pub fn bar(&mut self, row: usize, to: f64, color: Color, text: String) {
        self.marks.push(Mark::Bar {
            row,
            to,
            color,
            text,
        });
    }

    /// A square of a map whose axes are both [`Scale::Names`].
    pub fn cell(&mut self, column: usize, row: usize, color: Color, text: String) {
        self.marks.push(Mark::Cell {
            column,
            row,
            color,
            text,
        });
    }

    /// A shaded stretch of the x axis, behind what is drawn after it.
    pub fn band(&mut self, name: &str, color: Color, x: Range<f64>) {
        if !self.legend.iter().any(|(known, ..)| known == name) {
            self.name(name, color, false);
        }
        self.marks.push(Mark::Band { x, color });
    }

    /// A shaded stretch of the y axis, from its lower end to a value.
    pub fn floor(&mut self, name: &str, color: Color, to: f64) {
        self.name(name, color, false);
        self.marks.push(Mark::Floor { to, color });
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
                Mark::Bar { to, .. } => x.add(self.x.place(*to)),
                Mark::Band { .. } | Mark::Cell { .. } | Mark::Floor { .. } => {}
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

impl Panel {
    /// The rectangle of the data in the panel's own, the y axis from below; points.
    pub(super) fn frame(
        &self,
        outer_x: Range<f64>,
        outer_y: Range<f64>,
    ) -> (Range<f64>, Range<f64>) {
        let (_, y) = self.data();
        let head = HEAD
            + self
                .legend_places(outer_x.end - outer_x.start)
                .last()
                .map_or(0.0, |(_, down)| *down);
        let y_ticks = self
            .y
            .ticks(&y, (outer_y.end - outer_y.start - head - FOOT) / 34.0);
        let labels = if self.y.hidden {
            0.0
        } else {
            y_ticks
                .iter()
                .map(|(_, text)| text.chars().count())
                .max()
                .unwrap_or(0) as f64
        };
        let left = outer_x.start
            + if labels > 0.0 {
                labels * 11.0 * CHARACTER + 12.0
            } else {
                0.0
            };
        (left..outer_x.end, outer_y.end - FOOT..outer_y.start + head)
    }

    /// Draws the diagram into a rectangle of the page; points.
    pub(super) fn paint<DB: DrawingBackend>(
        &self,
        pen: &Pen<'_, DB>,
        outer_x: Range<f64>,
        outer_y: Range<f64>,
    ) -> Result<(), String> {
        let (mut x, mut y) = self.data();
        let legend = self.legend_places(outer_x.end - outer_x.start);
        let (frame_x, frame_y) = self.frame(outer_x.clone(), outer_y.clone());
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
            frame.start
                + ((place - range.start) / (range.end - range.start)).clamp(0.0, 1.0)
                    * (frame.end - frame.start)
        };
        let at_x = |value: f64| to(&x, &frame_x, self.x.place(value));
        let at_y = |value: f64| to(&y, &frame_y, self.y.place(value));

        pen.text(
            (outer_x.start, outer_y.start + 8.0),
            &self.title,
            12.0,
            true,
            INK,
            HPos::Left,
        )?;
        for mark in &self.marks {
            match mark {
                Mark::Band { x, color } => pen.block(
                    at_x(x.start)..at_x(x.end),
                    frame_y.end..frame_y.start,
                    *color,
                )?,
                Mark::Floor { to, color } => {
                    pen.block(frame_x.clone(), at_y(*to)..frame_y.start, *color)?
                }
                _ => {}
            }
        }
        let named_rows = matches!(self.y.scale, Scale::Names(_));
        if !self.x.hidden {
            for (tick, text) in self.x.ticks(&x, width / 62.0) {
                let place = to(&x, &frame_x, tick);
                pen.line(&[(place, frame_y.start), (place, frame_y.end)], FAINT, 0.8)?;
                pen.text(
                    (place, frame_y.start + 10.0),
                    &text,
                    11.0,
                    false,
                    GREY,
                    HPos::Center,
                )?;
            }
            pen.line(
                &[(frame_x.start, frame_y.start), (frame_x.end, frame_y.start)],
                GREY,
                0.8,
            )?;
            pen.text(
                (frame_x.end, frame_y.start + 24.0),
                &self.x.label,
                11.0,
                false,
                GREY,
                HPos::Right,
            )?;
        }
        if !self.y.hidden {
            for (tick, text) in self.y.ticks(&y, height / 34.0) {
                let place = to(&y, &frame_y, tick);
                if !named_rows {
                    pen.line(&[(frame_x.start, place), (frame_x.end, place)], FAINT, 0.8)?;
                }
                let color = if named_rows { INK } else { GREY };
                pen.text(
                    (frame_x.start - 7.0, place),
                    &text,
                    11.0,
                    false,
                    color,
                    HPos::Right,
                )?;
            }
        }
        for mark in &self.marks {
            match mark {
                Mark::Band { .. } | Mark::Floor { .. } => {}
                Mark::Cell {
                    column,
                    row,
                    color,
                    text,
                } => {
                    let half = |span: &Range<f64>, room: f64| {
                        0.5 * room / (span.end - span.start).abs().max(1.0) - 1.0
                    };
                    let (middle, across, up) = (
                        (at_x(*column as f64), at_y(*row as f64)),
                        half(&x, width),
                        half(&y, height),
                    );
                    pen.block(
                        middle.0 - across..middle.0 + across,
                        middle.1 - up..middle.1 + up,
                        *color,
                    )?;
                    let bright = 0.299 * f64::from(color.0)
                        + 0.587 * f64::from(color.1)
                        + 0.114 * f64::from(color.2)
                        > 150.0;
                    pen.text(
                        middle,
                        text,
                        10.0,
                        false,
                        if bright { INK } else { rgb(255, 255, 255) },
                        HPos::Center,
                    )?;
                }
                Mark::Line {
                    points,
                    color,
                    width,
                    dashed,
                } => {
                    for stretch in points.split(|(x, y)| {
                        !self.x.place(*x).is_finite() || !self.y.place(*y).is_finite()
                    }) {
                        let places = thinned(stretch.iter().map(|(x, y)| (at_x(*x), at_y(*y))));
                        if *dashed {
                            dashes(&places)
                                .iter()
                                .try_for_each(|dash| pen.line(dash, *color, *width))?;
                        } else {
                            pen.line(&places, *color, *width)?;
                        }
                    }
                }
                Mark::Dots {
                    points,
                    color,
                    radius,
                } => {
                    for (x, y) in points {
                        pen.dot((at_x(*x), at_y(*y)), *radius, *color)?;
                    }
                }
                Mark::Bar {
                    row,
                    to,
                    color,
                    text,
                } => {
                    let (middle, half) = (
                        at_y(*row as f64),
                        0.32 * height / (y.start - y.end).abs().max(1.0),
                    );
                    let end = at_x(*to);
                    pen.block(frame_x.start..end, middle - half..middle + half, *color)?;
                    // Inside the bar where there is no room behind it.
                    let long = text.chars().count() as f64 * 11.0 * CHARACTER + 6.0;
                    if end + long > frame_x.end {
                        pen.text(
                            (end - 5.0, middle),
                            text,
                            11.0,
                            false,
                            rgb(255, 255, 255),
                            HPos::Right,
                        )?;
                    } else {
                        pen.text((end + 5.0, middle), text, 11.0, false, INK, HPos::Left)?;
                    }
                }
            }
        }
        for ((name, color, dashed), (right, down)) in self.legend.iter().zip(legend) {
            let (left, y) = (outer_x.start + right, outer_y.start + 26.0 + down);
            if *dashed {
                dashes(&[(left, y), (left + 14.0, y)])
                    .iter()
                    .try_for_each(|dash| pen.line(dash, *color, 1.4))?;
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
