"""A sweep on Dask (`pip install "dask[distributed]"`): python on_dask.py gains.toml OUT [SHARDS [SCHEDULER]]

Each shard is a task that runs `armplane sweep --shard`. Dask starts a task again when its worker dies; the shard then goes on in its folder.
Without the address of a scheduler the workers are processes of this machine.
"""

import ctypes
import pathlib
import signal
import subprocess
import sys

from distributed import Client, LocalCluster

PR_SET_PDEATHSIG = 1


def die_with_worker():
    """The kernel ends the shard with its worker: another worker's attempt finds the folder free."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


def shard(index, count, sweep, out):
    command = ["armplane", "sweep", sweep, "--shard", f"{index}/{count}", "--out", f"{out}/shard-{index}", "--json"]
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=die_with_worker)
    if done.returncode != 0:
        raise RuntimeError(done.stderr)
    return f"{out}/shard-{index}"


def main(sweep, out, count="4", scheduler=None):
    sweep, out = pathlib.Path(sweep).resolve(), pathlib.Path(out).resolve()
    with Client(scheduler or LocalCluster(threads_per_worker=1)) as client:
        indices = range(1, int(count) + 1)
        tasks = [client.submit(shard, index, int(count), str(sweep), str(out), pure=False, retries=5) for index in indices]
        subprocess.run(["armplane", "sweep", "--merge", *client.gather(tasks), "--out", str(out / "whole")], check=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
