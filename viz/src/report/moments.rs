//! The moments of a run that are worth a picture, and what happens at a tick, as the recording has it. PURE.

use shared_types::codes::{MODE_REGULAR, MODES, name_of};

use super::drawing::Named;
use super::poses::{Poses, swept};
use super::recorded::Recorded;
use crate::narration::{NO_FAULT, capital, doing, lost};

/// Most pictures side by side.
const MOST: usize = 5;

/// A moment with its name.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Moment {
    pub(super) tick: u64,
    pub(super) name: String,
}

/// Modes of one singularity over time.
#[derive(Clone, Debug, Default)]
struct Modes(Vec<(u64, u32)>);

impl Modes {
    fn of(recorded: &Recorded, name: &str) -> Self {
        let lane = format!("mode/{name}");
        let code = |state: &str| {
            MODES
                .iter()
                .find(|(_, known)| *known == state)
                .map_or(u32::MAX, |(code, _)| *code)
        };
        Self(
            recorded
                .states
                .iter()
                .filter(|(_, of, _)| *of == lane)
                .map(|(tick, _, state)| (*tick, code(state)))
                .collect(),
        )
    }

    /// The mode at a tick.
    fn at(&self, tick: u64) -> u32 {
        self.0[..self.0.partition_point(|(known, _)| *known <= tick)]
            .last()
            .map_or(MODE_REGULAR, |(_, mode)| *mode)
    }
}

/// The modes of all singularities.
pub(super) struct Course<'a> {
    singularities: &'a [Named],
    modes: Vec<Modes>,
    poses: &'a Poses,
    /// The words of the lane of faults, since when.
    faults: Vec<(u64, &'a str)>,
    last: u64,
    rate_hz: f64,
}

impl<'a> Course<'a> {
    pub(super) fn new(recorded: &'a Recorded, singularities: &'a [Named], rate_hz: f64) -> Self {
        let modes = singularities
            .iter()
            .map(|one| Modes::of(recorded, &one.name))
            .collect();
        let last = (recorded.end_s * rate_hz).round() as u64;
        let faults = recorded
            .states
            .iter()
            .filter(|(_, lane, _)| lane == "fault")
            .map(|(tick, _, words)| (*tick, words.as_str()))
            .collect();
        Self {
            singularities,
            modes,
            poses: &recorded.poses,
            faults,
            last,
            rate_hz,
        }
    }

    /// The singularities that control treats as such at a tick, each with what it does there; none where the arm is free.
    pub(super) fn at(&self, tick: u64) -> Vec<(&'a Named, String)> {
        let of = |(one, modes): (&'a Named, &Modes)| {
            let mode = modes.at(tick);
            let mark = self.poses.marks.get(&one.name);
            let is_inside = mark.is_some_and(|mark| mark.label.fresh(tick, self.hold()).is_some());
            if mode == MODE_REGULAR && !is_inside {
                return None;
            }
            let mut words = String::new();
            if let Some(mark) = mark.filter(|_| is_inside) {
                words = format!("the hand cannot {}; ", lost(mark.is_angular(tick)));
                let (_, turned) = swept(mark.since_entry(tick, self.hold()));
                if turned > 5.0 {
                    words.push_str(&format!("ζ turned {turned:.0}°; "));
                }
            }
            words.push_str(doing(mode));
            Some((one, words))
        };
        self.singularities
            .iter()
            .zip(&self.modes)
            .filter_map(of)
            .collect()
    }

