//! Two joints side by side in the processor's vector registers.
//!
//! Poses of links follow from one another, and so do their velocities. All else about a link is computed from these for two joints at once,
//! by [`Pair`]s: sums, differences, products and quotients only, so that each joint has the bits that it would have alone, on any processor.

use nalgebra::{SVector, Vector3};
use shared_types::MAX_DOF;

/// Calls a function of [`Model`](crate::Model), `#[inline(always)]` and without `self`, by the widest instructions that this processor has.
///
/// They take three operands and so need fewer moves. Operations and their order stay the same, products and sums are not fused: so do the bits.
macro_rules! widest {
    ($body:ident($($argument:ident: $type:ty),*) -> $result:ty) => {{
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx2")]
            fn avx2<const N: usize>($($argument: $type),*) -> $result {
                Model::<N>::$body($($argument),*)
            }
            if is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has what the function asks for.
                return unsafe { avx2($($argument),*) };
            }
        }
        Self::$body($($argument),*)
    }};
}
pub(crate) use widest;

/// A number of each of two joints.
pub(crate) type Pair = wide::f64x2;

/// The pairs of `N` joints: the last is half empty where `N` is odd.
#[inline(always)]
pub(crate) fn pairs<const N: usize>() -> std::ops::Range<usize> {
    const { assert!(N <= MAX_DOF && MAX_DOF.is_multiple_of(2)) };
    0..N.div_ceil(2)
}

/// A number per joint, zero beyond the last.
#[derive(Clone, Copy, Debug)]
#[repr(align(16))]
pub(crate) struct PerJoint(pub(crate) [f64; MAX_DOF]);

impl PerJoint {
    pub(crate) const ZERO: Self = Self([0.0; MAX_DOF]);

    #[inline(always)]
    pub(crate) fn of<const N: usize>(values: &SVector<f64, N>) -> Self {
        let mut all = Self::ZERO;
        all.0[..N].copy_from_slice(values.as_slice());
        all
    }

    #[inline(always)]
    pub(crate) fn pair(&self, k: usize) -> Pair {
        Pair::new([self.0[2 * k], self.0[2 * k + 1]])
    }

    /// The same with its joints exchanged.
    #[inline(always)]
    pub(crate) fn swapped(&self, k: usize) -> Pair {
        Pair::new([self.0[2 * k + 1], self.0[2 * k]])
    }

    /// Numbers that are computed one by one are put together before they are stored: a processor waits where it reads at once what it has written in
    /// parts.
    #[inline(always)]
    pub(crate) fn put(&mut self, k: usize, values: Pair) {
        self.0[2 * k..2 * k + 2].copy_from_slice(&values.to_array());
    }

    /// Of joint i the sum of `first` and all before it.
    #[inline(always)]
    fn summed_outwards<const N: usize>(&self, first: f64) -> Self {
        let (mut sums, mut sum) = (Self::ZERO, first);
        for k in pairs::<N>() {
            let next = sum + self.0[2 * k];
            sums.put(k, Pair::new([sum, next]));
            sum = next + self.0[2 * k + 1];
        }
        sums
    }

    /// Of joint i the sum over it and all beyond it.
    #[inline(always)]
    pub(crate) fn summed_inwards<const N: usize>(&mut self) {
        let mut sum = 0.0;
        for k in pairs::<N>().rev() {
            let beyond = self.0[2 * k + 1] + sum;
            sum = self.0[2 * k] + beyond;
            self.put(k, Pair::new([sum, beyond]));
        }
    }
}

/// A vector per joint.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Vectors {
    pub(crate) x: PerJoint,
    pub(crate) y: PerJoint,
    pub(crate) z: PerJoint,
}

impl Vectors {
    pub(crate) const ZERO: Self = Self { x: PerJoint::ZERO, y: PerJoint::ZERO, z: PerJoint::ZERO };

    #[inline(always)]
    pub(crate) fn set(&mut self, i: usize, v: &Vector3<f64>) {
        (self.x.0[i], self.y.0[i], self.z.0[i]) = (v.x, v.y, v.z);
    }

    #[inline(always)]
    pub(crate) fn get(&self, i: usize) -> Vector3<f64> {
        Vector3::new(self.x.0[i], self.y.0[i], self.z.0[i])
    }

    #[inline(always)]
    pub(crate) fn put_each(&mut self, k: usize, [a, b]: [&Vector3<f64>; 2]) {
        self.put(k, &Vector3::new(Pair::new([a.x, b.x]), Pair::new([a.y, b.y]), Pair::new([a.z, b.z])));
    }

    #[inline(always)]
    pub(crate) fn pair(&self, k: usize) -> Vector3<Pair> {
        Vector3::new(self.x.pair(k), self.y.pair(k), self.z.pair(k))
    }

    #[inline(always)]
    pub(crate) fn swapped(&self, k: usize) -> Vector3<Pair> {
        Vector3::new(self.x.swapped(k), self.y.swapped(k), self.z.swapped(k))
    }

    #[inline(always)]
    pub(crate) fn put(&mut self, k: usize, v: &Vector3<Pair>) {
        self.x.put(k, v.x);
        self.y.put(k, v.y);
        self.z.put(k, v.z);
    }

