//! The built-in robots: a URDF and a description each, compiled in.

use crate::error::RobotError;
use shared_types::job::RobotText;

use crate::robot::Robot;

/// Makes [`NAMES`] and [`TEXTS`] of the names of the files in `robots/`.
macro_rules! robots {
    ($($name:literal)+) => {
        const NAMES: &[&str] = &[$($name),+];
        /// URDF and description, in the order of the names.
        const TEXTS: &[[&str; 2]] = &[$([
            include_str!(concat!("../robots/", $name, ".urdf")),
            include_str!(concat!("../robots/", $name, ".toml")),
        ]),+];
    };
}

robots!("puma560" "puma560-ideal" "planar3r" "ur5" "planar2r" "iiwa14" "ur10" "panda" "fr3" "xarm7" "gen3");

impl Robot {
    /// The built-in robots' names.
    pub fn builtin_names() -> &'static [&'static str] {
        NAMES
    }

    /// A built-in robot.
    ///
    /// Errors: [`RobotError::Unknown`], which lists the names.
    pub fn builtin(name: &str) -> Result<Robot, RobotError> {
        let Some(place) = NAMES.iter().position(|known| *known == name) else {
            return Err(RobotError::Unknown {
                name: name.to_owned(),
                known: NAMES.join(", "),
            });
        };
        let [urdf, description] = TEXTS[place].map(str::to_owned);
        Robot::from_source(&RobotText {
            name: name.to_owned(),
            description,
            urdf,
            ..RobotText::default()
        })
    }
}
