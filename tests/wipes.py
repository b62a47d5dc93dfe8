#!/usr/bin/env python3
"""Straight wipes with 10 N through the exact locks of arms, by one law or several.

    python3 tests/wipes.py [--arms puma560,ur5,panda,xarm7] [--each 2] [--seed 1] [--set KEY=VALUE ...] [--law NAME[=FILE.py] ...] [--plant mujoco]

`--each 17` is 204 wipes, and takes about six minutes. A law is one of armplane's (`blended` is ours), or an opponent of the arena by name or file.

Each wipe is a line that `armplane.lines` draws through a singular posture, at a mean speed of 0.1 m/s, pressed at a random right angle to the line on a plane
that the hand touches at the start. It runs without a force under our law, and with the force under each law. Prints a row for each wipe and law and, at the
end, for each law how many lines reach their goal without a force, and how many of these with it, within 0.5 N (root mean square), 0.5 mm across the force,
and without lift-off; the same of the wipes with at most 0.7 of the force's axis lost; how many lift off; median and worst. At a boundary of reach a hand that
presses on a plane of 20 N/mm with more of it lost leaves its path by more than 0.5 mm. Exit code 1: our law failed in silence (a goal counts as reached with
more than 1 N, or without contact).
"""

import json
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

import armplane
import numpy as np
import pandas
from asked import asked
from armplane.arena import OPPONENTS
from armplane.results import _program, _sentence

MEASURES = "rms_n error_max_n lift_off_ticks impact_max_n tangential_max_mm borne_max".split()
OURS, MOSTLY = "blended", 0.7


def run(scenario, law, settings, plant=""):
    """The row of a run, refused ones too."""
    name, _, file = law.partition("=")
    file = file or OPPONENTS.get(name, "")
    with tempfile.TemporaryDirectory() as folder:
        task = Path(folder, "wipe.toml")
        task.write_text(scenario)
        more = [*(["--plant", plant] if plant else []), *(f"--set={key}={value}" for key, value in settings.items())]
        command = [_program(), "compare", task, "--law", f"{name}={file}" if file else law, *more, "--out", f"{folder}/out", "--json"]
        done = subprocess.run(command, capture_output=True, text=True)
    return {"outcome": f"refused: {_sentence(done.stderr)}"} if done.returncode else json.loads(done.stdout)["scenarios"][0]["laws"][0]


def reached(row):
    """Whether a goal counts as reached."""
    return row["outcome"] in ("goal reached", "followed to the boundary")


def pressed(text, random):
    """The line's scenario with a force across it."""
    task = tomllib.loads(text)
    start = armplane.Arm.builtin(task["robot"]).at(task["start"]["q"]).pose[:3, 3]
    e = np.cross(task["segment"][0]["to_m"] - start, random.normal(size=3))
    e /= np.linalg.norm(e)
    force = f'force = {{ axis = "{" ".join(map(repr, e.tolist()))}", newtons = 10 }}\n'
    return f"{text.replace('duration_s = ', force + 'duration_s = ', 1)}\n[[plant.surface]]\npoint_m = {start.tolist()}\nnormal = {(-e).tolist()}\n"


def wipes(options, settings):
    """A row for each wipe and law."""
    bare = {key: value for key, value in settings.items() if not key.startswith("plant.surface")}
    for name in options.arms.split(","):
        random = np.random.default_rng(options.seed)
        for line in armplane.lines(name, options.each, options.seed, speed=0.1875):
            scenario, is_free = pressed(line["scenario"], random), reached(run(line["scenario"], OURS, bare))
            for law in options.law or [OURS]:
                row = run(scenario, law, settings, options.plant)
                force = {key: (row.get("force") or {}).get(key, np.inf) for key in MEASURES}
                print(f"{law}: {name} {line['singularities']} {line['place']}: {row['outcome']}: {' '.join(f'{key} {force[key]:.3g}' for key in MEASURES)}", flush=True)
                yield {"law": law, "free": is_free, "reached": reached(row), **force}


def main():
    options = asked(__doc__, arms="puma560,ur5,panda,xarm7", each=2, seed=1, set=[], law=[], plant="")
    table = pandas.DataFrame(wipes(options, dict(one.split("=", 1) for one in options.set)))
    table["lifted"] = table.lift_off_ticks > 0
    table["met"] = table.reached & (table.rms_n <= 0.5) & (table.tangential_max_mm <= 0.5) & ~table.lifted
    table["silent"] = table.reached & ((table.rms_n > 1) | table.lifted)
    for law, rows in table.groupby("law", sort=False):
        free = rows[rows.free]
        held = free[free.borne_max <= MOSTLY]
        print(f"{law}: {len(rows)} wipes; {len(free)} reach their goal without a force; {free.reached.sum()} of these with it; {free.met.sum()} of these within "
              f"the bars; {rows.silent.sum()} silent; {rows.lifted.sum()} lift off; with at most {MOSTLY} of the axis lost: {held.met.sum()} of {len(held)} within the bars")  # fmt: skip
        print(rows[MEASURES].agg(["median", "max"]).to_string(float_format=lambda x: f"{x:.2g}"))
    sys.exit(bool(table.silent[table.law == OURS].any()))


if __name__ == "__main__":
    main()
