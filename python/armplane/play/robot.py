"""The arm of a run as the page needs it: its frames, its limits, postures near singularities."""

import pathlib
import tempfile

import numpy as np

from .. import Arm
from .body import Body

# Postures among which those near singularities are chosen, and their distance from joint limits.
TRIES, MARGIN = 4000, 0.1


class Robot:
    """From the job of a run."""

    def __init__(self, job):
        source = job["robot"]
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "arm.urdf"
            path.write_text(source["urdf"])
            path.with_suffix(".toml").write_text(source["description"])
            self.arm = Arm.from_urdf(path, tip=job["scenario"]["frame"] or None)
        self.name, self.dof = source["name"], self.arm.dof
        bounded = lambda values, usual: np.where(np.isfinite(values), values, usual)
        self.lower = bounded(self.arm.lower, -np.pi)
        self.upper = bounded(self.arm.upper, np.pi)
        middle = (self.lower + self.upper) / 2
        self.singular_names = [one.name for one in self.arm.singularities(middle)]
        frames = np.concatenate([np.eye(4)[None], self.frames(middle)])
        tips = np.einsum("nji,nj->ni", frames[:-1, :3, :3], np.diff(frames[:, :3, 3], axis=0))
        self.reach = float(np.linalg.norm(tips, axis=1).sum())
        self.body = Body(source, self.arm.joints, tips)

    def frames(self, q):
        """Poses of the links and, last, of the end-effector in the base, (n + 1, 4, 4)."""
        at = self.arm.at(q)
        return np.concatenate([at.links, at.pose[None]])

    def near(self, home):
        """Near each singularity a posture: if possible near no other one, not far from `home`."""
        spread = np.linspace(0, 2, TRIES)[:, None]
        q = home + spread * np.random.default_rng(1).uniform(-1, 1, (TRIES, self.dof))
        q = np.clip(q, self.lower + MARGIN, self.upper - MARGIN)
        found = self.arm.step_many(q)["singularities"][:, : len(self.singular_names)]
        share, inside = np.abs(found["s"]) / found["eta_out"], found["inside"] == 1
        out = np.linalg.norm([self.arm.at(one).pose[:3, 3] for one in q], axis=1) / self.reach
        cost = 3 * (share < 1.5).sum(axis=1) + np.abs(q - home).max(axis=1) - 2 * out
        # Outside of a neighbourhood a name may be a guess.
        return {
            name: q[np.argmin(np.where(one, cost, np.inf))]
            for name, one in zip(self.singular_names, inside.T)
            if one.any()
        }
