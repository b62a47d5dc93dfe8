#!/usr/bin/env python3
"""The wipes of `wipes.py` under several laws.

    python3 tests/wipes_beside.py --law NAME[=FILE.py] ... [--arms puma560,ur5,panda,xarm7] [--each 1] [--seed 1] [--plant mujoco]

A law is one of armplane's (`blended` is ours), or an opponent of the arena by name or file. Prints a row for each wipe and law. At the end, for each law: how
many of its wipes reach their goal; how many stay within 0.5 N (root mean square), 0.5 mm across the force, and in contact; how many lift off; median and worst.
"""

import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import armplane
import numpy as np
from armplane.arena import OPPONENTS
from armplane.results import _program, _sentence
from wipes import KEYS, NONE, pressed, run

MEASURES = "rms_n error_max_n impact_max_n tangential_max_mm".split()


def wiped(scenario, law, plant):
    """The row of a wipe, refused ones too, and whether its goal counts as reached."""
    name, _, file = law.partition("=")
    file = file or {path.stem: path for path in OPPONENTS}.get(name, "")
    if not file and not plant:
        return run(scenario, {"control.strategy": law})
    with tempfile.TemporaryDirectory() as folder:
        task = Path(folder) / "wipe.toml"
        task.write_text(scenario)
        more = ["--plant", plant] if plant else []
        command = [_program(), "compare", task, "--law", f"{name}={file}" if file else law, *more, "--out", f"{folder}/out", "--json"]
        done = subprocess.run(command, capture_output=True, text=True)
    row = {"outcome": f"refused: {_sentence(done.stderr)}"} if done.returncode else json.loads(done.stdout)["scenarios"][0]["laws"][0]
    return row, row["outcome"] in ("goal reached", "followed to the boundary")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--law", action="append", required=True)
    parser.add_argument("--arms", default="puma560,ur5,panda,xarm7")
    parser.add_argument("--each", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--plant")
    asked = parser.parse_args()
    rows = {law: [] for law in asked.law}
    for name in asked.arms.split(","):
        random = np.random.default_rng(asked.seed)
        for line in armplane.lines(name, asked.each, asked.seed, speed=0.1875):
            scenario = pressed(line["scenario"], random)
            for law in asked.law:
                row, is_reached = wiped(scenario, law, asked.plant)
                force = row.get("force") or NONE
                is_met = is_reached and force["rms_n"] <= 0.5 and force["tangential_max_mm"] <= 0.5 and force["lift_off_ticks"] == 0
                rows[law].append([is_reached, is_met, force["lift_off_ticks"] > 0, *(force[key] for key in MEASURES)])
                measures = " ".join(f"{key} {force[key]:.3g}" for key in KEYS)
                print(f"{law}: {name} {line['singularities']} {line['place']}: {row['outcome']}: {measures}", flush=True)
    for law, table in rows.items():
        reached, met, lifted, *measures = np.transpose(table)
        numbers = ", ".join(f"{key} {np.median(one):.2g} {max(one):.2g}" for key, one in zip(MEASURES, measures))
        print(f"{law}: {len(table)} wipes, {reached.sum():.0f} reach their goal, {met.sum():.0f} within the bars, {lifted.sum():.0f} lift off; {numbers}")


if __name__ == "__main__":
    main()
