"""Two laws on one task as curves: error and joint speed over time, as SVG in a page."""

import html
import itertools
import math
import pathlib

# Points of a curve, size of a panel, px, and the colours of two laws.
POINTS, WIDTH, HEIGHT, COLORS = 240, 400, 130, ("#2e7d32", "#c0392b")
# Smallest error that is drawn.
FLOOR = 1e-3
PANELS = (("error orthogonal to ζ, mm", "mm", True), ("error orthogonal to ζ, °", "deg", True), ("fastest joint, share of its limit", "speed", False))


def curves(folder):
    """The curves of the recorded run in `folder`/run: names to values, `t` in s; the largest of each stretch of time, `None` where there is none."""
    from armplane import Run

    table = Run(pathlib.Path(folder) / "run").arrow()
    column = lambda name: table.column(name).to_pylist()
    largest = lambda values: max((value for value in values if value is not None), key=abs, default=None)
    speeds = [column(name) for name in table.schema.names if name.startswith("joint.qdot_ratio.")]
    whole = {
        "t": column("t_s"),
        "mm": column("error.position_mm.orthogonal"),
        "deg": column("error.orientation_deg.orthogonal"),
        "speed": [largest(tick) for tick in zip(*speeds)] if speeds else [None] * table.num_rows,
    }
    stretch = max(math.ceil(table.num_rows / POINTS), 1)
    return {name: [largest(values[k : k + stretch]) for k in range(0, len(values), stretch)] for name, values in whole.items()}


def races(found):
    """The section of the page for what [`__main__.races`] gives."""
    parts = []
    for heading, task, laws in found:
        missing = "".join(f"<p>{html.escape(law)} has no curve: it was refused or failed." for law, curve in laws.items() if not curve)
        key = " ".join(f'<span style="color:{color}">■ {html.escape(law)}</span>' for color, law in zip(COLORS, laws))
        panels = "".join(_panel(title, name, is_log, laws) for title, name, is_log in PANELS)
        parts.append(f"<h3>{html.escape(task)}: {html.escape(heading)}</h3><p>{key}{missing}<p>{panels}")
    return "".join(parts)


def _panel(title, name, is_log, laws):
    scale = (lambda value: math.log10(max(abs(value), FLOOR))) if is_log else abs
    values = [scale(value) for curve in laws.values() for value in curve.get(name, ()) if value is not None]
    end = max((curve["t"][-1] for curve in laws.values() if curve), default=0.0)
    if not values or not end:
        return ""
    low, high = (math.floor(min(values)), max(math.ceil(max(values)), math.floor(min(values)) + 1)) if is_log else (0.0, max(*values, 1.0))
    x = lambda t: 44 + (WIDTH - 54) * t / end
    y = lambda value: 10 + (HEIGHT - 30) * (1 - (value - low) / (high - low))
    lines = "".join(
        f'<polyline fill="none" stroke="{color}" stroke-width="1.4" points="{" ".join(f"{x(t):.1f},{y(scale(v)):.1f}" for t, v in points)}"/>'
        for color, curve in zip(COLORS, laws.values())
        for is_gap, points in itertools.groupby(zip(curve.get("t", ()), curve.get(name, ())), lambda point: point[1] is None)
        if not is_gap
    )
    marks = range(int(low), int(high) + 1) if is_log else (0.0, 0.5, 1.0)
    grid = "".join(
        f'<line x1="44" x2="{WIDTH - 10}" y1="{y(mark):.1f}" y2="{y(mark):.1f}" stroke="#ddd"/>'
        f'<text x="40" y="{y(mark) + 4:.1f}" text-anchor="end">{f"{10.0**mark:g}" if is_log else f"{mark:g}"}</text>'
        for mark in marks
    )
    axis = f'<text x="44" y="{HEIGHT - 4}">0 s</text><text x="{WIDTH - 10}" y="{HEIGHT - 4}" text-anchor="end">{end:.1f} s</text>'
    return f'<figure><figcaption>{html.escape(title)}</figcaption><svg width="{WIDTH}" height="{HEIGHT}" role="img">{grid}{lines}{axis}</svg></figure>'
