//! Faults in a real graph, judged by what the arm does: every fault on every process, and pairs of them.
//!
//! One experiment: a plan of faults ([`plan`]) is requested of a run ([`run`]), as `armplane fault` would, and what is seen of the run is judged
//! ([`judge`]) into a [`Cell`]. The guarantees are the same in lockstep and in real time; in lockstep the plan that the run leaves must also give the
//! same bytes, and the arm's distance from its path without a fault is bounded ([`bounds`]).

mod bounds;
mod drill;
mod judge;
mod plan;
mod run;
mod show;
mod without;

pub use drill::{Request, drill};
pub use judge::{Broken, Cell};
pub use show::Drilled;
pub use without::Without;
