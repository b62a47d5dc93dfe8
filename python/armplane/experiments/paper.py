"""Chang & Khatib's Figures 1 to 5, drawn from runs just made: `figures("folder")`."""

import json
import pathlib
import tempfile
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.linalg import norm
from scipy.spatial.transform import Rotation

from .. import _armplane
from ..results import as_settings
from ..trials import trace
from .style import BLUE, GREY, INK, RED, SINGULARITIES, curves, digits, legend, page, postures, undistorted

SCENARIOS = ("fig1-pseudo-inverse", "fig2-dynamically-consistent", "elbow-in-and-out", "overhead-pass", "fig4-elbow-and-wrist", "fig5-wrist-rotation")
HAND_M = 0.15  # of the stick that shows the hand's axis
POSTURES = 9
SWING_S = 0.33  # half a swing of the null space
MAGNIFIED = 50
# Of each lock: what the hand cannot do, the lines that fall together, why they do, and the type that the paper gives.
LOCKS = {
    "elbow": ("move along", "shoulder, elbow, wrist", "shoulder, elbow and wrist are in one line, and ζ is that line", "type 1"),
    "wrist": ("turn about", "axes 4 and 6", "axes 4 and 6 are one line, and ζ is at right angles to it and to axis 5", "type 2"),
    "overhead": ("move along", "waist's axis", "the wrist is as near to the waist's axis as it can come, and ζ is normal to the arm's plane", "type 2"),
}
X, Y, Z = np.eye(3)


def figures(out, settings=None):
    """Runs the paper's scenarios, with `settings` overridden, and saves the figures and `figures.json` in the folder `out`; returns the numbers."""
    folder = pathlib.Path(out)
    if folder.is_file() or folder.is_dir() and any(folder.iterdir()):
        raise ValueError(f"{folder} exists: choose another folder")
    folder.mkdir(parents=True, exist_ok=True)
    # A command that is stopped leaves an empty folder, in which it begins anew.
    with tempfile.TemporaryDirectory(dir=folder) as draft:
        numbers = _drawn(pathlib.Path(draft), settings)
        for file in pathlib.Path(draft).iterdir():
            file.replace(folder / file.name)
    return numbers


def _drawn(folder, settings):
    with ThreadPoolExecutor() as pool:
        fig1, fig2, elbow, overhead, fig4, fig5 = pool.map(lambda name: Recorded(name, settings), SCENARIOS)
    numbers = null_space(folder / "fig1-2", fig1, fig2)
    numbers["fig3"] = three_locks(folder / "fig3", {"elbow": elbow, "wrist": fig5, "overhead": overhead})
    numbers["fig4"] = two_locks(folder / "fig4", fig4)
    numbers["fig5"] = wrist_lock(folder / "fig5", fig5)
    # Without the numbers and arrays of numpy.
    text = json.dumps(numbers, indent=1, default=lambda value: value.tolist())
    (folder / "figures.json").write_text(f"{text}\n")
    return json.loads(text)


def unit(v):
    return v / norm(v)


