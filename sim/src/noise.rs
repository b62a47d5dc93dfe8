//! Counter-based random numbers: each is a function of (seed, tick, channel), so a lost message or a restart shifts none.

use shared_types::random::mix;

/// Uniform in the open interval (0, 1), from the top 52 bits: with one more, the last value would round to 1.
fn unit(bits: u64) -> f64 {
    ((bits >> 12) as f64 + 0.5) * (1.0 / (1u64 << 52) as f64)
}

/// A standard normal number for (seed, tick, channel).
///
/// z = √(−2 ln u₁)·cos 2πu₂                     [Box & Muller 1958]
///
/// Ensures finite, |z| < 8.6; the same on every machine (libm). Independent between any two different arguments, for
/// all that matters to a simulation.
#[must_use]
pub fn gaussian(seed: u64, tick: u64, channel: u64) -> f64 {
    let key = mix(mix(mix(seed) ^ tick) ^ channel);
    let (u_1, u_2) = (unit(mix(key)), unit(mix(key ^ 0x5851_f42d_4c95_7f2d)));
    (-2.0 * libm::log(u_1)).sqrt() * libm::cos(std::f64::consts::TAU * u_2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_the_standard_normal() {
        let n = 200_000u64;
        let sum = |power: i32| (0..n).map(|tick| gaussian(7, tick, 2).powi(power)).sum::<f64>() / n as f64;
        // Standard errors: 1/√n, √(2/n), √(15/n), √(96/n); five of them each.
        let root = (n as f64).sqrt();
        assert!(sum(1).abs() < 5.0 / root, "mean {}", sum(1));
        assert!((sum(2) - 1.0).abs() < 5.0 * 2f64.sqrt() / root, "variance {}", sum(2));
        assert!(sum(3).abs() < 5.0 * 15f64.sqrt() / root, "third moment {}", sum(3));
        assert!((sum(4) - 3.0).abs() < 5.0 * 96f64.sqrt() / root, "fourth moment {}", sum(4));
    }

    #[test]
    fn neighbouring_arguments_are_uncorrelated() {
        let n = 100_000u64;
        let correlation = |f: fn(u64) -> (f64, f64)| (0..n).map(f).map(|(a, b)| a * b).sum::<f64>() / n as f64;
        let bound = 5.0 / (n as f64).sqrt();
        assert!(correlation(|t| (gaussian(1, t, 0), gaussian(1, t + 1, 0))).abs() < bound, "ticks");
        assert!(correlation(|t| (gaussian(1, t, 0), gaussian(1, t, 1))).abs() < bound, "channels");
        assert!(correlation(|t| (gaussian(1, t, 0), gaussian(2, t, 0))).abs() < bound, "seeds");
    }

    #[test]
    fn a_number_does_not_depend_on_what_was_asked_before() {
        let forwards: Vec<f64> = (0..100).map(|t| gaussian(3, t, 5)).collect();
        let backwards: Vec<f64> = (0..100).rev().map(|t| gaussian(3, t, 5)).collect();
        assert!(forwards.iter().eq(backwards.iter().rev()));
        assert!(forwards.iter().all(|z| z.is_finite()));
    }

    #[test]
    fn the_extremes_of_the_uniform_grid_stay_inside() {
        assert!(unit(0) > 0.0 && unit(u64::MAX) < 1.0);
    }
}
