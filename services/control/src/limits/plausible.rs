//! Estimates that no arm can have moved to: beyond what its speed and torque limits allow (+).

use crate::linear::Joints;
use crate::paper::operational_space::Cholesky;
use model::{Model, Terms};

/// Time after which a state that stays implausible is refused, s: longer than the estimator sets readings aside, shorter than an arm takes to fall far.
pub(crate) const REJECTION_S: f64 = 0.2;

/// A joint moves with at most so many times its speed limit.
const SPEED: f64 = 2.0;

/// Error of the estimated position that is no motion, rad.
const POSITION_NOISE: f64 = 0.02;

/// Error of the estimated velocity that is no acceleration, as a share of the speed limit: that of a difference of two readings.
const VELOCITY_NOISE: f64 = 0.25;

/// Speed limit where there is none, rad/s.
const FAST: f64 = 10.0;

/// The last plausible state, carried on to rest while the estimate is set aside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Plausible<const N: usize> {
    /// Whether there has been one.
    pub(crate) known: bool,
    /// Ticks in a row for which the estimate has been set aside.
    pub(crate) rejected_ticks: u32,
    /// rad.
    pub(crate) q: Joints<N>,
    /// rad/s.
    pub(crate) qdot: Joints<N>,
}

impl<const N: usize> Plausible<N> {
    /// Before the first tick.
    pub(crate) fn unknown() -> Self {
        Self {
            known: false,
            rejected_ticks: 0,
            q: Joints::zeros(),
            qdot: Joints::zeros(),
        }
    }

    /// Takes the estimate where it is plausible; returns whether it is.
    ///
    /// With k ticks of rejected estimates before: |Δq_i| ≤ 2·q̇_max·(1 + k)·dt + 0.02 rad, and |q̇_i| grows by at most a quarter of its limit plus
    /// (1 + k)·dt·Σ_j |A⁻¹_ij|·(τ_max,j + |g_j|). A speed that falls is always plausible: stops and floors take any of it.
    ///
    /// Shapes N · Units rad, rad/s · Requires finite numbers · Ensures that a lasting change of place is accepted after the time an arm takes to get
    /// there · Cost O(N), and O(N³) for a velocity that changes by more than a quarter of its limit; no allocation
    pub(crate) fn take(
        &mut self,
        q: &Joints<N>,
        qdot: &Joints<N>,
        terms: &Terms<N>,
        model: &Model<N>,
        dt: f64,
    ) -> bool {
        let passed_s = (1.0 + f64::from(self.rejected_ticks)) * dt;
        let is_near = |i: usize| {
            (q[i] - self.q[i]).abs() <= SPEED * model.velocity()[i] * passed_s + POSITION_NOISE
        };
        let is_plausible =
            !self.known || (0..N).all(is_near) && self.reaches(qdot, terms, model, passed_s);
        if is_plausible {
            *self = Self {
                known: true,
                rejected_ticks: 0,
                q: *q,
                qdot: *qdot,
            };
        } else {
            self.rejected_ticks = self.rejected_ticks.saturating_add(1);
        }
        is_plausible
    }

    fn reaches(&self, qdot: &Joints<N>, terms: &Terms<N>, model: &Model<N>, passed_s: f64) -> bool {
        let beyond = Joints::<N>::from_fn(|i, _| {
            let limit = model.velocity()[i];
            let fast = if limit.is_finite() { limit } else { FAST };
            qdot[i].abs() - self.qdot[i].abs() - VELOCITY_NOISE * fast
        });
        if beyond.iter().all(|x| *x <= 0.0) {
            return true;
        }
        let Ok(A) = Cholesky::new(terms.A) else {
            return false;
        };
        let mut most = Joints::<N>::zeros();
        for j in 0..N {
            let mut push = Joints::zeros();
            push[j] = model.effort()[j] + terms.gravity[j].abs();
            most += A.solve(&push).abs();
        }
        (0..N).all(|i| beyond[i] <= 0.0 || beyond[i] <= most[i] * passed_s)
    }

    /// One tick of the motion of an arm that is damped by `damping`, 1/s.
    pub(crate) fn come_to_rest(&mut self, damping: f64, dt: f64) {
        self.q += self.qdot * dt;
        self.qdot *= libm::exp(-damping * dt);
    }
}
