#!/usr/bin/env python3
"""Writes the reference pages beside this file, from the schemas of docs/schema and the built program.

    cargo build --release && python3 docs/reference/make.py     # writes the pages
    python3 docs/reference/make.py --check                      # exit code 1 if a page is out of date

ARMPLANE names another program than target/release/armplane.
"""

import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
PROGRAM = os.environ.get("ARMPLANE", str(ROOT / "target/release/armplane"))
UNITS = r"MB \(10⁶ bytes\)|degrees|counts|bytes|ticks|1/s²?|rad/s²?|m/s²?|rad|Hz|mm|ms|µs|m|s|J"
SUFFIXES = {"mm": "mm", "deg": "degrees", "m": "m", "s": "s", "hz": "Hz", "ms": "ms", "n": "N", "j": "J", "mb": "MB", "ticks": "ticks"}
SUFFIXES |= {"ratio": "share of the limit", "bytes": "bytes"}
# Described on a page of their own.
ELSEWHERE = {"Kind": "[word](faults.md#kinds)", "Way": "[word](faults.md#variants)"}
# Writers of topics that few runs have.
SOME = {"wrist_force": "plant (runs with a force)"}
# A run of each kind leaves a scenario with the defaults of all keys.
PATH = 'name = "path"\nrobot = "puma560"\n[start]\nposture = "ready"\n[[segment]]\nduration_s = 0.01\n'
STEERED = 'name = "steered"\nrobot = "puma560"\n[start]\nposture = "ready"\n[servo]\ntargets = """\n# armplane targets 1, length m\n0.0, end\n"""\n'


def program(*arguments, folder=None):
    # Without a terminal on any stream, the help is as wide as COLUMNS.
    environment = {**os.environ, "COLUMNS": "84", "NO_COLOR": "1"}
    done = subprocess.run([PROGRAM, *arguments], cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"{PROGRAM} {' '.join(arguments)}: {done.stderr}")
    return done.stdout


def value_of(text):
    text = text.strip()
    return json.loads(text) if text[0] in '"[' or text in ("true", "false") else text


def read_defaults(text):
    """The keys of a TOML file of plain tables, by table: the program's own writer puts one key on a line."""
    tables, table = {}, "Scenario"
    for line in text.splitlines():
        if found := re.fullmatch(r"\[\[?([\w.]+)\]?\]", line):
            table = found[1]
        elif found := re.fullmatch(r"(\w+) = (.+)", line):
            tables.setdefault(table, {})[found[1]] = value_of(found[2]) if '"""' not in line else ""
    return tables


def defaults(folder):
    """The defaults of a scenario's keys, by the path of their table."""
    found = {}
    for name, text in (("path", PATH), ("steered", STEERED)):
        (folder / f"{name}.toml").write_text(text)
        program("run", f"{name}.toml", "--no-record", "--out", name, folder=folder)
        found = read_defaults((folder / name / "scenario.toml").read_text()) | found
    # These are the two runs' own.
    del found["start"], found["servo"]["input"], found["segment"]["duration_s"]
    return found


def is_number(value):
    return isinstance(value, str) and re.fullmatch(r"[-+.0-9e]+", value)


def cell(text):
    return str(text).replace("|", "\\|").replace("\n", " ")


def table(head, rows):
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cell(one) for one in row) + " |" for row in lines) + "\n"


def split_unit(key, words):
    """The unit that a description or a key's name ends with, and the description without it."""
    if found := re.search(rf"; (({UNITS})( \([^)]*\))?)(?=\.)", words):
        return found[1], words.replace(found[0], "", 1)
    return "1/s" if key.endswith("_per_s") else SUFFIXES.get(key.rpartition("_")[2] if "_" in key else "", ""), words


# Of a graph: false, 0 and empty.
NO_DEFAULTS = {"": {}}


