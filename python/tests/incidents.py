"""Incidents of known cause, to judge `armplane autopsy` by: arms in MuJoCo under controllers of others, logged by the libraries of others.

    pip install 'armplane[autopsy]' mujoco example-robot-data
    python python/tests/incidents.py 1000 200           # seeds 1000 to 1199: writes the logs, asks, and counts
    python python/tests/incidents.py 1000 200 --keep /tmp/incidents

Nothing here is taken from armplane: kinematics are MuJoCo's, singular directions are null vectors of its Jacobian at the nearest posture of lower rank, and
a cause is the one that was put in, kept only where the controller itself has felt it.
"""

import argparse
import collections
import json
import pathlib
import sys
import tempfile
import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np

DT = 0.002
SINGULAR, OTHERS = "singularity", ("joint limit", "speed limit", "torque limit", "gap in the stamps", "jump in the command", "NaN", "oscillation", "unknown", "none")
LAWS = ("dls", "pinv clamped", "servo halt", "pinv fault", "inverse kinematics", "impedance")
# An arm without masses, for tests that have no other file.
PLAIN = """<robot name="plain"><link name="base"/>{links}</robot>"""


def plain_urdf():
    """An arm of six joints with a spherical wrist, without masses: what many drivers' packages have."""
    rows = [("0 0 0.4", "0 0 1", 2.9, 2.5), ("0.05 0 0", "0 1 0", 2.0, 2.2), ("0 0 0.45", "0 1 0", 2.6, 2.5), ("0.2 0 0.04", "1 0 0", 3.1, 4.0), ("0.22 0 0", "0 1 0", 2.1, 4.0), ("0.08 0 0", "1 0 0", 6.2, 6.0)]  # fmt: skip
    text = ""
    for k, (xyz, axis, limit, speed) in enumerate(rows, 1):
        text += f'<link name="l{k}"/><joint name="axis_{k}" type="revolute"><parent link="{f"l{k - 1}" if k > 1 else "base"}"/><child link="l{k}"/>'
        text += f'<origin xyz="{xyz}" rpy="0 0 0"/><axis xyz="{axis}"/><limit lower="{-limit}" upper="{limit}" velocity="{speed}" effort="0"/></joint>'
    return PLAIN.format(links=text)


def arms():
    """Six arms, (name for the command, tip, path of the URDF): three that are built in, three of `example-robot-data`."""
    own = pathlib.Path(__file__).resolve().parents[2] / "services" / "model" / "robots"
    others = next(path for root in sys.path for path in pathlib.Path(root).glob("cmeel.prefix/share/example-robot-data/robots"))
    rows = [("ur5", "tool0", own / "ur5.urdf"), ("puma560", "ee", own / "puma560.urdf"), ("panda", "panda_link8", own / "panda.urdf")]
    for name, tip in (("kinova_description/robots/kinova", "j2s6s200_link_6"), ("z1_description/urdf/z1", "link06"), ("talos_data/robots/talos_left_arm", "arm_left_7_link")):
        rows.append((str(others / f"{name}.urdf"), tip, others / f"{name}.urdf"))
    return rows


