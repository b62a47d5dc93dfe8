//! The moments of a run that are worth a picture, and what happens at a tick, as the recording has it. PURE.

use std::ops::Range;

use glam::Vec3;
use shared_types::codes::{MODE_REGULAR, MODE_REORIENT};

use super::recorded::{Named, Recorded, at, between, joined, stretches};
use crate::narration::{NO_FAULT, capital, doing, lost};
use crate::signals::Signal;
use crate::solid::Placement;

/// Most pictures side by side.
const MOST: usize = 5;

/// The directions that ζ has had, as it turns: a line, whose sign may be either, followed without jumps; and how far it has turned, degrees.
pub(super) fn swept(frames: &[(u64, Placement)]) -> (Vec<Vec3>, f32) {
    let mut directions: Vec<Vec3> = Vec::new();
    let mut turned = 0.0;
    for (_, frame) in frames {
        let zeta = frame.R.x_axis.normalize_or(Vec3::X);
        let last = directions.last().copied().unwrap_or(zeta);
        let zeta = if last.dot(zeta) < 0.0 { -zeta } else { zeta };
        let angle = last.angle_between(zeta).to_degrees();
        if angle > 2.0 || directions.is_empty() {
            turned += angle;
            directions.push(zeta);
        }
    }
    // The last, smaller step.
    if let (Some(last), Some((_, frame))) = (directions.last(), frames.last()) {
        turned += last.dot(frame.R.x_axis).abs().min(1.0).acos().to_degrees();
    }
    (directions, turned)
}

