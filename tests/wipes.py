#!/usr/bin/env python3
"""Straight wipes with 10 N through the exact locks of arms.

    python3 tests/wipes.py [--arms puma560,ur5,panda,xarm7] [--each 2] [--seed 1] [--set KEY=VALUE ...]

`--each 17` is 204 wipes, and takes about five minutes.

Each wipe is a line that `armplane.lines` draws through a singular posture, at a mean speed of 0.1 m/s, pressed at a random right angle to the line on a plane
that the hand touches at the start. It runs without and with the force. Prints a row for each wipe and, at the end, how many lines reach their goal without
a force, and how many of these with it, within 0.5 N (root mean square), 0.5 mm across the force, and without lift-off; the same of the wipes with at most 0.7
of the force's axis lost. At a boundary of reach a hand that presses on a plane of 20 N/mm with more of it lost leaves its path by more than 0.5 mm. Exit code
1: a wipe failed in silence (a goal counts as reached with more than 1 N, or without contact).
"""

import argparse
import collections
import sys
import tomllib

import armplane
import numpy as np

KEYS = "rms_n error_max_n lift_off_ticks impact_max_n tangential_max_mm borne_max".split()
NONE = dict.fromkeys(KEYS, np.inf)
MOSTLY = 0.7


def run(scenario, settings):
    """The row of a run, refused ones too, and whether its goal counts as reached."""
    try:
        row = armplane.trial(scenario, settings)
    except ValueError as error:
        row = {"outcome": f"refused: {error}"}
    return row, row["outcome"] in ("goal reached", "followed to the boundary")


def pressed(text, random):
    """The line's scenario with a force across it."""
    task = tomllib.loads(text)
    start = armplane.Arm.builtin(task["robot"]).at(task["start"]["q"]).pose[:3, 3]
    e = np.cross(task["segment"][0]["to_m"] - start, random.normal(size=3))
    e /= np.linalg.norm(e)
    force = f'force = {{ axis = "{" ".join(map(repr, e.tolist()))}", newtons = 10 }}\n'
    return f"{text.replace('duration_s = ', force + 'duration_s = ', 1)}\n[[plant.surface]]\npoint_m = {start.tolist()}\nnormal = {(-e).tolist()}\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", default="puma560,ur5,panda,xarm7")
    parser.add_argument("--each", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--set", action="append", default=[])
    asked = parser.parse_args()
    settings, counts = dict(one.split("=", 1) for one in asked.set), collections.Counter()
    for name in asked.arms.split(","):
        random = np.random.default_rng(asked.seed)
        for line in armplane.lines(name, asked.each, asked.seed, speed=0.1875):
            _, is_free = run(line["scenario"], {key: value for key, value in settings.items() if not key.startswith("plant.surface")})
            row, is_reached = run(pressed(line["scenario"], random), settings)
            force, both = row.get("force") or NONE, is_free and is_reached
            is_met = force["rms_n"] <= 0.5 and force["tangential_max_mm"] <= 0.5 and force["lift_off_ticks"] == 0
            is_silent = is_reached and (force["rms_n"] > 1 or force["lift_off_ticks"] > 0)
            is_held = is_free and force["borne_max"] <= MOSTLY
            counts.update(wipes=1, free=is_free, reached=both, met=both and is_met, silent=is_silent, held=is_held, kept=is_held and both and is_met)
            print(f"{name} {line['singularities']} {line['place']}: {row['outcome']}: {' '.join(f'{key} {force[key]:.3g}' for key in KEYS)}", flush=True)
    print("{wipes} wipes; {free} reach their goal without a force; {reached} of these with it; {met} of these within the bars; {silent} silent".format_map(counts))
    print(f"with at most {MOSTLY} of the axis lost: {counts['kept']} of {counts['held']} within the bars")
    sys.exit(counts["silent"] > 0)


if __name__ == "__main__":
    main()
