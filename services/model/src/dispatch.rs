//! From a number of joints that is known at run time to one that is in the type.
//!
//! The control chain is compiled for [`SIZES`] only; an arm of fewer joints than a size is embedded in it by absent joints (see
//! [`Model`](crate::Model)). This file alone lists the sizes.

use crate::robot::Robot;
use nalgebra::SVector;

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
        Self(format!(
            "{} has {} joints; armplane is built for arms of at most {} joints",
            robot.name,
            robot.dof(),
            SIZES[SIZES.len() - 1]
        ))
    }
}

/// The arm's joint values in the places of a size, zero at absent joints. Requires at most `N` values.
#[must_use]
pub fn embedded<const N: usize>(values: &[f64]) -> SVector<f64, N> {
    assert!(
        values.len() <= N,
        "{} joint values in {N} places",
        values.len()
    );
    SVector::from_fn(|i, _| values.get(i).copied().unwrap_or_default())
}

/// Makes [`SIZES`] and [`with_dof`] of one list. `$d` is the dollar sign of the macro that is made.
macro_rules! sizes {
    ($d:tt $($size:literal),+) => {
        /// Sizes for which the program is compiled, in order. One more is one more literal below, and the time to compile it.
        pub const SIZES: [usize; [$($size),+].len()] = [$($size),+];

        /// Evaluates an expression with the smallest size that holds `$dof` joints as a constant; `None` if there is none.
        ///
        /// ```
        /// let robot = model::Robot::builtin("planar3r")?;
        /// assert_eq!(model::with_dof!(robot.dof(), N => N), Some(6));
        /// assert_eq!(model::with_dof!(model::SIZES[2] + 1, N => N), None);
        /// # Ok::<(), model::RobotError>(())
        /// ```
        #[macro_export]
        macro_rules! with_dof {
            ($d dof:expr, $d N:ident => $d body:expr) => {
                match $d dof {
                    0 => None,
                    $(dof if dof <= $size => {
                        const $d N: usize = $size;
                        Some($d body)
                    })+
                    _ => None,
                }
            };
        }
    };
}

sizes!($ 6, 7, 8);

/// Builds a process's step in the size of `$robot`: `$step` gives it for `$N` joints or an error, and it is boxed as `$Step`.
///
/// The value is a `Result<Box<$Step>, Refused>`, refused for the step's own reason or for an arm that no size holds.
#[macro_export]
macro_rules! boxed {
    ($robot:expr, $N:ident => $step:expr, $Step:ty) => {
        $crate::with_dof!($robot.dof(), $N => $step.map(|step| Box::new(step) as Box<$Step>).map_err($crate::Refused::because))
            .unwrap_or_else(|| Err($crate::Refused::size($robot)))
    };
}