class Recorded:
    """The signals of a run as arrays, and its arm."""

    def __init__(self, scenario, settings=None):
        table = trace(scenario, settings)
        self.columns = {name: table[name].to_numpy() for name in table.column_names}
        self.t = self.columns["t_s"]
        self.arm = _armplane.scenario_arm(str(scenario), as_settings(settings))
        self.q, self.p, p_d = map(self.vectors, ("joint.q", "hand.position", "desired.position"))
        hand, desired = (Rotation.from_quat(self.vectors(f"{one}.orientation")) for one in ("hand", "desired"))
        self.R, self.turned, self.off = hand.as_matrix(), (hand * hand[0].inv()).as_rotvec(), p_d - self.p
        self.error_mm = 1e3 * norm(self.off, axis=1)
        self.error_deg = np.degrees((hand * desired.inv()).magnitude())

    def vectors(self, quantity):
        """Of each tick the elements of a quantity."""
        return np.stack([values for name, values in self.columns.items() if name.rpartition(".")[0] == quantity], axis=1)

    def s(self, name):
        return self.columns[f"singularity.s.{name}"]

    def zeta(self, name):
        """The moving or the turning half of ζ, whichever it has."""
        v, w = np.hsplit(self.vectors(f"singularity.zeta.{name}"), 2)
        return np.where(norm(v, axis=1, keepdims=True) > 0.5, v, w)

    def chain(self, i):
        """Base, joints, end-effector and, in space, the end of a stick along its z axis; m."""
        points, z = [0 * Z, *self.arm.at(self.q[i]).links[:, :3, 3], self.p[i]], self.R[i][:, 2]
        return np.array([*points, self.p[i] + HAND_M * z] if np.ptp(self.p[:, 2]) > 1e-9 or abs(z[2]) < 0.999 else points)

    def moments(self, start, end):
        """Even steps of time."""
        within = np.flatnonzero((self.t >= start) & (self.t <= end))
        return within[np.linspace(0, len(within) - 1, POSTURES).astype(int)]

    def seen(self, start, end, across, up=Z):
        """The arm at even steps of time, in the plane of two directions."""
        return [self.chain(i) @ np.stack([across, up], axis=1) for i in self.moments(start, end)]

    def outwards(self, direction):
        """A horizontal direction, to the side on which the hand is at the start."""
        return direction if self.p[0] @ direction >= 0 else -direction

    def coupling_n(self, i):
        """The force with which the null-space torques act on the tip of an arm in the plane, |J̄ᵀΓ_null|; N."""
        at, torque = self.arm.at(self.q[i]), self.vectors("torque.null")[i]
        J = at.J[:2]
        AinvJT = np.linalg.solve(at.A, J.T)
        return norm(np.linalg.solve(J @ AinvJT, AinvJT.T @ torque))


def joints(values, which):
    """Joints' angles or rates in degrees, as `curves` takes them."""
    return [(f"$q_{i}$", np.degrees(values[:, i - 1])) for i in which]


def null_space(path, *pair):
    """Figures 1 and 2: a planar arm whose null space swings without dissipation while its tip should stand still, under both projections."""
    numbers, series, (t, names, colours) = {}, [[], []], (pair[0].t, ("pseudo-inverse", "dynamically consistent"), (RED, BLUE))
    for key, run, name, colour in zip(("fig1", "fig2"), pair, names, colours):
        force = np.array([run.coupling_n(i) for i in range(len(t))])
        for values, kind, least in zip((run.error_mm, force), series, (1e-4, 1e-16)):
            kind.append((name, np.maximum(values, least), colour))
        swings = [np.degrees(np.ptp(run.q[(t >= start) & (t < start + 1), 1])) for start in (0, 1)]
        numbers[key] = {"tip_error_max_mm": run.error_mm.max(), "coupling_max_n": force.max(), "joint_2_swings_deg": swings}
    error, push = ([digits(one[name]) for one in numbers.values()] for name in ("tip_error_max_mm", "coupling_max_n"))
    notes = [
        f"Largest error of the tip: {error[0]} mm with the pseudo-inverse, {error[1]} mm dynamically consistent.",
        f"The torques meant for the null space push the tip with up to {push[0]} N (pseudo-inverse), {push[1]} N (dynamically consistent).",
    ]
    subtitle = "planar arm of three joints: the null space swings in an attractive potential while the tip should stand still; above, half a swing (later is darker)"
    title = "Figures 1 and 2: null-space motion, and its effect on the tip"
    with page(path, title, subtitle, notes, [(3.6, 2), (2.2, 2), (2, 2)]) as (arms, below, angles):
        for number, run, name, colour, arm, axes in zip((1, 2), pair, names, colours, arms, angles):
            undistorted(arm, f"Figure {number}: {name}")
            postures(arm, run.seen(0, SWING_S, X, Y))
            far = MAGNIFIED * (run.p - run.p[0])
            arm.plot(*(run.p[0] + far)[np.abs(far).max(axis=1) < 1.5, :2].T, colour, lw=1, label=f"path of the tip, drawn {MAGNIFIED} × as large")
            arm.set_xlabel("m")
            legend(arm)
            curves(axes, f"Figure {number}: joint angles, °", t, *joints(run.q, (1, 2, 3)))
        for axes, heading, least, named in zip(below, ("error of the tip, mm", "force of the null space on the tip, N"), (1e-4, 1e-16), series):
            curves(axes, heading, t, *named).set(yscale="log", ylim=(least, 1e3))
    return numbers


