"""The arm of a log: kinematics of many postures at once, from any URDF, with or without masses."""

import os
import pathlib
import tempfile
import xml.etree.ElementTree as ElementTree

import armplane
import numpy as np

# Written where a file states no limit, and read back as infinity.
_UNKNOWN = 1e7
_INERTIAL = '<inertial><origin xyz="0 0 0"/><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'


class Robot:
    """An arm and its kinematics for N postures at once: a product of exponentials, so that nothing but screw axes is needed.

    `lower`, `upper`, `velocity`, `effort`: its limits, shape (n,), infinite where the file states none; `length` makes metres comparable to radians.
    `notes`: sentences about gaps of the file.
    """

    def __init__(self, name, tip=None, text=None):
        """`name`: a built-in arm or the path of a URDF or MJCF file; `text`: a URDF from the log. Raises ValueError with the file's first defect."""
        self.notes = []
        self.arm = self._open(name, tip, text)
        self.name, self.dof, self.joints = self.arm.name, self.arm.dof, list(self.arm.joints)
        known = lambda values: np.where(np.abs(values) >= _UNKNOWN / 2, np.inf, values)
        self.lower, self.upper = -known(-self.arm.lower), known(self.arm.upper)
        self.velocity, self.effort = known(self.arm.velocity), known(self.arm.effort)
        zero = self.arm.at(np.zeros(self.dof))
        self._home = zero.pose
        self._omega = zero.J[3:].T.copy()
        self.turns = np.linalg.norm(self._omega, axis=1) > 0.5
        self._v = zero.J[:3].T - np.cross(self._omega, self._home[:3, 3])
        self.length = float(self.arm.step_many(np.zeros((1, self.dof)))["length_m"][0])
        self.scale = np.r_[np.full(3, 1 / self.length), np.ones(3)]
        self.rank = min(6, self.dof)

    def _open(self, name, tip, text):
        if text is None and str(name) in armplane.Arm.names():
            return armplane.Arm.builtin(str(name), tip)
        path = None if text is not None else pathlib.Path(str(name))
        if path is not None and not path.is_file():
            raise ValueError(f"there is no robot {name}: give a URDF or MJCF file, or one of {', '.join(armplane.Arm.names())}")
        if path is not None and path.stat().st_size > 64 << 20:
            raise ValueError(f"{name} has more than 64 MB: give a robot's URDF or MJCF file")
        text = path.read_bytes() if text is None else text.encode()
        beside = path and path.with_suffix(".toml")
        beside = beside if beside and beside.is_file() else None
        filled = self._filled(text) if b"<robot" in text else None
        if filled is None:
            return armplane.Arm.from_urdf(str(path), tip, beside and str(beside))
        with tempfile.TemporaryDirectory(prefix="armplane-autopsy-") as folder:
            copy = os.path.join(folder, path.name if path is not None else "robot.urdf")
            with open(copy, "w", encoding="utf-8") as file:
                file.write(filled)
            try:
                return armplane.Arm.from_urdf(copy, tip, beside and str(beside))
            except ValueError as error:
                raise ValueError(str(error).replace(copy, str(name))) from None

    def _filled(self, text):
        """The URDF with the masses and limits that it lacks, so that its kinematics can be read; `None` where it is no XML, for the reader to refuse."""
        try:
            root = ElementTree.fromstring(text)
        except ElementTree.ParseError:
            return None
        lacks = {"masses": 0, "speed limits": 0, "torque limits": 0, "position limits": 0}
        for link in root.iter("link"):
            for picture in [*link.findall("visual"), *link.findall("collision")]:
                link.remove(picture)
            mass = link.find("inertial/mass")
            if mass is None or not _number(mass.get("value")) or link.find("inertial/inertia") is None:
                for old in link.findall("inertial"):
                    link.remove(old)
                link.append(ElementTree.fromstring(_INERTIAL))
                lacks["masses"] += 1
        for joint in root.iter("joint"):
            if joint.get("type") not in ("revolute", "prismatic", "continuous"):
                continue
            limit = joint.find("limit")
            limit = ElementTree.SubElement(joint, "limit") if limit is None else limit
            for key, word in (("effort", "torque limits"), ("velocity", "speed limits")):
                if not _number(limit.get(key)):
                    limit.set(key, str(_UNKNOWN))
                    lacks[word] += 1
            if joint.get("type") != "continuous" and not (_number(limit.get("lower")) or _number(limit.get("upper"))):
                limit.set("lower", str(-_UNKNOWN))
                limit.set("upper", str(_UNKNOWN))
                lacks["position limits"] += 1
        if lacked := [word for word, count in lacks.items() if count and word != "masses"]:
            self.notes.append(f"The robot's file lacks some {' and '.join(lacked)}; those joints are judged without them.")
        return ElementTree.tostring(root, encoding="unicode")

    def move(self, q):
        """Poses (N, 4, 4) and Jacobians (N, 6, n) of the hand at `q` (N, n), in base axes, `[linear; angular]`."""
        count = len(q)
        R, p = np.broadcast_to(np.eye(3), (count, 3, 3)), np.zeros((count, 3))
        J = np.empty((count, 6, self.dof))
        for j in range(self.dof):
            w, v = self._omega[j], self._v[j]
            omega = R @ w
            # The screw's velocity at the base's origin, moved by the joints before it.
            J[:, :3, j], J[:, 3:, j] = R @ v + np.cross(p, omega), omega
            if self.turns[j]:
                W = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
                s, c = np.sin(q[:, j, None, None]), 1 - np.cos(q[:, j, None, None])
                step = np.eye(3) + s * W + c * (W @ W)
                point = np.cross(w, v)
                p = p + (R @ (point - step @ point)[..., None])[..., 0] + (R @ w) * (w @ v) * q[:, j, None]
                R = R @ step
            else:
                p = p + (R @ v) * q[:, j, None]
        pose = np.tile(np.eye(4), (count, 1, 1))
        pose[:, :3, :3] = R @ self._home[:3, :3]
        pose[:, :3, 3] = p + R @ self._home[:3, 3]
        J[:, :3] += np.cross(J[:, 3:], pose[:, :3, 3][:, :, None], axis=1)
        return pose, J

    def decompose(self, J):
        """The last singular triple of J with lengths in units of `length`: u (N, 6), σ (N,), v (N, n); σ is 0 where a direction is lost."""
        U, S, Vt = np.linalg.svd(J * self.scale[:, None], full_matrices=False)
        k = self.rank - 1
        return U[:, :, k], S[:, k], Vt[:, k]


def _number(text):
    """Whether a URDF's attribute states a number other than zero."""
    try:
        return text is not None and float(text) != 0
    except ValueError:
        # For the reader of the file to refuse, with its place.
        return True
