//! The joints of an arm side by side in the processor's vector registers.
//!
//! A [`Row`] has a number of each joint, and a model's algorithms are written in rows once. Two types carry them: two registers of four lanes, where the
//! processor has AVX2, or an array. Both compute the same sums, differences and products of the same numbers in the same
//! order, and none is fused, so that both give the same bits. Places beyond the arm's `N` joints are computed where that is for nothing, and enter no
//! place of the arm's own.

#[cfg(target_arch = "x86_64")]
mod four;
mod plain;
mod row;

#[cfg(target_arch = "x86_64")]
pub(crate) use four::Fours;
pub(crate) use plain::Plain;
pub(crate) use row::{Number, PerJoint, Row, Space, V3, Vectors};

/// A function of [`Model`](crate::Model) that calls the one named as its body, which is generic over its row and `#[inline(always)]`, with the widest row
/// that this processor has.
macro_rules! widest {
    ($(#[$doc:meta])* $seen:vis fn $name:ident(&$this:ident $(, $argument:ident: $type:ty)*) $(-> $result:ty)? { $body:ident }) => {
        $(#[$doc])*
        $seen fn $name(&$this, $($argument: $type),*) $(-> $result)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                fn fours<const N: usize>(arm: &Model<N>, $($argument: $type),*) $(-> $result)? {
                    arm.$body::<crate::lanes::Fours<N>>($($argument),*)
                }
                if is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor has what the function asks for.
                    return unsafe { fours::<N>($this, $($argument),*) };
                }
            }
            $this.$body::<crate::lanes::Plain<N>>($($argument),*)
        }
    };
}
pub(crate) use widest;