def three_locks(path, runs):
    """Chang & Khatib 1995, Figure 3. Each lock with its ζ, the lines that fall together, and the hand's lost motion."""
    numbers, notes = {}, []
    title, subtitle = "Figure 3: the singularities of a PUMA 560, and the direction ζ that each takes", "postures of three runs where the arm is most singular; dashed: the lines that fall together"
    with page(path, title, subtitle, notes, [(3, 3)]) as (row,):
        for axes, (name, run) in zip(row, runs.items()):
            i, (cannot, line, why, in_paper) = np.argmin(np.abs(run.s(name))), LOCKS[name]
            zeta, s, t = run.zeta(name)[i], run.s(name)[i], run.t[i]
            kind = next(one.type for one in run.arm.singularities(run.q[i]) if one.name == name)
            undistorted(axes, f"{name} lock: cannot {cannot} ζ", hidden=True)
            _lock(axes, name, line, run.chain(i), run.R[i][:, 2], zeta)
            notes.append(f"{name} ({kind}): {why}; |s| = {digits(abs(s))} at {t:.2f} s of its run.")
            if kind != in_paper:
                notes.append(
                    f"The paper counts the {name} lock as {in_paper}. Here the type is computed: the shoulder's offset keeps the wrist's centre out of a "
                    f"cylinder around the waist's axis, so the centre can move along ζ on one side. Without the offset (puma560-ideal) the lock is {in_paper}, too."
                )
            numbers[name] = {"s": s, "t_s": t, "zeta": zeta, "type": kind, "type_in_the_paper": in_paper}
    return numbers


def _lock(axes, name, line, chain, forward, zeta):
    # An oblique view: from the side of the plane in which the arm reaches out, a little above.
    view = Rotation.from_euler("ZX", [np.arctan2(chain[-1][1], chain[-1][0]) + np.pi / 2 - 1.05, -0.4]).as_matrix()[:, [0, 2]]
    colour, shoulder, centre = SINGULARITIES[name], chain[2], chain[5]
    draw = lambda points, *style, **more: axes.plot(*(np.array(points) @ view).T, *style, **more)
    arrow = lambda start, end: axes.annotate("", end @ view, start @ view, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.6})
    for axis in (X, Y):
        draw([-0.25 * axis, 0.25 * axis], "--", color=GREY, alpha=0.5, lw=1)
    together = {
        "elbow": [shoulder, shoulder + 1.3 * (centre - shoulder)],
        "wrist": [centre - 0.3 * forward, centre + 0.35 * forward],
        "overhead": [0 * Z, (centre[2] + 0.25) * Z],
    }
    draw(together[name], "--", color=colour, lw=1.2, label=line)
    draw(chain, "-o", color=BLUE, lw=2.4, ms=4)
    draw([centre - 0.28 * zeta, centre + 0.28 * zeta], color=colour, label="ζ")
    if name == "wrist":
        side, turn = unit(np.cross(zeta, forward)), np.linspace(0.05, 0.8, 40) * 2 * np.pi
        arc = centre + 0.17 * (np.outer(np.cos(turn), side) + np.outer(np.sin(turn), np.cross(zeta, side)))
        draw(arc, color=colour)
        arrow(arc[2], arc[0]), arrow(arc[-3], arc[-1])
    else:
        arrow(centre, centre + 0.3 * zeta), arrow(centre, centre - 0.3 * zeta)
    legend(axes)


