//! Where an arm is singular: one way for every arm.
//!
//! [`analyzer`] lists the singularities of a posture, [`family`] says who measures them: the [`factors`] of det J where the geometry of the axes gives
//! them, and the [`tracker`] of singular directions everywhere else. Each is one [`Singularity`](crate::types::Singularity): a measure s with its rate, the
//! direction ζ, and the regular coordinate that replaces it: modulo the kept rows ζᵀJ = gain·aux_row.
//!
//! | file | content |
//! |---|---|
//! | [`tracked_svd`], [`tracker`] | the singular value decomposition carried from tick to tick; its smallest directions as singularities |
//! | [`auxiliary_row`] | the coordinate of a tracked direction |
//! | [`classify`] | Type 1, Type 2 or mixed, by the second-order motion along ζ |
//! | [`geometry`], [`axes`], [`screws`] | what the axes tell: names, meeting points; the arm as screws |
//! | [`factors`], [`elbow`] | measures by the geometry of six axes, and of an arm with a spherical shoulder |
//! | [`reference`](mod@reference) | where the coordinate of a singularity goes |

pub mod analyzer;
mod auxiliary_row;
pub(crate) mod axes;
pub mod classify;
mod elbow;
mod factors;
pub mod family;
mod geometry;
mod reference;
pub mod screws;
mod tracked_svd;
mod tracker;

#[cfg(test)]
mod tests;
