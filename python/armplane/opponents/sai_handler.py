"""Hold and blend: the singularity handler of Stanford's SAI, from its published description and with its published numbers, in our words. In its favour, the
reference is fed forward, J̇q̇ and Coriolis torques are compensated, and the error is bounded.

The singular values of J, metres and radians mixed, split the task. Directions whose value is less than a share of the largest are singular; the rest is
controlled with its own Λ. The torque of the singular part is blended by one α with a joint strategy along the right singular vectors, in the null space of the
regular part. A jump of five radians along the null motion decides the type, and a vote of the last ticks which strategy acts: of Type 1 the joints are held
where they were at entry; of Type 2 they are pushed open loop, the harder the more of the task lies along the singular direction. Λ is split without its cross
terms, which makes torque jump."""

import mujoco
import numpy as np

from armplane.arena import Reference, Torque

# Step along the null motion by which a singularity is classified, rad; motion along the singular direction, m and rad mixed, from which on it is Type 1; how
# many ticks vote on that; and the distance from a joint limit at which the open-loop torque turns round, rad.
JUMP, MOVED, VOTERS, TURN_ROUND = 5.0, 0.5, 200, np.radians(5)
# Largest error that is answered, m and rad.
BOUNDS = 0.05, 0.25


class Handler(Torque):
    # Gains of the task; 1/s², 1/s.
    k_p, k_v = 400.0, 40.0
    # Ratios to the largest singular value: below the first the joint strategy alone acts, above the second the task alone.
    blend = (0.006, 0.06)
    # Stiffness and damping of held joints, 1/s², 1/s; the push as a share of a joint's torque limit, and the damping of the motion under it, 1/s.
    hold_k_p, hold_k_v, push, push_k_v = 50.0, 14.0, 0.01, 5.0

    def setup(self, arm):
        self.votes, self.held = 0, None
        self.side = np.where(np.isfinite(arm.effort), arm.effort, 1.0)

    def torque(self, q, qdot, ref):
        arm = self.arm
        arm.move_to(q, qdot)
        J, A, bias, turning = arm.jacobian().copy(), arm.mass_matrix(), arm.bias().copy(), self._turning(qdot)
        relative = self._wanted(q, ref, J @ qdot) - turning
        U, sigma, V = np.linalg.svd(J, full_matrices=False)
        ratio = sigma / sigma[0]
        regular = next((k for k in range(1, len(ratio)) if ratio[k] < self.blend[1]), len(ratio))
        T_ns, T_s, V_s = U.T[:regular], U.T[regular:], V[regular:]
        J_ns = T_ns @ J
        Lambda_ns, Jbar_ns = _operational(A, J_ns)
        tau = bias + J_ns.T @ (Lambda_ns @ (T_ns @ relative))
        if not len(T_s):
            self.votes, self.held = 0, None
            return tau
        self._vote(q, T_s, V_s)
        low, high = self.blend
        alpha = np.clip((ratio[regular] - low) / (high - low), 0.0, 1.0)
        if alpha > 0:
            J_s = T_s @ J
            Lambda_s, _ = _operational(A, J_s)
            tau += alpha * (J_s.T @ (Lambda_s @ (T_s @ relative))).clip(-arm.effort, arm.effort)
        J_joint = V_s @ (np.eye(arm.n) - Jbar_ns @ J_ns)
        Lambda_joint, _ = _operational(A, J_joint)
        if self.votes > 0:
            wanted = Lambda_joint @ (V_s @ (self.hold_k_p * (self.held - q) - self.hold_k_v * qdot))
        else:
            asked = abs(T_s[0] @ relative) / max(np.linalg.norm(relative), 1e-12)
            wanted = V_s @ (self._pushed(q) * self.push * asked) - self.push_k_v * Lambda_joint @ (V_s @ qdot)
        return tau + (1 - alpha) * (J_joint.T @ wanted)

    def _wanted(self, q, ref, V):
        """The acceleration that follows the reference."""
        error = self.arm.error(q, ref)
        bounded = [part * min(1, most / max(np.linalg.norm(part), 1e-12)) for part, most in zip((error[:3], error[3:]), BOUNDS)]
        return ref.a + self.k_v * (ref.V - V) + self.k_p * np.concatenate(bounded)

    def _turning(self, qdot):
        """J̇q̇ where the arm is."""
        arm, rate = self.arm, np.zeros((6, self.arm.n))
        body = arm.model.site_bodyid[arm.frame]
        mujoco.mj_jacDot(arm.model, arm.data, rate[:3], rate[3:], arm.position, body)
        return rate @ qdot

    def _vote(self, q, T_s, V_s):
        """Votes on the type. The joints are held where they were at entry, or when the votes for Type 2 were last more."""
        if self.held is None or self.votes < 0:
            self.held = q.copy()
        R, p = self.arm.pose(q)
        here = Reference(R, p, 0, 0)
        is_type_1 = any(abs(self.arm.error(q + JUMP * v, here) @ u) > MOVED for u, v in zip(T_s, V_s))
        self.votes = int(np.clip(self.votes + (1 if is_type_1 else -1), -VOTERS, VOTERS))

    def _pushed(self, q):
        """The torque limits, each with the sign of the push, which turns round near a joint limit and stays so."""
        size = abs(self.side)
        self.side = np.where(self.arm.upper - q < TURN_ROUND, -size, np.where(q - self.arm.lower < TURN_ROUND, size, self.side))
        return self.side


def _operational(A, J):
    """Λ of these rows and their dynamically consistent inverse J̄."""
    back = np.linalg.solve(A, J.T)
    Lambda = np.linalg.inv(J @ back)
    return Lambda, back @ Lambda
