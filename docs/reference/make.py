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
import tomllib

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
PROGRAM = os.environ.get("ARMPLANE", str(ROOT / "target/release/armplane"))
UNITS = r"MB \(10⁶ bytes\)|degrees|counts|bytes|ticks|1/s²?|rad/s²?|m/s²?|rad|Hz|mm|ms|µs|m|s|J"
SUFFIXES = "mm: mm, deg: degrees, m: m, s: s, hz: Hz, ms: ms, n: N, j: J, mb: MB, ticks: ticks, ratio: share of the limit, bytes: bytes"
SUFFIXES = dict(one.split(": ") for one in SUFFIXES.split(", "))
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


def defaults(folder):
    """The defaults of a scenario's keys, nested as in its file."""
    found = {}
    for name, text in (("steered", STEERED), ("path", PATH)):
        (folder / f"{name}.toml").write_text(text)
        program("run", f"{name}.toml", "--no-record", "--out", name, folder=folder)
        found |= tomllib.loads((folder / name / "scenario.toml").read_text())
    # These are the two runs' own.
    del found["start"], found["servo"]["input"], found["segment"][0]["duration_s"]
    return found


def table(head, rows):
    cell = lambda text: str(text).replace("|", "\\|").replace("\n", " ")
    return f"| {head} |\n|{' --- |' * (head.count('|') + 1)}\n" + "".join(f"| {' | '.join(map(cell, row))} |\n" for row in rows)


def split_unit(key, words):
    """The unit that a description or a key's name ends with, and the description without it."""
    if found := re.search(rf"; (({UNITS})( \([^)]*\))?)(?=\.)", words):
        return found[1], words.replace(found[0], "", 1)
    return "1/s" if key.endswith("_per_s") else SUFFIXES.get(key.rpartition("_")[2] if "_" in key else "", ""), words


def tables(schema, found=None):
    """The tables of a schema, each below a heading of its path in the file. `found`: the defaults of its keys; `None` for a file that nobody writes."""
    shown = {}

    def type_of(one, path, children):
        """A type in words; tables of their own go to `children` with their path."""
        if "anyOf" in one:
            options = [option for option in one["anyOf"] if option != {"type": "null"}]
            return " or ".join(f'`"{option["const"]}"`' if "const" in option else type_of(option, path, children) for option in options)
        if "$ref" in one:
            name = one["$ref"].rsplit("/", 1)[1]
            if name not in ELSEWHERE:
                children.append((path, schema["$defs"][name]))
            return ELSEWHERE.get(name) or ("word" if "oneOf" in schema["$defs"][name] else "table")
        if one["type"] == "array":
            of = type_of(one["items"], path, children)
            return f"{one['minItems']} × {of}" if "minItems" in one else f"list of {of}s"
        if isinstance(of := one.get("additionalProperties"), dict):
            return f"by name: {type_of(of, path + '.NAME', children)}"
        return "table" if one["type"] == "object" else one["type"]

    def default_of(here, key, one, is_required):
        value = json.dumps(here.get(key, ""))
        if is_required:
            return "required"
        if value != '""' and "{" not in value:
            return f"`{value}`"
        # Of a graph: false, 0 and empty.
        return {"boolean": "`false`", "integer": "" if found else "`0`"}.get(one.get("type"), "")

    def section(path, target):
        heading, children, here = f"## {f'`{path}`' if path else 'Top level'}\n\n{target['description']}\n\n", [], found or {}
        for part in path.split(".") if path else ():
            here = here.get(part, {})
            here = here[0] if isinstance(here, list) else here
        if "oneOf" in target:
            shown[path] = heading + table("word | meaning", ([f'`"{one["const"]}"`', one["description"]] for one in target["oneOf"]))
            return
        rows, head = [], "key | type | default | unit | meaning"
        for key, one in target["properties"].items():
            if one["description"].startswith("The same as "):
                continue
            kind = type_of(one, f"{path}.{key}".lstrip("."), children)
            default = default_of(here, key, one, key in target.get("required", ()) and not path.startswith("control"))
            if one.get("anyOf", [{}])[0].get("properties", {}).get("wrist"):
                kind, default = "table of [numbers](#one-number-for-each-singularity)", ", ".join(f"{name} {number}" for name, number in here.get(key, {}).items())
            rows.append([f"`{key}`", kind, *([] if found is None else [default]), *split_unit(key, one["description"])])
        shown[path] = heading + table(head.replace(" default |", "") if found is None else head, rows)
        for child in children:
            if child[0] not in shown:
                section(*child)

    section("", schema)
    return "\n".join(shown.values())


