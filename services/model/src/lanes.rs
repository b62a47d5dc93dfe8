//! The joints of an arm side by side in the processor's vector registers.
//!
//! A [`Row`] has a number of each joint, and a model's algorithms are written in rows once. Two types carry them: two registers of four lanes, where the
//! processor has AVX2, or four registers of two lanes. Both compute the same sums, differences, products and quotients of the same numbers in the same
//! order, and none is fused, so that both give the same bits. Places beyond the arm's `N` joints are computed where that is for nothing, and enter no
//! place of the arm's own.

#[cfg(target_arch = "x86_64")]
mod four;
mod row;
mod sines;
mod two;

#[cfg(target_arch = "x86_64")]
pub(crate) use four::Fours;
pub(crate) use row::{Number, PerJoint, Row, Space, V3, Vectors};
pub(crate) use sines::sincos;
pub(crate) use two::Twos;

/// Calls a function of [`Model`](crate::Model) that is generic over its row, `#[inline(always)]` and without `self`, with the widest that this processor
/// has.
///
/// Of AVX-512 it takes the 32 registers, where fewer numbers wait in memory. Its lanes of eight are no quicker on a Zen 4: each step waits for the one
/// before.
macro_rules! widest {
    ($body:ident($($argument:ident: $type:ty),*) -> $result:ty) => {{
        #[cfg(target_arch = "x86_64")]
        {
            #[target_feature(enable = "avx2,avx512f,avx512vl,avx512dq")]
            fn fours_in_32_registers<const N: usize>($($argument: $type),*) -> $result {
                Model::<N>::$body::<crate::lanes::Fours<N>>($($argument),*)
            }
            #[target_feature(enable = "avx2")]
            fn fours<const N: usize>($($argument: $type),*) -> $result {
                Model::<N>::$body::<crate::lanes::Fours<N>>($($argument),*)
            }
            if is_x86_feature_detected!("avx2")
                && is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512vl")
                && is_x86_feature_detected!("avx512dq")
            {
                // SAFETY: the processor has what the function asks for.
                return unsafe { fours_in_32_registers::<N>($($argument),*) };
            }
            if is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has what the function asks for.
                return unsafe { fours::<N>($($argument),*) };
            }
        }
        Model::<N>::$body::<crate::lanes::Twos<N>>($($argument),*)
    }};
}
pub(crate) use widest;
