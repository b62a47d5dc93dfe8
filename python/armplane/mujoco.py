"""The arm of a job in MuJoCo: an MJCF from its URDF and description, and the numbers that messages need."""

import math
import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np

from .robot import Robot


def _numbers(element, name, default):
    return [float(x) for x in element.get(name, default).split()] if element is not None else [float(x) for x in default.split()]


def _text(numbers):
    return " ".join(repr(float(x)) for x in numbers)


def _rotation(rpy):
    """R = Rz(yaw) Ry(pitch) Rx(roll), as a URDF means it."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(x), math.cos(x)) for x in rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _quaternion(rotation):
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, rotation.flatten())
    return quaternion


def mjcf(robot, rate_hz, substeps=4, friction=False, mass_factor=1.0):
    """The model as MJCF: the URDF's bodies, joints and inertias, the description's armature and, where asked for, friction.

    Runge-Kutta of order 4 with `substeps` steps a tick, no contact.
    """
    root = ElementTree.Element("mujoco", model="arm")
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="false", balanceinertia="false")
    option = ElementTree.SubElement(
        root, "option", timestep=repr(1.0 / rate_hz / substeps), integrator="RK4", gravity=_text(robot.gravity)
    )
    ElementTree.SubElement(option, "flag", contact="disable")
    world = ElementTree.SubElement(root, "worldbody")
    base = ElementTree.SubElement(world, "body", name=robot.base)

    def fill(body, link):
        inertial = robot.links[link].find("inertial")
        if inertial is not None and float(inertial.find("mass").get("value")) > 0:
            origin, inertia = inertial.find("origin"), inertial.find("inertia")
            xx, xy, xz, yy, yz, zz = (float(inertia.get(name)) for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
            R = _rotation(_numbers(origin, "rpy", "0 0 0"))
            I = R @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R.T * mass_factor
            ElementTree.SubElement(
                body,
                "inertial",
                pos=_text(_numbers(origin, "xyz", "0 0 0")),
                mass=repr(float(inertial.find("mass").get("value")) * mass_factor),
                fullinertia=_text([I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]]),
            )
        for element in robot.children.get(link, []):
            child, origin = element.find("child").get("link"), element.find("origin")
            quaternion = _quaternion(_rotation(_numbers(origin, "rpy", "0 0 0")))
            below = ElementTree.SubElement(body, "body", name=child, pos=_text(_numbers(origin, "xyz", "0 0 0")), quat=_text(quaternion))
            if element.get("name") in robot.moving:
                joint = robot.moving[element.get("name")]
                limited = math.isfinite(joint.lower) and math.isfinite(joint.upper)
                ElementTree.SubElement(
                    below,
                    "joint",
                    name=joint.name,
                    type="slide" if joint.kind == "prismatic" else "hinge",
                    axis=_text(_numbers(element.find("axis"), "xyz", "1 0 0")),
                    armature=repr(joint.armature),
                    damping=repr(joint.viscous_friction if friction else 0.0),
                    frictionloss=repr(joint.coulomb_friction if friction else 0.0),
                    limited="true" if limited else "false",
                    range=_text([joint.lower, joint.upper] if limited else [0.0, 0.0]),
                )
            fill(below, child)

    fill(base, robot.base)
    return ElementTree.tostring(root, encoding="unicode")


class Arm:
    """The arm in MuJoCo at the scenario's start: `model`, `data`, and what armplane's messages say of a posture."""

    def __init__(self, job):
        scenario = job["scenario"]
        plant = scenario["plant"]
        self.robot = Robot(job)
        self.substeps = plant["substeps"]
        text = mjcf(self.robot, scenario["rate_hz"], self.substeps, plant["friction"], plant["mass_factor"])
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)
        self.n = self.model.nv
        self.frame = self.model.body(self.robot.frame).id
        self._jacobian = np.zeros((6, self.n))
        self._mass = np.zeros((self.n, self.n))
        self.move_to(self.robot.start(scenario))

    def move_to(self, q, qdot=None):
        """Places the arm; the kinematics and the bias force are those of the new state."""
        self.data.qpos[:] = q
        self.data.qvel[:] = 0.0 if qdot is None else qdot
        mujoco.mj_forward(self.model, self.data)

    def step(self, tau):
        """One tick under the joint torques `tau`; N·m."""
        self.data.qfrc_applied[:] = tau
        mujoco.mj_step(self.model, self.data, self.substeps)
        mujoco.mj_forward(self.model, self.data)

    @property
    def position(self):
        """The end-effector's position in B; m."""
        return self.data.xpos[self.frame]

    @property
    def rotation(self):
        """The end-effector's rotation in B, 3 × 3."""
        return self.data.xmat[self.frame].reshape(3, 3)

    def jacobian(self):
        """J at the end-effector, 6 × n, [linear; angular] in base axes."""
        mujoco.mj_jacBody(self.model, self.data, self._jacobian[:3], self._jacobian[3:], self.frame)
        return self._jacobian

    def mass_matrix(self):
        """A(q), n × n; kg·m²."""
        for i, unit in enumerate(np.eye(self.n)):
            mujoco.mj_mulM(self.model, self.data, self._mass[i], unit)
        return self._mass

    def bias(self):
        """Torque of gravity and of Coriolis and centrifugal forces; N·m."""
        return self.data.qfrc_bias
