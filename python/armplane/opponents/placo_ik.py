"""placo 0.10.2: its QP over joint steps, with its limits of position and speed. Numbers: its example of a six-axis arm (kinematics/6axis_targets.py)."""

import numpy as np
import placo

from armplane.arena import Velocity, grid


class Placo(Velocity):
    regularization = 0.0
    trials = grid(regularization=(0.0, 1e-6, 1e-4), own_clock=(False, True))

    def setup(self, arm):
        self.file = arm.urdf_file()
        self.robot = placo.RobotWrapper(self.file.name, placo.Flags.ignore_collisions)
        self.solver = placo.KinematicsSolver(self.robot)
        self.solver.mask_fbase(True)
        self.solver.enable_velocity_limits(True)
        self.solver.dt = self.dt
        self.hand = self.solver.add_frame_task("end_effector", np.eye(4))
        self.hand.configure("end_effector", "soft", 1.0, 1.0)
        if self.regularization:
            self.solver.add_regularization_task(self.regularization)
        self.places = [self.robot.get_joint_v_offset(name) for name in arm.names]

    def qdot(self, q, ref):
        for name, value in zip(self.arm.names, q):
            self.robot.set_joint(name, value)
        self.robot.update_kinematics()
        target = np.eye(4)
        target[:3, :3], target[:3, 3] = ref.after(self.dt)
        self.hand.T_world_frame = target
        return self.solver.solve(False)[self.places] / self.dt
