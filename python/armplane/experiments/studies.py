"""Laws compared on a task, on lines through singularities, and side by side over time; a table each, and its picture."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pandas as pd

from .. import trials, wire
from ..results import listed
from .paper import Recorded
from .style import BLUE, GREY, RED, digits, endings, legend, page, postures, undistorted

# Drawn of each law, three to a row.
METRICS = {
    "orthogonal_max_mm": "error orthogonal to ζ, mm",
    "along_max_mm": "error along ζ, mm",
    "final_position_mm": "error at the end, mm",
    "orthogonal_max_deg": "error orthogonal to ζ, °",
    "along_max_deg": "error along ζ, °",
    "final_orientation_deg": "error at the end, °",
    "speed_max_ratio": "joint speed, share of limit",
    "torque_step_max_ratio": "torque step, share of limit",
    "jump_energy_j": "energy of jumps, J",
}


def _all(jobs):
    """The rows of trials, (columns, scenario, settings) each, on all cores."""
    with ThreadPoolExecutor() as pool:
        rows = pool.map(lambda job: {**job[0], **trials.trial(job[1], job[2])}, jobs)
        return pd.DataFrame([{key: value for key, value in row.items() if key != "hash"} for row in rows])


def compare(scenario, laws=None, settings=None):
    """A scenario under each law (all that follow paths by default): a row each."""
    laws = listed(trials.laws() if laws is None else laws)
    if not laws:
        raise ValueError("laws is empty: name one, or leave it out for all")
    return _all([({"law": law}, scenario, {**(settings or {}), "control.strategy": law, "fault": "[]"}) for law in laws])


def singular_lines(robot, count=4, seed=1, kind="one", laws=("blended",), *, speed=0.28, settings=None):
    """Lines through the exact singularities of an arm, under each law: a row each, with `line`, `singularities` and `place`."""
    lines = trials.lines(robot, count, seed, kind, speed=speed, settings=settings)
    places = [{"line": i, "singularities": line["singularities"], "place": line["place"]} for i, line in enumerate(lines, 1)]
    return _all([({**place, "law": law}, line["scenario"], {"control.strategy": law}) for law in listed(laws) for place, line in zip(places, lines)])


# The study's bars: errors orthogonal to ζ, mm and °, the reference's lead among them; and when an arm stands, below a share of the speed asked for, for how long, s.
ORTHOGONAL, STILL_SHARE, STILL_S, MOVES = (0.5, 1.5), 0.02, 0.5, 1e-3
STATED = ("LIMIT", "REACH", "RESTING", "STALE", "OVER", "HELD", "LOST")


def steered(robots=("puma560", "ur5", "iiwa14", "panda"), seeds=range(1, 4), seconds=60.0, settings=None):
    """Random twists on each arm, by each seed: a row each, with loads over their limits, errors, and seconds: stalled without a stated reason, at limits.

    `kept` says whether no limit was exceeded, no error was beyond 0.5 mm or 1.5° orthogonal to ζ, and the arm never stood without a stated reason.
    """
    jobs = [(robot, seed) for robot in listed(robots) for seed in listed(seeds)]
    with ThreadPoolExecutor() as pool:
        return pd.DataFrame(pool.map(lambda job: _session(*job, seconds, settings), jobs))


def _session(robot, seed, seconds, settings):
    scenario = trials.twists(robot, seed, seconds)
    row, run = trials.trial(scenario, settings), Recorded(scenario, settings)
    dt, by = run.t[1] - run.t[0], lambda *reasons: np.isin(run.columns["servo.reason"], [getattr(wire, f"REASON_{name}") for name in reasons])
    asked = np.abs(np.hstack([run.vectors("servo.velocity"), run.vectors("servo.angular_velocity")])).max(axis=1)
    stands = pd.Series(~by(*STATED) & (asked > MOVES) & (run.columns["servo.speed_share"] < STILL_SHARE))
    # Ticks that it has stood at each tick; those beyond what it may count.
    since = stands.groupby((~stands).cumsum()).cumsum()
    step = np.abs(np.diff(run.vectors("torque.commanded"), axis=0)).max(axis=0) / (run.arm.torque_rate * dt)
    beyond = np.maximum(run.q - run.arm.upper, run.arm.lower - run.q).max()
    found = {
        "arm": robot, "seed": seed, "seconds": seconds, "speed_max_ratio": row["speed_max_ratio"], "torque_max_ratio": row["torque_max_ratio"],
        "step_max_ratio": step.max(), "beyond_range_rad": max(beyond, 0.0), "orthogonal_max_mm": row["orthogonal_max_mm"],
        "orthogonal_max_deg": row["orthogonal_max_deg"], "stalled_s": (since * dt > STILL_S).sum() * dt, "limit_s": by("LIMIT").sum() * dt,
        "reach_s": by("REACH").sum() * dt, "slowed_s": by("SINGULARITY", "EFFORT").sum() * dt,
    }  # fmt: skip
    limits = found["speed_max_ratio"] <= 1 and found["torque_max_ratio"] <= 1 and found["step_max_ratio"] <= 1 + 1e-6 and found["beyond_range_rad"] == 0
    errors = found["orthogonal_max_mm"] <= ORTHOGONAL[0] and found["orthogonal_max_deg"] <= ORTHOGONAL[1]
    return {**found, "kept": bool(limits and errors and found["stalled_s"] == 0)}


def compare_plot(table, path, title="Control laws on the same plant and seed"):
    """Draws the rows of `compare` as bars: blue within the law's bars, red beyond them, grey where the run ended early.

    `path` ends with .svg, .pdf or .png, or is the name of all three.
    """
    notes = [f"{row.law}: {row.outcome}. {row.reason}" for row in table.itertuples()]
    colours = [GREY if not row.completed else BLUE if row.s2 else RED for row in table.itertuples()]
    with page(path, title, "red: a bar of S2 is missed; grey: ended early", notes, [(0.22 * len(table) + 0.5, 3)] * 3) as panels:
        for i, (axes, (column, heading)) in enumerate(zip(np.ravel(panels), METRICS.items())):
            values = table[column].astype(float)
            axes.bar_label(axes.barh(table["law"], values, color=colours), map(digits, values), padding=3, size=7)
            axes.invert_yaxis()
            axes.set_title(heading)
            axes.tick_params(labelleft=i % 3 == 0)
            axes.margins(x=0.18)


def race(scenario, laws, path, settings=None):
    """Runs a scenario under one or more laws, draws errors, joint speeds and the paths of the hand over time, and returns the largest of each.

    `path` ends with .svg, .pdf or .png, or is the name of all three.
    """
    # Before any run: a mistake in it would come after minutes.
    endings(path)
    laws = listed(laws)
    if not laws:
        raise ValueError("laws is empty: name one or more")
    runs = {law: Recorded(scenario, {**(settings or {}), "control.strategy": law, "fault": "[]"}) for law in laws}
    table = pd.DataFrame(
        {"position_max_mm": run.error_mm.max(), "orientation_max_deg": run.error_deg.max(), "speed_max_ratio": np.abs(run.vectors("joint.qdot_ratio")).max()}
        for run in runs.values()
    ).set_index(pd.Index(runs, name="law"))
    notes = [f"{law}: at most {digits(mm)} mm and {digits(deg)}° off, joints at {speed:.0%} of their speed" for law, mm, deg, speed in table.itertuples()]
    series = {
        "position error, mm": lambda run: run.error_mm,
        "orientation error, °": lambda run: run.error_deg,
        "fastest joint, share of its speed": lambda run: np.abs(run.vectors("joint.qdot_ratio")).max(axis=1),
    }
    with page(path, f"{scenario}: {' and '.join(laws)}", "the same plant, seed and task", notes, [(2.6, 3), (3.2, len(runs))]) as (above, below):
        for axes, (title, of) in zip(above, series.items()):
            axes.set(title=title, xlabel="time, s")
            for law, run in runs.items():
                axes.plot(run.t, of(run), label=law)
            legend(axes)
        for i, (axes, (law, run)) in enumerate(zip(below, runs.items())):
            side = run.outwards(np.array([1.0, 0, 0]))
            undistorted(axes, f"{law}: the arm, m (later is darker)")
            postures(axes, run.seen(0, np.inf, side), f"C{i}")
    return table
