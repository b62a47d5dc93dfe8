//! Counter-based random numbers: each is a function of (seed, tick, channel), so a lost message or a restart shifts none.

use shared_types::random::mix;

/// Uniform in the open interval (0, 1), from the top 52 bits: with one more, the last value would round to 1.
#[inline(always)]
fn unit(bits: u64) -> f64 {
    // A number in [1, 2) has those bits as its fraction; both sums are exact.
    (f64::from_bits((bits >> 12) | 1.0_f64.to_bits()) - 1.0) + 0.5 * f64::EPSILON
}

/// A standard normal number for (seed, tick, channel).
///
/// z = √(−2 ln u₁)·cos 2πu₂                     [Box & Muller 1958]
///
/// Ensures finite, |z| < 8.6; the same on every machine. Independent between any two different arguments, for all that matters to a simulation.
#[must_use]
pub fn gaussian(seed: u64, tick: u64, channel: u64) -> f64 {
    let [z] = of_channels(seed, tick, [channel]);
    z
}

/// Those of the channels 0 to `N` − 1, all at once.
#[must_use]
pub(crate) fn gaussians<const N: usize>(seed: u64, tick: u64) -> [f64; N] {
    of_channels(seed, tick, std::array::from_fn(|i| i as u64))
}

#[inline(always)]
fn of_channels<const N: usize>(seed: u64, tick: u64, channels: [u64; N]) -> [f64; N] {
    let of_tick = mix(mix(seed) ^ tick);
    let keys = channels.map(|channel| mix(of_tick ^ channel));
    let (bits_1, bits_2) = (
        keys.map(mix),
        keys.map(|key| mix(key ^ 0x5851_f42d_4c95_7f2d)),
    );
    // Apart from the multiplications of integers, and without a branch, so that the compiler makes vectors of it.
    let mut z = [0.0; N];
    for i in 0..N {
        z[i] = (-2.0 * log_of_unit(unit(bits_1[i]))).sqrt() * cos_of_turn(unit(bits_2[i]));
    }
    z
}

/// ln u for 2⁻⁵³ ≤ u < 1, to the bits of libm: its method without the cases that do not come [FreeBSD msun, `e_log.c`].
#[inline(always)]
fn log_of_unit(u: f64) -> f64 {
    const LN_2: [f64; 2] = [
        f64::from_bits(0x3FE6_2E42_FEE0_0000),
        f64::from_bits(0x3DEA_39EF_3579_3C76),
    ];
    const LG: [f64; 7] = [
        f64::from_bits(0x3FE5_5555_5555_5593),
        f64::from_bits(0x3FD9_9999_9997_FA04),
        f64::from_bits(0x3FD2_4924_9422_9359),
        f64::from_bits(0x3FCC_71C5_1D8E_78AF),
        f64::from_bits(0x3FC7_4664_96CB_03DE),
        f64::from_bits(0x3FC3_9A09_D078_C69F),
        f64::from_bits(0x3FC2_F112_DF3E_5244),
    ];
    /// The high half of √½.
    const ROOT: u64 = 0x3FE6_A09E << 32;
    const FRACTION: u64 = (1 << 52) - 1;
    /// 2⁵²: a small whole number in its last bits makes the sum of both.
    const WHOLE: f64 = 1.0 / f64::EPSILON;
    // u = 2ᵏ·(1 + f) with √½ < 1 + f < √2.
    let shifted = u.to_bits() + (1.0_f64.to_bits() - ROOT);
    let k = f64::from_bits((shifted >> 52) | WHOLE.to_bits()) - (WHOLE + 1023.0);
    let f = f64::from_bits((shifted & FRACTION) + ROOT) - 1.0;
    let half_square = 0.5 * f * f;
    let s = f / (2.0 + f);
    let z = s * s;
    let w = z * z;
    let even = w * (LG[1] + w * (LG[3] + w * LG[5]));
    let odd = z * (LG[0] + w * (LG[2] + w * (LG[4] + w * LG[6])));
    s * (half_square + (odd + even)) + k * LN_2[1] - half_square + f + k * LN_2[0]
}

