//! A run as far as a page shows it: thinned lines, the log, states and places over time.

use std::collections::BTreeMap;
use std::ops::Range;

use model::Robot;
use nalgebra::SVector;
use shared_types::codes::{KIND_NUMERIC, KINDS, MODE_REGULAR, MODES};
use shared_types::job::Job;

use super::plot::{Axis, GREY, Plot, RED, thinned};
use crate::arm::{placement, pose};
use crate::narration::{NO_FAULT, colour_of};
use crate::recording::Facts;
use crate::run::{Event, Happened, Tick};
use crate::scene::{Mark, Presence};
use crate::signals::{Signal, TickRow};
use crate::sink::RecordError;
use crate::solid::{Placement, Rgba};
use crate::story::{News, Story};
use crate::tint::faded;

/// Stretches of a plotted line, each of at most four points: more would not be seen.
const POINTS: u64 = 1500;
/// Ticks without a value that are no gap.
const PATIENCE: f64 = 2.5;
/// The contents of the plots.
const PLOTTED: [Signal; 13] = {
    use Signal::*;
    [
        Measure,
        PositionError,
        OrientationError,
        TorqueTask,
        TorqueNull,
        TorqueTaskRatio,
        TorqueNullRatio,
        PositionInRange,
        Speed,
        SpeedRatio,
        Beta,
        Scale,
        Latency,
    ]
};

/// Values over time, in the order of the ticks.
pub(super) type Track<T> = Vec<(u64, T)>;

/// The rows of a stretch, both ends included.
pub(super) fn between<T>(track: &[(u64, T)], from: u64, to: u64) -> &[(u64, T)] {
    let first = track.partition_point(|(tick, _)| *tick < from);
    let end = track.partition_point(|(tick, _)| *tick <= to);
    track.get(first..end).unwrap_or_default()
}

/// The last value up to a tick, and since when.
pub(super) fn at<T>(track: &[(u64, T)], tick: u64) -> Option<&(u64, T)> {
    between(track, 0, tick).last()
}

/// Stretches of time, sorted by their beginnings, as one where they touch.
pub(super) fn joined(stretches: impl IntoIterator<Item = Range<u64>>) -> Vec<Range<u64>> {
    let mut out: Vec<Range<u64>> = Vec::new();
    for next in stretches {
        match out.last_mut() {
            Some(last) if next.start <= last.end => last.end = last.end.max(next.end),
            _ => out.push(next),
        }
    }
    out
}

/// When values were others than at rest; `last`: the end of the run.
pub(super) fn stretches<T>(
    track: &[(u64, T)],
    last: u64,
    is_rest: impl Fn(&T) -> bool,
) -> Vec<Range<u64>> {
    let ends = track.iter().skip(1).map(|(tick, _)| *tick).chain([last]);
    let all = track.iter().zip(ends);
    joined(
        all.filter(|((_, value), _)| !is_rest(value))
            .map(|((from, _), to)| *from..to),
    )
}

/// A singularity over the run, and its mark.
#[derive(Default)]
pub(super) struct Named {
    pub(super) name: String,
    pub(super) kind: u32,
    pub(super) colour: Rgba,
    /// |s| below which the arm is treated as singular.
    pub(super) eta: f64,
    pub(super) modes: Track<u32>,
    /// The singular frame, x along ζ, where |s_i| is below twice η_out.
    pub(super) frame: Track<Placement>,
    /// Since when the arm is inside the neighbourhood or outside; inside, whether ζ is a rotation.
    pub(super) lost: Track<Option<bool>>,
}

impl Named {
    /// Whether ζ is a rotation at a tick.
    pub(super) fn is_angular(&self, tick: u64) -> bool {
        let known = between(&self.lost, 0, tick).iter().rev().chain(&self.lost);
        known.filter_map(|(_, lost)| *lost).next().unwrap_or(false)
    }

    /// Since when the arm is inside the neighbourhood; none where it is outside.
    pub(super) fn entered(&self, tick: u64) -> Option<u64> {
        let (since, lost) = at(&self.lost, tick)?;
        lost.map(|_| *since)
    }

    /// The frames in a stretch from the first tick inside the neighbourhood to the last one.
    pub(super) fn inside(&self, from: u64, to: u64) -> &[(u64, Placement)] {
        let frames = between(&self.frame, from, to);
        let is_inside = |(tick, _): &(u64, Placement)| self.entered(*tick).is_some();
        let first = frames.iter().position(is_inside).unwrap_or(frames.len());
        let last = frames.iter().rposition(is_inside);
        &frames[first..last.map_or(first, |last| last + 1)]
    }

