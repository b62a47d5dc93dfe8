//! From a number of joints that is known at run time to one that is in the type.

use crate::robot::Robot;

/// Numbers of joints for which the program is built. One more is one more arm below, and the time to compile it.
pub const SUPPORTED_DOF: [usize; 3] = [3, 6, 7];

/// Why something cannot be built for a robot, in one sentence.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Refused(String);

impl Refused {
    /// For a reason found elsewhere: any error, as its sentence.
    pub fn because(reason: impl std::fmt::Display) -> Self {
        Self(reason.to_string())
    }

    /// For a number of joints that the program is not built for.
    #[must_use]
    pub fn size(robot: &Robot) -> Self {
        Self(format!("{} has {} joints; armplane is built for arms of {SUPPORTED_DOF:?} joints", robot.name, robot.dof()))
    }
}

/// Evaluates an expression with the robot's number of joints as a constant; `None` for a number the program is not built for.
///
/// ```
/// let robot = model::Robot::builtin("puma560")?;
/// let size = model::with_dof!(robot.dof(), N => std::mem::size_of::<model::Model<N>>());
/// assert!(size.is_some());
/// # Ok::<(), model::RobotError>(())
/// ```
#[macro_export]
macro_rules! with_dof {
    ($dof:expr, $N:ident => $body:expr) => {
        match $dof {
            3 => {
                const $N: usize = 3;
                Some($body)
            }
            6 => {
                const $N: usize = 6;
                Some($body)
            }
            7 => {
                const $N: usize = 7;
                Some($body)
            }
            _ => None,
        }
    };
}
