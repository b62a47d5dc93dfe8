//! A run as far as a page shows it: thinned lines, the log, and what is seen 50 times a second. PURE.

use std::collections::BTreeMap;
use std::ops::Range;

use shared_types::codes::{MODE_REGULAR, MODE_REORIENT, MODES};
use shared_types::event::Event;

use crate::eye::Room;
use crate::facts::Facts;
use crate::narration::{NO_FAULT, capital};
use crate::picture::{Named, Picture, Scene};
use crate::run::Source;
use crate::scene::Presence;
use crate::signals::Signal;
use crate::story::{News, Story};

/// Stretches of a plotted line, each of at most four points: more would not be seen.
const STRETCHES: u64 = 700;
/// Ticks without a value that are no gap.
const PATIENCE: f64 = 2.5;
/// Most pictures side by side.
const MOST: usize = 5;
/// How often a caller hears how far it is; ticks.
const NEWS: u64 = 1000;

/// Values over time, in the order of the ticks.
pub(super) type Track<T> = Vec<(u64, T)>;

/// The last value up to a tick.
fn at<T>(track: &[(u64, T)], tick: u64) -> Option<&T> {
    let end = track.partition_point(|(known, _)| *known <= tick);
    Some(&track.get(end.checked_sub(1)?)?.1)
}

/// When values were others than at rest, as one stretch where two touch; `last`: the end of the run.
pub(super) fn stretches<T>(
    track: &[(u64, T)],
    last: u64,
    is_rest: impl Fn(&T) -> bool,
) -> Vec<Range<u64>> {
    let ends = track.iter().skip(1).map(|(tick, _)| *tick).chain([last]);
    let mut out: Vec<Range<u64>> = Vec::new();
    for ((from, _), to) in track.iter().zip(ends).filter(|one| !is_rest(&one.0.1)) {
        match out.last_mut() {
            Some(before) if *from <= before.end => before.end = before.end.max(to),
            _ => out.push(*from..to),
        }
    }
    out
}

/// A line of a plot: of so many successive values the first, the least, the largest and the last; NaN in a gap.
#[derive(Clone, Default)]
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
        let mut kept: Vec<usize> = [Some(0), low, high, count.checked_sub(1)]
            .into_iter()
            .flatten()
            .filter(|i| *i < count)
            .collect();
        kept.sort_unstable();
        kept.dedup();
        self.points
            .extend(kept.into_iter().map(|i| self.gathered[i]));
        self.gathered.clear();
    }
}

/// A run as far as a page shows it.
#[derive(Default)]
pub(super) struct Recorded {
    /// Of each signal its lines, element by element.
    pub(super) lines: BTreeMap<&'static str, Vec<Line>>,
    pub(super) log: Vec<Event>,
    /// The lane of faults, and the mode of each singularity.
    pub(super) faults: Track<String>,
    pub(super) modes: Vec<Track<u32>>,
    pub(super) named: Vec<Named>,
    pub(super) pictures: Vec<Picture>,
    room: Room,
    pub(super) rate_hz: f64,
    pub(super) last: u64,
}

