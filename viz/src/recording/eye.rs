//! From where the arm is seen: all of it, and the longest singular stretch from near by.

use glam::Vec3;
use shared_types::messages::SingularityState;

use crate::blueprint::{Eye, Subject};
use crate::scene::{Mark, Presence};
use crate::solid::span;

/// The room that an arm takes.
#[derive(Clone, Debug, Default)]
pub(crate) struct Room {
    /// Its last link at the beginning.
    first: Option<Vec3>,
    /// Corners of the box of all that it has filled, and of the hand's, from then on.
    all: Option<[Vec3; 2]>,
    hand: Option<[Vec3; 2]>,
}

impl Room {
    /// Of an arm with these corners, the last of which is one of its last link.
    pub(crate) fn of(corners: &[Vec3]) -> Self {
        Self {
            first: corners.last().copied(),
            all: span(corners.iter().copied()),
            hand: None,
        }
    }

    /// Takes a posture in.
    pub(super) fn push(&mut self, corners: impl Iterator<Item = Vec3>, hand: Vec3) {
        self.all = span(self.all.into_iter().flatten().chain(corners));
        self.hand = span(self.hand.into_iter().flatten().chain([hand]));
    }

    /// An eye near the hand that sees all of its way, from the main eye's side.
    pub(super) fn close_up(&self, unit: f32, main: &Eye) -> Option<Eye> {
        let [low, high] = self.hand?;
        Some(close_up(
            (low + high) / 2.0,
            [main.up; 2],
            high - low,
            unit,
            main,
        ))
    }

    /// An eye that sees the arm from floor to hand wherever it has been so far, and where the task takes the hand, with room for a mark of that
    /// size there: off to the side of the plane in which the arm reaches out, a little above; a planar arm from above.
    pub(crate) fn eye(&self, mark: f32, subject: &Subject, planar: bool) -> Eye {
        let hand = self.first.unwrap_or(Vec3::X);
        let foot = if planar {
            0.0
        } else {
            // Of a small arm on a high pedestal, not all of the pedestal.
            subject.floor_m.min(0.0).max(-5.0 * mark)
        };
        let ends = subject.ways.iter().scan(hand, |hand, way| {
            *hand = way.after(*hand);
            Some(*hand)
        });
        let hands = ends.chain([hand]).chain(self.hand.into_iter().flatten());
        let around = |hand: Vec3| [mark, -mark].map(|by| hand + Vec3::splat(by));
        let all = hands.flat_map(around).chain([Vec3::ZERO, Vec3::Z * foot]);
        let all: Vec<Vec3> = all.chain(self.all.into_iter().flatten()).collect();
        let [low, high] = span(all.iter().copied()).unwrap_or_default();
        let look_at = (low + high) / 2.0;
        let heading = hand.with_z(0.0).normalize_or(Vec3::X);
        let side = Vec3::new(heading.y, -heading.x, 0.0);
        let (away, up) = match planar {
            true => (Vec3::new(0.0, -0.25, 1.0), Vec3::Y),
            false => (heading * 0.5 + side + Vec3::Z * 0.3, Vec3::Z),
        };
        let away = away.normalize();
        let right = up.cross(away).normalize_or(Vec3::X);
        let far = |p: &Vec3| {
            let v = *p - look_at;
            let [across, upwards] = [right, away.cross(right)].map(|axis| v.dot(axis).abs());
            v.dot(away) + (across / subject.pane.max(SLIM)).max(upwards) / TANGENT
        };
        let distance = all.iter().map(far).fold(0.0, f32::max);
        Eye {
            position: look_at + away * distance,
            look_at,
            up,
        }
    }
}

/// The part of half of Rerun's upright field of view that is used.
const TANGENT: f32 = 0.44;
/// Width over height of the slimmest pane.
const SLIM: f32 = 0.57;

/// A stretch of time in which the arm was inside some neighbourhood throughout, or nearest to one.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    first: u64,
    last: u64,
    /// The singularity that the arm entered first; its ζ at the beginning and now.
    which: usize,
    zeta: [Vec3; 2],
    centre: Vec3,
    /// The hand at the beginning, and the corners of the box it has been in since.
    hand: Vec3,
    corners: [Vec3; 2],
}

impl Stretch {
    /// From the singularity to the hand, for a run that is inside none: the two may be apart.
    fn with_hand(mut self) -> Self {
        let [low, high] = self.corners;
        self.corners = [low.min(self.centre), high.max(self.centre)];
        self.hand = self.centre;
        self
    }
}

/// The stretches of a run so far.
#[derive(Clone, Debug, Default)]
pub(super) struct Stretches {
    now: Option<Stretch>,
    /// The longest, or the first of those about as long.
    longest: Option<Stretch>,
    /// Where |s|/η was least, and how small, of those near enough to have a mark; for a run that is inside none.
    nearest: Option<(f64, Stretch)>,
}

