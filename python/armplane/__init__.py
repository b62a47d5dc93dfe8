"""Drives robot arms through kinematic singularities: a library of arms and the law, runs with their results, and processes of a run.

    arm = armplane.Arm.builtin("ur5")            # or Arm.from_urdf("ur5e.urdf", tip="tool0")
    arm.singularities(q)                         # each with name, type, measure, direction
    law = armplane.Law(arm, dt=0.001)
    tau = law.step(q, qdot, pose, twist)         # N·m; law.state: mode, reason, β
    run = armplane.run("fig5-wrist-rotation")    # run.signals, run.summary, run.view()
    row = armplane.trial("fig5-wrist-rotation", {"control.k_p": 900})    # without processes and files; `trace` has the signals

SI units. Poses and twists are those of the end-effector E in the base B; twists are `[linear; angular]`.
"""

from pkgutil import extend_path

# Read from its source tree, the package finds the extension module of an installed wheel.
__path__ = extend_path(__path__, __name__)

from . import wire
from .joined import Joined, ProcessError
from .lazy import lazily
from .process import Controller, Observer, Operator, Plant, Process
from .results import Run, extra, load, run

_PLACES = {"_armplane": ("Arm", "Law", "LawState", "Posture", "Reference", "Singularity"), "trials": ("laws", "lines", "trace", "trial")}
_names, _found = lazily(__name__, _PLACES)
__all__ = ["Controller", "Joined", "Observer", "Operator", "Plant", "Process", "ProcessError", "Run", "load", "run", "subscribe", "wire", *_names]
__dir__ = lambda: __all__


def subscribe(topic, run=None):
    """Listens to a topic of a run in progress, from outside: `for torque in armplane.subscribe("torque"): ...` (needs iceoryx2)."""
    with extra("live"):
        from . import live

    return live.subscribe(topic, run)


def __getattr__(name):
    # A process of a run needs neither numpy nor the extension module, and starts in milliseconds without them.
    try:
        return _found(name)
    except ImportError as error:
        raise ImportError(f"armplane.{name} is part of the wheel that `python/build` makes (docs/python.md): {error}") from error
