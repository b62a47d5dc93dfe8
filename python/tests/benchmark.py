"""Measures the package as it is installed: `python benchmark.py [COUNT]`, COUNT singular states of each arm (10,000 by default). docs/python.md has the
numbers. Needs the packages of incidents.py.
"""

import functools
import resource
import sys
import time

import armplane
import incidents
import numpy as np


@functools.cache
def locks(name):
    """A hundred random postures within the limits in which the arm is singular."""
    arm, random, found = incidents.Arm(*incidents.built_in(name)), np.random.default_rng(3), []
    while len(found) < 100:
        q = arm.singular_near(incidents.draw(arm, random, np.pi, 0.05), floor=1e-6)
        if q is not None and arm.is_inside(q, 0):
            found.append(q)
    return found


def singular(arm, count, random):
    """Singular postures, (count, n), rad: the first and the last joint make no difference to that, and are random."""
    q, ends = np.resize(locks(arm.name), (count, arm.dof)), [0, -1]
    q[:, ends] = random.uniform(np.maximum(arm.lower, -np.pi)[ends], np.minimum(arm.upper, np.pi)[ends], (count, 2))
    return q


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
    law, (bad, over, refused, seconds, stepping) = armplane.Law(arm), (0, 0, 0, 0, 0)
    for _ in range(count // batch):
        q, qdot = singular(arm, batch, random), np.zeros((batch, arm.dof))
        twist = random.normal(0, 0.3, (batch, 6))
        law.reset()
        for tick in range(ticks):
            begin = time.perf_counter()
            tau = law.step_many(q, qdot, twist=twist)
            seconds += time.perf_counter() - begin
            stepping += time.perf_counter() - begin if tick else 0
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
    for name in ("puma560", "iiwa14", "panda"):
        count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
        arms(name, count)
        laws(name, count)
