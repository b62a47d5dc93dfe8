"""The look of all pictures: one font, colours for the colour-blind, units in the headings; SVG and PDF for papers, PNG for pages."""

import contextlib
import pathlib
import textwrap

import matplotlib
import numpy as np

matplotlib.use("Agg")
from matplotlib import pyplot as plt

BLUE, RED, GREY, INK = "#0062b2", "#cb3234", "#787e8a", "#262a33"
SINGULARITIES = {"elbow": "#e27722", "wrist": "#eb4ad4", "overhead": "#ab8f2a", "shoulder": "#ab8f2a"}
LOOK = pathlib.Path(__file__).with_suffix(".mplstyle")
ENDINGS = (".svg", ".pdf", ".png")


def endings(path):
    """Those with which a picture is saved at `path`: its own, or without one all of them. Raises ValueError for the ending of another kind of file."""
    own = pathlib.Path(path).suffix
    if own and own not in ENDINGS:
        raise ValueError(f"{path} is no picture's name: end it with {', '.join(ENDINGS)}, or leave the ending out for all of them")
    return (own,) if own else ENDINGS


@contextlib.contextmanager
def page(path, title, subtitle, notes, rows, width=9.8):
    """A figure of rows of panels, (height, number) each: yields the panels, row by row, and saves `path` by its `endings`. `notes` may grow meanwhile."""
    heights, counts = zip(*rows)
    files = [pathlib.Path(path).with_suffix(ending) for ending in endings(path)]
    with plt.rc_context(fname=LOOK):
        figure = plt.figure(figsize=(width, 1))
        parts = figure.subfigures(len(rows), height_ratios=heights, hspace=0.03, squeeze=False).ravel()
        yield [part.subplots(1, count, squeeze=False)[0] for part, count in zip(parts, counts)]
        caption = "\n".join(textwrap.fill(note, int(15 * width)) for note in [subtitle, *notes])
        figure.suptitle(title, x=0.01, ha="left")
        figure.supxlabel(caption, x=0.01, ha="left", linespacing=1.35)
        figure.set_figheight(sum(heights) + 1.1 + 0.19 * caption.count("\n"))
        for file in files:
            figure.savefig(file, metadata={".svg": {"Date": None}, ".pdf": {"CreationDate": None}}.get(file.suffix))
        plt.close(figure)


def curves(axes, title, t, *named, dashed=(), x="time, s"):
    """Lines over time: (name, values) or (name, values, colour) each."""
    for name, values, *colour in named:
        axes.plot(t, values, *colour, label=name, ls="--" if name in dashed else "-")
    axes.set(title=title, xlabel=x)
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


def postures(axes, chains, colour=BLUE):
    """Chains of points, (points, 2) each; later ones are darker."""
    for points, strength in zip(chains, np.linspace(0.18, 1, len(chains))):
        axes.plot(*points.T, "-o", color=colour, alpha=strength, lw=2, ms=3)


def digits(value):
    """A number with as many digits as a reader wants."""
    size = abs(value)
    return "0" if size == 0 else f"{value:.1e}".replace("e-0", "e-") if size < 1e-3 else f"{value:.3f}" if size < 1 else f"{value:.{1 if size < 1000 else 0}f}"
