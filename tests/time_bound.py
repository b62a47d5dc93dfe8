#!/usr/bin/env python3
"""How long runs through singular postures take, over the bound that toppra gives for the same joint path under the same limits.

    pip install toppra 'armplane[experiments]'
    python3 tests/time_bound.py [--robots puma560,ur5,panda,iiwa14] [--count 3] [--seed 1] [--speed 0.28]

The joint path is the one that the plant went, over the clock u of its route. toppra may stretch u by up to the given clock (u̇ ≤ 1) where a joint keeps 92 %
of its speed and 95 % of its torque, which are the margins of the plan. Prints a line for each run that reached its goal: the time taken, the bound, their
ratio; then the median and the largest ratio. Exit code 1: the median is above 1.02, or the largest above 1.10.
"""

import sys
import tomllib

import armplane
import numpy as np
import toppra
from asked import asked
from toppra import algorithm, constraint

SPEED, TORQUE, POINTS = 0.92, 0.95, 200


def run(scenario):
    """The row of a run, the clock of its route, s, and the joint path over it."""
    row, table = armplane.trial(scenario), armplane.trace(scenario).to_pandas()
    # The columns of the joints are in their order.
    return row, np.append(0, np.cumsum(table["control.scale.time"][:-1])) * 1e-3, table.filter(like="joint.q.").to_numpy()


def bound(arm, u, q):
    """The least time for a joint path, s."""
    # One coordinate more is the clock itself.
    path = toppra.SplineInterpolator(u, np.column_stack([q, u]))
    speeds = np.append(np.minimum(SPEED * arm.velocity, 1e3), 1)
    holding = np.append(TORQUE * np.asarray(arm.effort), 1e9)

    def torque(q, qdot, qddot):
        posture = arm.at(q[:-1], qdot[:-1])
        return np.append(posture.A @ qddot[:-1] + posture.bias, 0)

    limits = [
        constraint.JointVelocityConstraint(np.column_stack([-speeds, speeds])),
        constraint.JointTorqueConstraint(torque, np.column_stack([-holding, holding]), np.zeros(len(holding)), constraint.DiscretizationType.Collocation),
    ]
    solver = algorithm.TOPPRA(limits, path, gridpoints=np.linspace(u[0], u[-1], 2 * POINTS), solver_wrapper="seidel")
    for ends in (1, 0.8, 0.5, 0.2, 0):
        _, rates, _ = solver.compute_parameterization(ends, ends)
        if rates is not None and np.isfinite(rates).all():
            return float(np.sum(2 * np.diff(solver.gridpoints) / np.maximum(rates[1:] + rates[:-1], 1e-6)))
    return None


def main():
    options = asked(__doc__, robots="puma560,ur5,panda,iiwa14", count=3, seed=1, speed=0.28)
    toppra.setup_logging("ERROR")
    ratios = []
    for robot in options.robots.split(","):
        for number, line in enumerate(armplane.lines(robot, options.count, options.seed, speed=options.speed), 1):
            name, (row, u, q) = f"{robot}-{number}", run(line["scenario"])
            if not row.get("s1"):
                print(f"{name:16} {row['outcome']}")
                continue
            # The path's own end, whatever settles after it.
            legs = sum(leg["duration_s"] for leg in tomllib.loads(line["scenario"])["segment"])
            taken = row["time_stretch"] * legs
            grid = np.linspace(0.0, u[min(round(taken * 1e3), len(u) - 1)], POINTS)
            least = bound(armplane.Arm.builtin(robot), grid, np.stack([np.interp(grid, u, column) for column in q.T], axis=1))
            if least is None:
                print(f"{name:16} toppra finds no bound")
                continue
            ratios.append(taken / least)
            print(f"{name:16} {taken:7.3f} s  bound {least:7.3f} s  ratio {ratios[-1]:.3f}  of the given clock {taken / legs:.3f}")
    if not ratios:
        sys.exit("no run reached its goal")
    median, most = np.median(ratios), max(ratios)
    print(f"{len(ratios)} runs: median {median:.3f}, largest {most:.3f}")
    sys.exit(bool(median > 1.02 or most > 1.10))


if __name__ == "__main__":
    main()
