"""The look of all pictures: one font, colours for the colour-blind, units in the headings; SVG and PDF for papers, PNG for pages."""

import contextlib
import pathlib

import matplotlib

matplotlib.use("Agg")
from matplotlib import pyplot as plt

BLUE, RED, GREY, INK = "#0062b2", "#cb3234", "#787e8a", "#262a33"
SINGULARITIES = {"elbow": "#e27722", "wrist": "#eb4ad4", "overhead": "#ab8f2a", "shoulder": "#ab8f2a"}
LOOK = pathlib.Path(__file__).with_suffix(".mplstyle")


@contextlib.contextmanager
def page(path, title, subtitle, notes, rows, width=9.8, files=("svg", "pdf", "png")):
    """A figure of rows of panels, (height, number) each: yields the panels, row by row, and saves `path` with each ending. `notes` may grow meanwhile."""
    with plt.rc_context(fname=LOOK):
        below = lambda: 0.19 * sum(1 + len(note) // 145 for note in notes)
        height = sum(height for height, _ in rows) + 1.1
        figure = plt.figure(figsize=(width, height + 1.2))
        grids = figure.add_gridspec(len(rows), 1, height_ratios=[height for height, _ in rows], hspace=0.55)
        yield [[figure.add_subplot(cell) for cell in grid.subgridspec(1, count, wspace=0.28)] for grid, (_, count) in zip(grids, rows)]
        foot = below() + 0.2
        figure.set_size_inches(width, height + foot)
        whole = height + foot
        figure.subplots_adjust(left=0.06, right=0.985, top=1 - 1.05 / whole, bottom=(foot + 0.45) / whole)
        figure.text(0.02, 1 - 0.12 / whole, title, size=13, weight="bold", va="top")
        figure.text(0.02, 1 - 0.37 / whole, subtitle, size=9, color=GREY, va="top", wrap=True)
        figure.text(0.02, 0.1 / whole, "\n".join(_wrapped(note) for note in notes), size=9, va="bottom", linespacing=1.35)
        for ending in files:
            metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(ending, {})
            figure.savefig(f"{path}.{ending}", metadata=metadata)
        plt.close(figure)


def _wrapped(text):
    import textwrap

    return textwrap.fill(text, 150)


def curves(axes, title, t, *named, dashed=(), x="time, s"):
    """Lines over time: (name, values) or (name, values, colour) each."""
    axes.set_title(title)
    axes.set_xlabel(x)
    for name, values, *colour in named:
        axes.plot(t, values, label=name, color=colour[0] if colour else None, ls="--" if name in dashed else "-")
    if any(name for name, *_ in named):
        legend(axes)
    return axes


def legend(axes):
    """Between the title and the data, where it hides nothing."""
    axes.legend(loc="lower left", bbox_to_anchor=(-0.02, 0.99), ncols=6, borderaxespad=0, columnspacing=0.8, handlelength=1.1, handletextpad=0.4)
    axes.set_title(axes.get_title(loc="left"), pad=19)


def undistorted(axes, title, hidden=False):
    """A picture with one scale for both axes."""
    axes.set_title(title)
    axes.set_aspect("equal", adjustable="datalim")
    if hidden:
        axes.axis("off")
    return axes


def postures(axes, chains, colour=BLUE):
    """Chains of points, (points, 2) each; later ones are darker."""
    for k, points in enumerate(chains):
        strength = 0.18 + 0.82 * k / max(len(chains) - 1, 1)
        axes.plot(*points.T, "-o", color=colour, alpha=strength, lw=2, ms=3)


def digits(value):
    """A number with as many digits as a reader wants."""
    size = abs(value)
    if size == 0:
        return "0"
    if size < 1e-3:
        return f"{value:.1e}".replace("e-0", "e-")
    return f"{value:.3f}" if size < 1 else f"{value:.1f}" if size < 1000 else f"{value:.0f}"
