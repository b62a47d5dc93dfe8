"""Incidents of known cause, to judge `armplane autopsy` by: arms in MuJoCo under controllers of others, logged by the libraries of others.

    pip install 'armplane[autopsy,experiments]' mujoco example-robot-data
    python python/tests/incidents.py 1000 200           # seeds 1000 to 1199: writes the logs, asks, and counts
    python python/tests/incidents.py 1000 200 --keep /tmp/incidents

Nothing here is taken from armplane: kinematics are MuJoCo's, singular directions are null vectors of its Jacobian at the nearest posture of lower rank, and
a cause is the one that was put in, kept only where the controller itself has felt it.
"""

import argparse
import json
import sys
import tempfile
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pandas
from numpy.linalg import norm
from repository import place
from scipy.spatial.transform import Rotation

DT = 0.002
ROBOTS = place("services/model/robots")
SINGULAR, OTHERS = "singularity", ("joint limit", "speed limit", "torque limit", "gap in the stamps", "jump in the command", "NaN", "oscillation", "unknown", "none")
LAWS = ("dls", "pinv clamped", "servo halt", "pinv fault", "inverse kinematics", "impedance")
STYLES = ("csv", "csv degrees", "lerobot", "mcap", "rosbag2", "rosbag2 mcap")


def built_in(name):
    """A built-in arm: its name, its tip, and the path of its URDF."""
    return name, tomllib.loads((ROBOTS / f"{name}.toml").read_text())["default_frame"], ROBOTS / f"{name}.urdf"


def arms():
    """Six arms, (name for the command, tip, path of the URDF): three that are built in, three of `example-robot-data`."""
    others = next(path for root in sys.path for path in Path(root).glob("cmeel.prefix/share/example-robot-data/robots"))
    files = {"kinova_description/robots/kinova": "j2s6s200_link_6", "z1_description/urdf/z1": "link06", "talos_data/robots/talos_left_arm": "arm_left_7_link"}
    paths = [(others / f"{name}.urdf", tip) for name, tip in files.items()]
    return [*map(built_in, ("ur5", "puma560", "panda")), *((str(path), tip, path) for path, tip in paths)]


