"""The arm in MuJoCo, as the plant of any scenario: `armplane run fig5-wrist-rotation --graph examples/mujoco/graph.toml`.

Needs `pip install mujoco` and the package armplane (docs/python.md), or `PYTHONPATH=python`. The arm comes from the run's own URDF; encoders and their noise are those of armplane's plant.
"""

import armplane
import numpy as np
from armplane.drive import Drive
from armplane.mujoco import Arm
from armplane.noise import Gaussian


class Plant(armplane.Plant):
    def setup(self):
        scenario, plant = self.job["scenario"], self.job["scenario"]["plant"]
        self.arm = Arm(self.job)
        self.drive = Drive(self.arm.robot.joints, self.dt, plant["hold_ticks"], self.arm.bias().copy())
        bits = plant["encoder_bits"]
        turn = np.array([1.0 if joint.kind == "prismatic" else 2.0 * np.pi for joint in self.arm.robot.joints])
        self.count = turn / 2**bits if bits else None
        self.noise, self.noise_counts = Gaussian(scenario["seed"], self.arm.n), plant["encoder_noise_counts"]

    def step(self, torque):
        arm, n = self.arm, self.arm.n
        tick = self.exchange.head.tick - 1
        age = tick - torque.header.tick if torque else 0
        command = np.array(torque.tau[:n]) if torque else None
        gravity, inertia = (arm.bias(), arm.mass_matrix().diagonal()) if command is None else (None, None)
        tau = self.drive.answer(command, age, arm.data.qvel, gravity, inertia)
        if self.drive.braked:
            arm.move_to(arm.data.qpos.copy())
        else:
            arm.step(tau)

    def sample(self, tick, sensor, truth):
        arm, n, drive = self.arm, self.arm.n, self.drive
        q, qdot = arm.data.qpos, arm.data.qvel
        reading = q if self.count is None else self.count * np.round(q / self.count + self.noise_counts * self.noise(tick))
        sensor.q_encoder[:n] = reading.tolist()
        sensor.tau_drive[:n] = truth.tau[:n] = drive.tau.tolist()
        sensor.drive, sensor.stale_ticks = truth.drive, _ = drive.state, drive.stale_ticks
        truth.q[:n], truth.qdot[:n] = q.tolist(), qdot.tolist()
        truth.p_BE[:] = arm.position.tolist()
        truth.R_BE[:] = arm.rotation.T.flatten().tolist()
        truth.V_BE[:] = (arm.jacobian() @ qdot).tolist()
        truth.drive_flags, truth.saturation_mask, truth.refused = drive.flags, drive.saturation_mask, drive.refused


if __name__ == "__main__":
    Plant.run()