class Page:
    """The tables of a schema, each below a heading of its path in the file."""

    def __init__(self, schema, found=None):
        self.schema, self.defaults, self.children, self.shown = schema, found, [], {}

    def type_of(self, schema, path):
        """A type in words; tables of their own are queued with their path."""
        if "anyOf" in schema:
            options = [option for option in schema["anyOf"] if option != {"type": "null"}]
            return " or ".join(f'`"{one["const"]}"`' if "const" in one else self.type_of(one, path) for one in options)
        if "$ref" in schema:
            name = schema["$ref"].rsplit("/", 1)[1]
            if name in ELSEWHERE:
                return ELSEWHERE[name]
            target = self.schema["$defs"][name]
            self.children.append((path, name))
            return "word" if "oneOf" in target else "table"
        if schema["type"] == "array":
            of = self.type_of(schema["items"], path)
            return f"{schema['minItems']} × {of}" if "minItems" in schema else f"list of {of}s"
        if isinstance(schema.get("additionalProperties"), dict):
            return f"by name: {self.type_of(schema['additionalProperties'], path + '.NAME')}"
        return "table" if schema["type"] == "object" else schema["type"]

    def default_of(self, path, key, schema, required):
        here = (self.defaults or {}).get(path or "Scenario", {})
        if key in required and not path.startswith("control"):
            return "required"
        if key in here and here[key] != "":
            return f"`{here[key] if is_number(here[key]) else json.dumps(here[key])}`"
        if schema.get("type") == "boolean":
            return "`false`"
        return "`0`" if schema.get("type") == "integer" and self.defaults == NO_DEFAULTS else ""

    def section(self, path, name):
        target = self.schema if name is None else self.schema["$defs"][name]
        heading = f"`{path}`" if path else "Top level"
        if "oneOf" in target:
            rows = [[f'`"{one["const"]}"`', one["description"]] for one in target["oneOf"]]
            return f"## {heading}\n\n{target['description']}\n\n" + table(["word", "meaning"], rows)
        rows = []
        for key, schema in target["properties"].items():
            if schema["description"].startswith("The same as "):
                continue
            kind = self.type_of(schema, f"{path}.{key}".lstrip("."))
            if schema.get("anyOf", [{}])[0].get("properties", {}).get("wrist"):
                kind = "table of [numbers](#one-number-for-each-singularity)"
                here = self.defaults.get(f"{path}.{key}", {})
                rows.append([f"`{key}`", kind, ", ".join(f"{one} {number}" for one, number in here.items())])
            else:
                rows.append([f"`{key}`", kind, self.default_of(path, key, schema, target.get("required", []))])
            rows[-1] += split_unit(key, schema["description"])
            if self.defaults is None:
                del rows[-1][2]
        head = ["key", "type", *(["default"] if self.defaults is not None else []), "unit", "meaning"]
        return f"## {heading}\n\n{target['description']}\n\n" + table(head, rows)

    def write(self):
        queue, sections = [("", None)], []
        while queue:
            path, name = queue.pop(0)
            if path not in self.shown:
                self.shown[path], self.children = name, []
                sections.append(self.section(path, name))
                queue = self.children + queue
        return "\n".join(sections)


def scenario(folder):
    schema = json.loads((ROOT / "docs/schema/scenario.json").read_text())
    numbers = "\n## One number for each singularity\n\nSuch a key takes a table like `{ wrist = 0.12, elbow = 0.08 }`. Names left out keep their defaults: "
    numbers += "`elbow`, `wrist`, `overhead`, `shoulder`, and `numeric` for singularities found numerically.\n"
    about = "`armplane run FILE.toml` runs a scenario; `--set KEY=VALUE` changes a key for one run, such as `--set control.k_p=900` or "
    about += "`--set segment.0.duration_s=3`. Sections with several entries (`segment`, `fault`) are written `[[segment]]`, all others `[plant]`.\n\n"
    return about + Page(schema, defaults(folder)).write() + numbers


def graph(_):
    schema = json.loads((ROOT / "docs/schema/graph.json").read_text())
    return "[Your own graph](../graph.md) shows how to use one.\n\n" + Page(schema, NO_DEFAULTS).write()


def summary(_):
    schema = json.loads((ROOT / "docs/schema/summary.json").read_text())
    # A fault's plan has the keys of a scenario's fault.
    plan = schema["$defs"]["FaultSummary"]["properties"]["plan"]
    schema["$defs"]["FaultSummary"]["properties"]["plan"] = {"type": "object", "description": plan["description"]}
    about = "Every run leaves a `summary.json`. The true state of the simulated arm is judged. [How the verdict is made](../recording.md#summaryjson)\n\n"
    return about + Page(schema).write()


def faults(_):
    listed = json.loads(program("fault", "--list", "--json"))
    roles = {"world": "plant", "stage": "estimator, analyzer, controller", "observer": "recorder"}
    kinds, ways = [], []
    for one in listed:
        to = "any" if len(one["roles"]) == 3 else ", ".join(roles[role] for role in one["roles"])
        length = "to the end" if one["length_s"] is None else f"{one['length_s']} s"
        kinds.append([f"`{one['kind']}`", one["about"], to, length])
        for way in one["ways"]:
            about = way["about"].split(": ", 1)[1] if one["kind"] in way["about"].split(":")[0] else way["about"]
            if "; drive: " in way["about"]:
                about = dict(part.split(": ", 1) for part in way["about"].rstrip(".").split("; "))[one["kind"]] + "."
            usual = f"{way['amount']:g} {way['unit']}" if way["amount"] else ""
            ways.append([f"`{one['kind']}`", f"`{way['as']}`", about[0].upper() + about[1:], usual])
    about = "[Faults](../faults.md) shows how to inject them, [the scenario's reference](scenario.md#fault) lists all keys.\n\n## Kinds\n\n"
    about += table(["kind", "effect", "processes", "default duration"], kinds)
    return about + "\n## Variants\n\nThe first variant of a kind is its default.\n\n" + table(["kind", "variant (`as`)", "effect", "default amount"], ways)


