"""The arena's tasks: the paper's, lines that others have published, and seeded lines through singular postures of eight arms. Only the paper's
tasks have hints that say which posture to take.

Four of the arms are armplane's own, four are files of the package robosuite 1.5.2. A full table has 25 lines an arm, of seven kinds: through a singularity at the
usual, a slow and a fast speed, beginning in it, ending in it, past it (each joint of the start moved by up to 50 mrad), and through two at once. Where a lock
bounds what can be reached, a line through it begins or ends there. An arm that has no two singularities at once within its limits gets more lines past one.
"""

import concurrent.futures
import hashlib
import importlib.util
import math
import os
import random
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path

import armplane

from ..results import read_toml, write_whole

# Lines of the table, and lines on which numbers may be tuned.
TEST, TRAINING, TRAINED = 1, 101, ("puma560", "ur5")
# Laws, arms, kinds of lines and sizes of tables.
DATA = read_toml(Path(__file__).with_name("arena.toml"))
# Starts and ways of others, as scenarios. J-PARSE: its line over the base axis (0.5 m at 0.05 Hz) and its key points about that axis; MoveIt Servo: 0.1 m along x
# from the posture of its test of a halt; isaac-sim/IsaacLab#7063: a UR10 from its posture at rest, in wrist lock, to each goal of run_osc.py, without its wall,
# the hand not turned, and turned by 180° about z, because this base's x axis points backwards. open-planning/roboplan#239, example_singularity.py: the hand goes
# straight from the pose of one of its UR5's postures to that of the next; there, along the joints' straight line.
PUBLISHED = {path.stem: path for path in sorted((Path(__file__).parent / "published").glob("*.toml"))}
# Peak speed at which lines are drawn, m/s.
DRAWN = 0.28
# Lines an arm on which payload, noise and delay are varied: the first of the usual ones.
VARIED = 3


def _hash(content):
    return hashlib.sha256(content).hexdigest()


@dataclass
class Task:
    """A scenario: its name, group and text; a built-in one has no text. `is_varied`: whether payload, noise and delay are varied on it. `known`: what its hash is
    of, where that is neither the text nor the name."""

    name: str
    group: str
    text: str = ""
    is_varied: bool = False
    known: str = ""

    @property
    def hash(self):
        return _hash((self.known or self.text or self.name).encode())[:16]

    def copied(self, folder):
        """The argument of a run: the built-in name, or a file of its own, as an opponent may write to one that all share."""
        if not self.text:
            return self.name
        path = Path(folder) / f"{self.name}.toml"
        path.write_text(self.text)
        return str(path)


def make(folder, size="short", seed=TEST, arms=None, most=math.inf):
    """The tasks of a size, `most` lines of a kind and arm, and the arms left out; only the lines of another seed than that of the table. `folder` keeps arms and lines."""
    folder = Path(folder).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    asked, tasks = DATA["sizes"][size], []
    for name in asked.get("scenarios", [*DATA["paper"], *PUBLISHED]) if seed == TEST else ():
        tasks.append(Task(name, "paper") if name in DATA["paper"] else Task(name, "published", PUBLISHED[name].read_text()))
    arms = arms or [*DATA["arms"]][: asked["arms"]]
    files = {arm: _file(arm, folder) for arm in arms}
    skipped = {arm: "the package robosuite is missing" for arm, file in files.items() if file is None}
    # Drawn on all cores: a line is kept once a planner has found a way along it.
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for kinds in pool.map(lambda arm: _lines(folder, arm, files[arm], asked["lines"], seed), [arm for arm in arms if files[arm]]):
            tasks += [task for kind in kinds for task in kind[: min(most, len(kind))]]
    return tasks, skipped


