//! The governor: the path's clock slows down so that no joint is asked for more than it has (+).

/// Slowest clock.
const SLOWEST: f64 = 0.05;
/// Share of a limit that is used.
const MARGIN: f64 = 0.95;
/// Time constants, s.
const DOWN: f64 = 0.020;
const UP: f64 = 0.080;

/// The clock's speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Governor {
    /// Speed of the path's clock against real time, 0.05 to 1.
    pub rate: f64,
    /// Its change, 1/s.
    pub rate_dot: f64,
}

impl Default for Governor {
    fn default() -> Self {
        Self { rate: 1.0, rate_dot: 0.0 }
    }
}

impl Governor {
    /// Moves towards 0.95/demand within [0.05, 1], in 20 ms down, in 80 ms up; the clock's change is known, so it is fed forward.
    ///
    /// `demand` is the largest share of any limit (joint speed, joint torque, auxiliary rate) that the path would take at full clock speed.
    pub fn step(&mut self, demand: f64, dt: f64) {
        let target = (MARGIN / demand.max(1e-9)).clamp(SLOWEST, 1.0);
        let lag = if target < self.rate { DOWN } else { UP };
        self.rate_dot = (target - self.rate) / (lag + dt);
        self.rate += self.rate_dot * dt;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_clock_follows_the_demand_and_recovers() {
        let mut governor = Governor::default();
        (0..200).for_each(|_| governor.step(1.9, 1e-3));
        assert!((governor.rate - 0.5).abs() < 1e-3);
        (0..1000).for_each(|_| governor.step(1e9, 1e-3));
        assert!((governor.rate - SLOWEST).abs() < 1e-3);
        (0..1000).for_each(|_| governor.step(0.0, 1e-3));
        assert!((governor.rate - 1.0).abs() < 1e-3);
    }
}
