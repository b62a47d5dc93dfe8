"""The arm of a log: kinematics of many postures at once, from any URDF or MJCF file, with or without masses."""

import pathlib

import armplane
import numpy as np

from ..trials import arm_of


class Robot:
    """An arm, its limits and its kinematics for N postures at once.

    `lower`, `upper`, `velocity`, `effort`: limits, shape (n,), infinite where the file states none; `length` (m) makes metres comparable to radians;
    `scale` (6,) turns a twist's metres into radians, and leaves out what is not the hand's task. `notes`: sentences about gaps of the file.
    """

    def __init__(self, name, tip=None, text=None, description=""):
        """`name`: a built-in arm or the path of a URDF or MJCF file; `text`: a URDF from the log, with its `description`. Raises ValueError."""
        self.arm = arm = _open(name, tip, text, description)
        self.name, self.dof, self.joints = arm.name, arm.dof, list(arm.joints)
        self.lower, self.upper, self.velocity, self.effort = arm.lower, arm.upper, arm.velocity, arm.effort
        lacked = [words for words, limits in (("speed limits", self.velocity), ("torque limits", self.effort)) if np.isinf(limits).any()]
        self.notes = [f"The robot's file lacks some {' and '.join(lacked)}; those joints are judged without them."] if lacked else []
        zero = np.zeros((1, self.dof))
        self.turns = np.linalg.norm(self.move(zero)[1][0, 3:], axis=0) > 0.5
        self.length = arm.step_many(zero)["length_m"][0]
        self.scale = np.r_[np.full(3, 1 / self.length), np.ones(3)] * arm.task

    def move(self, q):
        """Poses (N, 4, 4) and Jacobians (N, 6, n) of the hand at `q` (N, n), in base axes, `[linear; angular]`."""
        postures = [self.arm.at(row) for row in q]
        return np.array([one.pose for one in postures]), np.array([one.J for one in postures])

    def decompose(self, J):
        """The last singular triple of J with lengths in units of `length`: u (N, 6), σ (N,), v (N, n); σ is 0 where a direction is lost."""
        U, S, Vt = np.linalg.svd(J * self.scale[:, None], full_matrices=False)
        last = min(np.count_nonzero(self.scale), self.dof) - 1
        return U[:, :, last], S[:, last], Vt[:, last]


def _open(name, tip, text, description):
    if text is not None:
        return arm_of(text, description, tip)
    if str(name) in armplane.Arm.names():
        return armplane.Arm.builtin(str(name), tip)
    if not pathlib.Path(name).is_file():
        raise ValueError(f"there is no robot {name}: give a URDF or MJCF file, or one of {', '.join(armplane.Arm.names())}")
    return armplane.Arm.from_urdf(name, tip)
