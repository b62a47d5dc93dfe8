"""jparse-robotics 0.1.0: the projected and clamped pseudo-inverse of J-PARSE. γ: its own default; the gain of the pose error is ours."""

from jparse_robotics import JParseCore

from armplane.arena import Velocity, grid


class JParse(Velocity):
    gamma, gain = 0.1, 10.0
    trials = grid(gamma=(0.1, 0.02, 0.005), own_clock=(False, True))

    def setup(self, arm):
        self.core = JParseCore(gamma=self.gamma)

    def qdot(self, q, ref):
        return self.core.compute(self.arm.J(q)) @ (ref.V + self.gain * self.arm.error(q, ref))
