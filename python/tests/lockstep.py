"""Measures a Python controller with an empty step in lockstep: `python lockstep.py [RUNS]`, ticks per second of each run and the best of them."""

import pathlib
import sys
import tempfile

import armplane

TICKS = 40_000
CONTROLLER = """import armplane

class Empty(armplane.Controller):
    def control(self, tick, estimate, singularity, state, torque):
        torque.phase = armplane.wire.PHASE_RUNNING if tick < {ticks} else armplane.wire.PHASE_DONE

Empty.run()
"""
GRAPH = """extends = "armplane"
[[process]]
name = "controller"
command = [{python!r}, "controller.py"]
{more}reads = ["estimate", "singularity"]
writes = ["control_state", "torque"]
"""
# An arm that swings in the horizontal plane: without a torque it stands still.
LINK = '<link name="{0}"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
JOINT = (
    '<joint name="joint{0}" type="revolute"><parent link="{0}"/><child link="{1}"/><axis xyz="0 0 1"/><origin xyz="0.4 0 0"/>'
    '<limit lower="-3" upper="3" effort="50" velocity="3"/></joint>'
)
ARM = "<robot name=\"swing\">" + "".join(LINK.format(i) for i in range(4)) + "".join(JOINT.format(i, i + 1) for i in range(3)) + "</robot>"
TASK = 'default_frame = "3"\nlength_m = 0.4\ntask = ["x", "y"]\n'
SCENARIO = 'name = "empty"\nrobot = "arm.urdf"\ngraph = "graph.toml"\n[start]\nq_deg = [20, 40, 50]\n[[segment]]\nby_m = [0.03, -0.04, 0.0]\nduration_s = 40\n'


def main(runs):
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        (folder / "controller.py").write_text(CONTROLLER.format(ticks=TICKS))
        (folder / "graph.toml").write_text(GRAPH.format(python=sys.executable, more="" if hasattr(armplane, "Joined") else "exchange = true\n"))
        for name, text in {"empty.toml": SCENARIO, "arm.urdf": ARM, "arm.toml": TASK}.items():
            (folder / name).write_text(text)
        paces = [armplane.run(folder / "empty.toml", out=folder / f"run-{run}", record=False).summary["ticks_per_s"] for run in range(runs)]
        print(f"empty step in Python: {', '.join(f'{pace:.0f}' for pace in paces)} ticks/s; best {max(paces):.0f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
