//! Properties of an arm that a URDF has no element for, in TOML beside it. Every key is optional; unknown keys are refused.
//!
//! ```toml
//! default_frame = "flange"          # end-effector frame: a link of the URDF. Default: the chain's last link
//! base_frame = "torso_lift_link"    # the arm's base: a link of the URDF. Default: the URDF's root
//! gravity = [0.0, 0.0, -9.81]       # m/s², base axes. Default as shown
//! length_m = 0.43                   # makes radians and metres comparable. Default: half the sum of the link lengths
//! encoder_bits = 16                 # per turn, 1 to 32. Default 16
//! task = ["x", "y", "z", "rx", "ry", "rz"]   # task axes served. Default: those that move, in this order, at most one per joint
//!
//! [factors]                         # analytic factors of det J. Default: none, singularities are found numerically
//! kind = "puma"                     # the only kind; a2, a3, d4 in m, modified DH. Checked against the geometry
//! a2 = 0.4318
//! a3 = -0.0203
//! d4 = 0.4331
//!
//! [joints.joint1]                   # by the URDF's name
//! armature = 1.14                   # reflected rotor inertia G²·J_m, kg·m². Default 0
//! viscous_friction = 5.8            # N·m·s/rad. Default: the URDF's <dynamics damping>
//! coulomb_friction = 6.3            # N·m. Default: the URDF's <dynamics friction>
//! lower = -2.79                     # rad (inf allowed), instead of the URDF's, as are the next three
//! upper = 2.79
//! effort = 97.6                     # N·m
//! velocity = 1.92                   # rad/s
//! torque_rate = 1000.0              # N·m/s that the drive accepts (inf allowed). Default: the torque limit in 20 ms
//! locked = 0.5                      # rad: the joint is no joint of the arm but fixed there. Default: free. No other key beside it
//!
//! [postures]                        # by name, rad, within the limits. Default: `middle` of the limits (0 where there are none)
//! ready = [0.0, -1.57, 1.57, 0.0, 0.0, 0.0]
//! ```
//!
//! A URDF without a description works with these defaults: no armature, no friction beyond its `<dynamics>`.
//! `continuous` joints without a `<limit>` have no limits of position, torque or speed.

use crate::error::{DescriptionError, RobotError, list};
use crate::factors::Factors;
use crate::joint::Joint;
use crate::robot::Robot;
use crate::task::{TaskAxes, TaskAxis};
use crate::urdf::Cut;
use serde::Deserialize;
use std::collections::BTreeMap;

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct Description {
    pub(crate) default_frame: Option<String>,
    base_frame: Option<String>,
    gravity: Option<[f64; 3]>,
    length_m: Option<f64>,
    encoder_bits: Option<u32>,
    task: Option<Vec<TaskAxis>>,
    factors: Option<FactorsTable>,
    joints: BTreeMap<String, JointTable>,
    postures: BTreeMap<String, Vec<f64>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, tag = "kind", rename_all = "lowercase")]
enum FactorsTable {
    Puma { a2: f64, a3: f64, d4: f64 },
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct JointTable {
    armature: Option<f64>,
    viscous_friction: Option<f64>,
    coulomb_friction: Option<f64>,
    lower: Option<f64>,
    upper: Option<f64>,
    effort: Option<f64>,
    velocity: Option<f64>,
    torque_rate: Option<f64>,
    locked: Option<f64>,
}

/// The torque limit over this time is the default torque rate, s.
const RISE_S: f64 = 0.02;

impl Description {
    pub(crate) fn parse(text: &str) -> Result<Self, DescriptionError> {
        toml::from_str(text).map_err(|error| DescriptionError(error.to_string()))
    }

    /// The part of the URDF that is the arm.
    pub(crate) fn cut(&self) -> Cut<'_> {
        Cut {
            base: self.base_frame.as_deref(),
            end: self.default_frame.as_deref(),
            locked: self
                .joints
                .iter()
                .filter_map(|(name, table)| Some((name.as_str(), table.locked?)))
                .collect(),
        }
    }

    pub(crate) fn apply_to_joints(
        &self,
        robot: &str,
        joints: &mut [Joint],
    ) -> Result<(), RobotError> {
        for joint in joints.iter_mut() {
            joint.torque_rate = self
                .joints
                .get(&joint.name)
                .and_then(|table| table.effort)
                .unwrap_or(joint.effort)
                / RISE_S;
        }
        for (name, table) in self
            .joints
            .iter()
            .filter(|(_, table)| table.locked.is_none())
        {
            let known = list(joints.iter().map(|joint| &joint.name));
            let Some(joint) = joints.iter_mut().find(|joint| joint.name == *name) else {
                return Err(RobotError::UnknownJoint {
                    robot: robot.to_owned(),
                    joint: name.clone(),
                    known,
                });
            };
            for (stated, value) in [
                (table.armature, &mut joint.armature),
                (table.viscous_friction, &mut joint.viscous_friction),
                (table.coulomb_friction, &mut joint.coulomb_friction),
                (table.lower, &mut joint.lower),
                (table.upper, &mut joint.upper),
                (table.effort, &mut joint.effort),
                (table.velocity, &mut joint.velocity),
                (table.torque_rate, &mut joint.torque_rate),
            ] {
                *value = stated.unwrap_or(*value);
            }
        }
        Ok(())
    }

    pub(crate) fn apply(self, robot: &mut Robot) -> Result<(), RobotError> {
        let refuse = |what, value: String, remedy: &str| {
            Err(RobotError::Value {
                robot: robot.name.clone(),
                what,
                value,
                remedy: remedy.to_owned(),
            })
        };
        if let Some(gravity) = self.gravity {
            if !gravity.iter().all(|g| g.is_finite()) {
                return refuse(
                    "gravity",
                    format!("{gravity:?}"),
                    "give three finite numbers, m/s²",
                );
            }
            robot.gravity = gravity.into();
        }
        if let Some(length_m) = self.length_m {
            if !(length_m > 0.0 && length_m.is_finite()) {
                return refuse(
                    "length_m",
                    length_m.to_string(),
                    "give a positive length in metres",
                );
            }
            robot.length_m = length_m;
        }
        if let Some(bits) = self.encoder_bits {
            if !(1..=32).contains(&bits) {
                return refuse(
                    "encoder_bits",
                    bits.to_string(),
                    "give 1 to 32 bits per turn",
                );
            }
            robot.encoder_bits = bits;
        }
        if let Some(task) = self.task {
            let axes: TaskAxes = task.iter().copied().collect();
            if axes.count() != task.len() || task.is_empty() || task.len() > robot.dof() {
                return refuse(
                    "task",
                    format!("{task:?}"),
                    "name each axis once, and at most as many as there are joints",
                );
            }
            robot.task = axes;
        }
        if let Some(FactorsTable::Puma { a2, a3, d4 }) = self.factors {
            if ![a2, a3, d4].iter().all(|length| length.is_finite()) {
                return refuse(
                    "factors",
                    format!("{:?}", [a2, a3, d4]),
                    "give finite lengths in metres",
                );
            }
            robot.factors = Factors::Puma { a2, a3, d4 };
        }
        robot.postures = self.postures;
        if robot.postures.is_empty() {
            robot.postures.insert("middle".to_owned(), robot.middle());
        }
        for (name, q) in &robot.postures {
            robot
                .check_posture(q)
                .map_err(|reason| RobotError::Posture {
                    robot: robot.name.clone(),
                    name: name.clone(),
                    reason,
                })?;
        }
        Ok(())
    }
}
