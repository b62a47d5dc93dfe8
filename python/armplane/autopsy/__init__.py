"""Was it a singularity? Reads a robot's log, and says what happened, when, and why.

    from armplane import autopsy
    answer = autopsy.autopsy("log.mcap", "ur5e.urdf", tip="tool0")
    answer["cause"], answer["t"], answer["text"]

The command is `armplane autopsy LOG --robot ARM` (docs/autopsy.md).
"""

from ..lazy import lazily

# The command lists its arguments, and says what to install, without numpy and scipy.
_PLACES = {"causes": ("CAUSES",), "columns": ("ROLES",), "logs": ("LogError",), "robot": ("Robot",), "answer": ("autopsy",)}
__all__, __getattr__ = lazily(__name__, _PLACES)
