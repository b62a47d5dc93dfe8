//! The simulated arm: one state, two ways to integrate it.

use crate::hybrid::{Hybrid, Touch};
use crate::smooth::{Smooth, State};
use model::{Model, ModelError, PostureError, Robot};
use nalgebra::SVector;
use shared_types::scenario::{self, PlantModel};

/// Why an arm cannot be simulated as asked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlantError {
    /// The robot has no model of this size or at this frame.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The start posture is not one.
    #[error("the start posture cannot be: {0}")]
    Start(#[from] PostureError),
    /// The arm starts in the floor.
    #[error("{link} starts in the floor at z = {floor_m} m: lower plant.floor_m, or start from another posture")]
    StartInFloor {
        /// The link.
        link: String,
        /// The floor's height in B; m.
        floor_m: f64,
    },
    /// A number of the scenario's `[plant]` is out of range.
    #[error("{key} = {value} cannot be: it must be {range}")]
    Range {
        /// The scenario's key.
        key: &'static str,
        /// Its value.
        value: f64,
        /// What it may be.
        range: &'static str,
    },
    /// Dry friction is not smooth.
    #[error(
        "plant.model = \"reference\" integrates smooth dynamics and has no dry friction, but joint {joint} of '{robot}' has {coulomb} N·m of it: use plant.model = \"rapier\", or plant.friction = false"
    )]
    DryFriction {
        /// The robot's name.
        robot: String,
        /// The first such joint.
        joint: String,
        /// Its Coulomb friction; N·m.
        coulomb: f64,
    },
    /// A link's inertia has a negative principal value.
    #[error("{link} has a principal inertia of {least} kg·m²: move inertia to it from a neighbour, or use plant.model = \"reference\"")]
    NotRealisable {
        /// The link.
        link: String,
        /// The smallest principal inertia; kg·m².
        least: f64,
    },
    /// A joint moves nothing.
    #[error("the mass matrix of '{robot}' is singular at the start posture: give the outer links mass, or the joints armature")]
    SingularMass {
        /// The robot's name.
        robot: String,
    },
    /// There is nothing to move.
    #[error("the robot has no joints")]
    NoJoints,
}

/// The state left the finite numbers, and was kept as it was before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the arm's motion left the finite numbers: the torque is beyond what the robot can take; give its joints effort limits")]
pub struct Diverged;

/// Speed at which motion counts as diverged: its square, and with it the energy, is a number still; rad/s.
const FASTEST: f64 = 1e100;

/// How the state is carried from tick to tick.
enum BackEnd<const N: usize> {
    /// Runge–Kutta alone: no floor, no joint stops, no dry friction.
    Reference,
    /// With constraints from rapier3d.
    Hybrid(Box<Hybrid<N>>),
}

/// A simulated arm in its world.
pub struct Plant<const N: usize> {
    smooth: Smooth<N>,
    back_end: BackEnd<N>,
    state: State<N>,
    touch: Touch,
    substeps: u32,
    /// Length of a sub-step; s.
    h: f64,
}

