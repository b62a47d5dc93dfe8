//! A diagram over time: what a template needs to draw it. Units of the drawing are quarters of a point. PURE.

use std::fmt::Write;
use std::ops::Range;

use serde_json::{Value, json};

use crate::pose::Rgba;
use crate::tint::{hex, opacity};

/// Room for labels at the left and below, and at the other sides for halves of labels.
const LEFT: f64 = 190.0;
const FOOT: f64 = 110.0;
const EDGE: f64 = 60.0;

/// A line of a diagram; dashed: what is wanted, limits. Not a number: nothing is known there.
#[derive(Clone, Debug)]
pub(super) struct Curve {
    pub(super) name: String,
    pub(super) colour: Rgba,
    pub(super) is_dashed: bool,
    pub(super) points: Vec<(f64, f64)>,
}

/// A diagram over time; the title names the vertical quantity and its unit.
#[derive(Clone, Debug, Default)]
pub(super) struct Plot {
    pub(super) title: String,
    pub(super) end_s: f64,
    pub(super) is_logarithmic: bool,
    /// The values shown; the data's where there are none.
    pub(super) range: Option<Range<f64>>,
    pub(super) curves: Vec<Curve>,
    /// Stretches of time behind the curves, and those with a fault.
    pub(super) bands: Vec<(Range<f64>, Rgba)>,
    pub(super) faults: Vec<Range<f64>>,
    /// All that is below a value, behind the curves.
    pub(super) floor: Option<(f64, Rgba)>,
}

impl Plot {
    fn place(&self, value: f64) -> f64 {
        if self.is_logarithmic {
            value.log10()
        } else {
            value
        }
    }

    /// The places shown: those asked for, or the data's with air around them.
    fn span(&self) -> Range<f64> {
        if let Some(range) = &self.range {
            return self.place(range.start)..self.place(range.end);
        }
        let places = self
            .curves
            .iter()
            .flat_map(|curve| &curve.points)
            .map(|(_, value)| self.place(*value));
        let (low, high) = places
            .filter(|place| place.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), y| {
                (low.min(y), high.max(y))
            });
        if low.is_finite() {
            let air = (0.06 * (high - low)).max(0.05 * low.abs().max(1e-3));
            low - air..high + air
        } else {
            0.0..1.0
        }
    }

    /// The values of the template `plot`, for a drawing of so many points: the place and the range of the data, so that the page can read off values, too.
    pub(super) fn drawing(&self, [width, height]: [f64; 2]) -> Value {
        let ([right, bottom], span) = ([4.0 * width - EDGE, 4.0 * height - FOOT], self.span());
        let share = |value: f64, span: &Range<f64>| {
            ((value - span.start) / (span.end - span.start)).clamp(0.0, 1.0)
        };
        let time = 0.0..self.end_s.max(1e-3);
        let x = |t_s: f64| (LEFT + share(t_s, &time) * (right - LEFT)).round();
        let y = |place: f64| (bottom - share(place, &span) * (bottom - EDGE / 2.0)).round();
        let band = |stretch: &Range<f64>, colour| {
            let (from, to) = (x(stretch.start), x(stretch.end));
            json!([from, (to - from).max(8.0), hex(colour), opacity(colour)])
        };
        let lines = self.curves.iter().map(|curve| {
            let points: Vec<(f64, f64)> =
                curve.points.iter().map(|(t_s, value)| (*t_s, self.place(*value))).collect();
            let stretches = points.split(|(_, place)| !place.is_finite());
            let path = stretches.fold(String::new(), |mut path, points| {
                for (k, (t_s, place)) in points.iter().enumerate() {
                    let _ = write!(path, "{}{} {}", if k == 0 { "M" } else { "L" }, x(*t_s), y(*place));
                }
                path
            });
            json!({ "name": curve.name, "colour": hex(curve.colour), "dashed": curve.is_dashed, "path": path })
        });
        let values = ticks(&span, (bottom - EDGE / 2.0) / 136.0, self.is_logarithmic);
        let values = values.into_iter().map(|(place, label)| (y(place), label));
        let seconds = ticks(&time, (right - LEFT) / 248.0, false);
        let seconds = seconds.into_iter().map(|(t_s, label)| (x(t_s), label));
        json!({
            "left": LEFT, "right": right, "top": EDGE / 2.0, "bottom": bottom,
            "width": 4.0 * width, "height": 4.0 * height,
            "low": span.start, "high": span.end, "log": u8::from(self.is_logarithmic),
            "values": values.collect::<Vec<_>>(), "seconds": seconds.collect::<Vec<_>>(),
            "bands": self.bands.iter().map(|(stretch, colour)| band(stretch, *colour)).collect::<Value>(),
            "faults": self.faults.iter().map(|stretch| band(stretch, 0)).collect::<Value>(),
            "floor": self.floor.map(|(value, colour)| json!([y(self.place(value)), hex(colour), opacity(colour)])),
            "lines": lines.collect::<Value>(),
        })
    }
}

/// Places and labels of at most `most` round numbers: powers of ten where places are logarithms.
fn ticks(span: &Range<f64>, most: f64, is_logarithmic: bool) -> Vec<(f64, String)> {
    // 1, 2 or 5 times a power of ten.
    let size = (span.end - span.start) / most.max(1.0);
    let power = 10f64.powf(size.max(1e-300).log10().floor());
    let factors = [1.0, 2.0, 5.0, 10.0].into_iter();
    let step = factors
        .map(|factor| factor * power)
        .find(|step| *step >= size * (1.0 - 1e-9))
        .map_or(1.0, |step| if is_logarithmic { step.ceil() } else { step });
    let (first, last) = (span.start / step - 1e-6, span.end / step + 1e-6);
    let all = (first.ceil() as i64..=last.floor() as i64).take(200);
    let label = |k: i64| {
        let place = k as f64 * step;
        let text = match is_logarithmic {
            true if place.abs() <= 2.0 => format!("{}", 10f64.powf(place)),
            true => format!("1e{place}"),
            false => {
                let digits = (-step.log10() - 0.001).ceil().clamp(0.0, 6.0) as usize;
                format!("{place:.digits$}")
            }
        };
        (place, text.replace('-', "−"))
    };
    all.map(label).collect()
}