class Arm:
    """An arm in MuJoCo: the chain from the root to `tip`, all other joints fixed, no contacts."""

    def __init__(self, path, tip=None):
        root = ElementTree.parse(path).getroot()
        for link in root.iter("link"):
            for one in [*link.findall("visual"), *link.findall("collision")]:
                link.remove(one)
        parents = {joint.find("child").get("link"): joint for joint in root.findall("joint")}
        tip = tip or [link.get("name") for link in root.iter("link") if link.get("name") not in {j.find("parent").get("link") for j in parents.values()}][-1]
        chain, link = [], tip
        while link in parents:
            chain.insert(0, parents[link])
            link = parents[link].find("parent").get("link")
        for joint in parents.values():
            if joint not in chain:
                joint.set("type", "fixed")
            for mimic in joint.findall("mimic"):
                joint.remove(mimic)
        compiler = '<mujoco><compiler fusestatic="false" discardvisual="true" balanceinertia="true" boundmass="0.3" boundinertia="0.003"/></mujoco>'
        root.append(ElementTree.fromstring(compiler))
        moving = [joint for joint in chain if joint.get("type") != "fixed"]
        number = lambda joint, key: float(joint.find("limit").get(key) or 0) if joint.find("limit") is not None else 0.0
        self.model = m = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))
        self.dt, self.gains = DT, (900.0, 60.0)
        m.opt.timestep, m.opt.integrator = DT, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        m.dof_armature[:] += 0.02
        m.dof_damping[:] = 0.3
        m.dof_frictionloss[:] = 0
        self.joints = [joint.get("name") for joint in moving]
        self.n, self.body = m.nv, m.body(tip).id
        self.speed = np.array([number(joint, "velocity") for joint in moving])
        self.effort = np.array([number(joint, "effort") or 1e6 for joint in moving])
        turning = np.array([joint.get("type") == "continuous" for joint in moving])
        self.lower, self.upper = np.where(turning, -1e3, m.jnt_range[:, 0]), np.where(turning, 1e3, m.jnt_range[:, 1])
        self.asked = mujoco.MjData(m)
        # A load at the hand that its shoulder cannot carry.
        self.heavy = 1.2 * min(np.sort(self.effort)[::-1][:2]) / max(np.abs(self.J(np.zeros(self.n))[:3]).max(), 0.2) if self.effort.max() < 1e6 else 0.0
        self.length = max(np.abs(self.J(np.zeros(self.n))[:3]).max(), 0.2) / 2

    def J(self, q):
        d, m = self.asked, self.model
        d.qpos[:] = q
        mujoco.mj_kinematics(m, d)
        mujoco.mj_comPos(m, d)
        J = np.zeros((6, m.nv))
        mujoco.mj_jacBody(m, d, J[:3], J[3:], self.body)
        return J

    def pose(self, q):
        self.J(q)
        return self.asked.xpos[self.body].copy(), self.asked.xmat[self.body].reshape(3, 3).copy()

    def sigma(self, q):
        U, S, Vt = np.linalg.svd(self.J(q) / np.r_[np.full(3, self.length), np.ones(3)][:, None])
        return U[:, 5], S, Vt[5]

    def singular_near(self, q, steps=40):
        """The posture of lower rank nearest to `q`, by the gradient of the last singular value; `None` where there is none within the limits."""
        q = np.array(q)
        for _ in range(steps):
            value = self.sigma(q)[1][5]
            if value < 2e-4:
                return q
            slope = np.array([self.sigma(q + 1e-5 * one)[1][5] - value for one in np.eye(self.n)]) / 1e-5
            q = q - np.clip(value * slope / max(slope @ slope, 1e-9), -0.2, 0.2)
        return None

    def zeta(self, q):
        """The direction lost at the singular posture nearest to `q`: the lost force's direction (None for a pure rotation) and the lost rotation at the wrist."""
        at = self.singular_near(q)
        at = q if at is None or np.abs(at - q).max() > 0.4 else at
        w = self.sigma(at)[0] / np.r_[np.full(3, self.length), np.ones(3)]
        J = self.J(at)
        tip = self.asked.xpos[self.body]
        # The wrist: the point of the last joint but one nearest to the axis before it.
        a, b = J[3:, self.n - 3], J[3:, self.n - 2]
        pa, pb = (self.asked.xanchor[j] for j in (self.n - 3, self.n - 2))
        skew = 1 - (a @ b) ** 2
        wrist = pb if skew < 1e-9 else pb + b * (((pa - pb) @ b - ((pa - pb) @ a) * (a @ b)) / skew)
        force, moment = w[:3], w[3:] + np.cross(tip - wrist, w[:3])
        unit = lambda x: x / max(np.linalg.norm(x), 1e-12)
        return {
            "force": unit(force).tolist() if np.linalg.norm(force) * self.length > 0.05 * np.linalg.norm(moment) else None,
            "moment": unit(moment).tolist() if np.linalg.norm(moment) > 0.1 * self.length * np.linalg.norm(force) else None,
        }


class Drive:
    """Joint drives under computed torque, with limits of torque and speed; they brake on a fault, and keep a row for each control period."""

    def __init__(self, arm, q):
        self.arm, self.gains = arm, arm.gains
        self.data = mujoco.MjData(arm.model)
        self.data.qpos[:] = q
        mujoco.mj_forward(arm.model, self.data)
        self.braking, self.delay, self.past, self.load, self.grip = False, 0, [], np.zeros(3), None
        self.effort, self.saturated, self.torque = arm.effort.copy(), 0, np.zeros(arm.n)

    @property
    def q(self):
        return self.data.qpos.copy()

    def M(self):
        M = np.zeros((self.arm.n, self.arm.n))
        mujoco.mj_fullM(self.arm.model, self.data, M)
        return M

    def step(self, qc, vc, torque=None):
        d = self.data
        self.past.append((d.qpos.copy(), d.qvel.copy()))
        q, v = self.past[-1 - min(self.delay, len(self.past) - 1)]
        if self.braking:
            tau = d.qfrc_bias - self.M() @ (12.0 * d.qvel)
        elif torque is not None:
            tau = torque
        else:
            tau = d.qfrc_bias + self.M() @ (self.gains[0] * (qc - q) + self.gains[1] * (vc - v))
        self.saturated += int((np.abs(tau) > self.effort).any())
        self.torque = np.clip(tau, -self.effort, self.effort)
        d.qfrc_applied[:] = self.torque
        d.xfrc_applied[self.arm.body, :3] = self.load
        if self.grip is not None:  # A post that the hand has run into.
            d.xfrc_applied[self.arm.body, :3] += 2e4 * (self.grip - d.xpos[self.arm.body]) - 150.0 * (self.arm.J(d.qpos)[:3] @ d.qvel)
        mujoco.mj_step(self.arm.model, d)


def quintic(x):
    x = np.clip(x, 0, 1)
    return x**3 * (10 - 15 * x + 6 * x * x), 30 * x * x * (1 - x) ** 2


