"""Experiments of many trials, with pandas, scipy and matplotlib (`pip install 'armplane[experiments]'`).

    from armplane import experiments
    table = experiments.sweep("fig5-wrist-rotation", {"control.k_p": [100, 400, 1600], "seed": range(1, 9)}, out="gains")
    experiments.figures("figures")
"""

from .figures import figures
from .report import heat, report
from .studies import compare, compare_plot, race, singular_lines, steered
from .sweep import Range, lack, read, sweep

__all__ = ["Range", "compare", "compare_plot", "figures", "heat", "lack", "race", "read", "report", "singular_lines", "steered", "sweep"]
