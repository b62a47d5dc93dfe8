"""Isaac Lab's operational-space controller, after the configuration that isaaclab 2.3.2.post1 documents, in our words (its own file needs torch and the packages of
a simulator): Λ = (J A⁻¹ Jᵀ)⁻¹, stiffness 100 and damping ratio 1, gravity added, spare joints drawn to the start posture. The reference's twist and acceleration are fed
forward, which it does not do: without them the hand lags. An exactly singular Λ⁻¹ ends the run, as there. Where it presses, as its tutorial run_osc.py configures
it: along the axis no motion gains, after Λ the selected motion, and of the force the set-point and its error times the contact stiffness."""

import numpy as np

from armplane.arena import Torque, grid


class Osc(Torque):
    stiffness, damping_ratio, null_stiffness, feed_forward, contact_stiffness = 100.0, 1.0, 10.0, True, 0.1
    presses = True
    # Relative eigenvalues of Λ⁻¹ between which damping sets in; none.
    thresholds = ()
    trials = grid(stiffness=(100.0, 400.0, 1600.0), null_stiffness=(10.0, 100.0))

    def torque(self, q, qdot, ref):
        arm = self.arm
        error = arm.error(q, ref)
        J, A = arm.J(q), arm.A(q)
        V, a = (ref.V, ref.a) if self.feed_forward else (np.zeros(6), np.zeros(6))
        k_v = 2 * self.damping_ratio
        Lambda = self._inverse(J @ np.linalg.solve(A, J.T))
        S, wrench = np.eye(6), np.zeros(6)
        if force := ref.force:
            S[:3, :3] -= np.outer(force.axis, force.axis)
            wrench[:3] = force.axis * (force.newtons + self.contact_stiffness * (force.newtons - force.pressed))
        wanted = self.stiffness * error + k_v * np.sqrt(self.stiffness) * (V - J @ qdot) + a
        tau = J.T @ (S @ Lambda @ S @ wanted + wrench)
        if arm.n > 6:
            back = self.null_stiffness * (arm.start - q) - k_v * np.sqrt(self.null_stiffness) * qdot
            tau += (np.eye(arm.n) - J.T @ Lambda @ np.linalg.solve(A, J.T).T) @ A @ back
        arm.move_to(q, 0 * qdot)
        return tau + arm.bias()

    def _inverse(self, matrix):
        if not self.thresholds:
            return np.linalg.inv(matrix)
        values, vectors = np.linalg.eigh(matrix)
        lower, upper = self.thresholds
        x = np.clip((values / values[-1] - lower) / (upper - lower), 0.0, 1.0)
        damping = lower * values[-1] * (1 - x * x * (3 - 2 * x))
        return vectors @ np.diag(1 / (values + damping)) @ vectors.T
