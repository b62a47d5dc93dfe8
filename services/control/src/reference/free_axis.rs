//! Orientation of an arm that serves two rotations of three: five joints, of which one turns the hand only as the position demands (+).
//!
//! The third rotation, about the base axis k, is as the arm has it. A desired rotation R_d is met up to it: R_d' = exp(−α k)·R_d with α the twist of
//! R_d·Rᵀ about k, so that the error log(R_d'·Rᵀ) has no share about k, and none of what is served depends on α.

use crate::centre::PoseMotion;
use crate::linear::{
    Matrix3, Vector3, Vector6, angular, linear, rotation_exp, rotation_log, rotation_twist, stack,
};

/// The one base axis about which the task does not serve rotation; `None` where it serves all three, or fewer than two.
pub fn free_axis(task: &[bool; 6]) -> Option<Vector3> {
    let mut free = (0..3).filter(|k| !task[3 + k]);
    let (first, second) = (free.next()?, free.next());
    second.is_none().then(|| Vector3::ith(first, 1.0))
}

/// The rotation vector from `R` to `R_d`; without the share about `free` where there is one. Units rad.
pub(crate) fn rotation_error(R_d: &Matrix3, R: &Matrix3, free: Option<&Vector3>) -> Vector3 {
    let E = R_d * R.transpose();
    match free {
        None => rotation_log(&E),
        Some(k) => rotation_log(&(rotation_exp(&(k * -rotation_twist(&E, k))) * E)),
    }
}

/// A desired motion turned about `k` to where an arm in the orientation `R` with the twist `V` serves it.
///
/// ω' = exp(−α k)·ω_d − α̇ k and its derivative, with α̇ = k·(ω_d − ω): what is served of it does not depend on α̈.
#[must_use]
pub(crate) fn turned(desired: &PoseMotion, R: &Matrix3, V: &Vector6, k: &Vector3) -> PoseMotion {
    let T = rotation_exp(&(k * -rotation_twist(&(desired.R * R.transpose()), k)));
    let (w, a) = (T * angular(&desired.V), T * angular(&desired.a));
    let alpha_rate = k.dot(&(w - V.fixed_rows::<3>(3)));
    PoseMotion {
        R: T * desired.R,
        p: desired.p,
        V: stack(&linear(&desired.V), &(w - k * alpha_rate)),
        a: stack(&linear(&desired.a), &(a - k.cross(&w) * alpha_rate)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn one_free_rotation_is_found() {
        assert_eq!(free_axis(&[true; 6]), None);
        assert_eq!(
            free_axis(&[true, true, true, true, true, false]),
            Some(Vector3::z())
        );
        assert_eq!(free_axis(&[true, true, true, false, false, true]), None);
    }

    proptest! {
        /// An arm that follows what it serves, and turns about k as it likes, sees no error; and its velocity is the one demanded.
        #[test]
        fn the_served_directions_do_not_depend_on_the_free_rotation(
            start in prop::array::uniform3(-0.8..0.8_f64),
            w in prop::array::uniform3(-1.0..1.0_f64),
            a in prop::array::uniform3(-1.0..1.0_f64),
            (alpha, alpha_rate, alpha_rate_rate) in (-1.5..1.5_f64, -1.0..1.0_f64, -1.0..1.0_f64),
        ) {
            let (k, w, acc) = (Vector3::z(), Vector3::from(w), Vector3::from(a));
            let desired = |t: f64| {
                let turn = w * t + acc * (0.5 * t * t);
                rotation_exp(&turn) * rotation_exp(&Vector3::from(start))
            };
            let actual = |t: f64| rotation_exp(&(k * -(alpha + alpha_rate * t + 0.5 * alpha_rate_rate * t * t))) * desired(t);
            let omega = |f: &dyn Fn(f64) -> Matrix3, t: f64| rotation_log(&(f(t + 1e-4) * f(t - 1e-4).transpose())) / 2e-4;
            let rate = |f: &dyn Fn(f64) -> Matrix3| (omega(f, 1e-3) - omega(f, -1e-3)) / 2e-3;
            let motion = PoseMotion {
                R: desired(0.0),
                p: Vector3::zeros(),
                V: stack(&Vector3::zeros(), &omega(&desired, 0.0)),
                a: stack(&Vector3::zeros(), &rate(&desired)),
            };
            let served = turned(&motion, &actual(0.0), &stack(&Vector3::zeros(), &omega(&actual, 0.0)), &k);
            prop_assert!((served.R - actual(0.0)).amax() < 1e-9);
            prop_assert!(rotation_error(&motion.R, &actual(0.0), Some(&k)).amax() < 1e-9);
            prop_assert!((angular(&served.V) - omega(&actual, 0.0)).amax() < 1e-6);
            let error = angular(&served.a) - rate(&actual);
            prop_assert!((error - k * k.dot(&error)).amax() < 1e-4, "{error}");
        }
    }
}
