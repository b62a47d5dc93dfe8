//! The paper: each equation and each strategy of Chang & Khatib 1995 in a file of its own.
//!
//! | file | what | source |
//! |---|---|---|
//! | [`neighborhood`] | D_si, the neighbourhood of one singularity | Eq. 2 |
//! | [`singular_frame`] | the rows of J orthogonal to the singular directions | §4 |
//! | [`operational_space`] | Λ, J̄, N_T, Γ = JᵀF + N_T Γ₀, Γ₀ = −A[∇V₀ + k_vq q̇] | Eq. 3 to 5 |
//! | [`null_space`] | posture control of a redundant arm by either projector | Figures 1, 2 |
//! | [`type_1`] | s_i as a task coordinate: into the singularity, out of it on a chosen side | §4, Type 1 |
//! | [`type_2`] | ζ_i held, or driven to ζ_id | §4, Type 2 |
//! | [`switching`] | the transition table: mode and condition to mode | §4 |
//! | [`chang_khatib`] | torques by the reduced Jacobian and its null space, switched at η | Eq. 3 to 5, §4 |
//!
//! The factors of s(q) = s₁·s₂·… are computed by each [`arm_family`](crate::arm_family).

pub mod chang_khatib;
pub mod neighborhood;
pub mod null_space;
pub mod operational_space;
pub mod reference;
pub mod singular_frame;
pub mod switching;
pub mod type_1;
pub mod type_2;
