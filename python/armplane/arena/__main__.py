"""`armplane arena`: laws and controllers of others on the same tasks, in one plant, under one judge; a page, a Parquet file, and a hash."""

import argparse
import concurrent.futures
import functools
import hashlib
import json
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import threading
import time
from importlib import metadata

from ..results import _armplane, _program, _sentence
from . import page, tasks

OWN = ("armplane", "damped-least-squares", "operational-space")
STRATEGY = {"armplane": "blended"}
# Trials of a law that is tuned; those of an opponent are in its class.
TRIALS = {"armplane": [{}, *({"control.k_p": k_v * k_v / 4, "control.k_v": k_v} for k_v in (20, 30, 60, 80))], "damped-least-squares": []}
TRIALS["damped-least-squares"] = [
    {"control.baseline.damped_least_squares.largest": largest, "control.baseline.damped_least_squares.onset": onset} for largest in (0.005, 0.02, 0.08) for onset in (0.02, 0.16)
]
OPPONENTS = sorted(path for path in (pathlib.Path(__file__).parent.parent / "opponents").glob("[!_]*.py"))
PACKAGES = ("daqp", "drake", "jparse-robotics", "mink", "mujoco", "numpy", "pin", "pin-pink", "placo", "robosuite")
# Longest run of a law on a task, s.
PATIENCE = 1800
# Columns that differ from one time to the next, or say nothing of the arm.
CLOCK = {"key", "median_us", "p99_us", "first_ms", "reason"}


class Entry:
    """A row of the table: a law under a name, with attributes (of a class) or settings (of a scenario) laid over its own."""

    def __init__(self, name, argument, own=False, **settings):
        self.name, self.argument, self.own, self.settings = name, argument, own, settings

    def options(self):
        """Arguments and environment of its runs."""
        text = lambda value: value if isinstance(value, str) else json.dumps(value)
        arguments = [part for key, value in self.settings.items() for part in ("--set", f"{key}={text(value)}")] if self.own else []
        return ["--law", self.argument, *arguments], {"ARMPLANE_ARENA": "" if self.own else json.dumps(self.settings, sort_keys=True)}


def entries(names):
    """The rows that are asked for: `NAME`, `NAME=FILE.py`, each with `:key=value` for another number; and what is left out, with the reason."""
    found, skipped = [], {}
    for text in names or [*OWN, *(path.stem for path in OPPONENTS)]:
        head, *pairs = text.split(":")
        settings = {key: _value(value) for key, _, value in (pair.partition("=") for pair in pairs)}
        name, _, file = head.partition("=")
        known = {path.stem: path for path in OPPONENTS}
        if not file and name not in known:
            if STRATEGY.get(name, name) not in strategies():
                sys.exit(f"armplane arena: there is no law {name}: give NAME=FILE.py for a file of yours, or one of {', '.join([*OWN, *known, *strategies()])}")
            found.append(Entry(text, STRATEGY.get(name, name), True, **settings))
            continue
        file = pathlib.Path(file or known[name]).resolve()
        reason = missing(file, settings)
        if reason:
            skipped[text] = reason
        else:
            found.append(Entry(name + "".join(f":{pair}" for pair in pairs), f"{name}={file}", **settings))
    return found, skipped


@functools.cache
def strategies():
    """The control laws of armplane."""
    schema = json.loads(subprocess.run([_program(), "generate", "schema", "scenario"], stdout=subprocess.PIPE, text=True, check=True).stdout)
    return [one["const"] for one in schema["$defs"]["Strategy"]["oneOf"]]


def _value(text):
    try:
        return json.loads(text)
    except ValueError:
        return text