impl<const N: usize> Plant<N> {
    /// The arm `robot` at rest at `q_start`, seen at `frame` (its default frame where empty), `rate_hz` ticks a second.
    ///
    /// `options.mass_factor` scales the links' masses and inertias; the armature is the drives', and stays.
    ///
    /// # Errors
    /// [`PlantError`]: a posture outside the limits or in the floor, a number out of range, an arm that cannot be simulated.
    pub fn new(robot: &Robot, frame: &str, options: &scenario::Plant, rate_hz: u32, q_start: &SVector<f64, N>) -> Result<Self, PlantError> {
        check(rate_hz > 0, "rate_hz", rate_hz.into(), "at least 1")?;
        check(options.substeps > 0, "plant.substeps", options.substeps.into(), "at least 1")?;
        let factor = options.mass_factor;
        check(factor > 0.0 && factor.is_finite(), "plant.mass_factor", factor, "positive")?;
        if let Some(floor_m) = options.floor_m {
            check(floor_m.is_finite(), "plant.floor_m", floor_m, "a height in m")?;
        }
        let mut robot = robot.clone();
        for joint in &mut robot.joints {
            joint.mass *= factor;
            joint.inertia *= factor;
        }
        let model = Model::new(&robot, (!frame.is_empty()).then_some(frame))?;
        robot.check_posture(q_start.as_slice())?;
        if model.mass_matrix(q_start).cholesky().is_none() {
            return Err(PlantError::SingularMass { robot: robot.name });
        }
        let viscous = if options.friction { *model.viscous_friction() } else { SVector::zeros() };
        let smooth = Smooth { model, viscous };
        let h = 1.0 / f64::from(rate_hz) / f64::from(options.substeps);
        let back_end = match options.model {
            PlantModel::Reference => {
                let dry = robot.joints.iter().find(|joint| options.friction && joint.coulomb_friction > 0.0);
                if let Some(joint) = dry {
                    let (joint, coulomb) = (joint.name.clone(), joint.coulomb_friction);
                    return Err(PlantError::DryFriction { robot: robot.name, joint, coulomb });
                }
                BackEnd::Reference
            }
            PlantModel::Rapier => BackEnd::Hybrid(Box::new(Hybrid::new(&robot, &smooth, q_start, options, h)?)),
        };
        let state = State::at_rest(*q_start);
        Ok(Self { smooth, back_end, state, touch: Touch::default(), substeps: options.substeps, h })
    }

    /// Advances one tick with the joint torques `tau` (N·m) held.
    ///
    /// Cost: 4 forward dynamics a sub-step; where a constraint may act, a rapier3d step each besides, which allocates.
    ///
    /// # Errors
    /// [`Diverged`], with the state as it was.
    pub fn step(&mut self, tau: &SVector<f64, N>) -> Result<(), Diverged> {
        let mut state = self.state;
        let mut touch = Touch::default();
        for _ in 0..self.substeps {
            state = match &mut self.back_end {
                BackEnd::Reference => self.smooth.rk4(&state, tau, self.h),
                BackEnd::Hybrid(hybrid) => hybrid.step(&self.smooth, &state, tau, self.h, &mut touch),
            };
            if !(state.is_finite() && state.qdot.amax() < FASTEST) {
                return Err(Diverged);
            }
        }
        touch.force /= self.h * f64::from(self.substeps);
        (self.state, self.touch) = (state, touch);
        Ok(())
    }

    /// Holds the arm by its brakes for one tick: it is at rest where it is.
    ///
    /// What the world does to a braked arm is not computed: the brakes take it, and [`Plant::touch`] is empty.
    pub fn hold(&mut self) {
        self.state.qdot.fill(0.0);
        self.touch = Touch::default();
    }

    /// Where the joints are and how they move.
    pub fn state(&self) -> &State<N> {
        &self.state
    }

    /// What constraints did over the last tick.
    pub fn touch(&self) -> &Touch {
        &self.touch
    }

    /// The simulated arm's model (with the scenario's mass factor).
    pub fn model(&self) -> &Model<N> {
        &self.smooth.model
    }

    /// Kinetic and potential energy; J.
    pub fn energy(&self) -> f64 {
        self.smooth.energy(&self.state)
    }

    #[cfg(test)]
    pub(crate) fn set_state(&mut self, state: State<N>) {
        self.state = state;
    }

    /// Makes the hybrid plant ask rapier3d at every sub-step.
    #[cfg(test)]
    pub(crate) fn always_ask(&mut self) {
        if let BackEnd::Hybrid(hybrid) = &mut self.back_end {
            hybrid.always = true;
        }
    }
}

fn check(holds: bool, key: &'static str, value: f64, range: &'static str) -> Result<(), PlantError> {
    if holds { Ok(()) } else { Err(PlantError::Range { key, value, range }) }
}
