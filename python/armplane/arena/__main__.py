"""`armplane arena`: runs laws and controllers of others on the same tasks, in one plant, under one judge. Writes a page, a Parquet file, and a hash."""

import argparse
import concurrent.futures
import ctypes
import fcntl
import functools
import hashlib
import itertools
import json
import math
import os
import shlex
import signal
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass, field, replace
from importlib import metadata
from pathlib import Path

import armplane

from ..results import INSTALL, Parser, _program, _sentence, as_settings, write_whole
from . import GIVEN_CLOCK as BASE
from . import NO_HINTS, OPPONENTS, OWN_CLOCK, tasks
from .children import CHILDREN
from .tasks import DATA

try:
    import pyarrow
    from pyarrow import parquet

    from .. import _armplane
    from . import page, picture
except ImportError as error:
    # Its help can be read without them.
    LACK = f"armplane arena: {error}: {INSTALL.format('arena')}"
else:
    LACK = None

# The end of the name of a law's tuned row.
TUNED = " tuned"
# Longest run of a law on a task, and longest time in which an opponent loads and joins it (--join-limit); s.
LONGEST, MOST_TRIALS = {"run": 1800, "join": 120}, 6
SILENT = {"outcome": "silent", "reason": f"no end within {LONGEST['run']} s"}
# The graph of a run under an opponent: compilers and large packages are at work before its first answer.
GRAPH = """extends = "armplane"
[[process]]
name = "controller"
command = {command}
restart = "never"
answer_limit_s = {join}
join_limit_s = {join}
reads = ["estimate", "singularity"]
writes = ["control_state", "torque"]
"""
# The ticks by which an estimate is late in the row that has its name.
LATE = "delay 2 ticks"
# Columns that differ from one time to the next, or say nothing of the arm.
CLOCK = {"key", "median_us", "p99_us", "first_ms", "reason"}


def sets(settings):
    """The arguments of a run with these settings."""
    return [f"--set={one}" for one in as_settings(settings)]


@dataclass
class Entry:
    """A row of the table: a law of armplane with scenario settings, or the file of an opponent with attributes of its class.

    `about`: trials for tuning, and whether the class has a clock of its own to switch on.
    """

    name: str
    argument: str
    own: bool = False
    about: dict = field(default_factory=dict)
    settings: dict = field(default_factory=dict)

    def with_settings(self, name, **settings):
        return replace(self, name=name, settings={**self.settings, **settings})

    def scenario(self):
        """What its runs override in a task."""
        return {"control.strategy": self.argument, **self.settings} if self.own else {}

    def attributes(self):
        """What is laid over an opponent's class, as JSON."""
        return "" if self.own else json.dumps(self.settings, sort_keys=True)

    def graph(self, folder):
        """Writes the graph of an opponent's run."""
        path = Path(folder) / "graph.toml"
        path.write_text(GRAPH.format(command=json.dumps([sys.executable, "-m", "armplane.arena.host", self.argument]), join=LONGEST["join"]))
        return str(path)


def entries(names):
    """The requested rows (`NAME` or `NAME=FILE.py`, each with `:key=value` for another number), and the reason for each one left out."""
    found, skipped = {}, {}
    for text in names or [*DATA["own"], *OPPONENTS]:
        head, *pairs = text.split(":")
        settings = {key: _value(value) for key, _, value in (pair.partition("=") for pair in pairs)}
        name, _, file = head.partition("=")
        title, strategy, file = ":".join([name, *pairs]), DATA["strategy"].get(name, name), file or OPPONENTS.get(name)
        if file:
            file = Path(file).resolve()
            if not file.is_file():
                refuse(f"there is no file {file}: give the path of an opponent that exists")
            reason, about = asked_file(file, settings)
            if reason:
                skipped[text] = reason
                continue
            entry = Entry(title, str(file), False, about, settings)
        elif strategy in armplane.laws(all=True):
            entry = Entry(title, strategy, True, settings=settings)
        else:
            refuse(f"there is no law {name}: give NAME=FILE.py for a file of yours, or one of {', '.join([*DATA['own'], *OPPONENTS, *armplane.laws()])}")
        if title in found:
            refuse(f"two laws are called {title}: give one of them another name, NAME=FILE.py")
        found[title] = entry
    return [*found.values()], skipped


