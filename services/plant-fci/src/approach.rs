//! Moves to the start posture in joint space, before the first tick. PURE.

use control::quintic;
use model::Model;
use nalgebra::SVector;

use crate::interface::JOINTS;

type Joints = SVector<f64, JOINTS>;

/// Largest joint speed on the way; rad/s.
const SPEED: f64 = 0.4;

/// Shortest time; s.
const SHORTEST_S: f64 = 1.0;

/// Gains per unit of inertia; 1/s², 1/s.
const GAINS: (f64, f64) = (400.0, 40.0);

/// The arm is there within this of each joint, at less than this speed; rad, rad/s.
const THERE: (f64, f64) = (5e-3, 5e-3);

/// Peak of the rate of 10u³ − 15u⁴ + 6u⁵.
const PEAK: f64 = 1.875;

/// A straight line in joint space, quintic in time, then a hold.
#[derive(Clone, Debug)]
pub(crate) struct Approach {
    from: Joints,
    to: Joints,
    duration_s: f64,
}

impl Approach {
    pub(crate) fn new(from: Joints, to: Joints) -> Self {
        Self {
            from,
            to,
            duration_s: (PEAK * (to - from).amax() / SPEED).max(SHORTEST_S),
        }
    }

    /// Planned time; s.
    pub(crate) fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// Torque without gravity that follows the line at time `t_s`; N·m.
    ///
    /// τ = A(q)·(q̈_d + k_v(q̇_d − q̇) + k_p(q_d − q)) + C(q, q̇)q̇
    pub(crate) fn torque(
        &self,
        model: &Model<JOINTS>,
        t_s: f64,
        q: &Joints,
        qdot: &Joints,
    ) -> Joints {
        let (by, [place, rate, change]) = (self.to - self.from, quintic(t_s, self.duration_s));
        let (q_d, qdot_d) = (self.from + by * place, by * rate);
        let wanted = by * change + (qdot_d - qdot) * GAINS.1 + (q_d - q) * GAINS.0;
        model.mass_matrix(q) * wanted + model.bias(q, qdot) - model.gravity(q)
    }

    /// Torque without gravity that keeps the arm at `at`; N·m.
    pub(crate) fn hold(model: &Model<JOINTS>, at: &Joints, q: &Joints, qdot: &Joints) -> Joints {
        model.mass_matrix(q) * ((at - q) * GAINS.0 - qdot * GAINS.1)
    }

    /// Whether the arm rests at the end.
    pub(crate) fn is_there(&self, q: &Joints, qdot: &Joints) -> bool {
        (self.to - q).amax() < THERE.0 && qdot.amax() < THERE.1
    }

    /// The joint that is furthest off, from 1, and by how much; rad.
    pub(crate) fn furthest(&self, q: &Joints) -> (usize, f64) {
        let off = (self.to - q).abs();
        (off.imax() + 1, off.amax())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model::Robot;

    #[test]
    fn the_line_arrives_within_its_time_at_its_speed() {
        let model = Model::<JOINTS>::new(&Robot::builtin("fr3").unwrap(), None).unwrap();
        let from = Joints::from([0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.785]);
        let to = Joints::from([0.3, -0.4, 0.2, -2.0, 1.5, 3.3, 0.7]);
        let approach = Approach::new(from, to);
        let (mut q, mut qdot, dt) = (from, Joints::zeros(), 1e-3);
        let (mut fastest, mut last, mut steepest) = (0.0_f64, Joints::zeros(), 0.0_f64);
        let ticks = (approach.duration_s() / dt) as usize + 300;
        for k in 0..ticks {
            let tau = approach.torque(&model, k as f64 * dt, &q, &qdot);
            (steepest, last) = (steepest.max((tau - last).amax()), tau);
            let acceleration = model
                .mass_matrix(&q)
                .cholesky()
                .unwrap()
                .solve(&(tau - (model.bias(&q, &qdot) - model.gravity(&q))));
            qdot += acceleration * dt;
            q += qdot * dt;
            fastest = fastest.max(qdot.amax());
        }
        assert!(
            approach.is_there(&q, &qdot),
            "{:?} off",
            approach.furthest(&q)
        );
        assert!(
            (0.9 * SPEED..1.02 * SPEED).contains(&fastest),
            "{fastest} rad/s"
        );
        assert!(
            steepest < 0.5,
            "the torque changes by {steepest} N·m in a tick"
        );
        let away = Joints::from_fn(|i, _| if i == 3 { to[i] - 0.01 } else { to[i] });
        assert!(Approach::hold(&model, &to, &away, &Joints::zeros())[3] > 1.0);
    }
}
