"""Two laws on one task as curves: error and joint speed over time, as pictures in a page."""

import base64
import html
import pathlib
import tempfile

import numpy as np
import pandas

from ..experiments.style import BLUE, RED, legend
from ..experiments.style import page as drawn
from ..results import Run

# Points of a curve; and smallest error that is drawn, mm and °.
POINTS, FLOOR = 240, 1e-3
PANELS = {"error orthogonal to ζ, mm": "log", "error orthogonal to ζ, °": "log", "fastest joint, share of its limit": "linear"}


def curves(folder):
    """The curves of the recorded run in `folder`/run over `t`, s: the largest of each stretch of time, none where there is none."""
    table = Run(pathlib.Path(folder) / "run").pandas()
    errors = table[["error.position_mm.orthogonal", "error.orientation_deg.orthogonal"]].clip(lower=FLOOR)
    whole = pandas.concat([errors, table.filter(like="joint.qdot_ratio.").abs().max(axis=1)], axis=1).set_axis([*PANELS], axis=1)
    return whole.assign(t=table.t_s).groupby(np.arange(len(table)) * POINTS // len(table)).max()


def races(found):
    """The section of the page for what [`__main__.races`] gives."""
    parts = []
    for heading, task, laws in found:
        missing = [f"{law} has no curve: it was refused or failed." for law, curve in laws.items() if curve is None]
        with tempfile.TemporaryDirectory() as folder:
            with drawn(f"{folder}/race.svg", f"{task}: {heading}", " and ".join(laws), missing, [(1.9, 3)]) as (panels,):
                for axes, (title, scale) in zip(panels, PANELS.items()):
                    for (law, curve), color in zip(laws.items(), (BLUE, RED)):
                        if curve is not None:
                            axes.plot(curve.t, curve[title], color=color, label=law)
                    axes.set(title=title, xlabel="time, s", yscale=scale)
                    legend(axes)
            picture = base64.b64encode(pathlib.Path(f"{folder}/race.svg").read_bytes()).decode()
        parts.append(f'<p><img alt="{html.escape(f"{task}: {heading}")}" src="data:image/svg+xml;base64,{picture}">')
    return "".join(parts)