class Rejected(Exception):
    """A draw in which nothing happens, or not the thing wanted."""


def draw_singular(arm, rng):
    """A singular posture well within the limits that is not one of several at once, its ζ, and its joint direction."""
    for _ in range(200):
        low, high = np.maximum(arm.lower, -2.6), np.minimum(arm.upper, 2.6)
        q = arm.singular_near(low + (high - low) * rng.uniform(0.1, 0.9, arm.n), 25)
        if q is not None and np.all(q > arm.lower + 0.2) and np.all(q < arm.upper - 0.2) and arm.sigma(q)[1][4] > 0.12 and np.abs(q).max() < 3:
            return q
    raise Rejected


def approach(arm, rng):
    """A start posture and a constant twist that lead past a singular posture, with a part along ζ."""
    at = draw_singular(arm, rng)
    u, S, v = arm.sigma(at)
    slope = np.array([arm.sigma(at + 0.05 * one)[1][5] for one in np.eye(arm.n)])
    near = at + rng.choice([-1, 1]) * rng.uniform(0.02, 0.07) * slope / max(np.linalg.norm(slope), 1e-6)
    u, S, v = arm.sigma(near)
    scale = np.r_[np.full(3, arm.length), np.ones(3)]
    qdot = rng.normal(size=arm.n)
    V = arm.J(near) @ (qdot / np.linalg.norm(qdot)) / scale
    V = V - (V @ u) * u
    V = V / max(np.linalg.norm(V), 1e-9) + rng.choice([-1, 1]) * rng.uniform(0.4, 1.5) * u
    V = V * scale
    V *= rng.uniform(0.06, 0.2) / max(np.linalg.norm(V[:3]), 0.3 * np.linalg.norm(V[3:]))
    q, back = near.copy(), rng.uniform(0.8, 2.0)
    for _ in range(int(back / 0.01)):
        q = q - 0.01 * damped(arm.J(q), V, 0.01, arm)
        if np.any(q < arm.lower + 0.1) or np.any(q > arm.upper - 0.1):
            raise Rejected
    if arm.sigma(q)[1][5] < 0.1 or np.any(np.abs(damped(arm.J(q), V, 0.001, arm)) > 0.6 * arm.speed):
        raise Rejected
    return q, V, back


def damped(J, V, factor, arm):
    scale = 1 / np.r_[np.full(3, arm.length), np.ones(3)]
    J, V = J * scale[:, None], V * scale
    return J.T @ np.linalg.solve(J @ J.T + factor**2 * np.eye(6), V)


def regular(arm, rng, floor=0.13):
    """A posture far from all singular ones."""
    for _ in range(400):
        low, high = np.maximum(arm.lower, -2.4), np.minimum(arm.upper, 2.4)
        q = low + (high - low) * rng.uniform(0.2, 0.8, arm.n)
        if arm.sigma(q)[1][5] > floor:
            return q
    raise Rejected


class Law:
    """Controllers of others, from a twist to joint velocities; `felt` is the time at which the singularity first had its way."""

    def __init__(self, name, arm, rng, q, V):
        self.name, self.arm, self.q, self.felt, self.bad, self.halted = name, arm, q.copy(), None, 0, False
        self.factor = float(rng.choice([0.02, 0.05, 0.1])) if name == "dls" else 0.0
        self.p, self.R = arm.pose(q)
        self.hard, self.rest = float(rng.uniform(25, 45)), 0.0

    def ask(self, V, drive, t):
        """Joint positions and velocities to command, a torque where the law gives one."""
        arm, J = self.arm, self.arm.J(self.q)
        scale = 1 / np.r_[np.full(3, arm.length), np.ones(3)]
        is_off = False
        if self.name == "dls":
            qdot = damped(J, V, self.factor, arm)
            is_off = np.linalg.norm((J @ qdot - V) * scale) > 0.4 * np.linalg.norm(V * scale) or np.any(np.abs(qdot) > arm.speed)
            qdot = np.clip(qdot, -arm.speed, arm.speed)
        elif self.name == "servo halt":
            # As MoveIt Servo: by the condition number, where the motion leads towards the singularity.
            condition = np.linalg.cond(J)
            qdot = np.linalg.pinv(J) @ V
            ahead = np.linalg.cond(arm.J(self.q + 0.005 * qdot / max(np.linalg.norm(qdot), 1e-9)))
            lower = 0.6 * self.hard
            factor = 1.0 if ahead <= condition or condition < lower else max(0.0, 1 - (condition - lower) / (self.hard - lower))
            qdot, is_off = factor * qdot, factor < 0.02
            if np.any(np.abs(qdot) > arm.speed) and factor == 1.0:
                raise Rejected
        else:
            qdot = np.linalg.pinv(J) @ V
            is_off = np.any(np.abs(qdot) > arm.speed)
            if self.name == "pinv fault" and is_off:
                drive.braking = True
            if self.name in ("pinv clamped", "inverse kinematics"):
                qdot = np.clip(qdot, -(3 if "inv" == self.name[:3] else 1) * arm.speed, (3 if "inv" == self.name[:3] else 1) * arm.speed)
        self.bad = self.bad + 1 if is_off else 0
        if self.bad * arm.dt >= (0.0 if self.name == "pinv fault" else 0.06) and is_off and self.felt is None:
            self.felt = t
        self.q = self.q + arm.dt * qdot
        return self.q, qdot

    def impedance(self, V, drive, t, p, R):
        """Torques of a spring and a damper at the hand."""
        arm, q = self.arm, drive.q
        J = arm.J(q)
        here, turn = arm.asked.xpos[arm.body], arm.asked.xmat[arm.body].reshape(3, 3)
        dR = R @ turn.T
        error = np.r_[p - here, 0.5 * np.array([dR[2, 1] - dR[1, 2], dR[0, 2] - dR[2, 0], dR[1, 0] - dR[0, 1]])]
        M = drive.M()
        inner = np.linalg.inv(J @ np.linalg.solve(M, J.T) + 1e-3 * np.diag(np.r_[np.ones(3), np.ones(3)]))
        F = inner @ (100 * error + 20 * (V - J @ drive.data.qvel))
        u, S, _ = arm.sigma(q)
        scale = 1 / np.r_[np.full(3, arm.length), np.ones(3)]
        is_off = S[5] < 0.06 and np.linalg.norm(error * scale) > 0.15 and abs(u @ (error * scale)) > 0.8 * np.linalg.norm(error * scale)
        self.bad = self.bad + 1 if is_off else 0
        if self.bad * arm.dt > 0.1 and self.felt is None:
            self.felt = t
        return drive.data.qfrc_bias + J.T @ F - M @ (0.5 * drive.data.qvel)


