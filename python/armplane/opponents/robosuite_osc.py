"""robosuite 1.5.2: the functions of its operational-space controller, with its gains (osc_pose.json). The reference's twist and acceleration are fed forward,
which robosuite does not do for its own targets: without them the hand lags. It presses by a goal beyond the surface, so far that its spring gives the force of the
set-point in this posture, and no other; it reads no measured force."""

import numpy as np
from robosuite.utils.control_utils import nullspace_torques, opspace_matrices

from armplane.arena import Torque, grid


class Osc(Torque):
    k_p, damping_ratio, uncoupled = 150.0, 1.0, True
    presses = True
    trials = grid(k_p=(150.0, 400.0, 1600.0), uncoupled=(True, False))

    def torque(self, q, qdot, ref):
        arm = self.arm
        error = arm.error(q, ref)
        arm.move_to(q, qdot)
        J, A, bias = arm.jacobian().copy(), arm.mass_matrix(), arm.bias().copy()
        k_d = 2 * np.sqrt(self.k_p) * self.damping_ratio
        F = self.k_p * error + k_d * (ref.V - J @ qdot) + ref.a
        whole, position, orientation, null = opspace_matrices(A, J, np.ascontiguousarray(J[:3]), np.ascontiguousarray(J[3:]))
        if force := ref.force:
            # The hand goes in as deep as the surface gives way.
            deeper = force.surface + force.newtons / force.stiffness - force.axis @ arm.position
            F[:3] += self.k_p * deeper * force.axis + J[:3] @ np.linalg.solve(A, J[:3].T @ force.axis) * force.newtons
        wrench = np.concatenate([position @ F[:3], orientation @ F[3:]]) if self.uncoupled else whole @ F
        return J.T @ wrench + bias + nullspace_torques(A, null, arm.start, q, qdot)
