//! The ranges of the joints: the run is refused, the clock slows, or an acceleration is held, before a joint reaches the end of its range.

use super::{Parts, shares};
use crate::linear::Joints;
use crate::reference::guide::Planned;
use model::{Model, Terms};

/// Distance per speed in which an arm with torque to spare is brought to rest before a limit, s: 1/k_v.
const DAMPED_S: f64 = 0.025;
/// Time that the torque rate takes from pushing a joint to braking it, s.
const REVERSING_S: f64 = 0.045;
/// Share of what gravity leaves of a joint's torque with which it brakes.
const BRAKING: f64 = 0.9;
/// Joint speed below which a joint is at rest, rad/s.
const RESTING: f64 = 0.02;
/// Distance from the plan beyond which it leads nowhere, rad.
const STRAYED: f64 = 0.02;

/// Whether a joint could not be stopped before its limit later than now, and no plan leads it away from there.
///
/// `terms` are those of `q`: a joint brakes with the torque that gravity leaves it.
#[inline]
pub fn is_nearing<const N: usize>(
    planned: Option<&Planned<N>>,
    (q, qdot): (&Joints<N>, &Joints<N>),
    terms: &Terms<N>,
    model: &Model<N>,
) -> bool {
    let bias = terms.bias();
    (0..N).any(|i| {
        let (speed, _, distance) = ahead(q, qdot, model, i);
        let effort = BRAKING * model.effort()[i];
        let torque = (effort - bias[i].abs()).max(0.1 * effort);
        let braked = 0.5 * speed * speed * terms.A[(i, i)] / torque;
        speed > RESTING
            && speed * REVERSING_S + braked.max(speed * DAMPED_S) > distance
            && planned.is_none_or(|plan| (plan.q[i] - q[i]).abs() > STRAYED)
    })
}

/// Fastest clock at which every joint, `qdot` rad/s at full speed, can be stopped before its limit.
pub(crate) fn stoppable<const N: usize>(q: &Joints<N>, qdot: &Joints<N>, model: &Model<N>) -> f64 {
    (0..N).fold(1.0, |clock, i| {
        let (speed, _, distance) = ahead(q, qdot, model, i);
        clock.min(distance / ((REVERSING_S + DAMPED_S) * speed).max(1e-9))
    })
}

/// The speed of joint `i`, whether it moves up, and the distance to the limit ahead of it.
#[inline]
fn ahead<const N: usize>(
    q: &Joints<N>,
    qdot: &Joints<N>,
    model: &Model<N>,
    i: usize,
) -> (f64, bool, f64) {
    let (speed, is_up) = (qdot[i].abs(), qdot[i] > 0.0);
    let [below, above] = [q[i] - model.lower()[i], model.upper()[i] - q[i]];
    (speed, is_up, if is_up { above } else { below })
}

/// Speed towards a limit per distance to it, 1/s: slower than the governor's clock changes.
const TOWARDS: f64 = 4.0;
/// Distance from a limit at which the joint of a reference arm stands, rad (m for prismatic joints).
pub const STANDING: f64 = 0.005;
/// Joint speed at full clock speed below which a joint is not on its way anywhere, rad/s.
const STILL: f64 = 1e-4;
/// Share of a joint's speed that the reference may take.
const REFERENCE_SPEED: f64 = 0.95;
/// The clock that holds a joint at the margin. Rates are divided by the clock to find the motion at full speed, so it is never zero; at this one, the
/// fastest joint takes an hour for the margin.
const HELD: f64 = 1e-7;

/// The joint that allows the least, and the clock's speed that it allows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fastest {
    /// Speed of the clock, above 0 and at most 1.
    pub clock: f64,
    /// Index of the joint at its limit and whether that is the upper one; `None` where no limit matters.
    pub joint: Option<(usize, bool)>,
}

impl Default for Fastest {
    fn default() -> Self {
        Self {
            clock: 1.0,
            joint: None,
        }
    }
}

