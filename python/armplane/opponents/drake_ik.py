"""Drake 1.51.1: its differential inverse kinematics, which keeps the direction of the motion and slows it down where a limit demands it."""

import numpy as np
from pydrake.multibody.inverse_kinematics import DifferentialInverseKinematicsParameters, DifferentialInverseKinematicsStatus, DoDifferentialInverseKinematics

from armplane.arena import Reference, Velocity, grid


class Drake(Velocity):
    centering = 0.0
    trials = grid(centering=(0.0, 1.0, 10.0), own_clock=(False, True))

    def setup(self, arm):
        self.parameters = p = DifferentialInverseKinematicsParameters(arm.n, arm.n)
        p.set_time_step(self.dt)
        p.set_nominal_joint_position(arm.start)
        p.set_joint_centering_gain(self.centering * np.eye(arm.n))
        p.set_joint_position_limits((arm.lower, arm.upper))
        p.set_joint_velocity_limits((-arm.velocity, arm.velocity))

    def qdot(self, q, ref):
        V = self.arm.error(q, Reference(*ref.after(self.dt), 0, 0)) / self.dt
        result = DoDifferentialInverseKinematics(q, self.qdot_d, V, self.arm.J(q), self.parameters)
        if result.status == DifferentialInverseKinematicsStatus.kNoSolutionFound:
            return np.zeros(self.arm.n)
        if self.own_clock:
            # The share of the motion that the limits let through.
            self.rate = float(np.clip(V @ self.arm.J(q) @ result.joint_velocities / max(V @ V, 1e-12), 0.0, 1.0))
        return result.joint_velocities