def missing(file, settings):
    """Why an opponent cannot run here; empty: it can."""
    environment = {**os.environ, "ARMPLANE_ARENA": json.dumps(settings)}
    done = subprocess.run([sys.executable, "-m", "armplane.arena.host", str(file)], env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
    return "" if done.returncode == 0 else (done.stderr.strip().splitlines() or ["it ended without a word"])[-1]


def trials(entry):
    """The numbers that are tried when a law is tuned: at most six settings."""
    if entry.own:
        return TRIALS.get(entry.name, [])
    command = [sys.executable, "-m", "armplane.arena.host", entry.argument.partition("=")[2]]
    return json.loads(subprocess.run(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=True).stdout)


def tuned(found, table, folder, jobs):
    """Of each law that has trials its best on the training lines, as a row of its own: by S1 with clean torque, S1, S2, then the error orthogonal to ζ."""
    todo = tasks.make(folder / "training", _armplane, "short", tasks.TRAINING, tasks.TRAINED)
    entries = [(entry, Entry(f"{entry.name} {json.dumps(one)}", entry.argument, entry.own, **one)) for entry in found if not entry.settings for one in trials(entry)]
    rows = judged(table.fill([(trial, task) for _, trial in entries for task in todo], jobs))

    def worth(trial):
        mine = [row for row in rows if row["law"] == trial.name]
        count = lambda so: sum(bool(so(row)) for row in mine)
        return count(page.clean), count(lambda row: row.get("s1")), count(lambda row: row.get("s2")), -sum(min(row.get("orthogonal_max_mm", 1e3), 1e3) for row in mine)

    best = {}
    for entry, trial in entries:
        if entry.name not in best or worth(trial) > worth(best[entry.name]):
            best[entry.name] = trial
    for name, trial in best.items():
        print(f"{name} tuned: {json.dumps(trial.settings)}, {worth(trial)[0]} of {len(todo)} training lines", file=sys.stderr)
    return [Entry(f"{name} tuned", trial.argument, trial.own, **trial.settings) for name, trial in best.items()]


class Children:
    """The runs of now, each in a session of its own, so that Ctrl-C ends them in order: the arena first, then what it has started."""

    def __init__(self):
        self.lock, self.running, self.stopped = threading.Lock(), set(), False

    def run(self, command, environment):
        """Exit code, standard output and standard error of a program; `None` after [`stop`], or when it takes too long."""
        with self.lock:
            if self.stopped:
                return None
            child = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)
            self.running.add(child)
        try:
            out, error = child.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            child.send_signal(signal.SIGINT)
            child.communicate()
            return None
        finally:
            self.running.discard(child)
        return None if self.stopped else (child.returncode, out, error)

    def stop(self):
        with self.lock:
            self.stopped = True
            for child in self.running:
                child.send_signal(signal.SIGINT)


CHILDREN = Children()


def run(entry, task, more=()):
    """One law on one task, with `more` arguments of `armplane compare`: its row."""
    arguments, environment = entry.options()
    with tempfile.TemporaryDirectory() as folder:
        cost = pathlib.Path(folder) / "cost"
        command = [_program(), "compare", task.argument, *arguments, *more, "--out", f"{folder}/out", "--json"]
        row = {"law": entry.name, "task": task.name, "group": task.group, "task_hash": task.hash}
        done = CHILDREN.run(command, {**os.environ, **environment, "ARMPLANE_ARENA_COST": str(cost)})
        if done is None:
            return {**row, "outcome": "silent", "reason": f"no end within {PATIENCE} s"}
        code, out, error = done
        if code:
            return {**row, "outcome": "refused" if code == 2 else "failed", "reason": _sentence(error)}
        scenario = json.loads(out)["scenarios"][0]
        score = scenario["laws"][0]
        score.pop("law")
        row.update(robot=scenario["robot"], hash=score["hash"].pop("torque"), **{key: value for key, value in score.items() if isinstance(value, (bool, int, float, str))})
        row["missed"] = ", ".join(score["missed"])
        if cost.is_file():
            row.update(json.loads(cost.read_text().splitlines()[-1]))
        return row


