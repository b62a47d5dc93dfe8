//! The robot's own URDF as a robot of armplane.

use model::{Robot, RobotText};

use crate::error::RobotFailure;
use crate::interface::JOINTS;

/// Rotor inertia as it acts at the joint, kg·m²: MuJoCo Menagerie, `franka_fr3`, identified on hardware. Franka publishes none.
const ARMATURE: [f64; JOINTS] = [0.195, 0.195, 0.195, 0.195, 0.074, 0.074, 0.074];

/// FCI documentation, "Constants": 1000 N·m/s for every joint. Kept a hundredth below, for what gravity changes within a tick.
const TORQUE_RATE: f64 = 990.0;

/// From the elbow to the shoulder 0.316 m, to the wrist 0.384 m.
const LENGTH_M: f64 = 0.35;

/// The frame at which tools are mounted, where the URDF has a link of this ending.
const FLANGE: &str = "link8";

/// A robot from the URDF that `GetRobotModel` gives. Friction is none: the interface compensates it.
pub(crate) fn source(name: &str, urdf: String) -> Result<RobotText, RobotFailure> {
    let wrong = |error: &dyn std::fmt::Display| RobotFailure::Description(error.to_string());
    let bare = RobotText {
        name: name.to_owned(),
        urdf,
        ..RobotText::default()
    };
    let robot = Robot::from_source(&bare).map_err(|error| wrong(&error))?;
    let frame = robot
        .frames
        .iter()
        .find(|frame| frame.name.ends_with(FLANGE));
    let frame = frame.map_or(robot.default_frame.as_str(), |frame| frame.name.as_str());
    // The chain may go on beyond the flange, to the fingers of a hand.
    let arm: Vec<_> = robot.joints.iter().take(JOINTS).collect();
    if arm.len() < JOINTS {
        return Err(RobotFailure::Description(format!(
            "it has {} joints, a Franka arm has {JOINTS}",
            arm.len()
        )));
    }
    let mut text = format!(
        "# Made from the robot's own URDF (GetRobotModel).\n# Armature: MuJoCo Menagerie, franka_fr3. Friction: compensated by the interface.\n\
         default_frame = {frame:?}\nlength_m = {LENGTH_M}\n\n[joints]\n"
    );
    for (joint, armature) in arm.iter().zip(ARMATURE) {
        text += &format!(
            "{:?} = {{ armature = {armature}, torque_rate = {TORQUE_RATE:.1}, viscous_friction = 0.0, coulomb_friction = 0.0 }}\n",
            joint.name
        );
    }
    let source = RobotText {
        description: text,
        ..bare
    };
    let robot = Robot::from_source(&source).map_err(|error| wrong(&error))?;
    match robot.dof() {
        JOINTS => Ok(source),
        dof => Err(RobotFailure::Description(format!(
            "it has {dof} joints up to {frame}, a Franka arm has {JOINTS}"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_names_of_joints_become_an_arm_of_seven() {
        let urdf = Robot::builtin("fr3")
            .unwrap()
            .source
            .urdf
            .replace("fr3_", "left_");
        let robot = Robot::from_source(&source("mine", urdf).unwrap()).unwrap();
        assert_eq!(
            (
                robot.dof(),
                robot.default_frame.as_str(),
                robot.name.as_str()
            ),
            (JOINTS, "left_link8", "mine")
        );
        assert!(
            robot.joints.iter().zip(ARMATURE).all(
                |(joint, armature)| joint.armature == armature && joint.coulomb_friction == 0.0
            )
        );
        assert!(
            robot
                .joints
                .iter()
                .all(|joint| joint.torque_rate == TORQUE_RATE)
        );
    }

    #[test]
    fn another_arm_is_refused() {
        let refused = source("mine", Robot::builtin("ur5").unwrap().source.urdf.clone())
            .unwrap_err()
            .to_string();
        assert!(refused.contains("6 joints"), "{refused}");
        assert!(
            source("mine", "<robot/>".into())
                .unwrap_err()
                .to_string()
                .contains("own description")
        );
    }
}
