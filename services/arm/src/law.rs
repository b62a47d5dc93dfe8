//! The law, tick by tick: the steps of the processes `analyzer` and `controller`, towards a target that is given at each tick.

use std::fmt::{self, Display};
use std::sync::Arc;

use controller::{Commanded, Read};
use model::{Joint, Refused, Robot};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use shared_types::{
    ControlState, MAX_SINGULARITIES, ServoState, SingularityReport, StateEstimate, Target,
    TargetContent, TorqueCommand, codes,
};

use crate::steps::{Steps, steps};
use crate::{Arm, is_finite, scenario};

/// Age from which a target no longer counts, where those after it are refused; s.
const VALID_S: f64 = 0.1;

/// Error of a pose's last row that rounding may have made.
const ROUNDED: f64 = 1e-6;

/// The part of a law that all its rows share.
pub struct Task {
    robot: Arc<Robot>,
    steps: Box<dyn Steps>,
    /// The posture in which a row begins; `None`: that of its first tick.
    q: Option<Vec<f64>>,
}

/// One arm under the law, with its last messages.
pub struct Row {
    steps: Box<dyn Steps>,
    start: Start,
    tick: u64,
    estimate: StateEstimate,
    report: SingularityReport,
    target: Target,
    control: ControlState,
    servo: ServoState,
    torque: TorqueCommand,
}

#[derive(Clone, Copy, PartialEq)]
enum Start {
    /// No tick yet.
    Awaited,
    /// The position of a joint was none of the arm's; the next tick may begin.
    Refused,
    Begun,
}

/// The arguments of a tick, their rows one after another: q, qdot, pose, twist, tau_disturbance.
#[derive(Clone, Copy)]
pub struct Given<'a>(pub [Option<&'a [f64]>; 5]);

impl Given<'_> {
    /// Row `i` of `count`.
    pub fn row(&self, i: usize, count: usize) -> Self {
        Self(self.0.map(|all| {
            let all = all?;
            let width = all.len() / count;
            Some(&all[i * width..][..width])
        }))
    }

    /// The target of a tick: a pose that moves on with a twist, a twist alone, or none.
    fn target(&self, tick: u64) -> TargetContent {
        let mut target = TargetContent {
            given_tick: tick,
            valid_s: VALID_S,
            ..TargetContent::default()
        };
        let [_, _, pose, twist, _] = self.0;
        if let Some(twist) = twist {
            target.twist.copy_from_slice(twist);
            target.kind = codes::TARGET_TWIST;
        }
        match pose {
            Some(pose) if pose.len() == 7 => {
                target.position.copy_from_slice(&pose[..3]);
                target.quaternion.copy_from_slice(&pose[3..]);
            }
            Some(X) => {
                let R = Matrix3::from_fn(|i, j| X[4 * i + j]);
                let R = Rotation3::from_matrix_unchecked(R);
                let turn = UnitQuaternion::from_rotation_matrix(&R);
                target.position = [X[3], X[7], X[11]];
                let mut last = X[12..].iter().zip([0.0, 0.0, 0.0, 1.0]);
                target.quaternion = match last.all(|(x, pose)| (x - pose).abs() < ROUNDED) {
                    true => [turn.w, turn.i, turn.j, turn.k],
                    // It is transposed, say: refused for its rotation.
                    false => [0.0; 4],
                };
            }
            None => return target,
        }
        target.kind = codes::TARGET_POSE;
        target
    }
}

impl Task {
    /// The law of an arm with `dt` s between two ticks, 1/dt a whole number from 50 to 20000. It begins at rest in `q`, rad, to which spare joints are drawn;
    /// in that of its first tick where `None`. `settings` are `key=value` of a scenario.
    ///
    /// # Errors
    /// [`Refused`] for another `dt`, a `q` that is not the arm's, or a setting that is none.
    pub fn new(
        arm: &Arm,
        dt: f64,
        q: Option<&[f64]>,
        mut settings: Vec<String>,
    ) -> Result<Self, Refused> {
        let rate = (1.0 / dt).round();
        if !((rate * dt - 1.0).abs() < 1e-9 && (50.0..=20_000.0).contains(&rate)) {
            return Err(Refused::because(format!(
                "dt = {dt}: give the time of a tick in s, one over a whole number from 50 to 20000, such as 0.001"
            )));
        }
        arm.robot.complete().map_err(Refused::because)?;
        settings.push(format!("rate_hz={rate}"));
        let robot = Arc::clone(&arm.robot);
        let steps = steps(&robot, &scenario(&robot, &arm.tip, &settings)?)?;
        if let Some(q) = q {
            robot.check_posture(q).map_err(Refused::because)?;
        }
        Ok(Self {
            robot,
            steps,
            q: q.map(<[f64]>::to_vec),
        })
    }

    /// The arm.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }
}

impl Row {
    /// An arm before its first tick. The only one that allocates.
    pub fn new(task: &Task) -> Self {
        Self {
            steps: task.steps.copied(),
            start: Start::Awaited,
            tick: 0,
            estimate: StateEstimate::default(),
            report: SingularityReport::default(),
            target: Target::default(),
            control: ControlState::default(),
            servo: ServoState::default(),
            torque: TorqueCommand::default(),
        }
    }

    /// Bytes that it takes, with its memory.
    pub fn bytes(&self) -> usize {
        size_of::<Self>() + size_of_val(&*self.steps)
    }

