//! The arm's smooth dynamics and their exact integration.

use crate::surface::Surfaces;
use model::{ArmMotion, Model};
use nalgebra::{SVector, Vector6};

/// Where the joints are and how they move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State<const N: usize> {
    /// Joint positions; rad.
    pub q: SVector<f64, N>,
    /// Joint velocities; rad/s.
    pub qdot: SVector<f64, N>,
}

impl<const N: usize> State<N> {
    /// At rest at `q`.
    pub fn at_rest(q: SVector<f64, N>) -> Self {
        Self {
            q,
            qdot: SVector::zeros(),
        }
    }

    /// Whether every number is finite, and the energy is one too.
    pub fn is_finite(&self) -> bool {
        self.q.iter().all(|x| x.is_finite()) && self.qdot.iter().all(|x| x.abs() < FASTEST)
    }
}

/// Longest step of [`Smooth::advance`]; s.
const LONGEST_S: f64 = 1e-3;

/// Longest step near a surface; s.
const CONTACT_S: f64 = 1e-4;

/// Speed at which motion counts as diverged: its square, and with it the energy, is a number still; rad/s.
const FASTEST: f64 = 1e100;

/// Everything about the arm that is a smooth function of its state: A·q̈ + C·q̇ + g + b∘q̇ = τ + JᵀF, F of the surfaces.
#[derive(Clone, Debug)]
pub(crate) struct Smooth<const N: usize> {
    pub(crate) model: Model<N>,
    /// Viscous friction b; N·m·s/rad. Zero where the scenario has no friction.
    pub(crate) viscous: SVector<f64, N>,
    pub(crate) surfaces: Surfaces,
}

impl<const N: usize> Smooth<N> {
    /// Joint torque less viscous friction, and that of the surfaces; N·m.
    pub(crate) fn driving(
        &self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        tau: &SVector<f64, N>,
    ) -> SVector<f64, N> {
        let driving = tau - self.viscous.component_mul(qdot);
        match self.surfaces.torque(&self.model, q, qdot) {
            Some(pressed) => driving + pressed,
            None => driving,
        }
    }

    /// Wrench of the surfaces on the hand that moves so, about E, base axes, N and N·m, and their number.
    pub(crate) fn pressed(&self, motion: &ArmMotion<N>) -> (Vector6<f64>, u32) {
        self.surfaces.wrench(&motion.X_BE, &motion.V_BE)
    }

    /// Everything about the arm in the state `x`.
    pub(crate) fn motion(&self, x: &State<N>) -> ArmMotion<N> {
        self.model.motion(&x.q, &x.qdot)
    }

    /// How far joint i is beyond a limit (rad, negative inside), and the sign of the way back.
    pub(crate) fn beyond(&self, x: &State<N>, i: usize) -> (f64, f64) {
        let (lower, upper) = (self.model.lower(), self.model.upper());
        let (low, high) = (lower[i] - x.q[i], x.q[i] - upper[i]);
        if low > high { (low, 1.0) } else { (high, -1.0) }
    }

    fn qddot(
        &self,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
        tau: &SVector<f64, N>,
    ) -> SVector<f64, N> {
        self.model
            .forward_dynamics(q, qdot, &self.driving(q, qdot, tau))
    }

    /// The state `t` s after `x`, whose motion is `now`, under constant torque: in equal steps of at most [`LONGEST_S`] by [`Model::advance`], or near a
    /// surface of at most [`CONTACT_S`] by [`rk4`](Self::rk4).
    pub(crate) fn advance(
        &self,
        x: &State<N>,
        now: &ArmMotion<N>,
        tau: &SVector<f64, N>,
        t: f64,
    ) -> State<N> {
        if self.surfaces.are_near(&now.X_BE, &now.V_BE, t) {
            let steps = (t / CONTACT_S).ceil();
            return (0..steps as u32).fold(*x, |x, _| self.rk4(&x, tau, t / steps));
        }
        let steps = (t / LONGEST_S).ceil();
        let step = |x: &State<N>, qddot: &SVector<f64, N>| {
            let [q, qdot] =
                self.model
                    .advance(&[x.q, x.qdot], qddot, tau, &self.viscous, t / steps);
            State { q, qdot }
        };
        let first = step(x, &now.qddot(&self.driving(&x.q, &x.qdot, tau)));
        (1..steps as u32).fold(first, |x, _| step(&x, &self.qddot(&x.q, &x.qdot, tau)))
    }

    /// The state after `h` s of constant torque, by the classical Runge–Kutta method of order 4.
    ///
    /// Local error O(h⁵). Cost 4 forward dynamics, no allocation.
    pub(crate) fn rk4(&self, x: &State<N>, tau: &SVector<f64, N>, h: f64) -> State<N> {
        let v_1 = x.qdot;
        let a_1 = self.qddot(&x.q, &v_1, tau);
        let v_2 = x.qdot + a_1 * (h / 2.0);
        let a_2 = self.qddot(&(x.q + v_1 * (h / 2.0)), &v_2, tau);
        let v_3 = x.qdot + a_2 * (h / 2.0);
        let a_3 = self.qddot(&(x.q + v_2 * (h / 2.0)), &v_3, tau);
        let v_4 = x.qdot + a_3 * h;
        let a_4 = self.qddot(&(x.q + v_3 * h), &v_4, tau);
        State {
            q: x.q + (v_1 + (v_2 + v_3) * 2.0 + v_4) * (h / 6.0),
            qdot: x.qdot + (a_1 + (a_2 + a_3) * 2.0 + a_4) * (h / 6.0),
        }
    }
}
