#!/usr/bin/env python3
"""Times of the arm's model beside pinocchio's, on this machine, in turns, at the same states.

    python3 tests/pinocchio/compare.py [PATH/OF/armplane]      # default: target/release/armplane

Needs a C++ compiler and `pip install pin cmeel-eigen`; without them it says so and ends with code 0. The C++ program is compiled at -O3 -march=native -DNDEBUG from
the headers of the same installation, which takes five minutes of one core and 2.3 GB of memory, once: it stays in target/pinocchio.
"""

import hashlib
import json
import os
import pathlib
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import tomllib

try:
    import numpy
    import pinocchio as pin
except ImportError:
    pin = None

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
ROBOTS = ROOT / "services" / "model" / "robots"
ARMS = ["puma560", "ur5", "panda"]
TURNS = 5
OURS = ["cargo", "run", "--release", "--locked", "--quiet", f"--manifest-path={ROOT / 'services/model/Cargo.toml'}", "--example", "terms", "--"]
# Ours, pinocchio's, and the goal for ours over pinocchio's.
PAIRS = [
    ("A, bias and J in one pass", "computeAllTerms", 0.25),
    ("mass matrix", "crba", 1.0),
    ("inverse dynamics", "rnea", 1.0),
]
# Lists of the 30 kinds of joint are longer than the headers of Boost's metaprogramming library are prepared for.
DEFINES = ["BOOST_MPL_LIMIT_LIST_SIZE=30", "BOOST_MPL_LIMIT_VECTOR_SIZE=30", "BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS", "BOOST_FUSION_INVOKE_MAX_ARITY=12"]


def skip(why):
    print(f"skipped: {why}")
    sys.exit(0)


def program(prefix, version):
    """The C++ program, compiled unless it is there already for this source, version and processor."""
    compiler = next(filter(None, map(shutil.which, [os.environ.get("CXX", "c++"), "g++", "clang++"])), None)
    if compiler is None:
        skip("there is no C++ compiler")
    source = HERE / "terms.cpp"
    processor = pathlib.Path("/proc/cpuinfo").read_text().split("\n\n")[0] if pathlib.Path("/proc/cpuinfo").exists() else ""
    model_name = next((line for line in processor.splitlines() if line.startswith("model name")), "")
    key = hashlib.sha256((source.read_text() + version + compiler + model_name).encode()).hexdigest()[:16]
    path = ROOT / "target" / "pinocchio" / f"terms-{key}"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        print(f"compiles {source.relative_to(ROOT)} with {compiler}: about five minutes", file=sys.stderr)
        draft = path.with_suffix(".draft")
        command = [compiler, "-std=c++17", "-O3", "-march=native", "-DNDEBUG", *(f"-D{name}" for name in DEFINES), "-w"]
        command += [f"-I{prefix / 'include'}", f"-I{prefix / 'include' / 'eigen3'}", str(source), "-o", str(draft)]
        command += [f"-L{prefix / 'lib'}", f"-Wl,-rpath,{prefix / 'lib'}", "-lpinocchio_default", "-lboost_serialization"]
        if subprocess.run(command).returncode != 0:
            skip(f"{compiler} cannot compile it with the headers of pinocchio {version}")
        draft.rename(path)
    return path


def pinocchio_model(name):
    """The arm as pinocchio has it: the same URDF, and the armature from the file beside it."""
    # Without pictures, whose files it would look for.
    text = re.sub(r"<(visual|collision)\b.*?</\1>", "", (ROBOTS / f"{name}.urdf").read_text(), flags=re.DOTALL)
    model = pin.buildModelFromXML(text)
    armature = model.armature.copy()
    for joint, values in tomllib.loads((ROBOTS / f"{name}.toml").read_text())["joints"].items():
        armature[model.joints[model.getJointId(joint)].idx_v] = values.get("armature", 0.0)
    model.armature = armature
    return model


def output(*command):
    done = subprocess.run(list(map(str, command)), stdout=subprocess.PIPE, text=True)
    if done.returncode != 0:
        sys.exit(f"{command[0]} failed")
    return done.stdout


def check_same_arm(armplane, model, name):
    """Both programs mean the same arm: its mass matrix in a posture is equal to 1e-9."""
    degrees = [10.0, -20.0, 30.0, -40.0, 50.0, 60.0, 70.0][: model.nv]
    ours = json.loads(output(armplane, "inspect", "--robot", name, "--q-deg=" + ",".join(map(str, degrees)), "--json"))["A"]
    theirs = pin.crba(model, model.createData(), numpy.radians(degrees))
    worst = max(abs(ours[i][j] - theirs[min(i, j), max(i, j)]) for i in range(model.nv) for j in range(model.nv))
    if worst > 1e-9:
        sys.exit(f"{name} is not the same arm in both programs: the mass matrices differ by {worst:.2e} kg·m²")


def main():
    armplane = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "target" / "release" / "armplane").resolve()
    if not armplane.exists():
        sys.exit(f"there is no {armplane}: cargo build --release")
    if pin is None:
        skip("Python has no pinocchio: pip install pin cmeel-eigen")
    prefix = next((parent for parent in pathlib.Path(pin.__file__).parents if (parent / "include" / "pinocchio").is_dir()), None)
    if prefix is None:
        skip("this pinocchio comes without headers: pip install pin cmeel-eigen")
    terms = program(prefix, pin.__version__)
    ours, theirs = {}, {}
    with tempfile.TemporaryDirectory() as folder:
        for name in ARMS:
            model = pinocchio_model(name)
            check_same_arm(armplane, model, name)
            model.saveToText(f"{folder}/{name}")
        for _ in range(TURNS):
            for name in ARMS:
                for times, command in [(ours, [*OURS, name]), (theirs, [terms, f"{folder}/{name}"])]:
                    for line in output(*command).splitlines():
                        algorithm, _, nanoseconds = line.rpartition(" ")
                        times.setdefault((name, algorithm), []).append(float(nanoseconds) / 1e3)
    print(f"µs, median of {TURNS} turns of 5000 samples each, pinocchio {pin.__version__}\n")
    print("| arm | armplane | µs | pinocchio | µs | ratio | goal |\n|---|---|---|---|---|---|---|")
    for name in ARMS:
        for own, algorithm, goal in PAIRS:
            # Of the ways to compute the same, the quicker one.
            ways = {way: times for (arm, way), times in theirs.items() if arm == name and way.partition(",")[0] == algorithm}
            way, other = min(ways.items(), key=lambda item: statistics.median(item[1]))
            mine = ours[name, own]
            ratio = statistics.median(a / b for a, b in zip(mine, other))
            print(f"| {name} | {own} | {statistics.median(mine):.3f} | {way} | {statistics.median(other):.3f} | {ratio:.2f} | {goal:.2f} |")


if __name__ == "__main__":
    main()
