//! The joint drives: the last to touch a torque, and able to stop the arm by themselves.

use model::{Model, joints, padded};
use nalgebra::SVector;
use shared_types::MAX_DOF;
use shared_types::checkpoints::DriveCheckpoint;
use shared_types::codes::{
    DRIVE_ABSENT, DRIVE_ACTIVE, DRIVE_BRAKED, DRIVE_EFFORT, DRIVE_ENCODER, DRIVE_HOLDING,
    DRIVE_RATE, DRIVE_REFUSED, DRIVE_SPEED, DRIVE_STALE, DRIVE_STOPPING,
};

/// Fastest change of applied torque, as a fraction of the effort limit per second: half of it in a millisecond.
pub(crate) const TORQUE_RATE: f64 = 500.0;

/// The same on the way back from the stop law or the brakes to commanded torque.
pub(crate) const RETURN_RATE: f64 = 100.0;

/// Damping of the stop law per unit of inertia: each joint's speed falls as exp(−20 t); 1/s.
pub const STOP_GAIN: f64 = 20.0;

/// Damping of what a joint is faster than its speed limit, per unit of inertia; 1/s. Other joints at full torque push with a few rad/s², which
/// this holds at some hundredths of a rad/s.
const SPEED_GAIN: f64 = 100.0;

/// The most of the excess that is taken away in a tick: the coupling of the joints makes the gain several times as large. At rates so low
/// that it is less than the stop law's, that one holds.
const SPEED_SHARE: f64 = 0.1;

/// The drives look ahead at a joint whose speed would be beyond this fraction of its limit ...
const AHEAD_RATIO: f64 = 0.5;

/// ... with so many times what it has gained in the last tick: at full torque that is up to half of the limit, and torque needs two ticks to be taken back.
const AHEAD_TICKS: f64 = 4.0;

/// Brakes engage below this fraction of the speed limit ...
const REST_RATIO: f64 = 0.05;

/// ... or below this speed, where there is none; rad/s ...
const REST_SPEED: f64 = 0.05;

/// ... or after this time, at whatever speed is left; s.
const STOP_TIME: f64 = 1.0;

/// The drives of an arm.
///
/// | state | torque | until |
/// |---|---|---|
/// | active | the commanded one, limited | a tick without a fresh one |
/// | holding | the last applied | fresh torque, or `hold_ticks` ticks |
/// | stopping | the stop law g(q) − k·diag A(q)·q̇ | fresh torque, or rest |
/// | braked | none (building up against the brakes when fresh torque comes) | fresh torque is reached |
///
/// The stop law needs only the drives' own sensors and the arm's nominal model. A positive diagonal damping takes energy
/// out in every motion, so that it comes to rest whatever the motion was; the brakes engage at 5 % of the speed limits, and
/// after 1 s in any case.
///
/// Every applied torque is within the effort limit and within a bounded step of the one before: half the effort limit per
/// millisecond, a tenth while returning from a stop. A joint is braked before it passes its speed limit, its own torque or that of
/// other joints taking it there: the drives' own sensors give the acceleration under the torques of the last tick, and the model how
/// much a change of torque changes it. Above the limit it gets no torque that would keep it there. A torque with a NaN or an infinity
/// is refused whole and counts as absent; so is one that was computed from a reading of the encoders that the drives' own sensors
/// contradict.
#[derive(Clone, Debug)]
pub struct Drive<const N: usize> {
    /// The drives' model of the arm: its description, not the simulated deviation from it.
    model: Model<N>,
    dt: f64,
    hold_ticks: u32,
    rest: SVector<f64, N>,
    /// All that a tick changes: the drives' actions over the last one.
    state: DriveCheckpoint,
}

impl<const N: usize> Drive<N> {
    /// Drives that carry an arm at rest, active, `rate_hz` ticks a second.
    ///
    /// Requires rate_hz > 0 and the torque that `carries` the arm, whatever it holds; N·m: it is the one before the first.
    pub fn new(model: Model<N>, rate_hz: u32, hold_ticks: u32, carries: &SVector<f64, N>) -> Self {
        let carried = carries.zip_map(model.effort(), |g, limit| g.clamp(-limit, limit));
        let rest = model.velocity().map(|limit| {
            if limit.is_finite() {
                REST_RATIO * limit
            } else {
                REST_SPEED
            }
        });
        Self {
            model,
            dt: 1.0 / f64::from(rate_hz),
            hold_ticks,
            rest,
            state: DriveCheckpoint {
                tau: padded(&carried),
                drive: DRIVE_ACTIVE,
                ..DriveCheckpoint::default()
            },
        }
    }

