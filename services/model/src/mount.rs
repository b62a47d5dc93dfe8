//! The tool and the loads that an arm carries.

use crate::error::Defect;
use crate::joint::{Frame, Joint};
use crate::pose::Pose;
use crate::robot::Robot;
use nalgebra::{Matrix3, Vector3};
use shared_types::scenario::{Payload, Tool};

/// The frame of a tool's tip.
const TIP: &str = "mount.tool";

impl Robot {
    /// The arm with a tool on its hand, whose tip becomes the default frame.
    ///
    /// # Errors
    /// [`Defect`] where the hand is fixed to the base.
    pub(crate) fn take_tool(&mut self, tool: &Tool) -> Result<(), Defect> {
        let hand = self.default_frame.clone();
        self.load(&hand, tool.mass_kg, tool.com_m.into())?;
        let rpy = tool.rpy_deg.map(f64::to_radians);
        let X_ET = Pose::from_xyz_rpy(tool.tip_m, rpy);
        if let Some(frame) = self.frame(&hand).cloned() {
            self.frames.push(Frame {
                name: TIP.to_owned(),
                X_LF: frame.X_LF * X_ET,
                ..frame
            });
            TIP.clone_into(&mut self.default_frame);
        }
        Ok(())
    }

    /// The arm with a load on a frame (`None`: its default frame).
    ///
    /// # Errors
    /// [`Defect`] where the frame does not move.
    pub fn take_payload(&mut self, frame: Option<&str>, load: &Payload) -> Result<(), Defect> {
        let frame = frame.unwrap_or(&self.default_frame).to_owned();
        self.load(&frame, load.mass_kg, load.com_m.into())
    }

    fn load(&mut self, frame: &str, mass: f64, at: Vector3<f64>) -> Result<(), Defect> {
        if mass == 0.0 {
            return Ok(());
        }
        let found = self.frame(frame).cloned();
        let carrier = found.and_then(|frame| Some((frame.joint?, frame.X_LF)));
        let Some((joint, X_LF)) = carrier else {
            return Err(Defect::Value {
                what: format!("a load on '{frame}'"),
                value: format!("{mass} kg"),
                remedy: "load a link that moves",
            });
        };
        self.joints[joint].carry(mass, &X_LF.transform_point(&at));
        Ok(())
    }
}

impl Joint {
    /// Adds a point mass to the link, at a place in its frame.
    fn carry(&mut self, mass: f64, at: &Vector3<f64>) {
        let (whole, d) = (self.mass + mass, at - self.com);
        let reduced = self.mass * mass / whole;
        self.inertia += (Matrix3::identity() * d.norm_squared() - d * d.transpose()) * reduced;
        self.com += d * (mass / whole);
        self.mass = whole;
    }
}

#[cfg(test)]
mod tests {
    use crate::{Model, Pose, Robot, RobotText};
    use nalgebra::{Vector3, Vector6};

    /// The PUMA with more in its description.
    fn puma(more: &str) -> Model<6> {
        let source = Robot::builtin("puma560").unwrap().source;
        let description = format!("{more}\n{}", source.description);
        let robot = Robot::from_source(&RobotText {
            description,
            ..source
        });
        Model::new(&robot.unwrap(), None).unwrap()
    }

    const Q: Vector6<f64> = Vector6::new(0.3, -0.9, 2.6, 0.4, 0.8, -0.5);

    /// The torque of a mass at the hand is Jᵀ of its weight.
    #[test]
    fn a_load_weighs_as_its_weight_at_its_place() {
        let loaded = puma("payload = {mass_kg = 2.0, com_m = [0.02, -0.03, 0.15]}");
        let plain = puma("");
        let at = Pose::translation(Vector3::new(0.02, -0.03, 0.15));
        let J = plain.clone().with_tool(&at).jacobian(&Q);
        let weight = Vector6::new(0.0, 0.0, 2.0 * 9.81, 0.0, 0.0, 0.0);
        let by = loaded.gravity(&Q) - plain.gravity(&Q);
        assert!((by - J.transpose() * weight).amax() < 1e-9, "{by}");
        let moved = J.fixed_rows::<3>(0);
        let by = loaded.mass_matrix(&Q) - plain.mass_matrix(&Q);
        assert!((by - moved.transpose() * moved * 2.0).amax() < 1e-9, "{by}");
    }

    #[test]
    fn an_arm_upside_down_is_pulled_the_other_way() {
        let (plain, hung) = (puma(""), puma("base_rpy_deg = [180, 0, 0]"));
        assert!((plain.gravity(&Q) + hung.gravity(&Q)).amax() < 1e-9);
    }

    #[test]
    fn the_tip_of_a_tool_is_the_end_effector() {
        let tool = "tool = {tip_m = [0.0, 0.1, 0.2], rpy_deg = [0, 90, 0], mass_kg = 1.0}";
        let [tip, hand] = [tool, ""].map(|tool| puma(tool).forward_kinematics(&Q));
        let X = hand.inverse() * tip;
        assert!((X.p - Vector3::new(0.0, 0.1, 0.2)).norm() < 1e-12);
        assert!((X.R * Vector3::z() - Vector3::x()).norm() < 1e-12);
    }
}