class Arm:
    """An arm in MuJoCo: the chain from the root to `tip`, all other joints fixed, no contacts."""

    def __init__(self, name, tip, path):
        self.name, self.tip, self.joints, spec = name, tip, [], mujoco.MjSpec.from_file(str(path))
        body, c = spec.body(tip), spec.compiler
        while body.parent is not None:
            self.joints[:0] = [joint.name for joint in body.joints]
            body = body.parent
        for one in [*spec.geoms, *spec.meshes, *spec.equalities, *(joint for joint in spec.joints if joint.name not in self.joints)]:
            spec.delete(one)
        c.fusestatic, c.discardvisual, c.balanceinertia, c.boundmass, c.boundinertia = False, True, True, 0.3, 0.003
        self.model = m = spec.compile()
        self.dt, self.gains = DT, (900, 60)
        m.opt.timestep, m.opt.integrator = DT, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        m.dof_armature[:] += 0.02
        m.dof_damping[:], m.dof_frictionloss[:] = 0.3, 0
        self.n, self.body, self.asked = m.nv, m.body(tip).id, mujoco.MjData(m)
        limits = ElementTree.parse(path)
        limit = lambda joint, key: limits.find(f"joint[@name='{joint}']/limit").get(key) or 0
        self.speed, effort = (np.array([float(limit(joint, key)) for joint in self.joints]) for key in ("velocity", "effort"))
        self.effort = np.where(effort == 0, 1e6, effort)
        self.lower, self.upper = (np.where(m.jnt_limited, bound, side) for side, bound in zip((-1e3, 1e3), m.jnt_range.T))
        reach = max(np.abs(self.J(np.zeros(self.n))[:3]).max(), 0.2)
        self.length, self.scale = reach / 2, np.r_[np.full(3, reach / 2), np.ones(3)]
        # A load at the hand that its shoulder cannot carry.
        self.heavy = 1.2 * np.sort(self.effort)[-2] / reach if self.effort.max() < 1e6 else 0

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

    def lost(self, q):
        """The direction that is nearest to being lost, and its singular values."""
        U, S, _ = np.linalg.svd(self.J(q) / self.scale[:, None])
        return U[:, 5], S

    def is_inside(self, q, room):
        return np.all(q > self.lower + room) and np.all(q < self.upper - room)

    def sigma(self, q):
        """The last singular value."""
        return self.lost(q)[1][5]

    def beside(self, q, step):
        """The last singular values a step of each joint from `q`."""
        return np.array([self.sigma(q + step * one) for one in np.eye(self.n)])

    def singular_near(self, q, steps=40, floor=2e-4):
        """The posture of lower rank nearest to `q`, by the gradient of the last singular value; `None` where there is none within the limits."""
        q = np.array(q)
        for _ in range(steps):
            if (value := self.sigma(q)) < floor:
                return q
            slope = (self.beside(q, 1e-5) - value) / 1e-5
            q = q - np.clip(value * slope / max(slope @ slope, 1e-9), -0.2, 0.2)
        return None

    def zeta(self, q):
        """The direction lost at the singular posture nearest to `q`: the lost force's (`None` for a pure rotation), and the lost rotation's at the wrist."""
        at = self.singular_near(q)
        at = q if at is None or np.abs(at - q).max() > 0.4 else at
        w, J = self.lost(at)[0] / self.scale, self.J(at)
        # The wrist: the point of the last joint but one nearest to the axis before it.
        (a, b), (pa, pb) = J[3:, self.n - 3 : self.n - 1].T, self.asked.xanchor[self.n - 3 : self.n - 1]
        skew = 1 - (a @ b) ** 2
        wrist = pb if skew < 1e-9 else pb + b * (((pa - pb) @ b - ((pa - pb) @ a) * (a @ b)) / skew)
        force, moment = w[:3], w[3:] + np.cross(self.asked.xpos[self.body] - wrist, w[:3])
        sizes = norm(force), norm(moment)
        return force / sizes[0] if sizes[0] * self.length > 0.05 * sizes[1] else None, moment / sizes[1] if sizes[1] > 0.1 * self.length * sizes[0] else None

    def damped(self, q, V, factor):
        """Joint velocities by damped least squares."""
        J, V = self.J(q) / self.scale[:, None], V / self.scale
        return J.T @ np.linalg.solve(J @ J.T + factor**2 * np.eye(6), V)


class Drive:
    """Joint drives under computed torque, with limits of torque and speed; they brake on a fault, and keep a row for each control period."""

    def __init__(self, arm, q):
        self.arm, self.gains, self.data = arm, arm.gains, mujoco.MjData(arm.model)
        self.data.qpos[:] = q
        mujoco.mj_forward(arm.model, self.data)
        self.braking, self.delay, self.past, self.load, self.grip = False, 0, [], np.zeros(3), None
        self.saturated, self.torque, self.rows = 0, np.zeros(arm.n), []
        if np.any(np.abs(self.data.qfrc_bias) > 0.6 * arm.effort):
            raise Rejected

    @property
    def q(self):
        return self.data.qpos.copy()

    def M(self):
        M = np.zeros((self.arm.n, self.arm.n))
        mujoco.mj_fullM(self.arm.model, self.data, M)
        return M

    def step(self, qc, vc, torque=None):
        d, arm = self.data, self.arm
        self.past.append((d.qpos.copy(), d.qvel.copy()))
        q, v = self.past[-1 - min(self.delay, len(self.past) - 1)]
        if self.braking:
            torque = d.qfrc_bias - self.M() @ (12 * d.qvel)
        elif torque is None:
            torque = d.qfrc_bias + self.M() @ (self.gains[0] * (qc - q) + self.gains[1] * (vc - v))
        self.saturated += arm.dt * (np.abs(torque) > arm.effort).any()
        self.torque = np.clip(torque, -arm.effort, arm.effort)
        d.qfrc_applied[:] = self.torque
        d.xfrc_applied[arm.body, :3] = self.load
        if self.grip is not None:  # A post that the hand has run into.
            d.xfrc_applied[arm.body, :3] += 2e4 * (self.grip - d.xpos[arm.body]) - 150 * (arm.J(d.qpos)[:3] @ d.qvel)
        mujoco.mj_step(arm.model, d)

    def log(self, t, qc, vc, V=None, pose=None):
        """Keeps a row of the state and of the commands."""
        state = {"t": t, "q": self.q, "qdot": self.data.qvel.copy(), "tau": self.torque.copy()}
        self.rows.append({**state, "q_cmd": qc, "qdot_cmd": vc, "twist_cmd": V, "pose_cmd": pose})


