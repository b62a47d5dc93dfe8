//! A protection left out, to show that the drill can fail: test equipment, in no run but the drill's own.

use launcher::Plan;
use model::{Joint, Robot};
use session::Failure;
use shared_types::job::Job;

/// The protection that a drill leaves out of its runs. It still judges by the robot and the bounds as they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Without {
    /// The drives' hold: without fresh torque they keep the last one for ever.
    Hold,
    /// The drives' check of torques against their limits: they allow [`EXCESS`] times as much.
    TorqueCheck,
    /// The fence of every reader: messages of dead incarnations count.
    Fencing,
}

/// The factor of the limits that drives without a check have.
const EXCESS: f64 = 10.0;

impl Without {
    /// Takes the protection out of a job, where it is in that.
    ///
    /// # Errors
    /// [`Failure::Input`] where no joint of the robot has an effort limit.
    pub(super) fn leave_out(self, job: &mut Job, robot: &Robot) -> Result<(), Failure> {
        match self {
            Self::Hold => job.scenario.plant.hold_ticks = u32::MAX,
            Self::TorqueCheck => {
                let description = with_efforts(&job.robot.description, robot, EXCESS)?;
                job.robot.description = description;
            }
            Self::Fencing => {}
        }
        Ok(())
    }

    /// Takes the protection out of the processes, where it is in them.
    pub(super) fn leave_out_of(self, plan: &mut Plan) {
        plan.children
            .iter_mut()
            .for_each(|child| child.process.disturbance.unfenced = self == Self::Fencing);
    }
}

/// The description of a robot with its effort limits multiplied.
fn with_efforts(description: &str, robot: &Robot, factor: f64) -> Result<String, Failure> {
    if robot.joints.iter().all(|joint| joint.effort.is_infinite()) {
        let name = &robot.name;
        return Err(Failure::Input(format!(
            "no joint of {name} has an effort limit, so there is no torque check to leave out"
        )));
    }
    let limit = |joint: &Joint| {
        let name = toml::Value::from(joint.name.as_str());
        format!("[joints.{name}]\neffort = {:?}\n", factor * joint.effort)
    };
    let limits: String = robot.joints.iter().map(limit).collect();
    model::description::merged(description, &limits).map_err(Failure::input)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_effort_limits_are_multiplied() {
        let robot = Robot::builtin("panda").expect("built in");
        let mut source = robot.source.clone();
        source.description = with_efforts(&source.description, &robot, EXCESS).expect("limits");
        let other = Robot::from_source(&source).expect("an arm");
        for (own, other) in robot.joints.iter().zip(&other.joints) {
            assert_eq!(other.effort, EXCESS * own.effort);
        }
    }
}
