"""Starts runs from Python, and reads their results as tables, without the Rerun viewer."""

import argparse
import contextlib
import functools
import html
import itertools
import json
import os
import shutil
import subprocess
import sysconfig
import tempfile
from collections.abc import Mapping
from pathlib import Path

from . import wire

INSTALL = "pip install the wheel that `python/build` makes (docs/python.md) with its extra [{}]"


def _program():
    """The program `armplane`: named by the environment variable ARMPLANE, beside this Python, from PATH, or built by cargo in a folder above."""
    path = os.pathsep.join([sysconfig.get_path("scripts"), os.environ.get("PATH", os.defpath)])
    if named := os.environ.get("ARMPLANE") or shutil.which("armplane", path=path):
        return named
    here = Path(__file__).resolve()
    for folder in [Path.cwd(), *Path.cwd().parents, *here.parents]:
        built = folder / "target/release/armplane"
        if built.is_file():
            return str(built)
    raise FileNotFoundError("there is no program `armplane` in PATH: install the wheel that `python/build` makes, or set ARMPLANE to its path")


class Parser(argparse.ArgumentParser):
    """Answers a mistake with one sentence, as the program does."""

    def parse_known_args(self, *given):
        known, unknown = super().parse_known_args(*given)
        if unknown:
            import difflib

            names = [name.lstrip("-") for name in self._option_string_actions]
            near = difflib.get_close_matches(unknown[0].lstrip("-").partition("=")[0], names, 1)
            self.error(f"{unknown[0]} is unknown{''.join(f' (did you mean --{name}?)' for name in near)}")
        return known, unknown

    def error(self, message):
        # Without `--`, the program gives its own help, which does not have these options.
        command, wrong = self.prog.split(), message.removeprefix("argument ")
        self.exit(2, f"{self.prog}: {wrong}: see {' '.join([*command[:2], '--', *command[2:], '--help'])}\n")


@contextlib.contextmanager
def extra(name):
    """Says of an import that fails within it which extra has what is missing."""
    try:
        yield
    except ImportError as error:
        raise ImportError(f"{error}: {INSTALL.format(name)}") from error


def _sentence(stderr):
    """The message of an error; with --json, it is an object on the last line."""
    last = (stderr.strip().splitlines() or [""])[-1]
    try:
        return json.loads(last)["error"]["message"]
    except (ValueError, KeyError, TypeError):
        return stderr.strip()


def _armplane(*arguments):
    done = subprocess.run([_program(), *map(str, arguments)], capture_output=True, text=True)
    if done.returncode not in (0, 1) or not done.stdout.strip():
        raise RuntimeError(_sentence(done.stderr) or f"armplane {arguments[0]} ended with exit code {done.returncode}")


class Run:
    """A finished run: `folder`, `summary` (as in summary.json), and its tables."""

    def __init__(self, folder):
        self.folder = Path(folder)
        if not (self.folder / "summary.json").is_file():
            raise FileNotFoundError(f"{folder} is not the folder of a finished run: it has no summary.json")
        self.summary = json.loads((self.folder / "summary.json").read_text())

    def __repr__(self):
        return f"Run({str(self.folder)!r}: {self.summary['scenario']}, {self.summary['outcome']})"

    @property
    def goal_reached(self):
        """Whether the hand followed its path to the goal."""
        return self.summary["outcome"] == "goal reached"

    def messages(self, topic):
        """Every message of a topic, in order: a structured `numpy` array with the fields of `armplane.wire`, nested ones too, `run.messages("torque")["tau"]`.

        Raises ValueError where the messages are of another layout. `armplane replay` and `armplane recover` say what a log lacks.
        """
        with extra("messages"):
            import numpy
            from mcap.reader import make_reader

        if topic not in wire.TOPICS:
            raise KeyError(f"there is no topic {topic!r}: there are {', '.join(wire.TOPICS)}")
        (structure, type_name, _), path = wire.TOPICS[topic], self.folder / "messages.mcap"
        dtype = numpy.dtype(structure)
        with open(path, "rb") as file:
            rows = [message.data[4:] for _, _, message in make_reader(file, validate_crcs=True).iter_messages([f"/{topic}"], log_time_order=False)]
        if any(len(row) != dtype.itemsize for row in rows):
            raise ValueError(f"{path} holds no {type_name}: use the package of the armplane that made the run")
        return numpy.frombuffer(b"".join(rows), dtype)

    def arrow(self, table="signals"):
        """The signals, one row per tick (or "events"), as a `pyarrow.Table`. Each field's metadata has `unit` and `description`."""
        with extra("notebook"):
            from pyarrow import parquet

        with tempfile.TemporaryDirectory() as folder:
            _armplane("export", self.folder, "--format", "parquet", "--out", folder)
            return parquet.read_table(f"{folder}/{table}.parquet")

    def pandas(self, table="signals"):
        """The same as a `pandas.DataFrame`. For polars, call `polars.from_arrow(run.arrow())`."""
        return self.arrow(table).to_pandas()

    @functools.cached_property
    def signals(self):
        """The signals, one row per tick, as a `pandas.DataFrame` (needs the extra `[notebook]`). docs/recording.md explains the columns' names."""
        return self.pandas()

    def view(self):
        """Opens the recording in the Rerun viewer. Raises RuntimeError if it is missing (`pip install rerun-sdk==0.36.3`)."""
        done = subprocess.run([_program(), "view", str(self.folder)], stderr=subprocess.PIPE, text=True)
        if done.returncode:
            raise RuntimeError(_sentence(done.stderr))

    def report(self):
        """Writes `report.html` into the run's folder: the arm under a slider, plots, tables, log. A notebook shows the page if its cell ends with this call."""
        _armplane("report", self.folder, "--json")
        return Page(self.folder / "report.html")

    def _repr_html_(self):
        task, joints = self.summary["task"], self.summary["joints"]
        rows = [
            ("outcome", f"{self.summary['outcome']}: {self.summary['reason']}"),
            ("orthogonal to ζ, at most", f"{task['orthogonal_max_mm']:.3f} mm, {task['orthogonal_max_deg']:.3f}°"),
            ("joint speed, torque, of the limit", f"{joints['speed_max_ratio']:.0%}, {joints['torque_max_ratio']:.0%}"),
            ("ticks", f"{self.summary['ticks']} at {self.summary['rate_hz']} Hz"),
            ("folder", str(self.folder)),
        ]
        cells = "".join(f"<tr><th>{name}</th><td>{html.escape(text)}</td></tr>" for name, text in rows)
        title = html.escape(f"{self.summary['scenario']} on {self.summary['robot']}")
        return f"<table><caption>{title}</caption>{cells}</table>"