/// The fastest clock of targets: |q̇_i| ≤ 0.95 of the joint's speed, and q̇_i ≤ 4·(distance to the limit ahead − margin).
///
/// `qdot` are the joint velocities at full clock speed. Shapes N · Units rad, rad/s · Ensures a clock in [10⁻⁷, 1], the lowest only where a joint that
/// moves towards its limit is at the margin · Errors none · Cost O(N), no allocation
pub fn fastest<const N: usize>(q: &Joints<N>, qdot: &Joints<N>, model: &Model<N>) -> Fastest {
    let mut fastest = Fastest::default();
    for i in (0..N).filter(|i| qdot[*i].abs() >= STILL) {
        let (speed, is_up, distance) = ahead(q, qdot, model, i);
        let at_limit = TOWARDS * (distance - STANDING).max(0.0) / speed;
        let at_speed = REFERENCE_SPEED * model.velocity()[i] / speed;
        for (clock, joint) in [(at_limit, Some((i, is_up))), (at_speed, None)] {
            if clock < fastest.clock {
                let clock = clock.max(HELD);
                fastest = Fastest { clock, joint };
            }
        }
    }
    fastest
}

/// The rates that the joints' limits leave to a motion of the null space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Room {
    /// Its lowest and its highest rate, rad/s.
    pub rates: [f64; 2],
    /// Index of the joint at whose limit each of them is, and whether that is the upper one; `None` where no limit matters.
    pub joints: [Option<(usize, bool)>; 2],
}

impl Default for Room {
    fn default() -> Self {
        Self::FREE
    }
}

impl Room {
    /// No limit matters.
    pub const FREE: Self = Self {
        rates: [f64::NEG_INFINITY, f64::INFINITY],
        joints: [None; 2],
    };

    /// Of the motion that moves the joints by `w` per unit, at most at the rate `rate_max`; by the rule of [`fastest`].
    pub fn of<const N: usize>(
        q: &Joints<N>,
        w: &Joints<N>,
        rate_max: f64,
        model: &Model<N>,
    ) -> Self {
        let mut room = Self::FREE;
        for (side, rate) in [-rate_max, rate_max].into_iter().enumerate() {
            let Fastest { clock, joint } = fastest(q, &(w * rate), model);
            if joint.is_some() {
                (room.rates[side], room.joints[side]) = (rate * clock, joint);
            }
        }
        room
    }

    /// The joint that holds a motion of this rate back.
    pub fn joint_at(&self, rate: f64) -> Option<(usize, bool)> {
        let [down, up] = self.rates;
        match (rate <= down, rate >= up) {
            (true, _) => self.joints[0],
            (_, true) => self.joints[1],
            _ => None,
        }
    }
}

/// Rate of the last approach to a stop, K, 1/s.
const APPROACH: f64 = 8.0;
/// Time in which a speed is adapted, T, s: 1/T > 4·K, so that no joint overshoots.
const ADAPT_S: f64 = 0.025;
/// Distance from the end of its range at which a joint stops, rad (m for prismatic joints): many times the arm's distance from the reference arm.
const MARGIN: f64 = 0.003;
/// Share of a joint's speed that it may take.
const SPEED: f64 = 0.97;
/// Share of a joint's torque with which braking is planned.
const BRAKE: f64 = 0.3;

/// The accelerations nearest to the sum of `parts` with which every joint can still stop before the end of its range, and a joint that is held there, with
/// whether that is the upper end.
///
/// A joint at the distance d from its stop is never faster than v(d) = √(a²/K² + 2·a·d) − a/K: braking from v takes less than a, and the approach
/// is exponential at the end. The acceleration that keeps it is (v(d) − q̇)/T, and v(d) is at most 0.97 of the joint's speed. The null-space motion is
/// given up first, then the motion along the reference's path, then the joint's own.
///
/// `inertia` is the diagonal of A. Shapes N · Units rad, rad/s, rad/s², kg·m² · Requires a state that keeps the limits · Ensures that the next state
/// does, and the sum unchanged away from all limits · Errors none · Cost O(N), no allocation
#[must_use]
pub fn stopped<const N: usize>(
    (q, qdot): (&Joints<N>, &Joints<N>),
    parts: &Parts<N>,
    inertia: &Joints<N>,
    model: &Model<N>,
) -> (Joints<N>, Option<(usize, bool)>) {
    let whole = parts.sum();
    let [mut low, mut high] = [Joints::<N>::zeros(); 2];
    let mut joint = None;
    for i in 0..N {
        let most = SPEED * model.velocity()[i];
        let braking = BRAKE * model.effort()[i] / inertia[i];
        let up = stopping_speed(model.upper()[i] - q[i], braking);
        let down = stopping_speed(q[i] - model.lower()[i], braking);
        high[i] = (up.min(most) - qdot[i]) / ADAPT_S;
        low[i] = (-down.min(most) - qdot[i]) / ADAPT_S;
        if up < most && whole[i] > high[i] {
            joint = Some((i, true));
        } else if down < most && whole[i] < low[i] {
            joint = Some((i, false));
        }
    }
    if (0..N).all(|i| whole[i] >= low[i] && whole[i] <= high[i]) {
        return (whole, None);
    }
    let [k_n, k_p, _] = shares(&Joints::zeros(), parts, [&low, &high]);
    let wanted = parts.scaled([k_n, k_p, 1.0]).sum();
    let held = Joints::from_fn(|i, _| wanted[i].clamp(low[i], high[i].max(low[i])));
    (held, joint)
}