def rotate(R, w):
    angle = np.linalg.norm(w)
    if angle < 1e-12:
        return R
    K = np.cross(np.eye(3), w / angle)
    return (np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K) @ R


def row(t, drive, qc, vc, V=None, pose=None):
    return {"t": t, "q": drive.q, "qdot": drive.data.qvel.copy(), "tau": drive.torque.copy(), "q_cmd": qc, "qdot_cmd": vc, "twist_cmd": V, "pose_cmd": pose}


def singular_incident(arm, rng, law):
    """A law of others past a singular posture: rows, and when it was felt."""
    q0, V, back = approach(arm, rng)
    drive, law = Drive(arm, q0), Law(law, arm, rng, q0, V)
    if np.any(np.abs(drive.data.qfrc_bias) > 0.6 * arm.effort):
        raise Rejected
    rows, p, R = [], law.p.copy(), law.R.copy()
    for k in range(int((back + rng.uniform(1.0, 2.5)) / arm.dt)):
        t = k * arm.dt
        asked = V * quintic(t / 0.3)[0]
        p, R = p + arm.dt * asked[:3], rotate(R, arm.dt * asked[3:])
        pose = np.r_[p, quaternion(R)]
        if law.name == "impedance":
            drive.step(None, None, law.impedance(asked, drive, t, p, R))
            rows.append(row(t, drive, None, None, asked, pose))
        else:
            qc, vc = law.ask(asked, drive, t)
            drive.step(qc, vc)
            rows.append(row(t, drive, qc.copy(), vc.copy(), asked, pose))
        if not np.isfinite(drive.q).all() or np.abs(drive.data.qvel).max() > 60:
            raise Rejected
        if law.felt is None and (np.any(drive.q < arm.lower + 0.02) or np.any(drive.q > arm.upper - 0.02)):
            raise Rejected
    if law.felt is None or law.felt < 0.4:
        raise Rejected
    return rows, law.felt


def quaternion(R):
    q = np.zeros(4)
    mujoco.mju_mat2Quat(q, R.ravel())
    return np.r_[q[1:], q[0]]


class Base:
    """The motion of an arm when something else happens: a joint trajectory, or a twist far from (or beside) a singular posture."""

    def __init__(self, arm, rng, mode, decoy, fraction):
        self.arm, self.mode, self.fraction = arm, mode, fraction
        if mode == "joints":
            middle = draw_singular(arm, rng) if decoy else regular(arm, rng)
            span = np.minimum(arm.upper, middle + 0.9) - np.maximum(arm.lower, middle - 0.9)
            ends = [np.clip(middle + rng.uniform(-0.5, 0.5, arm.n) * span, arm.lower + 0.15, arm.upper - 0.15) for _ in range(2)]
            if decoy:
                ends[1] = np.clip(2 * middle - ends[0], arm.lower + 0.15, arm.upper - 0.15)
            self.start, self.end = ends
            self.time = max(1.2, (1.875 * np.abs(self.end - self.start) / (fraction * arm.speed)).max())
        else:
            self.start = regular(arm, rng)
            if decoy:
                self.start = draw_singular(arm, rng) + rng.choice([-1, 1], arm.n) * 0.06
            u, S, _ = arm.sigma(self.start)
            scale = np.r_[np.full(3, arm.length), np.ones(3)]
            V = rng.normal(size=6)
            V = (V - (V @ u) * u) * scale
            self.V = V * rng.uniform(0.05, 0.15) / max(np.linalg.norm(V[:3]), 0.3 * np.linalg.norm(V[3:]))
            self.time = 3.0
            if fraction > 1:
                needed = np.abs(damped(arm.J(self.start), self.V, 0.005, arm)) / arm.speed
                self.V, self.time = self.V * fraction / needed.max(), 1.2
        self.q = self.start.copy()
        self.low = np.inf

    def at(self, t):
        """Commanded positions, velocities and twist."""
        if self.mode == "joints":
            x, rate = quintic(t / self.time)
            return self.start + x * (self.end - self.start), rate / self.time * (self.end - self.start), None
        V = self.V * quintic(t / 0.3)[0] * (1 - quintic((t - self.time + 0.4) / 0.4)[0])
        qdot = damped(self.arm.J(self.q), V, 0.005, self.arm)
        if np.any(np.abs(qdot) > 0.9 * self.arm.speed) and self.fraction < 1:
            raise Rejected
        self.q = self.q + self.arm.dt * qdot
        return self.q.copy(), qdot, V


