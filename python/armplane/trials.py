"""Runs without processes, one on each thread that asks: the same bytes on every topic as `armplane run`.

Python's lock is free while a run lasts, so threads use all cores. A scenario is a built-in name, the path of a file, or a text in TOML.
"""

import json
import os
import tempfile
from pathlib import Path

from . import _armplane
from .process import Controller
from .results import as_settings, extra


def trial(scenario, settings=None, faults=None, seed=None, controller=None):
    """Runs a scenario, and returns its row: `outcome`, `reason`, and the numbers of `summary.json`, a key each; `hash` has one of each topic.

    `settings` overrides keys of the scenario: `{"control.k_p": 900}`. `faults` replaces its faults, a dictionary each, with the keys of `[[fault]]`.
    `seed` replaces its seed. `controller`, a class derived from `armplane.Controller`, controls the run in place of a law: an object of it gets the
    messages that it would get in a process, and what it raises is raised here. If the law or the arm refuses the scenario, the row has only `outcome`
    ("refused") and `reason`. Raises ValueError if the scenario or a setting is invalid.
    """
    return json.loads(_armplane.run_trial(_named("scenario", scenario), as_settings(settings, faults), _whole("seed", seed), _class(controller)))


def trace(scenario, settings=None, faults=None, seed=None, controller=None):
    """Runs a scenario, and returns its signals as a `pyarrow.Table`, a row per tick, with the columns of `armplane export`. Arguments as of `trial`."""
    with extra("experiments"):
        from pyarrow import ipc

    stream = _armplane.trace_trial(_named("scenario", scenario), as_settings(settings, faults), _whole("seed", seed), _class(controller))
    return ipc.open_stream(stream).read_all()


def lines(robot, count, seed=1, kind="one", *, speed=0.28, settings=None):
    """Draws straight lines through singular postures of an arm: a list of dictionaries with `singularities`, `place`, and `scenario`, which `trial` takes.

    `kind="one"` draws `count` lines through each singularity, exactly, `"two"` through each pair at once; `"near"` draws `count` lines in all, through and
    near the singularities of a PUMA. `robot` is a built-in name or the path of a URDF or MJCF file. The lines' peak speed is `speed`, m/s.
    """
    if kind not in ("one", "two", "near"):
        raise ValueError(f"kind is {kind!r}: it must be 'one', 'two' or 'near'")
    if not 0 < speed <= 10:
        raise ValueError(f"speed = {speed} m/s: give one above 0, at most 10; are these mm/s?")
    return json.loads(_armplane.draw_lines(_named("robot", robot), kind, _whole("count", count, 1), _whole("seed", seed), speed, as_settings(settings)))


def twists(robot, seed=1, seconds=60.0):
    """A scenario that steers an arm by random twists, every 1 to 3 s another one, up to 0.25 m/s and 0.6 rad/s; `trial` takes it."""
    return _armplane.random_twists(_named("robot", robot), _whole("seed", seed), float(seconds))


def laws(all=False):
    """The names of the control laws that follow paths, the paper's first; with `all`, those for steering only, too."""
    return [name for name, follows in _armplane.law_names() if follows or all]


def arm_of(urdf, description, tip=None):
    """The arm of a URDF and of its description, two texts, as a run keeps them."""
    with tempfile.TemporaryDirectory(prefix="armplane-") as folder:
        path = Path(folder, "robot.urdf")
        path.write_text(urdf, encoding="utf-8")
        path.with_suffix(".toml").write_text(description, encoding="utf-8")
        return _armplane.Arm.from_urdf(path, tip)


def _whole(name, value, least=0):
    if value is not None and (isinstance(value, (str, bool)) or int(value) != value or not least <= value < 2**63):
        raise ValueError(f"{name} = {value!r}: give a whole number from {least}")
    return value


def _class(controller):
    if controller is not None and not (isinstance(controller, type) and issubclass(controller, Controller)):
        raise ValueError(f"controller is {controller!r}: give a class derived from armplane.Controller")
    return controller


def _named(name, value):
    if not isinstance(value, (str, os.PathLike)):
        raise ValueError(f"{name} is {value!r}: give a built-in name or the path of a file")
    return str(value)
