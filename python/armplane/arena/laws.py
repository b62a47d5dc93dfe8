"""The base classes of opponents, the reference that they follow, and the joint servo under those that give no torque."""

import itertools

import numpy as np

from ..rotation import rotation_exp

# How fast the own clock of a law returns to full speed, 1/s, and the share of a joint's speed limit that it leaves free.
_RISE, _FREE = 4.0, 0.05


def grid(**values):
    """Every combination of the values of some attributes, as `trials` has them; the last one varies fastest."""
    return [dict(zip(values, those)) for those in itertools.product(*values.values())]


class Reference:
    """The commanded motion at a tick: rotation `R` and position `p`, twist `V`, acceleration `a`, the `leg` of the path, and whether it is `done`.

    `force`: what the hand presses with now, a `Force`, along whose axis `p` is where the hand is, and `V` and `a` are zero; `None` where it does not press.
    """

    force = None

    def __init__(self, R, p, V, a, leg=0, done=False):
        self.R, self.p, self.V, self.a, self.leg, self.done = R, p, V, a, leg, done

    def lead(self, axis, place, speed):
        """Puts another motion in place of the path's along a unit vector: at `place`, m, with `speed`, m/s."""
        self.p = self.p + axis * (place - axis @ self.p)
        self.V[:3] += axis * (speed - axis @ self.V[:3])
        self.a[:3] -= axis * (axis @ self.a[:3])

    def after(self, dt):
        """The pose that this motion leads to in `dt` seconds, as rotation and position."""
        step = self.V * dt + self.a * (dt * dt / 2)
        return rotation_exp(step[3:]) @ self.R, self.p + step[:3]


class Law:
    """What all opponents have: the `arm`, the length of a tick `dt`, the `scenario`, and the clock.

    Its own numbers are class attributes, which a table can vary. `rate`, 0 to 1, is how fast the path's clock runs from the next tick on; a law may set it.
    """

    rate = 1.0
    # Whether it follows `ref.force`. A law that does not is not run where a scenario presses.
    presses = False
    # Settings of its attributes that are tried when it is tuned, at most six.
    trials = ()

    def begin(self, arm, dt, scenario):
        self.arm, self.dt, self.scenario = arm, dt, scenario
        self.setup(arm)

    def setup(self, arm):
        """Called once at the start."""

    def torque(self, q, qdot, ref):
        """The torques for joint positions and velocities as estimated, and the reference; N·m."""
        raise NotImplementedError("a torque law defines torque(self, q, qdot, ref)")


class Torque(Law):
    """A law that gives torques: `torque(q, qdot, ref)`."""


class Velocity(Law):
    """A law that gives joint velocities: `qdot(q, ref)`, rad/s.

    The same servo follows all of them: τ = A(q)(q̈_d + k_p (q_d − q) + k_v (q̇_d − q̇)) + b(q, q̇), where q_d integrates q̇_d from the start, and q̈_d is the
    difference of its last two values (left out with `feed_forward = False`). `q` is q_d, as in the examples of the kinematic packages; with
    `measured = True` the estimated positions. With `own_clock = True` the path's clock slows down where q̇_d would exceed a joint's speed limit, and q̇_d
    with it.
    """

    k_p = 1600.0
    k_v = 80.0
    feed_forward = True
    measured = False
    own_clock = False

    def begin(self, arm, dt, scenario):
        self.q_d, self.qdot_d = arm.start.copy(), np.zeros(arm.n)
        super().begin(arm, dt, scenario)

    def qdot(self, q, ref):
        """Joint velocities that lead from here to the reference; rad/s."""
        raise NotImplementedError("a velocity law defines qdot(self, q, ref)")

    def torque(self, q, qdot, ref):
        wanted = np.asarray(self.qdot(q if self.measured else self.q_d, ref), float).reshape(self.arm.n)
        if self.own_clock:
            wanted = self._slowed(wanted)
        return self.follow(q, qdot, wanted)

    def follow(self, q, qdot, wanted):
        """The servo's torques for joint velocities; N·m."""
        qddot = (wanted - self.qdot_d) / self.dt if self.feed_forward else 0
        self.arm.move_to(q, qdot)
        tau = self.arm.mass_matrix() @ (qddot + self.k_p * (self.q_d - q) + self.k_v * (wanted - qdot)) + self.arm.bias()
        self.q_d, self.qdot_d = self.q_d + self.dt * wanted, wanted
        return tau

    def _slowed(self, wanted):
        """The velocities within the limits, and the clock at the rate at which they suffice."""
        excess = np.max(np.abs(wanted) / ((1 - _FREE) * self.arm.velocity), initial=0)
        self.rate = min(self.rate / max(excess, 1e-9), self.rate + _RISE * self.dt, 1)
        return wanted / max(excess, 1)


class Position(Velocity):
    """A law that gives joint positions for the next tick: `position(q, ref)`, rad. The servo of `Velocity` follows them."""

    def position(self, q, ref):
        """Joint positions at which the arm meets the reference; rad."""
        raise NotImplementedError("a position law defines position(self, q, ref)")

    def qdot(self, q, ref):
        return (np.asarray(self.position(q, ref), float).reshape(self.arm.n) - self.q_d) / self.dt
