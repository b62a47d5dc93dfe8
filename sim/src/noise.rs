//! Counter-based random numbers: each is a function of (seed, tick, channel), so a lost message or a restart shifts none.

use shared_types::random::mix;
use std::f64::consts::TAU;

/// Uniform in the open interval (0, 1), from the top 52 bits: with one more, the last value would round to 1.
fn unit(bits: u64) -> f64 {
    // A number in [1, 2) has those bits as its fraction; both sums are exact.
    (f64::from_bits((bits >> 12) | 1.0_f64.to_bits()) - 1.0) + 0.5 * f64::EPSILON
}

/// Standard normal numbers for (seed, tick, channel), channels 0 to K − 1.
///
/// z = √(−2 ln u₁)·cos 2πu₂                     [Box & Muller 1958]
///
/// Ensures finite, |z| < 8.6; the same on every machine. Independent between any two different arguments, for all that matters to a simulation.
pub fn gaussians<const K: usize>(seed: u64, tick: u64) -> [f64; K] {
    let of_tick = mix(mix(seed) ^ tick);
    let keys: [u64; K] = std::array::from_fn(|channel| mix(of_tick ^ channel as u64));
    let (_, cos) = model::sincos(&keys.map(|key| TAU * unit(mix(key ^ 0x5851_f42d_4c95_7f2d))));
    std::array::from_fn(|i| (-2.0 * libm::log(unit(mix(keys[i])))).sqrt() * cos[i])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_the_standard_normal() {
        let n = 200_000u64;
        let root = (n as f64).sqrt();
        // Five standard errors each: 1/√n, √(2/n), √(15/n), √(96/n).
        for (power, moment, variance) in
            [(1, 0.0, 1.0), (2, 1.0, 2.0), (3, 0.0, 15.0), (4, 3.0, 96.0)]
        {
            let sum: f64 = (0..n)
                .map(|tick| gaussians::<3>(7, tick)[2].powi(power))
                .sum();
            let error = (sum / n as f64 - moment).abs();
            assert!(
                error < 5.0 * f64::sqrt(variance) / root,
                "moment {power}: off by {error}"
            );
        }
    }

    #[test]
    fn neighbouring_arguments_are_uncorrelated() {
        let n = 100_000u64;
        for (what, [seed, tick], channel) in [
            ("ticks", [0, 1], 0),
            ("channels", [0, 0], 1),
            ("seeds", [1, 0], 0),
        ] {
            let product =
                |t: u64| gaussians::<1>(1, t)[0] * gaussians::<2>(1 + seed, t + tick)[channel];
            let correlation = (0..n).map(product).sum::<f64>() / n as f64;
            assert!(
                correlation.abs() < 5.0 / (n as f64).sqrt(),
                "{what}: {correlation}"
            );
        }
    }

    #[test]
    fn the_extremes_of_the_uniform_grid_stay_inside() {
        assert!(unit(0) > 0.0 && unit(u64::MAX) < 1.0);
    }
}