def other_incident(arm, rng, cause, mode, decoy):
    """Something that is no singularity, at a time of its own: rows and that time."""
    dt, n = arm.dt, arm.n
    base = Base(arm, rng, mode, decoy, rng.uniform(1.5, 2.5) if cause == "speed limit" else rng.uniform(0.25, 0.6))
    if cause == "joint limit":
        _to_the_limit(base, arm, rng)
    drive, rows = Drive(arm, base.start), []
    if np.any(np.abs(drive.data.qfrc_bias) > 0.6 * arm.effort):
        raise Rejected
    begin = base.time * rng.uniform(0.4, 0.6)
    felt, offset, held, speed, hang = None, np.zeros(n), None, arm.speed, rng.uniform(0.15, 0.6)
    kind = rng.integers(2)
    qc, q_last = base.start.copy(), base.start.copy()
    for k in range(int((base.time + rng.uniform(0.3, 0.8)) / dt)):
        t = k * dt
        qc, vc, V = base.at(t)
        if not np.isfinite(qc).all() or (mode == "twist" and not decoy and cause not in ("joint limit",) and arm.sigma(base.q)[1][5] < 0.09):
            raise Rejected
        if cause == "gap in the stamps" and begin <= t < begin + hang:
            drive.step(q_last, np.zeros(n))
            felt = begin
            continue
        if t >= begin:
            if cause == "jump in the command" and felt is None:
                offset, felt = rng.choice([-1, 1]) * rng.uniform(0.12, 0.4) * np.eye(n)[rng.integers(min(n, 4))], t
            if cause == "unknown" and felt is None:
                felt = t
                drive.braking = kind == 0
                drive.grip = drive.data.xpos[arm.body].copy() if kind else None
            if cause == "oscillation":
                drive.gains, drive.delay = (6000.0, 60.0), round(0.012 / dt)
            if cause == "torque limit":
                drive.load = np.array([0, 0, -1.0]) * arm.heavy * quintic((t - begin) / 0.6)[0]
        qc = qc + offset
        if cause == "speed limit":
            step = np.clip(qc - q_last, -speed * dt, speed * dt)
            if np.any(np.abs(qc - q_last) > 1.05 * speed * dt):
                felt = t if felt is None else felt
            qc, vc = q_last + step, step / dt
        if cause == "joint limit":
            kept = np.clip(qc, arm.lower, arm.upper)
            if np.any(kept != qc):
                felt = t if felt is None else felt
            drive_q, vc = kept, np.where(kept == qc, vc, 0)
        else:
            drive_q = qc
        ask = base.at(t)[0] if cause == "speed limit" and mode == "joints" else qc
        if cause == "NaN" and t >= begin and (kind or t < begin + 0.05):
            felt, drive.braking = begin, True
            ask, V = (np.where(np.arange(n) == 1, np.nan, ask), V if V is None else V * np.nan)
        drive.step(drive_q, vc)
        q_last = drive_q
        if cause == "torque limit" and drive.saturated * dt > 0.15 and felt is None:
            felt = t
        if cause == "oscillation" and felt is None and t > begin and np.abs(drive.data.qvel - vc).max() > 0.3:
            felt = t
        rows.append(row(t, drive, ask, vc, V))
        if not np.isfinite(drive.q).all() or np.abs(drive.data.qvel).max() > 40:
            raise Rejected
        if cause != "joint limit" and (np.any(drive.q < arm.lower + 0.02) or np.any(drive.q > arm.upper - 0.02)):
            raise Rejected
        if cause not in ("torque limit", "oscillation") and drive.saturated * dt > 0.02 and (felt is None or cause in ("none", "speed limit")):
            raise Rejected
    if cause != "none" and (felt is None or felt > rows[-1]["t"] - 0.25):
        raise Rejected
    return rows, felt if felt is not None else 0.0