/// cos 2πu for 0 < u < 1, within a unit in the last place, and where it nearly vanishes within 1e-16: libm's method in one step of reduction
/// [FreeBSD msun, `e_rem_pio2.c`, `k_sin.c`, `k_cos.c`].
#[inline(always)]
fn cos_of_turn(u: f64) -> f64 {
    /// Adding this rounds a number to a whole one, which is then in its last bits.
    const ROUND: f64 = 1.5 / f64::EPSILON;
    const HALF_PI: [f64; 2] = [
        f64::from_bits(0x3FF9_21FB_5440_0000),
        f64::from_bits(0x3DD0_B461_1A62_6331),
    ];
    const S: [f64; 6] = [
        f64::from_bits(0xBFC5_5555_5555_5549),
        f64::from_bits(0x3F81_1111_1110_F8A6),
        f64::from_bits(0xBF2A_01A0_19C1_61D5),
        f64::from_bits(0x3EC7_1DE3_57B1_FE7D),
        f64::from_bits(0xBE5A_E5E6_8A2B_9CEB),
        f64::from_bits(0x3DE5_D93A_5ACF_D57C),
    ];
    const C: [f64; 6] = [
        f64::from_bits(0x3FA5_5555_5555_554C),
        f64::from_bits(0xBF56_C16C_16C1_5177),
        f64::from_bits(0x3EFA_01A0_19CB_1590),
        f64::from_bits(0xBE92_7E4F_809C_52AD),
        f64::from_bits(0x3E21_EE9E_BDB4_B1C4),
        f64::from_bits(0xBDA8_FAE9_BE88_38D4),
    ];
    let x = std::f64::consts::TAU * u;
    // 2πu = n·π/2 + y + tail with |y| ≤ π/4.
    let rounded = x * std::f64::consts::FRAC_2_PI + ROUND;
    let n = rounded - ROUND;
    let (r, w) = (x - n * HALF_PI[0], n * HALF_PI[1]);
    let y = r - w;
    let tail = (r - y) - w;
    let z = y * y;
    let (z2, v) = (z * z, z * y);
    let sines = S[1] + z * (S[2] + z * S[3]) + z * z2 * (S[4] + z * S[5]);
    let sin = y - ((z * (0.5 * tail - v * sines) - tail) - v * S[0]);
    let cosines = z * (C[0] + z * (C[1] + z * C[2])) + z2 * z2 * (C[3] + z * (C[4] + z * C[5]));
    let drop = 0.5 * z;
    let most = 1.0 - drop;
    let cos = most + (((1.0 - most) - drop) + (z * cosines - y * tail));
    // A quarter turn more makes of a cosine the sine, with the other sign in the first and the second quarter.
    let quarters = rounded.to_bits();
    let takes_sine = (quarters & 1).wrapping_neg();
    let sign = (quarters.wrapping_add(1) & 2) << 62;
    f64::from_bits(((cos.to_bits() & !takes_sine) | (sin.to_bits() & takes_sine)) ^ sign)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_the_standard_normal() {
        let n = 200_000u64;
        let sum = |power: i32| {
            (0..n)
                .map(|tick| gaussian(7, tick, 2).powi(power))
                .sum::<f64>()
                / n as f64
        };
        // Standard errors: 1/√n, √(2/n), √(15/n), √(96/n); five of them each.
        let root = (n as f64).sqrt();
        assert!(sum(1).abs() < 5.0 / root, "mean {}", sum(1));
        assert!(
            (sum(2) - 1.0).abs() < 5.0 * 2f64.sqrt() / root,
            "variance {}",
            sum(2)
        );
        assert!(
            sum(3).abs() < 5.0 * 15f64.sqrt() / root,
            "third moment {}",
            sum(3)
        );
        assert!(
            (sum(4) - 3.0).abs() < 5.0 * 96f64.sqrt() / root,
            "fourth moment {}",
            sum(4)
        );
    }

    #[test]
    fn neighbouring_arguments_are_uncorrelated() {
        let n = 100_000u64;
        let correlation =
            |f: fn(u64) -> (f64, f64)| (0..n).map(f).map(|(a, b)| a * b).sum::<f64>() / n as f64;
        let bound = 5.0 / (n as f64).sqrt();
        assert!(
            correlation(|t| (gaussian(1, t, 0), gaussian(1, t + 1, 0))).abs() < bound,
            "ticks"
        );
        assert!(
            correlation(|t| (gaussian(1, t, 0), gaussian(1, t, 1))).abs() < bound,
            "channels"
        );
        assert!(
            correlation(|t| (gaussian(1, t, 0), gaussian(2, t, 0))).abs() < bound,
            "seeds"
        );
    }

    #[test]
    fn a_number_does_not_depend_on_what_was_asked_before() {
        let forwards: Vec<f64> = (0..100).map(|t| gaussian(3, t, 5)).collect();
        let backwards: Vec<f64> = (0..100).rev().map(|t| gaussian(3, t, 5)).collect();
        assert!(forwards.iter().eq(backwards.iter().rev()));
        assert!(forwards.iter().all(|z| z.is_finite()));
    }

    #[test]
    fn numbers_are_those_of_libm() {
        for tick in 0..100_000 {
            let all: [f64; 6] = gaussians(9, tick);
            for (channel, z) in (0..).zip(all) {
                assert_eq!(z, gaussian(9, tick, channel));
                let (u_1, u_2) = (unit(mix(tick)), unit(mix(tick ^ channel)));
                assert_eq!(log_of_unit(u_1), libm::log(u_1));
                let (cos, expected) = (cos_of_turn(u_2), libm::cos(std::f64::consts::TAU * u_2));
                assert!(
                    (cos - expected).abs() <= expected.abs() * f64::EPSILON,
                    "{u_2}: {cos} {expected}"
                );
            }
        }
        for u in [
            unit(0),
            0.5 * f64::EPSILON,
            0.25,
            0.5,
            0.5_f64.sqrt(),
            0.75,
            1.0 - f64::EPSILON,
            unit(u64::MAX),
        ] {
            assert_eq!(log_of_unit(u), libm::log(u), "{u}");
            assert!(
                (cos_of_turn(u) - libm::cos(std::f64::consts::TAU * u)).abs() < 1e-16,
                "{u}"
            );
        }
    }

    #[test]
    fn the_extremes_of_the_uniform_grid_stay_inside() {
        assert!(unit(0) > 0.0 && unit(u64::MAX) < 1.0);
    }
}
