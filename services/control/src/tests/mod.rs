//! Tests of the crate as a whole.

mod beyond_reach;
mod controller;
mod proofs;
mod steered;