def unhinted(tasks):
    """The tasks with hints, without them, under the same names: the hand goes the same way, and no word says in which posture."""
    out = []
    for task in tasks:
        if task.group != "paper":
            continue
        with tempfile.TemporaryDirectory() as folder:
            run = armplane.run(task.name, out=Path(folder, "run"), record=False)
            # Without the comment of its first line, which refuses a changed file.
            text = (run.folder / "scenario.toml").read_text().partition("\n")[2]
        bare = re.sub(r"^branch = .*$", "branch = 0", text, flags=re.MULTILINE)
        # A hand that stands still meanwhile, for as long.
        bare = re.sub(r"^(duration_s = .*\n(?:\w.*\n)*)\n\[segment.reorient\]\n(?:\w.*\n)+", r"\1by_m = [0.0, 0.0, 0.0]\n", bare, flags=re.MULTILINE)
        if bare != text:
            out.append(Task(task.name, task.group, bare))
    return out


def _file(arm, folder):
    """The program's argument for an arm, and what stands for it in a task's hash; `None` where it is of a package that is missing."""
    package, _, name = arm.rpartition(":")
    if not package:
        return arm, _hash(Path(arm).read_bytes()) if Path(arm).is_file() else arm
    found = importlib.util.find_spec(package)
    if found is None:
        return None
    xml = Path(found.origin).parent / "models/assets/robots" / name / "robot.xml"
    # Here, as the arena's help needs no package of others.
    from ..mjcf import read

    # Once, not in each run: MuJoCo takes longer to start than most lines to run. Anew for each arena: the package can have changed, and an opponent can have written.
    urdf, texts = folder / f"{name}.urdf", read(xml)
    for path, text in zip((urdf, urdf.with_suffix(".toml")), texts):
        write_whole(path, text.encode())
    return str(urdf), _hash(xml.read_bytes())


def _lines(folder, arm, file, kinds, seed):
    """The lines of an arm in `file`, kind by kind."""
    short, found = arm.rpartition(":")[2], DATA["arms"].get(arm, 1)
    # Twelve lines through one singularity each, four of a kind of place; of a short table the first of each singularity.
    is_short = set(kinds) <= {"usual", "near", "fast", "double"} and max(kinds.values()) <= found
    count = 1 if is_short else math.ceil(12 / found)
    single = _drawn(folder / f"{short}-lines-{seed}-{count}", file[0], count, seed, False)
    of = len(single) // count
    double = _drawn(folder / f"{short}-pairs-{seed}", file[0], 1 if found > 2 else 3, seed, True) if "double" in kinds else []
    out = []
    for kind, wanted in kinds.items():
        speed, numbers, pairs, off = (DATA["kinds"][kind][key] for key in ("speed", "numbers", "pairs", "off"))
        if kind == "near":
            wanted += max(kinds.get("double", 0) - len(double), 0)
        fitting = double if pairs else [path for number, path in enumerate(single) if number // of % 4 in numbers]
        out.append([])
        for place, path in enumerate(fitting[:wanted]):
            text = _set(path.read_text(), "duration_s", lambda value: value * DRAWN / speed)
            if off:
                draw = random.Random(f"{seed} {short} {path.stem}")
                text = _set(text, "q", lambda value: value + draw.uniform(-off, off))
            # The place of an arm's file is this machine's; its text is the task's.
            out[-1].append(Task(f"{short}-{kind}-{path.stem[5:]}", kind, text, kind == "usual" and place < VARIED, text.replace(*file)))
    return out


def _drawn(drawn, arm, count, seed, pairs):
    """The files of an arm's lines at `DRAWN`, drawn where they are not there yet; none of pairs for an arm without two singularities at once."""
    if not drawn.is_dir():
        draft = Path(tempfile.mkdtemp(dir=drawn.parent))
        for number, line in enumerate(armplane.lines(arm, count, seed, "two" if pairs else "one", speed=DRAWN), 1):
            (draft / f"line-{number}.toml").write_text(line["scenario"])
        draft.rename(drawn)
    return sorted(drawn.glob("line-*.toml"), key=lambda path: int(path.stem[5:]))


def _set(text, key, change):
    """The scenario with each number of a key's first place changed."""

    def changed(match):
        return match[1] + re.sub(r"-?[0-9][-+.e0-9]*", lambda number: repr(change(float(number[0]))), match[2])

    text, count = re.subn(rf"^({key} = )(.*)$", changed, text, count=1, flags=re.MULTILINE)
    if count != 1:
        raise ValueError(f"a saved line has no key `{key}`: another version of armplane?")
    return text
