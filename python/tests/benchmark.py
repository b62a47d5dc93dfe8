"""Measures the package as it is installed: `python benchmark.py [COUNT]`, COUNT calls of `Law.step` for each arm (100,000 by default). docs/python.md has the numbers."""

import sys
import time

import armplane
import numpy as np


def step(name, count):
    arm = armplane.Arm.builtin(name)
    law, q = armplane.Law(arm), np.array(next(iter(arm.postures.values())))
    given = q, np.zeros(arm.dof), arm.at(q).pose, np.array([0.01, 0, 0, 0, 0, 0.01])
    law.step(*given)
    out, times = np.zeros(arm.dof), np.zeros(count)
    for k in range(count):
        begin = time.perf_counter()
        law.step(*given, out=out)
        times[k] = time.perf_counter() - begin
    p50, p99, p999, most = 1e6 * np.quantile(times, [0.5, 0.99, 0.999, 1])
    print(f"Law.step {name}: p50 {p50:.1f} µs, p99 {p99:.1f} µs, p99.9 {p999:.1f} µs, max {most:.0f} µs over {count} calls ({law.state.reason})")


if __name__ == "__main__":
    for name in ("ur5", "puma560", "iiwa14", "panda"):
        step(name, int(sys.argv[1]) if len(sys.argv) > 1 else 100_000)