def quintic(x):
    x = np.clip(x, 0, 1)
    return x**3 * (10 - 15 * x + 6 * x * x), 30 * x * x * (1 - x) ** 2


class Rejected(Exception):
    """A draw in which nothing happens, or not the thing wanted."""


def require(holds):
    if not holds:
        raise Rejected


def draw(arm, rng, ends, margin):
    """A random posture, `margin` of the range from the limits, or from `ends` where those are nearer."""
    low, high = np.maximum(arm.lower, -ends), np.minimum(arm.upper, ends)
    return low + (high - low) * rng.uniform(margin, 1 - margin, arm.n)


def first(found, tries):
    """The first of so many draws that is one."""
    for _ in range(tries):
        if (q := found()) is not None:
            return q
    raise Rejected


def draw_singular(arm, rng, ends=2.6, margin=0.1, room=0.2, alone=0.12, **precision):
    """A singular posture well within the limits that is not one of several at once: the last but one of its singular values is above `alone`."""

    def found():
        q = arm.singular_near(draw(arm, rng, ends, margin), **{"steps": 25, **precision})
        return q if q is not None and arm.is_inside(q, room) and arm.lost(q)[1][4] > alone and np.abs(q).max() < ends + 0.4 else None

    return first(found, 200)


def draw_regular(arm, rng):
    """A posture far from all singular ones."""
    return first(lambda: q if arm.sigma(q := draw(arm, rng, 2.4, 0.2)) > 0.13 else None, 400)


def paced(V, speed):
    """A twist of this speed, m/s, or of about three times as many rad/s."""
    return V * speed / max(norm(V[:3]), 0.3 * norm(V[3:]))


def approach(arm, rng):
    """A start posture and a constant twist that lead past a singular posture, with a part along ζ."""
    at = draw_singular(arm, rng)
    slope = arm.beside(at, 0.05)
    near = at + rng.choice([-1, 1]) * rng.uniform(0.02, 0.07) * slope / max(norm(slope), 1e-6)
    u, qdot = arm.lost(near)[0], rng.normal(size=arm.n)
    V = arm.J(near) @ (qdot / norm(qdot)) / arm.scale
    V = V - (V @ u) * u
    V = paced((V / max(norm(V), 1e-9) + rng.choice([-1, 1]) * rng.uniform(0.4, 1.5) * u) * arm.scale, rng.uniform(0.06, 0.2))
    q, back = near.copy(), rng.uniform(0.8, 2)
    for _ in range(int(back / 0.01)):
        q = q - 0.01 * arm.damped(q, V, 0.01)
        require(arm.is_inside(q, 0.1))
    require(arm.sigma(q) >= 0.1 and np.all(np.abs(arm.damped(q, V, 0.001)) <= 0.6 * arm.speed))
    return q, V, back