impl Stretches {
    /// Takes a tick in.
    pub(super) fn push(
        &mut self,
        tick: u64,
        singularities: &[SingularityState],
        marks: &[Mark],
        hand: Vec3,
    ) {
        let at = |which: usize| Stretch {
            first: tick,
            last: tick,
            which,
            zeta: [marks[which].zeta(); 2],
            centre: marks[which].X_BS.p,
            hand,
            corners: [hand; 2],
        };
        let inside = marks.iter().position(Mark::is_inside);
        self.now = inside.map(|which| self.now.unwrap_or_else(|| at(which)));
        if let Some(now) = &mut self.now {
            let [low, high] = now.corners;
            (now.last, now.corners) = (tick, [low.min(hand), high.max(hand)]);
            if marks[now.which].is_inside() {
                now.zeta[1] = marks[now.which].zeta();
            }
            // Of stretches about as long the first: playback comes to it first.
            let is_longest = |longest: Stretch| {
                longest.first == now.first
                    || 4 * (now.last - now.first) > 5 * (longest.last - longest.first)
            };
            if self.longest.is_none_or(is_longest) {
                self.longest = Some(*now);
            }
        }
        for (which, one) in singularities.iter().enumerate().take(marks.len()) {
            let nearness = one.s.abs() / one.eta_in.max(1e-9);
            let is_seen = marks[which].look.presence != Presence::Hidden;
            if is_seen && self.nearest.is_none_or(|(least, _)| nearness < least) {
                self.nearest = Some((nearness, at(which)));
            }
        }
    }

    /// The ticks to repeat of a run that ends with `last`, from half a second before the arm entered to one after it left, and an eye on it.
    /// `None` for a run that comes near none: all of it is repeated.
    pub(super) fn ending(
        &self,
        rate_hz: u32,
        last: u64,
        unit: f32,
        main: &Eye,
    ) -> Option<((u64, u64), Eye)> {
        let near = || self.nearest.map(|(_, stretch)| stretch.with_hand());
        let stretch = self.longest.or_else(near)?;
        let rate = u64::from(rate_hz);
        let ticks = (
            stretch.first.saturating_sub(rate / 2),
            (stretch.last + rate).min(last),
        );
        let [low, high] = stretch.corners;
        let centre = stretch.centre + (low + high) / 2.0 - stretch.hand;
        let eye = close_up(centre, stretch.zeta, high - low, unit, main);
        Some((ticks, eye))
    }
}

/// The close-up's distance, in half lengths of the mark: the hand fills a third of the picture.
const CLOSE: f32 = 3.3;

/// An eye near C that looks across ζ: onto the sector that ζ sweeps, else onto the plane of ζ and the hand's way; from the main eye's side.
pub(super) fn close_up(centre: Vec3, zeta: [Vec3; 2], way: Vec3, unit: f32, main: &Eye) -> Eye {
    let towards_main = (main.position - main.look_at).normalize_or(Vec3::X);
    let candidates = [zeta[1], way, main.up, towards_main];
    let aside = candidates
        .into_iter()
        .map(|other| zeta[0].cross(other.normalize_or_zero()))
        .find(|aside| aside.length() > 0.35)
        .unwrap_or_else(|| zeta[0].any_orthonormal_vector())
        .normalize_or(Vec3::X);
    let aside = if aside.dot(towards_main) < 0.0 {
        -aside
    } else {
        aside
    };
    // A little of the main view's direction: nothing is seen exactly edge-on. Never from straight above: captions stand above and below.
    let direction = (aside + 0.5 * towards_main + 0.12 * main.up).normalize_or(aside);
    let height = direction.dot(main.up).clamp(-0.5, 0.5);
    let level = direction.reject_from(main.up).normalize_or(towards_main);
    let direction = level * (1.0 - height * height).sqrt() + height * main.up;
    Eye {
        position: centre + direction * (CLOSE * unit + way.length()),
        look_at: centre,
        up: main.up,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn playback_repeats_the_first_of_stretches_about_as_long() {
        let mut stretches = Stretches::default();
        for tick in 0..1000 {
            let is_inside = matches!(tick, 100..120 | 300..400 | 500..601 | 800..830);
            let one = SingularityState {
                inside: u32::from(is_inside),
                ..SingularityState::default()
            };
            stretches.push(tick, &[one], &[Mark::new(&one, [0.0; 3])], Vec3::ZERO);
        }
        let position = Vec3::new(2.0, -2.0, 1.0);
        let main = Eye {
            position,
            look_at: Vec3::ZERO,
            up: Vec3::Z,
        };
        let ticks = |rate_hz| Some(stretches.ending(rate_hz, 999, 0.2, &main)?.0);
        assert_eq!(
            [ticks(1000), ticks(100)],
            [Some((0, 999)), Some((250, 499))]
        );
        // Across x and z, from the main eye's side.
        let eye = close_up(Vec3::ZERO, [Vec3::X, Vec3::Z], Vec3::ZERO, 0.2, &main);
        assert!(eye.position.normalize().dot(-Vec3::Y) > 0.9);
    }
}
