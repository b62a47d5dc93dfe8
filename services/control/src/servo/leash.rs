//! The leash between reference and arm: what the arm cannot reach, the reference does not run away to.

use crate::linear::{angular, linear, rotation_exp, rotation_log, smoothstep, stack};
use model::Pose;
use nalgebra::{Vector3, Vector6};

/// Longest distance and angle between reference and arm, m and rad: many times the error of tracking, and little to come back from.
const LENGTH: (f64, f64) = (0.003, 0.02);
/// Rate at which the reference comes back to the arm once nothing pulls it away, 1/s.
const BACK: f64 = 10.0;
/// Share of the leash from which a twist that would lengthen it is taken away.
const TAUT: f64 = 0.5;

/// The pull of the leash at a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pull {
    /// Error of position and orientation, m and rad.
    error: [Vector3<f64>; 2],
    /// How taut it is, 0 to 1.
    pub tension: f64,
}

impl Pull {
    /// Between the reference and the arm.
    #[must_use]
    pub fn between(reference: &Pose, arm: &Pose) -> Self {
        let error = [reference.p - arm.p, rotation_log(&(reference.R * arm.R.transpose()))];
        let taut = |error: &Vector3<f64>, length: f64| smoothstep((error.norm() / length - TAUT) / (1.0 - TAUT));
        Self { error, tension: taut(&error[0], LENGTH.0).max(taut(&error[1], LENGTH.1)) }
    }

    /// The reference at the end of the leash, where it is further away; and how far it has been taken back, m.
    #[must_use]
    pub fn hold(&self, reference: &Pose, arm: &Pose) -> (Pose, f64) {
        let [p, r] = self.error;
        let (mut held, mut back) = (*reference, 0.0);
        if p.norm() > LENGTH.0 {
            back = p.norm() - LENGTH.0;
            held.p = arm.p + p * (LENGTH.0 / p.norm());
        }
        if r.norm() > LENGTH.1 {
            held.R = rotation_exp(&(r * (LENGTH.1 / r.norm()))) * arm.R;
        }
        (held, back)
    }

    /// The reference on its way back to the arm, where `V` no longer leads away from it.
    #[must_use]
    pub fn relax(&self, reference: &Pose, V: &Vector6<f64>, dt: f64) -> Pose {
        let [p, r] = self.error;
        let mut relaxed = *reference;
        if linear(V).dot(&p) <= 0.0 {
            relaxed.p -= p * (BACK * dt);
        }
        if angular(V).dot(&r) <= 0.0 {
            relaxed.R = rotation_exp(&(r * (-BACK * dt))) * relaxed.R;
        }
        relaxed
    }

    /// A twist without what would pull the leash tighter.
    #[must_use]
    pub fn slacken(&self, V: &Vector6<f64>) -> Vector6<f64> {
        let without = |v: Vector3<f64>, error: &Vector3<f64>, length: f64| {
            let size = error.norm();
            let taut = smoothstep((size / length - TAUT) / (1.0 - TAUT));
            if taut > 0.0 { v - error * (v.dot(error).max(0.0) * taut / (size * size)) } else { v }
        };
        stack(&without(linear(V), &self.error[0], LENGTH.0), &without(angular(V), &self.error[1], LENGTH.1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reference_stays_within_the_leash_and_may_always_come_back() {
        let arm = Pose::identity();
        let far = Pose::translation(Vector3::new(0.05, 0.0, 0.0));
        let pull = Pull::between(&far, &arm);
        let (held, back) = pull.hold(&far, &arm);
        assert!((held.p.x - 0.003).abs() < 1e-12 && (back - 0.047).abs() < 1e-12 && pull.tension == 1.0);
        let V = Vector6::new(0.1, 0.2, 0.0, 0.0, 0.0, 0.3);
        assert_eq!(pull.slacken(&V), Vector6::new(0.0, 0.2, 0.0, 0.0, 0.0, 0.3));
        assert_eq!(pull.slacken(&-V), -V);
        assert_eq!(Pull::between(&Pose::translation(Vector3::new(0.001, 0.0, 0.0)), &arm).slacken(&V), V);
        assert_eq!(pull.relax(&held, &V, 1e-3), held, "it is still pulled");
        assert!((pull.relax(&far, &-V, 1e-3).p.x - 0.0495).abs() < 1e-12, "1 % of the way back in a tick");
    }
}
