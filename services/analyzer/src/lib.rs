//! The analyzer: finds the singularities near the arm's posture, with their directions and types. PURE.
#![allow(non_snake_case)]
#![cfg_attr(not(test), deny(clippy::disallowed_methods, clippy::disallowed_types))]

mod cycle;

use model::{Refused, Robot};
use process::{Running, Step};
use shared_types::scenario::Scenario;

pub use cycle::{Analysis, Cycle};

/// The process for an arm of as many joints as `robot` has.
///
/// # Errors
/// [`Refused`] if robot and scenario do not fit, or the arm has more joints than the program is built for.
pub fn process(robot: &Robot, scenario: &Scenario) -> Result<Box<dyn Step>, Refused> {
    model::boxed!(robot, N => Cycle::<N>::new(robot, scenario).map(Running::from), dyn Step)
}
