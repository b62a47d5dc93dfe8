"""Experiments of many trials, with pandas, scipy and matplotlib (the wheel's extra `[experiments]`).

    from armplane import experiments
    table = experiments.sweep("fig5-wrist-rotation", {"control.k_p": [100, 400, 1600], "seed": range(1, 9)}, out="gains")
    experiments.figures("figures")
"""

from ..lazy import lazily
from ..results import extra

_PLACES = {
    "paper": ("figures",),
    "reports": ("heat", "report"),
    "studies": ("compare", "compare_plot", "race", "singular_lines", "steered"),
    "sweeps": ("Range", "lack", "read", "sweep"),
}
__all__, _found = lazily(__name__, _PLACES)
__dir__ = lambda: __all__


def __getattr__(name):
    # The command imports this package before it can say what is to be installed.
    with extra("experiments"):
        return _found(name)
