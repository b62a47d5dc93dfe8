//! The built-in scenarios, embedded: the program runs them from any folder.

/// Name and text of every file in `scenarios/`, in alphabetical order.
const BUILT_IN: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/scenarios.rs"));

/// The names of the built-in scenarios, in alphabetical order.
pub fn names() -> impl Iterator<Item = &'static str> {
    BUILT_IN.iter().map(|(name, _)| *name)
}

/// The text of a built-in scenario.
#[must_use]
pub fn text(name: &str) -> Option<&'static str> {
    BUILT_IN
        .iter()
        .find(|(known, _)| *known == name)
        .map(|(_, text)| *text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Plant, PlantError};
    use model::Robot;
    use shared_types::scenario::Scenario;

    fn starts<const N: usize>(
        robot: &Robot,
        scenario: &Scenario,
        q: &[f64],
    ) -> Result<(), PlantError> {
        let q = model::embedded::<N>(q);
        Plant::<N>::new(
            robot,
            scenario.frame(),
            &scenario.plant,
            scenario.rate_hz,
            &q,
        )
        .map(|_| ())
    }

    #[test]
    fn every_built_in_scenario_is_valid_and_its_arm_can_start() {
        assert!(names().count() > 0);
        for name in names() {
            let scenario = Scenario::parse(name, text(name).unwrap(), &[]).unwrap();
            assert_eq!(scenario.name, name);
            let robot = Robot::builtin(&scenario.robot).unwrap();
            let q = robot.start_posture(&scenario.start).unwrap();
            let started =
                model::with_dof!(robot.dof(), N => starts::<N>(&robot, &scenario, &q)).unwrap();
            assert_eq!(started, Ok(()), "{name}");
        }
    }
}
