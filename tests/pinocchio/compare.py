#!/usr/bin/env python3
"""Times of the arm's model beside pinocchio's, on this machine, in alternating runs, at the same states.

    python3 tests/pinocchio/compare.py [PATH/OF/armplane]      # default: target/release/armplane

Needs a C++ compiler and `pip install pin cmeel-eigen pandas`; without them it says so and ends with code 0. The C++ program is compiled at -O3 -march=native -DNDEBUG from
the headers of the same installation, which takes five minutes of one core and 2.3 GB of memory, once: it stays in target/pinocchio.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

try:
    import numpy
    import pandas
    import pinocchio as pin
except ImportError:
    pin = None

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
ROBOTS = ROOT / "services/model/robots"
ARMS = ["puma560", "ur5", "panda"]
TURNS = 5
OURS = [*"cargo run --release --locked --quiet --example terms --manifest-path".split(), ROOT / "services/model/Cargo.toml", "--"]
# Ours, pinocchio's, and the goal for ours over pinocchio's.
PAIRS = {"A, bias and J in one pass": ("computeAllTerms", 0.25), "mass matrix": ("crba", 1), "inverse dynamics": ("rnea", 1)}
# Lists of the 30 kinds of joint are longer than the headers of Boost's metaprogramming library are prepared for.
DEFINES = "BOOST_MPL_LIMIT_LIST_SIZE=30 BOOST_MPL_LIMIT_VECTOR_SIZE=30 BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS BOOST_FUSION_INVOKE_MAX_ARITY=12".split()


def skip(why):
    print(f"skipped: {why}")
    sys.exit(0)


def program(prefix, version):
    """The C++ program, compiled unless it is there already for this version and newer than its source."""
    compiler, source = shutil.which(os.environ.get("CXX", "c++")), HERE / "terms.cpp"
    if compiler is None:
        skip("there is no C++ compiler")
    path = ROOT / f"target/pinocchio/terms-{version}"
    if not path.exists() or path.stat().st_mtime < source.stat().st_mtime:
        path.parent.mkdir(parents=True, exist_ok=True)
        print(f"compiles {source.relative_to(ROOT)} with {compiler}: about five minutes", file=sys.stderr)
        command = [compiler, *f"-std=c++17 -O3 -march=native -DNDEBUG -w -I{prefix}/include -I{prefix}/include/eigen3 -L{prefix}/lib -Wl,-rpath,{prefix}/lib".split()]
        command += [*(f"-D{name}" for name in DEFINES), source, "-o", path.with_suffix(".draft"), "-lpinocchio_default", "-lboost_serialization"]
        if subprocess.run(command).returncode != 0:
            skip(f"{compiler} cannot compile it with the headers of pinocchio {version}")
        path.with_suffix(".draft").rename(path)
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
    return subprocess.run(list(map(str, command)), stdout=subprocess.PIPE, text=True, check=True).stdout


def check_same_arm(armplane, model, name):
    """Both programs mean the same arm: its mass matrix in a posture is equal to 1e-9."""
    degrees = [10, -20, 30, -40, 50, 60, 70][: model.nv]
    ours = json.loads(output(armplane, "inspect", "--robot", name, f"--q-deg={','.join(map(str, degrees))}", "--json"))["A"]
    worst = numpy.abs(numpy.triu(ours - pin.crba(model, model.createData(), numpy.radians(degrees)))).max()
    if worst > 1e-9:
        sys.exit(f"{name} is not the same arm in both programs: the mass matrices differ by {worst:.2e} kg·m²")


def main():
    armplane = Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "target/release/armplane").resolve()
    if not armplane.exists():
        sys.exit(f"there is no {armplane}: cargo build --release")
    if pin is None:
        skip("Python has no pinocchio: pip install pin cmeel-eigen")
    prefix = next((parent for parent in Path(pin.__file__).parents if (parent / "include/pinocchio").is_dir()), None)
    if prefix is None:
        skip("this pinocchio comes without headers: pip install pin cmeel-eigen")
    terms, rows = program(prefix, pin.__version__), []
    with tempfile.TemporaryDirectory() as folder:
        for name in ARMS:
            model = pinocchio_model(name)
            check_same_arm(armplane, model, name)
            model.saveToText(f"{folder}/{name}")
        for turn in range(TURNS):
            for name in ARMS:
                for command in ([*OURS, name], [terms, f"{folder}/{name}"]):
                    for line in output(*command).splitlines():
                        algorithm, _, nanoseconds = line.rpartition(" ")
                        rows.append((name, algorithm, turn, float(nanoseconds) / 1e3))
    times = pandas.DataFrame(rows, columns=["arm", "way", "turn", "µs"]).set_index(["arm", "way", "turn"])["µs"]
    print(f"µs, median of {TURNS} turns of 5000 samples each, pinocchio {pin.__version__}\n")
    print("| arm | armplane | µs | pinocchio | µs | ratio | goal |\n|---|---|---|---|---|---|---|")
    for name in ARMS:
        mine = times[name]
        for own, (algorithm, goal) in PAIRS.items():
            # Of the ways to compute the same, the quicker one.
            way = min((way for way in mine.index.unique("way") if way.partition(",")[0] == algorithm), key=lambda way: mine[way].median())
            ours, theirs = mine[own], mine[way]
            print(f"| {name} | {own} | {ours.median():.3f} | {way} | {theirs.median():.3f} | {(ours / theirs).median():.2f} | {goal:.2f} |")


if __name__ == "__main__":
    main()
