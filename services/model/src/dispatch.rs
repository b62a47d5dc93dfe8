//! From a number of joints that is known at run time to one that is in the type.
//!
//! The control chain is compiled for [`SIZES`] only; an arm of fewer joints than a size is embedded in it by absent joints (see
//! [`Model`](crate::Model)). This file alone lists the sizes.

use crate::robot::Robot;
use nalgebra::SVector;

/// Sizes for which the program is compiled. One more is one more arm in [`with_dof`](crate::with_dof), and the time to compile it.
pub const SIZES: [usize; 3] = [6, 7, 8];

/// Why something cannot be built for a robot, in one sentence.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Refused(String);

impl Refused {
    /// For a reason found elsewhere: any error, as its sentence.
    pub fn because(reason: impl std::fmt::Display) -> Self {
        Self(reason.to_string())
    }

    /// For a number of joints beyond the largest size.
    #[must_use]
    pub fn size(robot: &Robot) -> Self {
        Self(format!("{} has {} joints; armplane is built for arms of at most {} joints", robot.name, robot.dof(), SIZES[SIZES.len() - 1]))
    }
}

/// The arm's joint values in the places of a size, zero at absent joints. Requires at most `N` values.
#[must_use]
pub fn embedded<const N: usize>(values: &[f64]) -> SVector<f64, N> {
    assert!(values.len() <= N, "{} joint values in {N} places", values.len());
    SVector::from_fn(|i, _| values.get(i).copied().unwrap_or_default())
}

/// Evaluates an expression with the smallest size that holds `$dof` joints as a constant; `None` if there is none.
///
/// ```
/// let robot = model::Robot::builtin("planar3r")?;
/// assert_eq!(model::with_dof!(robot.dof(), N => N), Some(6));
/// # Ok::<(), model::RobotError>(())
/// ```
#[macro_export]
macro_rules! with_dof {
    ($dof:expr, $N:ident => $body:expr) => {
        match $dof {
            1..=6 => {
                const $N: usize = 6;
                Some($body)
            }
            7 => {
                const $N: usize = 7;
                Some($body)
            }
            8 => {
                const $N: usize = 8;
                Some($body)
            }
            _ => None,
        }
    };
}
