"""Arms in MJCF, as MuJoCo's own compiler reads them, for `armplane --robot ARM.xml` and `Arm.from_mujoco`: the same tree of links and joints as a URDF, and
what a URDF has no element for as a description.

`python -m armplane.mjcf ARM.xml [OUT.urdf]` writes the two as files, for programs without Python.
"""

import json
import math
import os
import pathlib
import sys
from xml.sax.saxutils import quoteattr

try:
    import numpy as np

    from .limited import Ended, limited
    from .rotation import rotation_exp, rotation_of
except ImportError as error:
    if __name__ == "__main__":
        sys.exit(f"MuJoCo reads MJCF: pip install mujoco ({error})")
    raise

_FREE, _BALL, _SLIDE, _HINGE = range(4)
_SPHERE, _CAPSULE, _CYLINDER, _BOX, _MESH = 2, 3, 5, 6, 7
_KINDS = {_FREE: "floating", _BALL: "spherical", _SLIDE: "prismatic", _HINGE: "revolute"}
# MuJoCo's viewer shows the groups below.
_SEEN_GROUPS = 3
# Longest time in which a file is read and compiled, s: one can be endless, or say that a body is there a billion times.
_LONGEST_S = 60


def _numbers(values):
    return " ".join(repr(float(x)) for x in np.atleast_1d(values))


def _origin(p, R):
    """R = Rz(yaw)·Ry(pitch)·Rx(roll); any yaw serves where the pitch is a right angle: the roll is that of what it leaves."""
    yaw = math.atan2(R[1, 0], R[0, 0])
    c, s = math.cos(yaw), math.sin(yaw)
    rest = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ R
    pitch, roll = math.atan2(-rest[2, 0], rest[0, 0]), math.atan2(-rest[1, 2], rest[1, 1])
    return f'<origin xyz="{_numbers(p)}" rpy="{_numbers([roll, pitch, yaw])}"/>'


def _joint(name, kind, parent, child, *parts):
    return f'<joint name={quoteattr(name)} type="{kind}"><parent link={quoteattr(parent)}/><child link={quoteattr(child)}/>{"".join(parts)}</joint>'


class _Names:
    """Names that no other has: of bodies first, then of sites and what stands between."""

    def __init__(self):
        self.taken = set()

    def new(self, name, other):
        name = other if name in self.taken else name
        self.taken.add(name)
        return name


