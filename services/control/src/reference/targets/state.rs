//! The reference from tick to tick.

use crate::limits::range::{Fastest, STANDING};
use crate::limits::torque::Sent;
use crate::linear::{Joints, Matrix3, Vector6, angular, linear, rotation_exp, stack};
use crate::state::pose;
use crate::types::Refusal;
use model::{Pose, joints, padded};
use shared_types::checkpoints::ServoCheckpoint;
use shared_types::codes::{SIDE_NEGATIVE, SIDE_POSITIVE, TARGET_POSTURE};
use shared_types::scenario::{Scenario, Servo};
use shared_types::{AnalyzerCheckpoint, TargetContent};

/// Gain from an error of velocity to an acceleration, 1/s, and the lag of that acceleration, s: a step in it would be a step in torque.
const GAIN: f64 = 25.0;
const LAG_S: f64 = 0.010;
/// Gain from an error of a joint's position to its rate, 1/s.
const POSTURE_GAIN: f64 = 5.0;
/// Largest share of a joint's speed that a posture target takes, and time in which it gets there, s.
const POSTURE_SPEED: f64 = 0.4;
const POSTURE_RISE_S: f64 = 0.3;

/// A motion that a joint limit has ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ended {
    /// The twist asked for, its linear part over the arm's length; rad/s.
    pub asked: Vector6,
    /// Index of the joint, and whether it is at its upper limit.
    pub joint: (usize, bool),
}

/// The targets refused.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Refused {
    /// Given tick of the last one.
    pub tick: Option<u64>,
    /// How many.
    pub count: u32,
    /// Why the last one was: one of `codes::TARGET_REFUSALS`.
    pub why: u32,
}

/// The times that the arm was brought to rest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stops {
    /// Whether it is being so.
    pub now: bool,
    /// How often.
    pub count: u32,
    /// Why, the last time.
    pub why: Refusal,
}

/// The state of a steered run's reference; all of it but `fastest`, `withheld`, `resting` and `presses`, which each tick makes anew, survives a restart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TargetState<const N: usize> {
    /// The target in force.
    pub held: TargetContent,
    /// The tick in hand.
    pub tick: u64,
    /// Tick at which the session ended.
    pub over: Option<u64>,
    /// Pose in B.
    pub X: Pose,
    /// Twist at full clock speed.
    pub V: Vector6,
    /// Its change per second of real time.
    pub a: Vector6,
    /// Posture of the reference arm, rad.
    pub q: Joints<N>,
    /// Its velocity, rad/s.
    pub qdot: Joints<N>,
    /// Its torque.
    pub sent: Sent<N>,
    /// Distance that reach has taken away since the target began, m.
    pub behind_m: f64,
    /// The targets refused.
    pub refused: Refused,
    /// The times that the arm was brought to rest.
    pub stops: Stops,
    /// The tick before was at the boundary of reach.
    pub clipped: bool,
    /// The reference arm begins anew at the arm, from which it has parted.
    pub parted: bool,
    /// Ticks in a row in which nothing was asked for, and the reference stood.
    pub idle_ticks: u32,
    /// Ticks in a row in which a joint limit kept the hand from the motion asked for.
    pub held_ticks: u32,
    /// The motion that a joint limit has ended.
    pub ended: Option<Ended>,
    /// The reference arm rests at this tick.
    pub resting: bool,
    /// The clock that the joint limits allow at this tick.
    pub fastest: Fastest,
    /// The joint before whose limit a null motion is held back at this tick, and whether that is the upper one.
    pub withheld: Option<(usize, bool)>,
    /// The force of a target that the arm has given up, N; zero: none.
    pub given_up: [f64; 3],
    /// The hand presses as the target asks at this tick.
    pub presses: bool,
}

