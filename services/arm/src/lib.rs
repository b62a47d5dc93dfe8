//! An arm and its law as a library. `services/python` and `services/capi` give it to Python and C; what both need stands here.
//!
//! No algebra of its own: the steps of the processes `analyzer` and `controller`, message by message, so that a library gives their bits.
#![allow(non_snake_case)]

mod law;
mod steps;

use std::path::Path;
use std::sync::Arc;

use model::{Model, Pose, Refused, Robot, RobotText, embedded, with_dof};
use shared_types::scenario::Scenario;
use shared_types::{MAX_DOF, SingularityReport, StateEstimate};

use steps::{Look, look};

pub use law::{Given, Reason, Row, State, Task};

/// A steered scenario without an end; the arm, the frame and the start are laid over it.
const SESSION: &str =
    "name = \"library\"\nrobot = \"library\"\n[start]\nposture = \"x\"\n[servo]\nduration_s = 1\n";

/// From positions and velocities to kinematics and dynamics, for an arm of any number of joints.
type Evaluation = Box<dyn Fn(&[f64], &[f64]) -> Posture + Send + Sync>;

/// A serial arm, seen at one of its links.
pub struct Arm {
    robot: Arc<Robot>,
    tip: String,
    analysis: Analysis,
    at: Evaluation,
}

/// An arm at a posture. B base, E end-effector, n joints; rows of twists are `[linear; angular]` in the axes of B. Matrices lie row by row in the first
/// places of their arrays.
#[derive(Clone, Copy, Debug)]
pub struct Posture {
    /// Pose of E in B, homogeneous, 4 × 4, m.
    pub pose: [f64; 16],
    /// Poses of the links in B, the frames of their joints in the arm's file, n times 4 × 4, m.
    pub links: [[f64; 16]; MAX_DOF],
    /// Jacobian at E, 6 × n, m and rad per rad.
    pub J: [f64; 6 * MAX_DOF],
    /// Mass matrix, armature included, n × n, kg·m².
    pub A: [f64; MAX_DOF * MAX_DOF],
    /// Coriolis and gravity torques, n, N·m.
    pub bias: [f64; MAX_DOF],
    /// Gravity torques, n, N·m.
    pub gravity: [f64; MAX_DOF],
}

/// The step of the process `analyzer`, for postures by themselves.
pub struct Analysis {
    /// With the default thresholds.
    look: Box<dyn Look>,
    estimate: StateEstimate,
}

impl Clone for Analysis {
    fn clone(&self) -> Self {
        Self {
            look: self.look.copied(),
            ..*self
        }
    }
}

impl Analysis {
    /// The report of an arm at rest in `q`, as at the process's first tick. It is empty, with NaN, for a `q` that is not finite. No allocation.
    pub fn at(&mut self, q: &[f64], report: &mut SingularityReport) {
        if is_finite(q) {
            self.estimate.q[..q.len()].copy_from_slice(q);
            self.look.report(&self.estimate, report);
        } else {
            (report.count, report.det) = (0, f64::NAN);
            (report.singularities.iter_mut()).for_each(|one| one.s = f64::NAN);
        }
    }

    /// From now on a direction far from its singularity is numeric, of unknown type: with seven joints, ten times quicker.
    pub fn leave_far_unnamed(&mut self) {
        self.look.leave_far_unnamed();
    }
}

impl Arm {
    /// An arm seen at the link `tip`; its own end-effector frame where `None`.
    ///
    /// # Errors
    /// [`Refused`] for a link that the arm does not have, or too many joints.
    pub fn new(robot: Robot, tip: Option<&str>) -> Result<Self, Refused> {
        let tip = tip.unwrap_or(&robot.default_frame).to_owned();
        let look = look(&robot, &scenario(&robot, &tip, &[])?)?;
        let at = with_dof!(robot.dof(), N => {
            let model = Model::<N>::new(&robot, Some(&tip)).map_err(Refused::because)?;
            Ok(evaluation(model, robot.dof()))
        });
        Ok(Self {
            at: at.unwrap_or_else(|| Err(Refused::size(&robot)))?,
            robot: Arc::new(robot),
            tip,
            analysis: Analysis {
                look,
                estimate: StateEstimate::default(),
            },
        })
    }