    /// The drives' actions over the last tick.
    pub fn state(&self) -> &DriveCheckpoint {
        &self.state
    }

    /// Goes on from a [`state`](Self::state).
    pub fn restore(&mut self, from: &DriveCheckpoint) {
        self.state = *from;
    }

    /// Torque on the joints over the last tick; N·m.
    pub fn tau(&self) -> SVector<f64, N> {
        joints(&self.state.tau)
    }

    /// Whether the brakes hold the arm.
    pub fn is_braked(&self) -> bool {
        self.state.braked == 1
    }

    /// The torque for one tick from the state (q, q̇), given the command for it (`None`: none came), which was computed from a state `age` ticks ago; one
    /// older than `hold_ticks` is refused and counts as absent.
    ///
    /// Ensures a finite torque within the effort limits. No allocation.
    pub fn answer(
        &mut self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        command: Option<&SVector<f64, N>>,
        age: u32,
    ) -> &DriveCheckpoint {
        let (fresh, flag) = match command {
            Some(_) if age > self.hold_ticks => (None, DRIVE_STALE),
            Some(tau) if tau.iter().all(|x| x.is_finite()) => (Some(*tau), 0),
            Some(_) => (None, DRIVE_REFUSED),
            None => (None, DRIVE_ABSENT),
        };
        self.advance(q, qdot, fresh, age, flag)
    }

    /// The same where the encoders report another position than the drives' own sensors: the command was computed from it, is refused, and counts as absent.
    pub fn refuse(&mut self, q: &SVector<f64, N>, qdot: &SVector<f64, N>) -> &DriveCheckpoint {
        self.advance(q, qdot, None, 0, DRIVE_ENCODER)
    }

    /// One tick under a fresh torque, or without one for the reason `flags`.
    fn advance(
        &mut self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        fresh: Option<SVector<f64, N>>,
        age: u32,
        mut flags: u32,
    ) -> &DriveCheckpoint {
        let before = self.state;
        let is_refused = flags & (DRIVE_STALE | DRIVE_REFUSED | DRIVE_ENCODER) != 0;
        let stale_ticks = if fresh.is_some() {
            age
        } else {
            before.stale_ticks.saturating_add(1)
        };
        let mut drive = self.next(fresh.is_some(), stale_ticks, qdot);
        let stopping_ticks = match drive {
            DRIVE_STOPPING => before.stopping_ticks + 1,
            _ => 0,
        };
        let mut returning = match (fresh, drive) {
            (Some(_), DRIVE_BRAKED) => true,
            (Some(_), _) => before.returning == 1 || before.drive == DRIVE_STOPPING,
            (None, DRIVE_HOLDING) => before.returning == 1,
            (None, _) => false,
        };

        let wanted = match (fresh, drive) {
            (Some(tau), _) => tau,
            (None, DRIVE_HOLDING) => self.tau(),
            (None, DRIVE_STOPPING) => self.stop_law(q, qdot),
            (None, _) => SVector::zeros(),
        };
        let rate = if returning { RETURN_RATE } else { TORQUE_RATE };
        let (tau, limited) = self.limit(q, qdot, &wanted, rate * self.dt);
        flags |= limited;
        let limited = (0..N).filter(|i| tau[*i] != wanted[*i]);
        let saturation_mask = limited.fold(0, |mask, i| mask | 1 << i);
        // The return is over, and the brakes release, when the applied torque is what the command comes to.
        if fresh.is_some() && returning && flags & DRIVE_RATE == 0 {
            (returning, drive) = (false, DRIVE_ACTIVE);
        }
        self.state = DriveCheckpoint {
            tau: padded(&tau),
            qdot_before: padded(qdot),
            has_before: 1,
            drive,
            flags,
            saturation_mask,
            stale_ticks,
            braked: u32::from(drive == DRIVE_BRAKED),
            returning: returning.into(),
            stopping_ticks,
            refused: before.refused.saturating_add(is_refused.into()),
            reserved: 0,
        };
        &self.state
    }

