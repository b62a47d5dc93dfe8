//! A diagram over time as an SVG element, four units a point. PURE.

use std::fmt::Write;
use std::ops::Range;

use super::html::escaped;
use crate::solid::Rgba;
use crate::tint::{hex, opacity};

pub(super) const INK: Rgba = 0x262a33ff;
pub(super) const GREY: Rgba = 0x787e8aff;
const FAINT: Rgba = 0xe4e6ebff;
pub(super) const BLUE: Rgba = 0x0062b2ff;
pub(super) const RED: Rgba = 0xcb3234ff;

/// The n-th of eight distinguishable colours, for the colour-blind too (after Okabe and Ito).
pub(super) fn numbered(n: usize) -> Rgba {
    const COLORS: [u32; 8] = [
        0x0062b2ff, 0xd55e00ff, 0x008c68ff, 0xb85c96ff, 0xc98c00ff, 0x42a0d8ff, 0x6e6e76ff,
        0x96283cff,
    ];
    COLORS[n % COLORS.len()]
}

/// Units of the drawing per point.
const FINE: f64 = 4.0;
/// Room above the data for title and legend, below it for labels; and the height of a legend's line. Units.
const HEAD: f64 = 44.0 * FINE;
const FOOT: f64 = 32.0 * FINE;
const LEGEND: f64 = 15.0 * FINE;
/// Average width of a letter of the labels.
const LETTER: f64 = 5.83 * FINE;

/// How values go upwards.
#[derive(Clone, Debug, Default)]
pub(super) struct Axis {
    pub(super) is_logarithmic: bool,
    /// From the data where there is none.
    pub(super) range: Option<Range<f64>>,
}

impl Axis {
    pub(super) fn within(range: Range<f64>) -> Self {
        Self {
            range: Some(range),
            ..Self::default()
        }
    }

    pub(super) fn logarithmic(self) -> Self {
        Self {
            is_logarithmic: true,
            ..self
        }
    }

    fn place(&self, value: f64) -> f64 {
        if self.is_logarithmic {
            value.log10()
        } else {
            value
        }
    }

    /// Places and labels of at most `most` ticks.
    fn ticks(&self, span: &Range<f64>, most: f64) -> Vec<(f64, String)> {
        let step = nice((span.end - span.start) / most.max(1.0));
        let step = if self.is_logarithmic {
            step.ceil()
        } else {
            step
        };
        let first = (span.start / step - 1e-6).ceil();
        let all = (0..200).map(|k| (first + f64::from(k)) * step);
        let within = all.take_while(|place| *place <= span.end + 1e-6 * step);
        let label = |place| match self.is_logarithmic {
            true => decade(place),
            false => fixed(place, step),
        };
        within.map(|place| (place, label(place))).collect()
    }
}

/// 1, 2 or 5 times a power of ten, at least `size`.
fn nice(size: f64) -> f64 {
    let power = 10f64.powf(size.max(1e-300).log10().floor());
    let fits = |factor: &f64| factor * power >= size * (1.0 - 1e-9);
    power * [1.0, 2.0, 5.0].into_iter().find(fits).unwrap_or(10.0)
}

/// A tick's value with the digits that its step needs.
fn fixed(value: f64, step: f64) -> String {
    let value = if value.abs() < 1e-9 * step {
        0.0
    } else {
        value
    };
    let digits = (-step.log10() - 0.001).ceil().max(0.0) as usize;
    match (1e-4..1e5).contains(&step) {
        true => format!("{value:.digits$}"),
        false => format!("{value:.0e}"),
    }
    .replace('-', "−")
}

fn decade(exponent: f64) -> String {
    let raised = |c| match c {
        '-' => '⁻',
        c => ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][c as usize - 48],
    };
    match exponent.round() as i32 {
        n @ -2..=2 => format!("{}", 10f64.powi(n)),
        n => format!(
            "10{}",
            n.to_string().chars().map(raised).collect::<String>()
        ),
    }
}

