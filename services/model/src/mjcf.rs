//! An arm as MJCF, for a simulation in MuJoCo.

use crate::joint::{Joint, JointKind};
use crate::pose::Pose;
use crate::robot::Robot;
use std::fmt::Display;

impl Robot {
    /// The arm as MJCF: base axes, a body for each moving link, the end-effector (`frame`, or the default one) as the site `end_effector`, and the
    /// posture `start` as the key `start`.
    ///
    /// A joint's torque limit is its `actuatorfrcrange`, its speed limit the number in `user`; where there is none, there is no attribute.
    #[must_use]
    pub fn to_mjcf(&self, frame: Option<&str>, start: &[f64]) -> String {
        let frame = self.frame(frame.unwrap_or(&self.default_frame));
        let site = |joint: Option<usize>| {
            let here = frame.filter(|frame| frame.joint == joint);
            here.map_or_else(String::new, |frame| {
                format!("<site name=\"end_effector\"{}/>", pose(&frame.X_LF))
            })
        };
        let links: String = (self.joints.iter().enumerate())
            .map(|(i, joint)| body(joint) + &site(Some(i)))
            .collect();
        format!(
            "<mujoco><compiler angle=\"radian\" autolimits=\"true\"/><option gravity=\"{}\"/><worldbody>{}{links}{}</worldbody>\
             <keyframe><key name=\"start\" qpos=\"{}\"/></keyframe></mujoco>",
            numbers(&self.gravity),
            site(None),
            "</body>".repeat(self.dof()),
            numbers(start),
        )
    }
}

fn numbers<'a>(values: impl IntoIterator<Item = &'a f64>) -> String {
    let texts: Vec<String> = values.into_iter().map(f64::to_string).collect();
    texts.join(" ")
}

fn pose(X: &Pose) -> String {
    let (x, y) = (X.R.column(0), X.R.column(1));
    let axes = numbers(x.iter().chain(&y));
    format!(" pos=\"{}\" xyaxes=\"{axes}\"", numbers(&X.p))
}

fn attribute(name: &str, value: impl Display) -> String {
    let text = value.to_string().replace('&', "&amp;");
    let text = text.replace('<', "&lt;").replace('"', "&quot;");
    format!(" {name}=\"{text}\"")
}

/// A moving link and its joint, without the end of its element.
fn body(joint: &Joint) -> String {
    let kind = match joint.kind {
        JointKind::Prismatic => "slide",
        JointKind::Revolute | JointKind::Continuous => "hinge",
    };
    let range = |name, [lower, upper]: [f64; 2]| match lower.is_finite() && upper.is_finite() {
        true => attribute(name, numbers(&[lower, upper])),
        false => String::new(),
    };
    let joint_of = [
        attribute("name", &joint.name),
        attribute("type", kind),
        attribute("axis", numbers(&joint.axis)),
        attribute("armature", joint.armature),
        attribute("damping", joint.viscous_friction),
        attribute("frictionloss", joint.coulomb_friction),
        range("range", [joint.lower, joint.upper]),
        range("actuatorfrcrange", [-joint.effort, joint.effort]),
        if joint.velocity.is_finite() {
            attribute("user", joint.velocity)
        } else {
            String::new()
        },
    ];
    let I = joint.inertia;
    let inertia = [
        I[(0, 0)],
        I[(1, 1)],
        I[(2, 2)],
        I[(0, 1)],
        I[(0, 2)],
        I[(1, 2)],
    ];
    format!(
        "<body{}{}><joint{}/><inertial{}{}{}/>",
        attribute("name", &joint.link),
        pose(&joint.X_PJ),
        joint_of.concat(),
        attribute("pos", numbers(&joint.com)),
        attribute("mass", joint.mass),
        attribute("fullinertia", numbers(&inertia)),
    )
}