    /// The same again.
    pub fn reset(&mut self) {
        self.steps.reset();
        (self.start, self.tick) = (Start::Awaited, 0);
        (self.estimate, self.report) = Default::default();
        (self.control, self.servo, self.torque) = Default::default();
    }

    /// One tick. The law does not begin before it is given a posture of the arm.
    pub fn step(&mut self, task: &Task, given: Given<'_>) {
        let Given([Some(q), qdot, _, _, tau_disturbance]) = given else {
            return;
        };
        let (n, tick, estimate) = (q.len(), self.tick, &mut self.estimate);
        estimate.header.tick = tick;
        let StateEstimate {
            q: place,
            qdot: rate,
            tau_disturbance: torque,
            ..
        } = estimate;
        for (values, given) in [(place, Some(q)), (rate, qdot), (torque, tau_disturbance)] {
            match given {
                Some(given) => values[..n].copy_from_slice(given),
                None => values.fill(0.0),
            }
        }
        if self.start != Start::Begun {
            let q = task.q.as_deref().unwrap_or(q);
            if task.robot.misfit(q).is_some() {
                self.start = Start::Refused;
                return;
            }
            self.steps.begin(q);
            self.start = Start::Begun;
        }
        self.tick += 1;
        // A state that is not finite is the controller's to refuse, and none for the analysis to remember.
        if is_finite(&estimate.q) && is_finite(&estimate.qdot) {
            self.steps.analyse(estimate, &mut self.report);
        }
        self.target.target = given.target(tick);
        let read = Read {
            estimate,
            report: &self.report,
            target: Some(&self.target),
            wrist: None,
        };
        let mut out = Commanded {
            servo: Some(&mut self.servo),
            state: &mut self.control,
            torque: &mut self.torque,
        };
        self.steps.control(&read, &mut out);
    }

    /// The torque of the last tick, N·m, one value per joint: zero before the law has begun.
    pub fn tau(&self, task: &Task) -> &[f64] {
        &self.torque.tau[..task.robot.dof()]
    }

    /// Why the law gives no motion any more, or none yet.
    pub fn refusal<'a>(&self, task: &'a Task) -> Option<Reason<'a>> {
        match (self.start, self.control.refusal) {
            (Start::Refused, _) => {
                let (joint, value) = task.robot.misfit(&self.estimate.q)?;
                Some(Reason::NotBegun { joint, value })
            }
            (_, codes::REFUSAL_NONE) => None,
            (_, refusal) => Some(Reason::Refused(codes::name_of(codes::REFUSALS, refusal))),
        }
    }

    /// The law's answer to the last tick. No allocation.
    pub fn state<'a>(&'a self, task: &'a Task) -> State<'a> {
        let (servo, control) = (&self.servo, &self.control);
        let listed = self.report.listed();
        let set_aside = (control.rejected_ticks > 0)
            .then(|| Reason::Refused(codes::name_of(codes::REFUSALS, codes::REFUSAL_ESTIMATE)));
        let singularity = |place: usize| {
            let one = listed.get(place)?;
            Some((
                codes::singularity_name(one.kind, place),
                codes::name_of(codes::MODES, control.mode[place]),
                control.beta[place],
            ))
        };
        State {
            tick: self.tick,
            phase: codes::name_of(codes::PHASES, self.torque.phase),
            reason: (self.refusal(task).or(set_aside)).unwrap_or(Reason::Follows(servo)),
            refusal: self.refusal(task),
            singularities: std::array::from_fn(singularity),
            speed_scale: servo.speed_scale,
            targets_refused: servo.refused,
            target_refusal: codes::name_of(codes::TARGET_REFUSALS, servo.refusal),
        }
    }
}

/// The law's answer at a tick, with its reasons.
pub struct State<'a> {
    /// Ticks since the law began.
    pub tick: u64,
    /// running, settling, done, refused.
    pub phase: &'static str,
    /// How the arm follows its target; the refusal where there is one.
    pub reason: Reason<'a>,
    /// Why the law has given up, or not begun.
    pub refusal: Option<Reason<'a>>,
    /// Each singularity's name, the law's mode at it, and β, the share of the operational-space command along ζ, 0 to 1.
    pub singularities: [Option<(&'static str, &'static str, f64)>; MAX_SINGULARITIES],
    /// Share of the twist asked for that the arm moves with, 0 to 1.
    pub speed_scale: f64,
    /// Targets refused since the law began.
    pub targets_refused: u32,
    /// Why the last of them was.
    pub target_refusal: &'static str,
}

/// A reason; its words are its `Display`.
#[derive(Clone, Copy)]
pub enum Reason<'a> {
    /// The law has not been given a posture of the arm yet.
    NotBegun {
        /// The first joint that does not fit.
        joint: &'a Joint,
        /// Its position, rad.
        value: f64,
    },
    /// The law has given up, or sets the state aside.
    Refused(&'static str),
    /// The arm follows its target.
    Follows(&'a ServoState),
}

impl Display for Reason<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotBegun { joint, value } => write!(
                f,
                "not begun: joint '{}' = {value} is not within its limits [{}, {}]",
                joint.name, joint.lower, joint.upper
            ),
            Self::Refused(words) => f.write_str(words),
            Self::Follows(servo) => {
                codes::reason_text(servo.reason, servo.joint, servo.upper).fmt(f)
            }
        }
    }
}