    pub(super) fn mode(&self, tick: u64) -> u32 {
        at(&self.modes, tick).map_or(MODE_REGULAR, |(_, mode)| *mode)
    }
}

/// A run as far as a page shows it.
#[derive(Default)]
pub(super) struct Recorded {
    /// Of each signal its lines, element by element.
    pub(super) lines: BTreeMap<&'static str, Vec<Line>>,
    pub(super) log: Vec<Event>,
    /// The lane of faults.
    pub(super) faults: Track<String>,
    pub(super) rate_hz: f64,
    pub(super) last: u64,
    pub(super) singularities: Vec<Named>,
    pub(super) links: Vec<Track<Placement>>,
    pub(super) hand: Track<Placement>,
    pub(super) target: Track<Placement>,
}

/// A line of a plot: of so many successive values the first, the least, the largest and the last.
#[derive(Clone)]
pub(super) struct Line {
    pub(super) name: String,
    pub(super) points: Vec<(f64, f64)>,
    /// Where values are missing; s.
    gaps: Vec<Range<f64>>,
    /// The next values, at most `stride` of them.
    gathered: Vec<(f64, f64)>,
    stride: usize,
    /// The time of the last value, and how much later the next may be without a gap; s.
    last_s: f64,
    patience_s: f64,
}

impl Line {
    fn new(name: String, stride: usize, patience_s: f64) -> Self {
        Self {
            name,
            points: Vec::new(),
            gaps: Vec::new(),
            gathered: Vec::new(),
            stride,
            last_s: f64::INFINITY,
            patience_s,
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
        self.gathered.push((t_s, value));
        if self.gathered.len() >= self.stride {
            self.flush();
        }
    }

    fn flush(&mut self) {
        self.points.extend(thinned(&self.gathered, f64::INFINITY));
        self.gathered.clear();
    }
}

impl Recorded {
    /// Reads a run of about so many ticks.
    pub(super) fn read(
        job: &Job,
        robot: &Robot,
        ticks: impl Iterator<Item = Tick>,
        count: u64,
        happened: &Happened,
    ) -> Result<Self, RecordError> {
        let facts = Facts::new(job, robot, None, false)?;
        let mut recorded = Self {
            rate_hz: f64::from(facts.rate_hz),
            ..Self::default()
        };
        let (mut story, mut values) = (Story::new(job, happened), Vec::new());
        let stride = count.div_ceil(POINTS).max(1) as usize;
        for tick in ticks {
            let row = tick.row();
            story.push(&row, &mut |tick, news| recorded.tell(tick, &news));
            if recorded.singularities.is_empty() {
                recorded.meet(&row, job);
            }
            recorded.last = row.tick;
            let (t_s, now) = (recorded.seconds(row.tick), facts.now(&row));
            for signal in PLOTTED {
                values.clear();
                (signal.of().take)(&now, &mut values);
                let lines = recorded.lines.entry(signal.name()).or_default();
                if lines.is_empty() && !values.is_empty() {
                    let names = signal
                        .elements(robot.joints.len(), &story.names)
                        .into_iter();
                    let line = |name| Line::new(name, stride, PATIENCE / recorded.rate_hz);
                    lines.extend(names.map(line));
                }
                let pairs = lines.iter_mut().zip(&values);
                pairs.for_each(|(line, value)| line.push(t_s, *value));
            }
            if facts.is_pictured(row.tick) {
                recorded.see(&row, &facts);
            }
        }
        recorded.lines.values_mut().flatten().for_each(Line::flush);
        Ok(recorded)
    }

    /// The singularities of the first report.
    fn meet(&mut self, row: &TickRow, job: &Job) {
        for (i, one) in row.singularities().iter().enumerate() {
            let name = shared_types::codes::singularity_name(one.kind, i).to_owned();
            let kind = KINDS.iter().find(|(kind, _)| *kind == one.kind);
            let kind = kind.map_or(KIND_NUMERIC, |(kind, _)| *kind);
            self.singularities.push(Named {
                kind,
                colour: colour_of(kind, i),
                eta: job.scenario.analysis.eta_in.of(kind).max(1e-12),
                name,
                ..Named::default()
            });
        }
    }

    fn tell(&mut self, tick: u64, news: &News) {
        match news {
            News::Line(event) => self.log.push((*event).clone()),
            News::State {
                name: "fault",
                state,
                ..
            } => self.faults.push((tick, (*state).to_owned())),
            News::State { name, state, .. } => {
                let of = |one: &&mut Named| name.strip_prefix("mode/") == Some(one.name.as_str());
                if let Some(one) = self.singularities.iter_mut().find(of) {
                    let known = MODES.iter().find(|(_, known)| known == state);
                    one.modes
                        .push((tick, known.map_or(u32::MAX, |(code, _)| *code)));
                }
            }
        }
    }

