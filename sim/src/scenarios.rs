//! The built-in scenarios, embedded: the program runs them from any folder.

use model::{JointKind, Robot};
use shared_types::scenario::Scenario;

/// Name and text of every file in `scenarios/`, in alphabetical order.
const BUILT_IN: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/scenarios.rs"));

/// The names of the built-in scenarios, in alphabetical order.
pub fn names() -> impl Iterator<Item = &'static str> {
    BUILT_IN.iter().map(|(name, _)| *name)
}

/// The text of a built-in scenario.
#[must_use]
pub fn text(name: &str) -> Option<&'static str> {
    BUILT_IN.iter().find(|(known, _)| *known == name).map(|(_, text)| *text)
}

/// Why a scenario's start posture does not fit its robot.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StartError {
    /// The robot's description has no such posture.
    #[error("{robot} has no posture `{name}`: there are {known}; or give q_deg or q_rad")]
    Unknown {
        /// The robot.
        robot: String,
        /// The name asked for.
        name: String,
        /// The names there are.
        known: String,
    },
    /// The scenario names no posture at all.
    #[error("no start posture is given: give one of q_deg, q_rad, posture")]
    Missing,
}

/// The start posture of a scenario; rad (m for prismatic joints). Its length and limits are `Robot::check_posture`'s to judge.
///
/// # Errors
/// [`StartError`] where the scenario names a posture that the robot does not have.
pub fn start_posture(robot: &Robot, scenario: &Scenario) -> Result<Vec<f64>, StartError> {
    let start = &scenario.start;
    if let Some(q) = &start.q_rad {
        return Ok(q.clone());
    }
    if let Some(q) = &start.q_deg {
        let unit = |i: usize| match robot.joints.get(i).map(|joint| joint.kind) {
            Some(JointKind::Prismatic) => 1e-3,
            _ => std::f64::consts::PI / 180.0,
        };
        return Ok(q.iter().enumerate().map(|(i, value)| value * unit(i)).collect());
    }
    let name = start.posture.as_ref().ok_or(StartError::Missing)?;
    robot.postures.get(name).cloned().ok_or_else(|| StartError::Unknown {
        robot: robot.name.clone(),
        name: name.clone(),
        known: robot.postures.keys().cloned().collect::<Vec<_>>().join(", "),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Plant, PlantError};
    use nalgebra::SVector;

    fn starts<const N: usize>(robot: &Robot, scenario: &Scenario, q: &[f64]) -> Result<(), PlantError> {
        let q = SVector::<f64, N>::from_column_slice(q);
        Plant::<N>::new(robot, &scenario.frame, &scenario.plant, scenario.rate_hz, &q).map(|_| ())
    }

    #[test]
    fn every_built_in_scenario_is_valid_and_its_arm_can_start() {
        assert!(names().count() > 0);
        for name in names() {
            let scenario = Scenario::parse(name, text(name).unwrap(), &[]).unwrap();
            assert_eq!(scenario.name, name);
            let robot = Robot::builtin(&scenario.robot).unwrap();
            let q = start_posture(&robot, &scenario).unwrap();
            robot.check_posture(&q).unwrap();
            let started = model::with_dof!(robot.dof(), N => starts::<N>(&robot, &scenario, &q)).unwrap();
            assert_eq!(started, Ok(()), "{name}");
        }
    }
}
