"""The arm of a run for controllers of others: kinematics, dynamics and limits, and the same arm as URDF, for pinocchio and for MuJoCo."""

import tempfile
import xml.etree.ElementTree as ElementTree

import numpy as np

from .. import mujoco as plant
from ..mjcf import texts
from ..rotation import rotation_log

# A joint without stops: far enough not to be felt, near enough for a QP.
_FAR = 1e4


class Arm(plant.Arm):
    """The arm, as `armplane.mujoco.Arm` (`model` and `data` of MuJoCo, armature, limits and the site `end_effector` in it), asked by posture.

    `effort`, `velocity`, `lower`, `upper`: its limits, infinite where there is none. `start`: the posture at the start.
    """

    def __init__(self, text):
        super().__init__(text)
        m = self.model
        limited = m.jnt_limited.astype(bool)
        self.lower, self.upper = (np.where(limited, side, sign * np.inf) for side, sign in zip(m.jnt_range.T, (-1, 1)))
        self.armature = m.dof_armature.copy()
        self._at = None

    def move_to(self, q, qdot=None):
        super().move_to(q, qdot)
        self._at = None if qdot is not None else np.array(q, float)

    def _place(self, q):
        if self._at is None or not np.array_equal(q, self._at):
            self.move_to(q)

    def J(self, q):
        """The Jacobian at the end-effector, 6 × n."""
        self._place(q)
        return self.jacobian().copy()

    def A(self, q):
        """The mass matrix, armature included, n × n; kg·m²."""
        self._place(q)
        return self.mass_matrix()

    def pose(self, q):
        """Rotation (3 × 3) and position (3) of the end-effector in the base."""
        self._place(q)
        return self.rotation.copy(), self.position.copy()

    def error(self, q, ref):
        """What is missing to the reference's pose, `[p_d − p; log(R_d Rᵀ)]`; m, rad."""
        R, p = self.pose(q)
        return np.concatenate([ref.p - p, rotation_log(ref.R @ R.T)])

    def urdf(self):
        """The same arm as URDF: names, axes, inertia, limits; joints without stops turn ±1e4 rad; the link `end_effector`. Armature has no place in it."""
        root, speeds = ElementTree.fromstring(texts(self.model)[0]), dict(zip(self.names, self.velocity))
        for joint in root.iter("joint"):
            if (limit := joint.find("limit")) is not None:
                limit.set("velocity", speeds[joint.get("name")])
                limit.attrib.update({name: repr(float(np.clip(float(value), -_FAR, _FAR))) for name, value in limit.items()})
                joint.set("type", joint.get("type").replace("continuous", "revolute"))
                joint.remove(joint.find("dynamics"))
        return ElementTree.tostring(root, encoding="unicode")

    def urdf_file(self):
        """A file with `urdf()`, which lasts as long as the object returned; its path is `name`."""
        file = tempfile.NamedTemporaryFile("w", suffix=".urdf")
        file.write(self.urdf())
        file.flush()
        return file

    def pinocchio(self):
        """The arm as a model of pinocchio, its armature in it; the frame is `end_effector`. Joint by joint as here: one coordinate each."""
        import pinocchio

        model = pinocchio.buildModelFromXML(self.urdf())
        model.armature[:] = self.armature
        model.rotorInertia[:] = 0
        model.gravity.linear[:] = self.model.opt.gravity
        return model

