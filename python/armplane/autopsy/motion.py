"""A log as motion of its arm: velocities, what was asked of the hand, singular values; and whether log and arm fit at all."""

import itertools

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.optimize import linear_sum_assignment
from scipy.spatial.transform import Rotation

from .columns import Stream, hold

# Rows whose kinematics are computed; a longer log is thinned.
MOST = 20_000


def smooth(x, width):
    """Moving average of rows over `width` rows."""
    return uniform_filter1d(np.asarray(x, float), int(min(max(width, 1), len(x))), axis=0, mode="nearest")


def slope(t, x, reach):
    """Derivative by the difference over `reach` rows to both sides, for stamps that may stand still or run back."""
    k = np.arange(len(t))
    low, high = np.maximum(k - reach, 0), np.minimum(k + reach, len(t) - 1)
    span = np.maximum(np.abs(t[high] - t[low]), 1e-6)
    return (x[high] - x[low]) / span.reshape(-1, *[1] * (np.ndim(x) - 1))


def filled(x):
    """`x` with the last finite row in place of each row that is none."""
    known = np.isfinite(x.reshape(len(x), -1)).all(axis=1)
    if not known.any():
        return np.zeros_like(x)
    return x[np.maximum.accumulate(np.where(known, np.arange(len(x)), np.argmax(known)))]


def norm(x):
    """The length of a vector, or those of rows."""
    return np.linalg.norm(x, axis=-1)


def alike(x, y):
    """The median over rows of the cosine between two vectors."""
    return np.median(np.sum(x * y, axis=1) / np.maximum(norm(x) * norm(y), 1e-9))


def turned(R, V):
    """Twists with both halves turned by rotations (3, 3) or (N, 3, 3)."""
    return (R @ V.reshape(-1, 2, 3).swapaxes(1, 2)).swapaxes(1, 2).reshape(-1, 6)