def arm(_):
    source = (ROOT / "services/model/src/description.rs").read_text()
    text = "\n".join(line.removeprefix("//!").removeprefix(" ") for line in source.splitlines() if line.startswith("//!"))
    return f"`arm.toml` beside `arm.urdf` or `arm.xml` is read with it.\n\n{text}\n"


def messages(_):
    wire = json.loads(program("generate", "wire", "--lang", "json"))
    fields = {one["name"]: one for one in wire["structures"]}
    used = {topic["structure"]: topic for topic in wire["topics"]}
    text = f"{wire['timing']} [The wire](../wire.md) shows how a program of yours reads and writes them.\n\n## Topics\n\n"
    text += table(["topic", "message", "writer", "readers", "bytes"], [
        [f"`{one['topic']}`", f"[{one['structure']}](#{one['structure'].lower()})", one["writer"] or SOME.get(one["topic"], "(steered runs)"), ", ".join(one["readers"]), one["bytes"]]
        for one in wire["topics"]])
    for name, one in fields.items():
        heading = f" `{used[name]['type']}` on the topic `{used[name]['topic']}`." if name in used else ""
        rows = [[f"`{field['name']}`", field["type"] + (f" × {field['count']}" if field["count"] else ""), field["offset"], field["unit"] or "", field["about"]]
                for field in one["fields"]]
        text += f"\n## {name}\n\n{one['about']}{heading}\n\n" + table(["field", "type", "offset", "unit", "meaning"], rows)
    text += "\n## Codes\n\nNumbers that stand for words in messages.\n"
    for name, codes in wire["codes"].items():
        text += f"\n### {name}\n\n" + table(["code", "name", "meaning"], [[one["code"], f"`{one['name']}`", one["text"]] for one in codes])
    return text


def cli(folder):
    program("generate", "man", str(folder / "man"))
    text = "```text\n" + program("--help").rstrip() + "\n```\n"
    names = sorted(page.name.removesuffix(".1") for page in (folder / "man").iterdir())
    commands = {tuple(name.split("-")[1:]) for name in names if name != "armplane"}
    for command in sorted(commands):
        help_text = re.sub(r"[ \t]+$", "", program(*command, "--help"), flags=re.M).rstrip()
        about, rest = help_text.split("\nUsage:", 1)
        # Every command has these; the first block explains them.
        rest = re.sub(r"\n *--json\n? .*?(?=\n *-v)\n *-v, .*?\n *-h, --help[^\n]*(\n +Print help[^\n]*)?", "", rest, flags=re.S)
        rest = re.sub(r"\n{3,}", "\n\n", re.sub(r"\nOptions:\n*(?=\n\S|$)", "", rest))
        # An example stands on one line, to be copied.
        rest, header, examples = re.split(r"(\nExamples?:\n)", rest + "\nExamples:\n", maxsplit=1)[:3]
        examples = re.sub(r"\n  (?=[^ a]|a(?!rmplane ))", " ", examples.removesuffix("\nExamples:\n"))
        rest += header + examples if examples else ""
        text += f"\n## armplane {' '.join(command)}\n\n```text\n{about.strip()}\n\nUsage:{rest.rstrip()}\n```\n"
    return text


PAGES = {
    "scenario": ("Scenario: every key", scenario),
    "graph": ("Graph: every key", graph),
    "arm": ("Arm description: every key", arm),
    "faults": ("Faults: every kind", faults),
    "summary": ("summary.json: every key", summary),
    "messages": ("Topics and messages", messages),
    "cli": ("Command line", cli),
}


def main():
    stale = []
    with tempfile.TemporaryDirectory() as folder:
        for name, (title, page) in PAGES.items():
            path = HERE / f"{name}.md"
            text = f"<!-- Generated by docs/reference/make.py. Do not edit. -->\n# {title}\n\n{page(pathlib.Path(folder)).strip()}\n"
            if "--check" not in sys.argv:
                path.write_text(text)
            elif not path.exists() or path.read_text() != text:
                stale.append(path.name)
    if stale:
        sys.exit(f"{', '.join(stale)}: out of date; run python3 docs/reference/make.py")


if __name__ == "__main__":
    main()
