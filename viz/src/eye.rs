//! From where the arm is seen. PURE.

use glam::Vec3;

use crate::facts::Facts;
use crate::picture::Picture;
use crate::pose::span;

/// From where something is seen; base axes, m.
pub(crate) struct Eye {
    pub(crate) position: Vec3,
    pub(crate) look_at: Vec3,
    pub(crate) up: Vec3,
}

/// The part of half of Rerun's upright field of view that is used.
const TANGENT: f32 = 0.49;
/// The close-up's distance, in half lengths of the mark: the hand fills a third of the picture.
const CLOSE: f32 = 4.0;

/// The room that an arm has taken so far, and its longest stay inside a neighbourhood.
#[derive(Default)]
pub(crate) struct Room {
    /// Its hand at the beginning.
    first: Option<Vec3>,
    /// Corners of the box of all that it has filled.
    all: Option<[Vec3; 2]>,
    stay: Option<Stay>,
    longest: Option<Stay>,
}

/// A stretch of ticks inside some neighbourhood, and ζ at its beginning and end.
#[derive(Clone, Copy)]
struct Stay {
    first: u64,
    last: u64,
    zeta: [Vec3; 2],
}

impl Room {
    /// Takes a picture in.
    pub(crate) fn push(&mut self, facts: &Facts, picture: &Picture) {
        let corners = facts
            .body
            .corners(&picture.links)
            .chain([picture.hand.translation]);
        self.first.get_or_insert(picture.hand.translation);
        self.all = span(self.all.into_iter().flatten().chain(corners));
        let tick = picture.tick;
        let inside = picture.signs.iter().find(|sign| sign.mark.is_inside);
        self.stay = inside.map(|sign| {
            let zeta = sign.mark.zeta();
            let begin = Stay {
                first: tick,
                last: tick,
                zeta: [zeta; 2],
            };
            let stay = self.stay.unwrap_or(begin);
            Stay {
                last: tick,
                zeta: [stay.zeta[0], zeta],
                ..stay
            }
        });
        // Of stays about as long the first: playback comes to it first.
        let is_longest = |stay: &Stay| {
            self.longest.is_none_or(|longest| {
                longest.first == stay.first
                    || 4 * (stay.last - stay.first) > 5 * (longest.last - longest.first)
            })
        };
        if let Some(stay) = self.stay.filter(is_longest) {
            self.longest = Some(stay);
        }
    }

    /// The first and the last tick of the longest stay.
    pub(crate) fn stay(&self) -> Option<(u64, u64)> {
        self.longest.map(|stay| (stay.first, stay.last))
    }

    /// The ticks to repeat of a run that ends with `last`: from half a second before the longest stay to one after it; all where there is none.
    pub(crate) fn repeated(&self, rate_hz: u32, last: u64) -> [u64; 2] {
        let rate = u64::from(rate_hz);
        self.longest.map_or([0, last], |stay| {
            let first = stay.first.saturating_sub(rate / 2);
            [first, (stay.last + rate).min(last)]
        })
    }

    /// An eye that sees the arm from floor to hand wherever it has been, with room for a mark at the hand: off to the
    /// side of the plane in which the arm reaches out, a little above; a planar arm from above. `pane`: width over height.
    pub(crate) fn eye(&self, facts: &Facts, pane: f32) -> Eye {
        let (hand, mark) = (self.first.unwrap_or(Vec3::X), facts.mark_size());
        let is_planar = facts.is_planar();
        // Of a small arm on a high pedestal, not all of the pedestal.
        let foot = facts.floor_m.min(0.0).max(-5.0 * mark);
        let foot = if is_planar { 0.0 } else { foot };
        let mark = Vec3::splat(mark);
        let mut all = vec![hand + mark, hand - mark, Vec3::ZERO, Vec3::Z * foot];
        all.extend(self.all.into_iter().flatten());
        let [low, high] = span(all.iter().copied()).unwrap_or_default();
        let look_at = (low + high) / 2.0;
        let heading = [hand, Vec3::X, Vec3::Y]
            .into_iter()
            .find_map(|way| way.reject_from_normalized(facts.up).try_normalize())
            .unwrap_or(Vec3::X);
        let side = heading.cross(facts.up);
        let (away, up) = if is_planar {
            (Vec3::new(0.0, -0.25, 1.0), Vec3::Y)
        } else {
            (heading * 0.5 + side + facts.up * 0.3, facts.up)
        };
        let away = away.normalize();
        let right = up.cross(away).normalize_or(Vec3::X);
        let far = |p: &Vec3| {
            let v = *p - look_at;
            let [across, upwards] = [right, away.cross(right)].map(|axis| v.dot(axis).abs());
            v.dot(away) + (across / pane).max(upwards) / TANGENT
        };
        let distance = all.iter().map(far).fold(0.0, f32::max);
        Eye {
            position: look_at + away * distance,
            look_at,
            up,
        }
    }

    /// An eye near the hand, which is its origin, from the main eye's side: across ζ, onto the sector that it sweeps; of a hand that stands still from where the arm is seen.
    pub(crate) fn close_up(&self, facts: &Facts, main: &Eye) -> Eye {
        let towards = (main.position - main.look_at).normalize_or(Vec3::X);
        let aside = self.longest.map_or(towards, |stay| {
            let [first, last] = stay.zeta;
            let mut candidates = [last, main.up, towards]
                .map(|way| first.cross(way))
                .into_iter();
            let aside = candidates.find(|aside| aside.length() > 0.35);
            let aside = aside.map_or(towards, Vec3::normalize);
            aside * if aside.dot(towards) < 0.0 { -1.0 } else { 1.0 }
        });
        // A little of the main view's direction, nothing is seen exactly edge-on; and never from straight above.
        let direction = (aside + 0.6 * towards + 0.12 * main.up).normalize_or(towards);
        let height = direction.dot(main.up).clamp(-0.5, 0.5);
        let level = direction.reject_from(main.up).normalize_or(towards);
        let direction = level * (1.0 - height * height).sqrt() + height * main.up;
        Eye {
            position: direction * CLOSE * facts.mark_size(),
            look_at: Vec3::ZERO,
            up: main.up,
        }
    }
}
