"""Measures the package as it is installed: `python benchmark.py [COUNT]`, COUNT singular states of each arm (10,000 by default). docs/python.md has the
numbers.
"""

import resource
import sys
import time

import armplane
import numpy as np
from scipy.optimize import minimize_scalar

HALF = np.pi / 2
# Joints at these values make the arm singular; with a joint named after them, together with that joint at a value that depends on the others.
SINGULAR = {
    "puma560": [{4: 0.0}],
    "panda": [({4: HALF}, 5), ({4: -HALF}, 5), ({1: 0.0}, 2), ({1: 0.0}, 3)],
    "iiwa14": [{3: 0.0}, {5: 0.0, 4: HALF}, {1: 0.0, 2: HALF}, {3: 0.0, 5: 0.0}, {1: 0.0, 2: -HALF, 5: 0.0, 4: HALF}, {1: 0.0, 3: 0.0, 5: 0.0}],
}


def singular(arm, count, random):
    """Random postures within the limits, in each of which the joints of one case of `SINGULAR` make the arm singular; (count, n), rad."""
    q = random.uniform(np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi), (count, arm.dof))
    cases = SINGULAR[arm.name]
    for case, joints in enumerate(cases):
        rows = slice(case, None, len(cases))
        if isinstance(joints, dict):
            for joint, value in joints.items():
                q[rows, joint] = value
        else:
            # The first and the last joint make no difference to it, so a hundred postures of the others do.
            locks = [lock for lock in (locked(arm, posture, *joints) for posture in q[rows][:200].copy()) if lock is not None][:100]
            q[rows, 1:-1] = np.array(locks)[np.arange(len(q[rows])) % len(locks), 1:-1]
    return q


def locked(arm, q, joints, last):
    """The posture `q` with those joints at their values, and the joint `last` where the arm is singular; None where it nowhere is."""
    for joint, value in joints.items():
        q[joint] = value

    def smallest(angle):
        q[last] = angle
        return np.linalg.svd(arm.at(q).J, compute_uv=False)[-1]

    grid = np.linspace(arm.lower[last], arm.upper[last], 100)
    place = int(np.clip(np.argmin([smallest(angle) for angle in grid]), 1, 98))
    found = minimize_scalar(smallest, bounds=grid[[place - 1, place + 1]], method="bounded", options={"xatol": 1e-11})
    q[last] = found.x
    return q if found.fun < 1e-9 else None


def step(name, count=100_000):
    arm = armplane.Arm.builtin(name)
    law, q = armplane.Law(arm), np.array(next(iter(arm.postures.values())))
    qdot, pose, twist, out = np.zeros(arm.dof), arm.at(q).pose, np.array([0.01, 0, 0, 0, 0, 0.01]), np.zeros(arm.dof)
    law.step(q, qdot, pose, twist, out=out)
    times = np.empty(count)
    for i in range(count):
        begin = time.perf_counter()
        law.step(q, qdot, pose, twist, out=out)
        times[i] = time.perf_counter() - begin
    at = lambda share: 1e6 * np.quantile(times, share)
    print(f"Law.step {name}: p50 {at(0.5):.1f} µs, p99 {at(0.99):.1f} µs, p99.9 {at(0.999):.1f} µs, max {at(1.0):.0f} µs over {count} calls ({law.state.reason})")


def arms(name, count):
    arm, random = armplane.Arm.builtin(name), np.random.default_rng(1)
    q = singular(arm, count, random)
    begin = time.perf_counter()
    found = arm.step_many(q)
    seconds = time.perf_counter() - begin
    places = found["singularities"]
    bad = sum(int((~np.isfinite(values)).sum()) for values in (found["det"], found["manipulability"], places["s"], places["zeta_B"]))
    inside = (places["inside"] != 0).any(axis=1).mean()
    print(f"Arm.step_many {name}: {count} states in {seconds:.2f} s, {1e6 * seconds / count:.2f} µs each, {bad} NaN, {inside:.1%} inside a neighbourhood")


def laws(name, count, batch=10_000, ticks=3):
    """Laws that begin in singular postures and are asked to move on at random: `ticks` ticks of each."""
    arm, random = armplane.Arm.builtin(name), np.random.default_rng(2)
    law, (bad, over, refused, seconds, stepping) = armplane.Law(arm), (0, 0, 0, 0.0, 0.0)
    for _ in range(count // batch):
        q, qdot = singular(arm, batch, random), np.zeros((batch, arm.dof))
        twist = random.normal(0, 0.3, (batch, 6))
        law.reset()
        for tick in range(ticks):
            begin = time.perf_counter()
            tau = law.step_many(q, qdot, twist=twist)
            seconds += time.perf_counter() - begin
            stepping += time.perf_counter() - begin if tick else 0.0
            bad += int((~np.isfinite(tau)).sum())
            over += int((np.abs(tau) > arm.effort).sum())
        refused += int(law.refused.sum())
    print(
        f"Law.step_many {name}: {count} singular states, {ticks} ticks each, in {seconds:.1f} s: {bad} NaN, {over} torques over the limit, "
        f"{refused} refused; {1e6 * stepping / count / (ticks - 1):.2f} µs a tick once begun; "
        f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000:.0f} MB at most"
    )


if __name__ == "__main__":
    for name in ("ur5", "puma560", "iiwa14", "panda"):
        step(name)
    for name in SINGULAR:
        count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
        arms(name, count)
        laws(name, count)
