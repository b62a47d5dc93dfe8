//! Joint encoders: noise, then quantisation.

use crate::noise::gaussian;
use model::{JointKind, Robot};
use nalgebra::SVector;

/// The joint encoders of an arm.
///
/// reading = r·round(q/r + σ·z), with r = 2π/2^bits for a turning joint and 1 m/2^bits for a sliding one,
/// σ in counts and z standard normal, a function of (seed, tick, joint) alone.
///
/// An encoder of 0 bits is ideal: it reads q exactly, without noise (a count has no size then).
#[derive(Clone, Copy, Debug)]
pub struct Encoders<const N: usize> {
    /// Size of a count; rad (m for a sliding joint). 0: ideal.
    resolution: SVector<f64, N>,
    noise_counts: f64,
    seed: u64,
}

impl<const N: usize> Encoders<N> {
    /// Encoders of `bits` per turn with noise of standard deviation `noise_counts`.
    ///
    /// Requires robot.dof() ≤ N and bits < 53; the places of absent joints are ideal.
    #[must_use]
    pub fn new(robot: &Robot, bits: u32, noise_counts: f64, seed: u64) -> Self {
        let resolution = SVector::from_fn(|i, _| match robot.joints.get(i).map(|joint| joint.kind) {
            _ if bits == 0 => 0.0,
            None => 0.0,
            Some(JointKind::Prismatic) => 1.0 / (1u64 << bits) as f64,
            Some(JointKind::Revolute | JointKind::Continuous) => std::f64::consts::TAU / (1u64 << bits) as f64,
        });
        Self { resolution, noise_counts, seed }
    }

    /// The encoders' readings at `tick` with the joints at `q`; rad. A pure function of both.
    #[must_use]
    pub fn read(&self, tick: u64, q: &SVector<f64, N>) -> SVector<f64, N> {
        SVector::from_fn(|i, _| {
            let r = self.resolution[i];
            if r == 0.0 {
                return q[i];
            }
            let noise = if self.noise_counts == 0.0 { 0.0 } else { self.noise_counts * gaussian(self.seed, tick, i as u64) };
            r * (q[i] / r + noise).round()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::LazyLock;

    static ROBOT: LazyLock<Robot> = LazyLock::new(|| Robot::builtin("puma560").unwrap());

    fn encoders(bits: u32, noise_counts: f64) -> Encoders<6> {
        Encoders::new(&ROBOT, bits, noise_counts, 11)
    }

    #[test]
    fn without_noise_the_error_is_at_most_half_a_count() {
        let count = std::f64::consts::TAU / 65536.0;
        for k in 0..1000 {
            let q = SVector::from_fn(|i, _| (k * 6 + i) as f64 * 1.618e-3 - 3.0);
            let reading = encoders(16, 0.0).read(k as u64, &q);
            assert!((reading - q).amax() <= 0.5 * count * (1.0 + 1e-9));
            assert!(reading.iter().all(|x| (x / count - (x / count).round()).abs() < 1e-9), "on the grid");
        }
    }

    #[test]
    fn noise_has_the_standard_deviation_asked_for() {
        let count = std::f64::consts::TAU / 65536.0;
        let q = SVector::repeat(0.3);
        let n = 20_000;
        let square: f64 = (0..n).map(|t| ((encoders(16, 3.0).read(t, &q) - q) / count).norm_squared()).sum();
        let variance = square / (6 * n) as f64;
        // σ² and the variance of rounding; the standard error of a variance is √(2/n) of it.
        let expected = 9.0 + 1.0 / 12.0;
        assert!((variance - expected).abs() < 5.0 * expected * (2.0 / (6 * n) as f64).sqrt(), "variance {variance}");
    }

    #[test]
    fn zero_bits_are_ideal() {
        let q = SVector::from_fn(|i, _| 0.1 + i as f64 / 7.0);
        assert_eq!(encoders(0, 0.5).read(9, &q), q);
    }

    #[test]
    fn joints_and_ticks_have_their_own_noise() {
        let reading = encoders(16, 50.0).read(4, &SVector::zeros());
        assert!((1..6).all(|i| reading[i] != reading[0]));
        assert_ne!(encoders(16, 50.0).read(5, &SVector::zeros()), reading);
    }
}
