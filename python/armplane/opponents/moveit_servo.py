"""MoveIt Servo's scaling near singularities, after its documentation, in our words: pseudo-inverse; from condition number 17 on slower, at 30 halted; on the
way out the range is twice as wide. The gain of the pose error is ours."""

import numpy as np

from armplane.arena import Velocity


class Servo(Velocity):
    lower, hard_stop, leaving, gain = 17.0, 30.0, 2.0, 10.0
    trials = [{"lower": lower, "hard_stop": 2 * lower, "own_clock": clock} for lower in (15.0, 100.0, 1000.0) for clock in (False, True)]

    def qdot(self, q, ref):
        J = self.arm.J(q)
        wanted = np.linalg.pinv(J) @ (ref.V + self.gain * self.arm.error(q, ref))
        condition = np.linalg.cond(J)
        size = np.linalg.norm(wanted)
        is_leaving = size > 0 and np.linalg.cond(self.arm.J(q + 1e-3 * wanted / size)) < condition
        upper = self.lower + (self.hard_stop - self.lower) * (self.leaving if is_leaving else 1.0)
        share = float(np.clip((upper - condition) / (upper - self.lower), 0.0, 1.0))
        if self.own_clock:
            self.rate = max(share, 0.0)
        return share * wanted