/// Of several points within a width the first, the least, the largest and the last are drawn.
pub(super) fn thinned(places: &[(f64, f64)], width: f64) -> Vec<(f64, f64)> {
    let mut out = Vec::new();
    let near = |a: &(f64, f64), first: f64| (a.0 - first).abs() <= width;
    let mut rest = places;
    while let Some(first) = rest.first() {
        let count = rest.iter().take_while(|one| near(one, first.0)).count();
        let (column, after) = rest.split_at(count);
        rest = after;
        let by_y = |a: &usize, b: &usize| column[*a].1.total_cmp(&column[*b].1);
        let least = (0..count).min_by(by_y).unwrap_or(0);
        let largest = (0..count).max_by(by_y).unwrap_or(0);
        let mut kept = vec![0, least.min(largest), least.max(largest), count - 1];
        kept.dedup();
        out.extend(kept.iter().map(|i| column[*i]));
    }
    out
}

#[derive(Clone, Debug)]
struct Line {
    points: Vec<(f64, f64)>,
    colour: Rgba,
    is_dashed: bool,
}

/// A diagram over time; the title names the vertical quantity and its unit.
#[derive(Clone, Debug)]
pub(super) struct Plot {
    title: String,
    end_s: f64,
    axis: Axis,
    lines: Vec<Line>,
    /// Stretches of time, and all that is below a value, behind the lines.
    bands: Vec<(Range<f64>, Rgba)>,
    floor: Option<(f64, Rgba)>,
    legend: Vec<(String, Rgba, bool)>,
}

impl Plot {
    pub(super) fn new(title: &str, end_s: f64, axis: Axis) -> Self {
        Self {
            title: title.to_owned(),
            end_s: end_s.max(1e-3),
            axis,
            lines: Vec::new(),
            bands: Vec::new(),
            floor: None,
            legend: Vec::new(),
        }
    }

    fn name(&mut self, name: &str, colour: Rgba, is_dashed: bool) {
        if !name.is_empty() && !self.legend.iter().any(|(known, ..)| known == name) {
            self.legend.push((name.to_owned(), colour, is_dashed));
        }
    }

    /// A line, named in the legend unless the name is empty; dashed: what is wanted, limits.
    pub(super) fn line(
        &mut self,
        name: &str,
        colour: Rgba,
        points: Vec<(f64, f64)>,
        is_dashed: bool,
    ) {
        self.name(name, colour, is_dashed);
        self.lines.push(Line {
            points,
            colour,
            is_dashed,
        });
    }

    /// A shaded stretch of time.
    pub(super) fn band(&mut self, name: &str, colour: Rgba, stretch: Range<f64>) {
        self.name(name, colour, false);
        self.bands.push((stretch, colour));
    }

    /// Shades what is below a value.
    pub(super) fn floor(&mut self, name: &str, colour: Rgba, below: f64) {
        self.name(name, colour, false);
        self.floor = Some((below, colour));
    }

