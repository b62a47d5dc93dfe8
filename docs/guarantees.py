#!/usr/bin/env python3
"""Runs the commands of every row of docs/guarantees.md, one after the other, as they stand in the table, and prints whether each row holds.

    python3 docs/guarantees.py                  # all rows: hours
    python3 docs/guarantees.py drill hostile    # rows with one of these words in a command
    python3 docs/guarantees.py --short          # two minutes, after `cargo test`: that each filter names a test, and armplane's commands that are quick

A row passes when each of its commands ends with exit code 0; one named behind "fails with" has to end with 1. The exit code is that of the worst row.
"""

import argparse
import collections
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
    found, last, parts = [], None, cell.split("`")
    for before, quoted in zip(parts[::2], parts[1::2]):
        if quoted.startswith(("cargo ", "armplane ")):
            last = re.sub(r" SCENARIO\b", "", quoted)
            found.append((last, 0))
        elif quoted.startswith("--without ") and last:
            # "`armplane drill`, which fails with `--without hold`, `--without torque-check` and `--without fencing`"
            found.append((f"{last} {quoted}", 1))
    return found


def rows():
    """Guarantee and commands of each row."""
    for line in (ROOT / "docs/guarantees.md").read_text().splitlines():
        cells = line.removeprefix("| ").split(" | ")
        if line.startswith("| ") and not line.endswith("| shown by |"):
            yield cells[0], commands(cells[1])


def run(command, expected, folder, done, short):
    """Whether a command ends as it is to; one that has run already is not run again."""
    if (command, expected) not in done:
        words = shlex.split(command)
        is_own = words[0] == "armplane"
        words[0] = str(PROGRAM) if is_own else words[0]
        if short and not is_own:
            words += ["--list"] if "--" in words else ["--", "--list"]
        began = time.monotonic()
        ran = subprocess.run(words, cwd=folder if is_own else ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace")
        tested = re.findall(r"^test result: \w+\. (\d+) passed|^(\d+) tests?, ", ran.stdout, re.M)
        tests = sum(int(ran or listed) for ran, listed in tested)
        # A filter that no test has is no test.
        is_empty = words[0] == "cargo" and tests == 0
        holds = ran.returncode == expected and not is_empty
        note = f"{time.monotonic() - began:.0f} s" + (f", {tests} tests" if tested else "")
        if not holds:
            note += f", exit code {ran.returncode}: " + " / ".join(ran.stdout.strip().splitlines()[-3:])
        done[(command, expected)] = (holds, note)
    return done[(command, expected)]


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("words", nargs="*", help="only rows with one of these in a command")
    arguments.add_argument("--short", action="store_true", help="list the tests instead of running them, and leave out what takes minutes")
    chosen = arguments.parse_args()
    done, counts = {}, collections.Counter()
    with tempfile.TemporaryDirectory() as folder:
        for assumption, here in rows():
            if chosen.words and not any(word in command for command, _ in here for word in chosen.words):
                continue
            notes, holds, left_out = [], bool(here), 0
            for command, expected in here:
                if chosen.short and any(word in command for word in LONG):
                    notes.append(f"      not run   {command}")
                    left_out += 1
                    continue
                ends, note = run(command, expected, folder, done, chosen.short)
                holds &= ends
                notes.append(f"      {'as it is to' if ends else 'OTHERWISE'}  {command}  ({note})")
            verdict = "FAIL" if not holds else "part" if 0 < left_out < len(here) else "skip" if left_out else "pass"
            counts[verdict] += 1
            print(f"{verdict}  {assumption[:120]}", *notes, sep="\n", flush=True)
    print(f"{counts['pass']} rows pass, {counts['FAIL']} fail, {counts['skip'] + counts['part']} were not run or not whole")
    return 1 if counts["FAIL"] or not counts else 0


if __name__ == "__main__":
    sys.exit(main())
