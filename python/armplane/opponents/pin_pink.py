"""pin-pink 4.4.0: its weighted QP over joint velocities, with its limits of position and speed. Numbers: its example of a UR5 (examples/arm_ur5.py)."""

import pink
import pinocchio
from pink.tasks import FrameTask, PostureTask

from armplane.arena import Velocity


class Pink(Velocity):
    lm_damping, posture_cost = 1.0, 1e-3
    trials = [{"lm_damping": damping, "own_clock": clock} for damping in (1.0, 1e-2, 1e-4) for clock in (False, True)]

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
