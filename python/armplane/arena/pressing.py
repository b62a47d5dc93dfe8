"""The approach to a surface and the wait for its force: the same for all opponents that press."""

from dataclasses import dataclass

import numpy as np

# As in armplane's own law (services/control/src/law/force.rs). Time constant of the force by which a contact is told, s; share of the force from which on there
# is a contact, and the least such force, N; share of the force within which it counts as reached, and for how long, s; how long a segment waits for it, s.
_FELT_S, _TOUCH, _REACHED, _PATIENCE_S = 0.004, (0.1, 0.7), (0.1, 0.05), 10.0


@dataclass
class Force:
    """The force along `axis`, a unit vector in base axes: the set-point `newtons`, which rises within the scenario's ramp, and `pressed` as the wrist's sensor
    measures it, N. `surface`: where along the axis the hand has met the surface, m, and `stiffness`, about that surface's, N/m."""

    axis: np.ndarray
    newtons: float
    pressed: float
    surface: float
    stiffness: float


class Pressing:
    """Where a segment's force stands. `waits`: the path's clock stands until the force is reached."""

    def __init__(self, dt):
        self.dt, self.leg, self.touches, self.waits = dt, None, False, False

    def take(self, ref, asked, R, p, wrist):
        """Puts into the reference what the scenario asks for: until a contact an approach at its speed, then the force, along whose axis nothing moves.

        `R`, `p`: the hand's pose; `wrist`: the measured force on it, base axes, N. Raises ValueError where nothing is met, or the force does not come about.
        """
        if asked is None:
            self.leg, self.touches, self.waits = None, False, False
            return
        e, newtons = R @ asked["axis"] if asked["of_tool"] else asked["axis"], asked["newtons"]
        if ref.leg != self.leg:
            self._begin(ref.leg, e @ p)
        pressed = -float(e @ wrist)
        self.felt += (pressed - self.felt) * self.dt / (_FELT_S + self.dt)
        if not self.touches and self.felt > min(max(_TOUCH[0] * newtons, _TOUCH[1]), 0.5 * newtons):
            self.touches, self.set_n, self.surface = True, min(self.felt, newtons), e @ p - pressed / asked["stiffness_n_m"]
        self._wait(asked)
        if not self.touches:
            self.place += asked["approach_m_s"] * self.dt
            ref.lead(e, self.place, asked["approach_m_s"])
            return
        rise = newtons / asked["ramp_s"] * self.dt
        self.set_n += float(np.clip(newtons - self.set_n, -rise, rise))
        ref.lead(e, e @ p, 0.0)
        ref.force = Force(e, self.set_n, pressed, self.surface, asked["stiffness_n_m"])

    def _begin(self, leg, place):
        """A segment begins; a contact goes on into it."""
        self.leg, self.waits, self.begun, self.place, self.waited, self.lasted = leg, True, place, place, 0.0, 0.0
        if not self.touches:
            self.felt = 0.0

    def _wait(self, asked):
        if not self.waits:
            return
        self.waited += self.dt
        if self.place - self.begun > asked["reach_m"] or self.waited > max(_PATIENCE_S, 2 * asked["reach_m"] / asked["approach_m_s"]):
            raise ValueError("the hand could not press as asked" if self.touches else f"the hand met nothing within {asked['reach_m']} m")
        until, newtons = asked["until_newtons"], asked["newtons"]
        is_there = self.felt >= until if until else abs(self.felt - newtons) <= _REACHED[0] * newtons
        self.lasted = self.lasted + self.dt if self.touches and is_there else 0.0
        self.waits = not self.lasted > (0.0 if until else _REACHED[1])
