"""The arm of a run as the page needs it: its frames, its limits, postures near singularities."""

import functools
from xml.etree import ElementTree

import numpy as np

from ..rotation import rotation_exp
from ..trials import arm_of

# Postures among which those near singularities are chosen, and their distance from joint limits.
TRIES, MARGIN = 4000, 0.1


def numbers(element, key, usual=""):
    return np.array(element.get(key, usual).split(), float)


def origin(element):
    """The pose that a URDF's `origin` states, (4, 4)."""
    found, X = element.find("origin"), np.eye(4)
    if found is not None:
        for axis, angle in zip(np.eye(3), numbers(found, "rpy", "0 0 0")):
            X[:3, :3] = rotation_exp(angle * axis) @ X[:3, :3]
        X[:3, 3] = numbers(found, "xyz", "0 0 0")
    return X


def links(robot, joints):
    """Of each link of a URDF's tree: the place in `joints` of the joint that moves it, -1 for the base, and its pose behind that joint."""
    joint_to = {one.find("child").get("link"): one for one in robot.findall("joint")}

    def place(name):
        joint = joint_to.get(name)
        if joint is None or joint.get("name") in joints:
            return -1 if joint is None else joints.index(joint.get("name")), np.eye(4)
        number, X = place(joint.find("parent").get("link"))
        return number, X @ origin(joint)

    return {link.get("name"): place(link.get("name")) for link in robot.findall("link")}


class Robot:
    """From the job of a run. `tree`: its URDF; `links`: of each link, as [`links`] has it; `tips`: the end of each moving link, m."""

    def __init__(self, job):
        source = job["robot"]
        self.arm = arm_of(source["urdf"], source["description"], job["scenario"]["frame"] or None)
        self.name, self.folder, self.dof, self.tree = source["name"], source["folder"], self.arm.dof, ElementTree.fromstring(source["urdf"].encode())
        self.links = links(self.tree, self.arm.joints)
        bounded = lambda values, usual: np.where(np.isfinite(values), values, usual)
        self.lower = bounded(self.arm.lower, -np.pi)
        self.upper = bounded(self.arm.upper, np.pi)
        middle = (self.lower + self.upper) / 2
        self.singular_names = [one.name for one in self.arm.singularities(middle)]
        frames = np.concatenate([np.eye(4)[None], self.frames(middle)])
        self.tips = np.einsum("nji,nj->ni", frames[:-1, :3, :3], np.diff(frames[:, :3, 3], axis=0))
        self.reach = float(np.linalg.norm(self.tips, axis=1).sum())

    @functools.cached_property
    def body(self):
        # ROS 2 needs no shapes, and has no trimesh.
        from .body import Body

        return Body(self)

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
