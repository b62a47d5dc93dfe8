"""pin-pink 4.4.0: its weighted QP over joint velocities, with its limits of position and speed. Numbers: its example of a UR5 (examples/arm_ur5.py)."""

import pink
import pinocchio
from pink.tasks import FrameTask, PostureTask

from armplane.arena import Velocity, grid


class Pink(Velocity):
    lm_damping, posture_cost = 1.0, 1e-3
    trials = grid(lm_damping=(1.0, 1e-2, 1e-4), own_clock=(False, True))

    def setup(self, arm):
        model = arm.pinocchio()
        self.configuration = pink.Configuration(model, model.createData(), arm.start)
        self.hand = FrameTask("end_effector", position_cost=1.0, orientation_cost=1.0, lm_damping=self.lm_damping)
        self.posture = PostureTask(cost=self.posture_cost)
        self.posture.set_target(arm.start)

    def qdot(self, q, ref):
        self.configuration.update(q)
        self.hand.set_target(pinocchio.SE3(*ref.after(self.dt)))
        return pink.solve_ik(self.configuration, [self.hand, self.posture], self.dt, solver="daqp", safety_break=False)
