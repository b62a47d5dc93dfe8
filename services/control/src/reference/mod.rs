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
pub(crate) mod free_axis;
pub mod guide;
pub mod path;
pub(crate) mod posture;
pub mod targets;
pub mod turn;

use crate::centre::PoseMotion;
use crate::controller::Setup;
use crate::linear::{Vector3, Vector6, angular, linear, stack};
use crate::paper::type_2::Turn;
use crate::state::State;
use crate::tick::{Motion, Now};
use crate::types::Report;
use free_axis::{free_axis, rotation_error, turned};
use shared_types::scenario::Control;

/// Largest position error that feedback answers to, m: a goal far away must not demand the acceleration of its whole distance.
const POSITION_ERROR_MAX: f64 = 0.05;
/// Largest orientation error that feedback answers to, rad.
const ORIENTATION_ERROR_MAX: f64 = 0.25;

/// Share of a neighbourhood's thresholds within which a rotation counts as lost.
const DEEP: f64 = 0.25;

/// A pose error as far as feedback answers to it.
pub(crate) fn bounded(error: &Vector6) -> Vector6 {
    stack(
        &linear(error).cap_magnitude(POSITION_ERROR_MAX),
        &angular(error).cap_magnitude(ORIENTATION_ERROR_MAX),
    )
}

/// Step 1: the desired motion of E and C, the pose error, and a* = a_d + k_v(V_d − V) + k_p e, the error bounded.
pub(crate) fn motion<const N: usize>(
    setup: &Setup<N>,
    state: &mut State<N>,
    now: &Now<'_, N>,
) -> Motion<N> {
    let (path, guide, before) = (&setup.path, &setup.guide, state.progress.leg);
    let (forces, X_BE) = (&setup.forces, &now.terms.X_BE);
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
        Some(k) => turned(&motion, &now.terms.X_BE.R, &angular(&V), k),
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
    let turn_error = rotation_error(&desired_E.R, &now.terms.X_BE.R, free.as_ref());
    let mut desired = desired_E.at(now.p_EC);
    let mut V_nominal = served(place.moving(time_rate, 0.0)).at(now.p_EC).V;
    let mut a_feed = served(place.moving(clock * time_rate, 0.0)).at(now.p_EC).a;
    let off = stack(&(desired.p - now.at.p), &turn_error);
    let clips = guide.ends_before(state.progress.leg);
    // Beyond reach, the hand goes along with the nearest pose.
    let boundary = clips.then(|| boundary::nearest(&setup.task, now, &off));
    let boundary = boundary.flatten();
    if let Some(boundary) = &boundary {
        a_feed = boundary.acceleration(&a_feed, &desired.V);
        desired.a = boundary.acceleration(&desired.a, &desired.V);
        desired.V = boundary.velocity(&desired.V);
        V_nominal = boundary.velocity(&V_nominal);
    }
    let [error, lag] = about_E([off, desired.V - V], now);
    // The distance to a goal beyond reach along a lost direction must not take from the answer across it.
    let lost = if clips {
        along_lost(&error, now.report)
    } else {
        Vector6::zeros()
    };
    let Control { k_p, k_v, .. } = setup.scenario.control;
    let across = boundary.map_or(error - lost, |boundary| boundary.error(&(error - lost)));
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
        off_path: Vector3::zeros(),
    }
}

/// The errors of pose and velocity at C as the law answers to them: where ζ takes a rotation, that rotation is about E, which stays on its path. About C, the
/// point that the singular directions belong to, it would take E along.
///
/// The twist that is lost for ζ = [f; m] is t = [f + m × r; m], r from E to C: the force is lost at C, the moment's rotation about E. Only its part
/// orthogonal to ζ is taken out, so that what answers along ζ stays as it is. And only deep in the neighbourhood ([`DEEP`]): where the auxiliary
/// coordinate is held, moving C turns the hand about ζ in proportion to s, and with a gain of one it would run away.
fn about_E<const N: usize>(at_C: [Vector6; 2], now: &Now<'_, N>) -> [Vector6; 2] {
    let r = now.terms.X_BE.R * now.p_EC;
    let mut out = at_C;
    for s in now.report.listed() {
        let zeta = &s.zeta_B;
        let t = zeta + stack(&angular(zeta).cross(&r), &Vector3::zeros());
        // At least a half for every r below 1 m.
        let pairing = zeta.dot(&t).max(0.5);
        let across = (t - zeta * zeta.dot(&t)) / pairing;
        let lost = 1.0 - s.openness(s.s / DEEP);
        for (out, error) in out.iter_mut().zip(&at_C) {
            *out -= across * (lost * zeta.dot(error));
        }
    }
    out
}

/// The share of an error along the lost directions, as far as each is left to its auxiliary coordinate.
pub(crate) fn along_lost<const N: usize>(error: &Vector6, report: &Report<N>) -> Vector6 {
    let mut across = *error;
    for s in report.listed() {
        let openness = s.openness(s.s);
        across -= s.zeta_B * (s.zeta_B.dot(&across) * (1.0 - openness));
    }
    error - across
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::standing;

    /// A UR5 in its wrist's lock, E on its path and turned off it: about ζ that asks nothing of C, about another axis it moves C.
    #[test]
    fn a_lost_rotation_turns_the_hand_about_its_own_point() {
        standing("ur5", [0.4, -1.2, 1.5, 0.3, 0.0, 0.7], |now| {
            assert!(now.p_EC.norm() > 0.05, "{}", now.p_EC);
            // The error at C where E is on its path and the hand turned off it.
            let moved = |turn: Vector3| {
                let at_C = turn.cross(&(now.terms.X_BE.R * now.p_EC));
                let [error, _] = about_E([stack(&at_C, &turn), Vector6::zeros()], now);
                linear(&error).norm()
            };
            let lost = now.report.listed().iter().find(|s| s.inside).unwrap();
            let zeta = angular(&lost.zeta_B).normalize();
            let across = zeta.cross(&(now.terms.X_BE.R * now.p_EC)).normalize();
            assert!(moved(zeta * 0.05) < 1e-12, "{}", moved(zeta * 0.05));
            assert!(moved(across * 0.05) > 1e-3, "{}", moved(across * 0.05));
        });
    }
}