def _value(text):
    try:
        return json.loads(text)
    except ValueError:
        return text


def asked_file(file, settings):
    """The reason why an opponent cannot run here (empty if it can), and the facts about its class."""
    command = [sys.executable, "-m", "armplane.arena.host", str(file)]
    done = CHILDREN.run(command, LONGEST["join"], ARMPLANE_ARENA=json.dumps(settings))
    if done is None:
        return f"it does not load within {LONGEST['join']} s: --join-limit allows more", {}
    code, out, error = done
    if code:
        return (error.strip().splitlines() or ["it ended without a word"])[-1], {}
    try:
        about = json.loads(next(line for line in out.splitlines() if line.startswith('{"trials": ')))
    except (StopIteration, ValueError):
        return "it ends, or replaces the standard output, before it has said the facts about its class", {}
    count = len(about["trials"])
    return f"its class has {count} trials: at most {MOST_TRIALS}" if count > MOST_TRIALS else "", about


def tuned(found, table, folder, jobs):
    """For each law with trials, a row with the best of them on the training lines: by S1 with clean torque, S1, S2, then the error orthogonal to ζ."""
    todo, _ = tasks.make(folder / "training", "short", tasks.TRAINING, tasks.TRAINED)
    trials = lambda entry: DATA["trials"].get(entry.name, []) if entry.own else entry.about["trials"]
    entries = [(entry, entry.with_settings(f"{entry.name} {json.dumps(one)}", **one)) for entry in found if ":" not in entry.name for one in trials(entry)]
    if not entries:
        return []
    laws = page.Summary(judged(table.fill([(trial, task, BASE) for _, trial in entries for task in todo], jobs)), {}, {}, "").laws

    def worth(trial):
        mine = laws[trial.name]
        return mine.clean.sum(), mine.s1.sum(), mine.s2.sum(), -mine.orthogonal_max_mm.fillna(1e3).clip(upper=1e3).sum()

    out = []
    for name, those in itertools.groupby(entries, key=lambda one: one[0].name):
        best = max((trial for _, trial in those), key=worth)
        print(f"{name} tuned: {json.dumps(best.settings)}, {worth(best)[0]} of {len(todo)} training lines", file=sys.stderr)
        out.append(best.with_settings(name + TUNED))
    return out


def run(entry, task, condition, more=()):
    """The row of one law on one task under a condition, with `more` arguments of `armplane run`."""
    row = {"law": entry.name, "task": task.name, "group": task.group, "condition": condition, "task_hash": task.hash}
    more = [*more, *sets(DATA["varied"].get(condition, {}))]
    with tempfile.TemporaryDirectory() as folder:
        found = one_run(entry, task.copied(folder), folder, more) if "--plant" in more else tried(entry, task, folder, more)
        if condition == LATE:
            found = after_delay(found)
        found.update(stated_cost(Path(folder) / "cost"))
        if entry.own and task.is_varied and condition == BASE:
            found["median_us"] = own_cost(entry, task, folder, more)
        return {**row, **found}


def stated_cost(file):
    """The times that an opponent's process has written, and nothing else from there: it can write what it likes."""
    with suppress(OSError, ValueError, LookupError, TypeError):
        stated = json.loads(file.read_text().splitlines()[-1])
        times = {name: float(stated[name]) for name in ("median_us", "p99_us", "first_ms")}
        if all(map(math.isfinite, times.values())):
            return times
    return {}


def _scalars(values):
    return {key: value for key, value in values.items() if isinstance(value, (bool, int, float, str))}


class Sent(armplane.Controller):
    """Sends again what an opponent has sent in its own process, from a file: this process judges it."""

    file = ""

    def setup(self):
        self.messages = open(self.file, "rb")

    def control(self, tick, estimate, singularity, state, torque):
        for message in state, torque:
            if self.messages.readinto(message) != ctypes.sizeof(message):
                raise ValueError(f"its messages end before tick {tick}")

    def end(self):
        self.messages.close()