    /// Stops at once: brakes on, whatever the motion. For a state that cannot be gone on from.
    pub fn brake(&mut self, flag: u32) {
        self.state = DriveCheckpoint {
            tau: [0.0; MAX_DOF],
            drive: DRIVE_BRAKED,
            flags: self.state.flags | flag,
            braked: 1,
            returning: 0,
            ..self.state
        };
    }

    fn next(&self, fresh: bool, stale_ticks: u32, qdot: &SVector<f64, N>) -> u32 {
        match (self.state.drive, fresh) {
            (DRIVE_BRAKED, _) => DRIVE_BRAKED,
            (_, true) => DRIVE_ACTIVE,
            (DRIVE_ACTIVE | DRIVE_HOLDING, false) if stale_ticks <= self.hold_ticks => {
                DRIVE_HOLDING
            }
            (DRIVE_STOPPING, false) if self.at_rest(qdot) => DRIVE_BRAKED,
            (_, false) => DRIVE_STOPPING,
        }
    }

    fn at_rest(&self, qdot: &SVector<f64, N>) -> bool {
        let slow = qdot
            .iter()
            .zip(self.rest.iter())
            .all(|(v, rest)| v.abs() <= *rest);
        slow || f64::from(self.state.stopping_ticks) * self.dt >= STOP_TIME
    }

    /// τ = g(q) − k·diag A(q)·q̇
    fn stop_law(&self, q: &SVector<f64, N>, qdot: &SVector<f64, N>) -> SVector<f64, N> {
        self.model.gravity(q) - self.model.mass_matrix(q).diagonal().component_mul(qdot) * STOP_GAIN
    }

    /// The torque nearest to `wanted` that the limits allow, and which of them it met.
    fn limit(
        &self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        wanted: &SVector<f64, N>,
        step: f64,
    ) -> (SVector<f64, N>, u32) {
        let mut flags = 0;
        let mut bound = |tau: &mut f64, low: f64, high: f64, flag: u32| {
            let inside = tau.clamp(low, high);
            if inside != *tau {
                *tau = inside;
                flags |= flag;
            }
        };
        let speed = self.model.velocity();
        let has_before = self.state.has_before == 1;
        let before = has_before.then(|| joints::<N>(&self.state.qdot_before));
        let gained = before.map_or_else(SVector::zeros, |before| qdot - before);
        let is_near =
            |i: usize| qdot[i].abs() + AHEAD_TICKS * gained[i].abs() > AHEAD_RATIO * speed[i];
        // The most that keeps a joint at its speed limit: what carries its weight, less damping of the excess.
        let (mut carried, mut inertia, mut mobility) = (SVector::zeros(), SVector::zeros(), None);
        if (0..N).any(is_near) {
            let A = self.model.mass_matrix(q);
            (carried, inertia) = (self.model.gravity(q), A.diagonal());
            mobility = A.cholesky().map(|factors| factors.inverse().diagonal());
        }
        let speed_gain = SPEED_GAIN.min(SPEED_SHARE / self.dt).max(STOP_GAIN);
        let mut tau = *wanted;
        for i in 0..N {
            let (effort, last) = (self.model.effort()[i], self.state.tau[i]);
            let slack = step * effort;
            bound(&mut tau[i], -effort, effort, DRIVE_EFFORT);
            let (excess, sign) = (qdot[i].abs() - speed[i], qdot[i].signum());
            // The most torque in the direction of motion.
            let mut most = f64::INFINITY;
            if excess > 0.0 {
                most = sign * carried[i] - speed_gain * inertia[i] * excess;
            }
            if has_before && is_near(i) {
                // Without a model of the arm there is no more than what carries the joint.
                let ahead = mobility.map_or(sign * carried[i], |mobility| {
                    let room = (-excess).max(0.0);
                    let allowed = most_acceleration(room, slack * mobility[i] / self.dt, self.dt);
                    sign * last + (allowed - sign * gained[i] / self.dt) / mobility[i]
                });
                most = most.min(ahead);
            }
            // In this order it is a number whatever comes out above.
            let most = most.max(-effort);
            let (low, high) = if sign > 0.0 {
                (f64::NEG_INFINITY, most)
            } else {
                (-most, f64::INFINITY)
            };
            bound(&mut tau[i], low, high, DRIVE_SPEED);
            bound(&mut tau[i], last - slack, last + slack, DRIVE_RATE);
        }
        (tau, flags)
    }
}

