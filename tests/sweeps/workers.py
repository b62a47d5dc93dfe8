#!/usr/bin/env python3
"""A sweep on Ray and on Dask, one of whose workers is killed, and the table of one machine: the same bytes, read by four libraries.

    python3 tests/sweeps/workers.py [PATH/OF/armplane]      # default: target/release/armplane

Needs `pip install ray "dask[distributed]" duckdb polars pandas pyarrow`; an engine or a library that is missing is named and skipped.
Exit code 1: a table differs, or no worker could be killed.
"""

import importlib
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import threading

ROOT = pathlib.Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples" / "sweep"
SHARDS = 4
SWEEP = """name = "shards"
scenario = "fig5-wrist-rotation"
partition = 4

[[key]]
key = "control.k_p"
values = [100, 225, 400]

[[key]]
key = "seed"
from = 1
to = 32
steps = 32
"""
# The process between the engine and a shard: its worker.
ENGINES = {"distributed": "on_dask.py", "ray": "on_ray.py"}


def tables(folder):
    return {path.name: path.read_bytes() for path in sorted((folder / "runs").glob("*.parquet"))}


def parent(pid):
    fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return int(fields[1])


def shard_of(out):
    """A process that computes a shard into this folder."""
    for entry in pathlib.Path("/proc").iterdir():
        try:
            words = (entry / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if b"--shard" in words and any(word.startswith(os.fsencode(out)) for word in words):
            return int(entry.name)
    return None


def kill_a_worker(out, killed, is_over):
    """Kills the worker of a shard once the shard has completed a partition."""
    while not is_over.wait(0.02):
        pid = shard_of(out)
        if pid is None or not any(out.glob("shard-*/runs/part-*.parquet")):
            continue
        try:
            worker = parent(pid)
            os.kill(worker, signal.SIGKILL)
        except OSError:
            continue
        killed.append(worker)
        return


def on_engine(module, armplane, sweep, out):
    """The merged table of a sweep on an engine, and the workers killed meanwhile; `None` where the engine is missing."""
    try:
        importlib.import_module(module)
    except ImportError:
        return None
    killed = []
    is_over = threading.Event()
    thread = threading.Thread(target=kill_a_worker, args=(out, killed, is_over))
    thread.start()
    path = os.pathsep.join([str(armplane.parent), os.environ["PATH"]])
    command = [sys.executable, str(EXAMPLES / ENGINES[module]), str(sweep), str(out), str(SHARDS)]
    done = subprocess.run(command, env={**os.environ, "PATH": path}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    is_over.set()
    thread.join()
    if done.returncode != 0:
        sys.exit(f"{ENGINES[module]} ended with {done.returncode}:\n{done.stdout[-3000:]}")
    return tables(out / "whole"), killed


def counts(folder):
    """Runs that reached their goal, counted by each library that is there."""
    files = str(folder / "runs" / "*.parquet")
    ways = {
        "duckdb": lambda it: it.sql(f"SELECT count(*) FROM '{files}' WHERE outcome = 'goal reached'").fetchall()[0][0],
        "polars": lambda it: it.read_parquet(files).filter(it.col("outcome") == "goal reached").height,
        "pandas": lambda it: int((it.read_parquet(folder / "runs").outcome == "goal reached").sum()),
        "pyarrow.parquet": lambda it: it.read_table(folder / "runs").column("outcome").to_pylist().count("goal reached"),
    }
    found = {}
    for name, count in ways.items():
        try:
            library = importlib.import_module(name)
        except ImportError:
            print(f"{name}: skipped, it is not installed")
            continue
        found[name] = count(library)
    return found


def main(armplane=str(ROOT / "target" / "release" / "armplane")):
    armplane, failed = pathlib.Path(armplane).resolve(), False
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        sweep = folder / "shards.toml"
        sweep.write_text(SWEEP)
        subprocess.run([armplane, "sweep", sweep, "--out", folder / "one"], check=True, stdout=subprocess.DEVNULL)
        expected = tables(folder / "one")
        for module, script in ENGINES.items():
            ran = on_engine(module, armplane, sweep, folder / module)
            if ran is None:
                print(f"{script}: skipped, {module} is not installed")
                continue
            table, killed = ran
            same = "the same bytes" if table == expected else "ANOTHER TABLE"
            failed |= table != expected or not killed
            print(f"{script}: {SHARDS} shards, {len(killed)} worker killed, {len(table)} files: {same} as on one machine")
        found = counts(folder / "one")
        print("runs that reached their goal: " + ", ".join(f"{name} {count}" for name, count in found.items()))
        failed |= len(set(found.values())) > 1
    sys.exit(int(failed))


if __name__ == "__main__":
    main(*sys.argv[1:])