def tried(entry, task, folder, more):
    """The numbers of a law, by a trial on this thread; an opponent has one of its own before, whose messages are taken up."""
    text, settings, controller = task.text or task.name, dict(one.removeprefix("--set=").split("=", 1) for one in more), None
    if not entry.own:
        sent, cost = f"{folder}/sent", f"{folder}/cost"
        given = {"scenario": text, "settings": settings, "file": sent, "environment": {"ARMPLANE_ARENA": entry.attributes(), "ARMPLANE_ARENA_COST": cost}}
        why = CHILDREN.opponent(entry.argument, LONGEST["join"]).controls(given, LONGEST["run"])
        if why != "":
            # After any failure the next trial has another process.
            CHILDREN.dismiss()
            return dict(SILENT) if why is None else {"outcome": "failed", "reason": why}
        controller = type("Sent", (Sent,), {"file": sent})
    try:
        row = armplane.trial(text, {**settings, **entry.scenario()}, controller=controller)
    except (ValueError, OSError) as error:
        if entry.own:
            raise
        why = "it left none" if isinstance(error, FileNotFoundError) else _sentence(str(error))
        return {"outcome": "failed", "reason": f"its messages cannot be judged: {why}"}
    if "ticks" not in row:
        return row
    # The table has its own name for it.
    del row["law"]
    return {**_scalars(row), "hash": row["hash"]["torque"], "missed": ", ".join(row["missed"])}


def one_run(entry, scenario, folder, more, record=False):
    """The same numbers from `armplane run` in `folder`/run, which has other plants, and records."""
    law = sets(entry.scenario()) if entry.own else ["--graph", entry.graph(folder)]
    command = [_program(), "run", str(scenario), *law, *more, *([] if record else ["--no-record"]), "--out", f"{folder}/run", "--json"]
    done = CHILDREN.run(command, LONGEST["run"], ARMPLANE_ARENA=entry.attributes(), ARMPLANE_ARENA_COST=f"{folder}/cost")
    return told(done, Path(folder) / "run/summary.json")


def told(done, file):
    """The numbers of a run that has ended, from its summary."""
    if done is None:
        return dict(SILENT)
    code, _, error = done
    if code not in (0, 1) or not file.is_file():
        return {"outcome": "refused" if code == 2 else "failed", "reason": _sentence(error)}
    summary = json.loads(file.read_text())
    near, task = summary["singularities"], summary["task"]
    found = {**_scalars(task), **_scalars(summary["joints"]), "missed": ", ".join(task["missed"])}
    found |= {key: summary[key] for key in ("robot", "ticks", "completed", "outcome", "reason")} | ({"s_min": min(one["s_min"] for one in near)} if near else {})
    return {**found, "inside_ticks": sum(one["inside_ticks"] for one in near), "hash": summary["topics"].get("torque", {}).get("hash", "")}


def after_delay(row):
    """The row without the ticks in which the delay begins: the drive holds the last torque, which counts as a stop."""
    if "joint stop" in row.get("missed", "") and row["stopped_ticks"] <= DATA["varied"][LATE]["fault"][0]["delay_ticks"]:
        missed = [one for one in row["missed"].split(", ") if one != "joint stop"]
        row["missed"], row["s2"] = ", ".join(missed), not missed
        # S1: as narrow as S2 but for the orientation, and free along ζ.
        row["s1"] = not set(missed) - {"along"} and row["orthogonal_max_deg"] <= _armplane.orthogonal_bar_deg()
    return row


def own_cost(entry, task, folder, more):
    """Microseconds that a law of armplane takes for a tick: the medians of analysis and law, in processes of their own like those of others."""
    if "ticks" not in one_run(entry, task.copied(folder), folder, more):
        return None
    latency = json.loads((Path(folder) / "run/summary.json").read_text())["latency_us"]
    return sum(latency[name]["p50"] for name in ("analyzer", "controller") if name in latency)


