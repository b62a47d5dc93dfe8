"""An arm's kinematics, dynamics and singularities as armplane computes them (`armplane inspect`), as numpy arrays."""

import json
import types

import numpy as np

from .results import _armplane


class Model:
    """An arm by built-in name or URDF file, seen at `frame` (its own end-effector frame where `None`)."""

    def __init__(self, robot, frame=None):
        self.robot, self.frame = str(robot), frame

    def at(self, q, qdot=None):
        """The arm at joint positions `q` (rad) and velocities `qdot` (rad/s): `pose` (4 × 4, X_BE), `J` (6 × n, [linear; angular]), `A`, `bias`,
        `gravity`, `singularities` and the rest of `armplane inspect --json`. Every call starts the program: a few ms."""
        values = lambda numbers: ",".join(repr(float(x)) for x in numbers)
        arguments = ["inspect", "--json", "--robot", self.robot, f"--q={values(q)}"]
        if qdot is not None:
            arguments.append(f"--qdot={values(qdot)}")
        if self.frame is not None:
            arguments += ["--frame", self.frame]
        found = json.loads(_armplane(*arguments)[0])
        is_array = lambda value: isinstance(value, list) and value and isinstance(value[0], (int, float, list))
        return types.SimpleNamespace(**{name: np.array(value) if is_array(value) else value for name, value in found.items()})

