//! Experiments on sessions: whether the program does what it has done ([`conformance`]), what faults do to the arm ([`faults`]), what
//! it costs ([`benchmarks`]), how control laws compare ([`studies`]), and how a scenario goes under many settings ([`sweeps`]). Each
//! experiment stands beside its pictures.
//!
//! This crate prints nothing: results are returned, and what happens meanwhile goes to a [`session::Observer`].
#![allow(non_snake_case)]
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod benchmarks;
pub mod conformance;
pub mod faults;
pub mod studies;
pub mod sweeps;

mod folder;
mod pool;
mod quantile;
mod signals;
