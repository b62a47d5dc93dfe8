#!/usr/bin/env python3
"""Circles, spirals, eights and random splines through the singular postures of arms, beside an independent search.

    pip install mujoco 'armplane[autopsy,experiments]'
    python3 tests/paths.py [--arms puma560,ur5,panda] [--kinds circle,spiral,eight,spline] [--each 6] [--seed 1] [--keep ROWS.json]

Each path leads through a posture in which the Jacobian loses rank, found along the slope of its smallest singular value. The independent search follows
the path by damped least squares on MuJoCo's kinematics, from the same start; where it succeeds within 1 mm and 0.5° and the joint limits, the path is feasible.
Prints, for each arm and kind, how many paths there are, were found feasible, reached the goal, met S1, were refused, and missed in silence (a goal that counts
as reached with an error above 1 mm). Exit code 1: a silent miss, or S1 on less than 95 % of the paths found feasible.
"""

import itertools
import pathlib
import sys

import armplane
import numpy as np
import pandas
from asked import asked
from numpy.linalg import norm
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

sys.path.append(str(pathlib.Path(__file__).resolve().parents[1] / "python/tests"))
import incidents

SPEEDS = (8, 4, 2)
SAMPLES = 800


class Arm(incidents.Arm):
    """A built-in arm in MuJoCo."""

    def __init__(self, name):
        super().__init__(*incidents.built_in(name))
        self.lower, self.upper = self.lower.clip(-6.28), self.upper.clip(max=6.28)

    def follow(self, q, poses):
        """Postures along poses by damped least squares, or None where they leave them or the limits."""
        for damping in (1e-3, 1e-2, 3e-2):
            at, found = q.copy(), [q]
            for p_d, R_d in poses:
                for _ in range(60):
                    p, R = self.pose(at)
                    e = np.r_[p_d - p, Rotation.from_matrix(R_d @ R.T).as_rotvec()]
                    if np.abs(e / self.scale).max() < 1e-6:
                        break
                    at = at + self.damped(at, e, damping)
                far = norm(e[:3]) > 9e-4 or norm(e[3:]) > 7e-3
                if far or not self.is_inside(at, 2e-3) or np.abs(at - found[-1]).max() > 0.25:
                    break
                found.append(at.copy())
            else:
                return found
        return None


def unit(v):
    return v / norm(v)