def judged(rows):
    """The rows, marked whether the drives accept all their torque steps."""
    # The largest step in a millisecond that a drive accepts, as a share of that joint's limit.
    names = {row.get("robot") for row in rows}.intersection(armplane.Arm.names())
    limits = {name: float(max(arm.torque_rate / arm.effort)) / 1000 for name in names for arm in [armplane.Arm.builtin(name)]}
    for row in rows:
        row["within_rate"] = row.get("torque_step_max_ratio", float("inf")) <= 1.001 * limits.get(row.get("robot"), 0.05)
    return rows


def digest(rows):
    """The hash of a table: every torque and score, but no measured time."""
    plain = lambda value: float(value) if isinstance(value, int) else value
    scores = ({name: plain(value) for name, value in row.items() if name not in CLOCK and value is not None} for row in rows)
    lines = sorted(json.dumps(score, sort_keys=True) for score in scores)
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]


def refuse(reason):
    """Ends the program, which has not begun."""
    print(f"armplane arena: {reason}", file=sys.stderr)
    sys.exit(2)


def check(file):
    """Whether a table fits its hash, and the sentence that says so."""
    try:
        table = parquet.read_table(file)
    except (OSError, pyarrow.ArrowException) as error:
        refuse(f"{file} is not a table of the arena: give the arena.parquet that it wrote ({_sentence(str(error))})")
    found, stated = digest(table.to_pylist()), (table.schema.metadata or {}).get(b"hash", b"none").decode()
    return found == stated, f"{file}: hash {found}" + ("" if found == stated else f", but it states {stated}: it was changed")


def identity():
    """Everything that a row depends on besides its law and task: the program and its module, this package, and the versions of the others' packages."""
    here, programs = Path(__file__).parent, (_program(), _armplane.__file__)
    return [*(hashlib.sha256(Path(file).read_bytes()).hexdigest() for file in programs), sources(here), sources(here.parent), versions()]


def versions():
    """The installed packages of others, with their versions."""
    found = {}
    for name in DATA["packages"]:
        with suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    return found


