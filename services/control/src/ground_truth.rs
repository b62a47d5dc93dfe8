//! The ground truth of a run, as a judge needs it: what the scenario asks for and where the true posture is singular,
//! computed here from the scenario, the robot and the true posture alone.
//!
//! A controller says how far along the path it is, and nothing else that it says counts. The pose that belongs to that
//! time, the goal that depends on a singular direction, and the directions whose error is exempt follow from the truth.

use crate::centre::PoseMotion;
use crate::law::force::{self, Forces};
use crate::linear::{Joints, Matrix3, Vector3, Vector6, is_finite, linear, stack};
use crate::plan::{self, kinematics::Kinematics};
use crate::reference::free_axis;
use crate::reference::path::{Path, Progress};
use crate::setup::{SetupError, start_posture};
use crate::singularity::analyzer::Analyzer;
use crate::types::{Class, Kind, Report};
use model::{Model, Refused, Robot, Terms, joints};
use nalgebra::Cholesky;
use shared_types::scenario::Scenario;
use shared_types::{MAX_SINGULARITIES, PlantState, SingularityReport, TargetContent};

/// The ground truth of an arm of any number of joints.
pub trait GroundTruth: std::fmt::Debug {
    /// The place at which the commanded path begins; `None` in a steered run, which has no path.
    fn start(&self) -> Option<Progress>;

    /// The time that the path takes by its own clock, s; 0 without one.
    fn duration_s(&self) -> f64;

    /// Analyses the true posture of a tick; before every other question about it. `reported` chooses between ζ and −ζ,
    /// which mean the same direction. A posture that is not finite is left out.
    ///
    /// Cost about 3 µs for six joints, no allocation
    fn analyse(&mut self, truth: &PlantState, reported: &SingularityReport);

    /// Moves on by `by_s` of the path's clock, s; a leg that begins takes its singular direction from the true posture.
    ///
    /// Requires `by_s` finite and not negative
    fn advance(&self, place: &mut Progress, by_s: f64);

    /// The desired motion of E at a place, where the clock runs at `rate`, 0 to 1; `None` in a steered run.
    fn desired(&self, place: &Progress, rate: f64) -> Option<PoseMotion>;

    /// The force that the leg at a place, or the target of a steered run, asks for, and how the true contact and the `error` of the true pose answer it;
    /// `None` where there is none.
    fn force(
        &self,
        place: Option<&Progress>,
        target: Option<&TargetContent>,
        truth: &PlantState,
        error: &Vector6,
    ) -> Option<Contact>;

    /// The demand of the leg at this index on the posture, beside the pose, and how the true posture meets it.
    fn asked(&self, leg: usize) -> Asked;

    /// Position and orientation error of the true pose at a place, `[p_d − p; log(R_d Rᵀ)]`, on the axes that the task
    /// serves. Units m, rad; frame B.
    fn error(&self, place: &Progress, truth: &PlantState) -> Vector6;

    /// The part of an error that is orthogonal to every ζ_i in whose neighbourhood D_si the true posture is, linear and
    /// angular half each for itself. Units m, rad; frame B.
    fn orthogonal(&self, error: &Vector6) -> Vector6;

    /// Whether what an error `[p_d − p; ·]` has left along ζ may lie beyond the boundary of reach: at a fold in whose
    /// neighbourhood the true posture is, it points outwards (Type 1), or either way.
    fn is_beyond(&self, error: &Vector6) -> bool;

    /// Whether any posture of the arm has the pose of a place, found by Newton steps from the true posture and from others.
    ///
    /// Cost up to some 10 ms
    fn reaches(&self, place: &Progress, truth: &PlantState) -> bool;

    /// ½ΔΓᵀA⁻¹ΔΓ of a step ΔΓ of the torques, with A of the true posture; N²m²/(kg·m²). NaN without an inverse.
    fn response(&self, step: &[f64]) -> f64;
}

/// A force asked for, and the true one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Set-point, N.
    pub newtons: f64,
    /// Time in which a set-point changes to it, s.
    pub ramp_s: f64,
    /// Direction, base axes.
    pub e: Vector3,
    /// The force with which the hand presses in the direction asked for, N.
    pub pressed_n: f64,
    /// The error of position across that direction, mm.
    pub across_mm: f64,
    /// The share of its direction, or of a moment's axis, 0 to 1, that lies along lost ones: the structure bears it.
    pub borne: f64,
    /// The error of the moments together, N·m; `None`: none is asked for.
    pub moment_off_nm: Option<f64>,
}

impl Contact {
    /// Share of a force within which it has come about, and for how long, s.
    pub const REACHED: (f64, f64) = force::REACHED;

    /// Whether its direction is another one than `e`.
    pub fn is_away_from(&self, e: &Vector3) -> bool {
        self.e.dot(e) < force::SAME_AXIS
    }

