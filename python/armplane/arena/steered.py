"""Runs an opponent's file as the controller of a steered run (`armplane servo`): `python -m armplane.arena.steered FILE.py`, which gives joint velocities."""

import sys

import numpy as np

from .. import wire
from ..rotation import rotation_exp, rotation_log, rotation_of
from .host import Host
from .laws import Reference, Velocity

# The reference catches up with its target at this rate, 1/s.
RATE = 10.0
# Of a joint's speed limit: how fast it goes to a posture; and its acceleration there, rad/s².
SHARE, ACCELERATION = 0.3, 2.0


def _within(values, most):
    return values * min(1, most / max(float(np.linalg.norm(values)), 1e-12))


class Steered(Host):
    """The process: a reference that moves to the target within the accelerations of the session, and the law of a file that follows it."""

    def setup(self):
        self.begin(self.job["scenario"])
        if not isinstance(self.law, Velocity):
            raise ValueError(f"{sys.argv[1]}: only controllers that give joint velocities or positions can be steered")
        self.R, self.p = self.law.arm.pose(self.law.arm.start)
        self.V, session = np.zeros(6), self.job["scenario"]["servo"]
        self.limits = session["acceleration_m_s2"], session["acceleration_rad_s2"]

    def control(self, tick, estimate, singularity, state, torque):
        n, target = self.dof, self.topics["target"].target
        q, qdot = self.q.copy(), self.qdot.copy()
        age = (tick - target.given_tick) * self.dt
        kind = target.kind if age <= target.valid_s else wire.TARGET_NONE
        if kind == wire.TARGET_POSTURE:
            wanted = np.clip(4 * (np.array(target.q[:n]) - self.law.q_d), -SHARE * self.law.arm.velocity, SHARE * self.law.arm.velocity)
            step = np.clip(wanted - self.law.qdot_d, -ACCELERATION * self.dt, ACCELERATION * self.dt)
            tau = self.law.follow(q, qdot, self.law.qdot_d + step)
            self.R, self.p = self.law.arm.pose(self.law.q_d)
            self.V = self.law.arm.J(self.law.q_d) @ self.law.qdot_d
            ref = Reference(self.R, self.p, self.V, np.zeros(6))
        else:
            ref = self._advance(kind, target, age, singularity)
            tau = self.law.torque(q, qdot, ref)
        if self.ended is None and target.kind == wire.TARGET_END:
            self.ended = tick
        self._answer(tick, np.asarray(tau, float).reshape(n), ref, state, torque)
        servo = self.topics["servo_state"]
        servo.V_target[:], servo.p_target[:] = ref.V, ref.p
        servo.speed_scale, servo.nearest, servo.age_s, servo.reason = 1.0, 1e9, age, wire.REASON_FOLLOWING

    def _advance(self, kind, target, age, singularity):
        """One tick of the reference."""
        V, error = np.zeros(6), np.zeros(6)
        if kind == wire.TARGET_POSE:
            V = np.array(target.twist)
            R = rotation_exp(V[3:] * age) @ rotation_of(target.quaternion)
            error = np.concatenate([np.array(target.position) + V[:3] * age - self.p, rotation_log(R @ self.R.T)])
        elif kind == wire.TARGET_TWIST:
            V = np.kron(np.eye(2), self._axes(target.frame, singularity)) @ np.array(target.twist)
        wanted = RATE**2 * error + 2 * RATE * (V - self.V)
        a = np.concatenate([_within(part, most) for part, most in zip((wanted[:3], wanted[3:]), self.limits)])
        self.V = self.V + a * self.dt
        self.p, self.R = self.p + self.V[:3] * self.dt, rotation_exp(self.V[3:] * self.dt) @ self.R
        return Reference(self.R, self.p, self.V, a)

    def _axes(self, frame, report):
        if frame == wire.FRAME_SINGULAR and report.count:
            nearest = min(report.singularities[: report.count], key=lambda one: abs(one.s) / one.eta_out)
            return np.array(nearest.R_BS).reshape(3, 3).T
        return self.R if frame == wire.FRAME_HAND else np.eye(3)


if __name__ == "__main__":
    Steered.run()
