"""A sweep on Ray (`pip install ray`): python on_ray.py gains.toml OUT [SHARDS]

Each shard is a task that runs `armplane sweep --shard`. Ray starts a task again when its worker dies; the shard then goes on in its folder.
"""

import ctypes
import pathlib
import signal
import subprocess
import sys

import ray

PR_SET_PDEATHSIG = 1


def die_with_worker():
    """The kernel ends the shard with its worker: another worker's attempt finds the folder free."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


@ray.remote(num_cpus=1, max_retries=5)
def shard(index, count, sweep, out):
    command = ["armplane", "sweep", sweep, "--shard", f"{index}/{count}", "--out", f"{out}/shard-{index}", "--json"]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=die_with_worker)
    if done.returncode != 0:
        raise RuntimeError(done.stderr)
    return f"{out}/shard-{index}"


def main(sweep, out, count="4"):
    sweep, out = pathlib.Path(sweep).resolve(), pathlib.Path(out).resolve()
    ray.init()
    tasks = [shard.remote(index, int(count), str(sweep), str(out)) for index in range(1, int(count) + 1)]
    subprocess.run(["armplane", "sweep", "--merge", *ray.get(tasks), "--out", str(out / "whole")], check=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