class Law:
    """Controllers of others, from a twist to joint velocities; `felt` is the time at which the singularity first had its way."""

    def __init__(self, name, arm, rng, q):
        self.name, self.arm, self.q, self.felt, self.bad = name, arm, q.copy(), None, 0
        self.factor = float(rng.choice([0.02, 0.05, 0.1])) if name == "dls" else 0
        self.p, self.R = arm.pose(q)
        self.hard = float(rng.uniform(25, 45))

    def feel(self, t, is_off, seconds):
        """Whether the hand has been off for so long."""
        self.bad = self.bad + 1 if is_off else 0
        if is_off and self.bad * self.arm.dt >= seconds and self.felt is None:
            self.felt = t

    def ask(self, V, drive, t):
        """Joint positions and velocities to command."""
        arm, J = self.arm, self.arm.J(self.q)
        qdot = arm.damped(self.q, V, self.factor) if self.name == "dls" else np.linalg.pinv(J) @ V
        is_fast = bool(np.any(np.abs(qdot) > arm.speed))
        is_off, most = is_fast, arm.speed
        if self.name == "dls":
            is_off |= norm((J @ qdot - V) / arm.scale) > 0.4 * norm(V / arm.scale)
        elif self.name == "servo halt":
            # As MoveIt Servo: by the condition number, where the motion leads towards the singularity.
            condition, lower = np.linalg.cond(J), 0.6 * self.hard
            ahead = np.linalg.cond(arm.J(self.q + 0.005 * qdot / max(norm(qdot), 1e-9)))
            factor = 1 if ahead <= condition or condition < lower else max(0, 1 - (condition - lower) / (self.hard - lower))
            require(not (is_fast and factor == 1))
            qdot, is_off, most = factor * qdot, factor < 0.02, np.inf
        elif self.name == "pinv fault":
            drive.braking |= is_off
            most = np.inf
        elif self.name == "inverse kinematics":
            most = 3 * arm.speed
        self.feel(t, is_off, 0 if self.name == "pinv fault" else 0.06)
        qdot = np.clip(qdot, -most, most)
        self.q = self.q + arm.dt * qdot
        return self.q, qdot

    def impedance(self, V, drive, t, p, R):
        """Torques of a spring and a damper at the hand."""
        arm, q, M = self.arm, drive.q, drive.M()
        here, turn = arm.pose(q)
        J, D = arm.J(q), R @ turn.T
        error = np.r_[p - here, 0.5 * np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]])]
        F = np.linalg.inv(J @ np.linalg.solve(M, J.T) + 1e-3 * np.eye(6)) @ (100 * error + 20 * (V - J @ drive.data.qvel))
        (u, S), off = arm.lost(q), error / arm.scale
        self.feel(t, S[5] < 0.06 and norm(off) > 0.15 and abs(u @ off) > 0.8 * norm(off), 0.1 + 1e-9)
        return drive.data.qfrc_bias + J.T @ F - M @ (0.5 * drive.data.qvel)


def singular_incident(arm, rng, law):
    """A law of others past a singular posture: rows, and when it was felt."""
    q0, V, back = approach(arm, rng)
    law = Law(law, arm, rng, q0)
    drive, p, R = Drive(arm, q0), law.p.copy(), law.R.copy()
    for k in range(int((back + rng.uniform(1, 2.5)) / arm.dt)):
        t, asked = k * arm.dt, V * quintic(k * arm.dt / 0.3)[0]
        p, R = p + arm.dt * asked[:3], Rotation.from_rotvec(arm.dt * asked[3:]).as_matrix() @ R
        qc = vc = None
        if law.name == "impedance":
            drive.step(None, None, law.impedance(asked, drive, t, p, R))
        else:
            qc, vc = law.ask(asked, drive, t)
            drive.step(qc, vc)
        drive.log(t, qc, vc, asked, np.r_[p, Rotation.from_matrix(R).as_quat()])
        require(np.isfinite(drive.q).all() and np.abs(drive.data.qvel).max() <= 60)
        require(law.felt is not None or arm.is_inside(drive.q, 0.02))
    require(law.felt is not None and law.felt >= 0.4)
    return drive.rows, law.felt


