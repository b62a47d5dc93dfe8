//! Rows as arrays, for processors without AVX2: the sums of [`Fours`](super::Fours), in the same order.

use super::row::{PerJoint, Row, Space, V3};
use nalgebra::Vector3;
use shared_types::MAX_DOF;
use std::ops::{Add, Mul, Sub};

#[derive(Clone, Copy)]
pub(crate) struct Plain<const N: usize>([f64; MAX_DOF]);

macro_rules! by_joints {
    ($trait:ident, $method:ident) => {
        impl<const N: usize> $trait for Plain<N> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(std::array::from_fn(|i| self.0[i].$method(other.0[i])))
            }
        }
    };
}
by_joints!(Add, add);
by_joints!(Sub, sub);
by_joints!(Mul, mul);

impl<const N: usize> Row<N> for Plain<N> {
    type Space = Vector3<f64>;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Self([value; MAX_DOF])
    }

    #[inline(always)]
    fn load(values: &PerJoint) -> Self {
        Self(values.0)
    }

    #[inline(always)]
    fn store(self) -> PerJoint {
        PerJoint(self.0)
    }

    #[inline(always)]
    fn outwards(mut self) -> Self {
        for half in self.0.chunks_exact_mut(4) {
            half[1] += half[0];
            half[3] += half[2];
            half[2] += half[1];
            half[3] += half[1];
        }
        let first = self.0[3];
        self.0[4..].iter_mut().for_each(|sum| *sum += first);
        self
    }

    #[inline(always)]
    fn inwards(mut self) -> Self {
        let (low, high) = self.0.split_at_mut(4);
        for (half, used) in [(&mut *low, N), (&mut *high, N.saturating_sub(4))] {
            if used > 1 {
                half[0] += half[1];
            }
            if used > 3 {
                half[2] += half[3];
            }
            if used > 2 {
                half[0] += half[2];
                half[1] += half[2];
            }
        }
        if N > 4 {
            low.iter_mut().for_each(|sum| *sum += high[0]);
        }
        self
    }

    #[inline(always)]
    fn parents(self) -> Self {
        Self(std::array::from_fn(|i| {
            if i == 0 { 0.0 } else { self.0[i - 1] }
        }))
    }

    #[inline(always)]
    fn rows(vectors: &[Self::Space; MAX_DOF]) -> V3<Self> {
        V3 {
            x: Self(vectors.map(|v| v.x)),
            y: Self(vectors.map(|v| v.y)),
            z: Self(vectors.map(|v| v.z)),
        }
    }
}

impl Space for Vector3<f64> {
    #[inline(always)]
    fn of(v: [f64; 3]) -> Self {
        v.into()
    }

    #[inline(always)]
    fn get(self) -> Self {
        self
    }

    #[inline(always)]
    fn times(self, factor: f64) -> Self {
        self * factor
    }
}
