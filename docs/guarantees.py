#!/usr/bin/env python3
"""Runs the commands of every row of docs/guarantees.md, one after the other, as they stand in the table, and prints whether each row holds.

    python3 docs/guarantees.py                  # all rows: hours
    python3 docs/guarantees.py drill hostile    # rows with one of these words in a command
    python3 docs/guarantees.py --short          # two minutes, after `cargo test`: that each filter names a test, and armplane's commands that are quick

A row passes when each of its commands ends with exit code 0; one named behind "fails with" has to end with 1. The exit code is that of the worst row.
"""

import argparse
import collections
import functools
import pathlib
import re
import shlex
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
PROGRAM = ROOT / "target/release/armplane"
# Words of commands that take minutes.
LONG = ["--realtime", "--kills", "--without"]


def commands(cell):
    """The commands of a cell with the exit code that each is to have."""
    last = None
    for quoted in cell.split("`")[1::2]:
        if quoted.startswith(("cargo ", "armplane ")):
            last = re.sub(r" SCENARIO\b", "", quoted)
            yield last, 0
        elif quoted.startswith("--without ") and last:
            # "`armplane drill`, which fails with `--without hold`, `--without torque-check` and `--without fencing`"
            yield f"{last} {quoted}", 1


def rows():
    """Guarantee and commands of each row."""
    for line in (ROOT / "docs/guarantees.md").read_text().splitlines():
        if line.startswith("| ") and not line.endswith("| shown by |"):
            guarantee, cell, *_ = line.removeprefix("| ").split(" | ")
            yield guarantee, [*commands(cell)]


@functools.cache
def run(command, expected, folder, short):
    """Whether a command ends as it is to, and a note; one that has run already is not run again."""
    words = shlex.split(command)
    is_own = words[0] == "armplane"
    words[0] = str(PROGRAM) if is_own else words[0]
    if short and not is_own:
        words += ["--list"] if "--" in words else ["--", "--list"]
    began = time.monotonic()
    ran = subprocess.run(words, cwd=folder if is_own else ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace")
    tests = sum(int(ran or listed) for ran, listed in re.findall(r"^test result: \w+\. (\d+) passed|^(\d+) tests?, ", ran.stdout, re.M))
    # A filter that no test has is no test.
    holds = ran.returncode == expected and (tests > 0 or words[0] != "cargo")
    note = f"{time.monotonic() - began:.0f} s{f', {tests} tests' if tests else ''}"
    return holds, note if holds else f"{note}, exit code {ran.returncode}: " + " / ".join(ran.stdout.strip().splitlines()[-3:])


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("words", nargs="*", help="only rows with one of these in a command")
    arguments.add_argument("--short", action="store_true", help="list the tests instead of running them, and leave out what takes minutes")
    chosen = arguments.parse_args()
    counts = collections.Counter()
    with tempfile.TemporaryDirectory() as folder:
        for guarantee, here in rows():
            if chosen.words and not any(word in command for command, _ in here for word in chosen.words):
                continue
            notes, holds, left_out = [], bool(here), 0
            for command, expected in here:
                if chosen.short and any(word in command for word in LONG):
                    notes.append(f"      not run   {command}")
                    left_out += 1
                    continue
                ends, note = run(command, expected, folder, chosen.short)
                holds &= ends
                notes.append(f"      {'as it is to' if ends else 'OTHERWISE'}  {command}  ({note})")
            verdict = "FAIL" if not holds else "pass" if not left_out else "part"
            counts[verdict] += 1
            print(f"{verdict}  {guarantee[:120]}", *notes, sep="\n", flush=True)
    print(f"{counts['pass']} rows pass, {counts['FAIL']} fail, {counts['part']} were not run or not whole")
    return 1 if counts["FAIL"] or not counts else 0


if __name__ == "__main__":
    sys.exit(main())
