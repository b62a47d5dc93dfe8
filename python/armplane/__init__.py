"""Processes of an armplane run in Python, runs started from Python, and their results as tables."""

from . import wire
from .exchange import Exchange, WireError
from .process import Controller, Observer, Operator, Plant, Process
from .results import Run, load, run

__all__ = ["Controller", "Exchange", "Observer", "Operator", "Plant", "Process", "Run", "WireError", "load", "model", "run", "subscribe", "wire"]


def subscribe(topic, run=None):
    """Messages of a topic of a living run, from outside: `for torque in armplane.subscribe("torque"): ...` (needs iceoryx2)."""
    from .live import Subscriber

    return Subscriber(topic, run)


def model(robot, frame=None):
    """An arm's kinematics, dynamics and singularities: `armplane.model("puma560").at(q).J` (needs numpy)."""
    from .inspect_model import Model

    return Model(robot, frame)