class Page:
    """An HTML page at `path`, which a notebook shows."""

    def __init__(self, path):
        self.path = path

    def __repr__(self):
        return f"Page({str(self.path)!r})"

    def _repr_html_(self):
        return f'<iframe srcdoc="{html.escape(self.path.read_text())}" width="100%" height="800" style="border: 0"></iframe>'


def load(folder):
    """The run in a folder."""
    return Run(folder)


def run(scenario, settings=None, faults=None, seed=None, *, graph=None, plant=None, mode=None, out=None, record=True):
    """Runs a scenario (built-in name, or path of a file) to its end, and returns the `Run`.

    `settings`, `faults` and `seed` are those of `trial`. `plant="mujoco"` simulates the arm in MuJoCo. Raises `RuntimeError` with armplane's message if the run
    cannot start. A run that misses its goal raises nothing.
    """
    arguments = ["run", scenario, "--json"]
    for option, value in (("--graph", graph), ("--plant", plant), ("--mode", mode), ("--seed", seed)):
        if value is not None:
            arguments += [option, value]
    arguments += [f"--set={pair}" for pair in as_settings(settings, faults)]
    if not record:
        arguments.append("--no-record")
    folder = Path(out) if out is not None else _next_folder(Path(str(scenario)).stem)
    _armplane(*arguments, "--out", folder)
    return Run(folder)


def _next_folder(name):
    return next(folder for number in itertools.count(1) if not (folder := Path("runs", f"{name}-{number:03}")).exists())


def read_toml(path):
    """The tables of a TOML file. Raises ValueError where it is none."""
    try:
        import tomllib
    except ImportError:
        import tomli as tomllib
    return tomllib.loads(path.read_text())


def write_whole(path, content):
    """Writes a file that is there whole or not at all."""
    draft = path.with_suffix(".draft")
    with open(draft, "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    os.replace(draft, path)


def listed(given):
    """A list; one thing alone is a list of one."""
    return [given] if isinstance(given, (str, Mapping)) or not hasattr(given, "__iter__") else list(given)


def as_settings(settings, faults=None):
    """Settings and faults as KEY=VALUE."""
    if not isinstance(settings or {}, Mapping):
        raise ValueError(f'settings is {settings!r}: give a dictionary, such as {{"control.k_p": 900}}')
    chosen = dict(settings or {})
    if faults is not None:
        chosen["fault"] = listed(faults)
    return [f"{key}={toml(value)}" for key, value in chosen.items()]


def toml(value):
    """A value as TOML writes it; a text stays as it is, as with `--set`."""
    return value if isinstance(value, str) else _inner(value)


def plain(value):
    """Numbers and arrays of numpy and pandas as those of Python."""
    return value.tolist() if hasattr(value, "tolist") else value


def _inner(value):
    value = plain(value)
    if isinstance(value, dict):
        return f"{{{', '.join(f'{key} = {_inner(one)}' for key, one in value.items())}}}"
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(_inner, value))}]"
    # JSON has another word for a NaN.
    return repr(value) if isinstance(value, float) else json.dumps(value)