impl Recorded {
    /// The value of a track at a tick where it is fresh: a place of the picture holds for one and a half pictures.
    pub(super) fn fresh<'t, T>(&self, track: &'t [(u64, T)], tick: u64) -> Option<&'t T> {
        let (known, value) = at(track, tick)?;
        (tick - known <= self.hold()).then_some(value)
    }

    fn hold(&self) -> u64 {
        (0.03 * self.rate_hz).ceil() as u64
    }

    /// The directions of ζ since the arm entered the neighbourhood it is in at a tick.
    pub(super) fn swept(&self, one: &Named, tick: u64) -> (Vec<Vec3>, f32) {
        let entered = one.entered(tick);
        swept(entered.map_or(&[], |from| between(&one.frame, from, tick)))
    }

    /// The singularities that control treats as such at a tick, each with what it does there; none where the arm is free.
    pub(super) fn told(&self, tick: u64) -> Vec<(&Named, String)> {
        let of = |one| {
            let (mode, mut words) = (Named::mode(one, tick), String::new());
            if one.entered(tick).is_some() {
                words = format!("the hand cannot {}; ", lost(one.is_angular(tick)));
                let (_, turned) = self.swept(one, tick);
                if turned > 5.0 {
                    words.push_str(&format!("ζ turned {turned:.0}°; "));
                }
            } else if mode == MODE_REGULAR {
                return None;
            }
            Some((one, words + doing(mode)))
        };
        self.singularities.iter().filter_map(of).collect()
    }

    /// The fault in force at a tick.
    pub(super) fn fault(&self, tick: u64) -> Option<&str> {
        let (_, words) = at(&self.faults, tick)?;
        Some(words.as_str()).filter(|words| *words != NO_FAULT.0)
    }

    /// Stretches in which some mode is not the regular one.
    fn singular(&self) -> Vec<Range<u64>> {
        let of = |one: &Named| stretches(&one.modes, self.last, |mode| *mode == MODE_REGULAR);
        let mut all: Vec<_> = self.singularities.iter().flat_map(of).collect();
        all.sort_by_key(|stretch| stretch.start);
        joined(all)
    }

    /// How far ζ of any singularity turns in a stretch; degrees.
    fn turned(&self, stretch: &Range<u64>) -> f32 {
        let of = |one: &Named| swept(one.inside(stretch.start, stretch.end)).1;
        self.singularities.iter().map(of).fold(0.0, f32::max)
    }

    /// The tick of a stretch at which |s|/η of any singularity is least.
    fn nearest(&self, from: u64, to: u64) -> Option<u64> {
        let lines = self.of(Signal::Measure).zip(&self.singularities);
        let near = lines.flat_map(|(line, one)| {
            let points = line.points.iter();
            points.map(|(t_s, s)| ((t_s * self.rate_hz).round() as u64, s.abs() / one.eta))
        });
        let near = near.filter(|(tick, near)| (from..=to).contains(tick) && near.is_finite());
        near.min_by(|a, b| a.1.total_cmp(&b.1))
            .map(|(tick, _)| tick)
    }

    /// Up to five moments with their names, in order; `fault`: the tick of the first fault.
    pub(super) fn moments(&self, fault: Option<u64>) -> Vec<(u64, String)> {
        let mut out = Vec::new();
        let mut add = |tick: u64, name: &str| out.push((tick.min(self.last), name.to_owned()));
        // Those that matter most first: the others go where there is no room.
        add(self.last, "End");
        fault.into_iter().for_each(|tick| add(tick, "Fault"));
        let longest = self.singular().into_iter();
        let longest = longest.max_by_key(|one| (self.turned(one) > 20.0, one.end - one.start));
        if let Some(stretch) = longest {
            self.locked(stretch, &mut add);
        } else if let Some(tick) = self.nearest(0, self.last) {
            add(tick, "Nearest to a singularity");
        }
        add(0, "Start");
        // Where there is room: the other singularities that the arm leaves, and the middle.
        for one in &self.singularities {
            for (tick, mode) in &one.modes {
                if *tick > 0 && *mode == MODE_REGULAR {
                    add(*tick, &format!("{} free", capital(&one.name)));
                }
            }
        }
        add(self.last / 2, "Halfway");
        // Moments too close to be told apart are one picture.
        let apart = (self.last / 50).max(1);
        let mut kept: Vec<(u64, String)> = Vec::new();
        for one in out {
            let is_apart = kept.iter().all(|other| other.0.abs_diff(one.0) >= apart);
            if kept.len() < MOST && is_apart {
                kept.push(one);
            }
        }
        kept.sort();
        kept
    }

    /// The moments of a stretch in which the arm is treated as singular, those that matter most first.
    fn locked(&self, stretch: Range<u64>, add: &mut impl FnMut(u64, &str)) {
        let Range {
            start: from,
            end: to,
        } = stretch;
        let turning = self.singularities.iter().find_map(|one| {
            let begins =
                |(tick, mode): &(u64, u32)| (from..=to).contains(tick) && *mode == MODE_REORIENT;
            let begin = one.modes.iter().position(begins)?;
            let end = one.modes.get(begin + 1).map_or(to, |next| next.0);
            Some((one.modes[begin].0, end))
        });
        let inside = self.singularities.iter().map(|one| one.inside(from, to));
        let entered = inside
            .clone()
            .filter_map(|rows| Some(rows.first()?.0))
            .min();
        let (entered, left) = (
            entered.unwrap_or(from),
            inside.filter_map(|rows| Some(rows.last()?.0)).max(),
        );
        add(entered, "Locked");
        if let Some((begin, end)) = turning {
            add((begin + end) / 2, "ζ turning");
            add(end, "ζ turned");
        }
        add(left.unwrap_or(to), "Leaving");
        let before = (0.5 * self.rate_hz) as u64;
        if from > before / 2 {
            add(from.saturating_sub(before), "Approach");
        }
        if turning.is_none()
            && let Some(tick) = self.nearest(entered, to)
        {
            add(tick, "Nearest");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recorded(modes: &[(u64, u32)], inside: Range<u64>) -> Recorded {
        let at = |tick: u64| {
            let R = glam::Mat3::from_rotation_z(0.0002 * tick as f32);
            (
                tick,
                Placement {
                    R,
                    ..Placement::IDENTITY
                },
            )
        };
        let lost = vec![
            (inside.start, (!inside.is_empty()).then_some(true)),
            (inside.end, None),
        ];
        let frame: Vec<_> = inside.step_by(20).map(at).collect();
        let modes = modes.to_vec();
        let one = Named {
            modes,
            frame,
            lost,
            ..Named::default()
        };
        Recorded {
            last: 10_000,
            rate_hz: 1000.0,
            singularities: vec![one],
            ..Recorded::default()
        }
    }

    #[test]
    fn a_turn_of_zeta_is_shown_before_in_the_middle_and_after_and_a_fault_when_it_comes() {
        let turning = [
            (0, MODE_REGULAR),
            (2000, 1),
            (3000, MODE_REORIENT),
            (5000, 2),
            (7000, MODE_REGULAR),
        ];
        for (modes, inside, fault, expected) in [
            (
                &turning[..],
                2500..6500,
                None,
                &[2500, 4000, 5000, 6480, 10_000][..],
            ),
            (&turning[..1], 0..0, None, &[0, 5000, 10_000]),
            (&turning[..1], 0..0, Some(3000), &[0, 3000, 5000, 10_000]),
        ] {
            let recorded = recorded(modes, inside);
            let moments = recorded.moments(fault);
            assert_eq!(
                moments.iter().map(|one| one.0).collect::<Vec<_>>(),
                expected
            );
            assert!(recorded.told(8000).is_empty() && recorded.told(100).is_empty());
            assert_eq!(recorded.told(4000).len(), usize::from(modes.len() > 1));
        }
    }

    #[test]
    fn zeta_is_a_line_and_turns_by_the_sum_of_its_steps() {
        // Once the same line, the other way round.
        let angle = |k: u64| 3.0 * k as f32 + if k == 10 { 180.0 } else { 0.0 };
        let about_z = |k| {
            (
                k,
                Placement {
                    R: glam::Mat3::from_rotation_z(angle(k).to_radians()),
                    p: Vec3::ZERO,
                },
            )
        };
        let (directions, turned) = swept(&(0..=30).map(about_z).collect::<Vec<_>>());
        assert!((turned - 90.0).abs() < 0.5, "{turned}");
        assert!(
            directions
                .windows(2)
                .all(|pair| pair[0].dot(pair[1]) > 0.99)
        );
    }
}
