"""Runs controllers of others in lockstep with armplane's plant and judge. An opponent is a class in a file:

    import armplane.arena, numpy

    class Mine(armplane.arena.Velocity):                       # or Torque, Position
        def qdot(self, q, ref):
            return numpy.linalg.pinv(self.arm.J(q)) @ (ref.V + 10 * self.arm.error(q, ref))

    armplane compare fig5-wrist-rotation --law blended,mine=mine.py

Twists are `[linear; angular]` in base axes, SI units throughout. docs/arena.md has the tasks, the scores and the table.
"""

from pathlib import Path

from ..lazy import lazily

# The files of the controllers of others, by name.
OPPONENTS = {path.stem: path for path in sorted((Path(__file__).parents[1] / "opponents").glob("[!_]*.py"))}
# Conditions under which a task is run.
GIVEN_CLOCK, OWN_CLOCK, NO_HINTS = "given clock", "own clock", "no hints"
# The command `armplane arena` needs neither numpy nor MuJoCo to say what is missing.
_PLACES = {"arm": ("Arm",), "laws": ("Position", "Reference", "Torque", "Velocity", "grid"), "pressing": ("Force",)}
__all__, __getattr__ = lazily(__name__, _PLACES)
__all__.append("OPPONENTS")
