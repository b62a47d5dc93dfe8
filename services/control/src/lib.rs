//! The paper: control of an arm at its kinematic singularities, dynamically consistent.
//!
//! K.-S. Chang and O. Khatib, *Manipulator Control at Kinematic Singularities: A Dynamically Consistent Strategy*, IROS 1995; cited as CK95 where
//! an equation is implemented (`[CK95 Eq. 4]`) and where a test covers it (`// covers: CK95 Eq. 4`).
//!
//! PURE: no clock, thread, file, environment or randomness; nothing is allocated per tick; no data makes it panic.
//!
//! | step | where | what |
//! |---|---|---|
//! | 1 | [`singular`] | s(q) = s₁·s₂·…, neighbourhoods D_si, directions ζ_i and their frames (Eq. 1, 2) |
//! | 2 | [`trajectory`], [`governor`] | the desired motion, and how fast its clock runs |
//! | 3 | [`reference`], [`auxiliary`] | where the auxiliary coordinate of each singularity should go, and how |
//! | 4 | [`law`], [`operational`] | torques: what is kept by operational forces, the rest in the null space (Eq. 3 to 5) |
//! | 5 | [`saturation`] | limits: null-space torque is given up first |
//!
//! [`Analyzer`] does step 1, [`Controller`] the rest; [`wire`] turns their values into messages and back.
#![allow(non_snake_case)]

pub mod auxiliary;
pub mod centre;
pub mod governor;
pub mod law;
pub mod linear;
pub mod operational;
pub mod reference;
pub mod saturation;
pub mod singular;
pub mod sweep;
pub mod trajectory;
pub mod wire;

#[cfg(test)]
mod closed_loop;
mod controller;
#[cfg(test)]
mod testing;
mod types;

pub use controller::{Controller, SetupError, start_posture};
pub use singular::Analyzer;
pub use types::{Class, Command, Kind, Mode, Phase, Plan, Refusal, Report, Singularity};

pub use shared_types::MAX_SINGULARITIES;