    #[inline(always)]
    pub(crate) fn summed_outwards<const N: usize>(&self, first: &Vector3<f64>) -> Self {
        Self { x: self.x.summed_outwards::<N>(first.x), y: self.y.summed_outwards::<N>(first.y), z: self.z.summed_outwards::<N>(first.z) }
    }

    #[inline(always)]
    pub(crate) fn summed_inwards<const N: usize>(&mut self) {
        self.x.summed_inwards::<N>();
        self.y.summed_inwards::<N>();
        self.z.summed_inwards::<N>();
    }
}

/// Angles beyond this are reduced one by one; rad.
const LARGE: f64 = 1e5;

/// Sine and cosine of two angles, within a unit in the last place: libm's method in pairs.
///
/// x = n·π/2 + y [Cody & Waite 1980, *Software Manual for the Elementary Functions*, Ch. 8], then minimax polynomials of y and y² on [−π/4, π/4]
/// [FreeBSD msun, `e_rem_pio2.c`, `k_sin.c`, `k_cos.c`].
#[inline(always)]
pub(crate) fn sincos(x: Pair) -> (Pair, Pair) {
    /// Adding this rounds a number to a whole one, which is then in its last bits.
    const ROUND: f64 = 1.5 / f64::EPSILON;
    /// π/2 in two parts; the first has 33 bits, so that n times it is exact.
    const HALF_PI: [f64; 2] = [f64::from_bits(0x3FF9_21FB_5440_0000), f64::from_bits(0x3DD0_B461_1A62_6331)];
    let one = |value: f64| Pair::splat(value);
    let [a, b] = x.to_array();
    // Written so that a NaN is libm's to answer.
    if !(a.abs() <= LARGE && b.abs() <= LARGE) {
        let ((sin_a, cos_a), (sin_b, cos_b)) = (libm::sincos(a), libm::sincos(b));
        return (Pair::new([sin_a, sin_b]), Pair::new([cos_a, cos_b]));
    }
    let rounded = x * one(std::f64::consts::FRAC_2_PI) + one(ROUND);
    let n = rounded - one(ROUND);
    let (r, w) = (x - n * one(HALF_PI[0]), n * one(HALF_PI[1]));
    let y = r - w;
    let tail = (r - y) - w;

    let y2 = y * y;
    let series = |[a, b, c, d, e]: [f64; 5]| (((one(e) * y2 + one(d)) * y2 + one(c)) * y2 + one(b)) * y2 + one(a);
    let y3 = y2 * y;
    let sin = y - ((y2 * (one(0.5) * tail - y3 * series(SIN)) - tail) - y3 * one(SIN_0));
    let half = one(0.5) * y2;
    let most = one(1.0) - half;
    let cos = most + (((one(1.0) - most) - half) + (y2 * y2 * (one(COS_0) + y2 * series(COS)) - y * tail));

    let (sin, cos, quarters) = (sin.to_array(), cos.to_array(), rounded.to_array());
    let turned = |k: usize| {
        let (s, c, quarter) = (sin[k].to_bits(), cos[k].to_bits(), quarters[k].to_bits());
        // All bits where sine and cosine change places.
        let swaps = (s ^ c) & (quarter & 1).wrapping_neg();
        let sign = |turns: u64| (turns & 2) << 62;
        (f64::from_bits(s ^ swaps ^ sign(quarter)), f64::from_bits(c ^ swaps ^ sign(quarter.wrapping_add(1))))
    };
    let ((sin_a, cos_a), (sin_b, cos_b)) = (turned(0), turned(1));
    (Pair::new([sin_a, sin_b]), Pair::new([cos_a, cos_b]))
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

    /// Distance of two numbers in units of the last place of the larger.
    fn units(a: f64, b: f64) -> f64 {
        (a - b).abs() / (a.abs().max(b.abs()) * f64::EPSILON).max(f64::MIN_POSITIVE)
    }

    #[test]
    fn sines_in_pairs_are_those_of_libm() {
        let mut worst = 0.0_f64;
        let mut x = -2.0 * LARGE;
        while x < 2.0 * LARGE {
            for x in [x, x * 1e-5, x * 1e-12] {
                let (sin, cos) = sincos(Pair::new([x, -0.7 * x]));
                for (k, x) in [x, -0.7 * x].into_iter().enumerate() {
                    let (s, c) = libm::sincos(x);
                    // Where a value nearly vanishes it is exact to 1e-20.
                    let off = |a: f64, b: f64| if (a - b).abs() < 1e-20 { 0.0 } else { units(a, b) };
                    worst = worst.max(off(sin.to_array()[k], s)).max(off(cos.to_array()[k], c));
                }
            }
            x += 1.234_567;
        }
        assert!(worst <= 1.0, "{worst} units in the last place");
        for exact in [[0.0, -0.0], [f64::NAN, 1.0], [f64::INFINITY, 1e300]] {
            let (sin, cos) = sincos(Pair::new(exact));
            for (k, x) in exact.into_iter().enumerate() {
                let (s, c) = libm::sincos(x);
                assert_eq!((sin.to_array()[k].to_bits(), cos.to_array()[k].to_bits()), (s.to_bits(), c.to_bits()), "{x}");
            }
        }
    }
}
