"""The arena's tasks: the paper's, lines that others have published, and seeded lines through singular postures of eight arms, none with a hint."""

import hashlib
import pathlib
import random
import re

ARMS = ("puma560", "ur5", "iiwa14", "panda", "ur10", "fr3", "xarm7", "gen3")
# Lines of the table, and lines on which numbers may be tuned.
TEST, TRAINING, TRAINED = 1, 101, ("puma560", "ur5")
# `branch` and `reorient` in these scenarios say which posture to take: hints that no other law reads.
PAPER = ("fig4-elbow-and-wrist", "fig5-wrist-rotation", "elbow-in-and-out", "overhead-pass", "straight-up", "wrist-near-miss", "ur5-wrist", "ur5-elbow", "iiwa-elbow")
# Starts and lines of others: J-PARSE's line over the base axis (0.5 m at 0.05 Hz), and 0.1 m along x from the posture of MoveIt Servo's test of a halt.
PUBLISHED = {
    "j-parse-panda": ("panda", 'posture = "ready"', [([0.5, 0.0, 0.7], 3.0), ([0.05, 0.0, 0.7], 10.0), ([0.5, 0.0, 0.7], 10.0)], True),
    "servo-halt-panda": ("panda", "q = [-0.0001, 0.569, 0.0005, -0.7782, 0.0, 1.3453, 0.7845]", [([0.1, 0.0, 0.0], 4.0)], False),
}
# Peak speed at which lines are drawn, m/s.
DRAWN = 0.28
# Of each kind of line: peak speed, whether two singularities hold at once, and by how much a start is moved off them, rad.
KINDS = {"usual": (0.28, False, 0.0), "near": (0.28, False, 0.05), "fast": (0.84, False, 0.0), "double": (0.28, True, 0.0), "slow": (0.056, False, 0.0)}
# Of each size: kinds of lines, how many a singularity, and the scenarios beside them.
SIZES = {
    "short": (("usual",), 1, PAPER[1:2]),
    "main": (("usual", "near", "fast", "double"), 1, (*PAPER, *PUBLISHED)),
    "full": (tuple(KINDS), 4, (*PAPER, *PUBLISHED)),
}


class Task:
    """A scenario: its name, group, robot, and `argument`, a built-in name or a file."""

    def __init__(self, name, group, robot, argument, text):
        self.name, self.group, self.robot, self.argument = name, group, robot, str(argument)
        self.hash = hashlib.sha256(text.encode()).hexdigest()[:16]


def make(folder, armplane, size="main", seed=TEST, arms=ARMS):
    """The tasks of a size as files in `folder`; only the lines of another seed than that of the table. `armplane(*arguments)` runs the program."""
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    kinds, count, scenarios = SIZES[size]
    tasks = []
    for name in scenarios if seed == TEST else ():
        tasks.append(_published(folder, name) if name in PUBLISHED else Task(name, "paper", "", name, name))
    for arm in arms:
        for kind in kinds:
            tasks += _lines(folder, armplane, arm, kind, count, seed)
    return tasks


def _published(folder, name):
    robot, start, ways, is_absolute = PUBLISHED[name]
    goal = "to_m" if is_absolute else "by_m"
    segments = "".join(f"\n[[segment]]\n{goal} = {list(way)}\nduration_s = {time}\n" for way, time in ways)
    return _task(folder, name, "published", robot, f'name = "{name}"\nrobot = "{robot}"\n[start]\n{start}\n{segments}')


def _lines(folder, armplane, arm, kind, count, seed):
    speed, pairs, off = KINDS[kind]
    short = pathlib.Path(arm).stem
    tasks = []
    for path in _drawn(folder / f"{short}-{'pairs' if pairs else 'lines'}-{seed}-{count}", armplane, arm, count, seed, pairs):
        text = _set(path.read_text(), "duration_s", lambda value: value * DRAWN / speed)
        if off:
            draw = random.Random(f"{seed} {short} {path.stem}")
            text = _set(text, "q", lambda value: value + draw.uniform(-off, off))
        tasks.append(_task(folder, f"{short}-{kind}-{path.stem[5:]}", kind, arm, text))
    return tasks


def _drawn(drawn, armplane, arm, count, seed, pairs):
    """The files of an arm's lines at `DRAWN`, drawn where they are not there yet."""
    if not drawn.is_dir():
        arguments = ["compare", "sweep", "--robot", arm, "--count", count, "--speed", DRAWN, "--seed", seed, "--save-lines", drawn]
        try:
            armplane(*arguments, *(["--pairs"] if pairs else []))
        except RuntimeError as error:
            # An arm without two singularities at once within its limits.
            if not pairs or "has no line" not in str(error):
                raise
            drawn.mkdir()
    return sorted(drawn.glob("line-*.toml"), key=lambda path: int(path.stem[5:]))


def _set(text, key, change):
    """The scenario with each number of a key's first place changed."""

    def changed(match):
        return match[1] + re.sub(r"-?[0-9][-+.e0-9]*", lambda number: repr(change(float(number[0]))), match[2])

    text, count = re.subn(rf"^({key} = )(.*)$", changed, text, count=1, flags=re.MULTILINE)
    if count != 1:
        raise ValueError(f"a saved line has no key `{key}`: another version of armplane?")
    return text


def _task(folder, name, group, robot, text):
    path = folder / f"{name}.toml"
    path.write_text(text)
    return Task(name, group, robot, path, text)
