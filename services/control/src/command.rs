//! The command of a tick: torque, desired motion and telemetry, under the law and while the arm is brought to rest.

use crate::continuous::saturation::Limited;
use crate::linear::{angular, stack};
use crate::state::State;
use crate::tick::{Auxiliary, Inputs, LimitedTorque, Motion};
use crate::types::{Command, Mode, Phase, Plan, Refusal};
use model::Terms;
use nalgebra::{SVector, Vector6};
use shared_types::MAX_SINGULARITIES;

/// The command and the telemetry of a tick under the law; `settle_s` is how long the arm is held after its last leg.
#[inline]
pub(crate) fn running<const N: usize>(
    state: &State<N>,
    now: &Inputs<'_, N>,
    motion: &Motion<N>,
    auxiliary: &Auxiliary<N>,
    torque: &LimitedTorque<N>,
    settle_s: f64,
) -> Command<N> {
    let Motion {
        leg,
        desired_E,
        error,
        ..
    } = motion;
    let telemetry = &auxiliary.telemetry;
    let planned = leg
        .and_then(|leg| leg.reorient)
        .filter(|_| state.turn.duration_s > 0.0);
    Command {
        tau: state.sent.tau,
        tau_task: state.sent.tau - state.sent.null,
        tau_null: state.sent.null,
        R_BE_d: desired_E.R,
        p_BE_d: desired_E.p,
        V_BE_d: desired_E.V,
        error: stack(&(desired_E.p - now.terms.X_BE.p), &angular(error)),
        path_time_s: state.path_time_s,
        time_scale: motion.clock * motion.planned.map_or(1.0, |plan| plan.time_rate),
        null_scale: torque.limited.null_scale,
        task_scale: torque.limited.task_scale,
        beta: telemetry.beta,
        aux_d: telemetry.aux_d,
        aux_rate_d: telemetry.aux_rate_d,
        plan: planned.map(|(place, _)| Plan {
            place,
            by: state.turn.by,
            duration_s: state.turn.duration_s,
        }),
        mode: telemetry.mode,
        segment: state.progress.leg as u32,
        phase: match (leg, state.progress.time_s < settle_s) {
            (Some(_), _) => Phase::Running,
            (None, true) => Phase::Settling,
            (None, false) => Phase::Done,
        },
        saturation_mask: torque.limited.mask,
        rate_mask: torque.rate_mask,
        rejected_ticks: 0,
        clipped: telemetry.clipped,
        refusal: Refusal::None,
    }
}

/// The torque that brings an arm to rest, within the limits: gravity and Coriolis held, each joint's speed damped by `damping`, 1/s, through the whole
/// mass matrix, so that no joint is thrown by the braking of another; zero where the state is not finite.
pub(crate) fn braking<const N: usize>(
    known: Option<(&Terms<N>, &SVector<f64, N>)>,
    damping: f64,
    limits: &SVector<f64, N>,
) -> Limited<N> {
    let mut tau = known.map_or_else(SVector::zeros, |(terms, qdot)| {
        terms.bias() - terms.A * qdot * damping
    });
    if !tau.iter().all(|x| x.is_finite()) {
        tau = SVector::zeros();
    }
    let mut mask = 0;
    for i in 0..N {
        if tau[i].abs() >= limits[i] {
            mask |= 1 << i;
            tau[i] = tau[i].clamp(-limits[i], limits[i]);
        }
    }
    Limited {
        tau,
        task: tau,
        null: SVector::zeros(),
        null_scale: 0.0,
        task_scale: 0.0,
        mask,
        load: 0.0,
    }
}

/// The command of a tick in which the arm is brought to rest, its torque already in `state`.
pub(crate) fn resting<const N: usize>(
    state: &State<N>,
    saturation_mask: u32,
    rate_mask: u32,
) -> Command<N> {
    let start = state.progress.start;
    Command {
        tau: state.sent.tau,
        tau_task: state.sent.tau - state.sent.null,
        tau_null: state.sent.null,
        R_BE_d: start.R,
        p_BE_d: start.p,
        V_BE_d: Vector6::zeros(),
        error: Vector6::zeros(),
        path_time_s: state.path_time_s,
        time_scale: 0.0,
        null_scale: 0.0,
        task_scale: 0.0,
        beta: [1.0; MAX_SINGULARITIES],
        aux_d: [0.0; MAX_SINGULARITIES],
        aux_rate_d: [0.0; MAX_SINGULARITIES],
        plan: None,
        mode: [Mode::Regular; MAX_SINGULARITIES],
        segment: state.progress.leg as u32,
        phase: Phase::Refused,
        saturation_mask,
        rate_mask,
        rejected_ticks: state.plausible.rejected_ticks,
        clipped: false,
        refusal: state.refusal,
    }
}
