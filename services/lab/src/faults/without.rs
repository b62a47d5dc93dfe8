//! A protection left out, to show that the drill can fail: test equipment, in no run but the drill's own.

use std::fmt::Write;

use launcher::Plan;
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
    /// [`Failure::Input`] where the robot's description has an effort limit that is no number.
    pub(super) fn leave_out(self, job: &mut Job) -> Result<(), Failure> {
        match self {
            Self::Hold => job.scenario.plant.hold_ticks = u32::MAX,
            Self::TorqueCheck => {
                job.robot.urdf = with_efforts(&job.robot.urdf, EXCESS).map_err(Failure::Input)?
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

/// A URDF with all effort limits multiplied; the reason where one is no finite number, or there is none.
fn with_efforts(urdf: &str, factor: f64) -> Result<String, String> {
    const ATTRIBUTE: &str = "effort=\"";
    let mut parts = urdf.split(ATTRIBUTE);
    let mut text = parts.next().unwrap_or_default().to_owned();
    let mut count = 0;
    for part in parts {
        let (number, rest) = part
            .split_once('"')
            .ok_or("an effort limit of the URDF has no end")?;
        let effort = number
            .trim()
            .parse()
            .ok()
            .filter(|effort: &f64| effort.is_finite());
        let effort = effort.ok_or_else(|| {
            format!("the URDF's effort limit {number:?} is not a number: give one in N m")
        })?;
        // Writing to a string does not fail.
        let _ = write!(text, "{ATTRIBUTE}{}\"{rest}", factor * effort);
        count += 1;
    }
    if count == 0 {
        return Err(
            "the URDF has no effort limit (effort=\"…\"), so there is no torque check to leave out"
                .to_owned(),
        );
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_effort_limits_are_multiplied_and_nothing_else() {
        let urdf = "<limit effort=\"97.6\" velocity=\"8\"/><limit lower=\"-1\" effort=\"2\" velocity=\"1\"/>";
        let expected = "<limit effort=\"976\" velocity=\"8\"/><limit lower=\"-1\" effort=\"20\" velocity=\"1\"/>";
        assert_eq!(with_efforts(urdf, EXCESS).as_deref(), Ok(expected));
        for wrong in ["", "NaN", "1e999", "-inf", "7 N m"] {
            let reason = with_efforts(&format!("<limit effort=\"{wrong}\"/>"), EXCESS).unwrap_err();
            assert!(reason.contains(&format!("{wrong:?}")), "{reason}");
        }
        assert!(
            with_efforts("<limit velocity=\"1\"/>", EXCESS).is_err()
                && with_efforts("effort=\"3", EXCESS).is_err()
        );
    }
}
