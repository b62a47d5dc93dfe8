"""The commands `armplane sweep`, `armplane figures` and `armplane servo --seeds`."""

import json
import sys
from pathlib import Path

import armplane

from ..results import INSTALL, Parser, _next_folder, listed, read_toml

# Of a sweep's file and its tables: the kinds of the keys that it needs, and of others.
KEYS = {
    "": ({"name": "text", "scenario": "text", "key": "list of tables"}, {"set": "list", "sample": "table"}),
    "sample: ": ({"runs": "number"}, {"seed": "number", "method": "text"}),
    "key: ": ({"key": "text"}, {"values": "list", "from": "number", "to": "number", "steps": "whole number", "scale": "text"}),
}
KINDS = {"text": str, "list": list, "table": dict, "list of tables": (dict, list), "number": (int, float), "whole number": int}


def main():
    parser = Parser(prog="armplane")
    commands = parser.add_subparsers(dest="command", required=True)
    sweep = commands.add_parser("sweep")
    sweep.add_argument("file", type=Path, help="the sweep's TOML file")
    sweep.add_argument("--out", type=Path, help="folder for the results; goes on with a sweep begun there [default: runs/NAME]")
    sweep.add_argument("--jobs", type=int, default=-1, help="number of threads [default: all cores]")
    sweep.add_argument("--dask", metavar="ADDRESS", help="run on the workers of this dask scheduler")
    report = commands.add_parser("report", prog="armplane sweep report")
    report.add_argument("folder", type=Path, help="the sweep's folder")
    report.add_argument("--by", default="position_max_mm", help="column that ranks the worst runs and colours the map [default: %(default)s]")
    report.add_argument("--map", type=lambda text: text.split(","), help="KEY,KEY: the axes of the map [default: the first two]")
    report.add_argument("--worst", type=int, default=10, help="number of worst runs to list [default: %(default)s]")
    figures = commands.add_parser("figures")
    figures.add_argument("--out", type=Path, help="folder for the figures [default: the next free runs/figures-NNN]")
    figures.add_argument("--set", action="append", default=[], help="override a value of every scenario, for example plant.encoder_bits=0 (repeatable)")
    steered = commands.add_parser("steered")
    steered.add_argument("robots", nargs="*", default=["puma560", "ur5", "iiwa14", "panda"])
    steered.add_argument("--seeds", type=int, default=1)
    steered.add_argument("--duration", type=float, default=60.0)
    steered.add_argument("--set", action="append", default=[])
    for command in (sweep, report, figures, steered):
        command.add_argument("--json", action="store_true")
    options = parser.parse_args()
    try:
        armplane.trial  # of the extension module
        from armplane import experiments

        return {"sweep": _sweep, "report": _report, "figures": _figures, "steered": _steered}[options.command](experiments, options)
    except ModuleNotFoundError as error:
        print(f"armplane: {error}: {INSTALL.format('experiments')}{' and dask[distributed]' if error.name == 'distributed' else ''}", file=sys.stderr)
        return 2
    except (ValueError, OSError, ImportError) as error:
        print(f"armplane: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"armplane: stopped; the same command {'goes on' if options.command == 'sweep' else 'begins anew'}", file=sys.stderr)
        return 130


def _sweep(experiments, options):
    name, arguments = read_file(options.file)
    out = options.out or Path("runs") / name
    client = None
    if options.dask:
        from distributed import Client

        client = Client(options.dask)
    table = experiments.sweep(**arguments, out=out, jobs=options.jobs, client=client, progress=_progress)
    lack = experiments.lack(table, arguments["space"])
    outcomes = {key: int(count) for key, count in table["outcome"].value_counts().items()}
    if options.json:
        print(json.dumps({"folder": str(out), "runs": len(table), "outcomes": outcomes, "lack": lack}))
    else:
        print(f"{len(table)} runs: {', '.join(f'{outcome} {count}' for outcome, count in outcomes.items())}\n{out}")
        print(f"  runs-*.parquet  one row per run: `table, plan = armplane.experiments.read('{out}')`\n  look at it with: armplane sweep report {out}")
    if lack:
        print(f"armplane: {lack}", file=sys.stderr)
    return 1 if lack else 0


def _report(experiments, options):
    result = experiments.report(options.folder, options.by, options.map, options.worst)
    from .reports import text

    print(json.dumps(result) if options.json else f"{text(result)}\n\n{options.folder}\n  report.svg, .pdf, .png and .json")
    return 0


def _figures(experiments, options):
    settings = dict(_setting(one) for one in options.set)
    out = options.out or _next_folder("figures")
    numbers = experiments.figures(out, settings)
    print(json.dumps(numbers) if options.json else f"{out}\n  fig1-2, fig3, fig4, fig5: .svg, .pdf and .png; figures.json")
    return 0


def _steered(experiments, options):
    settings = dict(_setting(one) for one in options.set)
    table = experiments.steered(options.robots, range(1, options.seeds + 1), options.duration, settings)
    print(table.to_json(orient="records") if options.json else table.to_string(index=False, float_format=lambda x: f"{x:.4g}"))
    return 0 if table["kept"].all() else 1


def _setting(text):
    key, equals, value = str(text).partition("=")
    if not equals:
        raise ValueError(f"`{text}` is not KEY=VALUE")
    return key, value


def _progress(done, runs):
    if sys.stderr.isatty():
        print(f"\r{done} of {runs} runs", end="\n" if done == runs else "", file=sys.stderr, flush=True)


def read_file(path):
    """The name of a sweep's file (docs/sweeps.md), and the arguments of `sweep` that it states."""
    from . import Range

    if not path.is_file():
        raise ValueError(f"{path} is not a file: give the file of a sweep")
    try:
        spec = read_toml(path)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None
    if "robot" in spec:
        raise ValueError(f"{path} is a scenario: the file of a sweep has scenario = \"{path.name}\", and a [[key]] for each that varies (docs/sweeps.md)")
    _check(path, "", spec)
    beside = path.parent / spec["scenario"]
    sample = spec.get("sample", {})
    if sample:
        _check(path, "sample: ", sample)
    space = {}
    for key in listed(spec["key"]):
        _check(path, "key: ", key)
        name = key["key"]
        if name in space or name in ("graph", "name"):
            raise ValueError(f"{path}: `{name}` is given twice, or cannot vary within a sweep")
        if ("values" in key) == ("from" in key and "to" in key):
            raise ValueError(f"{path}: `{name}` needs either `values`, or `from` and `to`")
        if key.get("scale", "linear") not in ("linear", "log"):
            raise ValueError(f"{path}: the scale of `{name}` is `linear` or `log`")
        space[name] = key["values"] if "values" in key else Range(key["from"], key["to"], key.get("steps", 0), key.get("scale") == "log")
    method = sample.get("method", "random" if sample else "grid")
    scenario = str(beside) if beside.suffix == ".toml" and beside.is_file() else spec["scenario"]
    if spec["name"] in ("", ".", "..") or "/" in spec["name"]:
        raise ValueError(f"{path}: `name` is {spec['name']!r}: give the name of a folder within runs/")
    settings = dict(_setting(one) for one in spec.get("set", []))
    return spec["name"], {"scenario": scenario, "space": space, "runs": sample.get("runs"), "method": method, "seed": sample.get("seed", 0), "settings": settings}


def _check(path, where, table):
    """Raises ValueError where a key is unknown, missing, or of another kind."""
    needed, others = KEYS[where]
    kinds = needed | others
    if not isinstance(table, dict):
        raise ValueError(f"{path}: {where}{table!r} is no table")
    for key in [*table, *needed]:
        if key not in kinds:
            raise ValueError(f"{path}: {where}`{key}` is unknown; there are {', '.join(sorted(kinds))}")
        if key not in table:
            raise ValueError(f"{path}: {where}`{key}` is missing")
        if not isinstance(table[key], KINDS[kinds[key]]) or isinstance(table[key], bool):
            raise ValueError(f"{path}: {where}`{key}` is {table[key]!r}: give a {kinds[key]}")


if __name__ == "__main__":
    sys.exit(main())
