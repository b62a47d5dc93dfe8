"""Experiments of many trials, with pandas, scipy and matplotlib (`pip install 'armplane[experiments]'`).

    from armplane import experiments
    table = experiments.sweep("fig5-wrist-rotation", {"control.k_p": [100, 400, 1600], "seed": range(1, 9)}, out="gains")
    experiments.figures("figures")
"""

_WHERE = {
    "paper": ("figures",),
    "reports": ("heat", "report"),
    "studies": ("compare", "compare_plot", "race", "singular_lines", "steered"),
    "sweeps": ("Range", "lack", "read", "sweep"),
}
__all__ = [name for names in _WHERE.values() for name in names]


def __getattr__(name):
    # The command imports this package before it can say what is to be installed.
    for module, names in _WHERE.items():
        if name in names:
            from importlib import import_module

            found = import_module(f".{module}", __name__)
            globals().update({one: getattr(found, one) for one in names})
            return globals()[name]
    raise AttributeError(f"module 'armplane.experiments' has no attribute {name!r}")
