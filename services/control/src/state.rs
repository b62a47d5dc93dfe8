//! The controller's state from tick to tick.

use crate::law::auxiliary::Loop;
use crate::law::force::Pressing;
use crate::limits::clock::Clock;
use crate::limits::plausible::Plausible;
use crate::limits::torque::Sent;
use crate::linear::{Joints, Matrix3};
use crate::paper::type_2::Turn;
use crate::reference::path::Progress;
use crate::reference::targets::TargetState;
use crate::types::{Mode, Refusal};
use model::{Pose, Terms, joints, padded};
use shared_types::wire::Part;
use shared_types::{ControllerCheckpoint, MAX_SINGULARITIES};

/// Farther than any leg leads, m and rad.
const FARTHEST: f64 = 1e6;

/// The state from tick to tick: all of it survives a restart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct State<const N: usize> {
    pub(crate) progress: Progress,
    pub(crate) clock: Clock,
    pub(crate) loops: [Loop; MAX_SINGULARITIES],
    pub(crate) turn: Turn<N>,
    pub(crate) refusal: Refusal,
    /// Torque of the tick before.
    pub(crate) sent: Sent<N>,
    /// Joint velocities that the path needs, rad/s.
    pub(crate) qdot_planned: Joints<N>,
    pub(crate) plausible: Plausible<N>,
    pub(crate) force: Pressing,
    /// Of a steered run.
    pub(crate) targets: TargetState<N>,
}

impl<const N: usize> State<N> {
    /// Before the first tick: an arm at rest in `q_start`, whose terms are `rest`; `effort` are the torque limits, N·m.
    pub(crate) fn begin(rest: &Terms<N>, q_start: Joints<N>, effort: &Joints<N>) -> Self {
        let sent = Sent::holding(&rest.gravity, effort);
        Self {
            progress: Progress::at(rest.X_BE),
            clock: Clock::default(),
            loops: [Loop::default(); MAX_SINGULARITIES],
            turn: Turn::none(),
            refusal: Refusal::None,
            sent,
            qdot_planned: Joints::zeros(),
            plausible: Plausible::unknown(),
            force: Pressing::default(),
            targets: TargetState::at(rest.X_BE, q_start, sent),
        }
    }

    /// Writes all of it.
    pub(crate) fn save(&self, out: &mut ControllerCheckpoint) {
        let State {
            progress,
            clock,
            loops,
            turn,
            refusal,
            sent,
            qdot_planned,
            plausible,
            force,
            targets,
        } = self;
        *out = ControllerCheckpoint {
            segment: progress.leg as u32,
            begun: u32::from(progress.begun),
            segment_time_s: progress.time_s,
            path_time_s: clock.path_s,
            route_time_s: clock.plan_s,
            p_BE_start: progress.start.p.into(),
            R_BE_start: std::array::from_fn(|i| progress.start.R[i]),
            translation: progress.by.into(),
            rotation: progress.turn.into(),
            governor_rate: clock.rate,
            governor_rate_dot: clock.rate_dot,
            governor_demand: clock.demand,
            turn_from: turn.from.into(),
            turn_angle: turn.angle,
            turn_dq: padded(&turn.by),
            turn_s: turn.duration_s,
            refusal: refusal.code(),
            rejected_ticks: plausible.rejected_ticks,
            plausible: u32::from(plausible.known),
            reserved: 0,
            tau: padded(&sent.tau),
            tau_path: padded(&sent.path),
            tau_null: padded(&sent.null),
            qdot_planned: padded(qdot_planned),
            q_plausible: padded(&plausible.q),
            qdot_plausible: padded(&plausible.qdot),
            loops: loops.map(|one| one.checkpoint()),
            force: force.checkpoint(),
            servo: targets.checkpoint(),
        };
    }

    /// The state that [`save`](Self::save) has written, its torque within the arm's `limits`, N·m. One with a number that is not finite, a leg that starts
    /// in no pose or leads farther than any, or a mode or a refusal that does not exist, is damaged: it refuses to go on.
    pub(crate) fn from_checkpoint(from: &ControllerCheckpoint, limits: &Joints<N>) -> Self {
        let is_damaged = is_damaged(from);
        let refusal = Refusal::from_code(from.refusal)
            .filter(|_| !is_damaged)
            .unwrap_or(Refusal::Checkpoint);
        Self {
            progress: Progress {
                leg: from.segment as usize,
                time_s: from.segment_time_s,
                begun: from.begun != 0,
                start: if is_damaged {
                    Pose::identity()
                } else {
                    pose(&from.R_BE_start, from.p_BE_start)
                },
                by: from.translation.into(),
                turn: from.rotation.into(),
            },
            clock: Clock {
                path_s: from.path_time_s,
                plan_s: from.route_time_s,
                rate: from.governor_rate,
                rate_dot: from.governor_rate_dot,
                demand: from.governor_demand,
            },
            loops: from.loops.map(|one| Loop::restored(&one)),
            turn: Turn {
                from: from.turn_from.into(),
                angle: from.turn_angle,
                by: joints(&from.turn_dq),
                duration_s: from.turn_s,
            },
            refusal,
            sent: Sent::restored(
                [&from.tau, &from.tau_path, &from.tau_null].map(joints),
                limits,
            ),
            qdot_planned: joints(&from.qdot_planned),
            plausible: Plausible {
                known: from.plausible != 0,
                rejected_ticks: from.rejected_ticks,
                q: joints(&from.q_plausible),
                qdot: joints(&from.qdot_plausible),
            },
            force: Pressing::restored(&from.force),
            targets: TargetState::restored(&from.servo, limits),
        }
    }
}

/// A number that is not finite, a leg that starts in no pose or leads farther than any, or a mode or a refusal that does not exist.
fn is_damaged(from: &ControllerCheckpoint) -> bool {
    let servo = &from.servo;
    // A reflection is orthogonal, too.
    let is_rotation = |R: &[f64; 9]| {
        let R = Matrix3::from_column_slice(R);
        R.is_orthogonal(1e-6) && R.determinant() > 0.0
    };
    let vectors = [from.p_BE_start, from.translation, from.rotation, servo.p_BE];
    let mut numbers = vectors
        .as_flattened()
        .iter()
        .chain(&servo.V)
        .chain(&servo.a);
    !from.is_finite()
        || ![from.R_BE_start, servo.R_BE].iter().all(is_rotation)
        || numbers.any(|x| x.abs() > FARTHEST)
        || from
            .loops
            .iter()
            .any(|one| Mode::from_code(one.mode).is_none())
        || Refusal::from_code(servo.stop).is_none()
}

/// A pose of a checkpoint.
pub(crate) fn pose(R: &[f64; 9], p: [f64; 3]) -> Pose {
    Pose {
        R: Matrix3::from_column_slice(R),
        p: p.into(),
    }
}
