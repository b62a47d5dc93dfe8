//! Sines and cosines of several angles at once.

use std::f64::consts::FRAC_2_PI;

/// Angles beyond this are libm's, which reduces them by more digits of π; rad.
const LARGE: f64 = 1e5;

/// Sine and cosine of each angle, rad: libm's method without a branch, so that the compiler puts the angles side by side.
///
/// x = n·π/2 + y [Cody & Waite 1980, *Software Manual for the Elementary Functions*, Ch. 8], then minimax polynomials of y and y² on [−π/4, π/4]
/// [FreeBSD msun, `e_rem_pio2.c`, `k_sin.c`, `k_cos.c`].
///
/// Ensures libm's values within a unit in the last place, the same bits on every machine; NaN for what is not finite
#[must_use]
#[inline(always)]
pub fn sincos<const K: usize>(x: &[f64; K]) -> ([f64; K], [f64; K]) {
    let (mut sin, mut cos, mut all_small) = ([0.0; K], [0.0; K], true);
    for i in 0..K {
        (sin[i], cos[i]) = reduced(x[i]);
        all_small &= x[i].abs() <= LARGE;
    }
    if !all_small {
        replace_large(x, &mut sin, &mut cos);
    }
    (sin, cos)
}

#[inline(always)]
fn reduced(x: f64) -> (f64, f64) {
    /// Adding this rounds a number to a whole one, which is then in its last bits.
    const ROUND: f64 = 1.5 / f64::EPSILON;
    /// π/2 in two parts; the first has 33 bits, so that n times it is exact.
    const HALF_PI: [f64; 2] = [
        f64::from_bits(0x3FF9_21FB_5440_0000),
        f64::from_bits(0x3DD0_B461_1A62_6331),
    ];
    let rounded = x * FRAC_2_PI + ROUND;
    let n = rounded - ROUND;
    let (r, w) = (x - n * HALF_PI[0], n * HALF_PI[1]);
    let y = r - w;
    let tail = (r - y) - w;
    let y2 = y * y;
    let y3 = y2 * y;
    let sin = y - ((y2 * (0.5 * tail - y3 * series(&SIN, y2)) - tail) - y3 * SIN_0);
    let most = 1.0 - 0.5 * y2;
    let cos =
        most + (((1.0 - most) - 0.5 * y2) + (y2 * y2 * (COS_0 + y2 * series(&COS, y2)) - y * tail));
    // An odd n exchanges the two; bit 1 of n is the sign of the sine, that of n + 1 the cosine's.
    let (n, s, c) = (rounded.to_bits(), sin.to_bits(), cos.to_bits());
    let odd = 0_u64.wrapping_sub(n & 1);
    let exchanged = (s ^ c) & odd;
    (
        f64::from_bits((s ^ exchanged) ^ ((n & 2) << 62)),
        f64::from_bits((c ^ exchanged) ^ ((n.wrapping_add(1) & 2) << 62)),
    )
}

/// A polynomial of y² by its five coefficients.
#[inline(always)]
fn series(c: &[f64; 5], y2: f64) -> f64 {
    let y4 = y2 * y2;
    (c[4] * y4 + (c[3] * y2 + c[2])) * y4 + (c[1] * y2 + c[0])
}

#[cold]
#[inline(never)]
fn replace_large(x: &[f64], sin: &mut [f64], cos: &mut [f64]) {
    for ((x, sin), cos) in x.iter().zip(sin).zip(cos) {
        // Written so that a NaN is not small.
        let is_small = x.abs() <= LARGE;
        if !is_small {
            (*sin, *cos) = libm::sincos(*x);
        }
    }
}

/// (sin y − y)/y³ in powers of y²: the first, and the others.
const SIN_0: f64 = f64::from_bits(0xBFC5_5555_5555_5549);
const SIN: [f64; 5] = [
    f64::from_bits(0x3F81_1111_1110_F8A6),
    f64::from_bits(0xBF2A_01A0_19C1_61D5),
    f64::from_bits(0x3EC7_1DE3_57B1_FE7D),
    f64::from_bits(0xBE5A_E5E6_8A2B_9CEB),
    f64::from_bits(0x3DE5_D93A_5ACF_D57C),
];

/// (cos y − 1 + y²/2)/y⁴ in powers of y²: the first, and the others.
const COS_0: f64 = f64::from_bits(0x3FA5_5555_5555_554C);
const COS: [f64; 5] = [
    f64::from_bits(0xBF56_C16C_16C1_5177),
    f64::from_bits(0x3EFA_01A0_19CB_1590),
    f64::from_bits(0xBE92_7E4F_809C_52AD),
    f64::from_bits(0x3E21_EE9E_BDB4_B1C4),
    f64::from_bits(0xBDA8_FAE9_BE88_38D4),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_are_those_of_libm() {
        let mut angles = vec![0.0, -0.0, f64::NAN, f64::INFINITY, 1e300];
        for k in 0..400_000 {
            let x = 1.234_567 * f64::from(k) - 2.0 * LARGE;
            angles.extend([x, x * 1e-5, x * 1e-12]);
        }
        for x in angles {
            let ([sin], [cos]) = sincos(&[x]);
            let (s, c) = libm::sincos(x);
            for (a, b) in [(sin, s), (cos, c)] {
                // Where a value nearly vanishes it is exact to 1e-20.
                let close = (a - b).abs() <= f64::EPSILON * a.abs().max(b.abs()) + 1e-20;
                let same = a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan();
                assert!(same || close && x != 0.0, "{x}: {a} {b}");
            }
        }
    }
}