class Base:
    """The motion of an arm when something else happens: a joint trajectory, or a twist far from (or beside) a singular posture."""

    def __init__(self, arm, rng, mode, decoy, fraction):
        self.arm, self.mode, self.fraction, self.time = arm, mode, fraction, 3
        if mode == "joints":
            middle = draw_singular(arm, rng) if decoy else draw_regular(arm, rng)
            span = np.minimum(arm.upper, middle + 0.9) - np.maximum(arm.lower, middle - 0.9)
            keep = lambda q: np.clip(q, arm.lower + 0.15, arm.upper - 0.15)
            self.start, self.end = (keep(middle + rng.uniform(-0.5, 0.5, arm.n) * span) for _ in range(2))
            self.end = keep(2 * middle - self.start) if decoy else self.end
            self.time = max(1.2, (1.875 * np.abs(self.end - self.start) / (fraction * arm.speed)).max())
        else:
            self.start = draw_regular(arm, rng)
            if decoy:
                self.start = draw_singular(arm, rng) + rng.choice([-1, 1], arm.n) * 0.06
            u, V = arm.lost(self.start)[0], rng.normal(size=6)
            self.V = paced((V - (V @ u) * u) * arm.scale, rng.uniform(0.05, 0.15))
            if fraction > 1:
                needed = np.abs(arm.damped(self.start, self.V, 0.005)) / arm.speed
                self.V, self.time = self.V * fraction / needed.max(), 1.2
        self.q = self.start.copy()

    def to_the_limit(self, rng):
        """Leads a joint beyond its limit: the drive stops it there."""
        arm, near = self.arm, np.flatnonzero(self.arm.upper < 50)
        j = near[rng.integers(len(near))]
        if self.mode == "joints":
            self.start[j], self.end[j] = arm.upper[j] - rng.uniform(0.4, 0.8), arm.upper[j] + rng.uniform(0.15, 0.4)
        else:
            self.start[j] = self.q[j] = arm.upper[j] - 0.12
            self.V = arm.J(self.start) @ (np.eye(arm.n)[j] * 0.15 + rng.normal(0, 0.02, arm.n))
            require(arm.sigma(self.start) >= 0.12)

    def at(self, t):
        """Commanded positions, velocities and twist."""
        if self.mode == "joints":
            x, rate = quintic(t / self.time)
            return self.start + x * (self.end - self.start), rate / self.time * (self.end - self.start), None
        arm, V = self.arm, self.V * quintic(t / 0.3)[0] * (1 - quintic((t - self.time + 0.4) / 0.4)[0])
        qdot = arm.damped(self.q, V, 0.005)
        missing, asked = (norm(one / arm.scale) for one in (arm.J(self.q) @ qdot - V, V))
        # A base that strays from its own twist would be an incident already.
        require(missing <= 0.1 * asked + 1e-6 and (self.fraction >= 1 or np.all(np.abs(qdot) <= 0.9 * arm.speed)))
        self.q = self.q + arm.dt * qdot
        return self.q, qdot, V


def other_incident(arm, rng, cause, mode, decoy):
    """Something that is no singularity, at a time of its own: rows and that time."""
    dt, n, speed = arm.dt, arm.n, arm.speed
    base = Base(arm, rng, mode, decoy, rng.uniform(1.5, 2.5) if cause == "speed limit" else rng.uniform(0.25, 0.6))
    if cause == "joint limit":
        base.to_the_limit(rng)
    drive, begin = Drive(arm, base.start), base.time * rng.uniform(0.4, 0.6)
    felt, offset, hang, kind, last = None, np.zeros(n), rng.uniform(0.15, 0.6), rng.integers(2), base.start.copy()
    for k in range(int((base.time + rng.uniform(0.3, 0.8)) / dt)):
        t = k * dt
        qc, vc, V = base.at(t)
        require(np.isfinite(qc).all() and (mode == "joints" or decoy or cause == "joint limit" or arm.sigma(base.q) >= 0.09))
        if cause == "gap in the stamps" and begin <= t < begin + hang:
            drive.step(last, np.zeros(n))
            felt = begin
            continue
        if t >= begin:
            if cause == "jump in the command" and felt is None:
                offset, felt = rng.choice([-1, 1]) * rng.uniform(0.12, 0.4) * np.eye(n)[rng.integers(min(n, 4))], t
            elif cause == "unknown" and felt is None:
                felt, drive.braking, drive.grip = t, kind == 0, drive.data.xpos[arm.body].copy() if kind else None
            elif cause == "oscillation":
                drive.gains, drive.delay = (6000, 60), round(0.012 / dt)
            elif cause == "torque limit":
                drive.load = np.array([0, 0, -1]) * arm.heavy * quintic((t - begin) / 0.6)[0]
        told = qc = qc + offset
        is_over = False
        if cause == "speed limit":
            step = np.clip(qc - last, -speed * dt, speed * dt)
            is_over = np.any(np.abs(qc - last) > 1.05 * speed * dt)
            qc, vc = last + step, step / dt
            told = base.at(t)[0] if mode == "joints" else qc
        elif cause == "joint limit":
            qc = np.clip(told, arm.lower, arm.upper)
            is_over, vc = np.any(qc != told), np.where(qc == told, vc, 0)
        elif cause == "NaN" and t >= begin and (kind or t < begin + 0.05):
            felt, drive.braking = begin, True
            told, V = np.where(np.arange(n) == 1, np.nan, told), V if V is None else V * np.nan
        drive.step(qc, vc)
        last = qc
        is_over |= cause == "torque limit" and drive.saturated > 0.15
        is_over |= cause == "oscillation" and t > begin and np.abs(drive.data.qvel - vc).max() > 0.3
        felt = t if felt is None and is_over else felt
        drive.log(t, told, vc, V)
        require(np.isfinite(drive.q).all() and np.abs(drive.data.qvel).max() <= 40)
        require(cause == "joint limit" or arm.is_inside(drive.q, 0.02 - 1e-12))
        require(cause in ("torque limit", "oscillation") or drive.saturated <= 0.02 or felt is not None and cause not in ("none", "speed limit"))
    require(cause == "none" or felt is not None and felt <= drive.rows[-1]["t"] - 0.25)
    return drive.rows, felt or 0


