//! Kinematics carried from the end-effector frame E to another point of the same link: the wrist centre C.

use crate::linear::{Jacobian, Matrix3, Vector3, Vector6, angular, displaced, linear, stack};
use model::{Pose, Terms};

/// Jacobian and its rate at a point C fixed to the link that carries E; base axes.
#[derive(Clone, Copy, Debug)]
pub struct AtCentre<const N: usize> {
    /// Position of C in B, m.
    pub p: Vector3,
    /// 6×N, rows [v; ω] of C.
    pub J: Jacobian<N>,
    /// Acceleration [v̇; ω̇] of C at q̈ = 0.
    pub Jdot_qdot: Vector6,
}

impl<const N: usize> AtCentre<N> {
    /// v_C = v_E + ω×r, v̇_C = v̇_E + ω̇×r + ω×(ω×r), with r = p_C − p_E.
    ///
    /// Requires C fixed to E's link, the last one.
    #[inline]
    pub fn new(terms: &Terms<N>, p_BC: &Vector3) -> Self {
        let (r, omega) = (p_BC - terms.X_BE.p, &terms.omega[N - 1]);
        let (mut J, mut Jdot_qdot) = (terms.J, terms.Jdot_qdot);
        if r != Vector3::zeros() {
            J = displaced(J, &r);
            let a =
                linear(&Jdot_qdot) + angular(&Jdot_qdot).cross(&r) + omega.cross(&omega.cross(&r));
            Jdot_qdot = stack(&a, &angular(&Jdot_qdot));
        }
        Self {
            p: *p_BC,
            J,
            Jdot_qdot,
        }
    }
}

/// A pose with its twist and acceleration, at some point of the end-effector link; base axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseMotion {
    /// Rotation.
    pub R: Matrix3,
    /// Position, m.
    pub p: Vector3,
    /// Twist [v; ω].
    pub V: Vector6,
    /// Acceleration [v̇; ω̇].
    pub a: Vector6,
}

impl PoseMotion {
    /// Its pose.
    #[inline]
    pub fn pose(&self) -> Pose {
        let (R, p) = (self.R, self.p);
        Pose { R, p }
    }

    /// At rest in `X`.
    pub fn rest(X: &Pose) -> Self {
        Self {
            R: X.R,
            p: X.p,
            V: Vector6::zeros(),
            a: Vector6::zeros(),
        }
    }

    /// The same motion of the body, seen at the point `p_E` (coordinates in the body's own axes).
    #[inline]
    pub fn at(&self, p_E: &Vector3) -> Self {
        let r = self.R * p_E;
        let (w, alpha) = (angular(&self.V), angular(&self.a));
        Self {
            R: self.R,
            p: self.p + r,
            V: stack(&(linear(&self.V) + w.cross(&r)), &w),
            a: stack(
                &(linear(&self.a) + alpha.cross(&r) + w.cross(&w.cross(&r))),
                &alpha,
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{posture, puma, robot};
    use model::Model;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_tools_kinematics_carried_to_the_wrist_are_the_wrists(q in posture(puma()), qdot in prop::array::uniform6(-1.0..1.0)) {
            let qdot = qdot.into();
            let X_ET = Pose::translation(Vector3::new(0.03, -0.02, 0.1));
            let tool = Model::<6>::new(robot("puma560"), None).unwrap().with_tool(&X_ET).evaluate(&q, &qdot);
            let wrist = puma().evaluate(&q, &qdot);
            let carried = AtCentre::new(&tool, &wrist.X_BE.p);
            prop_assert!((carried.J - wrist.J).amax() < 1e-14);
            prop_assert!((carried.Jdot_qdot - wrist.Jdot_qdot).amax() < 1e-13);
        }
    }
}