    /// The values shown, or their logarithms: those asked for, or the data's with air around them.
    fn span(&self) -> Range<f64> {
        if let Some(range) = &self.axis.range {
            return self.axis.place(range.start)..self.axis.place(range.end);
        }
        let points = self.lines.iter().flat_map(|line| &line.points);
        let values = points.map(|(_, value)| self.axis.place(*value));
        let (low, high) = values
            .filter(|value| value.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), y| {
                (low.min(y), high.max(y))
            });
        match high - low {
            size if size >= 1e-12 => low - 0.06 * size..high + 0.06 * size,
            _ if low.is_finite() => {
                let air = 0.5 * low.abs().max(1e-3);
                low - air..low + air
            }
            _ => 0.0..1.0,
        }
    }

    /// The element, of so many points. The page reads values off the lines by its attributes: the place of the data, its range, the names of the lines.
    pub(super) fn svg(&self, [width, height]: [f64; 2]) -> String {
        let (whole, bottom) = (width * FINE, height * FINE - FOOT);
        // The last label is centred on the end of the axis.
        let right = whole - 10.0 * FINE;
        let (head, below) = self.head(whole);
        let span = self.span();
        let top = HEAD + below;
        let ticks = self.axis.ticks(&span, (bottom - top) / (34.0 * FINE));
        let letters = ticks.iter().map(|(_, label)| label.chars().count()).max();
        let left = letters.unwrap_or(0) as f64 * LETTER + 12.0 * FINE;
        let share = |value: f64, from: f64, to: f64| ((value - from) / (to - from)).clamp(0.0, 1.0);
        let x = |t_s: f64| (left + share(t_s, 0.0, self.end_s) * (right - left)).round();
        let y = |place: f64| (bottom - share(place, span.start, span.end) * (bottom - top)).round();
        let mut body = String::new();
        for (stretch, colour) in &self.bands {
            rect(
                &mut body,
                [x(stretch.start), top, x(stretch.end), bottom],
                *colour,
            );
        }
        if let Some((value, colour)) = self.floor {
            rect(
                &mut body,
                [left, y(self.axis.place(value)), right, bottom],
                colour,
            );
        }
        for (place, label) in &ticks {
            stroke(&mut body, [left, y(*place), right, y(*place)], FAINT, 3.0);
            text(
                &mut body,
                [left - 24.0, y(*place)],
                label,
                " text-anchor=\"end\"",
            );
        }
        let seconds = Axis::default().ticks(&(0.0..self.end_s), (right - left) / (62.0 * FINE));
        for (t_s, label) in &seconds {
            stroke(&mut body, [x(*t_s), top, x(*t_s), bottom], FAINT, 3.0);
            text(
                &mut body,
                [x(*t_s), bottom + 44.0],
                label,
                " text-anchor=\"middle\"",
            );
        }
        stroke(&mut body, [left, bottom, right, bottom], GREY, 3.0);
        text(
            &mut body,
            [right, bottom + 96.0],
            "time, s",
            " text-anchor=\"end\"",
        );
        let half_point = 0.5 * FINE * self.end_s / (right - left);
        for line in &self.lines {
            let places = line.points.iter();
            let places: Vec<_> = places
                .map(|(t_s, value)| (*t_s, self.axis.place(*value)))
                .collect();
            let stretches = places.split(|(_, place)| !place.is_finite());
            for stretch in stretches.filter(|stretch| stretch.len() > 1) {
                let points = thinned(stretch, half_point).into_iter();
                let points = points.map(|(t_s, place)| format!("{},{} ", x(t_s), y(place)));
                let dashes = if line.is_dashed {
                    " stroke-dasharray=\"20 12\""
                } else {
                    ""
                };
                let _ = write!(
                    body,
                    "<polyline fill=\"none\" stroke=\"{}\" stroke-width=\"6\"{dashes} points=\"{}\"/>",
                    hex(line.colour),
                    points.collect::<String>().trim_end()
                );
            }
        }
        let opaque = self
            .legend
            .iter()
            .filter(|(_, colour, _)| colour & 0xff == 0xff);
        let names: Vec<_> = opaque
            .map(|(name, colour, _)| (name, hex(*colour)))
            .collect();
        format!(
            "<svg data-x=\"{left} {right}\" data-y=\"{bottom} {top} {} {} {}\" data-names=\"{}\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {whole} {}\" font-family=\"DejaVu Sans, Verdana, sans-serif\" font-size=\"44\" dominant-baseline=\"central\">{head}{body}\
             <path class=\"cursor\" d=\"M0 {top}V{bottom}\" transform=\"translate({left} 0)\"/></svg>",
            span.start,
            span.end,
            u8::from(self.axis.is_logarithmic),
            escaped(&serde_json::json!(names).to_string()),
            height * FINE
        )
    }

    /// Title and legend, and how much room the legend's further lines take.
    fn head(&self, width: f64) -> (String, f64) {
        let mut out = format!(
            "<text x=\"0\" y=\"32\" font-size=\"48\" font-weight=\"bold\" fill=\"{}\">{}</text>",
            hex(INK),
            escaped(&self.title)
        );
        let (mut right, mut down) = (0.0, 0.0);
        for (name, colour, is_dashed) in &self.legend {
            let long = 19.0 * FINE + name.chars().count() as f64 * LETTER;
            if right > 0.0 && right + long > width {
                (right, down) = (0.0, down + LEGEND);
            }
            let y = 104.0 + down;
            match (colour & 0xff < 0xff, is_dashed) {
                // Of a shade, a patch that can be told from the paper.
                (true, _) => rect(&mut out, [right, y - 18.0, right + 56.0, y + 18.0], *colour),
                (_, false) => stroke(&mut out, [right, y, right + 56.0, y], *colour, 12.0),
                (_, true) => {
                    stroke(&mut out, [right, y, right + 22.0, y], *colour, 6.0);
                    stroke(&mut out, [right + 34.0, y, right + 56.0, y], *colour, 6.0);
                }
            }
            let (x, ink) = (right + 76.0, hex(INK));
            let _ = write!(
                out,
                "<text x=\"{x}\" y=\"{y}\" fill=\"{ink}\">{}</text>",
                escaped(name)
            );
            right += long + 14.0 * FINE;
        }
        (out, down)
    }
}

