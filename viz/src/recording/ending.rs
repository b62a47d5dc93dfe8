//! Settings known at the end of a run only: the longest singular stretch, and the best view of it.

use glam::Vec3;
use shared_types::messages::SingularityState;

use crate::blueprint::{Ending, Eye};
use crate::scene::{Mark, Presence};
use crate::solid::Placement;

/// A stretch of time in which the arm was inside some neighbourhood throughout, or nearest to one.
#[derive(Clone, Copy, Debug)]
struct Stretch {
    first: u64,
    last: u64,
    /// ζ at its beginning and now, of the singularity that the arm entered first.
    zeta: [Vec3; 2],
    /// Which.
    which: usize,
    centre: Vec3,
    /// The hand at its beginning and now.
    hand: [Vec3; 2],
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
        hand: &Placement,
    ) {
        let inside = marks
            .iter()
            .position(|mark| mark.look.presence == Presence::Inside);
        let at = |which: usize, mark: &Mark| Stretch {
            first: tick,
            last: tick,
            zeta: [mark.zeta(); 2],
            which,
            centre: mark.X_BS.p,
            hand: [hand.p; 2],
        };
        if let Some(which) = inside {
            let now = self.now.get_or_insert_with(|| at(which, &marks[which]));
            (now.last, now.hand[1]) = (tick, hand.p);
            if marks[now.which].look.presence == Presence::Inside {
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
        } else {
            self.now = None;
        }
        let seen = |mark: &Mark| mark.look.presence != Presence::Hidden;
        for (which, (one, mark)) in singularities
            .iter()
            .zip(marks)
            .enumerate()
            .filter(|(_, (_, mark))| seen(mark))
        {
            let nearness = one.s.abs() / one.eta_in.max(1e-9);
            if self.nearest.is_none_or(|(least, _)| nearness < least) {
                self.nearest = Some((nearness, at(which, mark)));
            }
        }
    }

    /// The stretch to repeat of a run whose ticks are `ns` apart and end with `last`: half a second before the arm entered to one after
    /// it left. `None` for a run that comes near none: all of it is repeated.
    pub(super) fn ending(
        &self,
        ns: impl Fn(u64) -> i64,
        last: u64,
        unit: f32,
        main: &Eye,
    ) -> Option<Ending> {
        let stretch = self.longest.or(self.nearest.map(|(_, stretch)| stretch))?;
        let (before, after) = (500_000_000, 1_000_000_000);
        let loop_ns = (
            (ns(stretch.first) - before).max(0),
            (ns(stretch.last) + after).min(ns(last)),
        );
        let way = stretch.hand[1] - stretch.hand[0];
        Some(Ending {
            loop_ns,
            close_up: close_up(stretch.centre, stretch.zeta, way, unit, main),
            main: None,
        })
    }
}

/// The close-up's distance, in half lengths of the mark: its label has room beside it.
const CLOSE: f32 = 5.8;

/// An eye near C that looks across ζ: onto the sector that ζ sweeps, else onto the plane of ζ and the hand's way; from the main eye's side.
pub(super) fn close_up(centre: Vec3, zeta: [Vec3; 2], way: Vec3, unit: f32, main: &Eye) -> Eye {
    let across = |other: Vec3| zeta[0].cross(other.normalize_or_zero());
    let candidates = [
        across(zeta[1]),
        across(way),
        across(main.up),
        across(main.position - main.look_at),
    ];
    let aside = candidates
        .into_iter()
        .find(|aside| aside.length() > 0.35)
        .unwrap_or_else(|| zeta[0].any_orthonormal_vector());
    let towards_main = (main.position - main.look_at).normalize_or(Vec3::X);
    let mut aside = aside.normalize_or(Vec3::X);
    if aside.dot(towards_main) < 0.0 {
        aside = -aside;
    }
    // A little of the main view's direction: nothing is seen exactly edge-on.
    let direction = (aside + 0.25 * towards_main + 0.12 * main.up).normalize_or(aside);
    let up = if direction.dot(main.up).abs() > 0.93 {
        zeta[0].cross(direction).normalize_or(Vec3::X)
    } else {
        main.up
    };
    Eye {
        position: centre + direction * (CLOSE * unit),
        look_at: centre,
        up,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Look;

    #[test]
    fn playback_repeats_the_first_of_stretches_about_as_long() {
        let mut stretches = Stretches::default();
        let mark = |presence| Mark {
            look: Look {
                presence,
                angular: false,
            },
            X_BS: Placement::IDENTITY,
            size: 1.0,
            edge: 0.5,
        };
        for tick in 0..1000 {
            let is_inside = matches!(tick, 100..120 | 300..400 | 500..601 | 800..830);
            let mark = mark(if is_inside {
                Presence::Inside
            } else {
                Presence::Near
            });
            stretches.push(
                tick,
                &[SingularityState::default()],
                &[mark],
                &Placement::IDENTITY,
            );
        }
        let main = Eye {
            position: Vec3::new(2.0, -2.0, 1.0),
            look_at: Vec3::ZERO,
            up: Vec3::Z,
        };
        let ending = stretches
            .ending(|tick| tick as i64 * 1_000_000, 999, 0.2, &main)
            .expect("it was singular");
        assert_eq!(
            ending.loop_ns,
            (0, 999_000_000),
            "from 300 ms less 500 ms to 399 ms and 1 s more"
        );
        let ending = stretches
            .ending(|tick| tick as i64 * 10_000_000, 999, 0.2, &main)
            .expect("it was singular");
        assert_eq!(
            ending.loop_ns,
            (2_500_000_000, 4_990_000_000),
            "the stretch from 3.00 to 3.99 s"
        );
    }

    #[test]
    fn the_close_up_looks_onto_the_plane_that_zeta_sweeps() {
        let main = Eye {
            position: Vec3::new(2.0, -2.0, 1.0),
            look_at: Vec3::ZERO,
            up: Vec3::Z,
        };
        let eye = close_up(Vec3::ZERO, [Vec3::X, Vec3::Z], Vec3::ZERO, 0.2, &main);
        let direction = eye.position.normalize();
        assert!(
            direction.dot(-Vec3::Y) > 0.9,
            "{direction}: across x and z, from the main eye's side"
        );
        assert!((eye.position.length() - CLOSE * 0.2).abs() < 1e-5);
    }
}