    /// The fault in force at a tick.
    pub(super) fn fault(&self, tick: u64) -> Option<&'a str> {
        self.faults
            .iter()
            .rfind(|(known, _)| *known <= tick)
            .map(|(_, words)| *words)
            .filter(|words| *words != NO_FAULT.0)
    }

    /// A place of the picture holds for so many ticks.
    fn hold(&self) -> u64 {
        (0.03 * self.rate_hz).ceil() as u64
    }

    /// The ticks at which modes change.
    fn changes(&self) -> impl Iterator<Item = (u64, u32)> {
        self.modes.iter().flat_map(|modes| modes.0.iter().copied())
    }

    /// Stretches in which some mode is not the regular one.
    fn stretches(&self) -> Vec<(u64, u64)> {
        let mut ticks: Vec<u64> = self.changes().map(|(tick, _)| tick).collect();
        ticks.sort_unstable();
        ticks.dedup();
        let mut stretches: Vec<(u64, u64)> = Vec::new();
        let mut since: Option<u64> = None;
        for tick in ticks {
            let is_regular = self
                .modes
                .iter()
                .all(|modes| modes.at(tick) == MODE_REGULAR);
            match (since, is_regular) {
                (None, false) => since = Some(tick),
                (Some(from), true) => {
                    stretches.push((from, tick));
                    since = None;
                }
                _ => {}
            }
        }
        stretches.extend(since.map(|from| (from, self.last)));
        stretches
    }

    /// How far ζ of any singularity turns in a stretch; degrees.
    fn turned(&self, (from, to): (u64, u64)) -> f32 {
        let of = |one: &Named| {
            self.poses
                .marks
                .get(&one.name)
                .map_or(0.0, |mark| swept(mark.inside(from, to)).1)
        };
        self.singularities.iter().map(of).fold(0.0, f32::max)
    }

    /// Up to five moments, in order; `nearest`: the tick of the least |s|/η, `fault`: that of the first fault.
    pub(super) fn moments(
        &self,
        nearest: impl Fn(u64, u64) -> Option<u64>,
        fault: Option<u64>,
    ) -> Vec<Moment> {
        let moment = |tick: u64, name: &str| self.moment(tick, name);
        let mut out = vec![moment(self.last, "End")];
        // Those that matter most first: the others go where there is no room.
        out.extend(fault.map(|tick| moment(tick, "Fault")));
        let longest = self.stretches().into_iter();
        let longest =
            longest.max_by_key(|(from, to)| (self.turned((*from, *to)) > 20.0, to - from));
        if let Some((from, to)) = longest {
            out.extend(self.locked(from, to, &nearest));
        } else {
            out.extend(nearest(0, self.last).map(|tick| moment(tick, "Nearest to a singularity")));
        }
        if !out.iter().any(|one| one.tick == 0) {
            out.push(moment(0, "Start"));
        }
        // Where there is room: the other singularities that the arm leaves, and the middle.
        for (one, modes) in self.singularities.iter().zip(&self.modes) {
            let freed = modes
                .0
                .iter()
                .filter(|(tick, mode)| *tick > 0 && *mode == MODE_REGULAR);
            out.extend(
                freed.map(|(tick, _)| moment(*tick, &format!("{} free", capital(&one.name)))),
            );
        }
        out.push(moment(self.last / 2, "Halfway"));
        // Moments too close to be told apart are one picture.
        let apart = (self.last / 50).max(1);
        let mut kept: Vec<Moment> = Vec::new();
        for one in out {
            if kept.len() < MOST
                && kept
                    .iter()
                    .all(|other| other.tick.abs_diff(one.tick) >= apart)
            {
                kept.push(one);
            }
        }
        kept.sort_by_key(|one| one.tick);
        kept
    }

    fn moment(&self, tick: u64, name: &str) -> Moment {
        Moment {
            tick: tick.min(self.last),
            name: name.to_owned(),
        }
    }

    /// The moments of a stretch in which the arm is treated as singular, those that matter most first.
    fn locked(&self, from: u64, to: u64, nearest: impl Fn(u64, u64) -> Option<u64>) -> Vec<Moment> {
        let reorient = |code: u32| name_of(MODES, code) == "reorient";
        let turning = self.modes.iter().find_map(|modes| {
            let begins = |(tick, mode): &(u64, u32)| (from..=to).contains(tick) && reorient(*mode);
            let begin = modes.0.iter().position(begins)?;
            let end = modes.0.get(begin + 1).map_or(to, |next| next.0);
            Some((modes.0[begin].0, end))
        });
        let entered = self.entered(from, to).unwrap_or(from);
        let mut out = vec![self.moment(entered, "Locked")];
        if let Some((begin, end)) = turning {
            out.push(self.moment((begin + end) / 2, "ζ turning"));
            out.push(self.moment(end, "ζ turned"));
        }
        out.push(self.moment(self.left(from, to).unwrap_or(to), "Leaving"));
        let before = (0.5 * self.rate_hz) as u64;
        if from > before / 2 {
            out.push(self.moment(from.saturating_sub(before), "Approach"));
        }
        if turning.is_none() {
            out.extend(nearest(entered, to).map(|tick| self.moment(tick, "Nearest")));
        }
        out
    }

    /// When the arm is first inside a neighbourhood in a stretch.
    fn entered(&self, from: u64, to: u64) -> Option<u64> {
        self.poses
            .marks
            .values()
            .filter_map(|mark| Some(mark.label.between(from, to).first()?.0))
            .min()
    }

    /// When it has left the last one.
    fn left(&self, from: u64, to: u64) -> Option<u64> {
        self.poses
            .marks
            .values()
            .filter_map(|mark| Some(mark.label.between(from, to).last()?.0))
            .max()
    }

    /// Ticks from which on other words hold.
    pub(super) fn turning_points(&self) -> Vec<u64> {
        let changes = self
            .changes()
            .map(|(tick, _)| tick)
            .chain(self.faults.iter().map(|(tick, _)| *tick));
        let mut ticks: Vec<u64> = std::iter::once(0).chain(changes).collect();
        ticks.sort_unstable();
        ticks.dedup();
        ticks
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recorded(states: &[(u64, &str)], inside: std::ops::Range<u64>) -> Recorded {
        let mut recorded = Recorded {
            end_s: 10.0,
            ..Recorded::default()
        };
        let state =
            |(tick, state): &(u64, &str)| (*tick, "mode/wrist".to_owned(), (*state).to_owned());
        recorded.states = states.iter().map(state).collect();
        for tick in inside.step_by(20) {
            let xyzw = glam::Quat::from_rotation_z(0.0002 * tick as f32).to_array();
            let poses = &mut recorded.poses;
            poses.place(tick, "/world/singularity/wrist", [0.0; 3], xyzw);
            poses.place(tick, "/world/label/wrist", [0.0; 3], [0.0, 0.0, 0.0, 1.0]);
        }
        recorded
    }

    #[test]
    fn a_turn_of_zeta_is_shown_before_in_the_middle_and_after_and_a_fault_when_it_comes() {
        let singularities = Named::all(&["wrist".to_owned()]);
        let turning = [
            (0, "regular"),
            (2000, "blend"),
            (3000, "reorient"),
            (5000, "track"),
            (7000, "regular"),
        ];
        for (states, inside, fault, expected) in [
            (
                &turning[..],
                2500..6500,
                None,
                &[2500, 4000, 5000, 6480, 10_000][..],
            ),
            (&turning[..1], 0..0, None, &[0, 5000, 10_000]),
            (&turning[..1], 0..0, Some(3000), &[0, 3000, 5000, 10_000]),
        ] {
            let recorded = recorded(states, inside);
            let course = Course::new(&recorded, &singularities, 1000.0);
            let moments = course.moments(|from, to| Some((from + to) / 2), fault);
            assert_eq!(
                moments.iter().map(|one| one.tick).collect::<Vec<_>>(),
                expected
            );
            assert!(course.at(8000).is_empty() && course.at(100).is_empty());
            assert_eq!(course.at(4000).len(), usize::from(states.len() > 1));
        }
    }
}