@functools.cache
def sources(folder):
    """A hash of the Python files of a folder: an opponent may import those beside it."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in sorted(folder.glob("*.py")))).hexdigest()


class Table:
    """The rows of a folder, which are not run again."""

    def __init__(self, folder, more):
        self.path, self.rows, self.more, self.identity = folder / "rows.jsonl", {}, more, [identity(), *more]
        for line in self.path.read_text().splitlines() if self.path.is_file() else []:
            # Not so the last line of an interrupted run.
            with suppress(ValueError, LookupError, TypeError):
                row = json.loads(line)
                self.rows[row["key"]] = row

    def hold(self):
        """Takes the folder for this arena: two would lose rows to each other."""
        self.held = open(self.path, "a")
        try:
            fcntl.flock(self.held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            refuse(f"another arena works in {self.path.parent}: give this one another folder with --out")
        self.write()

    def write(self):
        """The rows as they are known here, whatever has come to the file."""
        self.path.write_text("".join(f"{json.dumps(row)}\n" for row in self.rows.values()))

    def key(self, entry, task, condition):
        source = "" if entry.own else sources(Path(entry.argument).parent)
        parts = [self.identity, entry.name, entry.scenario(), entry.attributes(), source, task.name, task.hash, condition]
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:24]

    def fill(self, cells, jobs):
        """Runs the cells that are missing, on all cores; all rows in the order of the cells."""
        # Law by law: an opponent's process takes one run after another.
        left, began = sorted((cell for cell in cells if self.key(*cell) not in self.rows), key=lambda cell: cell[0].argument), time.monotonic()
        cores = itertools.cycle(sorted(os.sched_getaffinity(0)))
        # A run's processes inherit the core of the thread that starts them, and take turns on it.
        spread = lambda: os.sched_setaffinity(0, {next(cores)}) if jobs > 1 else None
        with concurrent.futures.ThreadPoolExecutor(jobs, initializer=spread) as pool:
            try:
                found = {pool.submit(run, *cell, self.more): self.key(*cell) for cell in left}
                for done, future in enumerate(concurrent.futures.as_completed(found), 1):
                    row = {**future.result(), "key": found[future]}
                    self.rows[row["key"]] = row
                    with open(self.path, "a") as out:
                        print(json.dumps(row), file=out)
                    minutes = (time.monotonic() - began) / done * (len(left) - done) / 60
                    why = f" ({row['reason']})" if row["outcome"] in ("failed", "refused", "silent") else ""
                    ended = f"{row['law']} on {row['task']}, {row['condition']}: {row['outcome']}{why}"
                    print(f"{done} of {len(left)}, {minutes:.0f} min left: {ended}", file=sys.stderr, flush=True)
            except KeyboardInterrupt:
                CHILDREN.stop()
                pool.shutdown(cancel_futures=True)
                raise
            finally:
                CHILDREN.close()
        # An opponent may have written to the file.
        self.write()
        return [self.rows[self.key(*cell)] for cell in cells]


def again(found, todo, rows, count, more):
    """Runs the first `count` tasks of each law a second time, in the processes of a run, and returns the cells whose torques differ."""
    known = {(row["law"], row["task"]): row for row in rows if row["condition"] == BASE}
    different = []
    for entry, task in itertools.product(found, todo[:count]):
        with tempfile.TemporaryDirectory() as folder:
            if one_run(entry, task.copied(folder), folder, more).get("hash") != known[entry.name, task.name].get("hash"):
                different.append(f"{entry.name} on {task.name}")
    return different


def save(folder, rows, digest, command):
    """The table as Parquet, with its hash and the command that made it."""
    names = sorted({name for row in rows for name in row} - {"key"})
    table, file = pyarrow.table({name: [row.get(name) for row in rows] for name in names}), pyarrow.BufferOutputStream()
    parquet.write_table(table.replace_schema_metadata({"hash": digest, "command": command}), file)
    write_whole(folder / "arena.parquet", file.getvalue())


def positive(text):
    """An option's number of at least 1."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number from 1")
    return int(text)


def arguments():
    parser = Parser("armplane arena", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter, epilog=tasks.__doc__)
    add = parser.add_argument
    add("--law", action="append", metavar="NAME[=FILE.py][:KEY=VALUE]", help="a law of armplane, an opponent, or a file of yours; repeatable [default: all that are installed]")
    add("--size", choices=tuple(DATA["sizes"]), default="short", help="how many tasks [default: short]")
    add("--robot", action="append", help="only lines of these arms; repeatable")
    add("--lines", type=positive, default=sys.maxsize, metavar="N", help="at most N lines of each kind an arm")
    add("--seed", type=int, default=tasks.TEST, help=f"seed of the lines [default: {tasks.TEST}; tune on {tasks.TRAINING}]")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="a value of every task: plant.mass_factor=1.1, plant.encoder_noise_counts=2; repeatable")
    add("--plant", help="mujoco: the same tasks in MuJoCo")
    add("--out", default="runs/arena", help="folder, which the same command continues [default: runs/arena]")
    add("--jobs", type=positive, default=os.cpu_count(), help="runs at once [default: a core each]")
    add("--join-limit", type=positive, default=LONGEST["join"], metavar="SECONDS", help=f"longest time in which an opponent loads and joins a run [default: {LONGEST['join']}]")
    add("--tracks", action="store_true", help="add the tracks: each opponent's own clock, which slows where a limit demands it, and the paper's tasks without hints")
    add("--varied", action="store_true", help="add payload +-10 %%, encoder noise x 4, and estimates two ticks late, on the first lines of each arm")
    add("--tune", action="store_true", help="add a row of each law tuned: the best of at most six settings on lines of another seed")
    add("--again", type=int, default=0, metavar="N", help="then run N tasks of each law a second time, in processes, and compare every torque")
    add("--check", metavar="FILE", help="compute the hash of an arena.parquet, and compare it with the one that it states")
    return parser.parse_args()


