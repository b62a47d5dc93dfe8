//! The pure step: computed torque along a straight line of the hand, through a damped inverse of the Jacobian.
#![allow(non_snake_case)]

use model::{Model, Pose, Robot, embedded, joints, padded};
use nalgebra::{Cholesky, Matrix6, SMatrix, SVector, Vector3, Vector6};
use process::{Flow, Inputs, Outputs, Port, Process, Stateless};
use shared_types::codes::{PHASE_DONE, PHASE_RUNNING, PHASE_SETTLING};
use shared_types::scenario::Scenario;
use shared_types::{ControlState, MAX_DOF, StateEstimate, TorqueCommand};

/// Stiffness and damping of the error's decay; 1/s², 1/s.
const K_P: f64 = 400.0;
const K_V: f64 = 40.0;
/// Damping of the inverse: it keeps the joints from racing where the arm can hardly move.
const LAMBDA: f64 = 0.01;

type Joints = SVector<f64, MAX_DOF>;

/// Γ = A(q)·q̈ + b(q, q̇) with q̈ = −k_v·q̇ + J⁺·(ẍ_d + k_v·ẋ_d + k_p·(x_d − x) − J̇·q̇) and J⁺ = Jᵀ(J·Jᵀ + λ²·1)⁻¹;
/// x_d is a quintic in time from the start to the goal, and J has the rows that the task serves.
pub(crate) struct Law {
    /// As many places as a message has: absent joints have no mass.
    arm: Model<MAX_DOF>,
    served: [bool; 6],
    start: Pose,
    way: Vector3<f64>,
    duration_s: f64,
    settle_s: f64,
    dt_s: f64,
}

impl Law {
    /// # Errors
    /// The missing part of the scenario, in words.
    pub(crate) fn new(robot: &Robot, scenario: &Scenario) -> Result<Self, String> {
        let arm = Model::new(robot, scenario.frame()).map_err(|error| error.to_string())?;
        let start = robot
            .start_posture(&scenario.start)
            .map_err(|error| error.to_string())?;
        let first = scenario
            .segment
            .first()
            .ok_or("the scenario has no segment")?;
        let way = first.by_m.ok_or("the first segment has no by_m")?;
        Ok(Self {
            start: arm.forward_kinematics(&embedded(&start)),
            arm,
            served: robot.task.0,
            way: way.into(),
            duration_s: first.duration_s,
            settle_s: scenario.settle_s,
            dt_s: scenario.dt_s(),
        })
    }

    fn answer(
        &self,
        estimate: &StateEstimate,
        state: &mut ControlState,
        torque: &mut TorqueCommand,
    ) {
        let t = estimate.header.tick as f64 * self.dt_s;
        let (q, qdot): (Joints, Joints) = (joints(&estimate.q), joints(&estimate.qdot));
        let terms = self.arm.evaluate(&q, &qdot);
        let u = (t / self.duration_s).min(1.0);
        let share = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u);
        let rate = 30.0 * u * u * (1.0 - u) * (1.0 - u) / self.duration_s;
        let bend = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / (self.duration_s * self.duration_s);

        let p_d = self.start.p + self.way * share;
        let turn = model::rotation_log(&(self.start.R * terms.X_BE.R.transpose()));
        let error = stack(&(p_d - terms.X_BE.p), &turn);
        let wanted = stack(&(self.way * (bend + K_V * rate)), &Vector3::zeros());
        let acceleration = self.serve(&(wanted + K_P * error - terms.Jdot_qdot));
        let J =
            SMatrix::<f64, 6, MAX_DOF>::from_fn(
                |i, j| {
                    if self.served[i] { terms.J[(i, j)] } else { 0.0 }
                },
            );
        let damped = J * J.transpose() + Matrix6::identity() * (LAMBDA * LAMBDA);
        // Positive definite by its damping; an estimate that is no number gives a torque that is none, which is refused.
        let solved = Cholesky::new(damped).map_or(acceleration * f64::NAN, |factor| {
            factor.solve(&acceleration)
        });
        let tau = terms.A * (J.transpose() * solved - K_V * qdot) + terms.bias();

        torque.tau = padded(&tau);
        torque.phase = match t {
            t if t < self.duration_s => PHASE_RUNNING,
            t if t < self.duration_s + self.settle_s => PHASE_SETTLING,
            _ => PHASE_DONE,
        };
        // The judge takes the time on the path and follows the path itself; the rest is drawn.
        state.path_time_s = t.min(self.duration_s);
        state.tau_task = torque.tau;
        state.p_BE_d = p_d.into();
        state.R_BE_d.copy_from_slice(self.start.R.as_slice());
        state.V_BE_d = stack(&(self.way * rate), &Vector3::zeros()).into();
        state.error = self.serve(&error).into();
        (state.time_scale, state.null_scale, state.task_scale) = (1.0, 1.0, 1.0);
        state.beta.fill(1.0);
    }

    /// The rows that the task serves; 0 in the others.
    fn serve(&self, x: &Vector6<f64>) -> Vector6<f64> {
        Vector6::from_fn(|i, _| if self.served[i] { x[i] } else { 0.0 })
    }
}

fn stack(linear: &Vector3<f64>, angular: &Vector3<f64>) -> Vector6<f64> {
    Vector6::from_fn(|i, _| if i < 3 { linear[i] } else { angular[i - 3] })
}

impl Process for Law {
    type State = Stateless;
    const READS: &'static [Port] = &[Port::of::<StateEstimate>()];
    const WRITES: &'static [Port] = &[Port::of::<ControlState>(), Port::of::<TorqueCommand>()];

    fn step(&self, _: &mut Stateless, inputs: &Inputs<'_>, outputs: &mut Outputs<'_>) -> Flow {
        let (mut state, mut torque) = (ControlState::default(), TorqueCommand::default());
        if let Some(estimate) = inputs.get() {
            self.answer(estimate, &mut state, &mut torque);
        }
        outputs.put(&state);
        outputs.put(&torque);
        Flow::Go
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_rest_in_the_start_posture_the_torque_carries_the_arm() {
        let robot = Robot::builtin("puma560").unwrap();
        let text = "name = \"x\"\nrobot = \"puma560\"\n[start]\nq_deg = [20, -60, 170, 0, 30, 0]\n[[segment]]\n\
                    by_m = [0.05, 0, 0]\nduration_s = 1.0\n";
        let scenario = Scenario::parse("x.toml", text, &[]).unwrap();
        let law = Law::new(&robot, &scenario).unwrap();
        let q: Joints = embedded(&robot.start_posture(&scenario.start).unwrap());
        let mut estimate = StateEstimate {
            q: padded(&q),
            ..StateEstimate::default()
        };
        let (mut state, mut torque) = (ControlState::default(), TorqueCommand::default());
        law.answer(&estimate, &mut state, &mut torque);
        let gravity = law.arm.gravity(&q);
        assert!(
            gravity.norm() > 1.0 && (joints::<MAX_DOF>(&torque.tau) - gravity).norm() < 1e-9,
            "{torque:?}"
        );
        assert_eq!(torque.phase, PHASE_RUNNING);
        estimate.header.tick = 1_000_000;
        law.answer(&estimate, &mut state, &mut torque);
        assert_eq!(torque.phase, PHASE_DONE);
    }
}
