//! Tests of the crate as a whole.

mod beyond_reach;
mod closed_loop;
mod controller;
mod lost;
mod proofs;
mod steered;