class Motion:
    """The log on the clock of its positions, finite everywhere. Rows: `t`, `q`, `v` (measured), `qc`, `vc` (commanded) and `tau`, `None` where not logged;
    Of the thinned `rows`, kinematics: `V`: the hand's twist, `asked`: the one asked for, by the twist, pose or joint command (`asked_by`); `W` and `S`: the same
    with metres as radians; `sigma`, `u`, `null`: the last singular triple; `t_k`, `v_k`: time and joint velocities, every `period` s. `order`: in which the
    log's joints would be the robot's, `None` where they are."""

    def __init__(self, log, robot):
        self.log, self.robot, self.notes, self.fits, self.order = log, robot, [], True, None
        self.t, self.q = log["q"].t, filled(log["q"].x)
        steps = np.diff(self.t)
        self.dt = np.median(steps[steps > 0]) if (steps > 0).any() else 1e-3
        self.reach = max(1, round(0.008 / self.dt))
        v = self._held("qdot")
        self.v = slope(self.t, self.q, self.reach) if v is None else smooth(v, self.reach)
        self.tau, self.vc = self._held("tau"), self._held("qdot_cmd")
        self._order()
        self.qc = self._held("q_cmd") if log["q_cmd"] is not log["q"] else None
        if self.vc is None and self.qc is not None:
            self.vc = slope(self.t, self.qc, self.reach)
        self._limits()
        self.rows = np.unique(np.linspace(0, len(self.t) - 1, min(len(self.t), MOST)).astype(int))
        self._kinematics()

    def _held(self, role):
        stream = self.log[role]
        return None if stream is None else filled(hold(stream, self.t))

    def _order(self):
        """A command whose joints are in another order than the state's is put into its order."""
        command, state = self.log["q_cmd"], self.log["q"]
        if command is None or command is state:
            return
        some = slice(None, None, max(1, len(self.t) // 2000))
        cost = np.median(np.abs(filled(hold(command, self.t))[some, :, None] - self.q[some, None]), axis=0).T
        joints, order = linear_sum_assignment(cost)
        if cost[joints, order].sum() < 0.2 * np.trace(cost) and np.trace(cost) > 0.3:
            self.log.streams["q_cmd"] = Stream(command.t, command.x[:, order], command.name)
            self.notes.append(f"The command's joints are in another order than the state's; they were matched as {', '.join(str(k + 1) for k in order)}.")

    def _limits(self):
        r = self.robot
        beyond = np.mean((self.q < r.lower - 0.1) | (self.q > r.upper + 0.1), axis=0)
        if beyond.max() > 0.3:
            j = np.argmax(beyond)
            self.fits = beyond.max() < 0.9
            self.notes.append(f"{r.joints[j]} is beyond its limits in {beyond[j]:.0%} of the log: another robot, another order of joints, or an offset?")

    def _kinematics(self):
        r, rows = self.robot, self.rows
        self.pose, self.J = r.move(self.q[rows])
        self.u, self.sigma, self.null = r.decompose(self.J)
        sample = np.random.default_rng(0).uniform(np.maximum(r.lower, -np.pi), np.minimum(r.upper, np.pi), (400, r.dof))
        self.usual = np.median(r.decompose(r.move(sample)[1])[1])
        self.t_k, self.v_k = self.t[rows], self.v[rows]
        self.period = np.median(np.diff(self.t_k))
        self.V = np.einsum("kij,kj->ki", self.J, self.v_k)
        self.W = self.V * r.scale
        self.asked, self.asked_by = None, ""
        if (twist := self._held("twist_cmd")) is not None:
            self.asked, self.asked_by = self._twist(twist[rows]), "twist"
        elif (target := self._held("pose_cmd")) is not None and self._target(target):
            self.asked_by = "pose"
        elif self.vc is not None:
            J = self.J if self.qc is None else r.move(self.qc[rows])[1]
            self.asked, self.asked_by = np.einsum("kij,kj->ki", J, self.vc[rows]), "joint command"
        self.S = None if self.asked is None else self.asked * r.scale
        self._pose_fits()

    def _target(self, target):
        """Asks for the pose's own motion, and for what is missing to it within half a second."""
        rows, off = self.rows, target[self.rows, :3, 3] - self.pose[:, :3, 3]
        # A pose of another frame would ask for what nobody wants; one that the arm left in the incident was near before.
        if np.quantile(norm(off), 0.1) > 0.5 * self.robot.length:
            self.notes.append("The commanded poses are not those of this arm's hand; they were left out. Name the frame by --tip.")
            return False
        linear, angular = slope(self.t, target[:, :3, 3], self.reach)[rows] + 2 * off, np.zeros_like(off)
        R = target[:, :3, :3]
        if np.abs(R - np.eye(3)).max() > 1e-9:
            between = lambda a, b: Rotation.from_matrix(b @ np.swapaxes(a, 1, 2)).as_rotvec()
            step = between(R[np.maximum(rows - self.reach, 0)], R[np.minimum(rows + self.reach, len(self.t) - 1)])
            angular = step / (2 * self.reach * self.dt) + 2 * between(self.pose[:, :3, :3], R[rows])
        self.asked = np.concatenate([linear, angular], 1)
        return True

    def _twist(self, twist):
        """The commanded twist in base axes: as it is, from the hand's axes, or turned; found by what the hand did far from singularities."""
        scale = self.robot.scale
        size = norm(twist * scale)
        moving = (size > 0.1 * size.max()) & (size > 0)
        usable = (self.sigma > 0.25 * self.usual) & moving
        is_far = usable.sum() >= 10
        if not is_far:
            usable = moving
        if usable.sum() < 10:
            return twist
        # The first of them: later, the incident itself may be what differs.
        t, first = self.t_k, np.flatnonzero(usable)
        usable &= t < t[first[min(10, len(first) - 1)]] + 0.6
        # Beside a singularity, the motion across the lost direction still tells.
        u = 0 if is_far else self.u[usable]
        across = lambda V: V - np.sum(V * u, axis=1, keepdims=True) * u
        V = across(self.W[usable])
        fit = lambda asked: alike(across((asked * scale)[usable]), V)
        in_hand = turned(self.pose[:, :3, :3], twist)
        as_it_is, as_of_hand = fit(twist), fit(in_hand) - 0.02
        quality = max(as_it_is, as_of_hand)
        pace = norm(V) / size[usable]
        if is_far and quality > 0.8 and abs(np.log(np.median(pace))) > 0.15:
            times = f"{np.median(pace):.2f} times as fast as it was asked"
            self.notes.append(f"From the start, the hand of {self.robot.name} would have moved {times}: is it another robot, or is the command scaled?")
        if quality > 0.8 and quality == as_of_hand:
            self.notes.append("The commanded twist is in the hand's axes.")
            return in_hand
        if quality > 0.8 or not is_far:
            return twist
        base, _ = Rotation.align_vectors(self.V[usable].reshape(-1, 3), twist[usable].reshape(-1, 3))
        again = turned(base.as_matrix(), twist)
        if fit(again) > 0.95 and np.linalg.matrix_rank(twist[usable], tol=0.05 * np.abs(twist).max()) > 1:
            self.notes.append(f"The commanded twist is in axes that are turned by {np.degrees(base.magnitude()):.0f}° to the robot's base.")
            return again
        if np.mean((pace > 0.5) & (pace < 2)) > 0.7 and usable.sum() > 8:
            self._reorder(twist, usable, quality)
        return twist

    def _reorder(self, twist, usable, quality):
        """Looks for an order of the joints in which the hand moves as asked; without one, log and robot do not fit."""
        few = np.flatnonzero(usable)[:: max(1, usable.sum() // 12)][:12]
        q, v, scale = self.q[self.rows[few]], self.v[self.rows[few]], self.robot.scale
        moves = lambda order: np.einsum("kij,kj->ki", self.robot.move(q[:, order])[1], v[:, order]) * scale
        score, order = max((alike(twist[few] * scale, moves(order)), order) for order in itertools.permutations(range(self.robot.dof)))
        if score > max(quality, 0.95):
            self._adopt(order, "the hand then moves as asked")
        elif quality < 0.5:
            self.fits = False
            self.notes.append(f"The hand of {self.robot.name} would not have moved as the log asks (agreement {quality:.2f} of 1): another robot, frame or order of joints?")

    def _adopt(self, order, why):
        self.order = list(order)
        self.notes.append(f"The joints are in another order than in the robot's file, {', '.join(str(k + 1) for k in order)}: {why}.")

    def _pose_fits(self):
        """Compares logged positions of the hand with the arm's: any tool and any place of the base is allowed for, a turned base too."""
        pose = self._held("pose")
        if pose is None or len(self.rows) < 20 or self.order:
            return
        rows = self.rows[np.linspace(0, len(self.rows) - 1, 60).astype(int)]
        q, p = self.q[rows], pose[rows, :3, 3]
        off, span = self._misfit(q, p), norm(p - p.mean(axis=0)).max()
        if span < 0.02 or off < 0.03 * span + 0.003:
            return
        orders = itertools.permutations(range(self.robot.dof)) if self.robot.dof < 7 else ()
        best, order = min(((self._misfit(q[:, order], p, turns=1), order) for order in orders), default=(off, None))
        if best < min(0.02 * span + 0.002, 0.2 * off):
            self._adopt(order, "the hand is then where the log has it")
            return
        self.fits = False
        self.notes.append(f"The log's hand is {off * 1000:.0f} mm from where {self.robot.name} has it, for any tool: another robot, units or order of joints?")

    def _misfit(self, q, p, turns=4):
        """Distance of logged positions `p` from the arm's, with the tool and base that suit best; m, median."""
        pose, _ = self.robot.move(q)
        best = np.inf
        for Z in Rotation.from_euler("z", np.arange(turns)[:, None] * np.pi / 2).as_matrix():
            unknown = np.concatenate([Z @ pose[:, :3, :3], np.tile(np.eye(3), (len(q), 1, 1))], axis=2).reshape(-1, 6)
            missing = (p - pose[:, :3, 3] @ Z.T).ravel()
            left = missing - unknown @ np.linalg.lstsq(unknown, missing, rcond=1e-6)[0]
            best = min(best, np.median(norm(left.reshape(-1, 3))))
        return best


def motion_of(log, robot):
    """The `Motion` of a log, with its joints in the robot's order."""
    first = Motion(log, robot)
    if first.order is None:
        return first
    for stream in {id(one): one for role in ("q", "qdot", "tau", "q_cmd", "qdot_cmd") if (one := log[role]) is not None}.values():
        stream.x = stream.x[:, first.order]
    m = Motion(log, robot)
    m.fits &= m.order is None
    m.notes.append("No one order of the joints suits the whole log." if m.order else first.notes[-1])
    return m
