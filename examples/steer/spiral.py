"""A growing spiral of the hand in the y-z plane, asked for as a twist: an operator in Python."""

import math

import armplane
from armplane import wire

TURN_S, GROWTH_M_S, LASTS_S = 2, 0.01, 8


class Spiral(armplane.Operator):
    def steer(self, tick: int, target: wire.TargetContent, sensor: wire.SensorSample) -> None:
        t, omega = tick * self.dt, 2 * math.pi / TURN_S
        radius = GROWTH_M_S * t
        y, z = math.cos(omega * t), math.sin(omega * t)
        # The derivative of radius·(cos, sin), 0.1 s old at most before the arm comes to rest.
        target.kind, target.frame, target.valid_s = wire.TARGET_TWIST, wire.FRAME_BASE, 0.1
        target.twist[1] = GROWTH_M_S * y - radius * omega * z
        target.twist[2] = GROWTH_M_S * z + radius * omega * y
        if t >= LASTS_S:
            target.kind = wire.TARGET_END


if __name__ == "__main__":
    Spiral.run()
