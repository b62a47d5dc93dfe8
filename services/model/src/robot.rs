//! The arm as data.

use crate::error::{Defect, PostureError, RobotError, list};
use crate::factors::Factors;
use crate::joint::{Frame, Joint, JointKind};
use crate::shape::Shape;
use crate::task::TaskAxes;
use nalgebra::Vector3;
use shared_types::job::RobotText;
use shared_types::scenario::Start;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A serial arm as data: valid by construction, whatever it was read from.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// The robot's name.
    pub name: String,
    /// The joints and moving links, from the base outwards.
    pub joints: Vec<Joint>,
    /// Every link of the URDF on or fixed to the chain, as a frame.
    pub frames: Vec<Frame>,
    /// Visual geometry; mesh files are named, and not read.
    pub shapes: Vec<Shape>,
    /// Acceleration of gravity, base axes, m/s².
    pub gravity: Vector3<f64>,
    /// The length that makes radians and metres comparable in unit-scaled singular values, m.
    pub length_m: f64,
    /// The analytic factorisation of det J, if one holds.
    pub factors: Factors,
    /// The end-effector frame, unless another is asked for.
    pub default_frame: String,
    /// The task axes this arm serves.
    pub task: TaskAxes,
    /// Named postures, each within the limits, rad.
    pub postures: BTreeMap<String, Vec<f64>>,
    /// Resolution of the joint encoders, bits per turn.
    pub encoder_bits: u32,
    /// The gaps of an arm that is to move, as [`complete`](Self::complete) refuses it.
    pub(crate) gaps: Option<String>,
    /// Assumptions and omissions of the reading, one sentence each, for display.
    pub notes: Vec<String>,
    /// The folder from which the paths of mesh files start.
    pub meshes: PathBuf,
    /// The text it was made of.
    pub source: RobotText,
}

impl Robot {
    /// Whether all is known that its motion depends on: masses and limits. Kinematics and singularities need none of them; what depends on an unknown
    /// mass is NaN.
    ///
    /// Errors: [`RobotError`] with all gaps at once, and a block of the description to fill in.
    pub fn complete(&self) -> Result<(), RobotError> {
        self.gaps.as_ref().map_or(Ok(()), |gaps| {
            Err(RobotError::Defect {
                robot: self.name.clone(),
                defect: Defect::Gaps(gaps.clone()),
            })
        })
    }

    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.joints.len()
    }

    /// The middle of the joints' ranges, rad; as near to zero as the limits allow where there is only one.
    pub fn middle(&self) -> Vec<f64> {
        let middle = |joint: &Joint| match 0.5 * (joint.lower + joint.upper) {
            middle if middle.is_finite() => middle,
            _ => 0.0_f64.clamp(joint.lower, joint.upper),
        };
        self.joints.iter().map(middle).collect()
    }

    /// The frame of that name.
    pub fn frame(&self, name: &str) -> Option<&Frame> {
        self.frames.iter().find(|frame| frame.name == name)
    }

    /// The frames' names, separated by commas.
    pub fn frame_names(&self) -> String {
        list(self.frames.iter().map(|frame| &frame.name))
    }

    /// Whether `q` is a posture of this robot: one finite value per joint, inside the limits.
    ///
    /// Errors: [`PostureError`], which names the first joint that is not.
    pub fn check_posture(&self, q: &[f64]) -> Result<(), PostureError> {
        if q.len() != self.dof() {
            return Err(PostureError::Length {
                actual: q.len(),
                expected: self.dof(),
                joints: list(self.joints.iter().map(|joint| &joint.name)),
            });
        }
        match self.misfit(q) {
            None => Ok(()),
            Some((joint, value)) if value.is_finite() => Err(PostureError::OutsideLimits {
                joint: joint.name.clone(),
                kind: joint.kind,
                value,
                lower: joint.lower,
                upper: joint.upper,
            }),
            Some((joint, value)) => Err(PostureError::NotFinite {
                joint: joint.name.clone(),
                value,
            }),
        }
    }

    /// The first joint whose position in `q` is not finite or not within its limits, with that position. No allocation.
    pub fn misfit(&self, q: &[f64]) -> Option<(&Joint, f64)> {
        let fits = |(joint, value): &(&Joint, f64)| {
            value.is_finite() && (joint.lower..=joint.upper).contains(value)
        };
        let given = self.joints.iter().zip(q.iter().copied());
        given.into_iter().find(|one| !fits(one))
    }

    /// The posture a scenario starts in, checked against length and limits; rad (m for prismatic joints).
    ///
    /// Errors: [`PostureError`], also for degrees of a joint that slides.
    pub fn start_posture(&self, start: &Start) -> Result<Vec<f64>, PostureError> {
        let named = |name: &String| {
            let unknown = || PostureError::Unknown {
                robot: self.name.clone(),
                name: name.clone(),
                known: list(self.postures.keys()),
            };
            self.postures.get(name).cloned().ok_or_else(unknown)
        };
        let slides = |joint: &&Joint| joint.kind == JointKind::Prismatic;
        let q = match (&start.q, &start.q_deg, &start.posture) {
            (Some(q), _, _) => q.clone(),
            (None, Some(q), _) => match self.joints.iter().find(slides) {
                Some(joint) => {
                    let joint = joint.name.clone();
                    return Err(PostureError::Degrees { joint });
                }
                None => q.iter().map(|value| value.to_radians()).collect(),
            },
            (None, None, Some(name)) => named(name)?,
            (None, None, None) => return Err(PostureError::Missing),
        };
        self.check_posture(&q)?;
        Ok(q)
    }
}