    /// A built-in arm.
    ///
    /// # Errors
    /// [`Refused`] for an unknown name, with the known ones.
    pub fn builtin(name: &str, tip: Option<&str>) -> Result<Self, Refused> {
        Self::new(Robot::builtin(name).map_err(Refused::because)?, tip)
    }

    /// The arm of a URDF text with its description.
    ///
    /// # Errors
    /// [`Refused`] with the joint or link, and the remedy, where something is missing.
    pub fn parse(source: &RobotText, tip: Option<&str>) -> Result<Self, Refused> {
        let robot = Robot::from_source_at(source, tip).map_err(Refused::because)?;
        Self::new(robot, tip)
    }

    /// The arm of a URDF file. Where there is no `description`, it is the TOML file of the same name beside it, if there is one.
    ///
    /// # Errors
    /// As [`parse`](Self::parse), with the file.
    pub fn read(
        path: &Path,
        description: Option<&Path>,
        tip: Option<&str>,
    ) -> Result<Self, Refused> {
        let source = files::robot(path, description).map_err(Refused::because)?;
        Self::parse(&source, tip)
            .map_err(|error| Refused::because(format!("{}: {error}", path.display())))
    }

    /// Its description.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// The link that is the end-effector E.
    pub fn tip(&self) -> &str {
        &self.tip
    }

    /// Kinematics and dynamics at `q`, rad, and `qdot`, rad/s, one value per joint. No allocation.
    pub fn at(&self, q: &[f64], qdot: &[f64]) -> Posture {
        (self.at)(q, qdot)
    }

    /// Its singularities, posture by posture.
    pub fn analysis(&self) -> Analysis {
        self.analysis.clone()
    }
}

/// A steered scenario on an arm, with `settings` applied, that starts in the middle of the joints' ranges.
fn scenario(robot: &Robot, tip: &str, settings: &[String]) -> Result<Scenario, Refused> {
    let mut scenario = Scenario::parse("settings", SESSION, settings).map_err(Refused::because)?;
    tip.clone_into(&mut scenario.frame);
    (scenario.start.posture, scenario.start.q) = (None, Some(robot.middle()));
    if let Some(servo) = &mut scenario.servo {
        servo.duration_s = f64::INFINITY;
    }
    Ok(scenario)
}

/// [`Arm::at`] of an arm with n joints.
fn evaluation<const N: usize>(model: Model<N>, n: usize) -> Evaluation {
    Box::new(move |q, qdot| {
        let terms = model.evaluate(&embedded(q), &embedded(qdot));
        let (links, bias) = (model.link_poses(&embedded(q)), terms.bias());
        let first = |values: &[f64]| std::array::from_fn(|i| if i < n { values[i] } else { 0.0 });
        Posture {
            pose: homogeneous(&terms.X_BE),
            links: std::array::from_fn(|i| links.get(i).map_or([0.0; 16], homogeneous)),
            J: rows(6, n, |at| terms.J[at]),
            A: rows(n, n, |at| terms.A[at]),
            bias: first(bias.as_slice()),
            gravity: first(terms.gravity.as_slice()),
        }
    })
}

fn homogeneous(pose: &Pose) -> [f64; 16] {
    let X = pose.to_homogeneous();
    rows(4, 4, |at| X[at])
}

/// The numbers of a matrix row by row, zero behind them.
fn rows<const SIZE: usize>(
    rows: usize,
    columns: usize,
    value: impl Fn((usize, usize)) -> f64,
) -> [f64; SIZE] {
    std::array::from_fn(|i| match i < rows * columns {
        true => value((i / columns, i % columns)),
        false => 0.0,
    })
}

/// Whether no value is a NaN or an infinity.
pub fn is_finite(values: &[f64]) -> bool {
    values.iter().all(|x| x.is_finite())
}
