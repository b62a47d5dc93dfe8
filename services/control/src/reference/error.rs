//! The pose error at C, as far as the law answers to it.

use crate::limits::clock::SLOWEST;
use crate::linear::{Vector3, Vector6, angular, linear, served, stack};
use crate::tick::Now;
use crate::types::Report;

/// Largest position error that feedback answers to, m: a goal far away must not demand the acceleration of its whole distance.
const POSITION_ERROR_MAX: f64 = 0.05;
/// Largest orientation error that feedback answers to, rad.
const ORIENTATION_ERROR_MAX: f64 = 0.25;

/// Share of a neighbourhood's thresholds within which a rotation counts as lost.
const DEEP: f64 = 0.25;

/// Error across the lost directions from which on the clock slows down along the boundary of reach, m and rad: the path goes on there as the hand
/// cannot, which falls behind in proportion to its speed.
const STRAYED: (f64, f64) = (0.3e-3, 2.6e-3);

/// A pose error as far as feedback answers to it.
pub(crate) fn bounded(error: &Vector6) -> Vector6 {
    stack(
        &linear(error).cap_magnitude(POSITION_ERROR_MAX),
        &angular(error).cap_magnitude(ORIENTATION_ERROR_MAX),
    )
}

/// The errors of pose and velocity at C as the law answers to them: where ζ takes a rotation, that rotation is about E, which stays on its path. About C, the
/// point that the singular directions belong to, it would take E along.
///
/// The twist that is lost for ζ = [f; m] is t = [f + m × r; m], r from E to C: the force is lost at C, the moment's rotation about E. Only its part
/// orthogonal to ζ is taken out, so that what answers along ζ stays as it is. And only deep in the neighbourhood ([`DEEP`]): where the auxiliary
/// coordinate is held, moving C turns the hand about ζ in proportion to s, and with a gain of one it would run away.
pub(super) fn about_E<const N: usize>(at_C: [Vector6; 2], now: &Now<'_, N>) -> [Vector6; 2] {
    let r = now.terms.X_BE.R * now.p_EC;
    let mut out = at_C;
    for s in now.report.listed() {
        let zeta = &s.zeta_B;
        let t = zeta + stack(&zeta.fixed_rows::<3>(3).cross(&r), &Vector3::zeros());
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

/// Fastest clock with which the hand keeps beside a path beyond reach.
pub(crate) fn clock_beside<const N: usize>(
    task: &[bool; 6],
    error: &Vector6,
    report: &Report<N>,
) -> f64 {
    let across = error - along_lost(error, report);
    let across = served(task, &across);
    let strayed = (linear(&across).norm() / STRAYED.0).max(angular(&across).norm() / STRAYED.1);
    let strayed = strayed.max(1.0);
    (1.0 / (strayed * strayed * strayed)).max(SLOWEST)
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