def happened(arm, rng, cause, how):
    """The first draw in which an incident of this cause happens: rows, and when. `how`: the law of a singularity; of all else mode and decoy."""
    for _ in range(400):
        try:
            return singular_incident(arm, rng, how) if cause == SINGULAR else other_incident(arm, rng, cause, *how)
        except (Rejected, np.linalg.LinAlgError):
            continue
    raise Rejected


def log_rows(arm, rows, rng, rate):
    """The rows that a logger writes of the simulated steps: every so many, rounded by encoders."""
    rows = rows[:: max(1, round(1 / (rate * arm.dt)))]
    log = {key: np.array([row[key] for row in rows]) for key in rows[0] if rows[0][key] is not None}
    bits = 2 * np.pi / 2 ** rng.integers(17, 21)
    log["q"] = np.round(log["q"] / bits) * bits
    log["qdot"] = log["qdot"] + rng.normal(0, 1e-3, log["qdot"].shape)
    log["tau"] = log["tau"] + rng.normal(0, 0.02, log["tau"].shape)
    return log


# --- files, by the libraries of others ---

TWIST, POSE = "linear.x linear.y linear.z angular.x angular.y angular.z", "position.x position.y position.z orientation.x orientation.y orientation.z orientation.w"
# Words of a CSV's columns and how a joint's number or name follows, spelled as by four loggers.
WORDS = [
    ("position velocity effort position_command velocity_command", "{word}.{name}"),
    ("actual_q actual_qd actual_moment target_q target_qd", "{word}_{j}"),
    ("q dq tau_J q_d dq_d", "{word}[{j}]"),
    ("position velocity effort position_command velocity_command", "{name}_{word}"),
]
JOINT_KEYS = "q qdot tau q_cmd qdot_cmd".split()


def write(log, arm, folder, rng, style):
    """Writes a log in one of six kinds; returns its path."""
    if style.startswith("csv"):
        return write_csv(log, arm, folder / "log.csv", rng, style == "csv degrees")
    return write_lerobot(log, arm, folder / "set") if style == "lerobot" else write_messages(log, arm, folder, style)


def write_csv(log, arm, path, rng, degrees):
    words, form = WORDS[1 if degrees else int(rng.integers(4))]
    name, factor = (("time", 1), ("timestamp_ms", 1e3), ("stamp_ns", 1e9))[rng.integers(3)]
    columns = {name: log["t"] * factor}
    for key, word in zip(JOINT_KEYS, words.split()):
        for j in rng.permutation(arm.n) if key in log else ():
            columns[form.format(word=word, j=j, name=arm.joints[j])] = np.degrees(log[key][:, j]) if degrees and key != "tau" else log[key][:, j]
    for key, start, ends in (("twist_cmd", "twist_cmd", TWIST), ("pose_cmd", "target_pose_cmd", POSE)):
        columns |= {f"{start}.{end}": log[key][:, k] for k, end in enumerate(ends.split()) if key in log}
    columns["battery"] = 24 + rng.normal(0, 0.1, len(log["t"]))
    pandas.DataFrame(columns).to_csv(path, index=False, na_rep="nan", sep=rng.choice([",", ";"]))
    return path


def write_lerobot(log, arm, folder):
    for name in ("data/chunk-000", "meta"):
        (folder / name).mkdir(parents=True)
    columns = {"q": "observation.state", "q_cmd": "action", "qdot": "observation.velocity", "tau": "observation.effort", "twist_cmd": "action.twist"}
    vectors = {name: x.astype(np.float32) for key, name in columns.items() if (x := log.get(key, log["q"] if key == "q_cmd" else None)) is not None}
    count, positions = len(log["t"]), [f"{joint}.pos" for joint in arm.joints]
    rows = {**{name: list(x) for name, x in vectors.items()}, "timestamp": log["t"].astype(np.float32), "frame_index": range(count), "episode_index": [0] * count}
    pandas.DataFrame(rows).to_parquet(folder / "data/chunk-000/episode_000000.parquet")
    names = {"observation.state": positions, "action": positions, "action.twist": TWIST.split()}
    features = {name: {"dtype": "float32", "shape": [x.shape[1]], "names": names.get(name, arm.joints)} for name, x in vectors.items()}
    info = {"codebase_version": "v2.1", "fps": round(1 / np.median(np.diff(log["t"]))), "total_episodes": 1, "features": features}
    (folder / "meta/info.json").write_text(json.dumps(info))
    return folder


