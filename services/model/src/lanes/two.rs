//! Rows in registers of two lanes, which every x86-64 and every aarch64 has.

use super::row::{PerJoint, Row, Space, V3};
use nalgebra::{SVector, Vector3};
use shared_types::MAX_DOF;
use std::ops::{Add, Mul, Sub};
use wide::f64x2;

const PAIRS: usize = MAX_DOF / 2;

/// Joints in pairs. Pairs beyond the `N`-th joint are not computed.
#[derive(Clone, Copy)]
pub(crate) struct Twos<const N: usize>([f64x2; PAIRS]);

impl<const N: usize> Twos<N> {
    const ZERO: Self = Self([f64x2::ZERO; PAIRS]);
    const IN_USE: usize = {
        assert!(N <= MAX_DOF && MAX_DOF == 8);
        N.div_ceil(2)
    };

    #[inline(always)]
    fn first(&self, k: usize) -> f64x2 {
        f64x2::splat(self.0[k].to_array()[0])
    }

    #[inline(always)]
    fn second(&self, k: usize) -> f64x2 {
        f64x2::splat(self.0[k].to_array()[1])
    }
}

macro_rules! by_pairs {
    ($trait:ident, $method:ident) => {
        impl<const N: usize> $trait for Twos<N> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                let mut all = Self::ZERO;
                for k in 0..Self::IN_USE {
                    all.0[k] = self.0[k].$method(other.0[k]);
                }
                all
            }
        }
    };
}
by_pairs!(Add, add);
by_pairs!(Sub, sub);
by_pairs!(Mul, mul);

impl<const N: usize> Row<N> for Twos<N> {
    type Space = Components;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self([f64x2::splat(value); PAIRS])
    }

    #[inline(always)]
    fn of(values: &SVector<f64, N>) -> Self {
        let mut all = Self::ZERO;
        for k in 0..Self::IN_USE {
            all.0[k] = f64x2::new([
                values[2 * k],
                if 2 * k + 1 < N {
                    values[2 * k + 1]
                } else {
                    0.0
                },
            ]);
        }
        all
    }

    #[inline(always)]
    fn load(values: &PerJoint) -> Self {
        let mut all = Self::ZERO;
        for k in 0..Self::IN_USE {
            all.0[k] = f64x2::new([values.0[2 * k], values.0[2 * k + 1]]);
        }
        all
    }

    #[inline(always)]
    fn store(self) -> PerJoint {
        let [[a, b], [c, d], [e, f], [g, h]] = self.0.map(f64x2::to_array);
        PerJoint([a, b, c, d, e, f, g, h])
    }

    #[inline(always)]
    fn outwards(mut self) -> Self {
        for k in 0..Self::IN_USE {
            let [a, b] = self.0[k].to_array();
            self.0[k] = f64x2::new([a, b + a]);
        }
        self.0[1] += self.second(0);
        self.0[3] += self.second(2);
        let half = self.second(1);
        self.0[2] += half;
        self.0[3] += half;
        self
    }

    #[inline(always)]
    fn inwards(mut self) -> Self {
        for k in 0..N / 2 {
            let [a, b] = self.0[k].to_array();
            self.0[k] = f64x2::new([a + b, b]);
        }
        if N > 2 {
            self.0[0] += self.first(1);
        }
        if N > 6 {
            self.0[2] += self.first(3);
        }
        if N > 4 {
            let half = self.first(2);
            self.0[0] += half;
            self.0[1] += half;
        }
        self
    }

    #[inline(always)]
    fn parents(self) -> Self {
        let [[a, b], [c, d], [e, f], [g, _]] = self.0.map(f64x2::to_array);
        Self([[0.0, a], [b, c], [d, e], [f, g]].map(f64x2::new))
    }

    #[inline(always)]
    fn rows(vectors: &[Components; MAX_DOF]) -> V3<Self> {
        let (mut x, mut y, mut z) = (Self::ZERO, Self::ZERO, Self::ZERO);
        for k in 0..Self::IN_USE {
            let (a, b) = (&vectors[2 * k], &vectors[2 * k + 1]);
            let ([a_x, a_y], [b_x, b_y]) = (a.xy.to_array(), b.xy.to_array());
            (x.0[k], y.0[k], z.0[k]) = (
                f64x2::new([a_x, b_x]),
                f64x2::new([a_y, b_y]),
                f64x2::new([a.z, b.z]),
            );
        }
        V3 { x, y, z }
    }

    #[inline(always)]
    fn is_within(self, limit: f64) -> bool {
        self.store().0.iter().all(|x| x.abs() <= limit)
    }

    #[inline(always)]
    fn turned(sin: Self, cos: Self, quarters: Self) -> (Self, Self) {
        let (mut s, mut c) = (Self::ZERO, Self::ZERO);
        for k in 0..Self::IN_USE {
            let ([s_0, s_1], [c_0, c_1], [q_0, q_1]) = (
                sin.0[k].to_array(),
                cos.0[k].to_array(),
                quarters.0[k].to_array(),
            );
            let ((s_0, c_0), (s_1, c_1)) = (turned(s_0, c_0, q_0), turned(s_1, c_1, q_1));
            (s.0[k], c.0[k]) = (f64x2::new([s_0, s_1]), f64x2::new([c_0, c_1]));
        }
        (s, c)
    }
}

#[inline(always)]
fn turned(sin: f64, cos: f64, quarters: f64) -> (f64, f64) {
    let (s, c, quarter) = (sin.to_bits(), cos.to_bits(), quarters.to_bits());
    // All bits where sine and cosine change places.
    let swaps = (s ^ c) & (quarter & 1).wrapping_neg();
    let sign = |turns: u64| (turns & 2) << 62;
    (
        f64::from_bits(s ^ swaps ^ sign(quarter)),
        f64::from_bits(c ^ swaps ^ sign(quarter.wrapping_add(1))),
    )
}

/// A vector's components.
#[derive(Clone, Copy)]
pub(crate) struct Components {
    xy: f64x2,
    z: f64,
}

impl Add for Components {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self {
            xy: self.xy + other.xy,
            z: self.z + other.z,
        }
    }
}

impl Sub for Components {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self {
            xy: self.xy - other.xy,
            z: self.z - other.z,
        }
    }
}

impl Space for Components {
    #[inline(always)]
    fn of([x, y, z]: [f64; 3]) -> Self {
        Self {
            xy: f64x2::new([x, y]),
            z,
        }
    }

    #[inline(always)]
    fn get(self) -> Vector3<f64> {
        let [x, y] = self.xy.to_array();
        Vector3::new(x, y, self.z)
    }

    #[inline(always)]
    fn times(self, factor: f64) -> Self {
        Self {
            xy: self.xy * f64x2::splat(factor),
            z: self.z * factor,
        }
    }
}