def way(kind, arm, q, random):
    """Poses over s from 0 to 1 with the singular posture's within, and the segment's keys, given the time; None where no start is found."""
    p, R = arm.pose(q)
    normal = unit(random.normal(size=3))
    along = unit(np.cross(normal, random.normal(size=3)))
    inward, size = np.cross(normal, along), random.uniform(0.03, 0.08)
    turns, grow = {"circle": (1.0, 0.0), "spiral": (1.5, 0.5 * size)}.get(kind, (0.0, 0.0))
    centre = p + inward * (size + 0.5 * grow)
    if kind == "spline":
        nodes = [q + random.uniform(-0.35, 0.35, len(q)) for _ in range(4)]
        nodes.insert(2, q)
        poses = [arm.pose(np.clip(node, arm.lower + 0.02, arm.upper - 0.02)) for node in nodes]
        knots = [np.r_[p_n, Rotation.from_matrix(R_n @ R.T).as_rotvec()] for p_n, R_n in poses]
        curve = CubicSpline(np.linspace(0, 1, len(nodes)), knots)
        at = lambda s: (curve(s)[:3], Rotation.from_rotvec(curve(s)[3:]).as_matrix() @ R)
    elif kind == "eight":
        # Crosses itself in the singular posture.
        at = lambda s: (p + size * (along * np.sin(2 * np.pi * s) + 0.5 * inward * np.sin(4 * np.pi * s)), R)
    else:

        def at(s):
            # The middle of the way is in the singular posture.
            angle = 2 * np.pi * turns * (s - 0.5)
            return centre + (size + grow * s) * (along * np.sin(angle) - inward * np.cos(angle)), R

    back = arm.follow(q, [at(s) for s in np.linspace(0.5, 0, SAMPLES // 2)] if kind != "eight" else [at(0)])
    # A path begins where the hand is.
    if back is None or norm(arm.pose(back[-1])[0] - at(0)[0]) > 1e-5:
        return None

    def keys(time):
        if turns:
            arc = f'centre_m = {centre.tolist()}, about = "{normal[0]} {normal[1]} {normal[2]}", by_deg = {360 * turns}, grow_m = {grow}'
            return f"arc = {{ {arc} }}\nduration_s = {time}\nramp_s = {0.2 * time}"
        rows = ["t,x,y,z,qx,qy,qz,qw"]
        for x in np.linspace(0, 1, int(100 * time) + 1):
            p_x, R_x = at(incidents.quintic(x)[0])
            rows.append(",".join(f"{v:.7f}" for v in [x * time, *p_x, *Rotation.from_matrix(R_x).as_quat()]))
        text = "\n".join(rows)
        return f'table = {{ rows = """\n{text}""" }}'

    return back[-1], [at(s) for s in np.linspace(0, 1, SAMPLES)], keys


def trial(name, arm, time, start, keys):
    q = ", ".join(f"{x:.12f}" for x in start)
    text = f'name = "{name}"\nrobot = "{arm}"\n[start]\nq = [{q}]\n[[segment]]\n{keys(time)}\n[plant]\nfloor_m = "none"\n'
    try:
        row = armplane.trial(text)
    except ValueError as error:
        row = {"outcome": "refused", "reason": str(error), "s1": False}
    reached = row["outcome"] == "goal reached"
    outcome = "reached" if reached else "refused" if row.get("ticks", 0) < 50 else row["outcome"]
    silent = reached and not row["position_max_mm"] < 1 + row["along_max_mm"]
    return {"scenario": text, "outcome": outcome, "why": row["reason"], "s1": row.get("s1", False), "stretch": row.get("time_stretch"), "silent": silent}


def main():
    args = asked(__doc__, arms="puma560,ur5,panda", kinds="circle,spiral,eight,spline", each=6, seed=1, keep="/dev/null")
    every = []
    for name, kind in itertools.product(args.arms.split(","), args.kinds.split(",")):
        arm, random = Arm(name), np.random.default_rng([args.seed, *name.encode(), *kind.encode()])
        for k in range(args.each):
            made = []
            while not made:
                # A way through a stretched arm is often out of reach: some are tried for each posture.
                q = incidents.draw_singular(arm, random, 6.28, 0.15, 0.05, 0.15, steps=40, floor=1e-5)
                made = [found for _ in range(8) if (found := way(kind, arm, q, random))]
            found = next((one for one in made if arm.follow(*one[:2]) is not None), None)
            start, _, keys = found or made[-1]
            for time in SPEEDS:
                path = f"{name}-{kind}-{k}-{time:g}s"
                every.append({"arm": name, "kind": kind, "path": path, "feasible": found is not None, **trial(path, name, time, start, keys)})
                print(".", end="", flush=True)
    table = pandas.DataFrame(every)
    table.to_json(args.keep, orient="records", indent=1)
    reached, refused = (table.outcome == outcome for outcome in ("reached", "refused"))
    counted = table.assign(paths=1, reached=reached, refused=refused).groupby(["arm", "kind"])["paths feasible reached s1 refused silent".split()].sum()
    print(f"\n{counted.assign(median_stretch=table.stretch.where(reached).groupby([table.arm, table.kind]).median())}")
    for row in table[table.silent | table.feasible & ~table.s1].itertuples():
        print(f"  {row.path}: {row.outcome}: {row.why}")
    share, silent = table.s1[table.feasible].mean(), table.silent.sum()
    print(f"S1 on {share:.1%} of {table.feasible.sum()} paths found feasible; {silent} silent")
    sys.exit(bool(silent or not share >= 0.95))


if __name__ == "__main__":
    main()
