//! The reference: where the arm should go at this moment. Step 1 of a tick.
//!
//! | reference | given by | becomes | file |
//! |---|---|---|---|
//! | path | the segments of a scenario | a [`Leg`](path::Leg): a line, a turn, a slide along ζ | [`path`] |
//! | targets | a person or a program, at this moment | a leg of constant twist that begins anew at every tick | [`targets`] |
//! | turn of ζ | `reorient` in a segment | a leg that stays, and the auxiliary coordinate's own profile | [`turn`] |
//!
//! The law sees the same of all three: a [`Motion`]. Where the whole path is planned, the [`guide`] gives posture and auxiliary coordinates beside it;
//! the null space of a redundant arm has its own goal in [`posture`].

pub(crate) mod avoidance;
pub(crate) mod free_axis;
pub mod guide;
pub mod path;
pub(crate) mod posture;
pub mod targets;
pub mod turn;

use crate::centre::PoseMotion;
use crate::controller::Setup;
use crate::linear::{angular, clamp_norm, linear, stack};
use crate::paper::type_2::Turn;
use crate::state::State;
use crate::tick::{Motion, Now};
use crate::types::Report;
use free_axis::{free_axis, rotation_error, turned};
use nalgebra::Vector6;
use shared_types::scenario::Control;

/// Largest position error that feedback answers to, m: a goal far away must not demand the acceleration of its whole distance.
const POSITION_ERROR_MAX: f64 = 0.05;
/// Largest orientation error that feedback answers to, rad.
const ORIENTATION_ERROR_MAX: f64 = 0.25;

/// A pose error as far as feedback answers to it.
pub(crate) fn bounded(error: &Vector6<f64>) -> Vector6<f64> {
    stack(
        &clamp_norm(linear(error), POSITION_ERROR_MAX),
        &clamp_norm(angular(error), ORIENTATION_ERROR_MAX),
    )
}

/// Step 1: the desired motion of E and C, the pose error, and a* = a_d + k_v(V_d − V) + k_p e, the error bounded.
pub(crate) fn motion<const N: usize>(
    setup: &Setup<N>,
    state: &mut State<N>,
    now: &Now<'_, N>,
) -> Motion<N> {
    let (path, guide, before) = (&setup.path, &setup.guide, state.progress.leg);
    path.advance(&mut state.progress, 0.0, now.report);
    if state.progress.leg != before {
        state.turn = Turn::none();
    }
    let clock = state.clock.rate;
    let leg = path.leg(state.progress.leg).copied();
    let reorients = leg.is_some_and(|leg| leg.reorient.is_some());
    let planned = guide
        .at(state.progress.leg, state.clock.plan_s)
        .filter(|_| !reorients);
    // The path waits while the plan turns ζ.
    let time_rate = planned.map_or(1.0, |plan| plan.time_rate);
    let V = now.at.J * now.qdot;
    let free = free_axis(&setup.task);
    let served = |motion: PoseMotion| match &free {
        Some(k) => turned(&motion, &now.terms.X_BE.R, &angular(&V), k),
        None => motion,
    };
    let place = path.place(&state.progress);
    let on_path = place.moving(clock * time_rate, state.clock.rate_dot * time_rate);
    let desired_E = served(PoseMotion {
        a: on_path.a + state.targets.a * clock,
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
    let Control { k_p, k_v, .. } = setup.scenario.control;
    let feedback = (bounded(&(error - lost)) + bounded(&lost)) * k_p;
    Motion {
        leg,
        planned,
        clips,
        clock,
        desired_E,
        desired,
        V_nominal: served(place.moving(time_rate, 0.0)).at(now.p_EC).V,
        a_feed: served(place.moving(clock * time_rate, 0.0)).at(now.p_EC).a,
        error,
        feedback,
        a: desired.a + (desired.V - V) * k_v + feedback,
    }
}

/// The share of an error along the lost directions, as far as each is left to its auxiliary coordinate.
fn along_lost<const N: usize>(error: &Vector6<f64>, report: &Report<N>) -> Vector6<f64> {
    let mut across = *error;
    for s in report.listed() {
        let openness = s.neighborhood().openness(s.s);
        across -= s.zeta_B * (s.zeta_B.dot(&across) * (1.0 - openness));
    }
    error - across
}