impl Recorded {
    /// Reads a run of about so many ticks.
    pub(super) fn read(facts: &Facts, source: Source, count: u64, plotted: &[Signal]) -> Self {
        let mut recorded = Self {
            rate_hz: f64::from(facts.rate_hz),
            ..Self::default()
        };
        let mut scene = Scene::new(facts, Story::new(facts.job, &source.happened));
        let stride = count.div_ceil(STRETCHES).max(1) as usize;
        let patience_s = PATIENCE / recorded.rate_hz;
        let mut values = Vec::new();
        for (number, tick) in (0..).zip(source.ticks) {
            if number % NEWS == 0 && !(source.progress)(number) {
                break;
            }
            let row = tick.row();
            let picture = scene.push(facts, &row, &mut |tick, news| recorded.tell(tick, &news));
            if let Some(picture) = picture {
                recorded.room.push(facts, &picture);
                recorded.pictures.push(picture);
            }
            recorded.last = row.tick;
            let (t_s, now) = (recorded.seconds(row.tick), facts.now(&row));
            for signal in plotted {
                values.clear();
                (signal.of().take)(&now, &mut values);
                let lines = recorded.lines.entry(signal.name()).or_default();
                if lines.is_empty() && !values.is_empty() {
                    let names = signal.elements(facts.joints(), &scene.story.names);
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
        recorded.named = scene.named;
        recorded
    }

    fn tell(&mut self, tick: u64, news: &News) {
        match news {
            News::Line(event) => self.log.push((*event).clone()),
            News::State {
                name: "fault",
                state,
                ..
            } => self.faults.push((tick, (*state).to_owned())),
            News::State {
                of: Some(i), state, ..
            } => {
                let code = MODES.iter().find(|(_, known)| known == state);
                self.modes
                    .resize_with(self.modes.len().max(i + 1), Vec::new);
                self.modes[*i].push((tick, code.map_or(u32::MAX, |(code, _)| *code)));
            }
            News::State { .. } => (),
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

    /// Stretches with a fault in force.
    pub(super) fn faulty(&self) -> Vec<Range<u64>> {
        stretches(&self.faults, self.last, |state| state == NO_FAULT.0)
    }

    /// The fault in force at a tick.
    pub(super) fn fault(&self, tick: u64) -> Option<&String> {
        at(&self.faults, tick).filter(|state| *state != NO_FAULT.0)
    }

    /// The picture of a tick, or the last one before it.
    pub(super) fn picture(&self, tick: u64) -> Option<&Picture> {
        let end = self.pictures.partition_point(|one| one.tick <= tick);
        self.pictures.get(end.saturating_sub(1))
    }

    /// Up to five moments with their names, in order; `fault`: the tick of the first fault.
    pub(super) fn moments(&self, fault: Option<u64>) -> Track<String> {
        // Those that matter most first: the others go where there is no room.
        let mut all = vec![(self.last, "End".to_owned())];
        all.extend(fault.map(|tick| (tick, "Fault".to_owned())));
        match self.room.stay() {
            Some((first, last)) => self.locked(first, last, &mut all),
            None => all.extend(
                self.nearest(0, self.last)
                    .map(|tick| (tick, "Nearest to a singularity".to_owned())),
            ),
        }
        all.push((0, "Start".to_owned()));
        for (named, modes) in self.named.iter().zip(&self.modes) {
            let left = modes
                .iter()
                .filter(|(tick, mode)| *tick > 0 && *mode == MODE_REGULAR);
            all.extend(left.map(|(tick, _)| (*tick, capital(&named.name) + " free")));
        }
        all.push((self.last / 2, "Halfway".to_owned()));
        // Moments too close to be told apart are one picture.
        let apart = (self.last / 50).max(1);
        let mut kept: Track<String> = Vec::new();
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
        let marks = |one: &Picture| one.signs.iter().map(|sign| sign.mark).collect::<Vec<_>>();
        let all = self
            .between(first, last)
            .flat_map(|one| marks(one).into_iter().map(|mark| (one.tick, mark)));
        let seen = all.filter(|(_, mark)| mark.look.presence != Presence::Hidden);
        let nearest = seen.min_by(|a, b| b.1.size.total_cmp(&a.1.size));
        nearest.map(|(tick, _)| tick)
    }

    /// The moments of a stay inside a neighbourhood, those that matter most first.
    fn locked(&self, first: u64, last: u64, all: &mut Track<String>) {
        all.push((first, "Locked".to_owned()));
        let turns = |one: &&Picture| one.signs.iter().any(|sign| sign.mode == MODE_REORIENT);
        let turning: Vec<u64> = self
            .between(first, last)
            .filter(turns)
            .map(|one| one.tick)
            .collect();
        if let [begin, .., end] = turning[..] {
            all.extend([
                (begin.midpoint(end), "ζ turning".to_owned()),
                (end, "ζ turned".to_owned()),
            ]);
        }
        all.push((last, "Leaving".to_owned()));
        all.extend(
            first
                .checked_sub((0.5 * self.rate_hz) as u64)
                .map(|tick| (tick, "Approach".to_owned())),
        );
        if turning.is_empty() {
            all.extend(
                self.nearest(first, last)
                    .map(|tick| (tick, "Nearest".to_owned())),
            );
        }
    }
}
