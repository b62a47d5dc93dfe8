"""Joint drives of a plant: they limit each torque, and can stop the arm by themselves."""

import numpy as np

from . import wire


def mask(flags):
    """Bit i: flag i."""
    return sum(1 << int(i) for i in np.flatnonzero(flags))


class Drive:
    """Applies commands within the effort limits, with a bounded step per tick. Without a fresh command it holds, then stops, then brakes.

    States and limits are those of armplane's own plant, without its speed limiter and its slow return from a stop.
    """

    TORQUE_RATE = 500.0  # of the effort limit per second
    STOP_GAIN = 20.0  # damping of the stop law per unit of inertia; 1/s
    REST_RATIO = 0.05  # of the speed limit, below which the brakes engage
    STOP_TIME = 1.0  # after which they engage at any speed; s
    _COUNTS = "state", "flags", "saturation_mask", "stale_ticks", "stopping_ticks", "refused"

    def __init__(self, effort, velocity, dt, hold_ticks, carried):
        self.effort, self.dt, self.hold_ticks = effort, dt, hold_ticks
        self.rest = np.where(np.isfinite(velocity), self.REST_RATIO * velocity, 0.05)
        self.tau = np.clip(carried, -effort, effort)
        self.state = wire.DRIVE_ACTIVE
        self.flags = self.saturation_mask = self.stale_ticks = self.stopping_ticks = self.refused = 0

    @property
    def braked(self):
        return self.state == wire.DRIVE_BRAKED

    def state_bytes(self):
        """All that the next answer depends on."""
        return self.tau.tobytes() + np.array([getattr(self, name) for name in self._COUNTS], np.int64).tobytes()

    def restore(self, state):
        """Goes on from the bytes that `state_bytes` gave."""
        self.tau = np.frombuffer(state, count=len(self.tau)).copy()
        vars(self).update(zip(self._COUNTS, np.frombuffer(state, np.int64, offset=self.tau.nbytes).tolist()))

    def answer(self, command, age, qdot, gravity, inertia):
        """The torque for a tick. `command` is `None` if none arrived, `age` its age in ticks, `inertia` the diagonal of A(q)."""
        self.flags = 0
        if command is None:
            self.flags = wire.DRIVE_ABSENT
        elif age > self.hold_ticks or not np.isfinite(command).all():
            self.flags = wire.DRIVE_STALE if age > self.hold_ticks else wire.DRIVE_REFUSED
            command, self.refused = None, self.refused + 1
        self.stale_ticks = age if command is not None else self.stale_ticks + 1
        wanted = self.tau if command is None else command
        if command is not None:
            self.state = wire.DRIVE_ACTIVE
        elif self.state in (wire.DRIVE_ACTIVE, wire.DRIVE_HOLDING) and self.stale_ticks <= self.hold_ticks:
            self.state = wire.DRIVE_HOLDING
        else:
            was_stopping = self.state == wire.DRIVE_STOPPING
            self.stopping_ticks = self.stopping_ticks + 1 if was_stopping else 0
            is_at_rest = np.all(np.abs(qdot) <= self.rest) or self.stopping_ticks * self.dt >= self.STOP_TIME
            is_braked = self.braked or was_stopping and is_at_rest
            self.state = wire.DRIVE_BRAKED if is_braked else wire.DRIVE_STOPPING
            wanted = np.zeros_like(self.tau) if is_braked else gravity - self.STOP_GAIN * inertia * qdot
        tau, step = np.clip(wanted, -self.effort, self.effort), self.TORQUE_RATE * self.dt * self.effort
        limited = np.clip(tau, self.tau - step, self.tau + step)
        self.flags |= wire.DRIVE_EFFORT * np.any(tau != wanted) | wire.DRIVE_RATE * np.any(limited != tau)
        self.saturation_mask, self.tau = mask(limited != wanted), limited
        return self.tau
