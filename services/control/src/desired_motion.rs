//! Step 1 of a tick: the desired motion, and the acceleration that follows it.

use crate::centre::PoseMotion;
use crate::continuous::guide::Guide;
use crate::linear::{angular, clamp_norm, linear, stack};
use crate::paper::type_2::Turn;
use crate::served::{free_axis, rotation_error, turned};
use crate::state::State;
use crate::tick::{Inputs, Motion};
use crate::trajectory::Path;
use shared_types::scenario::Control;

/// Largest position error that feedback answers to, m: a goal far away must not demand the acceleration of its whole distance.
const POSITION_ERROR_MAX: f64 = 0.05;
/// Largest orientation error that feedback answers to, rad.
const ORIENTATION_ERROR_MAX: f64 = 0.25;

/// The path, and the terms on which it is followed.
pub(crate) struct Followed<'a, const N: usize> {
    pub(crate) path: &'a Path,
    pub(crate) guide: &'a Guide<N>,
    pub(crate) task: [bool; 6],
    pub(crate) control: &'a Control,
}

/// Step 1: the desired motion of E and C, the pose error, and a* = a_d + k_v(V_d − V) + k_p e, the error bounded.
pub(crate) fn desired_motion<const N: usize>(follow: &Followed<'_, N>, state: &mut State<N>, now: &Inputs<'_, N>) -> Motion<N> {
    let Followed { path, guide, task, control } = follow;
    let before = state.progress.leg;
    path.advance(&mut state.progress, 0.0, now.report);
    if state.progress.leg != before {
        state.turn = Turn::none();
    }
    let clock = state.governor.rate;
    let reorients = path.leg(state.progress.leg).is_some_and(|leg| leg.reorient.is_some());
    let planned = guide.at(state.progress.leg, state.route_time_s).filter(|_| !reorients);
    // The path waits while the plan turns ζ.
    let time_rate = planned.map_or(1.0, |plan| plan.time_rate);
    let V = now.at.J * now.qdot;
    let free = free_axis(task);
    let served = |motion: PoseMotion| match &free {
        Some(k) => turned(&motion, &now.terms.X_BE.R, &angular(&V), k),
        None => motion,
    };
    let on_path = path.desired(&state.progress, clock * time_rate, state.governor.rate_dot * time_rate);
    let desired_E = served(PoseMotion { a: on_path.a + state.servo.a * clock, ..on_path });
    let desired = desired_E.at(now.p_EC);
    let turn_error = rotation_error(&desired.R, &now.terms.X_BE.R, free.as_ref());
    let error = stack(&(desired.p - now.at.p), &turn_error);
    let feedback = stack(&clamp_norm(linear(&error), POSITION_ERROR_MAX), &clamp_norm(turn_error, ORIENTATION_ERROR_MAX));
    let Control { k_p, k_v, .. } = **control;
    Motion {
        leg: path.leg(state.progress.leg).copied(),
        planned,
        clock,
        desired_E,
        desired,
        V_nominal: served(path.desired(&state.progress, time_rate, 0.0)).at(now.p_EC).V,
        a_feed: served(path.desired(&state.progress, clock * time_rate, 0.0)).at(now.p_EC).a,
        error,
        feedback: feedback * k_p,
        a: desired.a + (desired.V - V) * k_v + feedback * k_p,
    }
}
