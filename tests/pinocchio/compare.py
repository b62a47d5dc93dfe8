#!/usr/bin/env python3
"""Our model beside pinocchio, in turns, in the same minute: PUMA 560, UR5, Panda.

    pip install pin cmeel-eigen          # pinocchio's headers and libraries, Eigen
    cargo build --release
    python3 tests/pinocchio/compare.py   # builds peer.cpp with c++, runs both, prints a table; --native: with -march=native

Both get the same postures, 5000 samples of 100 evaluations; a number is the least of three medians. Our A, bias and J in one pass stands beside
computeAllTerms, mass matrix beside crba, inverse dynamics beside rnea. armplane is compiled for any x86-64.
"""

import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
ARMS = {"puma560": "PUMA 560", "ur5": "UR5", "panda": "Panda"}
PAIRS = [("A, bias and J in one pass", "computeAllTerms", "1/5"), ("mass matrix", "crba", "1"), ("inverse dynamics", "rnea", "1")]
ROUNDS = 3


def prefix():
    """The folder of pinocchio's headers and libraries."""
    try:
        import pinocchio  # noqa: F401
    except ImportError:
        sys.exit("skipped: python3 has no pinocchio (pip install pin cmeel-eigen)")
    for folder in sys.path:
        found = pathlib.Path(folder) / "cmeel.prefix"
        if (found / "include" / "pinocchio").is_dir() and (found / "include" / "eigen3").is_dir():
            return found
    sys.exit("skipped: python3 has no headers of pinocchio and Eigen (pip install pin cmeel-eigen)")


def build(folder):
    """Compiles peer.cpp."""
    compiler = os.environ.get("CXX") or shutil.which("c++") or sys.exit("skipped: there is no C++ compiler")
    found, program = prefix(), folder / "peer"
    # The limits are those of pinocchio's own build: it has more joint types than a list of Boost's holds by default.
    limits = ["-DBOOST_MPL_LIMIT_LIST_SIZE=30", "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS"]
    flags = ["-std=c++17", "-O3", "-DNDEBUG", "-w", *limits] + (["-march=native"] if "--native" in sys.argv else [])
    paths = ["-isystem", found / "include", "-isystem", found / "include" / "eigen3", "-L", found / "lib", f"-Wl,-rpath,{found / 'lib'}"]
    libraries = ["-lpinocchio_default"]
    subprocess.run([compiler, *flags, ROOT / "tests/pinocchio/peer.cpp", "-o", program, *paths, *libraries], check=True)
    return program


def ours():
    """Medians of `armplane bench model`; ns."""
    armplane = os.environ.get("ARMPLANE") or ROOT / "target/release/armplane"
    said = subprocess.run([armplane, "bench", "model", "--json"], stdout=subprocess.PIPE, check=True)
    rows = json.loads(said.stdout)["rows"]
    return {row["mechanism"]: 1000 * row["p50_us"] for row in rows if row["bench"] == "model"}


def described(arm):
    """An arm as peer.cpp reads it, from pinocchio's URDF parser."""
    import pinocchio

    model = pinocchio.buildModelFromUrdf(str(ROOT / "services/model/robots" / f"{arm}.urdf"))
    lines = [f"{arm} {model.njoints - 1}"]
    for i in range(1, model.njoints):
        X, body, kind = model.jointPlacements[i], model.inertias[i], model.joints[i].shortname().removeprefix("JointModel")
        if kind not in ("RX", "RY", "RZ") or model.parents[i] != i - 1:
            sys.exit(f"{arm}: joint {i} is a {kind} on {model.parents[i]}; peer.cpp has chains of RX, RY, RZ")
        numbers = [*X.translation, *X.rotation.flatten(), body.mass, *body.lever, *body.inertia.flatten()]
        lines.append(kind + " " + " ".join(repr(float(x)) for x in numbers))
    return "\n".join(lines) + "\n"


def theirs(program, text):
    """Medians of pinocchio; ns."""
    said = subprocess.run([program], input=text, stdout=subprocess.PIPE, text=True, check=True)
    return {tuple(line.split()[:2]): float(line.split()[2]) for line in said.stdout.splitlines()}


def least(measured):
    return {key: min(one[key] for one in measured) for key in measured[0]}


def main():
    with tempfile.TemporaryDirectory() as folder:
        program = build(pathlib.Path(folder))
        text = "".join(map(described, ARMS))
        rounds = [(ours(), theirs(program, text)) for _ in range(ROUNDS)]
    mine, peer = least([one for one, _ in rounds]), least([other for _, other in rounds])
    print("| arm | armplane | µs | pinocchio | µs | ratio | goal |\n|---|---|---|---|---|---|---|")
    for arm, name in ARMS.items():
        for work, algorithm, goal in PAIRS:
            a, b = mine[work if arm == "puma560" else f"{work}, {arm}"], peer[arm, algorithm]
            print(f"| {name} | {work} | {a / 1e3:.3f} | {algorithm} | {b / 1e3:.3f} | {a / b:.2f} | {goal} |")


main()
