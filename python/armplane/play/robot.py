"""The arm of a run as the page needs it: the frames of its joints, its limits, and its postures near singularities."""

import pathlib
import tempfile
import xml.etree.ElementTree as xml

import numpy as np

from .. import Arm
from ..rotation import rotation_exp

# |s| of the postures near a singularity, as a share of the entry into its neighbourhood.
NEAR = 0.2
# Distance from joint limits kept there, rad.
MARGIN = 0.05


def _numbers(element, name, usual):
    return np.array([float(x) for x in element.get(name, usual).split()])


def _frame(element):
    axes = _numbers(element, "xyaxes", "1 0 0 0 1 0")
    x, y = axes[:3], axes[3:]
    return np.column_stack([x, y, np.cross(x, y)]), _numbers(element, "pos", "0 0 0")


class Robot:
    """From the files of a run: `job.json` and `arm.xml`."""

    def __init__(self, job, mjcf):
        source = job["robot"]
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / ("arm.xml" if "<mujoco" in source["urdf"] else "arm.urdf")
            path.write_text(source["urdf"])
            path.with_suffix(".toml").write_text(source["description"])
            self.arm = Arm.from_urdf(path, tip=job["scenario"]["frame"] or None, description=path.with_suffix(".toml"))
        self.name, self.dof = source["name"], self.arm.dof
        self.bodies, body = [], xml.fromstring(mjcf).find("worldbody")
        while (inner := body.find("body")) is not None:
            body, joint = inner, inner.find("joint")
            self.bodies.append((*_frame(body), _numbers(joint, "axis", "0 0 1"), joint.get("type", "hinge") == "hinge"))
        self.tip = _frame(body.find("site"))
        bounds = lambda values, usual: np.where(np.isfinite(values), values, usual)
        self.lower, self.upper = bounds(self.arm.lower, -np.pi), bounds(self.arm.upper, np.pi)
        self.singular_names = [one.name for one in self.arm.singularities((self.lower + self.upper) / 2)]
        frames = self.frames((self.lower + self.upper) / 2)
        points = [np.zeros(3), *(p for _, p in frames)]
        self.reach = sum(float(np.linalg.norm(b - a)) for a, b in zip(points, points[1:]))

    def frames(self, q):
        """Rotation and origin of each joint's frame in base axes, and of the end-effector's at the end."""
        R, p, found = np.eye(3), np.zeros(3), []
        for (R_0, p_0, axis, turns), value in zip(self.bodies, q):
            p, R = p + R @ p_0, R @ R_0
            R, p = (R @ rotation_exp(axis * value), p) if turns else (R, p + R @ axis * value)
            found.append((R, p))
        return [*found, (R @ self.tip[0], p + R @ self.tip[1])]

    def near(self, place, q):
        """A posture near one singularity and not far from `q`; `None` if none is found within the joint limits."""
        tries, found = np.random.default_rng(1), []
        for spread in np.linspace(0.0, 1.2, 16):
            start = np.clip(q + spread * tries.uniform(-1, 1, self.dof), self.lower + MARGIN, self.upper - MARGIN)
            if (at := self._descend(place, start)) is not None:
                found.append(at)
            if len(found) == 4:
                break
        return min(found, key=lambda at: np.abs(at - q).max(), default=None)

    def _descend(self, place, q):
        """Newton steps on the measure of a singularity, within the joint limits."""
        low, high = self.lower + MARGIN, self.upper - MARGIN
        for _ in range(40):
            one = self.arm.singularities(q)[place]
            missing = np.copysign(NEAR * one.entry, one.measure) - one.measure
            if abs(missing) < 0.1 * one.entry:
                break
            moved = [self.arm.singularities(q + step)[place].measure for step in 1e-5 * np.eye(self.dof)]
            slope = (np.array(moved) - one.measure) / 1e-5
            # A joint at its limit cannot help.
            slope[((q <= low) & (slope * missing < 0)) | ((q >= high) & (slope * missing > 0))] = 0
            if not (size := slope @ slope) > 1e-8:
                break
            step = slope * missing / size
            q = np.clip(q + step * min(1.0, 0.3 / np.abs(step).max()), low, high)
        return q if abs(one.measure) < 0.6 * one.entry else None
