//! The simulated arm: one state, two ways to integrate it.

use crate::error::PlantError;
use crate::hybrid::{Hybrid, Touch};
use crate::smooth::{Smooth, State};
use crate::surface::Surfaces;
use model::{ArmMotion, Model, Robot, joints, padded};
use nalgebra::{SVector, Vector6};
use shared_types::checkpoints::PlantCheckpoint;
use shared_types::scenario::{self, PlantModel};

/// The state left the finite numbers, and was kept as it was before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the arm's motion left the finite numbers: the torque is beyond what the robot can take; give its joints effort limits"
)]
pub struct Diverged;

/// A simulated arm in its world.
pub struct Plant<const N: usize> {
    smooth: Smooth<N>,
    /// Floor, joint stops and dry friction by rapier3d; `None`: Runge–Kutta alone, without these.
    pub(crate) hybrid: Option<Box<Hybrid<N>>>,
    state: State<N>,
    /// Of the state.
    motion: ArmMotion<N>,
    touch: Touch,
    /// Length of a tick; s.
    tick_s: f64,
}

impl<const N: usize> Plant<N> {
    /// The arm `robot` at rest at `q_start` (zero at absent joints), seen at `frame` (its default frame where empty), `rate_hz` ticks a second.
    ///
    /// `options.mass_factor` scales the links' masses and inertias; the armature is the drives', and stays. `options.payload` comes on top.
    ///
    /// Requires `options` and `rate_hz` of a scenario, which has checked them.
    ///
    /// # Errors
    /// [`PlantError`]: a posture outside the limits, in the floor or in a surface, an arm that cannot be simulated.
    pub fn new(
        robot: &Robot,
        frame: Option<&str>,
        options: &scenario::Plant,
        rate_hz: u32,
        q_start: &SVector<f64, N>,
    ) -> Result<Self, PlantError> {
        let mut robot = robot.clone();
        for joint in &mut robot.joints {
            joint.mass *= options.mass_factor;
            joint.inertia *= options.mass_factor;
        }
        if let Some(load) = &options.payload {
            robot
                .take_payload(frame, load)
                .map_err(|defect| PlantError::Load(defect.to_string()))?;
        }
        let model = Model::new(&robot, frame)?;
        robot.check_posture(&q_start.as_slice()[..robot.dof()])?;
        if model.mass_matrix(q_start).cholesky().is_none() {
            return Err(PlantError::SingularMass { robot: robot.name });
        }
        let viscous = match options.friction {
            true => *model.viscous_friction(),
            false => SVector::zeros(),
        };
        let surfaces = Surfaces::new(options);
        surfaces.check_start(&model.forward_kinematics(q_start))?;
        let smooth = Smooth {
            model,
            viscous,
            surfaces,
        };
        let tick_s = 1.0 / f64::from(rate_hz);
        let hybrid = match options.model {
            PlantModel::Reference => {
                let is_dry =
                    |joint: &&model::Joint| options.friction && joint.coulomb_friction > 0.0;
                if let Some(joint) = robot.joints.iter().find(is_dry) {
                    return Err(PlantError::DryFriction {
                        joint: joint.name.clone(),
                        coulomb: joint.coulomb_friction,
                        robot: robot.name,
                    });
                }
                None
            }
            PlantModel::Rapier => {
                let hybrid = Hybrid::new(&robot, &smooth, q_start, options, tick_s)?;
                Some(Box::new(hybrid))
            }
        };
        let state = State::at_rest(*q_start);
        Ok(Self {
            motion: smooth.motion(&state),
            smooth,
            hybrid,
            state,
            touch: Touch::default(),
            tick_s,
        })
    }

    /// Advances one tick with the joint torques `tau` (N·m) held.
    ///
    /// Cost: one [`Model::advance`] and the motion of the new state a millisecond of free motion; 4 forward dynamics a sub-step where a constraint may act, and
    /// a rapier3d step, which allocates.
    ///
    /// # Errors
    /// [`Diverged`], with the state as it was.
    pub fn step(&mut self, tau: &SVector<f64, N>) -> Result<(), Diverged> {
        let (smooth, now) = (&self.smooth, &self.motion);
        let (state, touch) = match &mut self.hybrid {
            Some(hybrid) => hybrid.tick(smooth, &self.state, now, tau),
            None => {
                let state = smooth.advance(&self.state, now, tau, self.tick_s);
                (state, Touch::default())
            }
        };
        if !state.is_finite() {
            return Err(Diverged);
        }
        self.motion = self.smooth.motion(&state);
        let (wrench, count) = self.smooth.pressed(&self.motion);
        (self.state, self.touch) = (state, touch);
        if count > 0 {
            self.touch.force += wrench.fixed_rows::<3>(0);
            self.touch.contacts += count;
        }
        Ok(())
    }

    /// Holds the arm by its brakes for one tick: it is at rest where it is.
    ///
    /// The world's forces on a braked arm are not computed: the brakes bear them, and [`Plant::touch`] is empty.
    pub fn hold(&mut self) {
        self.state.qdot.fill(0.0);
        self.motion = self.smooth.motion(&self.state);
        self.touch = Touch::default();
    }

    /// Writes all that a tick changes, but for what [`forget`](Self::forget) forgets.
    pub fn save(&self, out: &mut PlantCheckpoint) {
        (out.q, out.qdot) = (padded(&self.state.q), padded(&self.state.qdot));
        out.force = self.touch.force.into();
        (out.contacts, out.limits) = (self.touch.contacts, self.touch.limits);
        if let Some(hybrid) = &self.hybrid {
            hybrid.save(out);
        }
    }

    /// Forgets what rapier3d remembers of earlier contacts: what follows is determined by what [`save`](Self::save) writes.
    pub fn forget(&mut self) {
        if let Some(hybrid) = &mut self.hybrid {
            hybrid.forget();
        }
    }

    /// Goes on from what [`save`](Self::save) has written.
    pub fn restore(&mut self, from: &PlantCheckpoint) {
        self.state = State {
            q: joints(&from.q),
            qdot: joints(&from.qdot),
        };
        self.motion = self.smooth.motion(&self.state);
        self.touch = Touch {
            force: from.force.into(),
            contacts: from.contacts,
            limits: from.limits,
        };
        if let Some(hybrid) = &mut self.hybrid {
            hybrid.restore(from);
        }
    }

    /// Where the joints are and how they move.
    pub fn state(&self) -> &State<N> {
        &self.state
    }

    /// The effect of constraints over the last tick.
    pub fn touch(&self) -> &Touch {
        &self.touch
    }

    /// Wrench of the surfaces on the hand in this state, about E, base axes; N, N·m.
    pub fn pressed(&self) -> Vector6<f64> {
        self.smooth.pressed(&self.motion).0
    }

    /// The simulated arm's model (with the scenario's mass factor).
    pub fn model(&self) -> &Model<N> {
        &self.smooth.model
    }

    /// The end-effector's motion and the arm's energy.
    pub fn motion(&self) -> &ArmMotion<N> {
        &self.motion
    }

    /// Kinetic and potential energy; J.
    pub fn energy(&self) -> f64 {
        self.motion.energy
    }
}
