//! A run as far as a page shows it: thinned lines, the log, and what is seen 50 times a second. PURE.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use shared_types::codes::{MODE_REGULAR, MODE_REORIENT, MODES, name_of};
use shared_types::event::Event;

use crate::eye::Room;
use crate::facts::Facts;
use crate::narration::{NO_FAULT, capital};
use crate::picture::{Picture, Scene};
use crate::run::Source;
use crate::signals::{Now, Signal};
use crate::sink::RecordError;
use crate::story::{Named, News};

/// Stretches of a plotted line, each of at most four points: more would not be seen.
const STRETCHES: u64 = 700;
/// Ticks without a value that are no gap.
const PATIENCE: f64 = 2.5;
/// Most pictures side by side.
const MOST: usize = 5;
/// How often a caller hears how far it is; ticks.
const NEWS: u64 = 1000;

/// Words at ticks, in their order.
type Track = Vec<(u64, String)>;

/// A line of a plot: of so many successive values the first, the least, the largest and the last; NaN in a gap.
#[derive(Default)]
pub(super) struct Line {
    pub(super) name: String,
    pub(super) points: Vec<(f64, f64)>,
    /// Where values are missing; s.
    pub(super) gaps: Vec<Range<f64>>,
    gathered: Vec<(f64, f64)>,
}

impl Line {
    fn push(&mut self, at: (f64, f64), stride: usize, patience_s: f64) {
        let last = self.gathered.last().or(self.points.last());
        if let Some((last_s, _)) = last.copied().filter(|last| at.0 > last.0 + patience_s) {
            // Nothing is drawn across what was lost.
            self.flush();
            self.points.push((at.0, f64::NAN));
            self.gaps.push(last_s..at.0);
        }
        self.gathered.push(at);
        if self.gathered.len() >= stride {
            self.flush();
        }
    }

    fn flush(&mut self) {
        let by_value = |a: &usize, b: &usize| self.gathered[*a].1.total_cmp(&self.gathered[*b].1);
        let count = self.gathered.len();
        let (low, high) = ((0..count).min_by(by_value), (0..count).max_by(by_value));
        // None of nothing.
        let kept = [low.map(|_| 0), low, high, count.checked_sub(1)];
        let kept: BTreeSet<usize> = kept.into_iter().flatten().collect();
        self.points.extend(kept.iter().map(|i| self.gathered[*i]));
        self.gathered.clear();
    }
}

/// A run as far as a page shows it.
#[derive(Default)]
pub(super) struct Recorded {
    /// Of each signal its lines, element by element.
    pub(super) lines: BTreeMap<&'static str, Vec<Line>>,
    pub(super) log: Vec<Event>,
    /// The lanes of the state timeline, by their names.
    lanes: BTreeMap<String, Track>,
    pub(super) named: Vec<Named>,
    pub(super) pictures: Vec<Picture>,
    room: Room,
    pub(super) rate_hz: f64,
    pub(super) last: u64,
}

impl Recorded {
    /// Reads a run of about so many ticks.
    ///
    /// # Errors
    /// [`RecordError::Stopped`] where the source's `progress` has ended it.
    pub(super) fn read(
        facts: &Facts,
        source: Source,
        count: u64,
        plotted: &[Signal],
    ) -> Result<Self, RecordError> {
        let mut recorded = Self {
            rate_hz: f64::from(facts.rate_hz),
            ..Self::default()
        };
        let mut scene = Scene::new(facts);
        let stride = count.div_ceil(STRETCHES).max(1) as usize;
        let patience_s = PATIENCE / recorded.rate_hz;
        let mut values = Vec::new();
        for (number, tick) in (0..).zip(source.ticks) {
            if number % NEWS == 0 && !(source.progress)(number) {
                return Err(RecordError::Stopped);
            }
            let picture = scene.push(facts, &tick, &mut |tick, news| recorded.tell(tick, news));
            recorded.pictures.extend(picture);
            recorded.last = tick.tick;
            let (t_s, now) = (recorded.seconds(tick.tick), Now::new(&tick, facts));
            for signal in plotted {
                values.clear();
                (signal.of().take)(&now, &mut values);
                let lines = recorded.lines.entry(signal.name()).or_default();
                if lines.is_empty() && !values.is_empty() {
                    let names = signal.elements(facts.joints(), &scene.story.named);
                    let line = |name| Line {
                        name,
                        ..Line::default()
                    };
                    lines.extend(names.into_iter().map(line));
                }
                for (line, value) in lines.iter_mut().zip(&values) {
                    line.push((t_s, *value), stride, patience_s);
                }
            }
        }
        recorded.lines.values_mut().flatten().for_each(Line::flush);
        // The log tells of a fault or a loss when it is known, not when it happened.
        recorded.log.sort_by_key(|event| event.tick);
        (recorded.named, recorded.room) = (scene.story.named, scene.room);
        Ok(recorded)
    }

    fn tell(&mut self, tick: u64, news: News) {
        match news {
            News::Line(event) => self.log.push(event.clone()),
            News::State { name, state, .. } => {
                self.lanes
                    .entry(name.to_owned())
                    .or_default()
                    .push((tick, state.to_owned()));
            }
        }
    }

    pub(super) fn seconds(&self, tick: u64) -> f64 {
        tick as f64 / self.rate_hz
    }

