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
    arm, random = incidents.Arm(*incidents.built_in(name)), np.random.default_rng(3)
    return [incidents.draw_singular(arm, random, np.pi, 0.05, 0, 0, steps=40, floor=1e-6) for _ in range(100)]


def singular(arm, count, random):
    """Singular postures, (count, n), rad: the first and the last joint make no difference to that, and are random."""
    q, ends = np.resize(locks(arm.name), (count, arm.dof)), [0, -1]
    q[:, ends] = random.uniform(np.maximum(arm.lower, -np.pi)[ends], np.minimum(arm.upper, np.pi)[ends], (count, 2))
    return q


def timed(function, *arguments, **named):
    """What a function returns, and how long it takes, s."""
    begin = time.perf_counter()
    return function(*arguments, **named), time.perf_counter() - begin


def step(name, count=100_000):
    arm = armplane.Arm.builtin(name)
    law, q = armplane.Law(arm), np.array(next(iter(arm.postures.values())))
    given = q, np.zeros(arm.dof), arm.at(q).pose, np.array([0.01, 0, 0, 0, 0, 0.01])
    law.step(*given)
    out = np.zeros(arm.dof)
    times = [timed(law.step, *given, out=out)[1] for _ in range(count)]
    p50, p99, p999, most = 1e6 * np.quantile(times, [0.5, 0.99, 0.999, 1])
    print(f"Law.step {name}: p50 {p50:.1f} µs, p99 {p99:.1f} µs, p99.9 {p999:.1f} µs, max {most:.0f} µs over {count} calls ({law.state.reason})")


def arms(name, count):
    arm = armplane.Arm.builtin(name)
    found, seconds = timed(arm.step_many, singular(arm, count, np.random.default_rng(1)))
    places = found["singularities"]
    bad = sum(np.count_nonzero(~np.isfinite(values)) for values in (found["det"], found["manipulability"], places["s"], places["zeta_B"]))
    inside = (places["inside"] != 0).any(axis=1).mean()
    print(f"Arm.step_many {name}: {count} states in {seconds:.2f} s, {1e6 * seconds / count:.2f} µs each, {bad} NaN, {inside:.1%} inside a neighbourhood")


def laws(name, count, batch=10_000, ticks=3):
    """Laws that begin in singular postures and are asked to move on at random: `ticks` ticks of each."""
    arm, random = armplane.Arm.builtin(name), np.random.default_rng(2)
    law, bad, over, refused, times = armplane.Law(arm), 0, 0, 0, []
    for _ in range(count // batch):
        q, twist = singular(arm, batch, random), random.normal(0, 0.3, (batch, 6))
        law.reset()
        torques, seconds = zip(*(timed(law.step_many, q, 0 * q, twist=twist) for _ in range(ticks)))
        times.append(seconds)
        bad += np.count_nonzero(~np.isfinite(torques))
        over += np.count_nonzero(np.abs(torques) > arm.effort)
        refused += law.refused.sum()
    print(
        f"Law.step_many {name}: {count} singular states, {ticks} ticks each, in {np.sum(times):.1f} s: {bad} NaN, {over} torques over the limit, "
        f"{refused} refused; {1e6 * np.mean(times, axis=0)[1:].mean() / batch:.2f} µs a tick once begun; "
        f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000:.0f} MB at most"
    )


if __name__ == "__main__":
    for name in ("ur5", "puma560", "iiwa14", "panda"):
        step(name)
    for name in ("puma560", "iiwa14", "panda"):
        count = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
        arms(name, count)
        laws(name, count)
