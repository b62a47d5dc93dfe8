//! Families of arms: one file each, measures and references together.
//!
//! | family | arms | Eq. 1 |
//! |---|---|---|
//! | [`puma`] | PUMA 560 and its kin | s = sin θ · sin q5 · R, by declared lengths |
//! | [`parallel_axes`] | Universal Robots and its kin | the same three factors, by the geometry of the axes |
//! | [`spherical_shoulder`] | KUKA iiwa and its kin, seven joints | elbow and aided wrist, by the geometry of the axes |
//! | [`numeric`] | any other | signed singular values, tracked from tick to tick |
//!
//! All implement [`family::ArmFamily`]; [`choice::Family`] picks one. The law depends on the type of a singularity, not on the family.

pub(crate) mod axes;
mod block;
pub mod choice;
pub mod classify;
mod elbow;
pub mod family;
pub mod numeric;
pub mod parallel_axes;
pub mod parallel_axes_inverse;
pub mod puma;
pub mod puma_inverse;
pub mod screws;
pub mod spherical_shoulder;
mod waist;
mod wrist;

#[cfg(test)]
mod tests;
