//! Whether a fault can happen to a joint of an arm.

use model::Robot;
use shared_types::fault::{Fault, Kind, Way};
use shared_types::file::Complaint;

/// Whether the amount of a fault is a share of a torque limit that its joint has not.
pub fn lacks_limit(fault: &Fault, robot: &Robot) -> bool {
    let place = fault.joint.map_or(0, |joint| joint.saturating_sub(1)) as usize;
    let is_share =
        fault.kind == Kind::Drive && matches!(fault.way, Some(Way::Saturated | Way::Friction));
    is_share
        && robot
            .joints
            .get(place)
            .is_some_and(|joint| !joint.effort.is_finite())
}

/// Checks a fault against the arm.
///
/// # Errors
/// [`Complaint`], its path relative to the fault: the arm has no such joint, or the joint no torque limit of which the fault is a share.
pub(crate) fn check(fault: &Fault, robot: &Robot) -> Result<(), Complaint> {
    let (name, dof) = (&robot.name, robot.dof());
    if let Some(joint) = fault.joint.filter(|joint| *joint as usize > dof) {
        // A fault of a joint that the arm does not have could not be repeated.
        return Err(Complaint::new(
            "joint",
            format!("there is no joint {joint}: {name} has {dof} joints"),
            "joints count from 1",
        ));
    }
    if lacks_limit(fault, robot) {
        let message = format!(
            "joint {} of {name} has no torque limit of which the fault could be a share",
            fault.joint.unwrap_or(1)
        );
        return Err(Complaint::new(
            "as",
            message,
            "take `lost` or `stuck`, or give the joint an effort limit in the URDF",
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_of_no_limit_is_refused() {
        let of = |robot: &str, way, joint| {
            let fault = Fault {
                way: Some(way),
                joint,
                ..Fault::new("plant", Kind::Drive)
            };
            check(&fault, &Robot::builtin(robot).unwrap())
                .map_err(|complaint| complaint.to_string())
        };
        for way in [Way::Friction, Way::Saturated] {
            assert!(
                of("planar3r", way, Some(1))
                    .unwrap_err()
                    .contains("no torque limit")
                    && of("planar3r", way, None).is_err()
            );
            assert_eq!(of("puma560", way, Some(6)), Ok(()));
        }
        assert_eq!(of("planar3r", Way::Lost, Some(3)), Ok(()));
        assert!(
            of("planar3r", Way::Lost, Some(4))
                .unwrap_err()
                .contains("3 joints")
        );
    }
}