    /// The set-point of a force of `before_n`, N, a tick of `dt_s` s later.
    pub fn set_point(&self, before_n: f64, dt_s: f64) -> f64 {
        force::ramped(before_n, self.newtons, self.ramp_s, dt_s)
    }
}

/// A leg's demand on the posture, and how the posture meets it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Asked {
    /// The pose is all that is asked for.
    Nothing,
    /// That ζ turns by an angle, rad; ζ, and whether the posture is in its neighbourhood.
    Turn {
        /// In B.
        zeta: [f64; 3],
        /// rad.
        by: f64,
        /// Elsewhere nothing can be turned.
        is_inside: bool,
    },
    /// That the elbow's fold is left on a side; the fold's coordinate, rad.
    Side {
        /// Negative on the one side, positive on the other.
        x: f64,
        /// The sign asked for.
        side: f64,
        /// Whether the posture is in the neighbourhood.
        is_inside: bool,
    },
}

/// The ground truth of a scenario on a robot.
///
/// # Errors
/// [`Refused`] where the scenario does not fit the robot.
pub fn ground_truth(robot: &Robot, scenario: &Scenario) -> Result<Box<dyn GroundTruth>, Refused> {
    model::boxed!(robot, N => Truth::<N>::new(robot, scenario), dyn GroundTruth)
}

/// Of one arm.
#[derive(Clone, Debug)]
struct Truth<const N: usize> {
    model: Model<N>,
    analyzer: Analyzer<N>,
    path: Option<Path>,
    start: Progress,
    /// Of the present posture.
    terms: Terms<N>,
    report: Report<N>,
    /// Whether ζ in the report points the other way than the analysis has it.
    turned: [bool; MAX_SINGULARITIES],
    task: [bool; 6],
    length_m: f64,
    forces: Forces,
}

impl<const N: usize> Truth<N> {
    fn new(robot: &Robot, scenario: &Scenario) -> Result<Self, SetupError> {
        let (model, q) = (
            Model::new(robot, scenario.frame())?,
            start_posture(robot, scenario)?,
        );
        let terms = model.evaluate(&q, &Joints::zeros());
        let mut analyzer = Analyzer::new(robot, &scenario.analysis);
        let report = analyzer.step(&q, &Joints::zeros(), &terms);
        let path = match scenario.servo {
            None => Some(Path::new(scenario, terms.X_BE, &report)?),
            Some(_) => None,
        };
        Ok(Self {
            path,
            start: Progress::at(terms.X_BE),
            report,
            turned: [false; MAX_SINGULARITIES],
            terms,
            analyzer,
            model,
            task: robot.task.0,
            length_m: robot.length_m,
            forces: Forces::of(scenario),
        })
    }
}

impl<const N: usize> GroundTruth for Truth<N> {
    fn start(&self) -> Option<Progress> {
        self.path.as_ref().map(|_| self.start)
    }

    fn duration_s(&self) -> f64 {
        self.path.as_ref().map_or(0.0, Path::duration_s)
    }

    fn analyse(&mut self, truth: &PlantState, reported: &SingularityReport) {
        let (q, qdot) = (joints(&truth.q), joints(&truth.qdot));
        if !is_finite(&q) || !is_finite(&qdot) {
            return;
        }
        self.model.evaluate_into(&q, &qdot, &mut self.terms);
        self.analyzer.list(&q, &qdot, &self.terms, &mut self.report);
        let listed = self.report.count;
        let own = self.report.singularities[..listed].iter_mut();
        for ((own, other), turned) in own.zip(&reported.singularities).zip(&mut self.turned) {
            *turned = own.zeta_B.dot(&Vector6::from(other.zeta_B)) < 0.0;
            if *turned {
                own.zeta_B = -own.zeta_B;
            }
        }
    }

    fn advance(&self, place: &mut Progress, by_s: f64) {
        if let Some(path) = &self.path {
            let X_BE = &self.terms.X_BE;
            self.forces.advance(path, place, by_s, &self.report, X_BE);
        }
    }

    fn desired(&self, place: &Progress, rate: f64) -> Option<PoseMotion> {
        let path = self.path.as_ref()?;
        Some(path.desired(place, rate, 0.0))
    }

    fn force(
        &self,
        place: Option<&Progress>,
        target: Option<&TargetContent>,
        truth: &PlantState,
        error: &Vector6,
    ) -> Option<Contact> {
        let R = Matrix3::from_column_slice(&truth.R_BE);
        let press = match place {
            Some(place) => self.forces.at(place.leg, &R),
            None => self.forces.of_target(target?, &R),
        }?;
        let borne = |axis: &Vector6| (axis - self.orthogonal(axis)).norm();
        let F = stack(
            &truth.contact_force_n.into(),
            &truth.contact_torque_nm.into(),
        );
        let twisted = Vector3::from(press.off_nm(&F)).norm();
        Some(Contact {
            moment_off_nm: press.twists().then_some(twisted),
            newtons: press.newtons,
            ramp_s: press.ramp_s(),
            e: press.e,
            pressed_n: -press.e.dot(&Vector3::from(truth.contact_force_n)),
            across_mm: 1e3 * linear(&press.across(error)).norm(),
            borne: press.axes().iter().map(borne).fold(0.0, f64::max),
        })
    }

