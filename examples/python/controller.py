"""A straight line of the hand with a damped inverse of the Jacobian, as one writes it in a first course; MuJoCo gives J, A and the bias torque."""

import armplane
import numpy as np
from armplane import wire
from armplane.mujoco import Arm

DAMPING, K_P, K_V = 0.05, 400.0, 40.0


class LineController(armplane.Controller):
    def setup(self) -> None:
        self.arm = Arm(self.mjcf())
        segment = self.job["scenario"]["segment"][0]
        self.duration = segment["duration_s"]
        self.p_0, self.R_0 = self.arm.position.copy(), self.arm.rotation.copy()
        self.line = np.array(segment["by_m"])
        self.settle = self.duration + self.job["scenario"]["settle_s"]

    def control(
        self, tick: int, estimate: wire.StateEstimate, singularity: wire.SingularityReport, state: wire.ControlState, torque: wire.TorqueCommand
    ) -> None:
        arm, n, t = self.arm, self.arm.n, tick * self.dt
        u = min(t / self.duration, 1.0)
        s, rate = u**3 * (10 - 15 * u + 6 * u * u), 30 * u * u * (1 - u) ** 2 / self.duration
        arm.move_to(estimate.q[:n], estimate.qdot[:n])
        J, qdot = arm.jacobian(), np.array(estimate.qdot[:n])
        turn = sum(np.cross(arm.rotation[:, i], self.R_0[:, i]) for i in range(3)) / 2
        error = np.concatenate([self.p_0 + s * self.line - arm.position, turn])
        wanted = np.concatenate([rate * self.line, np.zeros(3)])
        xddot = K_P * error + K_V * (wanted - J @ qdot)
        qddot = J.T @ np.linalg.solve(J @ J.T + DAMPING**2 * np.eye(6), xddot)
        torque.tau[:n] = (arm.mass_matrix() @ qddot + arm.bias()).tolist()
        torque.phase = wire.PHASE_RUNNING if t < self.duration else wire.PHASE_SETTLING if t < self.settle else wire.PHASE_DONE
        state.p_BE_d[:], state.R_BE_d[:] = (self.p_0 + s * self.line).tolist(), self.R_0.T.flatten().tolist()
        state.V_BE_d[:], state.error[:] = wanted.tolist(), error.tolist()
        state.path_time_s, state.time_scale, state.null_scale, state.task_scale = min(t, self.duration), 1.0, 1.0, 1.0
        state.beta[:] = [1.0] * 4


if __name__ == "__main__":
    LineController.run()