def messages(log, arm, types):
    """ROS 2 messages of a log, (topic, t, message) in order of time; `types` are those of rosbags."""
    order, t0, none = sorted(range(arm.n), key=lambda j: arm.joints[j]), 1.7e9, np.zeros(0)
    message = lambda name, *fields: types[name.replace("/", "/msg/")](*fields)
    pair = lambda name, x, first, second: message(f"geometry_msgs/{name}", message(f"geometry_msgs/{first}", *x[:3]), message(f"geometry_msgs/{second}", *x[3:]))
    for k, t in enumerate(log["t"]):
        row = {key: values[k].astype(float) for key, values in log.items()}
        header = lambda frame="": message("std_msgs/Header", message("builtin_interfaces/Time", int(t0 + t), round((t % 1) * 1e9) % 1_000_000_000), frame)
        state = (row[key][order] if key in row else none for key in ("q", "qdot", "tau"))
        yield "/joint_states", t0 + t, message("sensor_msgs/JointState", header(), [arm.joints[j] for j in order], *state)
        if "q_cmd" in row:
            speeds = row.get("qdot_cmd", np.full(arm.n, np.nan))
            point = message("trajectory_msgs/JointTrajectoryPoint", row["q_cmd"], speeds, none, none, message("builtin_interfaces/Duration", 0, 0))
            yield "/arm_controller/joint_trajectory", t0 + t, message("trajectory_msgs/JointTrajectory", header(), arm.joints, [point])
        if "twist_cmd" in row:
            twist = pair("Twist", row["twist_cmd"], "Vector3", "Vector3")
            yield "/servo_node/delta_twist_cmds", t0 + t, message("geometry_msgs/TwistStamped", header("base"), twist)
        if "pose_cmd" in row:
            yield "/target_pose", t0 + t, message("geometry_msgs/PoseStamped", header("base"), pair("Pose", row["pose_cmd"], "Point", "Quaternion"))