    fn asked(&self, leg: usize) -> Asked {
        let Some(leg) = self.path.as_ref().and_then(|path| path.leg(leg)) else {
            return Asked::Nothing;
        };
        if let Some((place, by)) = leg.reorient {
            let turned = &self.report.singularities[place];
            return Asked::Turn {
                zeta: turned.axis().into(),
                by,
                is_inside: turned.inside,
            };
        }
        let mut folds = self.report.listed().iter();
        let fold = folds.find(|one| one.kind == Kind::Elbow && one.class == Class::Type1);
        match fold {
            Some(fold) if leg.branch != 0 => Asked::Side {
                x: fold.aux,
                side: leg.branch.into(),
                is_inside: fold.inside,
            },
            _ => Asked::Nothing,
        }
    }

    fn error(&self, place: &Progress, truth: &PlantState) -> Vector6 {
        let Some(path) = &self.path else {
            return Vector6::repeat(f64::NAN);
        };
        let desired = path.place(place).moving(0.0, 0.0);
        let R = Matrix3::from_column_slice(&truth.R_BE);
        let free = free_axis::free_axis(&self.task);
        let turn = free_axis::rotation_error(&desired.R, &R, free.as_ref());
        let error = stack(&(desired.p - Vector3::from(truth.p_BE)), &turn);
        let press = self.forces.at(place.leg, &R);
        let error = press.map_or(error, |press| press.across(&error));
        // Times zero, not zero: a NaN stays one.
        Vector6::from_fn(|i, _| error[i] * if self.task[i] { 1.0 } else { 0.0 })
    }

    fn orthogonal(&self, error: &Vector6) -> Vector6 {
        let mut rest = *error;
        for singularity in self.report.listed().iter().filter(|s| s.inside) {
            for half in [0, 3] {
                let zeta = singularity.zeta_B.fixed_rows::<3>(half);
                let along = zeta.dot(&rest.fixed_rows::<3>(half));
                let removed = zeta * along;
                let mut part = rest.fixed_rows_mut::<3>(half);
                part -= removed;
            }
        }
        rest
    }

    fn is_beyond(&self, error: &Vector6) -> bool {
        let listed = self.report.listed().iter();
        listed.zip(&self.turned).any(|(one, turned)| {
            let way = one.zeta_B.fixed_rows::<3>(0).dot(&error.fixed_rows::<3>(0));
            let way = if *turned { -way } else { way };
            // ζ points outwards at a fold. That of an elbow keeps its way where the arm is folded up, whose boundary is inwards.
            let is_outwards = match (one.class, one.kind) {
                (Class::Type1, Kind::Elbow) => way * libm::cos(one.aux) > 0.0,
                (Class::Type1, _) => way > 0.0,
                // Of both curvatures, or of one that is known elsewhere alone: the boundary may lie either way.
                _ => way != 0.0,
            };
            one.inside && !one.angular && is_outwards
        })
    }

    fn reaches(&self, place: &Progress, truth: &PlantState) -> bool {
        let arm = Kinematics {
            model: &self.model,
            p_EC: Vector3::zeros(),
            task: self.task,
            length_m: self.length_m,
        };
        let pose = |path: &Path| path.place(place).moving(0.0, 0.0).pose();
        self.path
            .as_ref()
            .is_none_or(|path| plan::reachable(&arm, &pose(path), &joints(&truth.q)))
    }

    fn response(&self, step: &[f64]) -> f64 {
        let mut A = self.terms.A;
        // A model may have more places than the arm has joints: absent ones have no mass.
        for absent in step.len()..N {
            A[(absent, absent)] = 1.0;
        }
        let step = Joints::<N>::from_fn(|i, _| step.get(i).copied().unwrap_or(0.0));
        Cholesky::new(A).map_or(f64::NAN, |A| 0.5 * step.dot(&A.solve(&step)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An arm with fewer joints than the least model has places.
    #[test]
    fn a_step_of_the_torques_has_an_answer_on_an_arm_of_two_joints() {
        let robot = Robot::builtin("planar2r").unwrap();
        let text = "name = \"x\"\nrobot = \"planar2r\"\n[start]\nq_deg = [20, 40]\n[[segment]]\nby_m = [0.1, 0, 0]\nduration_s = 1.0\n";
        let scenario = Scenario::parse("x.toml", text, &[]).unwrap();
        let truth = ground_truth(&robot, &scenario).unwrap();
        let answer = truth.response(&[1.0, -1.0]);
        assert!(answer.is_finite() && answer > 0.0, "{answer}");
    }
}
