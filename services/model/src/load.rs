//! From a URDF and a description to a robot: parse, check, refuse.

use crate::description::Description;
use crate::error::{Defect, RobotError, list};
use crate::factors::Factors;
use crate::joint::{Joint, JointKind};
use crate::robot::Robot;
use crate::{geometry, urdf};
use nalgebra::Vector3;
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
        let branches = |error: &RobotError| {
            let RobotError::Defect { defect, .. } = error else {
                return false;
            };
            matches!(defect, Defect::Branches { .. })
        };
        match (Self::from_source(source), frame) {
            (Err(error), Some(frame)) if branches(&error) => {
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
            let J = geometry::jacobian(self, &q);
            let (Some(product), Ok(square)) = (
                self.factors.determinant(&q),
                <[_; 6]>::try_from(J.as_slice()),
            ) else {
                return Err(Defect::Value {
                    what: "factors.kind".to_owned(),
                    value: format!("\"puma\" for {} joints", self.dof()),
                    remedy: "it needs six joints",
                });
            };
            let actual = nalgebra::Matrix6::from_columns(&square).determinant();
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
    let mut robot = Robot {
        name: source.name.clone(),
        length_m: geometry::default_length(&chain.joints, &chain.frames, &default_frame),
        joints: chain.joints,
        frames: chain.frames,
        shapes: chain.shapes,
        gravity: Vector3::new(0.0, 0.0, -9.81),
        gaps,
        factors: Factors::Numeric,
        default_frame,
        task: crate::TaskAxes::ALL,
        postures: BTreeMap::new(),
        encoder_bits: 16,
        notes: chain.notes,
        meshes: source.folder.join(&description.meshes),
        source: source.clone(),
    };
    robot.task = geometry::served_axes(&robot);
    let served = robot.task.count();
    if served < robot.dof().min(6) && robot.dof() > 3 {
        let names = robot
            .task
            .iter()
            .map(|axis| format!("{axis:?}").to_lowercase());
        robot.notes.push(format!(
            "the task is {}: no other axis is independent of these wherever the arm faces; state `task` in the description for others",
            names.collect::<Vec<_>>().join(", ")
        ));
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

/// The limits that are not stated, of speed and of torque. A continuous joint without any needs none.
fn unlimited(joints: &[Joint]) -> impl Iterator<Item = String> {
    let of = |effort: bool, joint: &Joint| if effort { joint.effort } else { joint.velocity };
    let kinds = [("torque", "effort", true), ("speed", "velocity", false)];
    kinds.into_iter().filter_map(move |(what, key, effort)| {
        let is_unlimited = |joint: &&Joint| {
            joint.kind != JointKind::Continuous && of(effort, joint).is_infinite()
        };
        let names = joints.iter().filter(is_unlimited);
        let names: Vec<_> = names.map(|joint| &joint.name).collect();
        (!names.is_empty()).then(|| {
            format!(
                "the {what} limits of {} are unknown: state `{key}` under `[joints.NAME]` in the description",
                list(names)
            )
        })
    })
}

/// Limits that look like degrees, and lengths that look like millimetres.
fn in_other_units(joints: &[Joint]) -> impl Iterator<Item = String> {
    // No cable lasts four turns; a thousand rad and more mean no limit.
    const TURNS: std::ops::Range<f64> = 4.0 * TAU..1e3;
    const LONG_M: f64 = 20.0;
    let named = |is_odd: fn(&Joint) -> bool| {
        let odd = joints.iter().filter(move |joint| is_odd(joint));
        odd.map(|joint| &joint.name).collect::<Vec<_>>()
    };
    let turning = named(|joint| {
        joint.kind == JointKind::Revolute
            && [joint.lower, joint.upper]
                .iter()
                .all(|limit| TURNS.contains(&limit.abs()))
    });
    let long = named(|joint| joint.X_PJ.p.norm() > LONG_M);
    let words = [
        (
            turning,
            "limits",
            "are over four turns: are they in degrees? A URDF has rad",
        ),
        (
            long,
            "distances to the joint before",
            "are over 20 m: are they in mm? A URDF has m",
        ),
    ];
    words.into_iter().filter_map(|(names, what, why)| {
        (!names.is_empty()).then(|| format!("the {what} of {} {why}", list(names)))
    })
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
    let (lower, upper) = (joint.lower, joint.upper);
    if !(lower < f64::INFINITY && upper >= lower) {
        let remedy = "state lower < upper in the URDF's <limit>, or in the description (ARM.toml beside ARM.urdf)";
        let given = format!("{lower} to {upper}");
        return Err(Defect::of_joint(&joint.name, "range", given, remedy));
    }
    for (what, value) in [
        ("effort", joint.effort),
        ("torque_rate", joint.torque_rate),
        ("velocity", joint.velocity),
    ] {
        let is_unknown = value == 0.0 && joint.effort == 0.0;
        if value.is_nan() || value < 0.0 || what == "torque_rate" && value == 0.0 && !is_unknown {
            let remedy = "state a positive number (or inf) in the URDF's <limit>, or in the description (ARM.toml beside ARM.urdf)";
            return Err(Defect::of_joint(&joint.name, what, value, remedy));
        }
    }
    for (what, value) in [
        ("armature", joint.armature),
        ("viscous_friction", joint.viscous_friction),
        ("coulomb_friction", joint.coulomb_friction),
    ] {
        if !(value >= 0.0 && value.is_finite()) {
            let remedy = "state a finite number, zero or more";
            return Err(Defect::of_joint(&joint.name, what, value, remedy));
        }
    }
    Ok(())
}