def write_messages(log, arm, folder, style):
    """By rosbags as a bag of either kind; or the one file of a bag."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store, known, path = get_typestore(Stores.ROS2_HUMBLE), {}, folder / "bag"
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3 if style == "rosbag2" else StoragePlugin.MCAP) as bag:
        for topic, t, one in messages(log, arm, store.types):
            if topic not in known:
                known[topic] = bag.add_connection(topic, one.__msgtype__, typestore=store)
            bag.write(known[topic], int(t * 1e9), store.serialize_cdr(one, one.__msgtype__))
    return next(path.glob("*.mcap")) if style == "mcap" else path


def incident(seed, rows, folder):
    """The incident of a seed, of the arms `rows`: writes its log into a folder; returns the truth about it."""
    rng = np.random.default_rng(seed)
    arm = Arm(*rows[seed % len(rows)])
    is_singular = rng.uniform() < 0.42
    cause, law = SINGULAR if is_singular else OTHERS[rng.integers(len(OTHERS))], LAWS[rng.integers(len(LAWS))]
    mode, decoy = rng.choice(["joints", "twist"]), rng.uniform() < 0.35
    decoy = decoy and not (cause == "speed limit" and mode == "twist")
    rate, style = int(rng.choice([50, 100, 125, 250, 500, 1000])), STYLES[rng.integers(len(STYLES))]
    arm.dt = arm.model.opt.timestep = 0.001 if rate == 1000 else DT
    arm.gains = [(900, 60), (400, 40), (150, 24)][rng.integers(3)]
    if cause == "torque limit" and not arm.heavy or cause == "joint limit" and not (arm.upper < 50).any():
        cause = "jump in the command"
    try:
        steps, felt = happened(arm, rng, cause, law if is_singular else (mode, decoy))
    except Rejected:
        return None
    # A logger that runs before the arm does, at stamps that are not quite even, and a twist in the axes of the hand.
    idle = int(rng.choice([0, 0, rng.uniform(0.3, 1)]) / arm.dt)
    steps = [{**steps[0], "qdot": 0 * steps[0]["qdot"], "t": k * arm.dt} for k in range(idle)] + [{**one, "t": one["t"] + idle * arm.dt} for one in steps]
    log = log_rows(arm, steps, rng, rate)
    log["t"] = log["t"] + rng.uniform(-0.1, 0.1, len(log["t"])) / rate
    if "twist_cmd" in log and rng.uniform() < 0.25:
        turns = (arm.pose(q)[1] for q in log["q"])
        log["twist_cmd"] = np.array([np.r_[R.T @ V[:3], R.T @ V[3:]] for V, R in zip(log["twist_cmd"], turns)])
    keep = {"qdot": rng.uniform() < 0.7, "tau": cause == "torque limit" or rng.uniform() < 0.6, "qdot_cmd": rng.uniform() < 0.4}
    if "twist_cmd" in log:
        keep |= dict(zip(("twist_cmd", "q_cmd", "pose_cmd"), rng.uniform(size=3) < (0.75, 0.7, 0.4)))
        keep["twist_cmd"] |= not is_singular or law == "impedance" or not (keep["q_cmd"] or keep["pose_cmd"])
    keep["q_cmd"] = keep.get("q_cmd", True) or cause in ("NaN", "jump in the command")
    log = {key: x for key, x in log.items() if keep.get(key, True)}
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(folder / "truth.npz", t=log["t"], q=log["q"])
    how = law if is_singular else f"{mode}{', beside a singularity' if decoy else ''}"
    truth = {"seed": seed, "cause": cause, "t": felt + idle * arm.dt, "arm": arm.name, "tip": arm.tip, "rate": rate, "style": style, "law": how}
    return {**truth, "path": str(write(log, arm, folder, rng, style))}


def off_deg(arm, t, q, first):
    """Angle of a stated ζ to the true one, degrees; 90 where a rotation is stated for a translation, or the other way round."""
    is_turn = int(norm(first["zeta"][:3]) < 0.5)
    true = arm.zeta(q[np.argmin(np.abs(t - t[0] - first["t_nearest"]))])[is_turn]
    return 90 if true is None else float(np.degrees(np.arccos(min(1, abs(np.reshape(first["zeta"], (2, 3))[is_turn] @ true)))))


def main():
    from armplane import autopsy

    parser = argparse.ArgumentParser(description="Writes incidents of known cause, asks `armplane.autopsy` about each, and counts.")
    parser.add_argument("first", type=int, help="the first seed")
    parser.add_argument("count", type=int)
    parser.add_argument("--keep", type=Path, help="folder for the logs, which are not written again [default: a temporary one]")
    options = parser.parse_args()
    rows, found = arms(), []
    with tempfile.TemporaryDirectory() as temporary:
        for seed in range(options.first, options.first + options.count):
            folder = (options.keep or Path(temporary)) / str(seed)
            kept = folder / "truth.json"
            truth = json.loads(kept.read_text()) if kept.is_file() else incident(seed, rows, folder)
            if truth is None:
                continue
            kept.write_text(json.dumps(truth))
            answer, deg = autopsy.autopsy(truth["path"], truth["arm"], truth["tip"]), None
            if truth["cause"] != answer["cause"]:
                print(json.dumps({**truth, "answer": answer["cause"]}), flush=True)
            elif truth["cause"] == SINGULAR:
                with np.load(folder / "truth.npz") as state:
                    deg = off_deg(Arm(*rows[seed % len(rows)]), state["t"], state["q"], answer["evidence"][0])
            found.append((truth["cause"], answer["cause"], deg))
    table = pandas.DataFrame(found, columns=["true", "said", "deg"])
    others = table.said[table.true != SINGULAR]
    print(f"{len(table)} incidents ({options.count - len(table)} seeds gave none): right cause first {(table.true == table.said).mean():.1%}; "
          f"called a singularity falsely {(others == SINGULAR).sum()} of {len(others)}; ζ within 5° in {(table.deg < 5).sum()} of {table.deg.count()}")  # fmt: skip


if __name__ == "__main__":
    main()
