//! Axes: how values become places, and where the ticks are.

use std::ops::Range;

/// How values become places.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Scale {
    /// Even steps.
    #[default]
    Linear,
    /// Even steps per power of ten.
    Logarithmic,
    /// Rows at 0, 1, … from the top.
    Names(Vec<String>),
}

/// One axis of a panel.
#[derive(Clone, Debug, Default)]
pub struct Axis {
    /// Written below the axis.
    pub label: String,
    /// Its scale.
    pub scale: Scale,
    /// From the data where there is none.
    pub range: Option<Range<f64>>,
    /// Without line, ticks and labels.
    pub hidden: bool,
}

impl Axis {
    /// A linear axis with a label.
    #[must_use]
    pub fn named(label: &str) -> Self {
        Self {
            label: label.to_owned(),
            ..Self::default()
        }
    }

    /// Shows this range.
    #[must_use]
    pub fn within(mut self, range: Range<f64>) -> Self {
        self.range = Some(range);
        self
    }

    /// With a logarithmic scale.
    #[must_use]
    pub fn logarithmic(mut self) -> Self {
        self.scale = Scale::Logarithmic;
        self
    }

    /// A row or a column for each name.
    #[must_use]
    pub fn names(names: impl IntoIterator<Item = String>) -> Self {
        Self {
            scale: Scale::Names(names.into_iter().collect()),
            ..Self::default()
        }
    }
}

/// The least and the largest of what is finite.
#[derive(Clone, Copy, Default)]
pub(super) struct Extent(Option<(f64, f64)>);

impl Extent {
    pub(super) fn add(&mut self, value: f64) {
        if value.is_finite() {
            let (low, high) = self.0.unwrap_or((value, value));
            self.0 = Some((low.min(value), high.max(value)));
        }
    }
}

impl Axis {
    /// Where a value lies before the axis is stretched over the page.
    pub(super) fn place(&self, value: f64) -> f64 {
        match self.scale {
            Scale::Logarithmic => value.log10(),
            _ => value,
        }
    }

    /// The range shown: the one asked for, or the data's, with air around it where `airy`.
    pub(super) fn span(&self, data: Extent, airy: bool) -> Range<f64> {
        if let Scale::Names(names) = &self.scale {
            return names.len() as f64 - 0.5..-0.5;
        }
        if let Some(range) = &self.range {
            return self.place(range.start)..self.place(range.end);
        }
        let (low, high) = data.0.unwrap_or((0.0, 1.0));
        let size = high - low;
        let air = if size < 1e-12 {
            0.5 * high.abs().max(1e-3)
        } else {
            f64::from(u8::from(airy)) * 0.06 * size
        };
        low - air..high + air
    }

    /// Places and labels of the ticks, at most `most` of them.
    pub(super) fn ticks(&self, span: &Range<f64>, most: f64) -> Vec<(f64, String)> {
        let (low, high) = (span.start.min(span.end), span.start.max(span.end));
        let step = nice((high - low) / most.max(1.0));
        match &self.scale {
            Scale::Names(names) => names
                .iter()
                .enumerate()
                .map(|(i, name)| (i as f64, name.clone()))
                .collect(),
            Scale::Linear => multiples(low, high, step)
                .map(|x| (x, fixed(x, step)))
                .collect(),
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
    power
        * [1.0, 2.0, 5.0, 10.0]
            .into_iter()
            .find(|factor| factor * power >= size * (1.0 - 1e-9))
            .unwrap_or(10.0)
}

fn multiples(low: f64, high: f64, step: f64) -> impl Iterator<Item = f64> {
    let (first, slack) = ((low / step - 1e-6).ceil(), high + 1e-6 * step);
    (0..200)
        .map(move |k| (first + f64::from(k)) * step)
        .take_while(move |x| *x <= slack)
}

/// A tick's value with the digits that its step needs.
fn fixed(value: f64, step: f64) -> String {
    let value = if value.abs() < 1e-9 * step {
        0.0
    } else {
        value
    };
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers_within_the_range() {
        let labels = |axis: &Axis, span: Range<f64>| {
            axis.ticks(&span, 5.0)
                .into_iter()
                .map(|(_, text)| text)
                .collect::<Vec<_>>()
        };
        assert_eq!(
            labels(&Axis::default(), -1.0..1.0),
            ["−1.0", "−0.5", "0.0", "0.5", "1.0"]
        );
        assert_eq!(
            labels(&Axis::default().logarithmic(), -4.0..2.0),
            ["10⁻⁴", "0.01", "1", "100"]
        );
    }
}
