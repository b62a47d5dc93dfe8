"""How late ROS 2 hears of the arm, and the arm of a twist: `python python/tests/ros2_latency.py`, with another participant in another process."""

import pathlib
import tempfile
import time

import armplane
import numpy as np
from test_ros2 import Face

HZ, SECONDS = 500, 20


def main():
    for mode in ("lockstep", "realtime"):
        with tempfile.TemporaryDirectory() as folder:
            with Face(None, pathlib.Path(folder), f"servo ur5 --duration 100 --mode {mode} --ros2=units,rate={HZ}") as face:
                while not face.peer.ask("heard", "servo_node/delta_twist_cmds"):
                    time.sleep(0.1)
                time.sleep(1)
                face.peer.ask("take", "joint_states")
                sent, ages = face.peer.ask("lag", "joint_states", SECONDS, HZ)
            targets = armplane.load(f"{folder}/run").messages("target")
        # The operator stamps last.
        count, when = np.rint(targets["target"]["twist"][:, 0] * 1e9).astype(int), targets["header"]["sent_ns"].max(axis=1)
        came, first = np.unique(count, return_index=True)
        known = (came > 0) & (came <= len(sent))
        delays = when[first[known]].astype(float) - np.array(sent)[came[known] - 1]
        table = {f"joint_states, {len(ages) / SECONDS:.0f} Hz": ages, f"twist, {known.sum()} of {len(sent)} in force": delays}
        for name, values in table.items():
            middle, tail, most = np.percentile(np.array(values) / 1e6, [50, 99, 100])
            print(f"{mode}: {name}: median {middle:.2f} ms, 99 % {tail:.2f} ms, longest {most:.2f} ms")


if __name__ == "__main__":
    main()
