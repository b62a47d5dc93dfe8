"""A scenario under many settings: a grid, or points drawn at random or by Sobol's sequence; one Parquet file a chunk of runs.

    table = sweep("fig5-wrist-rotation", {"control.k_p": Range(100, 1600, log=True), "seed": Range(1, 10**6)}, 1000, "sobol", out="gains")

The points depend on nothing but the arguments, and a chunk's file appears when it is whole. So the same call continues a sweep that was stopped or killed.
"""

import hashlib
import itertools
import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from .. import _armplane
from ..results import as_settings, plain, write_whole
from ..trials import _whole, trial

MOST = 10_000_000
PLAN = "sweep.json"
METHODS = ("grid", "random", "sobol")


@dataclass(frozen=True)
class Range:
    """The numbers from `low` to `high`, both included; a grid takes `steps` of them. `log`: evenly in the logarithm."""

    low: float
    high: float
    steps: int = 0
    log: bool = False

    def at(self, share, whole):
        low, high = self.low, self.high
        if whole and not self.log:
            # Each whole number as often as every other one, the ends included.
            return (np.floor(low + share * (high - low + 1)).clip(low, high)).astype(int)
        value = low * (high / low) ** share if self.log else low + (high - low) * share
        return np.rint(value).astype(int) if whole else np.where(share == 1, high, value)

    def grid(self, whole):
        if self.steps < 2:
            raise ValueError(f"the range from {self.low} to {self.high} needs steps for a grid, 2 or more; a sample (random, sobol) needs none")
        share = np.arange(self.steps) / (self.steps - 1)
        if whole and not self.log:
            values = self.low + (self.high - self.low) * share
            if (values != np.rint(values)).any():
                raise ValueError(f"{self.steps} steps from {self.low} to {self.high} are no whole numbers, and the key takes no others")
            return values.astype(int)
        return self.at(share, whole)


def sweep(scenario, space, runs=None, method="grid", *, seed=1, settings=None, out=None, client=None, jobs=-1, progress=None, run=trial):
    """Runs a scenario at each point of a space, and returns the table: a row per run, with its number, keys, `outcome` and all numbers of `trial`.

    `space` gives each key of the scenario a list of values or a `Range`. `method` is "grid" (every combination; the last key varies fastest), "random" or
    "sobol" (`runs` points by `seed`). `out` is a folder for the table's parts, which continues what it holds; without it, nothing is written. The runs use
    `jobs` threads (all cores by default), or the workers of a dask `client`. `progress(done, runs)` hears of each chunk.
    """
    if jobs == 0:
        raise ValueError("jobs = 0: give a number of threads, or -1 for all cores")
    if out is not None and Path(out).is_file():
        raise ValueError(f"out: {out} is a file, not a folder")
    points, job = draw(scenario, space, runs, method, seed, settings), (scenario, settings or {}, run)
    chunk = min(max(math.ceil(len(points) / 64), 8), 1000)
    chunks = {i: points[i : i + chunk] for i in range(0, len(points), chunk)}
    plan = {"scenario": str(scenario), "settings": settings or {}, "space": space, "method": method, "seed": seed, "runs": len(points), "chunk": chunk}
    parts = {i: Path(out) / f"runs-{i:08}.parquet" for i in chunks} if out is not None else {}
    if out is not None:
        _claim(Path(out), plan, _run(*job, points[0]))
    todo = {i: points for i, points in chunks.items() if i not in parts or _part(parts[i]) is None}
    done, tables = len(points) - sum(map(len, todo.values())), {}
    for i, rows in _spread(todo, job, client, jobs):
        tables[i] = table = pd.json_normalize(rows)
        if out is not None:
            write_whole(parts[i], table.to_parquet(index=False))
        done += len(table)
        if progress:
            progress(done, len(points))
    return pd.concat([tables[i] if i in tables else _part(parts[i]) for i in chunks], ignore_index=True)


def _part(path):
    """The table of a chunk's file; `None` where it is not there, or was cut short by others: then its runs are made again."""
    try:
        return pd.read_parquet(path)
    except (OSError, ValueError):
        return None


def read(folder):
    """The table of a sweep's folder, as far as it has come, and its plan."""
    folder = Path(folder)
    if not (folder / PLAN).is_file():
        raise ValueError(f"{folder} is not a sweep's folder: it has no {PLAN}")
    parts = {path: _part(path) for path in sorted(folder.glob("runs-*.parquet"))}
    if broken := [path for path, part in parts.items() if part is None]:
        raise ValueError(f"{broken[0]} is no whole table: the command that made the sweep makes it again")
    if not parts:
        raise ValueError(f"no chunk in {folder} is complete: run the sweep first")
    return pd.concat(parts.values(), ignore_index=True), _known(folder)


def _known(folder):
    """The plan that a folder states."""
    try:
        return json.loads((folder / PLAN).read_text())
    except ValueError as error:
        raise ValueError(f"{folder / PLAN} is no JSON ({error}): choose another folder, or remove this one") from None


