//! Sines and cosines of all joints' angles at once.

use super::row::{PerJoint, Row};

/// Angles beyond this are reduced one by one; rad.
const LARGE: f64 = 1e5;

/// Sine and cosine of each angle, within a unit in the last place: libm's method.
///
/// x = n·π/2 + y [Cody & Waite 1980, *Software Manual for the Elementary Functions*, Ch. 8], then minimax polynomials of y and y² on [−π/4, π/4]
/// [FreeBSD msun, `e_rem_pio2.c`, `k_sin.c`, `k_cos.c`].
#[inline(always)]
pub(crate) fn sincos<const N: usize, R: Row<N>>(x: R) -> (R, R) {
    /// Adding this rounds a number to a whole one, which is then in its last bits.
    const ROUND: f64 = 1.5 / f64::EPSILON;
    /// π/2 in two parts; the first has 33 bits, so that n times it is exact.
    const HALF_PI: [f64; 2] = [
        f64::from_bits(0x3FF9_21FB_5440_0000),
        f64::from_bits(0x3DD0_B461_1A62_6331),
    ];
    let rounded = x * R::splat(std::f64::consts::FRAC_2_PI) + R::splat(ROUND);
    let n = rounded - R::splat(ROUND);
    let (r, w) = (x - n * R::splat(HALF_PI[0]), n * R::splat(HALF_PI[1]));
    let y = r - w;
    let tail = (r - y) - w;

    let y2 = y * y;
    let (y3, y4) = (y2 * y, y2 * y2);
    let (one, half) = (R::splat(1.0), R::splat(0.5));
    let sin = y
        - ((y2 * (half * tail - y3 * series::<N, R>(&SIN, y2, y4)) - tail) - y3 * R::splat(SIN_0));
    let drop = half * y2;
    let most = one - drop;
    let cos = most
        + (((one - most) - drop)
            + (y4 * (R::splat(COS_0) + y2 * series::<N, R>(&COS, y2, y4)) - y * tail));
    let (sin, cos) = R::turned(sin, cos, rounded);
    // Written so that a NaN is libm's to answer.
    if x.is_within(LARGE) {
        (sin, cos)
    } else {
        reduced_one_by_one::<N, R>(x, sin, cos)
    }
}

/// A polynomial of y² by its five coefficients, with y⁴ at hand.
#[inline(always)]
fn series<const N: usize, R: Row<N>>(c: &[f64; 5], y2: R, y4: R) -> R {
    let (low, high) = (
        R::splat(c[1]) * y2 + R::splat(c[0]),
        R::splat(c[3]) * y2 + R::splat(c[2]),
    );
    (R::splat(c[4]) * y4 + high) * y4 + low
}

/// Sine and cosine by libm of those angles that are large or no numbers.
#[inline(always)]
fn reduced_one_by_one<const N: usize, R: Row<N>>(x: R, sin: R, cos: R) -> (R, R) {
    let (x, mut sin, mut cos) = (x.store(), sin.store(), cos.store());
    replace_large(&x, &mut sin, &mut cos);
    (R::load(&sin), R::load(&cos))
}

#[cold]
#[inline(never)]
fn replace_large(x: &PerJoint, sin: &mut PerJoint, cos: &mut PerJoint) {
    for (i, x) in x.0.iter().enumerate() {
        // Written so that a NaN is not small.
        let is_small = x.abs() <= LARGE;
        if !is_small {
            (sin.0[i], cos.0[i]) = libm::sincos(*x);
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
    use super::super::two::Twos;
    use super::*;
    use nalgebra::SVector;

    /// Distance of two numbers in units of the last place of the larger.
    fn units(a: f64, b: f64) -> f64 {
        (a - b).abs() / (a.abs().max(b.abs()) * f64::EPSILON).max(f64::MIN_POSITIVE)
    }

    fn sincos(x: [f64; 2]) -> [(f64, f64); 2] {
        let (sin, cos) = super::sincos::<2, Twos<2>>(Twos::of(&SVector::from(x)));
        let (sin, cos) = (sin.store().0, cos.store().0);
        [(sin[0], cos[0]), (sin[1], cos[1])]
    }

    #[test]
    fn sines_in_rows_are_those_of_libm() {
        let mut worst = 0.0_f64;
        let mut x = -2.0 * LARGE;
        while x < 2.0 * LARGE {
            for x in [x, x * 1e-5, x * 1e-12] {
                for (x, (sin, cos)) in [x, -0.7 * x].into_iter().zip(sincos([x, -0.7 * x])) {
                    let (s, c) = libm::sincos(x);
                    // Where a value nearly vanishes it is exact to 1e-20.
                    let off = |a: f64, b: f64| {
                        if (a - b).abs() < 1e-20 {
                            0.0
                        } else {
                            units(a, b)
                        }
                    };
                    worst = worst.max(off(sin, s)).max(off(cos, c));
                }
            }
            x += 1.234_567;
        }
        assert!(worst <= 1.0, "{worst} units in the last place");
        for exact in [[0.0, -0.0], [f64::NAN, 1.0], [f64::INFINITY, 1e300]] {
            for (x, (sin, cos)) in exact.into_iter().zip(sincos(exact)) {
                let (s, c) = libm::sincos(x);
                assert_eq!(
                    (sin.to_bits(), cos.to_bits()),
                    (s.to_bits(), c.to_bits()),
                    "{x}"
                );
            }
        }
    }
}
