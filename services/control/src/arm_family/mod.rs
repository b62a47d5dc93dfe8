//! Families of arms: one file each, measures and references together.
//!
//! | family | arms | Eq. 1 |
//! |---|---|---|
//! | [`puma`] | PUMA 560 and its kin | s = sin θ · sin q5 · R, by declared lengths |
//! | [`parallel_axes`] | Universal Robots and its kin | the same three factors, by the geometry of the axes |
//! | [`spherical_shoulder`] | KUKA iiwa and its kin, seven joints | the elbow by the geometry of the axes, the rest as below |
//! | [`redundant`] | Panda, FR3 and any other with spare joints | vectors in null space, tracked from tick to tick |
//! | [`numeric`] | any other | signed singular values, tracked from tick to tick |
//!
//! All implement [`family::ArmFamily`]; [`choice::Family`] picks one. The law depends on the type of a singularity, not on the family.

mod ahead;
pub(crate) mod axes;
mod block;
pub mod choice;
pub mod classify;
mod elbow;
pub mod family;
mod lost;
mod lost_geometry;
mod lost_reference;
pub mod numeric;
pub mod parallel_axes;
pub mod parallel_axes_inverse;
pub mod puma;
pub mod puma_inverse;
pub mod redundant;
pub mod screws;
pub mod spherical_shoulder;
mod thresholds;
mod waist;
mod wrist;

#[cfg(test)]
mod tests;