def rates():
    """Of each arm the largest step of torque in a tick that a drive accepts, as a share of that joint's limit."""
    from armplane import Arm

    def rate(name):
        arm = Arm.builtin(name)
        return max(float(rate) / 1000 / float(effort) for rate, effort in zip(arm.torque_rate, arm.effort))

    return {name: rate(name) for name in Arm.names()}


def judged(rows):
    """The rows with the word whether no step of torque was beyond what the drives accept."""
    limits = rates()
    for row in rows:
        row["within_rate"] = row.get("torque_step_max_ratio", float("inf")) <= 1.001 * limits.get(row.get("robot"), 0.05)
    return rows


def digest(rows):
    """The hash of a table: every torque and every score, without what this machine's clock says."""
    plain = lambda value: float(value) if isinstance(value, int) else value
    scores = ({name: plain(value) for name, value in row.items() if name not in CLOCK and value is not None} for row in rows)
    lines = sorted(json.dumps(score, sort_keys=True) for score in scores)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]


def check(file):
    """Whether a table is the one that its hash names; its sentence."""
    from pyarrow import parquet

    table = parquet.read_table(file)
    found, stated = digest(table.to_pylist()), (table.schema.metadata or {}).get(b"hash", b"none").decode()
    return found == stated, f"{file}: hash {found}" + ("" if found == stated else f", but it states {stated}: it was changed")


def identity():
    """What decides over a row beside its law and task: the program, this package, and the versions of those of others."""
    here = pathlib.Path(__file__).parent
    files = [pathlib.Path(_program()), *(here / name for name in ("arm.py", "host.py", "laws.py")), *(here.parent / name for name in ("mujoco.py", "rotation.py"))]
    return [*(hashlib.sha256(file.read_bytes()).hexdigest() for file in files), versions()]


def versions():
    """The packages of others that are installed here, with their versions."""
    found = {}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


class Table:
    """The rows of a folder: what is there is not run again."""

    def __init__(self, folder, more):
        self.path, self.lock, self.rows, self.more = folder / "rows.jsonl", threading.Lock(), {}, more
        self.identity = [identity(), *more]
        for line in self.path.read_text().splitlines() if self.path.is_file() else []:
            try:
                row = json.loads(line)
            except ValueError:
                # The last line of an interrupted run.
                continue
            self.rows[row["key"]] = row
        with open(self.path, "w") as out:
            out.writelines(json.dumps(row) + "\n" for row in self.rows.values())

    def key(self, entry, task):
        source = pathlib.Path(entry.argument.partition("=")[2]).read_bytes() if not entry.own else b""
        parts = [self.identity, entry.name, entry.argument.partition("=")[0], entry.options()[1], hashlib.sha256(source).hexdigest(), task.name, task.hash]
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:24]

    def fill(self, cells, jobs):
        """Runs the cells that are missing, on all cores; all rows in the order of the cells."""
        left = [(entry, task) for entry, task in cells if self.key(entry, task) not in self.rows]
        done, began = 0, time.monotonic()

        def one(cell):
            nonlocal done
            row = {**run(*cell, self.more), "key": self.key(*cell)}
            if CHILDREN.stopped:
                # It was ended with the arena.
                return
            with self.lock:
                done += 1
                self.rows[row["key"]] = row
                with open(self.path, "a") as out:
                    out.write(json.dumps(row) + "\n")
                minutes = (time.monotonic() - began) / done * (len(left) - done) / 60
                why = f" ({row['reason']})" if row["outcome"] in ("failed", "refused", "silent") else ""
                print(f"{done} of {len(left)}, {minutes:.0f} min left: {row['law']} on {row['task']}: {row['outcome']}{why}", file=sys.stderr, flush=True)

        with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
            try:
                for future in [pool.submit(one, cell) for cell in left]:
                    future.result()
            except KeyboardInterrupt:
                CHILDREN.stop()
                pool.shutdown(cancel_futures=True)
                raise
        # An opponent may have written to the file.
        self.path.write_text("".join(json.dumps(row) + "\n" for row in self.rows.values()))
        return [self.rows[self.key(entry, task)] for entry, task in cells]