def schema_of(name):
    return json.loads((ROOT / f"docs/schema/{name}.json").read_text())


def scenario(folder):
    numbers = "\n## One number for each singularity\n\nSuch a key takes a table like `{ wrist = 0.12, elbow = 0.08 }`. Names left out keep their defaults: "
    numbers += "`elbow`, `wrist`, `overhead`, `shoulder`, and `numeric` for singularities found numerically.\n"
    about = "`armplane run FILE.toml` runs a scenario; `--set KEY=VALUE` changes a key for one run, such as `--set control.k_p=900` or "
    about += "`--set segment.0.duration_s=3`. Sections with several entries (`segment`, `fault`) are written `[[segment]]`, all others `[plant]`.\n\n"
    return about + tables(schema_of("scenario"), defaults(folder)) + numbers


def graph(_):
    return "[Your own graph](../graph.md) shows how to use one.\n\n" + tables(schema_of("graph"), {})


def summary(_):
    schema = schema_of("summary")
    # A fault's plan has the keys of a scenario's fault.
    plan = schema["$defs"]["FaultSummary"]["properties"]["plan"]
    schema["$defs"]["FaultSummary"]["properties"]["plan"] = {"type": "object", "description": plan["description"]}
    about = "Every run leaves a `summary.json`. The true state of the simulated arm is judged. [How the verdict is made](../recording.md#summaryjson)\n\n"
    return about + tables(schema)


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
    about += table("kind | effect | processes | default duration", kinds)
    return about + "\n## Variants\n\nThe first variant of a kind is its default.\n\n" + table("kind | variant (`as`) | effect | default amount", ways)


def arm(_):
    source = (ROOT / "services/model/src/description.rs").read_text()
    text = "\n".join(line.removeprefix("//!").removeprefix(" ") for line in source.splitlines() if line.startswith("//!"))
    return f"`arm.toml` beside `arm.urdf` or `arm.xml` is read with it.\n\n{text}\n"


def messages(_):
    wire = json.loads(program("generate", "wire", "--lang", "json"))
    fields = {one["name"]: one for one in wire["structures"]}
    used = {topic["structure"]: topic for topic in wire["topics"]}
    text = f"{wire['timing']} [The wire](../wire.md) shows how a program of yours reads and writes them.\n\n## Topics\n\n"
    text += table("topic | message | writer | readers | bytes", (
        [f"`{one['topic']}`", f"[{one['structure']}](#{one['structure'].lower()})", one["writer"] or SOME.get(one["topic"], "(steered runs)"), ", ".join(one["readers"]), one["bytes"]]
        for one in wire["topics"]))
    for name, one in fields.items():
        heading = f" `{used[name]['type']}` on the topic `{used[name]['topic']}`." if name in used else ""
        rows = [[f"`{field['name']}`", field["type"] + (f" × {field['count']}" if field["count"] else ""), field["offset"], field["unit"] or "", field["about"]]
                for field in one["fields"]]
        text += f"\n## {name}\n\n{one['about']}{heading}\n\n" + table("field | type | offset | unit | meaning", rows)
    text += "\n## Codes\n\nNumbers that stand for words in messages.\n"
    for name, codes in wire["codes"].items():
        text += f"\n### {name}\n\n" + table("code | name | meaning", ([one["code"], f"`{one['name']}`", one["text"]] for one in codes))
    return text


def cli(folder):
    program("generate", "man", str(folder / "man"))
    text = f"```text\n{program('--help').rstrip()}\n```\n"
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
    scenario: "Scenario: every key",
    graph: "Graph: every key",
    arm: "Arm description: every key",
    faults: "Faults: every kind",
    summary: "summary.json: every key",
    messages: "Topics and messages",
    cli: "Command line",
}


def main():
    stale = []
    with tempfile.TemporaryDirectory() as folder:
        for page, title in PAGES.items():
            path = HERE / f"{page.__name__}.md"
            text = f"<!-- Generated by docs/reference/make.py. Do not edit. -->\n# {title}\n\n{page(pathlib.Path(folder)).strip()}\n"
            if "--check" not in sys.argv:
                path.write_text(text)
            elif not path.exists() or path.read_text() != text:
                stale.append(path.name)
    if stale:
        sys.exit(f"{', '.join(stale)}: out of date; run python3 docs/reference/make.py")


if __name__ == "__main__":
    main()
