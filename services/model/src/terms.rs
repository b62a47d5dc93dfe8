//! All terms of the equation of motion and of the end-effector's kinematics.

use crate::arm::Model;
use crate::pose::Pose;
use crate::spatial::ORIGIN;
use nalgebra::{SMatrix, SVector, Vector3, Vector6};

/// Everything a controller needs of the arm in one state, from one pass.
///
/// Base axes and SI units throughout. The equation of motion is A·q̈ + coriolis + gravity = τ.
#[derive(Clone, Debug, PartialEq)]
pub struct Terms<const N: usize> {
    /// Mass matrix, armature included, N×N.
    pub A: SMatrix<f64, N, N>,
    /// Coriolis and centrifugal torques C(q, q̇)·q̇.
    pub coriolis: SVector<f64, N>,
    /// Gravity torques g(q): the torques that hold the arm still.
    pub gravity: SVector<f64, N>,
    /// Geometric Jacobian at E's origin, rows [v; ω], 6×N.
    pub J: SMatrix<f64, 6, N>,
    /// J̇·q̇: the acceleration [v̇; ω̇] of E at q̈ = 0.
    pub Jdot_qdot: Vector6<f64>,
    /// Pose of E in the base.
    pub X_BE: Pose,
    /// Joint axes, unit.
    pub z: [Vector3<f64>; N],
    /// Joint (link) origins, m.
    pub p: [Vector3<f64>; N],
    /// Link angular velocities, rad/s.
    pub omega: [Vector3<f64>; N],
    /// Link angular accelerations at q̈ = 0, rad/s².
    pub alpha_bias: [Vector3<f64>; N],
    /// Velocities of the link origins, m/s.
    pub pdot: [Vector3<f64>; N],
    /// Accelerations of the link origins at q̈ = 0, m/s².
    pub pddot_bias: [Vector3<f64>; N],
}

impl<const N: usize> Terms<N> {
    /// A place for terms.
    #[inline(always)]
    pub(crate) fn zero() -> Self {
        Self {
            A: SMatrix::zeros(),
            coriolis: SVector::zeros(),
            gravity: SVector::zeros(),
            J: SMatrix::zeros(),
            Jdot_qdot: Vector6::zeros(),
            X_BE: Pose::identity(),
            z: [ORIGIN; N],
            p: [ORIGIN; N],
            omega: [ORIGIN; N],
            alpha_bias: [ORIGIN; N],
            pdot: [ORIGIN; N],
            pddot_bias: [ORIGIN; N],
        }
    }

    /// C·q̇ + g.
    pub fn bias(&self) -> SVector<f64, N> {
        self.coriolis + self.gravity
    }
}

/// The terms of the posture and velocity asked for last: not computed again where they are asked for again, to the bit.
#[derive(Clone, Debug)]
pub struct LastTerms<const N: usize> {
    q: SVector<f64, N>,
    qdot: SVector<f64, N>,
    terms: Terms<N>,
}

impl<const N: usize> LastTerms<N> {
    /// Those of an arm at rest at zero.
    #[must_use]
    pub fn of(model: &Model<N>) -> Self {
        let zero = SVector::zeros();
        Self {
            q: zero,
            qdot: zero,
            terms: model.evaluate(&zero, &zero),
        }
    }

    /// The terms at `q`, `qdot`. Requires the same `model` each time.
    #[inline]
    pub fn at(
        &mut self,
        model: &Model<N>,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
    ) -> &Terms<N> {
        let is = |a: &SVector<f64, N>, b: &SVector<f64, N>| {
            (0..N).all(|i| a[i].to_bits() == b[i].to_bits())
        };
        if !(is(&self.q, q) && is(&self.qdot, qdot)) {
            (self.q, self.qdot) = (*q, *qdot);
            model.evaluate_into(q, qdot, &mut self.terms);
        }
        &self.terms
    }
}
