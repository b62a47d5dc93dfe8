#!/usr/bin/env python3
"""Straight wipes with 10 N through the exact locks of arms.

    pip install armplane numpy
    python3 tests/wipes.py [--arms puma560,ur5,panda,xarm7] [--each 2] [--seed 1] [--program target/release/armplane] [--set KEY=VALUE ...]

Each wipe is a line that `armplane.lines` draws through a singular posture, at a mean speed of 0.1 m/s, pressed at a random right angle to the line on a plane
that the hand touches at the start. It runs without and with the force. Prints a row for each wipe and, at the end, how many lines reach their goal without
a force, and how many of these with it, within 0.5 N (root mean square), 0.5 mm across the force, and without lift-off. Exit code 1: a wipe failed in silence
(exit code 0 with more than 1 N, or without contact).
"""

import argparse
import json
import pathlib
import subprocess
import sys
import tempfile
import tomllib

import armplane
import numpy as np

PLANE = """
[[plant.surface]]
point_m = {point}
normal = {normal}
"""


def run(program, folder, text, settings):
    """The run's exit code and summary; None where it was refused."""
    (folder / "wipe.toml").write_text(text)
    told = [word for setting in settings for word in ("--set", setting)]
    done = subprocess.run([program, "run", "wipe.toml", "--json", *told], cwd=folder, capture_output=True, text=True)
    return done.returncode, json.loads(done.stdout) if done.stdout.strip() else None


def pressed(text, random):
    """The line's scenario with a force across it."""
    task = tomllib.loads(text)
    start = np.array(armplane.Arm.builtin(task["robot"]).at(task["start"]["q"]).pose)[:3, 3]
    along = np.array(task["segment"][0]["to_m"]) - start
    e = np.cross(along, random.normal(size=3))
    e /= np.linalg.norm(e)
    axis = " ".join(map(repr, map(float, e)))
    plane = PLANE.format(point=start.tolist(), normal=(-e).tolist())
    return text.replace("duration_s = ", f'force = {{ axis = "{axis}", newtons = 10 }}\nduration_s = ', 1) + plane


def is_met(summary):
    force = summary["task"]["force"]
    return force["rms_n"] <= 0.5 and force["tangential_max_mm"] <= 0.5 and force["lift_off_ticks"] == 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", default="puma560,ur5,panda,xarm7")
    parser.add_argument("--each", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--program", default="target/release/armplane", type=lambda path: str(pathlib.Path(path).resolve()))
    parser.add_argument("--set", action="append", default=[])
    asked = parser.parse_args()
    counts = {"wipes": 0, "reached without a force": 0, "of these reached with it": 0, "of these within the bars": 0, "silent": 0}
    for name in asked.arms.split(","):
        random = np.random.default_rng(asked.seed)
        for line in armplane.lines(name, asked.each, asked.seed, speed=0.1875):
            with tempfile.TemporaryDirectory() as folder:
                free = [setting for setting in asked.set if not setting.startswith("plant.surface")]
                code, _ = run(asked.program, pathlib.Path(folder), line["scenario"], free)
                code_pressed, summary = run(asked.program, pathlib.Path(folder), pressed(line["scenario"], random), asked.set)
            force = summary and summary["task"].get("force")
            counts["wipes"] += 1
            counts["reached without a force"] += code == 0
            counts["of these reached with it"] += code == code_pressed == 0
            counts["of these within the bars"] += code == code_pressed == 0 and is_met(summary)
            counts["silent"] += code_pressed == 0 and (not force or force["rms_n"] > 1.0 or force["lift_off_ticks"] > 0)
            keys = ("rms_n", "error_max_n", "lift_off_ticks", "impact_max_n", "tangential_max_mm", "borne_max")
            numbers = " ".join(f"{key} {force[key]:.3g}" for key in keys) if force else "no force"
            outcome = summary["outcome"] if summary else "refused"
            print(f"{name} {line['singularities']} {line['place']}: {code} {code_pressed} {outcome}: {numbers}", flush=True)
    print("; ".join(f"{count} {what}" for what, count in counts.items()))
    sys.exit(counts["silent"] > 0)


if __name__ == "__main__":
    main()
