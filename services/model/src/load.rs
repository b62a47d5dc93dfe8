//! From a URDF and a description to a robot: parse, check, refuse.

use crate::description::Description;
use crate::error::{Defect, RobotError, list};
use crate::factors::Factors;
use crate::joint::{Joint, JointKind};
use crate::robot::Robot;
use crate::{geometry, urdf};
use shared_types::bounds::within;
use shared_types::job::RobotText;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

impl Robot {
    /// A robot from its URDF and [description](crate::description). The same source gives the same robot.
    ///
    /// Fixed joints, and joints that the description locks, are merged into the links that move, and kept as frames. Movable joints off the
    /// way to the description's `default_frame`, and a gripper's, are held at zero, and noted. Errors: [`RobotError`].
    pub fn from_source(source: &RobotText) -> Result<Robot, RobotError> {
        read(source).map_err(|defect| RobotError::Defect {
            robot: source.name.clone(),
            defect,
        })
    }

    /// The same; of a URDF with several arms, whose description names none, the one that ends in `frame`. Errors: [`RobotError`].
    pub fn from_source_at(source: &RobotText, frame: Option<&str>) -> Result<Robot, RobotError> {
        match (Self::from_source(source), frame) {
            (
                Err(
                    error @ RobotError::Defect {
                        defect: Defect::Branches { .. },
                        ..
                    },
                ),
                Some(frame),
            ) => {
                let mut description: toml::Table = source.description.parse().map_err(|_| error)?;
                description.insert("default_frame".to_owned(), frame.into());
                Self::from_source(&RobotText {
                    description: description.to_string(),
                    ..source.clone()
                })
            }
            (made, _) => made,
        }
    }

    /// The factorisation must equal det J, or it is refused.
    fn check_factors(&self) -> Result<(), Defect> {
        let Factors::Puma { a2, a3, d4 } = self.factors else {
            return Ok(());
        };
        let scale = a2.abs() * (a3.abs() + d4.abs()) * (a2.abs() + a3.abs() + d4.abs());
        // Generic postures (multiples of an irrational), with nothing at 0 or π/2.
        for k in 0..8 {
            let q: Vec<f64> = (0..self.dof())
                .map(|i| 2.399963 * (k * 7 + i + 1) as f64 % 3.1)
                .collect();
            let (Some(product), 6) = (self.factors.determinant(&q), self.dof()) else {
                return Err(Defect::Value {
                    what: "factors.kind".to_owned(),
                    value: format!("\"puma\" for {} joints", self.dof()),
                    remedy: "it needs six joints",
                });
            };
            let J = geometry::jacobian(self, &q);
            let actual = J.fixed_columns::<6>(0).into_owned().determinant();
            if !within((actual - product).abs(), 1e-9 * scale) {
                return Err(Defect::Factors { q, actual, product });
            }
        }
        Ok(())
    }
}

fn read(source: &RobotText) -> Result<Robot, Defect> {
    let description = Description::parse(&source.name, &source.description)?;
    if is_mjcf(&source.urdf) {
        return Err(Defect::Mjcf);
    }
    let mut chain = urdf::read(&source.urdf, &description.cut())?;
    description.apply_to_joints(&mut chain.joints, &chain.names)?;
    chain.notes.extend(description.notes.iter().cloned());
    chain.joints.iter().try_for_each(check_joint)?;
    chain.notes.extend(unlimited(&chain.joints));
    chain.notes.extend(in_other_units(&chain.joints));
    let gaps = gaps(&source.name, &mut chain.joints);
    chain.notes.extend(
        gaps.iter()
            .map(|gaps| format!("it cannot move yet: {gaps}")),
    );
    let default_frame = description.default_frame.clone().unwrap_or(chain.tip);
    let length = || geometry::default_length(&chain.joints, &chain.frames, &default_frame);
    let mut robot = Robot {
        name: source.name.clone(),
        length_m: description.length_m.unwrap_or_else(length),
        joints: chain.joints,
        frames: chain.frames,
        shapes: chain.shapes,
        gravity: description.gravity.unwrap_or([0.0, 0.0, -9.81]).into(),
        gaps,
        factors: description.factors,
        default_frame,
        task: crate::TaskAxes::ALL,
        postures: BTreeMap::new(),
        encoder_bits: description.encoder_bits.unwrap_or(16),
        notes: chain.notes,
        meshes: source.folder.join(&description.meshes),
        source: source.clone(),
    };
    robot.task = geometry::served_axes(&robot);
    let served = robot.task.count();
    if served < 6 && robot.dof() > 3 && description.task.is_none() {
        let names = robot
            .task
            .iter()
            .map(|axis| format!("{axis:?}").to_lowercase());
        let names = names.collect::<Vec<_>>().join(", ");
        robot.notes.push(if served < robot.dof() {
            format!("the task is {names}: no other axis is independent of these wherever the arm faces; state `task` in the description for others")
        } else {
            format!("the task is {names}: the arm has no joint for another axis, whose motion is as the others make it")
        });
    }
    description.apply(&mut robot)?;
    robot.check_factors()?;
    Ok(robot)
}

