//! Step 1 of a tick: the desired motion, and the acceleration that follows it.

use crate::centre::PoseMotion;
use crate::continuous::guide::Guide;
use crate::linear::{angular, clamp_norm, linear, stack};
use crate::paper::neighborhood::Neighborhood;
use crate::paper::type_2::Turn;
use crate::served::{free_axis, rotation_error, turned};
use crate::state::State;
use crate::tick::{Inputs, Motion};
use crate::trajectory::Path;
use crate::types::Report;
use nalgebra::Vector6;
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
pub(crate) fn desired_motion<const N: usize>(
    follow: &Followed<'_, N>,
    state: &mut State<N>,
    now: &Inputs<'_, N>,
) -> Motion<N> {
    let Followed {
        path,
        guide,
        task,
        control,
    } = follow;
    let before = state.progress.leg;
    path.advance(&mut state.progress, 0.0, now.report);
    if state.progress.leg != before {
        state.turn = Turn::none();
    }
    let clock = state.governor.rate;
    let reorients = path
        .leg(state.progress.leg)
        .is_some_and(|leg| leg.reorient.is_some());
    let planned = guide
        .at(state.progress.leg, state.route_time_s)
        .filter(|_| !reorients);
    // The path waits while the plan turns ζ.
    let time_rate = planned.map_or(1.0, |plan| plan.time_rate);
    let V = now.at.J * now.qdot;
    let free = free_axis(task);
    let served = |motion: PoseMotion| match &free {
        Some(k) => turned(&motion, &now.terms.X_BE.R, &angular(&V), k),
        None => motion,
    };
    let place = path.place(&state.progress);
    let on_path = place.moving(clock * time_rate, state.governor.rate_dot * time_rate);
    let desired_E = served(PoseMotion {
        a: on_path.a + state.servo.a * clock,
        ..on_path
    });
    let desired = desired_E.at(now.p_EC);
    let turn_error = rotation_error(&desired.R, &now.terms.X_BE.R, free.as_ref());
    let error = stack(&(desired.p - now.at.p), &turn_error);
    let clips = guide.ends_before(state.progress.leg);
    // The distance to a goal beyond reach along a lost direction must not take from the answer across it.
    let lost = if clips {
        along_lost(&error, now.report)
    } else {
        Vector6::zeros()
    };
    let bounded = |e: &Vector6<f64>| {
        stack(
            &clamp_norm(linear(e), POSITION_ERROR_MAX),
            &clamp_norm(angular(e), ORIENTATION_ERROR_MAX),
        )
    };
    let feedback = bounded(&(error - lost)) + bounded(&lost);
    let Control { k_p, k_v, .. } = **control;
    Motion {
        leg: path.leg(state.progress.leg).copied(),
        planned,
        clips,
        clock,
        desired_E,
        desired,
        V_nominal: served(place.moving(time_rate, 0.0)).at(now.p_EC).V,
        a_feed: served(place.moving(clock * time_rate, 0.0)).at(now.p_EC).a,
        error,
        feedback: feedback * k_p,
        a: desired.a + (desired.V - V) * k_v + feedback * k_p,
    }
}

/// The share of an error along the lost directions, as far as each is left to its auxiliary coordinate.
fn along_lost<const N: usize>(error: &Vector6<f64>, report: &Report<N>) -> Vector6<f64> {
    let mut across = *error;
    for s in report.listed() {
        let openness = Neighborhood {
            eta_in: s.eta_in,
            eta_out: s.eta_out,
        }
        .openness(s.s);
        across -= s.zeta_B * (s.zeta_B.dot(&across) * (1.0 - openness));
    }
    error - across
}
