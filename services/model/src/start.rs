//! From a scenario's start to a posture of this robot.

use shared_types::scenario::Start;

use crate::error::PostureError;
use crate::joint::JointKind;
use crate::robot::Robot;

/// Why a start does not fit the robot.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum StartError {
    /// The robot's description names no such posture.
    #[error("{robot} has no posture `{name}`: it has {known}; or give q_deg or q_rad")]
    Unknown {
        /// The robot.
        robot: String,
        /// The name asked for.
        name: String,
        /// The names there are.
        known: String,
    },
    /// No posture is given at all.
    #[error("no start posture is given: give one of q_deg, q_rad, posture")]
    Missing,
    /// It is not a posture of this robot.
    #[error(transparent)]
    Posture(#[from] PostureError),
}

impl Robot {
    /// The posture a scenario starts in, checked against length and limits; rad (m for prismatic joints, which `q_deg` gives in mm).
    ///
    /// Errors: [`StartError`].
    pub fn start_posture(&self, start: &Start) -> Result<Vec<f64>, StartError> {
        let q = match (&start.q_rad, &start.q_deg, &start.posture) {
            (Some(q), _, _) => q.clone(),
            (None, Some(q), _) => q
                .iter()
                .enumerate()
                .map(|(i, value)| self.in_si(i, *value))
                .collect(),
            (None, None, Some(name)) => {
                self.postures
                    .get(name)
                    .cloned()
                    .ok_or_else(|| StartError::Unknown {
                        robot: self.name.clone(),
                        name: name.clone(),
                        known: self
                            .postures
                            .keys()
                            .map(String::as_str)
                            .collect::<Vec<_>>()
                            .join(", "),
                    })?
            }
            (None, None, None) => return Err(StartError::Missing),
        };
        self.check_posture(&q)?;
        Ok(q)
    }

    fn in_si(&self, joint: usize, value: f64) -> f64 {
        match self.joints.get(joint).map(|joint| joint.kind) {
            Some(JointKind::Prismatic) => value * 1e-3,
            _ => value.to_radians(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn degrees_names_and_limits() {
        let robot = Robot::builtin("puma560").unwrap();
        let in_degrees = |q: &[f64]| {
            robot.start_posture(&Start {
                q_deg: Some(q.to_vec()),
                ..Start::default()
            })
        };
        assert_eq!(
            in_degrees(&[0.0, -90.0, 90.0, 0.0, 0.0, 0.0]).unwrap()[2],
            90f64.to_radians()
        );
        assert!(matches!(
            in_degrees(&[0.0; 3]),
            Err(StartError::Posture(PostureError::Length { .. }))
        ));
        assert!(matches!(
            in_degrees(&[0.0, 0.0, 0.0, 0.0, 170.0, 0.0]),
            Err(StartError::Posture(PostureError::OutsideLimits { .. }))
        ));
        let named = |name: &str| {
            robot.start_posture(&Start {
                posture: Some(name.to_owned()),
                ..Start::default()
            })
        };
        assert_eq!(named("ready").unwrap(), robot.postures["ready"]);
        assert!(named("reddy").unwrap_err().to_string().contains("it has "));
        assert_eq!(
            robot.start_posture(&Start::default()),
            Err(StartError::Missing)
        );
    }
}
