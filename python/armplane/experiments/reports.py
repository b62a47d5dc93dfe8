"""A sweep read back: outcomes, distributions, a map over two keys, and the worst runs with the commands that repeat them."""

import itertools
import json
import pathlib
import shlex

import numpy as np
import pandas as pd

from ..results import as_settings
from .style import BLUE, curves, page
from .sweeps import lack, read

SHOWN = [
    "position_max_mm",
    "orthogonal_max_mm",
    "orientation_max_deg",
    "orthogonal_max_deg",
    "final_position_mm",
    "speed_max_ratio",
    "torque_max_ratio",
    "torque_step_max_ratio",
]
CLASSES = 10


def report(folder, by="position_max_mm", keys=None, worst=10):
    """Reads a sweep's folder, as far as it has come; saves `report.json`, `report.svg`, `.pdf` and `.png` there, and returns the report.

    `by` is the column that ranks the worst runs and colours the map over the two `keys` (the first two by default).
    """
    folder = pathlib.Path(folder)
    table, plan = read(folder)
    space = list(plan["space"])
    keys = list(keys or space[:2])
    unknown = [key for key in keys if key not in space]
    if unknown or len(keys) > 2:
        raise ValueError(f"a map needs two keys of this sweep, of {', '.join(space)}; not {', '.join(unknown or keys)}")
    if by not in table or not pd.api.types.is_numeric_dtype(table[by]) or table[by].isna().all():
        raise ValueError(f"the column {by!r} has no numbers; take one such as {SHOWN[0]}")
    shown = [column for column in dict.fromkeys([*SHOWN, by]) if column in table]
    spread = table[shown].quantile([0, 0.5, 0.9, 0.99, 1]).T.set_axis(["min", "p50", "p90", "p99", "max"], axis=1)
    # First those that did not come to their task's end, then by the column; a number that is none is larger.
    ranked = table.dropna(subset=by).assign(done=table.get("completed", True)).sort_values(["done", by, "run"], ascending=[True, False, True], kind="stable")

    def command(row):
        sets = (f"--set {shlex.quote(one)}" for one in as_settings({**plan["settings"], **row[space]}))
        return " ".join(["armplane run", shlex.quote(plan["scenario"]), *sets, f"--out {folder.name}-run-{row['run']}"])

    result = {
        "folder": str(folder), "scenario": plan["scenario"], "runs": len(table), "of": plan["runs"], "outcomes": table["outcome"].value_counts().to_dict(),
        "lack": lack(table, {}), "distributions": spread.to_dict("index"), "by": by,
        "worst": [{"run": int(row["run"]), "value": float(row[by]), "outcome": row["outcome"], "command": command(row)} for _, row in ranked.head(worst).iterrows()],
    }  # fmt: skip
    _draw(folder / "report", table, plan, result, keys, by, shown)
    (folder / "report.json").write_text(f"{json.dumps(result, indent=1)}\n")
    return result


def _counted(outcomes):
    return ", ".join(f"{outcome} {count}" for outcome, count in outcomes.items())


def text(result):
    """The report for people."""
    counted = f"{result['runs']} runs" if result["runs"] == result["of"] else f"{result['runs']} of {result['of']} runs, those of complete chunks"
    spread = pd.DataFrame(result["distributions"]).T.to_string(float_format=lambda x: f"{x:.4g}")
    worst = "\n".join(f"{one['value']:12.4g}  {one['outcome']}\n    {one['command']}" for one in result["worst"])
    return f"{result['scenario']}: {_counted(result['outcomes'])} in {counted}\n\n{spread}\n\nworst by {result['by']}\n{worst}"


def heat(axes, table, x, y, by, aggregate="median"):
    """A map of a column over two keys on the axes of a figure; ranges are gathered in classes."""
    grid = table.assign(_x=_classes(table[x]), _y=_classes(table[y])).pivot_table(index="_y", columns="_x", values=by, aggfunc=aggregate, observed=True)
    shown = axes.imshow(grid.to_numpy(dtype=float), origin="lower", aspect="auto", cmap="viridis")
    for axis, labels in ((axes.xaxis, grid.columns), (axes.yaxis, grid.index)):
        axis.set_ticks(range(len(labels)), [str(label) for label in labels], size=7)
    axes.tick_params(axis="x", rotation=30)
    axes.set(xlabel=x, ylabel=y)
    axes.grid(False)
    axes.figure.colorbar(shown, ax=axes)
    return grid


def _classes(values):
    distinct, is_number = values.dropna().unique(), pd.api.types.is_numeric_dtype(values)
    if len(distinct) <= CLASSES or not is_number:
        label = "{:g}".format if is_number else str
        return pd.Categorical(values.map(label), [label(value) for value in (sorted(distinct) if is_number else distinct)], ordered=True)
    is_log = values.min() > 0 and values.max() > 20 * values.min()
    edges = (np.geomspace if is_log else np.linspace)(values.min(), values.max(), CLASSES + 1)
    return pd.cut(values, edges, labels=[f"{(np.sqrt(a * b) if is_log else (a + b) / 2):.3g}" for a, b in zip(edges, edges[1:])], include_lowest=True, ordered=False)


def _draw(path, table, plan, result, keys, by, shown):
    notes = ["Curves: share of the runs with at most this value. Map: share of goals reached, and the median over the runs of a cell."]
    rows = [(2.2, 4)] * -(-len(shown) // 4) + ([(3.6, 2)] if len(keys) == 2 else [(2.6, 1)])
    with page(path, f"{plan['scenario']}: {result['runs']} runs", _counted(result["outcomes"]), notes, rows, width=12) as (*above, below):
        for axes, column in itertools.zip_longest(np.ravel(above), shown):
            axes.set_title(column)
            values = table[column].replace(np.inf, np.nan).dropna().astype(float) if column else ()
            if not len(values):
                axes.axis("off")
                continue
            axes.ecdf(values, color=BLUE)
            if values.min() >= 0 and values.max() > 20 * max(values.min(), 1e-5 * values.max()):
                axes.set_xscale("log")
        if len(keys) == 2:
            reached = table.assign(reached=(table["outcome"] == "goal reached").astype(float))
            for axes, column, name, how in zip(below, ("reached", by), ("goals reached", by), ("mean", "median")):
                heat(axes, reached, *keys, column, how)
                axes.set_title(name)
        else:
            curves(below[0], by, table[keys[0]], x=keys[0]).plot(table[keys[0]], table[by], "o", ms=3)