class _Tree:
    def __init__(self, m, folder):
        self.m, self.folder, self.xml, self.joints, self.notes = m, folder, [], {}, []
        names = _Names()
        self.bodies = [names.new(m.body(b).name or f"body{b}", f"body{b}") for b in range(m.nbody)]
        followers = {m.eq_obj1id[e]: m.eq_obj2id[e] for e in range(m.neq) if m.eq_type[e] == 2 and m.eq_obj2id[e] >= 0}
        joint_names = _Names()
        self.joint_names = [joint_names.new(m.joint(j).name or f"joint{j}", f"joint{j}") for j in range(m.njnt)]
        efforts = self._efforts()
        for b, body in enumerate(self.bodies):
            self._link(body, *([self._inertial(b), *self._shapes(b)] if b else ()))
            if b:
                self._joints_of(b, names, followers, efforts)
            if b and m.body_gravcomp[b]:
                self.notes.append(f"the gravity compensation of body '{body}' is left out")
        for s in range(m.nsite):
            if name := m.site(s).name:
                link = names.new(name, f"{name} (site)")
                self._link(link)
                self._fix(self.bodies[m.site_bodyid[s]], link, m.site_pos[s], rotation_of(m.site_quat[s]))

    def _link(self, name, *parts):
        self.xml.append(f"<link name={quoteattr(name)}>{''.join(parts)}</link>")

    def _fix(self, parent, child, p, R):
        self.xml.append(_joint(f"to {child}", "fixed", parent, child, _origin(p, R)))

    def _inertial(self, b):
        m, (ixx, iyy, izz) = self.m, map(float, self.m.body_inertia[b])
        inertia = f'<inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="0.0" ixz="0.0" iyz="0.0"/>'
        pose = _origin(m.body_ipos[b], rotation_of(m.body_iquat[b]))
        return f'<inertial>{pose}<mass value="{float(m.body_mass[b])}"/>{inertia}</inertial>' if m.body_mass[b] else ""

    def _shapes(self, b):
        m = self.m
        for g in range(m.body_geomadr[b], m.body_geomadr[b] + m.body_geomnum[b]):
            kind, size, p, R = m.geom_type[g], m.geom_size[g], m.geom_pos[g], rotation_of(m.geom_quat[g])
            radius, length = map(float, (size[0], 2 * size[1]))
            if kind == _SPHERE:
                form = f'<sphere radius="{radius}"/>'
            elif kind in (_CAPSULE, _CYLINDER):
                form = f'<{"capsule" if kind == _CAPSULE else "cylinder"} radius="{radius}" length="{length}"/>'
            elif kind == _BOX:
                form = f'<box size="{_numbers(2 * size)}"/>'
            elif kind == _MESH and m.mesh_pathadr[m.geom_dataid[g]] >= 0:
                mesh = m.geom_dataid[g]
                start = m.mesh_pathadr[mesh]
                file = os.path.relpath(m.paths[start : m.paths.index(b"\0", start)].decode(), self.folder)
                # The compiler moves a mesh to its own centre.
                R = R @ rotation_of(m.mesh_quat[mesh]).T
                p = p - R @ m.mesh_pos[mesh]
                form = f'<mesh filename={quoteattr(file)} scale="{_numbers(m.mesh_scale[mesh])}"/>'
            else:
                continue
            collides = (m.geom_contype[g] or m.geom_conaffinity[g]) and not (kind == _MESH and m.geom_group[g] < _SEEN_GROUPS)
            rgba = m.mat_rgba[m.geom_matid[g]] if m.geom_matid[g] >= 0 else m.geom_rgba[g]
            body = f"{_origin(p, R)}<geometry>{form}</geometry>"
            yield f"<collision>{body}</collision>" if collides else f'<visual>{body}<material name=""><color rgba="{_numbers(rgba)}"/></material></visual>'

    def _joints_of(self, b, names, followers, efforts):
        """The joints of a body, each with a link of its own; the body's is fixed to the last one's where that turns beside it."""
        m, body = self.m, self.bodies[b]
        parent, p, R = self.bodies[m.body_parentid[b]], m.body_pos[b], rotation_of(m.body_quat[b])
        first, count = m.body_jntadr[b], m.body_jntnum[b]
        for j in range(first, first + count):
            anchor = m.jnt_pos[j] if m.jnt_type[j] != _FREE else np.zeros(3)
            child = body
            if j != first + count - 1 or anchor.any():
                child = names.new(f"{self.joint_names[j]} of {body}", f"joint{j} of {body}")
                self._link(child)
            self._joint(j, parent, child, p + R @ anchor, R, followers, efforts)
            parent, p, R = child, -anchor, np.eye(3)
        if parent != body:
            self._fix(parent, body, p, R)

    def _joint(self, j, parent, child, p, R, followers, efforts):
        m, name = self.m, self.joint_names[j]
        kind, dof, limited = m.jnt_type[j], m.jnt_dofadr[j], m.jnt_limited[j]
        axis, moves = m.jnt_axis[j], kind in (_SLIDE, _HINGE)
        # The posture that the file draws is not q = 0 but q = ref.
        ref = m.qpos0[m.jnt_qposadr[j]] if moves else 0
        if kind == _SLIDE:
            p = p - R @ axis * ref
        elif kind == _HINGE:
            R = R @ rotation_exp(-ref * axis)
        lower, upper = map(float, m.jnt_range[j] if limited else (-math.inf, math.inf))
        effort = efforts.get(j, math.inf)
        if m.jnt_actfrclimited[j]:
            effort = min(effort, _either_way(m.jnt_actfrcrange[j]))
        parts = [
            _origin(p, R),
            f'<axis xyz="{_numbers(axis)}"/>',
            f'<limit lower="{lower}" upper="{upper}" effort="{float(effort)}" velocity="inf"/>',
            f'<dynamics damping="{float(np.ravel(m.dof_damping[dof])[0])}" friction="{float(m.dof_frictionloss[dof])}"/>',
        ]
        if j in followers:
            parts.append(f"<mimic joint={quoteattr(self.joint_names[followers[j]])}/>")
        self.xml.append(_joint(name, "continuous" if kind == _HINGE and not limited else _KINDS[kind], parent, child, *parts))
        if moves:
            self.joints[j] = {"armature": float(m.dof_armature[dof])}
        if np.any(m.jnt_stiffness[j]):
            self.notes.append(f"the spring of joint '{name}' is left out")

    def _efforts(self):
        """The force of a joint's actuators through their gears."""
        m, efforts = self.m, {}
        for a in range(m.nu):
            if m.actuator_trntype[a] not in (0, 1):
                continue
            force = _either_way(m.actuator_forcerange[a]) if m.actuator_forcelimited[a] else math.inf
            if m.actuator_biastype[a] == m.actuator_dyntype[a] == m.actuator_gaintype[a] == 0 and m.actuator_ctrllimited[a]:
                force = min(force, _either_way(m.actuator_ctrlrange[a]) * abs(m.actuator_gainprm[a, 0]))
            j = m.actuator_trnid[a, 0]
            efforts[j] = efforts.get(j, 0.0) + force * abs(m.actuator_gear[a, 0])
        return efforts