def _to_the_limit(base, arm, rng):
    """Leads a joint beyond its limit: the drive stops it there."""
    near = [j for j in range(arm.n) if arm.upper[j] < 50]
    j = near[rng.integers(len(near))]
    if base.mode == "joints":
        base.start[j] = arm.upper[j] - rng.uniform(0.4, 0.8)
        base.end[j] = arm.upper[j] + rng.uniform(0.15, 0.4)
    else:
        base.start[j] = base.q[j] = arm.upper[j] - 0.12
        J = arm.J(base.start)
        qdot = np.eye(arm.n)[j] * 0.15 + rng.normal(0, 0.02, arm.n)
        base.V = J @ qdot
        if arm.sigma(base.start)[1][5] < 0.12:
            raise Rejected


def log_rows(arm, rows, rng, rate):
    """The rows that a logger writes of the simulated steps: every so many, rounded by encoders."""
    every = max(1, round(1 / (rate * arm.dt)))
    rows = rows[::every]
    log = {key: np.array([row[key] for row in rows]) for key in rows[0] if rows[0][key] is not None}
    bits = 2 * np.pi / 2 ** rng.integers(17, 21)
    log["q"] = np.round(log["q"] / bits) * bits
    log["qdot"] = log["qdot"] + rng.normal(0, 1e-3, log["qdot"].shape)
    log["tau"] = log["tau"] + rng.normal(0, 0.02, log["tau"].shape)
    return log


# --- files, by the libraries of others ---


def write(log, arm, folder, rng, style):
    """Writes a log in one of six kinds; returns its path."""
    if style in ("csv", "csv degrees"):
        return write_csv(log, arm, folder / "log.csv", rng, style == "csv degrees")
    if style == "lerobot":
        return write_lerobot(log, arm, folder / "set")
    return write_mcap(log, arm, folder / "log.mcap", rng) if style == "mcap" else write_rosbag(log, arm, folder / "bag", rng, style)


def write_csv(log, arm, path, rng, degrees):
    import pandas

    unit = np.degrees(1) if degrees else 1.0
    spelling = rng.integers(4) if not degrees else 1
    place = lambda key, j: (f"{key}.{arm.joints[j]}", f"{key}_{j}", f"{key}[{j}]", f"{arm.joints[j]}_{key}")[spelling]
    words = [{"q": "position", "qdot": "velocity", "tau": "effort", "q_cmd": "position_command", "qdot_cmd": "velocity_command"}] * 4
    words[1] = {"q": "actual_q", "qdot": "actual_qd", "tau": "actual_moment", "q_cmd": "target_q", "qdot_cmd": "target_qd"}
    words[2] = {"q": "q", "qdot": "dq", "tau": "tau_J", "q_cmd": "q_d", "qdot_cmd": "dq_d"}
    columns = {}
    clock = rng.integers(3)
    columns[("time", "timestamp_ms", "stamp_ns")[clock]] = (log["t"] * (1, 1e3, 1e9)[clock]).astype(float if clock == 0 else float)
    for key, word in words[spelling].items():
        if key in log:
            for j in rng.permutation(arm.n):
                columns[place(word, j)] = log[key][:, j] * (unit if key != "tau" else 1)
    for key, ends in (("twist_cmd", ("linear.x", "linear.y", "linear.z", "angular.x", "angular.y", "angular.z")), ("pose_cmd", ("position.x", "position.y", "position.z", "orientation.x", "orientation.y", "orientation.z", "orientation.w"))):  # fmt: skip
        if key in log:
            for k, end in enumerate(ends):
                columns[f"{'twist' if key[0] == 't' else 'target_pose'}_cmd.{end}"] = log[key][:, k]
    columns["battery"] = 24 + rng.normal(0, 0.1, len(log["t"]))
    pandas.DataFrame(columns).to_csv(path, index=False, na_rep="nan", sep=rng.choice([",", ";"]))
    return path


def write_lerobot(log, arm, folder):
    import pyarrow
    from pyarrow import parquet

    data = folder / "data" / "chunk-000"
    data.mkdir(parents=True)
    (folder / "meta").mkdir()
    command = log.get("q_cmd", log["q"])
    vectors = {"observation.state": log["q"], "action": command}
    for key in ("qdot", "tau"):
        if key in log:
            vectors[f"observation.{'velocity' if key == 'qdot' else 'effort'}"] = log[key]
    if "twist_cmd" in log:
        vectors["action.twist"] = log["twist_cmd"]
    table = {key: pyarrow.array(list(x.astype(np.float32)), pyarrow.list_(pyarrow.float32(), x.shape[1])) for key, x in vectors.items()}
    count = len(log["t"])
    table |= {"timestamp": log["t"].astype(np.float32), "frame_index": np.arange(count), "episode_index": np.zeros(count, int)}
    parquet.write_table(pyarrow.table(table), data / "episode_000000.parquet")
    ends = ["linear.x", "linear.y", "linear.z", "angular.x", "angular.y", "angular.z"]
    names = {key: ends if key == "action.twist" else [f"{joint}.pos" if key in ("observation.state", "action") else joint for joint in arm.joints] for key in vectors}
    features = {key: {"dtype": "float32", "shape": [x.shape[1]], "names": names[key]} for key, x in vectors.items()}
    fps = int(round(1 / np.median(np.diff(log["t"]))))
    (folder / "meta" / "info.json").write_text(json.dumps({"codebase_version": "v2.1", "fps": fps, "total_episodes": 1, "features": features}))
    return folder