/// A scenario with the session's duration in place of the text of its targets, which another process publishes, and without the rows of its tables,
/// which the path has.
pub fn without_text(scenario: &Scenario) -> Scenario {
    let mut scenario = scenario.clone();
    if let Some(session) = &mut scenario.servo {
        session.duration_s = session.duration_s();
        session.targets.clear();
    }
    let tables = scenario
        .segment
        .iter_mut()
        .flat_map(|segment| &mut segment.table);
    tables.for_each(|table| table.rows.clear());
    scenario
}

impl<const N: usize> TargetState<N> {
    /// At rest in a posture whose pose is `X`.
    pub fn at(X: Pose, q: Joints<N>, sent: Sent<N>) -> Self {
        Self {
            held: TargetContent::default(),
            tick: 0,
            over: None,
            X,
            V: Vector6::zeros(),
            a: Vector6::zeros(),
            q,
            qdot: Joints::zeros(),
            sent,
            behind_m: 0.0,
            refused: Refused::default(),
            stops: Stops::default(),
            clipped: false,
            parted: false,
            idle_ticks: 0,
            held_ticks: 0,
            ended: None,
            resting: false,
            fastest: Fastest::default(),
            withheld: None,
            given_up: [0.0; 3],
            presses: false,
        }
    }

    /// Whether the target in force is a posture.
    pub fn is_posture(&self) -> bool {
        self.held.kind == TARGET_POSTURE
    }

    /// Whether the reference arm moves joint by joint at this tick, and the law has no part in it.
    pub fn goes_by_joints(&self) -> bool {
        !self.stops.now && (self.resting || self.is_posture())
    }

    /// The posture nearest to the one asked for in which every joint can stand, rad; and the first joint whose range it exceeds, and whether upwards.
    #[must_use]
    pub fn goal(&self, lower: &Joints<N>, upper: &Joints<N>) -> (Joints<N>, Option<(usize, bool)>) {
        let asked = joints::<N>(&self.held.q);
        let goal = Joints::from_fn(|i, _| {
            asked[i].clamp(
                lower[i] + STANDING,
                (upper[i] - STANDING).max(lower[i] + STANDING),
            )
        });
        let beyond = (0..N).find(|i| goal[*i] != asked[*i]);
        (goal, beyond.map(|i| (i, asked[i] > goal[i])))
    }

    /// The side in which a fold is to be left: −1, +1, or 0 to keep.
    pub fn branch(&self) -> i32 {
        i32::from(self.held.side == SIDE_POSITIVE) - i32::from(self.held.side == SIDE_NEGATIVE)
    }

    /// Rest in the pose `X`: what is left of a motion that the law has ended.
    pub fn rest_at(&mut self, X: Pose) {
        self.X = X;
        (self.V, self.a) = (Vector6::zeros(), Vector6::zeros());
    }

    /// One tick towards the twist `V`: within the session's acceleration, and smooth in it.
    pub fn turn_to(&mut self, V: &Vector6, session: &Servo, dt: f64) {
        let wanted = (V - self.V) * GAIN;
        let bounded = stack(
            &linear(&wanted).cap_magnitude(session.acceleration_m_s2),
            &angular(&wanted).cap_magnitude(session.acceleration_rad_s2),
        );
        self.a += (bounded - self.a) * (dt / (LAG_S + dt));
    }

    /// The reference arm's acceleration towards the posture `goal`, all joints arriving together, rad/s².
    #[must_use]
    pub fn towards(&self, goal: &Joints<N>, velocity: &Joints<N>) -> Joints<N> {
        let most = |i: usize| POSTURE_SPEED * velocity[i].min(10.0);
        // The slowest joint gives the measure.
        let error = goal - self.q;
        let share = (0..N).fold(0.0_f64, |share, i| {
            share.max(POSTURE_GAIN * error[i].abs() / most(i))
        });
        let wanted = error * (POSTURE_GAIN / share.max(1.0));
        Joints::from_fn(|i, _| {
            let limit = most(i) / POSTURE_RISE_S;
            ((wanted[i] - self.qdot[i]) * GAIN).clamp(-limit, limit)
        })
    }