def two_locks(path, run):
    """Figure 4: elbow and wrist locked at once, moved along ζ of the elbow."""
    zeta = run.zeta("elbow")[0]  # stays the direction of the task
    t, horizontal, along, moved = run.t, run.outwards(unit(zeta * [1, 1, 0])), 1e3 * run.off @ zeta, 1e3 * (run.p - run.p[0]) @ zeta
    orthogonal = 1e3 * norm(run.off - np.outer(run.off @ zeta, zeta), axis=1)
    numbers = {
        "moved_mm": moved[-1], "along_max_mm": np.abs(along).max(), "orthogonal_max_mm": orthogonal.max(),
        "orientation_max_deg": run.error_deg.max(), "final_mm": run.error_mm[-1],
    }  # fmt: skip
    way_mm, along_mm, orthogonal_mm, turned_deg, final_mm = (digits(abs(value)) for value in numbers.values())
    notes = [
        f"Moved {way_mm} mm inwards along ζ; largest error along ζ {along_mm} mm, orthogonal to ζ {orthogonal_mm} mm, orientation {turned_deg}°; at the end {final_mm} mm."
    ]
    subtitle = "PUMA 560, stretched: the hand moves along the direction that the elbow has lost, all else held"
    with page(path, "Figure 4: elbow and wrist locked at once", subtitle, notes, [(2.7, 3), (2.3, 3)]) as ((arm, way, error), (turn, s, angles)):
        undistorted(arm, "from the side, m (later is darker)")
        postures(arm, run.seen(0, 2, horizontal))
        curves(way, "way of the hand along ζ, mm", t, ("true", moved, BLUE), ("wanted", moved + along, INK), dashed=["wanted"])
        curves(error, "position error, mm", t, ("along ζ", np.abs(along), RED), ("orthogonal to ζ", orthogonal, BLUE))
        curves(turn, "orientation error, °", t, ("", run.error_deg))
        inside = np.all([run.columns[f"singularity.inside.{name}"] > 0 for name in ("elbow", "wrist")], axis=0)
        s.axvspan(0, t[-1] if inside.all() else t[np.argmin(inside)], color=BLUE, alpha=0.09, lw=0, label="in both neighbourhoods")
        curves(s, "singularity measures", t, *((name, run.s(name), SINGULARITIES[name]) for name in ("elbow", "wrist")))
        curves(angles, "joint angles from the start, °", t, *joints(run.q - run.q[0], range(1, 7)), dashed=["$q_5$"])
    return numbers


def wrist_lock(path, run):
    """Figure 5: wrist lock, ζ turned by null-space motion, then a rotation about the direction that was lost."""
    t, zeta, pink = run.t, run.zeta("wrist"), SINGULARITIES["wrist"]
    change = t[np.argmax(norm(run.vectors("desired.angular_velocity"), axis=1) > 0)]
    # Seen along ζ at the start: the rotation that was impossible is in the plane of the page.
    up = unit(Z - zeta[0] * zeta[0, 2])
    turned = np.where(t <= change, np.degrees(np.arccos(np.clip(zeta @ zeta[0], -1, 1))), np.nan)
    rotated = np.degrees(run.turned @ zeta[0])
    moved = dict(zip((4, 5, 6), np.degrees(run.q[-1] - run.q[0])[3:]))
    numbers = {
        "zeta_turned_deg": np.nanmax(turned), "hand_turned_deg": rotated[-1] % 360, **{f"q{i}_moved_deg": value for i, value in moved.items()},
        "position_max_mm": run.error_mm.max(), "orientation_max_deg": run.error_deg.max(),
    }  # fmt: skip
    notes = [
        f"ζ turned by {numbers['zeta_turned_deg']:.2f}°; then the hand by {rotated[-1]:.2f}°. Moved: {', '.join(f'joint {i} by {value:.2f}°' for i, value in moved.items())}.",
        f"Largest errors: position {digits(numbers['position_max_mm'])} mm, orientation {digits(numbers['orientation_max_deg'])}°.",
    ]
    subtitle = "PUMA 560: joints 4 and 6 turn the singular direction ζ while the hand stands still; then the hand rotates about it"
    with page(path, "Figure 5: wrist lock", subtitle, notes, [(2.9, 3), (2.2, 2), (2, 2)]) as ((null, arm, turn), (angles, rates), errors):
        undistorted(null, "null motion, seen along axis 6", hidden=True)
        for vector, size, colour, name in ((zeta, 1.15, pink, "ζ (later is darker)"), (run.R[:, :, 0], 0.6, BLUE, "the hand's x axis")):
            postures(null, [np.outer([-size, size], vector[i] @ run.R[0][:, :2]) for i in run.moments(0, change)], colour)
            null.plot([], [], colour, label=name)
        legend(null)
        undistorted(arm, "the hand turns, along the old ζ, m")
        postures(arm, run.seen(change, np.inf, run.outwards(np.cross(up, zeta[0])), up))
        turn.axvspan(0, change, color=BLUE, alpha=0.09, lw=0, label="turning ζ")
        curves(turn, "turns, °", t, ("ζ", turned, pink), ("hand about ζ as it was", rotated, BLUE))
        curves(angles, "wrist joints from the start, °", t, *joints(run.q - run.q[0], moved))
        curves(rates, "wrist joint rates, °/s", t, *joints(run.vectors("joint.qdot"), moved))
        for axes, heading, values in zip(errors, ("position error, mm", "orientation error, °"), (run.error_mm, run.error_deg)):
            curves(axes, heading, t, ("", values, RED))
    return numbers
