//! The pure step: computed torque along a path of the joints.
#![allow(non_snake_case)]

use model::{Model, Robot, embedded, joints, padded};
use nalgebra::SVector;
use shared_types::codes::{PHASE_DONE, PHASE_RUNNING, PHASE_SETTLING};
use shared_types::scenario::Scenario;
use shared_types::{ControlState, MAX_DOF, StateEstimate, TorqueCommand};

/// Stiffness and damping of the error's decay; 1/s², 1/s.
const K_P: f64 = 400.0;
const K_V: f64 = 40.0;

type Joints = SVector<f64, MAX_DOF>;

/// Γ = A(q)·(q̈_d + k_v·(q̇_d − q̇) + k_p·(q_d − q)) + b(q, q̇), with q_d a quintic in time from the start to the goal.
pub(crate) struct Law {
    /// As many places as a message has: absent joints have no mass.
    arm: Model<MAX_DOF>,
    start: Joints,
    way: Joints,
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
        let goal = first
            .posture_deg
            .as_ref()
            .ok_or("the first segment has no posture_deg")?;
        if goal.len() != start.len() {
            return Err(format!(
                "posture_deg has {} values: the arm has {} joints",
                goal.len(),
                start.len()
            ));
        }
        let goal: Vec<f64> = goal.iter().map(|degrees| degrees.to_radians()).collect();
        let (start, goal) = (embedded(&start), embedded::<MAX_DOF>(&goal));
        Ok(Self {
            arm,
            start,
            way: goal - start,
            duration_s: first.duration_s,
            settle_s: scenario.settle_s,
            dt_s: scenario.dt_s(),
        })
    }

    pub(crate) fn step(
        &self,
        estimate: &StateEstimate,
        state: &mut ControlState,
        torque: &mut TorqueCommand,
    ) {
        let t = estimate.header.tick as f64 * self.dt_s;
        let (q, qdot): (Joints, Joints) = (joints(&estimate.q), joints(&estimate.qdot));
        let u = (t / self.duration_s).min(1.0);
        let share = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u);
        let rate = 30.0 * u * u * (1.0 - u) * (1.0 - u) / self.duration_s;
        let bend = 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / (self.duration_s * self.duration_s);
        let (q_d, qdot_d) = (self.start + self.way * share, self.way * rate);
        let acceleration = self.way * bend + K_V * (qdot_d - qdot) + K_P * (q_d - q);
        let tau = self.arm.mass_matrix(&q) * acceleration + self.arm.bias(&q, &qdot);
        torque.tau = padded(&tau);
        torque.phase = match t {
            t if t < self.duration_s => PHASE_RUNNING,
            t if t < self.duration_s + self.settle_s => PHASE_SETTLING,
            _ => PHASE_DONE,
        };
        // The recorder judges and draws these.
        let (X_BE, X_BE_d) = (
            self.arm.forward_kinematics(&q),
            self.arm.forward_kinematics(&q_d),
        );
        state.tau_task = torque.tau;
        state.p_BE_d = X_BE_d.p.into();
        state.R_BE_d.copy_from_slice(X_BE_d.R.as_slice());
        state.V_BE_d = (self.arm.jacobian(&q_d) * qdot_d).into();
        state.error[..3].copy_from_slice((X_BE_d.p - X_BE.p).as_slice());
        state.path_time_s = t.min(self.duration_s);
        (state.time_scale, state.null_scale, state.task_scale) = (1.0, 1.0, 1.0);
        state.beta.fill(1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_rest_in_the_start_posture_the_torque_carries_the_arm() {
        let robot = Robot::builtin("puma560").unwrap();
        let text = "name = \"x\"\nrobot = \"puma560\"\n[start]\nq_deg = [20, -60, 170, 0, 30, 0]\n[[segment]]\n\
                    posture_deg = [0, -60, 170, 0, 30, 0]\nduration_s = 1.0\n";
        let scenario = Scenario::parse("x.toml", text, &[]).unwrap();
        let law = Law::new(&robot, &scenario).unwrap();
        let mut estimate = StateEstimate {
            q: padded(&law.start),
            ..StateEstimate::default()
        };
        let (mut state, mut torque) = (ControlState::default(), TorqueCommand::default());
        law.step(&estimate, &mut state, &mut torque);
        let gravity = law.arm.gravity(&law.start);
        assert!(
            gravity.norm() > 1.0 && (joints::<MAX_DOF>(&torque.tau) - gravity).norm() < 1e-9,
            "{torque:?}"
        );
        assert_eq!(torque.phase, PHASE_RUNNING);
        estimate.header.tick = 1_000_000;
        law.step(&estimate, &mut state, &mut torque);
        assert_eq!(torque.phase, PHASE_DONE);
    }
}
