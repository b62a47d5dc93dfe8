//! A recording as far as a page shows it: thinned lines, the log, the states.

use std::collections::BTreeMap;
use std::path::PathBuf;

use shared_types::summary::Summary;

use super::poses::Poses;
use crate::plot::{Axis, Color, GREY, Panel, RED};
use crate::read::{Piece, ReadError, ReadNews, read};
use crate::shortfall::Reading;
use crate::signals::{Kept, Signal};

/// Times at which a plotted line has points: more would not be seen.
const POINTS: u64 = 3000;
/// Ticks without a value that are no gap: values of a lower rate begin anew with each chunk.
fn patience(signal: Signal) -> f64 {
    if signal.of().kept == Kept::Slow {
        16.5
    } else {
        2.5
    }
}

/// A recording as far as a page shows it.
#[derive(Default)]
pub(super) struct Recorded {
    /// Of each signal its lines, element by element.
    pub(super) lines: BTreeMap<&'static str, Vec<Line>>,
    /// Tick, level, text.
    pub(super) log: Vec<(u64, String, String)>,
    /// Tick, lane, state.
    pub(super) states: Vec<(u64, String, String)>,
    /// Of the last tick; s.
    pub(super) end_s: f64,
    /// Names of the singularities, in order.
    pub(super) singularities: Vec<String>,
    /// Where the arm and the marks were.
    pub(super) poses: Poses,
    /// Faults in force: from when to when; s.
    pub(super) faults: Vec<std::ops::Range<f64>>,
}

/// A line of a plot: of so many successive values the least and the largest.
#[derive(Clone)]
pub(super) struct Line {
    pub(super) name: String,
    pub(super) points: Vec<(f64, f64)>,
    /// Where values are missing; s.
    pub(super) gaps: Vec<std::ops::Range<f64>>,
    stride: u64,
    gathered: u64,
    /// The time of the last value, and how much later the next may be without a gap; s.
    last_s: f64,
    patience_s: f64,
    least: (f64, f64),
    largest: (f64, f64),
}

impl Line {
    fn new(name: String, stride: u64, patience_s: f64) -> Self {
        Self {
            name,
            points: Vec::new(),
            gaps: Vec::new(),
            stride,
            gathered: 0,
            last_s: f64::INFINITY,
            patience_s,
            least: NOTHING.0,
            largest: NOTHING.1,
        }
    }

    fn push(&mut self, t_s: f64, value: f64) {
        if t_s > self.last_s + self.patience_s {
            // Nothing is drawn across what was lost.
            self.flush();
            self.points.push((t_s, f64::NAN));
            self.gaps.push(self.last_s..t_s);
        }
        self.last_s = t_s;
        if value < self.least.1 {
            self.least = (t_s, value);
        }
        if value > self.largest.1 {
            self.largest = (t_s, value);
        }
        self.gathered += 1;
        if self.gathered >= self.stride {
            self.flush();
        }
    }

    fn flush(&mut self) {
        let (a, b) = if self.least.0 <= self.largest.0 {
            (self.least, self.largest)
        } else {
            (self.largest, self.least)
        };
        if self.gathered > 0 && a.1.is_finite() {
            self.points.push(a);
            if a != b {
                self.points.push(b);
            }
        }
        self.gathered = 0;
        (self.least, self.largest) = NOTHING;
    }
}

/// The least and the largest of no values.
const NOTHING: ((f64, f64), (f64, f64)) = ((0.0, f64::INFINITY), (0.0, f64::NEG_INFINITY));

impl Recorded {
    pub(super) fn read(
        parts: &[PathBuf],
        summary: &Summary,
        reading: &mut Reading,
    ) -> Result<Self, ReadError> {
        let stride = summary.ticks.div_ceil(POINTS).max(1);
        let mut recorded = Self::default();
        let mut rate_hz = f64::from(summary.rate_hz.max(1));
        let mut values = Vec::new();
        read(parts, |piece| {
            match piece {
                Piece::About(about) => {
                    rate_hz = about.rate_hz();
                    recorded.singularities.clone_from(&about.singularities);
                    for signal in Signal::recorded() {
                        let lines = || {
                            signal
                                .elements(about.joints, &about.singularities)
                                .into_iter()
                                .map(|name| Line::new(name, stride, patience(signal) / rate_hz))
                                .collect()
                        };
                        recorded.lines.entry(signal.name()).or_insert_with(lines);
                    }
                }
                Piece::Rows(rows) => {
                    reading.add(ReadNews::Rows(rows.ticks.len() as u64));
                    for (row, tick) in rows.ticks.iter().enumerate() {
                        let t_s = *tick as f64 / rate_hz;
                        recorded.end_s = recorded.end_s.max(t_s);
                        for signal in Signal::recorded() {
                            values.clear();
                            rows.values(signal, row, &mut values);
                            let lines = recorded.lines.get_mut(signal.name()).into_iter().flatten();
                            lines
                                .zip(&values)
                                .for_each(|(line, value)| line.push(t_s, *value));
                        }
                    }
                }
                Piece::Event { tick, level, text } => recorded.log.push((tick, level, text)),
                Piece::State { tick, lane, state } => recorded.states.push((tick, lane, state)),
                Piece::Place { tick, of, p, xyzw } => recorded.poses.place(tick, of, p, xyzw),
                Piece::Label { tick, of, text } => recorded.poses.label(tick, of, &text),
                Piece::Damaged(damage) => reading.add(ReadNews::Damaged(&damage)),
            }
            Ok::<(), ReadError>(())
        })?;
        recorded.lines.values_mut().flatten().for_each(Line::flush);
        recorded.faults = recorded.stretches("fault", "none", rate_hz);
        Ok(recorded)
    }