def again(found, todo, rows, count, more):
    """Runs the first `count` tasks of each law a second time; the cells whose torques differ."""
    known = {(row["law"], row["task"]): row for row in rows}
    cells = [(entry, task) for entry in found for task in todo[:count]]
    return [f"{entry.name} on {task.name}" for entry, task in cells if run(entry, task, more).get("hash") != known[entry.name, task.name].get("hash")]


def save(folder, rows, digest):
    """The table as Parquet, with its hash."""
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError as error:
        print(f"no arena.parquet: {error}: pip install 'armplane[arena]'", file=sys.stderr)
        return
    names = sorted({name for row in rows for name in row} - {"key"})
    table = pyarrow.table({name: [row.get(name) for row in rows] for name in names})
    parquet.write_table(table.replace_schema_metadata({"hash": digest}), folder / "arena.parquet")


def arguments():
    parser = argparse.ArgumentParser("armplane arena", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, epilog=tasks.__doc__)
    parser.add_argument("--law", action="append", metavar="NAME[=FILE.py][:KEY=VALUE]", help="a law of armplane, an opponent, or a file of yours; repeatable [default: all that are installed]")
    parser.add_argument("--size", choices=tuple(tasks.SIZES), default="main", help="how many tasks [default: main]")
    parser.add_argument("--robot", action="append", help="only lines of these arms; repeatable")
    parser.add_argument("--seed", type=int, default=tasks.TEST, help=f"seed of the lines [default: {tasks.TEST}; tune on {tasks.TRAINING}]")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a value of every task: plant.mass_factor=1.1, plant.encoder_noise_counts=2; repeatable")
    parser.add_argument("--plant", help="mujoco: the same tasks in MuJoCo")
    parser.add_argument("--out", default="runs/arena", help="folder, which the same command continues [default: runs/arena]")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="runs at once [default: a core each]")
    parser.add_argument("--tune", action="store_true", help="add a row of each law tuned: the best of at most six settings on lines of another seed")
    parser.add_argument("--again", type=int, default=0, metavar="N", help="then run N tasks of each law a second time, and compare every torque")
    parser.add_argument("--check", metavar="FILE", help="compute the hash of an arena.parquet, and compare it with the one that it states")
    return parser.parse_args()


def main():
    asked = arguments()
    if asked.check:
        holds, sentence = check(asked.check)
        print(sentence)
        sys.exit(not holds)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        compete(asked)
    except KeyboardInterrupt:
        CHILDREN.stop()
        sys.exit("armplane arena: stopped; the same command goes on from here")


def compete(asked):
    folder = pathlib.Path(asked.out)
    more = [*(part for pair in asked.set for part in ("--set", pair)), *(["--plant", asked.plant] if asked.plant else [])]
    found, skipped = entries(asked.law)
    for name, reason in skipped.items():
        print(f"{name} is left out: {reason}", file=sys.stderr)
    if not found:
        sys.exit("no law is left to run")
    try:
        todo = tasks.make(folder / "tasks", _armplane, asked.size, asked.seed, asked.robot or tasks.ARMS)
    except RuntimeError as error:
        sys.exit(str(error))
    table = Table(folder, more)
    if asked.tune:
        found += tuned(found, table, folder, asked.jobs)
    rows = judged(table.fill([(entry, task) for task in todo for entry in found], asked.jobs))
    found_hash = digest(rows)
    save(folder, rows, found_hash)
    summary = page.Summary(rows, skipped, versions(), found_hash)
    (folder / "arena.html").write_text(summary.html())
    print(summary.text())
    print(f"{folder}/arena.html, {folder}/arena.parquet")
    if asked.again:
        different = again(found, todo, rows, asked.again, more)
        print(f"a second time, every torque compared: {len(different)} differ" + "".join(f"\n  {cell}" for cell in different))
        sys.exit(bool(different))


if __name__ == "__main__":
    main()
