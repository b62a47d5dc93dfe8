//! Tests of the crate as a whole.

mod closed_loop;
mod controller;
mod proofs;