    /// Moves the reference arm on by a tick.
    pub fn accelerate_arm(&mut self, qddot: &Joints<N>, dt: f64) {
        self.q += self.qdot * dt + qddot * (0.5 * dt * dt);
        self.qdot += qddot * dt;
    }

    /// Moves on by a tick at the clock's speed.
    pub fn advance(&mut self, clock: f64, dt: f64) {
        let step = self.V * (clock * dt);
        self.X = Pose {
            R: rotation_exp(&angular(&step)) * self.X.R,
            p: self.X.p + linear(&step),
        };
        // A step towards the nearest rotation: rounding must not add up.
        self.X.R = self.X.R * (Matrix3::identity() * 3.0 - self.X.R.tr_mul(&self.X.R)) * 0.5;
        self.V += self.a * dt;
    }

    /// Writes all of it; the analysis is the controller's.
    pub fn checkpoint(&self) -> ServoCheckpoint {
        let plus_one = |tick: Option<u64>| tick.map_or(0, |tick| tick.saturating_add(1));
        ServoCheckpoint {
            held: self.held,
            tick: self.tick,
            over_tick: plus_one(self.over),
            refused_tick: plus_one(self.refused.tick),
            p_BE: self.X.p.into(),
            R_BE: std::array::from_fn(|i| self.X.R[i]),
            V: self.V.into(),
            a: self.a.into(),
            q: padded(&self.q),
            qdot: padded(&self.qdot),
            tau: padded(&self.sent.tau),
            tau_path: padded(&self.sent.path),
            tau_null: padded(&self.sent.null),
            analysis: AnalyzerCheckpoint::default(),
            behind_m: self.behind_m,
            refused: self.refused.count,
            refusal: self.refused.why,
            stop: self.stops.why.code(),
            stops: self.stops.count,
            stopping: u32::from(self.stops.now),
            clipped: u32::from(self.clipped),
            parted: u32::from(self.parted),
            idle_ticks: self.idle_ticks,
            held_ticks: self.held_ticks,
            ended: self.ended.map_or([0.0; 6], |ended| ended.asked.into()),
            ended_joint: self.ended.map_or(0, |ended| ended.joint.0 as u32 + 1),
            ended_upper: self.ended.map_or(0, |ended| u32::from(ended.joint.1)),
            reserved: 0,
            given_up: self.given_up,
        }
    }

    /// The state that [`checkpoint`](Self::checkpoint) has written, its torque within the arm's `limits`, N·m.
    pub fn restored(from: &ServoCheckpoint, limits: &Joints<N>) -> Self {
        Self {
            held: from.held,
            tick: from.tick,
            over: from.over_tick.checked_sub(1),
            X: pose(&from.R_BE, from.p_BE),
            V: from.V.into(),
            a: from.a.into(),
            q: joints(&from.q),
            qdot: joints(&from.qdot),
            sent: Sent::restored(
                [&from.tau, &from.tau_path, &from.tau_null].map(joints),
                limits,
            ),
            behind_m: from.behind_m,
            refused: Refused {
                tick: from.refused_tick.checked_sub(1),
                count: from.refused,
                why: from.refusal,
            },
            stops: Stops {
                now: from.stopping != 0,
                count: from.stops,
                why: Refusal::from_code(from.stop).unwrap_or(Refusal::Checkpoint),
            },
            clipped: from.clipped != 0,
            parted: from.parted != 0,
            idle_ticks: from.idle_ticks,
            held_ticks: from.held_ticks,
            ended: (from.ended_joint as usize)
                .checked_sub(1)
                .filter(|joint| *joint < N)
                .map(|joint| Ended {
                    asked: from.ended.into(),
                    joint: (joint, from.ended_upper != 0),
                }),
            resting: false,
            fastest: Fastest::default(),
            withheld: None,
            given_up: from.given_up,
            presses: false,
        }
    }
}
