//! The reference: where the arm should go at this moment. Step 1 of a tick.
//!
//! | reference | given by | becomes | file |
//! |---|---|---|---|
//! | path | the segments of a scenario | a [`Leg`](path::Leg): a line, a turn, a slide along ζ, a [curve] | [`path`] |
//! | targets | a person or a program, at this moment | a leg of constant twist that begins anew at every tick | [`targets`] |
//! | turn of ζ | `reorient` in a segment | a leg that stays, and the auxiliary coordinate's own profile | [`turn`] |
//!
//! The law sees the same of all three: a [`Motion`]. Where the whole path is planned, the [`guide`] gives posture and auxiliary coordinates beside it;
//! the null space of a redundant arm has its own goal in [`posture`].

pub(crate) mod avoidance;
mod boundary;
pub(crate) mod curve;
pub(crate) mod error;
pub(crate) mod free_axis;
pub mod guide;
pub mod path;
pub(crate) mod posture;
pub mod targets;
pub mod turn;

use crate::centre::PoseMotion;
use crate::controller::Setup;
use crate::linear::{Vector6, stack};
use crate::paper::type_2::Turn;
use crate::state::State;
use crate::tick::{Motion, Now};
use error::{about_E, along_lost, bounded};
use free_axis::{free_axis, rotation_error, turned};
use shared_types::scenario::Control;

/// Step 1: the desired motion of E and C, the pose error, and a* = a_d + k_v(V_d − V) + k_p e, the error bounded.
pub(crate) fn motion<const N: usize>(
    setup: &Setup<N>,
    state: &mut State<N>,
    now: &Now<'_, N>,
) -> Motion<N> {
    let (path, guide, forces) = (&setup.path, &setup.guide, &setup.forces);
    let X_BE = &now.terms.X_BE;
    let before = state.progress.leg;
    forces.advance(path, &mut state.progress, 0.0, now.report, X_BE);
    if state.progress.leg != before {
        state.turn = Turn::none();
    }
    let clock = state.clock.rate;
    let leg = path.leg(state.progress.leg).copied();
    let reorients = leg.is_some_and(|leg| leg.reorient.is_some());
    let (route_s, rate_dot) = (state.clock.plan_s, state.clock.rate_dot);
    let planned = guide.motion(state.progress.leg, route_s, clock, rate_dot);
    let planned = planned.filter(|_| !reorients);
    // The path waits while the plan turns ζ.
    let time_rate = planned.map_or(1.0, |plan| plan.time_rate);
    let V = now.at.J * now.qdot;
    let free = free_axis(&setup.task);
    let served = |motion: PoseMotion| match &free {
        Some(k) => turned(&motion, &X_BE.R, &V, k),
        None => motion,
    };
    let place = path.place(&state.progress);
    let on_path = place.moving(clock * time_rate, rate_dot * time_rate);
    let mut desired_E = served(PoseMotion {
        a: on_path.a + state.targets.a * clock,
        ..on_path
    });
    if !forces.are_none() {
        forces.free(state, &mut desired_E, now);
    }
    let turn_error = rotation_error(&desired_E.R, &X_BE.R, free.as_ref());
    let mut desired = desired_E.at(now.p_EC);
    let mut V_nominal = served(place.moving(time_rate, 0.0)).at(now.p_EC).V;
    let mut a_feed = served(place.moving(clock * time_rate, 0.0)).at(now.p_EC).a;
    let off = stack(&(desired.p - now.at.p), &turn_error);
    let clips = guide.ends_before(state.progress.leg);
    // Beyond reach, the hand goes along with the nearest pose.
    let boundary = clips.then(|| boundary::nearest(&setup.task, now, &off));
    let boundary = boundary.flatten();
    if let Some(boundary) = &boundary {
        boundary.lead(&mut desired, &mut V_nominal, &mut a_feed);
    }
    let [error, lag] = about_E([off, desired.V - V], now);
    // The distance to a goal beyond reach along a lost direction must not take from the answer across it.
    let lost = if clips {
        along_lost(&error, now.report)
    } else {
        Vector6::zeros()
    };
    let across = error - lost;
    let across = boundary.map_or(across, |boundary| boundary.error(&across));
    let Control { k_p, k_v, .. } = setup.scenario.control;
    let feedback = (bounded(&across) + bounded(&lost)) * k_p;
    Motion {
        leg,
        planned,
        clips,
        clock,
        desired_E,
        desired,
        V_nominal,
        a_feed,
        error,
        feedback,
        a: desired.a + lag * k_v + feedback,
        off_path: Vector6::zeros(),
    }
}
