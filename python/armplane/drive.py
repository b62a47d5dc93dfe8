"""Joint drives of a plant: they limit each torque, and can stop the arm by themselves."""

import numpy as np

from . import wire


class Drive:
    """Applies commands within the effort limits, with a bounded step per tick. Without a fresh command it holds, then stops, then brakes.

    States and limits are those of armplane's own plant, without its speed limiter and its slow return from a stop.
    """

    TORQUE_RATE = 500.0  # of the effort limit per second
    STOP_GAIN = 20.0  # damping of the stop law per unit of inertia; 1/s
    REST_RATIO = 0.05  # of the speed limit, below which the brakes engage
    STOP_TIME = 1.0  # after which they engage at any speed; s

    def __init__(self, effort, velocity, dt, hold_ticks, carried):
        self.effort = effort
        self.rest = np.where(np.isfinite(velocity), self.REST_RATIO * velocity, 0.05)
        self.dt, self.hold_ticks = dt, hold_ticks
        self.tau = np.clip(carried, -self.effort, self.effort)
        self.state, self.flags, self.saturation_mask = wire.DRIVE_ACTIVE, 0, 0
        self.stale_ticks = self.stopping_ticks = self.refused = 0

    @property
    def braked(self):
        return self.state == wire.DRIVE_BRAKED

    def state_bytes(self):
        """All that the next answer depends on."""
        counts = self.state, self.flags, self.saturation_mask, self.stale_ticks, self.stopping_ticks, self.refused
        return self.tau.tobytes() + np.array(counts, np.int64).tobytes()

    def restore(self, state):
        """Goes on from the bytes that `state_bytes` gave."""
        self.tau = np.frombuffer(state, count=len(self.tau)).copy()
        counts = np.frombuffer(state, np.int64, offset=self.tau.nbytes).tolist()
        self.state, self.flags, self.saturation_mask, self.stale_ticks, self.stopping_ticks, self.refused = counts

    def answer(self, command, age, qdot, gravity, inertia):
        """The torque for a tick. `command` is `None` if none arrived, `age` its age in ticks, `inertia` the diagonal of A(q)."""
        self.flags = 0
        if command is None:
            self.flags = wire.DRIVE_ABSENT
        elif age > self.hold_ticks:
            self.flags, command, self.refused = wire.DRIVE_STALE, None, self.refused + 1
        elif not np.all(np.isfinite(command)):
            self.flags, command, self.refused = wire.DRIVE_REFUSED, None, self.refused + 1
        self.stale_ticks = age if command is not None else self.stale_ticks + 1
        if command is not None:
            self.state = wire.DRIVE_ACTIVE
            wanted = command
        elif self.state in (wire.DRIVE_ACTIVE, wire.DRIVE_HOLDING) and self.stale_ticks <= self.hold_ticks:
            self.state = wire.DRIVE_HOLDING
            wanted = self.tau
        else:
            self.stopping_ticks = self.stopping_ticks + 1 if self.state == wire.DRIVE_STOPPING else 0
            is_at_rest = np.all(np.abs(qdot) <= self.rest) or self.stopping_ticks * self.dt >= self.STOP_TIME
            if self.state == wire.DRIVE_BRAKED or (self.state == wire.DRIVE_STOPPING and is_at_rest):
                self.state = wire.DRIVE_BRAKED
                wanted = np.zeros_like(self.tau)
            else:
                self.state = wire.DRIVE_STOPPING
                wanted = gravity - self.STOP_GAIN * inertia * qdot
        tau = np.clip(wanted, -self.effort, self.effort)
        if np.any(tau != wanted):
            self.flags |= wire.DRIVE_EFFORT
        step = self.TORQUE_RATE * self.dt * self.effort
        limited = np.clip(tau, self.tau - step, self.tau + step)
        if np.any(limited != tau):
            self.flags |= wire.DRIVE_RATE
        self.saturation_mask = int(sum(1 << int(i) for i in np.flatnonzero(limited != wanted)))
        self.tau = limited
        return self.tau
