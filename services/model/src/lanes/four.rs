//! Rows in two registers of four lanes: AVX2.

use super::row::{PerJoint, Row, Space, V3};
use nalgebra::Vector3;
use shared_types::MAX_DOF;
use std::arch::x86_64::{
    __m256d, _mm256_add_pd, _mm256_blend_pd, _mm256_loadu_pd, _mm256_mul_pd,
    _mm256_permute2f128_pd, _mm256_permute4x64_pd, _mm256_set1_pd, _mm256_setr_pd,
    _mm256_setzero_pd, _mm256_storeu_pd, _mm256_sub_pd, _mm256_unpackhi_pd, _mm256_unpacklo_pd,
};
use std::ops::{Add, Mul, Sub};

/// Instructions of AVX2, which nothing but `widest!` lets run.
macro_rules! avx2 {
    ($value:expr) => {
        // SAFETY: values of these types are made only where the processor has been found to have AVX2, in functions that `widest!` calls and in tests.
        unsafe { $value }
    };
}

/// Joints in fours. The second is not computed where `N` is at most four.
#[derive(Clone, Copy)]
pub(crate) struct Fours<const N: usize>([__m256d; 2]);

macro_rules! by_fours {
    ($trait:ident, $method:ident, $instruction:ident) => {
        impl<const N: usize> $trait for Fours<N> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                let ([a, b], [c, d]) = (self.0, other.0);
                avx2!(Self([
                    $instruction(a, c),
                    if N > 4 { $instruction(b, d) } else { b }
                ]))
            }
        }

        impl $trait for Components {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                avx2!(Self($instruction(self.0, other.0)))
            }
        }
    };
}
by_fours!(Add, add, _mm256_add_pd);
by_fours!(Sub, sub, _mm256_sub_pd);
by_fours!(Mul, mul, _mm256_mul_pd);

impl<const N: usize> Row<N> for Fours<N> {
    type Space = Components;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        avx2!(Self([_mm256_set1_pd(value); 2]))
    }

    #[inline(always)]
    fn load(values: &PerJoint) -> Self {
        let v = values.0.as_ptr();
        avx2!(Self([_mm256_loadu_pd(v), _mm256_loadu_pd(v.add(4))]))
    }

    #[inline(always)]
    fn store(self) -> PerJoint {
        let mut values = PerJoint::ZERO;
        let v = values.0.as_mut_ptr();
        avx2!({
            _mm256_storeu_pd(v, self.0[0]);
            _mm256_storeu_pd(v.add(4), self.0[1]);
        });
        values
    }

    #[inline(always)]
    fn outwards(self) -> Self {
        let [a, b] = self.0;
        avx2!({
            let (a, b) = (outwards(a), outwards(b));
            Self([
                a,
                _mm256_add_pd(b, _mm256_permute4x64_pd::<0b11_11_11_11>(a)),
            ])
        })
    }

    #[inline(always)]
    fn inwards(self) -> Self {
        let [a, b] = self.0;
        avx2!({
            let a = inwards(a, N);
            if N <= 4 {
                return Self([a, b]);
            }
            let b = inwards(b, N - 4);
            Self([_mm256_add_pd(a, _mm256_permute4x64_pd::<0>(b)), b])
        })
    }

    #[inline(always)]
    fn parents(self) -> Self {
        let [a, b] = self.0;
        avx2!({
            let (up_a, up_b) = (
                _mm256_permute4x64_pd::<0b10_01_00_00>(a),
                _mm256_permute4x64_pd::<0b10_01_00_00>(b),
            );
            let last = _mm256_permute4x64_pd::<0b11_11_11_11>(a);
            Self([
                _mm256_blend_pd::<1>(up_a, _mm256_setzero_pd()),
                _mm256_blend_pd::<1>(up_b, last),
            ])
        })
    }

    #[inline(always)]
    fn rows(v: &[Components; MAX_DOF]) -> V3<Self> {
        let ([x_a, y_a, z_a], [x_b, y_b, z_b]) = (
            transposed(&v[0], &v[1], &v[2], &v[3]),
            transposed(&v[4], &v[5], &v[6], &v[7]),
        );
        V3 {
            x: Self([x_a, x_b]),
            y: Self([y_a, y_b]),
            z: Self([z_a, z_b]),
        }
    }
}

/// Sums of four from the first on. Places that have nothing to add get −0, which leaves every number as it is.
#[inline(always)]
fn outwards(s: __m256d) -> __m256d {
    avx2!({
        let none = _mm256_set1_pd(-0.0);
        let s = _mm256_add_pd(s, _mm256_unpacklo_pd(none, s));
        _mm256_add_pd(
            s,
            _mm256_blend_pd::<0b1100>(none, _mm256_permute4x64_pd::<0b01_01_01_01>(s)),
        )
    })
}

/// Sums of the first `used` of four from the last of them on.
#[inline(always)]
fn inwards(s: __m256d, used: usize) -> __m256d {
    avx2!({
        let none = _mm256_set1_pd(-0.0);
        let next = _mm256_unpackhi_pd(s, none);
        let next = match used {
            0 | 1 => none,
            2 | 3 => _mm256_blend_pd::<0b1100>(next, none),
            _ => next,
        };
        let s = _mm256_add_pd(s, next);
        if used <= 2 {
            return s;
        }
        _mm256_add_pd(
            s,
            _mm256_blend_pd::<0b1100>(_mm256_permute4x64_pd::<0b10_10_10_10>(s), none),
        )
    })
}

/// Four vectors as rows of their components.
#[inline(always)]
fn transposed(a: &Components, b: &Components, c: &Components, d: &Components) -> [__m256d; 3] {
    avx2!({
        let (xz_ab, y_ab) = (_mm256_unpacklo_pd(a.0, b.0), _mm256_unpackhi_pd(a.0, b.0));
        let (xz_cd, y_cd) = (_mm256_unpacklo_pd(c.0, d.0), _mm256_unpackhi_pd(c.0, d.0));
        [
            _mm256_permute2f128_pd::<0x20>(xz_ab, xz_cd),
            _mm256_permute2f128_pd::<0x20>(y_ab, y_cd),
            _mm256_permute2f128_pd::<0x31>(xz_ab, xz_cd),
        ]
    })
}

/// A vector's components, and a fourth number without meaning.
#[derive(Clone, Copy)]
pub(crate) struct Components(__m256d);

impl Space for Components {
    #[inline(always)]
    fn of([x, y, z]: [f64; 3]) -> Self {
        avx2!(Self(_mm256_setr_pd(x, y, z, 0.0)))
    }

    #[inline(always)]
    fn get(self) -> Vector3<f64> {
        let mut v = [0.0; 4];
        avx2!(_mm256_storeu_pd(v.as_mut_ptr(), self.0));
        Vector3::new(v[0], v[1], v[2])
    }

    #[inline(always)]
    fn times(self, factor: f64) -> Self {
        avx2!(Self(_mm256_mul_pd(self.0, _mm256_set1_pd(factor))))
    }
}
