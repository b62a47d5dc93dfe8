//! The paper: each equation and each strategy of Chang & Khatib 1995 in a file.
//!
//! | file | content | source |
//! |---|---|---|
//! | [`neighborhood`] | D_si, the neighbourhood of one singularity | Eq. 2 |
//! | [`singular_frame`] | the rows of J orthogonal to the singular directions | §4 |
//! | [`operational_space`] | Γ = JᵀF + N_T Γ₀, J̄ and Λ, Γ₀ = −A[∇V₀ + k_vq q̇] | Eq. 3 to 5 |
//! | [`type_1`] | s_i as a task coordinate: into the singularity, out of it on a chosen side | §4, Type 1 |
//! | [`type_2`] | ζ_i held, or driven to ζ_id | §4, Type 2 |
//! | [`switching`] | the transition table: mode and condition to mode | §4 |
//!
//! The factors of s(q) = s₁·s₂·… (Eq. 1) are computed by each [`singularity`](crate::singularity); [`law`](crate::law) puts the rest together.

pub mod neighborhood;
pub mod operational_space;
pub mod reference;
pub mod singular_frame;
pub mod switching;
pub mod type_1;
pub mod type_2;
