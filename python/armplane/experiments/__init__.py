"""Experiments of many trials, with pandas, scipy and matplotlib (`pip install 'armplane[experiments]'`).

    from armplane import experiments
    table = experiments.sweep("fig5-wrist-rotation", {"control.k_p": [100, 400, 1600], "seed": range(1, 9)}, out="gains")
    experiments.figures("figures")
"""

from ..lazy import found

_PLACES = {
    "paper": ("figures",),
    "reports": ("heat", "report"),
    "studies": ("compare", "compare_plot", "race", "singular_lines", "steered"),
    "sweeps": ("Range", "lack", "read", "sweep"),
}
__all__ = sum(_PLACES.values(), ())


def __getattr__(name):
    # The command imports this package before it can say what is to be installed.
    return found(__name__, _PLACES, name)
