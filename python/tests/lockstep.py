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
reads = ["estimate", "singularity"]
writes = ["control_state", "torque"]
"""
# An arm without limits, which swings under gravity.
SCENARIO = 'name = "empty"\nrobot = "planar3r"\ngraph = "graph.toml"\n[start]\nq_deg = [20, 40, 50]\n[[segment]]\nby_m = [0.03, -0.04, 0.0]\nduration_s = 40\n'


def main(runs):
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        (folder / "controller.py").write_text(CONTROLLER.format(ticks=TICKS))
        (folder / "graph.toml").write_text(GRAPH.format(python=sys.executable))
        (folder / "empty.toml").write_text(SCENARIO)
        paces = [armplane.run(folder / "empty.toml", out=folder / f"run-{run}", record=False).summary["ticks_per_s"] for run in range(runs)]
        print(f"empty step in Python: {', '.join(f'{pace:.0f}' for pace in paces)} ticks/s; best {max(paces):.0f}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