def messages(log, arm, rng):
    """ROS 2 messages of a log: (topic, type, t, fields) in order of time."""
    order = sorted(range(arm.n), key=lambda j: arm.joints[j])
    nan, t0 = np.full(arm.n, np.nan), 1.7e9
    for k, t in enumerate(log["t"]):
        stamp = {"sec": int(t0 + t), "nanosec": int(round((t % 1) * 1e9)) % 1_000_000_000}
        header = {"stamp": stamp, "frame_id": ""}
        pick = lambda key: [float(log[key][k][j]) for j in order] if key in log else []
        yield "/joint_states", "sensor_msgs/msg/JointState", t0 + t, {"header": header, "name": [arm.joints[j] for j in order], "position": pick("q"), "velocity": pick("qdot"), "effort": pick("tau")}  # fmt: skip
        if "q_cmd" in log:
            zero = {"sec": 0, "nanosec": 0}
            point = {"positions": [float(x) for x in log["q_cmd"][k]], "velocities": [float(x) for x in log.get("qdot_cmd", [nan])[k if "qdot_cmd" in log else 0]], "accelerations": [], "effort": [], "time_from_start": zero}  # fmt: skip
            yield "/arm_controller/joint_trajectory", "trajectory_msgs/msg/JointTrajectory", t0 + t, {"header": header, "joint_names": arm.joints, "points": [point]}
        if "twist_cmd" in log:
            v = [float(x) for x in log["twist_cmd"][k]]
            twist = {"linear": dict(zip("xyz", v[:3])), "angular": dict(zip("xyz", v[3:]))}
            yield "/servo_node/delta_twist_cmds", "geometry_msgs/msg/TwistStamped", t0 + t, {"header": {**header, "frame_id": "base"}, "twist": twist}
        if "pose_cmd" in log:
            x = [float(x) for x in log["pose_cmd"][k]]
            pose = {"position": dict(zip("xyz", x[:3])), "orientation": dict(zip("xyzw", x[3:]))}
            yield "/target_pose", "geometry_msgs/msg/PoseStamped", t0 + t, {"header": {**header, "frame_id": "base"}, "pose": pose}


def write_mcap(log, arm, path, rng):
    from mcap_ros2.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with open(path, "wb") as file:
        writer, schemas = Writer(file), {}
        for topic, kind, t, fields in messages(log, arm, rng):
            if kind not in schemas:
                schemas[kind] = writer.register_msgdef(kind, store.generate_msgdef(kind, ros_version=2)[0])
            writer.write_message(topic, schemas[kind], fields, log_time=int(t * 1e9), publish_time=int(t * 1e9))
        writer.finish()
    return path


def write_rosbag(log, arm, path, rng, style):
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)

    def made(kind, fields):
        values = {}
        for name, (form, content) in store.fielddefs[kind][1]:
            value = fields[name]
            if form == 2:
                value = made(content, value)
            elif form == 4 and content[0][0] == 2:
                value = [made(content[0][1], one) for one in value]
            elif form == 4 and content[0][1][0] == "float64":
                value = np.array(value, float)
            values[name] = value
        return store.types[kind](**values)

    plugin = StoragePlugin.SQLITE3 if style == "rosbag2" else StoragePlugin.MCAP
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        topics = {}
        for topic, kind, t, fields in messages(log, arm, rng):
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(topics[topic], int(t * 1e9), store.serialize_cdr(made(kind, fields), kind))
    return path


STYLES = ("csv", "csv degrees", "lerobot", "mcap", "rosbag2", "rosbag2 mcap")


