//! Properties of an arm for which URDF and MJCF have no element, in a TOML file beside it. Every key is optional; unknown
//! keys are refused.
//!
//! ```toml
//! default_frame = "flange"          # end-effector frame: a link of the URDF. Default: the chain's last link
//! base_frame = "torso_lift_link"    # the arm's base: a link of the URDF. Default: the URDF's root
//! gravity = [0.0, 0.0, -9.81]       # m/s², base axes. Default as shown
//! base_rpy_deg = [180.0, 0.0, 0.0]  # roll, pitch, yaw of the base in the world, which turn gravity. Default: upright
//! length_m = 0.43                   # makes radians and metres comparable. Default: half the sum of the link lengths
//! encoder_bits = 16                 # per turn, 1 to 32. Default 16
//! task = ["x", "y", "z", "rx", "ry", "rz"]   # task axes. Default: those that can move wherever the arm faces, in this order, at most one per joint
//! meshes = "."                      # folder from which the paths of meshes start. Default: that of the URDF
//!
//! [factors]                         # analytic factors of det J, for `sweep` and for its sign. Default: none
//! kind = "puma"                     # the only kind; a2, a3, d4 in m, modified DH. Checked against the geometry
//! a2 = 0.4318
//! a3 = -0.0203
//! d4 = 0.4331
//!
//! [joints.joint1]                   # by the URDF's name
//! armature = 1.14                   # reflected rotor inertia G²·J_m, kg·m². Default 0
//! viscous_friction = 5.8            # N·m·s/rad. Default: the URDF's <dynamics damping>
//! coulomb_friction = 6.3            # N·m. Default: the URDF's <dynamics friction>
//! lower = -2.79                     # rad (inf allowed). Default: the URDF's; so for the next three
//! upper = 2.79
//! effort = 97.6                     # N·m
//! velocity = 1.92                   # rad/s
//! torque_rate = 1000.0              # N·m/s that the drive accepts (inf allowed). Default: the torque limit in 20 ms
//! locked = 0.5                      # rad: fixes the joint there, without any other key beside it. Default: free
//!
//! [tool]                            # on the default frame; its tip becomes the end-effector. Default: none
//! tip_m = [0.0, 0.0, 0.12]          # in the hand's axes; so com_m
//! rpy_deg = [0.0, 0.0, 0.0]
//! mass_kg = 0.8
//! com_m = [0.0, 0.0, 0.05]
//!
//! [payload]                         # a point mass, in the axes of the end-effector. Default: none
//! mass_kg = 2.0
//! com_m = [0.0, 0.0, 0.05]
//!
//! [postures]                        # by name, rad, within the limits. Default: `middle` of the limits (0 where there are none)
//! ready = [0.0, -1.57, 1.57, 0.0, 0.0, 0.0]
//! ```
//!
//! MuJoCo makes a URDF and a description of an arm in MJCF (`pip install mujoco`): links are its bodies and sites, postures its keys, and a description
//! beside the file adds to its own. `continuous` joints without a `<limit>` have no limits of position, torque or speed.

use crate::error::{Defect, list};
use crate::factors::Factors;
use crate::joint::Joint;
use crate::pose::Pose;
use crate::robot::Robot;
use crate::task::TaskAxis;
use crate::urdf::Cut;
use serde::Deserialize;
use shared_types::file;
use shared_types::scenario::{Payload, Tool};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct Description {
    pub(crate) default_frame: Option<String>,
    base_frame: Option<String>,
    pub(crate) gravity: Option<[f64; 3]>,
    base_rpy_deg: [f64; 3],
    tool: Option<Tool>,
    payload: Option<Payload>,
    pub(crate) length_m: Option<f64>,
    pub(crate) encoder_bits: Option<u32>,
    pub(crate) task: Option<Vec<TaskAxis>>,
    pub(crate) meshes: PathBuf,
    pub(crate) factors: Factors,
    joints: BTreeMap<String, JointTable>,
    postures: BTreeMap<String, Posture>,
    /// Parts of a file of another format that are left out, a sentence each.
    pub(crate) notes: Vec<String>,
}

/// The positions of the joints of the chain, or of all joints by their names: a key of MJCF, of whose joints some are the chain's.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Posture {
    List(Vec<f64>),
    ByJoint(BTreeMap<String, f64>),
}

impl Posture {
    /// The positions of the chain's joints; `None` where one of them has none.
    fn of_chain(self, joints: &[Joint]) -> Option<Vec<f64>> {
        match self {
            Self::List(q) => Some(q),
            Self::ByJoint(all) => (joints.iter())
                .map(|joint| all.get(&joint.name).copied())
                .collect(),
        }
    }
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

/// The description `own` with what `over` states in place of its own: a key, or one of a joint, or a posture.
///
/// # Errors
/// [`Defect::Description`] where one of them is no TOML.
pub fn merged(own: &str, over: &str) -> Result<String, Defect> {
    let table = |text: &str| {
        let table = text.parse::<toml::Table>();
        table.map_err(|error| Defect::Description(error.to_string()))
    };
    let mut all = table(own)?;
    lay_over(&mut all, table(over)?);
    Ok(all.to_string())
}

fn lay_over(all: &mut toml::Table, over: toml::Table) {
    for (key, value) in over {
        match (all.get_mut(&key), value) {
            (Some(toml::Value::Table(inner)), toml::Value::Table(over)) => lay_over(inner, over),
            (_, value) => {
                all.insert(key, value);
            }
        }
    }
}

impl Description {
    /// Of the arm of this name.
    pub(crate) fn parse(name: &str, text: &str) -> Result<Self, Defect> {
        file::parse(&format!("{name}.toml"), text, &[])
            .map_err(|error| Defect::Description(error.to_string()))
    }

