"""roboplan 0.7.0 (roboplan-core, roboplan-oink): its QP over joint steps, OInK, with its limits of position and speed. Numbers: its example of a UR5 that passes
through singularities (roboplan_examples/python/example_singularity.py)."""

import numpy as np
from roboplan.core import CartesianConfiguration, Scene, loadUrdfSceneDescriptionFromXml
from roboplan.optimal_ik import ConfigurationTask, ConfigurationTaskOptions, FrameTask, FrameTaskOptions, Oink, PositionLimit, VelocityLimit

from armplane.arena import Velocity, grid


class Roboplan(Velocity):
    lm_damping, orientation_cost, posture_weight, regularization = 1e-3, 0.1, 0.05, 1e-6
    trials = grid(lm_damping=(1e-3, 1e-5, 0.0), posture_weight=(0.05, 0.0), own_clock=(True,))

    def setup(self, arm):
        self.scene = Scene("arm", loadUrdfSceneDescriptionFromXml(arm.urdf()))
        self.solver = Oink(self.scene)
        place = CartesianConfiguration("universe", "end_effector", np.eye(4))
        options = FrameTaskOptions(position_cost=1.0, orientation_cost=self.orientation_cost, task_gain=1.0, lm_damping=self.lm_damping)
        self.hand = FrameTask(self.solver, self.scene, place, options)
        weights = np.full(arm.n, self.posture_weight)
        self.tasks = [self.hand, ConfigurationTask(self.solver, arm.start, weights, ConfigurationTaskOptions(task_gain=0.1, lm_damping=0.0))]
        self.limits = [PositionLimit(self.solver, gain=1.0), VelocityLimit(self.solver, self.dt, np.minimum(arm.velocity, 1e3))]
        self.step = np.zeros(arm.n)

    def qdot(self, q, ref):
        target = np.eye(4)
        target[:3, :3], target[:3, 3] = ref.after(self.dt)
        self.hand.setTargetFrameTransform(target)
        self.scene.setJointPositions(q)
        try:
            self.solver.solveIk(self.scene, self.tasks, self.limits, self.step, self.regularization)
        except RuntimeError:
            # As its example: no step.
            self.step[:] = 0.0
        return self.step / self.dt