def main():
    asked = arguments()
    if LACK:
        print(LACK, file=sys.stderr)
        sys.exit(2)
    if asked.check:
        holds, sentence = check(asked.check)
        print(sentence)
        sys.exit(not holds)
    LONGEST["join"] = asked.join_limit
    for number in (signal.SIGTERM, signal.SIGINT):
        # A shell lets what it runs in the background ignore Ctrl-C.
        signal.signal(number, signal.default_int_handler)
    try:
        compete(asked)
    except KeyboardInterrupt:
        CHILDREN.stop()
        sys.exit("armplane arena: stopped; the same command goes on from here")
    finally:
        CHILDREN.close()


def conditions(asked, found, todo):
    """The runs of the other tracks, and the varied ones, which tuned rows do without. A law without its own clock, or a task without a hint, keeps its rows."""
    cells = []
    if asked.tracks:
        slowing = [entry.with_settings(entry.name, own_clock=True) for entry in found if entry.about.get("has_clock") and not entry.settings.get("own_clock")]
        cells += [(entry, task, OWN_CLOCK) for task in todo for entry in slowing]
        cells += [(entry, task, NO_HINTS) for task in tasks.unhinted(todo) for entry in found]
    if asked.varied:
        own = [entry for entry in found if not entry.name.endswith(TUNED)]
        cells += [(entry, task, condition) for task in todo if task.is_varied for condition in DATA["varied"] for entry in own]
    return cells


def races(summary, found, todo, more):
    """Ours and the best of the others on up to three tasks, tick by tick: one that only they do, one that only we do, one that both do."""
    entries, places, out = {entry.name: entry for entry in found}, {task.name: task for task in todo}, []
    for heading, name in summary.contests():
        curves = {}
        for law in summary.rivals():
            with tempfile.TemporaryDirectory() as folder:
                ended = one_run(entries[law], places[name].copied(folder), folder, more, record=True)
                curves[law] = picture.curves(folder) if ended.get("ticks") else None
        out.append((heading, name, curves))
    return out


def compete(asked):
    folder = Path(asked.out)
    more = [*(f"--set={pair}" for pair in asked.set), *(["--plant", asked.plant] if asked.plant else [])]
    if folder.exists() and not folder.is_dir():
        refuse(f"{folder} is a file: give a folder with --out")
    # Before the first line of an opponent runs: it may write to the file.
    table = Table(folder, more)
    found, skipped = entries(asked.law)
    for name, reason in skipped.items():
        print(f"{name} is left out: {reason}", file=sys.stderr)
    if not found:
        refuse("no law is left to run")
    try:
        todo, arms_out = tasks.make(folder / "tasks", asked.size, asked.seed, asked.robot, asked.lines)
    except ValueError as error:
        refuse(error)
    skipped.update(arms_out)
    if not todo:
        refuse(f"no task is left to run: {'; '.join(f'{arm}: {reason}' for arm, reason in arms_out.items())}")
    table.hold()
    if asked.tune:
        found += tuned(found, table, folder, asked.jobs)
    cells = [(entry, task, BASE) for task in todo for entry in found] + conditions(asked, found, todo)
    rows = judged(table.fill(cells, asked.jobs))
    found_hash = digest(rows)
    command = shlex.join(["armplane", "arena", *sys.argv[1:]])
    save(folder, rows, found_hash, command)
    summary = page.Summary(rows, skipped, versions(), found_hash, command)
    print(summary.text())
    (folder / "arena.html").write_text(summary.html(races(summary, found, todo, more)))
    print(f"{folder}/arena.html, {folder}/arena.parquet")
    ended = {row["law"] for row in rows if row["outcome"] not in ("failed", "silent")}
    if lost := [entry.name for entry in found if entry.name not in ended]:
        print(f"armplane arena: every run failed of {', '.join(lost)}", file=sys.stderr)
    if asked.again:
        different = again(found, todo, rows, asked.again, more)
        print(f"a second time, every torque compared: {len(different)} differ" + "".join(f"\n  {cell}" for cell in different))
        lost += different
    sys.exit(bool(lost))


if __name__ == "__main__":
    main()