fn rect(out: &mut String, [x, y, right, bottom]: [f64; 4], colour: Rgba) {
    let (wide, high, colour, opacity) = (right - x, bottom - y, hex(colour), opacity(colour));
    let _ = write!(
        out,
        "<rect x=\"{x}\" y=\"{y}\" width=\"{wide}\" height=\"{high}\" fill=\"{colour}\" fill-opacity=\"{opacity:.2}\"/>"
    );
}

fn stroke(out: &mut String, [x, y, right, bottom]: [f64; 4], colour: Rgba, width: f64) {
    let colour = hex(colour);
    let _ = write!(
        out,
        "<path stroke=\"{colour}\" stroke-width=\"{width}\" d=\"M{x} {y}L{right} {bottom}\"/>"
    );
}

fn text(out: &mut String, [x, y]: [f64; 2], text: &str, more: &str) {
    let colour = hex(GREY);
    let _ = write!(
        out,
        "<text x=\"{x}\" y=\"{y}\" fill=\"{colour}\"{more}>{text}</text>"
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers_within_the_range() {
        let labels = |axis: Axis, span: Range<f64>| -> Vec<String> {
            let ticks = axis.ticks(&span, 5.0).into_iter();
            ticks.map(|(_, label)| label).collect()
        };
        let even = ["−1.0", "−0.5", "0.0", "0.5", "1.0"];
        assert_eq!(labels(Axis::default(), -1.0..1.0), even);
        let decades = ["10⁻⁴", "0.01", "1", "100"];
        assert_eq!(labels(Axis::default().logarithmic(), -4.0..2.0), decades);
    }

    #[test]
    fn a_line_breaks_where_nothing_is_known_and_keeps_its_extremes() {
        let mut plot = Plot::new("x", 10.0, Axis::within(0.0..10.0));
        let value = |k: u32| if k == 555 { 9.0 } else { f64::from(k % 7) };
        let mut points: Vec<_> = (0..1000)
            .map(|k| (f64::from(k) / 100.0, value(k)))
            .collect();
        points[700].1 = f64::NAN;
        plot.line("line", BLUE, points, false);
        let svg = plot.svg([350.0, 200.0]);
        assert_eq!(svg.matches("<polyline").count(), 2);
        let [bottom, top] = [200.0 * FINE - FOOT, HEAD];
        let highest = format!(",{} ", (bottom - 0.9 * (bottom - top)).round());
        assert_eq!(svg.matches(&highest).count(), 1);
    }
}
