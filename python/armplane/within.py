"""A controller on the thread of a trial, instead of in a process of a run."""

import json
from types import SimpleNamespace

import numpy as np

from . import wire


class Within:
    """The messages of a controller and the tick in hand, as `Joined` has them for a process of a run."""

    previous = None

    def __init__(self, job, mjcf):
        self.job, self._mjcf = json.loads(job), mjcf
        mine = next(process for process in self.job["graph"]["process"] if process["name"] == "controller")
        self.inputs, self.outputs = ({topic: wire.TOPICS[topic][0]() for topic in mine[side]} for side in ("reads", "writes"))
        scenario = self.job["scenario"]
        self.now = SimpleNamespace(tick=0, fresh=0, lockstep=1, rate_hz=scenario["rate_hz"], dof=self.job["dof"], incarnation=1, keeps=0)

    def is_fresh(self, topic):
        """Whether a message of a topic has come for the tick in hand."""
        header = self.inputs[topic].header
        return header.tick == self.now.tick and header.incarnation > 0

    def view(self, topic):
        """The message of the tick in hand; `None` if none has come."""
        return self.inputs[topic] if self.is_fresh(topic) else None

    def mjcf(self):
        """The arm in MJCF, as `Joined.mjcf`."""
        return self._mjcf


def begin(controller, job, mjcf):
    """Starts a controller of a class; its process, its function for a tick, and the bytes of its messages."""
    within = Within(job, mjcf)
    process = controller(within)
    process._begin()
    now, answer = within.now, process.tick

    def tick(number):
        now.tick = number
        answer(number)

    return process, tick, {topic: np.frombuffer(message, np.uint8) for topic, message in (within.inputs | within.outputs).items()}
