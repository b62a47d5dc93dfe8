"""Writes a MuJoCo model as MJCF with all digits, which MuJoCo's own writer rounds."""

from xml.sax.saxutils import quoteattr

_JOINTS = ("free", "ball", "slide", "hinge")
_GEOMS = {2: "sphere", 3: "capsule", 4: "ellipsoid", 5: "cylinder", 6: "box"}


def _element(tag, /, **attributes):
    def text(value):
        return value if isinstance(value, str) else " ".join(repr(float(x)) for x in (value if hasattr(value, "__len__") else [value]))

    stated = (f"{key}={quoteattr(text(value))}" for key, value in attributes.items() if value is not None)
    return f"<{tag} {' '.join(stated)}"


def _joint(m, j):
    kind, dof = _JOINTS[m.jnt_type[j]], m.jnt_dofadr[j]
    limited, forced = bool(m.jnt_limited[j]), bool(m.jnt_actfrclimited[j])
    return _element(
        "joint",
        name=m.joint(j).name or None,
        type=kind,
        pos=m.jnt_pos[j],
        axis=m.jnt_axis[j],
        ref=m.qpos0[m.jnt_qposadr[j]] if kind in ("slide", "hinge") else None,
        range=m.jnt_range[j] if limited else None,
        limited=str(limited).lower(),
        actuatorfrcrange=m.jnt_actfrcrange[j] if forced else None,
        actuatorfrclimited=str(forced).lower(),
        armature=m.dof_armature[dof],
        damping=m.dof_damping[dof : dof + 1],
        frictionloss=m.dof_frictionloss[dof],
        stiffness=m.jnt_stiffness[j : j + 1],
    )


def _actuator(m, a):
    limited, controlled = bool(m.actuator_forcelimited[a]), bool(m.actuator_ctrllimited[a])
    is_direct = m.actuator_biastype[a] == 0 and m.actuator_dyntype[a] == 0 and m.actuator_gaintype[a] == 0
    return _element(
        "general",
        joint=m.joint(m.actuator_trnid[a, 0]).name,
        gear=m.actuator_gear[a, :1],
        forcerange=m.actuator_forcerange[a] if limited else None,
        forcelimited=str(limited).lower(),
        gainprm=m.actuator_gainprm[a, :1],
        biastype="none" if is_direct else "affine",
        ctrlrange=m.actuator_ctrlrange[a] if controlled else None,
        ctrllimited=str(controlled).lower(),
    )


def text(m):
    """The model `m` (mujoco.MjModel): bodies, inertia, joints, sites, geoms in closed form, force limits and gravity."""
    if not hasattr(m, "jnt_type"):
        raise TypeError(f"model is a {type(m).__name__}: give a mujoco.MjModel, or the path of a file to Arm.from_urdf, which reads MJCF too")
    lines = ["<mujoco>", '<compiler angle="radian" autolimits="false"/>', _element("option", gravity=m.opt.gravity) + "/>", "<worldbody>"]

    def contents(body):
        if body:
            name = m.body(body).name or None
            lines.append(_element("body", name=name, pos=m.body_pos[body], quat=m.body_quat[body]) + ">")
            inertia = _element("inertial", mass=m.body_mass[body], pos=m.body_ipos[body], quat=m.body_iquat[body], diaginertia=m.body_inertia[body])
            lines.append(inertia + "/>")
            first = m.body_jntadr[body]
            lines.extend(_joint(m, j) + "/>" for j in range(first, first + m.body_jntnum[body]))
            for g in range(m.body_geomadr[body], m.body_geomadr[body] + m.body_geomnum[body]):
                if kind := _GEOMS.get(int(m.geom_type[g])):
                    geom = _element("geom", type=kind, size=m.geom_size[g], pos=m.geom_pos[g], quat=m.geom_quat[g], rgba=m.geom_rgba[g], mass="0")
                    lines.append(geom + "/>")
        for s in range(m.nsite):
            if m.site_bodyid[s] == body and m.site(s).name:
                lines.append(_element("site", name=m.site(s).name, pos=m.site_pos[s], quat=m.site_quat[s]) + "/>")
        for child in range(body + 1, m.nbody):
            if m.body_parentid[child] == body:
                contents(child)
        lines.append("</body>" if body else "</worldbody>")

    contents(0)
    on_joints = [a for a in range(m.nu) if m.actuator_trntype[a] in (0, 1)]
    lines += ["<actuator>", *(_actuator(m, a) + "/>" for a in on_joints), "</actuator>", "<equality>"]
    for e in range(m.neq):
        if m.eq_type[e] == 2 and m.eq_obj2id[e] >= 0:
            lines.append(_element("joint", joint1=m.joint(m.eq_obj1id[e]).name, joint2=m.joint(m.eq_obj2id[e]).name) + "/>")
    return "\n".join([*lines, "</equality>", "</mujoco>"])
