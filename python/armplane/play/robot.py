"""The arm of a run as the page needs it: the frames of its joints, its limits, and its postures near singularities."""

import pathlib
import tempfile
import xml.etree.ElementTree as xml

import numpy as np

from .. import Arm
from ..rotation import rotation_exp

# Postures from which one near a singularity is looked for, and its distance from joint limits, rad.
TRIES, MARGIN = 24, 0.1


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
            self.arm = Arm.from_urdf(path, tip=job["scenario"]["frame"] or None)
        self.name, self.dof = source["name"], self.arm.dof
        self.bodies, body = [], xml.fromstring(mjcf).find("worldbody")
        while (inner := body.find("body")) is not None:
            body, joint = inner, inner.find("joint")
            self.bodies.append((*_frame(body), _numbers(joint, "axis", "0 0 1"), joint.get("type", "hinge") == "hinge"))
        self.tip = _frame(body.find("site"))
        bounds = lambda values, usual: np.where(np.isfinite(values), values, usual)
        self.lower, self.upper = bounds(self.arm.lower, -np.pi), bounds(self.arm.upper, np.pi)
        middle = (self.lower + self.upper) / 2
        self.singular_names = [one.name for one in self.arm.singularities(middle)]
        points = np.array([np.zeros(3), *(p for _, p in self.frames(middle))])
        self.reach = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())

    def frames(self, q):
        """Rotation and origin of each joint's frame in base axes, and of the end-effector's at the end."""
        R, p, found = np.eye(3), np.zeros(3), []
        for (R_0, p_0, axis, turns), value in zip(self.bodies, q):
            p, R = p + R @ p_0, R @ R_0
            R, p = (R @ rotation_exp(axis * value), p) if turns else (R, p + R @ axis * value)
            found.append((R, p))
        return [*found, (R @ self.tip[0], p + R @ self.tip[1])]

    def _shares(self, q):
        """Of each posture: s over η of each singularity."""
        report = self.arm.step_many(q.reshape(-1, self.dof))["singularities"][:, : len(self.singular_names)]
        return (report["s"] / report["eta_out"]).reshape(*q.shape[:-1], -1)

    def near(self, home):
        """Of each singularity for which one is found: a posture near it, if possible near no other, and not far from `home`."""
        starts = home + np.random.default_rng(1).uniform(-1, 1, (TRIES, self.dof)) * np.linspace(0, 2, TRIES)[:, None]
        found, small = {}, 1e-5 * np.vstack([np.zeros(self.dof), np.eye(self.dof)])
        for place, name in enumerate(self.singular_names):
            q = np.clip(starts, self.lower + MARGIN, self.upper - MARGIN)
            for _ in range(8):
                # A Newton step towards |s| = 0.3 η.
                share = self._shares(q[:, None] + small)[..., place]
                slope, missing = (share[:, 1:] - share[:, :1]) / 1e-5, np.copysign(0.3, share[:, 0]) - share[:, 0]
                step = slope * (missing / np.maximum((slope**2).sum(axis=1), 1e-9))[:, None]
                step *= np.minimum(1, 0.3 / np.maximum(np.abs(step).max(axis=1), 1e-9))[:, None]
                q = np.clip(q + step, self.lower + MARGIN, self.upper - MARGIN)
            share = np.abs(self._shares(q))
            worth = 3 * (share < 1.5).sum(axis=1) + np.abs(q - home).max(axis=1) - 2 * np.array([np.linalg.norm(self.frames(one)[-1][1]) for one in q]) / self.reach
            if (share[:, place] < 0.7).any():
                found[name] = q[np.argmin(np.where(share[:, place] < 0.7, worth, np.inf))]
        return found
