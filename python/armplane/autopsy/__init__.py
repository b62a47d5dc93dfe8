"""Was it a singularity? Reads a robot's log, and says what happened, when, and why.

    from armplane import autopsy
    answer = autopsy.autopsy("log.mcap", "ur5e.urdf", tip="tool0")
    answer["cause"], answer["t"], answer["text"]

The command is `armplane autopsy LOG --robot ARM` (docs/autopsy.md).
"""

__all__ = ["CAUSES", "ROLES", "LogError", "Robot", "autopsy"]


def __getattr__(name):
    # The command lists its arguments, and says what to install, without numpy and pandas.
    if name not in __all__:
        raise AttributeError(f"module 'armplane.autopsy' has no attribute {name!r}")
    from . import answer

    return getattr(answer, name)
