//! From a URDF and a description to a robot: parse, check, refuse.

use crate::description::Description;
use crate::error::RobotError;
use crate::factors::Factors;
use crate::joint::Joint;
use shared_types::job::RobotText;

use crate::robot::Robot;
use crate::task::TaskAxes;
use crate::{geometry, urdf};
use nalgebra::Vector3;
use shared_types::bounds::within;
use std::collections::BTreeMap;

impl Robot {
    /// A robot from its URDF and [description](crate::description). The same source gives the same robot.
    ///
    /// Fixed joints, and joints that the description locks, are merged into the links that move, and kept as frames. Movable joints off the
    /// way to the description's `default_frame`, and a gripper's, are held at zero, and noted. Errors: [`RobotError`].
    pub fn from_source(source: &RobotText) -> Result<Robot, RobotError> {
        let name = source.name.clone();
        let description =
            Description::parse(&source.description).map_err(|reason| RobotError::Description {
                robot: name.clone(),
                reason,
            })?;
        let mut chain = urdf::read(&name, &source.urdf, &description.cut())?;
        description.apply_to_joints(&name, &mut chain.joints)?;
        chain
            .joints
            .iter()
            .try_for_each(|joint| check_joint(&name, joint))?;

        let default_frame = description.default_frame.clone().unwrap_or(chain.tip);
        let mut robot = Robot {
            name,
            length_m: geometry::default_length(&chain.joints, &chain.frames, &default_frame),
            joints: chain.joints,
            frames: chain.frames,
            shapes: chain.shapes,
            gravity: Vector3::new(0.0, 0.0, -9.81),
            factors: Factors::Numeric,
            default_frame,
            task: TaskAxes::ALL,
            postures: BTreeMap::new(),
            encoder_bits: 16,
            notes: chain.notes,
            source: source.clone(),
        };
        robot.task = geometry::served_axes(&robot);
        description.apply(&mut robot)?;
        robot.check_factors()?;
        Ok(robot)
    }

    /// The factorisation must equal det J, or it is refused.
    fn check_factors(&self) -> Result<(), RobotError> {
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
                return Err(RobotError::Value {
                    robot: self.name.clone(),
                    what: "factors.kind",
                    value: "\"puma\"".to_owned(),
                    remedy: format!("it needs six joints, and this arm has {}", self.dof()),
                });
            };
            let actual = nalgebra::Matrix6::from_columns(&square).determinant();
            if !within((actual - product).abs(), 1e-9 * scale) {
                return Err(RobotError::Factors {
                    robot: self.name.clone(),
                    q,
                    actual,
                    product,
                });
            }
        }
        Ok(())
    }
}

fn check_joint(robot: &str, joint: &Joint) -> Result<(), RobotError> {
    let refuse = |what, value: f64, remedy| {
        Err(RobotError::Joint {
            robot: robot.to_owned(),
            joint: joint.name.clone(),
            what,
            value: value.to_string(),
            remedy,
        })
    };
    let limits = "state a range, lower < upper, in the URDF's <limit> or in the description";
    if joint.lower.is_nan() || joint.lower == f64::INFINITY {
        return refuse("lower", joint.lower, limits);
    }
    if joint.upper.is_nan() || joint.upper <= joint.lower {
        return refuse("upper", joint.upper, limits);
    }
    let positive = "state a positive number (or inf) in the URDF's <limit> or in the description";
    if joint.effort.is_nan() || joint.effort <= 0.0 {
        return refuse("effort", joint.effort, positive);
    }
    if joint.torque_rate.is_nan() || joint.torque_rate <= 0.0 {
        return refuse(
            "torque_rate",
            joint.torque_rate,
            "state a positive number (or inf) in the description",
        );
    }
    if joint.velocity.is_nan() || joint.velocity <= 0.0 {
        return refuse("velocity", joint.velocity, positive);
    }
    let not_negative = "state a finite number, zero or more";
    for (what, value) in [
        ("armature", joint.armature),
        ("viscous_friction", joint.viscous_friction),
        ("coulomb_friction", joint.coulomb_friction),
    ] {
        if !(value >= 0.0 && value.is_finite()) {
            return refuse(what, value, not_negative);
        }
    }
    Ok(())
}
