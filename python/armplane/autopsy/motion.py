"""A log as motion of its arm: velocities, what was asked of the hand, singular values; and whether log and arm fit at all."""

import itertools

import numpy as np

from .columns import Stream, hold

# Rows whose kinematics are computed; a longer log is thinned, but not around its incident.
MOST = 20_000


def smooth(x, width):
    """Moving average of rows over `width` rows, shorter at both ends."""
    width = int(min(max(width, 1), len(x)))
    if width < 2:
        return np.asarray(x, float)
    total = np.cumsum(np.concatenate([np.zeros((1, *np.shape(x)[1:])), x]), axis=0)
    k = np.arange(len(x))
    low, high = np.maximum(k - (width - 1) // 2, 0), np.minimum(k + width // 2 + 1, len(x))
    return (total[high] - total[low]) / (high - low).reshape(-1, *[1] * (np.ndim(x) - 1))


def slope(t, x, reach):
    """Derivative by the difference over `reach` rows to both sides, for stamps that may stand still or run back."""
    k = np.arange(len(t))
    low, high = np.maximum(k - reach, 0), np.minimum(k + reach, len(t) - 1)
    span = np.maximum(np.abs(t[high] - t[low]), 1e-6)
    return (x[high] - x[low]) / span.reshape(-1, *[1] * (np.ndim(x) - 1))


def filled(x):
    """`x` with the last finite row in place of each row that is none."""
    flat = x.reshape(len(x), -1)
    known = np.isfinite(flat).all(axis=1)
    if not known.any():
        return np.zeros_like(x)
    at = np.maximum.accumulate(np.where(known, np.arange(len(x)), 0))
    at[: np.argmax(known)] = np.argmax(known)
    return x[at]


def turn_between(R, S):
    """Rotation vectors (N, 3) from the matrices `R` to `S`, for angles below half a turn."""
    D = S @ np.swapaxes(R, 1, 2)
    axis = np.stack([D[:, 2, 1] - D[:, 1, 2], D[:, 0, 2] - D[:, 2, 0], D[:, 1, 0] - D[:, 0, 1]], 1) / 2
    sine, cosine = np.linalg.norm(axis, axis=1), (np.trace(D, axis1=1, axis2=2) - 1) / 2
    return axis * (np.arctan2(sine, cosine) / np.maximum(sine, 1e-9))[:, None]


class Motion:
    """The log on the clock of its positions, finite everywhere. Rows: `t`, `q`, `v` (measured), `qc`, `vc` (commanded) and `tau`, `None` where not logged;
    `V`: the hand's twist, `asked`: the one asked for, by the twist, pose or joint command (`asked_by`); `sigma`, `u`, `null`: the last singular triple."""

    def __init__(self, log, robot, final=False):
        self.log, self.robot, self.notes, self.fits, self._final = log, robot, [], True, final
        stream = log["q"]
        order = np.arange(len(stream.t))
        self.t, self.q = stream.t[order], filled(stream.x)
        steps = np.diff(self.t)
        self.dt = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1e-3
        self.reach = max(1, round(0.008 / self.dt))
        self.v = slope(self.t, self.q, self.reach)
        if (qdot := log["qdot"]) is not None:
            self.v = smooth(filled(hold(qdot, self.t)), self.reach)
        self.tau = self._held("tau")
        self._order()
        command = log["q_cmd"]
        self.qc = None if command is None or command is stream else self._held("q_cmd")
        self.vc = self._held("qdot_cmd")
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
        x = filled(hold(command, self.t))[:: max(1, len(self.t) // 2000)]
        q = self.q[:: max(1, len(self.t) // 2000)]
        cost = np.median(np.abs(x[:, :, None] - q[:, None, :]), axis=0).T
        order, n = np.argmin(cost, axis=1), np.arange(len(cost))
        if len(set(order)) == len(n) and cost[n, order].sum() < 0.2 * cost[n, n].sum() and cost[n, n].sum() > 0.3:
            self.log.streams["q_cmd"] = Stream(command.t, command.x[:, order], command.name)
            self.notes.append(f"The command's joints are in another order than the state's; they were matched as {', '.join(str(k + 1) for k in order)}.")

    def _limits(self):
        r = self.robot
        beyond = np.mean((self.q < r.lower - 0.1) | (self.q > r.upper + 0.1), axis=0)
        if beyond.max() > 0.3:
            j = int(np.argmax(beyond))
            where = f"{r.joints[j]} is beyond its limits in {beyond[j]:.0%} of the log"
            self.fits = beyond.max() < 0.9
            self.notes.append(f"{where}: another robot, another order of joints, or an offset?")

    def _kinematics(self):
        r, rows = self.robot, self.rows
        pose, J = r.move(self.q[rows])
        self.J, self.pose = J, pose
        self.u, self.sigma, self.null = r.decompose(J)
        sample = np.random.default_rng(0).uniform(np.maximum(r.lower, -np.pi), np.minimum(r.upper, np.pi), (400, r.dof))
        self.usual = float(np.median(r.decompose(r.move(sample)[1])[1]))
        self.V = np.einsum("kij,kj->ki", J, self.v[rows])
        self.asked, self.asked_by = None, ""
        if (twist := self._held("twist_cmd")) is not None:
            self.asked, self.asked_by = self._twist(twist[rows]), "twist"
        elif (target := self._held("pose_cmd")) is not None and self._target(target):
            self.asked_by = "pose"
        elif self.vc is not None:
            self.asked, self.asked_by = np.einsum("kij,kj->ki", r.move(self.qc[rows] if self.qc is not None else self.q[rows])[1], self.vc[rows]), "joint command"
        self._pose_fits()

    def _target(self, target):
        """Asks for the pose's own motion, and for what is missing to it within half a second."""
        rows = self.rows
        p, R = target[rows, :3, 3], target[rows, :3, :3]
        turned = np.abs(target[:, :3, :3] - np.eye(3)).max() > 1e-9
        linear = slope(self.t, target[:, :3, 3], self.reach)[rows] + 2 * (p - self.pose[:, :3, 3])
        # A pose of another frame would ask for what nobody wants.
        if np.median(np.linalg.norm(p - self.pose[:, :3, 3], axis=1)) > 0.5 * self.robot.length:
            self.notes.append("The commanded poses are not those of this arm's hand; they were left out. Name the frame by --tip.")
            return False
        angular = np.zeros_like(linear)
        if turned:
            step = turn_between(target[np.maximum(rows - self.reach, 0), :3, :3], target[np.minimum(rows + self.reach, len(self.t) - 1), :3, :3])
            angular = step / (2 * self.reach * self.dt) + 2 * turn_between(self.pose[:, :3, :3], R)
        self.asked = np.concatenate([linear, angular], 1)
        return True

    def _twist(self, twist):
        """The commanded twist in base axes: as it is, from the hand's axes, or turned; found by what the hand did far from singularities."""
        scale = self.robot.scale
        size = np.linalg.norm(twist * scale, axis=1)
        usable = (self.sigma > 0.25 * self.usual) & (size > 0.1 * size.max()) if size.max() > 0 else np.zeros(len(size), bool)
        if usable.sum() < 10:
            return twist
        # The first of them: later, the incident itself may be what differs.
        late = np.flatnonzero(usable)[min(10, usable.sum() - 1)]
        usable &= (self.t[self.rows] < self.t[self.rows][late] + 0.6) & (np.arange(len(size)) >= np.flatnonzero(usable)[0])
        R = self.pose[:, :3, :3]
        turned = np.concatenate([np.einsum("kij,kj->ki", R, twist[:, :3]), np.einsum("kij,kj->ki", R, twist[:, 3:])], 1)
        fit = lambda x, V: self._alike(x[usable] * scale, V[usable] * scale)
        quality, kind = max((fit(twist, self.V), 1), (fit(turned, self.V) - 0.02, 0))
        if quality > 0.8:
            if not kind:
                self.notes.append("The commanded twist is in the hand's axes.")
            return twist if kind else turned
        Q = self._turn(twist[usable], self.V[usable])
        again = np.concatenate([twist[:, :3] @ Q.T, twist[:, 3:] @ Q.T], 1)
        if fit(again, self.V) > 0.95 and (np.linalg.matrix_rank(twist[usable], tol=0.05 * np.abs(twist).max()) > 1):
            angle = np.degrees(np.arccos(np.clip((np.trace(Q) - 1) / 2, -1, 1)))
            self.notes.append(f"The commanded twist is in axes that are turned by {angle:.0f}° to the robot's base.")
            return again
        pace = np.linalg.norm(self.V[usable] * scale, axis=1) / size[usable]
        if np.mean((pace > 0.5) & (pace < 2)) > 0.7 and usable.sum() > 8:
            self._reorder(twist, usable, quality)
        return twist

    @staticmethod
    def _alike(x, y):
        # The worst twentieth are where something happened.
        scores = np.sum(x * y, axis=1) / np.maximum(np.linalg.norm(x, axis=1) * np.linalg.norm(y, axis=1), 1e-9)
        return float(np.median(scores))

    @staticmethod
    def _turn(x, y):
        U, _, Vt = np.linalg.svd(x[:, :3].T @ y[:, :3] + x[:, 3:].T @ y[:, 3:])
        return (U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt).T

    def _reorder(self, twist, usable, quality):
        """Looks for an order of the joints in which the hand moves as asked; without one, log and robot do not fit."""
        few = np.flatnonzero(usable)[:: max(1, usable.sum() // 12)][:12]
        q, v, n = self.q[self.rows[few]], self.v[self.rows[few]], self.robot.dof
        wanted = twist[few] * self.robot.scale
        best = (quality, None)
        for order in itertools.permutations(range(n)):
            _, J = self.robot.move(q[:, order])
            score = self._alike(wanted, np.einsum("kij,kj->ki", J, v[:, order]) * self.robot.scale)
            best = max(best, (score, order), key=lambda one: one[0])
        if best[1] is not None and best[0] > 0.95:
            self._adopt(best[1], "the hand then moves as asked")
        elif quality < 0.5:
            self.fits = False
            self.notes.append(f"The hand of {self.robot.name} would not have moved as the log asks (agreement {quality:.2f} of 1): another robot, frame or order of joints?")

    def _adopt(self, order, why):
        order = list(order)
        if self._final:
            self.fits = False
            self.notes.append("No one order of the joints suits the whole log.")
            return
        for role in ("q", "qdot", "tau", "q_cmd", "qdot_cmd"):
            if (stream := self.log[role]) is not None:
                stream.x = stream.x[:, order]
        self.notes.append(f"The joints are in another order than in the robot's file, {', '.join(str(k + 1) for k in order)}: {why}.")
        raise Reordered

    def _pose_fits(self):
        """Compares logged positions of the hand with the arm's: any tool and any place of the base is allowed for, a turned base too."""
        pose = self._held("pose")
        if pose is None or len(self.rows) < 20:
            return
        few = np.linspace(0, len(self.rows) - 1, 60).astype(int)
        rows = self.rows[few]
        p = pose[rows, :3, 3]
        off = self._misfit(self.q[rows], p)
        span = np.linalg.norm(p - p.mean(axis=0), axis=1).max()
        if span < 0.02 or off < 0.03 * span + 0.003:
            return
        best = (off, None)
        for order in itertools.permutations(range(self.robot.dof)) if self.robot.dof < 7 else ():
            best = min(best, (self._misfit(self.q[rows][:, order], p, turns=1), order), key=lambda one: one[0])
        if best[1] is not None and best[0] < min(0.02 * span + 0.002, 0.2 * off):
            self._adopt(best[1], "the hand is then where the log has it")
        self.fits = False
        self.notes.append(f"The log's hand is {off * 1000:.0f} mm from where {self.robot.name} has it, for any tool: another robot, units or order of joints?")

    def _misfit(self, q, p, turns=4):
        """Distance of logged positions `p` from the arm's, with the tool and base that suit best; m, median."""
        pose, _ = self.robot.move(q)
        best = np.inf
        for k in range(turns):
            c, s = np.cos(k * np.pi / 2), np.sin(k * np.pi / 2)
            Z = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
            rows = np.concatenate([Z @ pose[:, :3, :3], np.tile(np.eye(3), (len(q), 1, 1))], axis=2).reshape(-1, 6)
            missing = (p - pose[:, :3, 3] @ Z.T).ravel()
            fit = np.linalg.lstsq(rows, missing, rcond=1e-6)[0]
            best = min(best, float(np.median(np.linalg.norm((missing - rows @ fit).reshape(-1, 3), axis=1))))
        return best


class Reordered(Exception):
    """The log's joints were put into the robot's order; the motion is to be computed again."""


def motion_of(log, robot):
    """The `Motion` of a log, with its joints in the robot's order."""
    try:
        return Motion(log, robot)
    except Reordered:
        return Motion(log, robot, final=True)
