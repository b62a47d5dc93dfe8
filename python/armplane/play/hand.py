"""The target of the arm at each moment: of a person's hand, a posture, or a tour."""

import itertools
from time import monotonic

import numpy as np
from viser.transforms import SO3

from .scene import quaternion


class Hand:
    """The target of one session. `mode` is hold, hand, posture or tour; `goal` the pose that the
    target moves to."""

    def __init__(self, session):
        self.session, self.robot, self.arrivals = session, session.robot, 0
        self.hold()

    def hold(self):
        """The target is where the hand is."""
        R, p = self._pose(self.session.q)
        self.mode, self.goal, self.sent = "hold", (p, quaternion(R)), (p, SO3.from_matrix(R))

    def _pose(self, q):
        X = self.robot.frames(q)[-1]
        return X[:3, :3], X[:3, 3]

    def go(self, q):
        """To a posture."""
        self.posture = np.clip(q, self.robot.lower, self.robot.upper)
        R, p = self._pose(self.posture)
        self.mode, self.goal = "posture", (p, quaternion(R))

    def drag(self, position, wxyz, phase):
        """With a person's hand; in the phase `end` it lets go."""
        if self.mode != "hand":
            self.hold()
        self.mode, self.goal = "hold" if phase == "end" else "hand", (position, wxyz)

    def start_tour(self, postures):
        self.mode, self.tour = "tour", self._tour(postures)

    def line(self, dt, speed):
        """The target now, as `armplane servo --from -` reads it; `dt`: since the last one, s."""
        if self.mode == "tour":
            return next(self.tour)
        if self.mode == "posture":
            if np.abs(self.session.q - self.posture).max() >= 0.01:
                return _line("posture, joints, 0.5", self.posture)
            self.hold()
            self.arrivals += 1
        p, R = self.sent
        way, turn = self.goal[0] - p, (SO3(self.goal[1]) @ R.inverse()).log()
        v, w = _slowed(way, speed), _slowed(turn, 3 * speed)
        self.sent = p, R = p + v * dt, (SO3.exp(w * dt) @ R).normalize()
        return _line("pose, base, 0.3", p, R.wxyz, v, w)

    def _tour(self, postures):
        """Near each singularity, along ζ and back, home; without end."""
        for name, q in itertools.cycle(postures.items()):
            end = monotonic() + 8
            while np.abs(self.session.q - q).max() > 0.02 and monotonic() < end:
                yield _line("posture, joints, 0.5", q)
            for side, seconds in () if name == "start" else ((1, 1.2), (-1, 2.4), (1, 1.2)):
                end = monotonic() + seconds
                while monotonic() < end:
                    yield _line("twist, singular, 0.3", side * self._along_zeta())

    def _along_zeta(self):
        servo, report = self.session.seen["servo_state"], self.session.seen["singularity"]
        place = servo.singularity - 1
        if place >= 0 and report.singularities[place].angular:
            return np.array([0, 0, 0, 0.5, 0, 0])
        return np.array([0.08, 0, 0, 0, 0, 0])


def _line(head, *values):
    return f"{head}, " + " ".join(f"{x:.7g}" for x in np.concatenate(values))


def _slowed(way, most):
    """The speed with which a way is gone: in proportion to it, at most `most`."""
    return way * min(8, most / max(float(np.linalg.norm(way)), 1e-9))
