"""The arm of a run as the page needs it: its frames, its limits, postures near singularities."""

import functools
import json

import numpy as np

from .. import _armplane
from ..trials import arm_of

# Postures among which those near singularities are chosen, and their distance from joint limits.
TRIES, MARGIN = 4000, 0.1


class Robot:
    """From the job of a run. `links`: of its file, as `armplane.Arm` has the `frames`; `base`: the first of them; `reach`: the arm's length, m."""

    def __init__(self, job):
        self.job, source = job, job["robot"]
        self.arm = arm_of(source["urdf"], source["description"], job["scenario"]["frame"] or None)
        self.name, self.dof, self.links = source["name"], self.arm.dof, self.arm.frames
        self.base = next(iter(self.links))
        bounded = lambda values, usual: np.where(np.isfinite(values), values, usual)
        self.lower = bounded(self.arm.lower, -np.pi)
        self.upper = bounded(self.arm.upper, np.pi)
        middle = (self.lower + self.upper) / 2
        self.singular_names = [one.name for one in self.arm.singularities(middle)]
        ends = self.frames(middle)[:, :3, 3]
        self.reach = float(np.linalg.norm(np.diff(ends, axis=0, prepend=np.zeros((1, 3))), axis=1).sum())

    @functools.cached_property
    def solids(self):
        """Its pieces as they are drawn (`viz/src/solids.rs`). Only the page reads meshes."""
        return json.loads(_armplane.solids(json.dumps(self.job)))

    def frames(self, q):
        """Poses of the links and, last, of the end-effector in the base, (n + 1, 4, 4)."""
        at = self.arm.at(q)
        return np.concatenate([at.links, at.pose[None]])

    def near(self, home):
        """Near each singularity a posture: if possible near no other one, not far from `home`."""
        spread = np.linspace(0, 2, TRIES)[:, None]
        q = home + spread * np.random.default_rng(1).uniform(-1, 1, (TRIES, self.dof))
        q = np.clip(q, self.lower + MARGIN, self.upper - MARGIN)
        found = self.arm.step_many(q, far=True)["singularities"][:, : len(self.singular_names)]
        share, inside = np.abs(found["s"]) / found["eta_out"], found["inside"] == 1
        out = np.linalg.norm([self.arm.at(one).pose[:3, 3] for one in q], axis=1) / self.reach
        cost = 3 * (share < 1.5).sum(axis=1) + np.abs(q - home).max(axis=1) - 2 * out
        # Outside of a neighbourhood a name may be a guess.
        return {
            name: q[np.argmin(np.where(one, cost, np.inf))]
            for name, one in zip(self.singular_names, inside.T)
            if one.any()
        }