/// The largest acceleration under which a joint that lacks `room` of its speed limit does not pass it, when it keeps it for a tick `dt` and is then taken
/// back at `jerk`: a·dt + a²/(2·jerk) = room.
///
/// Units rad/s, rad/s³, s → rad/s² · Requires room ≥ 0, jerk > 0, which may be infinite
fn most_acceleration(room: f64, jerk: f64, dt: f64) -> f64 {
    // The other form of jerk·(√(dt² + 2·room/jerk) − dt), which has no difference of like numbers and no infinity times zero.
    2.0 * room / (dt + (dt * dt + 2.0 * room / jerk).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::Robot;
    use std::sync::LazyLock;

    type Joints = SVector<f64, 6>;

    static ROBOT: LazyLock<Robot> = LazyLock::new(|| Robot::builtin("puma560").unwrap());
    static ARM: LazyLock<Model<6>> = LazyLock::new(|| Model::new(&ROBOT, None).unwrap());
    static START: LazyLock<Joints> =
        LazyLock::new(|| Joints::from_column_slice(&ROBOT.postures["nominal"]));

    fn drive() -> Drive<6> {
        Drive::new(ARM.clone(), 1000, 3, &ARM.gravity(&START))
    }

    const REST: Joints = Joints::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0);

    impl<const N: usize> Drive<N> {
        /// The answer to a command that was computed from this state.
        fn step(
            &mut self,
            q: &SVector<f64, N>,
            qdot: &SVector<f64, N>,
            command: Option<&SVector<f64, N>>,
        ) -> &DriveCheckpoint {
            self.answer(q, qdot, command, 0)
        }
    }

    /// Largest change of torque as a fraction of the effort limit.
    fn step_ratio(before: &Joints, after: &Joints) -> f64 {
        (after - before).component_div(ARM.effort()).amax()
    }

    /// The drives' answer to the torque of an arm at rest, changed by `change`: drive, flags, mask, and how far it is from the one commanded.
    fn answer(age: u32, change: impl Fn(&mut Joints)) -> (u32, u32, u32, f64) {
        let mut drive = drive();
        let mut tau = drive.tau();
        change(&mut tau);
        let applied = *drive.answer(&START, &REST, Some(&tau), age);
        let off = step_ratio(&tau, &drive.tau());
        (applied.drive, applied.flags, applied.saturation_mask, off)
    }

    #[test]
    fn a_torque_passes_untouched_or_is_limited_or_refused_whole_and_reported() {
        let (effort, rate) = (ARM.effort(), TORQUE_RATE * 1e-3);
        assert_eq!(answer(0, |tau| *tau *= 1.1), (DRIVE_ACTIVE, 0, 0, 0.0));
        assert_eq!(answer(3, |_| {}), (DRIVE_ACTIVE, 0, 0, 0.0));
        assert_eq!(answer(4, |_| {}), (DRIVE_HOLDING, DRIVE_STALE, 0, 0.0));
        for poison in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let (state, flags, mask, _) = answer(0, |tau| tau[4] = poison);
            assert_eq!((state, flags, mask), (DRIVE_HOLDING, DRIVE_REFUSED, 0));
        }
        // Joint 1 is within the bound on steps.
        let (state, flags, mask, off) = answer(0, |tau| {
            (tau[0], tau[3]) = (tau[0] - 0.4 * effort[0], tau[3] + 0.9 * effort[3]);
        });
        assert_eq!((state, flags, mask), (DRIVE_ACTIVE, DRIVE_RATE, 0b1000));
        assert!((off - (0.9 - rate)).abs() < 1e-12, "{off}");
        let mut drive = drive();
        let tau = drive.tau() + Joints::new(0.0, 1e6, 0.0, 0.0, 0.0, -1e6);
        for _ in 0..5 {
            drive.step(&START, &REST, Some(&tau));
        }
        let state = drive.state();
        assert_eq!((state.tau[1], state.tau[5]), (effort[1], -effort[5]));
        let limited = (state.flags, state.saturation_mask);
        assert_eq!(limited, (DRIVE_EFFORT, 0b10_0010));
    }

    #[test]
    fn no_torque_acts_longer_than_it_may_be_held() {
        let mut drive = drive();
        let tau = ARM.gravity(&START);
        let late = drive.answer(&START, &REST, Some(&tau), 2);
        assert_eq!((late.drive, late.stale_ticks), (DRIVE_ACTIVE, 2));
        assert_eq!(drive.step(&START, &REST, None).drive, DRIVE_HOLDING);
        assert_eq!(drive.step(&START, &REST, None).drive, DRIVE_STOPPING);
        let mut hasty = Drive::new(ARM.clone(), 1000, 0, &tau);
        assert_eq!(
            hasty.step(&START, &Joints::repeat(1.0), None).drive,
            DRIVE_STOPPING
        );
    }

    /// The most speed of a joint, as a fraction of its limit, of an arm whose joint is driven at full torque from rest, while a load that the model
    /// does not know pushes at it.
    fn most_speed_share<const N: usize>(robot: &Robot, joint: usize, sign: f64, push: f64) -> f64 {
        let model = Model::<N>::new(robot, None).unwrap();
        let (mut q, mut qdot) = (SVector::from_element(0.3), SVector::zeros());
        let mut drive = Drive::new(model.clone(), 1000, 3, &model.gravity(&q));
        let mut most = 0.0_f64;
        for _ in 0..40 {
            let mut tau = model.gravity(&q);
            tau[joint] = sign * model.effort()[joint];
            let mut applied: SVector<f64, N> = joints(&drive.step(&q, &qdot, Some(&tau)).tau);
            applied[joint] += push * model.effort()[joint];
            for _ in 0..10 {
                qdot += model.forward_dynamics(&q, &qdot, &applied) * 1e-4;
                q += qdot * 1e-4;
            }
            most = most.max(qdot[joint].abs() / model.velocity()[joint]);
        }
        most
    }

    #[test]
    fn no_torque_takes_a_joint_past_its_speed_limit() {
        for (name, joints) in [
            ("iiwa14", &[3, 1, 5][..]),
            ("puma560", &[2, 4]),
            ("ur5", &[2]),
            ("panda", &[3]),
        ] {
            let robot = Robot::builtin(name).unwrap();
            for joint in joints {
                for (sign, push) in [(1.0, 0.0), (1.0, -0.1), (-1.0, 0.3), (1.0, 0.1)] {
                    let share = model::with_dof!(robot.dof(), N => most_speed_share::<N>(&robot, *joint, sign, push));
                    let is_within = share.is_some_and(|share| (0.6..1.05).contains(&share));
                    assert!(
                        is_within,
                        "{name}: joint {joint} at {sign} with {push}: {share:?}"
                    );
                }
            }
        }
        // Every joint as hard as it can, in turns.
        let (mut drive, mut q, mut qdot, mut most) = (drive(), *START, REST, REST);
        for tick in 0..600 {
            let push = Joints::from_fn(|i, _| if (tick / 70 + i) % 2 == 0 { 1.0 } else { -1.0 });
            let tau = ARM.effort().component_mul(&push);
            let tau = joints(&drive.step(&q, &qdot, Some(&tau)).tau);
            qdot += ARM.forward_dynamics(&q, &qdot, &tau) * 1e-3;
            q += qdot * 1e-3;
            most = most.sup(&qdot.component_div(ARM.velocity()).abs());
        }
        assert!(most.max() > 1.0 && most.max() < 1.05, "{most}");
    }

    #[test]
    fn beyond_its_speed_limit_a_joint_is_not_driven_on() {
        let after = |share: f64, torque: f64| {
            let first = |x: f64| Joints::new(x, 0.0, 0.0, 0.0, 0.0, 0.0);
            let tau = first(torque) + ARM.gravity(&START);
            *drive().step(&START, &first(share * ARM.velocity()[0]), Some(&tau))
        };
        assert_eq!(after(0.99, 20.0).flags, 0);
        assert_eq!(after(1.01, -20.0).flags, 0, "braking is allowed");
        for direction in [1.0, -1.0] {
            let held = after(1.01 * direction, 20.0 * direction);
            assert_eq!((held.flags, held.saturation_mask), (DRIVE_SPEED, 1));
            assert!(held.tau[0] * direction < 0.0, "it slows down");
        }
    }

    #[test]
    fn stale_torque_is_held_then_stopped_then_braked_and_comes_back_without_a_jump() {
        let mut drive = drive();
        let gravity = ARM.gravity(&START);
        let command = gravity + Joints::new(30.0, -40.0, 20.0, 5.0, 4.0, 3.0);
        let moving = Joints::new(0.5, -0.4, 0.3, 1.0, -1.0, 1.0);
        drive.step(&START, &moving, Some(&command));
        for k in 1..=3 {
            let held = *drive.step(&START, &moving, None);
            assert_eq!((held.drive, held.stale_ticks), (DRIVE_HOLDING, k));
            assert_eq!(drive.tau(), command);
        }
        let mut last = command;
        for _ in 0..20 {
            assert_eq!(drive.step(&START, &moving, None).drive, DRIVE_STOPPING);
            assert!(step_ratio(&last, &drive.tau()) <= TORQUE_RATE * 1e-3 + 1e-12);
            last = drive.tau();
        }
        let damping = ARM.mass_matrix(&START).diagonal().component_mul(&moving);
        let law = gravity - damping * STOP_GAIN;
        let law = law.zip_map(ARM.effort(), |t, e| t.clamp(-e, e));
        assert!((last - law).amax() < 1e-12, "the stop law");
        assert_eq!(drive.step(&START, &REST, None).drive, DRIVE_BRAKED);
        for _ in 0..20 {
            drive.step(&START, &REST, None);
        }
        assert_eq!(drive.tau(), REST, "the brakes carry the arm");

        let heavy = gravity - Joints::new(0.0, 60.0, 0.0, 0.0, 0.0, 0.0);
        let (mut ticks, mut last) = (0, REST);
        while drive.is_braked() {
            drive.step(&START, &REST, Some(&heavy));
            assert!(step_ratio(&last, &drive.tau()) <= RETURN_RATE * 1e-3 + 1e-12);
            (last, ticks) = (drive.tau(), ticks + 1);
            assert!(ticks < 20, "the torque builds up in a bounded time");
        }
        assert!(ticks > 3 && (last, drive.state().drive) == (heavy, DRIVE_ACTIVE));
    }

    #[test]
    fn a_return_from_stopping_is_ramped_even_where_it_is_interrupted() {
        let (mut drive, moving) = (drive(), Joints::repeat(1.0));
        for _ in 0..10 {
            drive.step(&START, &moving, None);
        }
        let mut last = drive.tau();
        let far = last + ARM.effort() * 0.45;
        for command in [Some(&far), None, Some(&far)] {
            let applied = *drive.step(&START, &moving, command);
            let (state, flag, step) = match command {
                Some(_) => (DRIVE_ACTIVE, DRIVE_RATE, 0.1),
                // A torque that is held is not a fresh one.
                None => (DRIVE_HOLDING, DRIVE_ABSENT, 0.0),
            };
            assert_eq!((applied.drive, applied.flags & flag), (state, flag));
            assert!((step_ratio(&last, &drive.tau()) - step).abs() < 1e-12);
            last = drive.tau();
        }
    }

    #[test]
    fn brakes_engage_in_bounded_time_even_if_rest_never_comes() {
        let mut drive = drive();
        let ticks = (0..2000).find(|_| drive.step(&START, &Joints::repeat(1.0), None).braked == 1);
        assert_eq!(ticks, Some(3 + 1000));
    }

    proptest::proptest! {
        #[test]
        fn whatever_is_commanded_the_torque_is_finite_within_limits_and_bounded_in_step(
            commands in proptest::collection::vec(proptest::option::of(proptest::array::uniform6(proptest::num::f64::ANY)), 1..60),
            qdot in proptest::array::uniform6(-8.0f64..8.0),
        ) {
            let (mut drive, qdot) = (drive(), Joints::from(qdot));
            for command in commands {
                let before = drive.tau();
                drive.step(&START, &qdot, command.map(Joints::from).as_ref());
                proptest::prop_assert!(drive.tau().iter().zip(ARM.effort()).all(|(t, e)| t.abs() <= *e));
                proptest::prop_assert!(step_ratio(&before, &drive.tau()) <= TORQUE_RATE * 1e-3 + 1e-12);
            }
        }
    }
}
