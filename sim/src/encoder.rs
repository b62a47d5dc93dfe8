//! Joint encoders: noise, then quantisation.

use crate::noise::gaussians;
use model::{JointKind, Robot};
use nalgebra::SVector;

/// Farther from the drives' own sensors than this no reading is taken for a position; rad, and for a sliding joint m. More than a reading drifts
/// while its arm still reaches its goal, and so little that a drive at full torque has not become fast by then.
const CONTRADICTION: (f64, f64) = (0.03, 0.01);

/// The same of coarse or noisy encoders, in counts, and in standard deviations of their noise: a reading in 10¹⁵ is that far off.
const UNLIKELY: (f64, f64) = (1.0, 8.0);

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
    /// Error that neither noise nor a small fault explains; rad (m for a sliding joint).
    tolerance: SVector<f64, N>,
    seed: u64,
}

impl<const N: usize> Encoders<N> {
    /// Encoders of `bits` per turn with noise of standard deviation `noise_counts`.
    ///
    /// Requires robot.dof() ≤ N and bits < 53; the places of absent joints are ideal.
    pub fn new(robot: &Robot, bits: u32, noise_counts: f64, seed: u64) -> Self {
        let slides = |i: usize| robot.joints.get(i).map(|j| j.kind == JointKind::Prismatic);
        let resolution = SVector::from_fn(|i, _| match slides(i) {
            Some(slides) if bits > 0 => {
                let turn = if slides { 1.0 } else { std::f64::consts::TAU };
                turn / (1u64 << bits) as f64
            }
            _ => 0.0,
        });
        let tolerance = SVector::from_fn(|i, _| {
            let least = if slides(i) == Some(true) {
                CONTRADICTION.1
            } else {
                CONTRADICTION.0
            };
            least.max(resolution[i] * (UNLIKELY.0 + UNLIKELY.1 * noise_counts))
        });
        Self {
            resolution,
            noise_counts,
            tolerance,
            seed,
        }
    }

    /// The farthest that a reading may be from the drives' own sensors; rad (m for a sliding joint).
    pub fn tolerance(&self) -> &SVector<f64, N> {
        &self.tolerance
    }

    /// Whether a reading is that of joints at `q`, as far as the drives can tell by their own sensors: |reading − q| within 0.03 rad (0.01 m for a sliding
    /// joint), or within a count and eight standard deviations of the noise where that is more.
    pub fn agrees(&self, reading: &SVector<f64, N>, q: &SVector<f64, N>) -> bool {
        (0..N).all(|i| (reading[i] - q[i]).abs() <= self.tolerance[i])
    }

    /// The encoders' readings at `tick` with the joints at `q`; rad. A pure function of both.
    pub fn read(&self, tick: u64, q: &SVector<f64, N>) -> SVector<f64, N> {
        let noise = match self.noise_counts {
            0.0 => [0.0; N],
            sigma => gaussians(self.seed, tick).map(|z| sigma * z),
        };
        SVector::from_fn(|i, _| match self.resolution[i] {
            0.0 => q[i],
            r => r * (q[i] / r + noise[i]).round(),
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

    const COUNT: f64 = std::f64::consts::TAU / 65536.0;

    /// Joints somewhere else at each tick.
    fn posture(tick: u64) -> SVector<f64, 6> {
        SVector::from_fn(|i, _| (tick * 6 + i as u64) as f64 * 1.618e-3 - 3.0)
    }

    #[test]
    fn without_noise_the_error_is_at_most_half_a_count_and_zero_bits_are_ideal() {
        for tick in 0..1000 {
            let q = posture(tick);
            let reading = encoders(16, 0.0).read(tick, &q);
            assert!((reading - q).amax() <= 0.5 * COUNT * (1.0 + 1e-9));
            let counts = reading / COUNT;
            assert!(
                (counts - counts.map(f64::round)).amax() < 1e-9,
                "on the grid"
            );
            assert_eq!(encoders(0, 0.5).read(tick, &q), q);
        }
    }

    #[test]
    fn noise_has_the_standard_deviation_asked_for_in_each_joint_and_tick() {
        let q = SVector::repeat(0.3);
        let n = 20_000;
        let square: f64 = (0..n)
            .map(|t| ((encoders(16, 3.0).read(t, &q) - q) / COUNT).norm_squared())
            .sum();
        let variance = square / (6 * n) as f64;
        // σ² and the variance of rounding; the standard error of a variance is √(2/n) of it.
        let expected = 9.0 + 1.0 / 12.0;
        let error = (variance - expected).abs();
        assert!(
            error < 5.0 * expected * (2.0 / (6 * n) as f64).sqrt(),
            "variance {variance}"
        );
        let reading = encoders(16, 50.0).read(4, &SVector::zeros());
        assert!((1..6).all(|i| reading[i] != reading[0]));
        assert_ne!(encoders(16, 50.0).read(5, &SVector::zeros()), reading);
    }

    #[test]
    fn noise_agrees_with_the_joints_and_a_frozen_reading_does_not() {
        for (bits, noise, within, beyond) in [
            (16, 0.5, 0.029, 0.031),
            (0, 0.0, 0.029, 0.031),
            (8, 2.0, 0.41, 0.43),
        ] {
            let encoders = encoders(bits, noise);
            let agrees =
                |tick| encoders.agrees(&encoders.read(tick, &posture(tick)), &posture(tick));
            assert!((0..500).all(agrees), "{bits} bits");
            for (away, agrees) in [
                (within, true),
                (-within, true),
                (beyond, false),
                (-beyond, false),
                (f64::NAN, false),
            ] {
                let reading = SVector::from_fn(|i, _| if i == 4 { away } else { 0.0 });
                assert_eq!(
                    encoders.agrees(&reading, &SVector::zeros()),
                    agrees,
                    "{away}"
                );
            }
        }
    }
}