    /// The part of the URDF that is the arm.
    pub(crate) fn cut(&self) -> Cut<'_> {
        let locked = self.joints.iter();
        Cut {
            base: self.base_frame.as_deref(),
            end: self.default_frame.as_deref(),
            locked: locked
                .filter_map(|(name, table)| Some((name.as_str(), table.locked?)))
                .collect(),
        }
    }

    /// `names` are those of all joints of the file: of one that is not in the chain nothing has to be known.
    pub(crate) fn apply_to_joints(
        &self,
        joints: &mut [Joint],
        names: &BTreeSet<String>,
    ) -> Result<(), Defect> {
        let tables = self.joints.iter();
        let mut tables: BTreeMap<_, _> = tables.filter(|(_, t)| t.locked.is_none()).collect();
        for joint in joints.iter_mut() {
            let Some(table) = tables.remove(&joint.name) else {
                joint.torque_rate = joint.effort / RISE_S;
                continue;
            };
            for (stated, value) in [
                (table.armature, &mut joint.armature),
                (table.viscous_friction, &mut joint.viscous_friction),
                (table.coulomb_friction, &mut joint.coulomb_friction),
                (table.lower, &mut joint.lower),
                (table.upper, &mut joint.upper),
                (table.effort, &mut joint.effort),
                (table.velocity, &mut joint.velocity),
            ] {
                *value = stated.unwrap_or(*value);
            }
            joint.torque_rate = table.torque_rate.unwrap_or(joint.effort / RISE_S);
        }
        match tables.keys().find(|name| !names.contains(**name)) {
            None => Ok(()),
            Some(name) => Err(Defect::UnknownJoint {
                joint: (*name).clone(),
                known: list(names),
            }),
        }
    }

    pub(crate) fn apply(self, robot: &mut Robot) -> Result<(), Defect> {
        if self.base_rpy_deg != [0.0; 3] {
            let rpy = self.base_rpy_deg.map(f64::to_radians);
            let X_WB = Pose::from_xyz_rpy([0.0; 3], rpy);
            robot.gravity = X_WB.R.transpose() * robot.gravity;
        }
        self.tool.map_or(Ok(()), |tool| robot.take_tool(&tool))?;
        let load = |load: Payload| robot.take_payload(None, &load);
        self.payload.map_or(Ok(()), load)?;
        let task = self.task.unwrap_or_else(|| robot.task.iter().collect());
        robot.task = task.iter().copied().collect();
        let lengths = match self.factors {
            Factors::Puma { a2, a3, d4 } => [a2, a3, d4],
            Factors::Numeric => [0.0; 3],
        };
        check_values(robot, &task, lengths)?;
        for (name, posture) in self.postures {
            let is_key = matches!(posture, Posture::ByJoint(_));
            let Some(q) = posture.of_chain(&robot.joints) else {
                continue;
            };
            match robot.check_posture(&q) {
                Err(reason) if is_key => {
                    let note = format!("posture '{name}' is left out: {reason}");
                    robot.notes.push(note);
                }
                _ => drop(robot.postures.insert(name, q)),
            }
        }
        if robot.postures.is_empty() {
            robot.postures.insert("middle".to_owned(), robot.middle());
        }
        for (name, q) in &robot.postures {
            let refuse = |reason| Defect::Posture {
                name: name.clone(),
                reason,
            };
            robot.check_posture(q).map_err(refuse)?;
        }
        Ok(())
    }
}

/// Whether every value is one of an arm; `lengths` are those of its factors.
fn check_values(robot: &Robot, task: &[TaskAxis], lengths: [f64; 3]) -> Result<(), Defect> {
    let are_finite = |values: &[f64]| values.iter().all(|x| x.is_finite());
    let (gravity, length_m, bits) = (robot.gravity, robot.length_m, robot.encoder_bits);
    let values = [
        (
            "gravity",
            format!("{:?}", gravity.as_slice()),
            are_finite(gravity.as_slice()),
            "give three finite numbers, m/s²",
        ),
        (
            "length_m",
            length_m.to_string(),
            length_m > 0.0 && length_m.is_finite(),
            "give a positive length in metres",
        ),
        (
            "encoder_bits",
            bits.to_string(),
            (1..=32).contains(&bits),
            "give 1 to 32 bits per turn",
        ),
        (
            "task",
            format!("{task:?}"),
            (1..=robot.dof()).contains(&task.len()) && robot.task.count() == task.len(),
            "name each axis once, and at most as many as there are joints",
        ),
        (
            "factors",
            format!("{lengths:?}"),
            are_finite(&lengths),
            "give finite lengths in metres",
        ),
    ];
    Defect::check("", values)
}
