//! Experiments on sessions: whether the program does what it has done ([`conformance`]), what faults do to the arm ([`faults`]), what
//! it costs ([`benchmarks`]), and how control laws compare ([`studies`]). Each experiment is made of trials, rows and tables ([`trial`]). Experiments of
//! many trials are in Python (`armplane.experiments`), on [`trial::Trial`] too.
//!
//! This crate prints nothing: results are returned, and what happens meanwhile goes to a [`session::Observer`].
#![allow(non_snake_case)]
#![cfg_attr(not(test), deny(clippy::print_stdout, clippy::print_stderr))]

pub mod benchmarks;
pub mod conformance;
pub mod faults;
pub mod row;
pub mod studies;
pub mod trial;

mod end;
mod folder;
mod signals;
mod text;
