//! Rest of the reference arm: where a session asks for nothing, or a joint limit has ended what it asks for, every joint stops, null motion included.
//!
//! The law alone does not end there: its feedback presses against a limit, and near a singularity its self-motion goes on, with a hand that stands still.

use super::state::{Ended, TargetState};
use crate::controller::Setup;
use crate::linear::{Joints, Vector6, angular, linear, stack};

/// Speed of the reference below which it has come to rest, m/s and rad/s.
const SLOW: (f64, f64) = (1e-3, 5e-3);
/// Time for which nothing has been asked for, s, after which the joints are brought to rest.
const ASKED_S: f64 = 0.2;
/// Time for which a joint limit has kept the hand from the motion asked for, s, after which that motion is over: longer than null motion needs to
/// make room.
const HELD_S: f64 = 2.0;
/// Share of the twist asked for below which the hand stands still.
const STILL: f64 = 0.02;
/// Distance from the end of its range within which a joint is held there, rad (m for prismatic joints).
const NEAR: f64 = 0.012;
/// Cosine of the angle from which on another twist is another motion: 10°.
const SAME: f64 = 0.985;
/// Rate at which joint velocities decay, 1/s: from the fastest null motion, 1.2 rad/s, the hand leaves its place by 1 mm.
const DECAY: f64 = 15.0;

/// The motion of a tick, as far as rest depends on it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion<'a, const N: usize> {
    /// Twist asked for, bounded to the session's speed; m/s, rad/s.
    pub(crate) asked: &'a Vector6,
    /// Twist of the reference arm's hand; m/s, rad/s.
    pub(crate) V: &'a Vector6,
    pub(crate) setup: &'a Setup<N>,
}

impl<const N: usize> Motion<'_, N> {
    /// A twist in rad/s.
    fn scaled(&self, V: &Vector6) -> Vector6 {
        stack(&(linear(V) / self.setup.length_m), &angular(V))
    }
}

impl<const N: usize> TargetState<N> {
    /// Decides at the beginning of a tick whether the reference arm rests in it.
    pub(crate) fn decide_rest(&mut self, now: &Motion<'_, N>) {
        let (asked, asks) = (now.scaled(now.asked), self.asks(now.asked));
        let is_same =
            |ended: &Ended| ended.asked.dot(&asked) > SAME * ended.asked.norm() * asked.norm();
        self.ended = self.ended.filter(|ended| asks && is_same(ended));
        let is_idle = !asks && f64::from(self.idle_ticks) * now.setup.scenario.dt_s() >= ASKED_S;
        self.resting = !self.stops.now && (self.ended.is_some() || is_idle);
    }

    /// Counts at the end of a tick for how long nothing has been asked for, and for how long a joint limit has kept the hand from it.
    pub(crate) fn count_rest(&mut self, now: &Motion<'_, N>) {
        let asks = self.asks(now.asked);
        let is_slow = linear(&self.V).norm() < SLOW.0 && angular(&self.V).norm() < SLOW.1;
        let is_held = asks
            && !self.is_posture()
            && self.is_held(&now.scaled(now.asked), &now.scaled(now.V), now.setup);
        let count = |ticks: u32, goes_on: bool| {
            if goes_on && !self.stops.now {
                ticks.saturating_add(1)
            } else {
                0
            }
        };
        (self.idle_ticks, self.held_ticks) = (
            count(self.idle_ticks, !asks && is_slow),
            count(self.held_ticks, is_held),
        );
        if f64::from(self.held_ticks) * now.setup.scenario.dt_s() >= HELD_S {
            self.ended = self.joint_at_limit().map(|joint| Ended {
                asked: now.scaled(now.asked),
                joint,
            });
        }
    }

    /// The acceleration that brings the joints to rest, rad/s².
    #[must_use]
    pub(crate) fn braking(&self) -> Joints<N> {
        self.qdot * -DECAY
    }

    /// Whether a motion is asked for: a twist, a force, or a posture.
    fn asks(&self, asked: &Vector6) -> bool {
        *asked != Vector6::zeros() || self.presses || self.is_posture() && self.over.is_none()
    }

    /// Whether the hand stands still, and a joint at the end of its range is the reason.
    fn is_held(&self, asked: &Vector6, V: &Vector6, setup: &Setup<N>) -> bool {
        let room = |(i, is_up): (usize, bool)| {
            if is_up {
                setup.model.upper()[i] - self.q[i]
            } else {
                self.q[i] - setup.model.lower()[i]
            }
        };
        asked.dot(V) < STILL * asked.norm_squared()
            && self
                .joint_at_limit()
                .is_some_and(|joint| room(joint) < NEAR)
    }

    /// The joint before whose limit the path or a null motion is held back, and whether that is the upper one.
    fn joint_at_limit(&self) -> Option<(usize, bool)> {
        self.fastest.joint.or(self.withheld)
    }
}
