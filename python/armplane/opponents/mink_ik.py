"""mink 1.3.0: its weighted QP over joint velocities, with its limits of position and speed. Numbers: its example of a UR5e (examples/arm_ur5e.py)."""

import mink
import numpy as np

from armplane.arena import Velocity, grid


class Mink(Velocity):
    lm_damping, damping = 1.0, 1e-3
    trials = grid(damping=(1e-3, 1e-6, 1e-9), own_clock=(False, True))

    def setup(self, arm):
        self.configuration = mink.Configuration(arm.model, arm.start)
        self.hand = mink.FrameTask("end_effector", "site", position_cost=1.0, orientation_cost=1.0, lm_damping=self.lm_damping)
        speeds = {name: speed for name, speed in zip(arm.names, arm.velocity) if np.isfinite(speed)}
        self.limits = [mink.ConfigurationLimit(arm.model), mink.VelocityLimit(arm.model, speeds)]

    def qdot(self, q, ref):
        self.configuration.update(q)
        R, p = ref.after(self.dt)
        self.hand.set_target(mink.SE3.from_rotation_and_translation(mink.SO3.from_matrix(R), p))
        return mink.solve_ik(self.configuration, [self.hand], self.dt, "daqp", damping=self.damping, limits=self.limits)