/// Whether a text is MuJoCo's.
fn is_mjcf(text: &str) -> bool {
    let mut tags = text.split('<').skip(1);
    let is_element = |tag: &&str| tag.starts_with(|first: char| first.is_alphabetic());
    tags.find(is_element)
        .is_some_and(|tag| tag.starts_with("mujoco"))
}

/// The names of the joints that are so, where there are any.
fn listed(joints: &[Joint], is_so: impl Fn(&Joint) -> bool) -> Option<String> {
    let names: Vec<_> = joints.iter().filter(|joint| is_so(joint)).collect();
    (!names.is_empty()).then(|| list(names.iter().map(|joint| &joint.name)))
}

/// The limits that are not stated, of speed and of torque. A continuous joint without any needs none.
fn unlimited(joints: &[Joint]) -> impl Iterator<Item = String> {
    let unknown = |what: &str, key: &str, limit: fn(&Joint) -> f64| {
        let names = listed(joints, |joint| {
            joint.kind != JointKind::Continuous && limit(joint).is_infinite()
        })?;
        Some(format!(
            "the {what} limits of {names} are unknown: state `{key}` under `[joints.NAME]` in the description"
        ))
    };
    let torques = unknown("torque", "effort", |joint| joint.effort);
    let speeds = unknown("speed", "velocity", |joint| joint.velocity);
    torques.into_iter().chain(speeds)
}

/// Limits that look like degrees, and lengths that look like millimetres.
fn in_other_units(joints: &[Joint]) -> impl Iterator<Item = String> {
    // No cable lasts four turns; a thousand rad and more mean no limit.
    const TURNS: std::ops::Range<f64> = 4.0 * TAU..1e3;
    const LONG_M: f64 = 20.0;
    let turns_far = |joint: &Joint| {
        let limits = [joint.lower, joint.upper];
        joint.kind == JointKind::Revolute && limits.iter().all(|one| TURNS.contains(&one.abs()))
    };
    let limits = listed(joints, turns_far).map(|names| {
        format!("the limits of {names} are over four turns: are they in degrees? A URDF has rad")
    });
    let lengths = listed(joints, |joint| joint.X_PJ.p.norm() > LONG_M).map(|names| {
        format!("the distances to the joint before of {names} are over 20 m: are they in mm? A URDF has m")
    });
    limits.into_iter().chain(lengths)
}

/// The gaps of an arm that is to move, with a block to fill in; its joints have no such limits then. `None` where there are none.
fn gaps(robot: &str, joints: &mut [Joint]) -> Option<String> {
    let (mut limits, mut links) = (String::new(), Vec::new());
    for joint in joints {
        let mut keys = Vec::new();
        if joint.lower == joint.upper {
            (joint.lower, joint.upper) = (f64::NEG_INFINITY, f64::INFINITY);
            keys.extend(["lower =      # rad", "upper =      # rad"]);
        }
        for (value, key) in [
            (&mut joint.effort, "effort =     # N·m"),
            (&mut joint.velocity, "velocity =   # rad/s"),
        ] {
            if *value == 0.0 {
                *value = f64::INFINITY;
                keys.push(key);
            }
        }
        if !keys.is_empty() {
            joint.torque_rate = f64::INFINITY;
            limits += &format!("\n  [joints.{:?}]\n  {}", joint.name, keys.join("\n  "));
        }
        if joint.mass.is_nan() {
            links.push(joint.link.clone());
        }
    }
    let mut parts = Vec::new();
    if !links.is_empty() {
        parts.push(format!(
            "the mass of what moves is unknown: give the links {}, or what is fixed to them, an <inertial> with mass, centre of mass and inertia",
            list(links)
        ));
    }
    if !limits.is_empty() {
        parts.push(format!(
            "limits are missing or zero: fill them in below in {robot}.toml beside the arm's file (inf for none){limits}"
        ));
    }
    (!parts.is_empty()).then(|| parts.join("; and "))
}

/// Refuses what no arm can have; what is missing, as zero or an empty range, is in [`gaps`].
fn check_joint(joint: &Joint) -> Result<(), Defect> {
    const RANGE: &str = "state lower < upper in the URDF's <limit>, or in the description (ARM.toml beside ARM.urdf)";
    const MOST: &str = "state a positive number (or inf) in the URDF's <limit>, or in the description (ARM.toml beside ARM.urdf)";
    const PART: &str = "state a finite number, zero or more";
    let (lower, upper, rate) = (joint.lower, joint.upper, joint.torque_rate);
    let number = |what, value: f64, holds, remedy| (what, value.to_string(), holds, remedy);
    let most = |what, value| number(what, value, value >= 0.0, MOST);
    let part = |what, value| number(what, value, (0.0..f64::INFINITY).contains(&value), PART);
    // It follows from the torque limit, and is unknown where that is.
    let has_rate = rate > 0.0 || rate == 0.0 && joint.effort == 0.0;
    Defect::check(
        &format!("joint '{}' has ", joint.name),
        [
            (
                "range",
                format!("{lower} to {upper}"),
                lower < f64::INFINITY && upper >= lower,
                RANGE,
            ),
            most("effort", joint.effort),
            number("torque_rate", rate, has_rate, MOST),
            most("velocity", joint.velocity),
            part("armature", joint.armature),
            part("viscous_friction", joint.viscous_friction),
            part("coulomb_friction", joint.coulomb_friction),
        ],
    )
}
