//! The governor: the path's clock slows down so that no joint exceeds its limits (+).
//!
//! Reduces to the paper's law: at a demand below 0.95 the clock runs at exactly 1 (proof: `a_feasible_path_runs_at_full_clock_speed`).

use super::foresight::{FORESEEN_STEP_S, Foreseen};
use nalgebra::SVector;

/// Slowest clock.
const SLOWEST: f64 = 0.05;
/// Share of a limit that the path may take.
pub const MARGIN: f64 = 0.95;
/// Time constants, s.
const DOWN: f64 = 0.020;
const UP: f64 = 0.080;
/// Time constant of the clock's own acceleration, s: a step in it would be a step in torque.
const SMOOTH: f64 = 0.008;
/// How far a rising demand is extrapolated, s: about as long as the clock takes to come down.
const LEAD: f64 = 0.060;
/// Share of the torque limits that changing the clock's speed may take.
const BRAKE: f64 = 0.35;
/// Share of that with which braking ahead is planned.
const PLANNED: f64 = 0.5;

/// Demand of the path at full clock speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load<const N: usize> {
    /// Largest share of a joint's speed, or of an auxiliary rate, at full clock speed.
    pub speed: f64,
    /// Torque that holds the arm, N·m.
    pub holding: SVector<f64, N>,
    /// Torque that follows the path at full clock speed, without what holds the arm, N·m: it goes with the clock's speed squared.
    pub following: SVector<f64, N>,
    /// Torque per change of the clock's speed, N·m·s.
    pub braking: SVector<f64, N>,
    /// Shares of rate limits on the path ahead.
    pub foreseen: Foreseen,
    /// Fastest clock that the path plan allows, up to 1.
    pub planned: f64,
}

/// The clock's speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Governor {
    /// Speed of the path's clock against real time, 0.05 to 1.
    pub rate: f64,
    /// Its change, 1/s.
    pub rate_dot: f64,
    /// Demand at the tick before.
    pub demand: f64,
}

impl Default for Governor {
    fn default() -> Self {
        Self {
            rate: 1.0,
            rate_dot: 0.0,
            demand: 0.0,
        }
    }
}

impl Governor {
    /// Slows down as fast as an arm does that is damped by `damping`, 1/s: the path waits for it.
    pub fn slow_down(&mut self, damping: f64, dt: f64) {
        self.rate = (self.rate * libm::exp(-damping * dt)).max(SLOWEST);
        self.rate_dot = 0.0;
    }

    /// Moves towards 0.95/demand within [0.05, 1], in 20 ms down, in 80 ms up, as fast as a share of the torque allows.
    ///
    /// The clock's change is known, so it is fed forward. Speed goes with the clock, torque beyond holding with its square; a rising demand is
    /// extrapolated over the time that slowing down takes, and a demand that is foreseen ahead is braked for in time.
    ///
    /// Units `limits` N·m, `dt` s · Ensures 0.05 ≤ rate ≤ 1 and |rate_dot| within the share of torque that braking may take; rate = 1 exactly while the
    /// demand stays below 0.95 · Errors none · Cost O(N), no allocation
    pub fn step<const N: usize>(&mut self, load: &Load<N>, limits: &SVector<f64, N>, dt: f64) {
        let mut demand = load.speed;
        let mut hardest = 1e3_f64;
        for i in 0..N {
            // |holding + r²·following| ≤ 0.95·limit, at least a quarter of it left for following.
            let room = (MARGIN * limits[i] - load.holding[i].abs()).max(0.25 * limits[i]);
            demand = demand.max(MARGIN * (load.following[i].abs() / room).sqrt());
            hardest = hardest.min(BRAKE * limits[i] / load.braking[i].abs().max(1e-9));
        }
        let rising = ((demand - self.demand) / dt).max(0.0);
        self.demand = demand;
        let mut target = MARGIN / (demand + LEAD * rising).max(1e-9);
        // Braking at `hardest`, r² falls by 2·hardest per second of the path's clock.
        for (k, share) in load
            .foreseen
            .demand
            .iter()
            .enumerate()
            .filter(|(_, share)| **share != 0.0)
        {
            let there = MARGIN / share.max(1e-9);
            target = target
                .min((there * there + 2.0 * PLANNED * hardest * k as f64 * FORESEEN_STEP_S).sqrt());
        }
        // The plan knows of places that need a slower clock than any demand measured so far.
        let slowest = SLOWEST.min(load.planned);
        let target = target.max(SLOWEST).min(load.planned);
        let lag = if target < self.rate { DOWN } else { UP };
        let wanted = ((target - self.rate) / lag).clamp(-hardest, hardest);
        self.rate_dot += (wanted - self.rate_dot) * dt / (SMOOTH + dt);
        let next = (self.rate + self.rate_dot * dt).clamp(slowest.min(self.rate), 1.0);
        self.rate_dot = (next - self.rate) / dt;
        self.rate = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector1;

    fn load(speed: f64, following: f64) -> Load<1> {
        Load {
            speed,
            holding: Vector1::new(2.0),
            following: Vector1::new(following),
            braking: Vector1::new(0.1),
            foreseen: Foreseen::default(),
            planned: 1.0,
        }
    }

    #[test]
    fn the_clock_follows_the_demand_and_recovers() {
        let limits = Vector1::new(10.0);
        let mut governor = Governor::default();
        (0..300).for_each(|_| governor.step(&load(1.9, 0.0), &limits, 1e-3));
        assert!((governor.rate - 0.5).abs() < 1e-3);
        (0..300).for_each(|_| governor.step(&load(0.0, 30.0), &limits, 1e-3));
        assert!(
            2.0 + 30.0 * governor.rate * governor.rate < 9.6,
            "torque within the limit at rate {}",
            governor.rate
        );
        (0..1000).for_each(|_| governor.step(&load(1e9, 0.0), &limits, 1e-3));
        assert!((governor.rate - SLOWEST).abs() < 1e-3);
        (0..1000).for_each(|_| governor.step(&load(0.0, 0.0), &limits, 1e-3));
        assert!((governor.rate - 1.0).abs() < 1e-3);
    }

    #[test]
    fn the_clock_never_brakes_harder_than_the_torque_allows() {
        let (limits, heavy) = (
            Vector1::new(10.0),
            Load {
                braking: Vector1::new(2.0),
                ..load(10.0, 0.0)
            },
        );
        let mut governor = Governor::default();
        for _ in 0..500 {
            governor.step(&heavy, &limits, 1e-3);
            assert!(governor.rate_dot.abs() <= 0.35 * 10.0 / 2.0 + 1e-9);
        }
    }
}
