//! The plant: the simulated arm, its sensors and its drives. It makes the ticks. PURE.
#![allow(non_snake_case)]
#![cfg_attr(not(test), deny(clippy::disallowed_methods, clippy::disallowed_types))]

mod cycle;
mod hardware_faults;

use model::{Refused, Robot};
use process::{Running, Step};
use shared_types::scenario::Scenario;

use cycle::Cycle;

/// The process for an arm of as many joints as `robot` has.
///
/// # Errors
/// [`Refused`] if robot and scenario do not fit, or the arm has more joints than the program is built for.
pub fn process(robot: &Robot, scenario: &Scenario) -> Result<Box<dyn Step>, Refused> {
    model::boxed!(robot, N => Cycle::<N>::new(robot, scenario).map(Running::from), dyn Step)
}