def incident(seed, rows, folder):
    """The incident of a seed, of the arms `rows`: writes its log into a folder; returns the truth about it."""
    rng = np.random.default_rng(seed)
    name, tip, path = rows[seed % len(rows)]
    is_singular = rng.uniform() < 0.42
    cause = SINGULAR if is_singular else OTHERS[rng.integers(len(OTHERS))]
    law = LAWS[rng.integers(len(LAWS))]
    mode, decoy = rng.choice(["joints", "twist"]), rng.uniform() < 0.35
    decoy = decoy and not (cause == "speed limit" and mode == "twist")
    rate = int(rng.choice([50, 100, 125, 250, 500, 1000]))
    style = STYLES[rng.integers(len(STYLES))]
    arm = Arm(path, tip)
    arm.dt = arm.model.opt.timestep = 0.001 if rate == 1000 else 0.002
    arm.gains = [(900.0, 60.0), (400.0, 40.0), (150.0, 24.0)][rng.integers(3)]
    if cause == "torque limit" and not arm.heavy or cause == "joint limit" and not (arm.upper < 50).any():
        cause = "jump in the command"
    for _ in range(400):
        try:
            if is_singular:
                steps, felt = singular_incident(arm, rng, law)
            else:
                steps, felt = other_incident(arm, rng, cause, mode, decoy)
            break
        except (Rejected, np.linalg.LinAlgError):
            continue
    else:
        return None
    # A logger that runs before the arm does, at stamps that are not quite even, and a twist in the axes of the hand.
    idle = int(rng.choice([0, 0, rng.uniform(0.3, 1.0)]) / arm.dt)
    rest = [{**steps[0], "qdot": 0 * steps[0]["qdot"]}] * idle
    steps = [{**one, "t": k * arm.dt} for k, one in enumerate(rest)] + [{**one, "t": one["t"] + idle * arm.dt} for one in steps]
    felt += idle * arm.dt
    log = log_rows(arm, steps, rng, rate)
    log["t"] = log["t"] + rng.uniform(-0.1, 0.1, len(log["t"])) / rate
    if "twist_cmd" in log and rng.uniform() < 0.25:
        log["twist_cmd"] = np.array([np.r_[R.T @ V[:3], R.T @ V[3:]] for V, R in zip(log["twist_cmd"], (arm.pose(q)[1] for q in log["q"]))])
    keep = {"qdot": rng.uniform() < 0.7, "tau": cause == "torque limit" or rng.uniform() < 0.6, "qdot_cmd": rng.uniform() < 0.4}
    if "twist_cmd" in log:
        both = rng.uniform(size=3)
        keep |= {"twist_cmd": both[0] < 0.75, "q_cmd": both[1] < 0.7, "pose_cmd": both[2] < 0.4}
        if not is_singular or law == "impedance":
            keep |= {"twist_cmd": True}
        if not (keep["twist_cmd"] or keep["q_cmd"] or keep["pose_cmd"]):
            keep["twist_cmd"] = True
    if cause in ("NaN", "jump in the command"):
        keep["q_cmd"] = True
    log = {key: x for key, x in log.items() if keep.get(key, True)}
    truth = {"seed": seed, "cause": cause, "t": float(felt), "arm": name, "tip": tip, "rate": rate, "style": style}
    truth["law"] = law if is_singular else f"{mode}{', beside a singularity' if decoy else ''}"
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(folder / "truth.npz", t=log["t"], q=log["q"])
    truth["path"] = str(write(log, arm, folder, rng, style))
    return truth


def off_deg(arm, truth, first):
    """Angle of a stated ζ to the true one, degrees; 90 where a rotation is stated for a translation, or the other way round."""
    with np.load(pathlib.Path(truth["folder"]) / "truth.npz") as rows:
        q = rows["q"][np.argmin(np.abs(rows["t"] - rows["t"][0] - first["t_nearest"]))]
    zeta, true = np.array(first["zeta"]), arm.zeta(q)
    part, kind = (zeta[:3], "force") if np.linalg.norm(zeta[:3]) > 0.5 else (zeta[3:], "moment")
    return 90.0 if true[kind] is None else float(np.degrees(np.arccos(min(1.0, abs(part @ np.array(true[kind]))))))


def main():
    from armplane import autopsy

    parser = argparse.ArgumentParser(description="Writes incidents of known cause, asks `armplane.autopsy` about each, and counts.")
    parser.add_argument("first", type=int, help="the first seed")
    parser.add_argument("count", type=int)
    parser.add_argument("--keep", type=pathlib.Path, help="folder for the logs [default: a temporary one]")
    options = parser.parse_args()
    rows, counts, angles, skipped = arms(), collections.Counter(), [], 0
    with tempfile.TemporaryDirectory() as temporary:
        for seed in range(options.first, options.first + options.count):
            folder = (options.keep or pathlib.Path(temporary)) / str(seed)
            truth = incident(seed, rows, folder)
            if truth is None:
                skipped += 1
                continue
            answer = autopsy.autopsy(truth["path"], truth["arm"], truth["tip"])
            counts[truth["cause"], answer["cause"]] += 1
            if truth["cause"] == answer["cause"] == SINGULAR:
                path = next(path for name, _, path in rows if name == truth["arm"])
                angles.append(off_deg(Arm(path, truth["tip"]), {**truth, "folder": folder}, answer["evidence"][0]))
            if truth["cause"] != answer["cause"]:
                print(json.dumps({**truth, "answer": answer["cause"]}), flush=True)
    total, right = sum(counts.values()), sum(n for (true, said), n in counts.items() if true == said)
    others = sum(n for (true, _), n in counts.items() if true != SINGULAR)
    false = sum(n for (true, said), n in counts.items() if said == SINGULAR != true)
    print(f"{total} incidents ({skipped} seeds gave none): right cause first {right / max(total, 1):.1%}; called a singularity falsely {false} of {others}; "
          f"ζ within 5° in {sum(angle < 5 for angle in angles)} of {len(angles)}")  # fmt: skip


if __name__ == "__main__":
    main()
