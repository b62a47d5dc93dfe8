"""The arm of a run for controllers of others: kinematics, dynamics and limits, and the same arm as URDF, for pinocchio and for MuJoCo."""

import tempfile
from xml.sax.saxutils import quoteattr

import numpy as np

from .. import mujoco as plant
from ..rotation import rotation_log, rotation_of

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
        m, text = self.model, ['<robot name="arm"><link name="base"/>']

        def element(tag, **values):
            return f"<{tag} {' '.join(f'{name}={quoteattr(_words(value))}' for name, value in values.items())}/>"

        for b in range(1, m.nbody):
            j, link, R = m.body_jntadr[b], quoteattr(m.body(b).name), rotation_of(m.body_iquat[b])
            inertia = (R @ np.diag(m.body_inertia[b]) @ R.T)[np.triu_indices(3)]
            inertia = element("inertia", **dict(zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), inertia)))
            text.append(f"<link name={link}><inertial>{element('mass', value=m.body_mass[b])}{_origin(m.body_ipos[b], np.eye(3))}{inertia}</inertial></link>")
            kind = "revolute" if self.turns[j] else "prismatic"
            lower, upper, velocity, effort = np.clip([self.lower[j], self.upper[j], self.velocity[j], self.effort[j]], -_FAR, _FAR)
            limit = element("limit", lower=lower, upper=upper, velocity=velocity, effort=effort)
            place = _origin(m.body_pos[b], rotation_of(m.body_quat[b])) + element("axis", xyz=m.jnt_axis[j]) + limit
            text.append(f'<joint name={quoteattr(m.joint(j).name)} type="{kind}">{self._parent(m.body_parentid[b])}<child link={link}/>{place}</joint>')
        place = _origin(m.site_pos[self.frame], rotation_of(m.site_quat[self.frame]))
        end = f'{self._parent(m.site_bodyid[self.frame])}<child link="end_effector"/>{place}'
        text.append(f'<link name="end_effector"/><joint name="end_effector_fixed" type="fixed">{end}</joint></robot>')
        return "".join(text)

    def _parent(self, body):
        return f"<parent link={quoteattr(self.model.body(body).name if body else 'base')}/>"

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
        model.rotorInertia[:] = 0.0
        model.gravity.linear[:] = self.model.opt.gravity
        return model


def _words(values):
    return " ".join(repr(float(value)) for value in np.atleast_1d(values))


def _origin(p, R):
    """A place in URDF's roll, pitch and yaw."""
    pitch = np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0]))
    if np.hypot(R[0, 0], R[1, 0]) > 1e-9:
        roll, yaw = np.arctan2(R[2, 1], R[2, 2]), np.arctan2(R[1, 0], R[0, 0])
    else:
        roll, yaw = np.arctan2(-R[1, 2], R[1, 1]), 0.0
    return f'<origin xyz="{_words(p)}" rpy="{_words([roll, pitch, yaw])}"/>'