    /// The places of everything that the pictures show.
    fn see(&mut self, row: &TickRow, facts: &Facts) {
        let (Some(q), tick) = (row.q(), row.tick) else {
            return;
        };
        let links = facts.links(q);
        self.links.resize_with(facts.figure.links.len(), Vec::new);
        for (track, link) in self.links.iter_mut().zip(links) {
            track.push((tick, link));
        }
        let kinematic = || placement(&facts.arm.forward_kinematics(&SVector::from(*q)));
        let hand = row.plant_state.map(|state| pose(&state.p_BE, &state.R_BE));
        self.hand.push((tick, hand.unwrap_or_else(kinematic)));
        let target = row
            .control_state
            .map(|state| (tick, pose(&state.p_BE_d, &state.R_BE_d)));
        self.target.extend(target);
        let Some(report) = row.singularity else {
            return;
        };
        for (named, one) in self.singularities.iter_mut().zip(row.singularities()) {
            let mark = Mark::new(one, report.p_BC);
            if mark.look.presence != Presence::Hidden {
                named.frame.push((tick, mark.X_BS));
            }
            let lost = mark.is_inside().then_some(mark.look.angular);
            if named.lost.last().is_none_or(|(_, before)| *before != lost) {
                named.lost.push((tick, lost));
            }
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }

    pub(super) fn seconds(&self, tick: u64) -> f64 {
        tick as f64 / self.rate_hz
    }

    pub(super) fn end_s(&self) -> f64 {
        self.seconds(self.last)
    }

    /// A diagram over time, with the faults in it.
    pub(super) fn blank(&self, title: &str, axis: Axis) -> Plot {
        let end_s = self.end_s();
        let mut plot = Plot::new(title, end_s, axis);
        // Hatched, whatever else is red. A fault of one tick is seen, too.
        let step = 0.008 * end_s.max(1e-3);
        for fault in stretches(&self.faults, self.last, |state| state == NO_FAULT.0) {
            let [from, to] = [fault.start, fault.end].map(|tick| self.seconds(tick));
            let count = ((to - from) / step).ceil().max(1.0) as u32;
            for begin in (0..count).map(|k| from + step * f64::from(k)) {
                plot.band("fault in force", faded(RED, 115), begin..begin + 0.5 * step);
            }
        }
        plot
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
        colours: &[Rgba],
        name: impl Fn(&str) -> String,
    ) -> Plot {
        let mut plot = self.blank(title, axis);
        self.draw(&mut plot, signal, colours, name, |_, value| value);
        plot
    }

    /// Draws a signal's lines, their values changed by `of`, by the place of the line.
    pub(super) fn draw(
        &self,
        plot: &mut Plot,
        signal: Signal,
        colours: &[Rgba],
        name: impl Fn(&str) -> String,
        of: impl Fn(usize, f64) -> f64,
    ) {
        if let Some(line) = self.of(signal).max_by_key(|line| line.gaps.len()) {
            for gap in &line.gaps {
                plot.band("nothing recorded", faded(GREY, 77), gap.clone());
            }
        }
        for (i, (line, colour)) in self.of(signal).zip(colours.iter().cycle()).enumerate() {
            let points = line.points.iter();
            let points = points.map(|(t_s, value)| (*t_s, of(i, *value))).collect();
            plot.line(&name(&line.name), *colour, points, false);
        }
    }

    /// Whether a signal is ever other than 0.
    pub(super) fn moves(&self, signal: Signal) -> bool {
        let mut points = self.of(signal).flat_map(|line| &line.points);
        points.any(|(_, value)| *value != 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_keep_their_extremes_and_their_gaps_however_long_they_are() {
        let mut line = Line::new("x".to_owned(), 100, 2.5);
        let value = |k| if k == 555 { 9.0 } else { f64::from(k % 7) };
        (0..1000).for_each(|k| line.push(f64::from(k), value(k)));
        line.push(1009.0, 1.0);
        assert!(line.points.len() <= 42 && line.points.contains(&(555.0, 9.0)));
        let is_sorted = line.points.is_sorted_by(|a, b| a.0 < b.0);
        assert!(is_sorted && line.points.last().is_some_and(|last| last.1.is_nan()));
    }

    #[test]
    fn stretches_end_where_the_mode_is_regular_again() {
        let modes = [(0, 5), (10, 4), (20, 0), (30, 1)];
        assert_eq!(stretches(&modes, 50, |mode| *mode == 0), [0..20, 30..50]);
        assert!(stretches(&modes[..0], 50, |mode| *mode == 0).is_empty());
    }
}