def draw(scenario, space, runs=None, method="grid", seed=1, settings=None):
    """The points of a sweep, a dictionary each. Every key's values are tried on the scenario, so that a mistake is found before any run."""
    if not space:
        raise ValueError("the space is empty: give it a key")
    if method not in METHODS:
        raise ValueError(f"method is {method!r}: it must be one of {', '.join(METHODS)}")
    if method != "grid" and runs is None:
        raise ValueError(f"method {method!r} needs runs, the number of points")
    if method == "grid" and runs is not None:
        raise ValueError(f"runs = {runs} is for a sample: method \"random\" or \"sobol\"; a grid has as many as its values make")
    _whole("runs", runs, 1), _whole("seed", seed)
    for key, values in space.items():
        _check(values.steps if isinstance(values, Range) else len(values) if hasattr(values, "__len__") else 1, least=0)
    whole = {key: _tried(scenario, settings, key, values) for key, values in space.items()}
    if method == "grid":
        lists = [values.grid(whole[key]) if isinstance(values, Range) else values for key, values in space.items()]
        count = math.prod(map(len, lists))
        _check(count)
        return [dict(zip(space, map(plain, point))) for point in itertools.product(*lists)]
    _check(runs)
    shares = _shares(method, len(space), runs, seed)
    columns = []
    for share, (key, values) in zip(shares.T, space.items()):
        listed = None if isinstance(values, Range) else list(values)
        columns.append(values.at(share, whole[key]) if listed is None else [listed[int(x * len(listed))] for x in share])
    return [dict(zip(space, map(plain, point))) for point in zip(*columns)]


def lack(table, space):
    """What of the space has no result, in one sentence; None where every listed value has one and no run failed."""
    without = table["outcome"].isin(["refused", "failed"])
    failed = int((table["outcome"] == "failed").sum())
    clauses = [f"{failed} of {len(table)} runs failed by a defect of armplane; see `reason` in the table"] if failed else []
    if without.all():
        return "; ".join([*clauses, f"no run of {len(table)} has a result: {table['reason'].iloc[0]}"])
    for key, values in space.items():
        for value in [] if isinstance(values, Range) else values:
            those = table[key].map(_plain) == _plain(value)
            if those.any() and without[those].all():
                clauses.append(f"no run with {key} = {value} has a result: {table.loc[those, 'reason'].iloc[0]}")
    return "; ".join(clauses) or None


def _check(count, least=1):
    if not least <= count <= MOST:
        raise ValueError(f"the sweep has {count} runs: it must be 1 to {MOST}")


def _shares(method, keys, runs, seed):
    if method == "random":
        # A key of its own generator each: a longer sweep begins with the points of a shorter one.
        return np.stack([np.random.default_rng([seed, place]).random(runs) for place in range(keys)], axis=1)
    from scipy.stats import qmc

    return qmc.Sobol(keys, seed=seed).random_base2(max(runs - 1, 0).bit_length())[:runs]


def _tried(scenario, settings, key, values):
    """Whether a range is of whole numbers."""
    laid = lambda value: _armplane.check_scenario(str(scenario), as_settings({**(settings or {}), key: value}))
    if not isinstance(values, Range):
        if isinstance(values, str) or not hasattr(values, "__len__"):
            raise ValueError(f"{key} = {values!r}: give a list, [{values!r}]")
        if len(values) == 0:
            raise ValueError(f"{key} has no values")
        for value in values:
            laid(plain(value))
        return False
    if not (math.isfinite(values.low) and math.isfinite(values.high) and values.low < values.high):
        raise ValueError(f"{key}: the range from {values.low} to {values.high} is empty or has no end")
    if values.log and values.low <= 0:
        raise ValueError(f"{key}: a logarithmic range begins above 0, not at {values.low}")
    try:
        laid(float(values.low)), laid(float(values.high))
        return False
    except ValueError:
        if not (float(values.low).is_integer() and float(values.high).is_integer()):
            raise
        laid(int(values.low)), laid(int(values.high))
        return True


def _spread(chunks, job, client, jobs):
    """The rows of each chunk, as they come."""
    if client is not None:
        from distributed import as_completed

        futures = [client.submit(_rows, i, points, *job, pure=False, retries=3) for i, points in chunks.items()]
        yield from (future.result() for future in as_completed(futures))
        return
    import joblib

    work = (joblib.delayed(_rows)(i, points, *job) for i, points in chunks.items())
    # Threads: a trial leaves Python's lock, and nothing is left behind when this process is killed.
    yield from joblib.Parallel(n_jobs=jobs, backend="threading", return_as="generator_unordered")(work)


def _rows(first, points, *job):
    return first, [_row(first + i, point, _run(*job, point)) for i, point in enumerate(points)]


def _run(scenario, settings, run, point):
    """A row, for what cannot be loaded, too: each value was tried alone, but they may contradict each other, or the arm."""
    try:
        return run(scenario, {**settings, **point})
    except ValueError as error:
        return {"outcome": "refused", "reason": str(error)}


def _row(number, point, result):
    row = {"run": number, **point, "outcome": result.pop("outcome"), "reason": result.pop("reason")}
    return row | {name: ", ".join(map(str, value)) if isinstance(value, list) else value for name, value in result.items()}


def _claim(folder, plan, first):
    """Makes the folder the plan's, or checks that it is. `first`: the row of its first run, which changes with the program, the arm and the scenario's files."""
    folder.mkdir(parents=True, exist_ok=True)
    wanted = _plain({**plan, "first_run_sha256": hashlib.sha256(json.dumps(first, sort_keys=True).encode()).hexdigest()})
    if not (folder / PLAN).exists():
        if any(folder.iterdir()):
            raise ValueError(f"{folder} is not empty, and not a sweep's: choose another folder")
        write_whole(folder / PLAN, json.dumps(wanted, indent=1).encode())
    known = _known(folder)
    changed = [key for key in wanted if known.get(key) != wanted[key]]
    if changed == ["first_run_sha256"]:
        raise ValueError(f"{folder} holds results of another build, arm or scenario: its first run gives other bytes now; choose another folder")
    if changed:
        raise ValueError(f"{folder} holds another sweep (other {', '.join(changed)}): choose another folder")


def _plain(value):
    """As JSON has it."""
    other = lambda one: asdict(one) if isinstance(one, Range) else plain(one) if hasattr(one, "tolist") else list(one)
    return json.loads(json.dumps(value, default=other))