def _either_way(range_):
    return min(-range_[0], range_[1])


def texts(m, folder="."):
    """The model `m` (mujoco.MjModel) as a URDF and as a description in TOML, two texts: bodies and sites are links, with all digits. Paths of meshes start
    from `folder`."""
    if not hasattr(m, "jnt_type"):
        raise TypeError(f"model is a {type(m).__name__}: give a mujoco.MjModel, or the path of a file to Arm.from_urdf, which reads MJCF too")
    tree = _Tree(m, folder)
    lines = [f"gravity = [{', '.join(repr(float(x)) for x in m.opt.gravity)}]"]
    if tree.notes:
        lines.append(f"notes = {json.dumps(tree.notes)}")
    for j, values in tree.joints.items():
        lines += [f"[joints.{json.dumps(tree.joint_names[j])}]", *(f"{key} = {value!r}" for key, value in values.items())]
    for k in range(m.nkey):
        name = m.key(k).name or f"key{k}"
        lines.append(f"[postures.{json.dumps(name)}]")
        lines += [f"{json.dumps(tree.joint_names[j])} = {float(m.key_qpos[k, m.jnt_qposadr[j]])!r}" for j in tree.joints]
    name = quoteattr(getattr(m, "names", b"arm").split(b"\0")[0].decode() or "arm")
    return f"<robot name={name}>\n" + "\n".join(tree.xml) + "\n</robot>\n", "\n".join(lines) + "\n"


def read(path):
    """The two texts of an MJCF file; whatever it includes is read from its folder."""
    try:
        import mujoco
    except ImportError as error:
        raise ModuleNotFoundError(f"{path} is MJCF, which MuJoCo reads: pip install mujoco ({error})") from error
    if os.path.exists(path) and not os.path.isfile(path):
        raise ValueError(f"{path} is no regular file: give an arm's MJCF file")
    try:
        model = mujoco.MjModel.from_xml_path(os.fspath(path))
    except Exception as error:
        raise ValueError(f"MuJoCo refuses {path}: {' '.join(str(error).split())}") from error
    return texts(model, os.path.dirname(os.path.abspath(path)))


def main():
    arguments = sys.argv[1:]
    as_json = arguments[:1] == ["--json"]
    if not as_json and len(arguments) not in (1, 2):
        sys.exit("usage: python -m armplane.mjcf ARM.xml [OUT.urdf]")
    path = pathlib.Path(arguments[as_json])
    try:
        urdf, description = limited(_LONGEST_S, read, path)
    except Ended as error:
        sys.exit(f"{path} {error}: give a smaller arm")
    except (ImportError, ValueError) as error:
        sys.exit(str(error))
    if as_json:
        return json.dump({"urdf": urdf, "description": description}, sys.stdout)
    out = pathlib.Path(arguments[1]) if arguments[1:] else path.with_suffix(".urdf")
    files = {out: urdf, out.with_suffix(".toml"): description}
    if taken := next((file for file in files if file.exists()), None):
        sys.exit(f"{taken} is there already: name another file, as in `python -m armplane.mjcf {path} OUT.urdf`")
    for file, text in files.items():
        file.write_text(text, encoding="utf-8")
        print(file)


if __name__ == "__main__":
    main()