/// The speed from which a joint stops within `distance` less the margin; 0 beyond it.
fn stopping_speed(distance: f64, braking: f64) -> f64 {
    let (d, slow) = ((distance - MARGIN).max(0.0), braking / APPROACH);
    if d.is_infinite() {
        f64::INFINITY
    } else {
        (slow * slow + 2.0 * braking * d).sqrt() - slow
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear::Vector6;
    use crate::testing::puma;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn no_motion_leaves_the_range_or_the_speed(
            pushes in prop::collection::vec(prop::array::uniform3(prop::array::uniform6(-400.0..400.0_f64)), 1..20),
        ) {
            let (model, dt) = (puma(), 1e-3);
            let (mut q, mut qdot) = (Vector6::zeros(), Vector6::zeros());
            let inertia = Vector6::repeat(1.5);
            for push in &pushes {
                let [path, null, rest] = push.map(Vector6::from);
                for _ in 0..300 {
                    let (qddot, _) = stopped((&q, &qdot), &Parts { null, path, rest }, &inertia, model);
                    q += qdot * dt + qddot * (0.5 * dt * dt);
                    qdot += qddot * dt;
                    for i in 0..6 {
                        let (low, high) = (model.lower()[i] + 0.5 * MARGIN, model.upper()[i] - 0.5 * MARGIN);
                        prop_assert!(q[i] >= low && q[i] <= high && qdot[i].abs() <= 0.981 * model.velocity()[i], "{q} {qdot}");
                    }
                }
            }
        }
    }

    #[test]
    fn the_null_space_goes_first_and_away_from_limits_nothing_changes() {
        let one = Vector6::repeat(1.0);
        let parts = Parts {
            path: one,
            rest: Vector6::zeros(),
            null: one * 0.5,
        };
        let at = |q: Vector6| stopped((&q, &Vector6::zeros()), &parts, &one, puma());
        assert_eq!(at(Vector6::zeros()), (parts.sum(), None));
        let mut q = Vector6::zeros();
        q[0] = puma().upper()[0] - MARGIN;
        let (qddot, joint) = at(q);
        assert!(qddot.amax() < 1.6 && qddot.rows(0, 2).amax() < 1e-9 && joint == Some((0, true)));
    }

    #[test]
    fn the_joint_that_moves_along_bounds_a_null_motion_and_only_towards_its_limit() {
        let mut q = Vector6::zeros();
        q[3] = puma().lower()[3] + STANDING + 0.01;
        let w = Vector6::new(1.0, 0.0, 0.0, 2.0, 0.0, 0.0);
        let room = Room::of(&q, &w, 1.5, puma());
        assert!((room.rates[0] + 0.02).abs() < 1e-12 && room.rates[1] == f64::INFINITY);
        let ends = [-0.02, -0.019, 1.5].map(|rate| room.joint_at(rate));
        assert_eq!(ends, [Some((3, false)), None, None]);
        assert_eq!(Room::of(&Vector6::zeros(), &w, 1.5, puma()), Room::FREE);
    }

    #[test]
    fn the_clock_slows_before_a_limit_and_is_free_away_from_it() {
        let (upper, velocity) = (puma().upper()[0], puma().velocity()[0]);
        let at = |q: f64, qdot: f64| {
            let along = |x: f64| Vector6::new(x, 0.0, 0.0, 0.0, 0.0, 0.0);
            fastest(&along(q), &along(qdot), puma())
        };
        let near = upper - STANDING;
        assert_eq!(at(0.0, 0.9 * velocity), Fastest::default());
        assert!(at(near, 1.0).clock < 1e-6 && at(near, 1.0).joint == Some((0, true)));
        assert_eq!(at(near, -1.0), Fastest::default());
        assert!((at(near - 0.1, 1.0).clock - 0.4).abs() < 1e-12);
        let fast = at(0.0, 9.5 * velocity);
        assert!((fast.clock - 0.1).abs() < 1e-12 && fast.joint.is_none());
        assert_eq!(at(upper + 0.2, 1.0).clock, HELD, "beyond the limit");
    }
}