    pub(super) fn end_s(&self) -> f64 {
        self.seconds(self.last)
    }

    /// The lines of a signal.
    pub(super) fn of(&self, signal: Signal) -> &[Line] {
        self.lines.get(signal.name()).map_or(&[], Vec::as_slice)
    }

    /// The words of a lane, with their ticks.
    fn lane(&self, name: &str) -> &[(u64, String)] {
        self.lanes.get(name).map_or(&[], Vec::as_slice)
    }

    fn modes(&self, named: &Named) -> &[(u64, String)] {
        self.lane(&format!("mode/{}", named.name))
    }

    /// When a lane told something else than `rest`, as one stretch where two touch; s.
    fn stretches(&self, lane: &[(u64, String)], rest: &str) -> Vec<Range<f64>> {
        let ends = lane.iter().skip(1).map(|(tick, _)| *tick);
        let all = lane.iter().zip(ends.chain([self.last]));
        let mut out: Vec<Range<f64>> = Vec::new();
        for ((from, _), to) in all.filter(|((_, state), _)| state != rest) {
            let [from, to] = [*from, to].map(|tick| self.seconds(tick));
            match out.last_mut() {
                Some(before) if from <= before.end => before.end = before.end.max(to),
                _ => out.push(from..to),
            }
        }
        out
    }

    /// Stretches with a fault in force; s.
    pub(super) fn faulty(&self) -> Vec<Range<f64>> {
        self.stretches(self.lane("fault"), NO_FAULT.0)
    }

    /// Stretches in which control at a singularity is not the regular one; s.
    pub(super) fn irregular(&self, named: &Named) -> Vec<Range<f64>> {
        self.stretches(self.modes(named), name_of(MODES, MODE_REGULAR))
    }

    /// The fault in force at a tick.
    pub(super) fn fault(&self, tick: u64) -> Option<&String> {
        let mut until = self.lane("fault").iter().rev();
        let (_, state) = until.find(|(known, _)| *known <= tick)?;
        Some(state).filter(|state| *state != NO_FAULT.0)
    }

    /// The picture of a tick, or the last one before it.
    pub(super) fn picture(&self, tick: u64) -> Option<&Picture> {
        let end = self.pictures.partition_point(|one| one.tick <= tick);
        self.pictures.get(end.saturating_sub(1))
    }

    /// Up to five moments with their names, in order; `fault`: the tick of the first fault.
    pub(super) fn moments(&self, fault: Option<u64>) -> Track {
        // Those that matter most first: the others go where there is no room.
        let mut all = vec![(self.last, "End".to_owned())];
        let mut add =
            |tick: Option<u64>, name: &str| all.extend(tick.map(|tick| (tick, name.to_owned())));
        add(fault, "Fault");
        match self.room.stay() {
            Some((first, last)) => self.locked(first, last, &mut add),
            None => add(self.nearest(0, self.last), "Nearest to a singularity"),
        }
        add(Some(0), "Start");
        for named in &self.named {
            let regular = name_of(MODES, MODE_REGULAR);
            for (tick, mode) in self.modes(named) {
                let is_left = *tick > 0 && mode == regular;
                add(is_left.then_some(*tick), &(capital(&named.name) + " free"));
            }
        }
        add(Some(self.last / 2), "Halfway");
        // Moments too close to be told apart are one picture.
        let apart = (self.last / 50).max(1);
        let mut kept = Track::new();
        for (tick, name) in all {
            let is_apart = kept.iter().all(|other| other.0.abs_diff(tick) >= apart);
            if kept.len() < MOST && is_apart && tick <= self.last {
                kept.push((tick, name));
            }
        }
        kept.sort_unstable();
        kept
    }

    /// The pictures of a stretch, both ends included.
    fn between(&self, first: u64, last: u64) -> impl Iterator<Item = &Picture> {
        self.pictures
            .iter()
            .filter(move |one| (first..=last).contains(&one.tick))
    }

    /// When the arm is nearest to a singularity whose mark is seen.
    fn nearest(&self, first: u64, last: u64) -> Option<u64> {
        let marks = |one: &Picture| {
            let marks = one.signs.iter().map(|sign| sign.mark);
            marks
                .filter(|mark| mark.is_seen)
                .map(|mark| (one.tick, mark.size))
                .collect::<Vec<_>>()
        };
        let nearest = self
            .between(first, last)
            .flat_map(marks)
            .min_by(|a, b| b.1.total_cmp(&a.1));
        nearest.map(|(tick, _)| tick)
    }

    /// The moments of a stay inside a neighbourhood, those that matter most first.
    fn locked(&self, first: u64, last: u64, add: &mut dyn FnMut(Option<u64>, &str)) {
        add(Some(first), "Locked");
        let turns = |one: &&Picture| one.signs.iter().any(|sign| sign.mode == MODE_REORIENT);
        let turning: Vec<u64> = self
            .between(first, last)
            .filter(turns)
            .map(|one| one.tick)
            .collect();
        if let [begin, .., end] = turning[..] {
            add(Some(begin.midpoint(end)), "ζ turning");
            add(Some(end), "ζ turned");
        }
        add(Some(last), "Leaving");
        add(first.checked_sub((0.5 * self.rate_hz) as u64), "Approach");
        if turning.is_empty() {
            add(self.nearest(first, last), "Nearest");
        }
    }
}