    /// A diagram over time, with the faults in it.
    pub(super) fn blank(&self, title: &str, axis: Axis) -> Panel {
        let mut panel = Panel::new(title, self.time_axis(), axis);
        let shade = Color { 3: 0.16, ..RED };
        // A fault of one tick is seen, too.
        let least = 0.004 * self.end_s;
        self.faults.iter().for_each(|fault| {
            panel.band(
                "fault in force",
                shade,
                fault.start..fault.end.max(fault.start + least),
            )
        });
        panel
    }

    /// The lines of a signal.
    pub(super) fn of(&self, signal: Signal) -> impl Iterator<Item = &Line> {
        self.lines.get(signal.name()).into_iter().flatten()
    }

    /// A diagram of a signal's lines; `name`: how the legend calls them.
    pub(super) fn panel(
        &self,
        title: &str,
        signal: Signal,
        axis: Axis,
        colours: &[Color],
        name: impl Fn(&str) -> String,
    ) -> Panel {
        let mut panel = self.blank(title, axis);
        self.draw(&mut panel, signal, colours, name, |_, value| value);
        panel
    }

    /// Draws a signal's lines, their values changed by `of`, by the place of the line.
    pub(super) fn draw(
        &self,
        panel: &mut Panel,
        signal: Signal,
        colours: &[Color],
        name: impl Fn(&str) -> String,
        of: impl Fn(usize, f64) -> f64,
    ) {
        if let Some(line) = self.of(signal).max_by_key(|line| line.gaps.len()) {
            for gap in &line.gaps {
                panel.band("nothing recorded", Color { 3: 0.30, ..GREY }, gap.clone());
            }
        }
        for (i, (line, colour)) in self.of(signal).zip(colours.iter().cycle()).enumerate() {
            let points = line.points.iter();
            let points: Vec<_> = points.map(|(t_s, value)| (*t_s, of(i, *value))).collect();
            panel.line(&name(&line.name), *colour, &points);
        }
    }

    /// Signals over the joints' limits, with their titles; where the limits are infinite, hence all is 0, the signals themselves.
    pub(super) fn over_limit<const K: usize>(
        &self,
        ratios: [Signal; K],
        values: [Signal; K],
        unit: &str,
    ) -> ([Signal; K], String) {
        let moves = |signal: &Signal| {
            let mut lines = self.of(*signal);
            lines.any(|line| line.points.iter().any(|(_, value)| *value != 0.0))
        };
        match values.iter().any(moves) && !ratios.iter().any(moves) {
            true => (values, format!(", {unit}")),
            false => (ratios, " / limit".to_owned()),
        }
    }

    pub(super) fn time_axis(&self) -> Axis {
        Axis::named("time, s").within(0.0..self.end_s.max(1e-3))
    }

    /// When a lane's state was another than `rest`; s.
    pub(super) fn stretches(
        &self,
        lane: &str,
        rest: &str,
        rate_hz: f64,
    ) -> Vec<std::ops::Range<f64>> {
        let mut stretches = Vec::new();
        let mut since: Option<f64> = None;
        for (tick, _, state) in self.states.iter().filter(|(_, of, _)| of == lane) {
            let t_s = *tick as f64 / rate_hz;
            match (since, state == rest) {
                (None, false) => since = Some(t_s),
                (Some(from), true) => {
                    stretches.push(from..t_s);
                    since = None;
                }
                _ => {}
            }
        }
        stretches.extend(since.map(|from| from..self.end_s));
        stretches
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_keep_their_extremes_and_their_gaps_however_long_they_are() {
        let mut line = Line::new("x".to_owned(), 100, 2.5);
        (0..1000).for_each(|k| {
            line.push(
                f64::from(k),
                if k == 555 {
                    9.0
                } else {
                    f64::from(k % 7) * 0.1
                },
            )
        });
        line.push(1009.0, 1.0);
        assert!(line.points.len() <= 21 && line.points.contains(&(555.0, 9.0)));
        assert!(
            line.points.is_sorted_by(|a, b| a.0 < b.0)
                && line.points[line.points.len() - 1].1.is_nan()
        );
    }

    #[test]
    fn stretches_end_where_the_mode_is_regular_again() {
        let states = [
            (0, "reorient"),
            (10, "hold"),
            (20, "regular"),
            (30, "blend"),
        ];
        let states = states.map(|(tick, state)| (tick, "mode/wrist".to_owned(), state.to_owned()));
        let recorded = Recorded {
            states: states.into(),
            end_s: 0.05,
            ..Recorded::default()
        };
        let of = |lane| recorded.stretches(lane, "regular", 1000.0);
        assert_eq!(of("mode/wrist"), [0.0..0.02, 0.03..0.05]);
        assert!(of("mode/elbow").is_empty());
    }
}
