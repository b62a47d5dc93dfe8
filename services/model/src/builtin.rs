//! The built-in robots: a URDF and a description each, compiled in.

use crate::error::RobotError;
use shared_types::job::RobotText;

use crate::robot::Robot;

/// Name, URDF, description.
const BUILTIN: &[(&str, &str, &str)] = &[
    (
        "puma560",
        include_str!("../robots/puma560.urdf"),
        include_str!("../robots/puma560.toml"),
    ),
    (
        "puma560-ideal",
        include_str!("../robots/puma560-ideal.urdf"),
        include_str!("../robots/puma560-ideal.toml"),
    ),
    (
        "planar3r",
        include_str!("../robots/planar3r.urdf"),
        include_str!("../robots/planar3r.toml"),
    ),
    (
        "ur5",
        include_str!("../robots/ur5.urdf"),
        include_str!("../robots/ur5.toml"),
    ),
    (
        "planar2r",
        include_str!("../robots/planar2r.urdf"),
        include_str!("../robots/planar2r.toml"),
    ),
    (
        "iiwa14",
        include_str!("../robots/iiwa14.urdf"),
        include_str!("../robots/iiwa14.toml"),
    ),
    (
        "ur10",
        include_str!("../robots/ur10.urdf"),
        include_str!("../robots/ur10.toml"),
    ),
    (
        "panda",
        include_str!("../robots/panda.urdf"),
        include_str!("../robots/panda.toml"),
    ),
    (
        "fr3",
        include_str!("../robots/fr3.urdf"),
        include_str!("../robots/fr3.toml"),
    ),
    (
        "xarm7",
        include_str!("../robots/xarm7.urdf"),
        include_str!("../robots/xarm7.toml"),
    ),
    (
        "gen3",
        include_str!("../robots/gen3.urdf"),
        include_str!("../robots/gen3.toml"),
    ),
];

const BUILTIN_NAMES: [&str; BUILTIN.len()] = {
    let mut names = [""; BUILTIN.len()];
    let mut i = 0;
    while i < names.len() {
        names[i] = BUILTIN[i].0;
        i += 1;
    }
    names
};

impl Robot {
    /// The built-in robots' names.
    pub fn builtin_names() -> &'static [&'static str] {
        &BUILTIN_NAMES
    }

    /// A built-in robot.
    ///
    /// Errors: [`RobotError::Unknown`], which lists the names.
    pub fn builtin(name: &str) -> Result<Robot, RobotError> {
        let (name, urdf, description) = BUILTIN
            .iter()
            .find(|(known, ..)| *known == name)
            .ok_or_else(|| RobotError::Unknown {
                name: name.to_owned(),
                known: BUILTIN_NAMES.join(", "),
            })?;
        Robot::from_source(&RobotText {
            name: (*name).to_owned(),
            description: (*description).to_owned(),
            urdf: (*urdf).to_owned(),
        })
    }
}
