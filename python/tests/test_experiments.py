"""Trials and experiments, as they are installed: `python/build --test` runs this in an empty virtual environment."""

import ctypes
import json
import math
import mmap
import os
import platform
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import armplane
import numpy as np
import pytest
from armplane import experiments, trial
from armplane.experiments import Range, sweep
from armplane.experiments import __main__ as command
from repository import tutorial

SHORT = """name = "short"
robot = "puma560"
settle_s = 0.05
[start]
q_deg = [20, -60, 170, 0, 30, 0]
[[segment]]
by_m = [0.02, 0.0, -0.01]
duration_s = 0.4
"""


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("short.toml").write_text(SHORT)


@pytest.mark.parametrize(
    "scenario, settings, faults",
    [
        ("fig5-wrist-rotation", {"control.k_p": 300, "seed": 7}, None),
        ("short.toml", {"control.strategy": "chang-khatib", "start.q_deg": np.array([21.0, -60, 170, 0, 30, 0])}, {"process": "controller", "kind": "kill", "at_tick": 9}),
        ("short.toml", {}, [{"process": "controller", "kind": "kill", "at_tick": 100}, {"process": "estimator", "kind": "delay", "at_s": 0.3, "for_ticks": 40}]),
    ],
)
def test_a_trial_has_the_bytes_and_numbers_of_the_processes(scenario, settings, faults):
    row = trial(scenario, settings, faults)
    run = armplane.run(scenario, settings, faults, out="run")
    assert row["hash"] == {topic: one["hash"] for topic, one in run.summary["topics"].items()}
    assert row["outcome"] == run.summary["outcome"] and row["ticks"] == run.summary["ticks"]
    assert {key: row[key] for key in run.summary["task"]} == run.summary["task"]
    table, recorded = armplane.trace(scenario, settings, faults), run.arrow()
    clock = [name for name in table.column_names if name.startswith("latency.")]
    assert table.drop_columns(clock).equals(recorded.drop_columns(clock))
    assert table.schema.field("joint.q.1").metadata[b"unit"] == b"rad"


DAMPER = """
import armplane


class Damper(armplane.Controller):
    def control(self, tick, estimate, singularity, state, torque):
        assert self.is_fresh("estimate")
        share = 1.0 if self.is_fresh("singularity") else 0.5
        torque.tau[: self.dof] = [-5 * share * qdot for qdot in estimate.qdot[: self.dof]]
        torque.phase = armplane.wire.PHASE_DONE if tick == 700 else armplane.wire.PHASE_RUNNING
        state.path_time_s = tick * self.dt


if __name__ == "__main__":
    Damper.run()
"""
GRAPH = """extends = "armplane"
[[process]]
name = "controller"
command = ["python3", "damper.py"]
reads = ["estimate", "singularity"]
writes = ["control_state", "torque"]
"""
FAULTS = [
    {"process": "estimator", "kind": "delay", "at_tick": 30, "for_ticks": 40, "delay_ticks": 3},
    {"process": "analyzer", "kind": "kill", "at_tick": 100},
    {"process": "estimator", "kind": "drop", "at_tick": 200, "for_ticks": 50, "probability": 0.3},
]


@pytest.mark.parametrize("faults", [[], FAULTS])
def test_a_controller_in_python_has_the_bytes_of_a_process(faults, monkeypatch):
    Path("damper.py").write_text(DAMPER)
    Path("graph.toml").write_text(GRAPH)
    monkeypatch.syspath_prepend(".")
    from damper import Damper

    row = trial("short.toml", faults=faults, controller=Damper)
    run = armplane.run("short.toml", faults=faults, graph="graph.toml", out="run")
    assert row["hash"] == {topic: one["hash"] for topic, one in run.summary["topics"].items()}
    assert row["ticks"] == run.summary["ticks"] == 701 and {key: row[key] for key in run.summary["task"]} == run.summary["task"]
    qdot = armplane.trace("short.toml", faults=faults, controller=Damper)["joint.qdot.1"].to_numpy()
    assert len(qdot) == 701 and abs(qdot[-1]) < max(abs(qdot))


class Raising(armplane.Controller):
    def control(self, tick, estimate, singularity, state, torque):
        if tick == 5:
            raise ZeroDivisionError


class NotFinite(armplane.Controller):
    def control(self, tick, estimate, singularity, state, torque):
        torque.tau[0] = math.nan if tick == 5 else 0.0


@pytest.mark.parametrize("faults", [[], FAULTS])
def test_what_a_controller_raises_ends_its_trial(faults):
    with pytest.raises(ZeroDivisionError):
        trial("short.toml", faults=faults, controller=Raising)
    with pytest.raises(ValueError, match="tick 5.*tau"):
        trial("short.toml", faults=faults, controller=NotFinite)
    for wrong in (Raising.control, armplane.Plant, 1):
        with pytest.raises(ValueError):
            trial("short.toml", controller=wrong)


@pytest.mark.skipif(platform.machine() != "x86_64", reason="this register is of x86-64")
def test_a_trial_has_its_bytes_whatever_a_library_has_told_the_processor():
    # ldmxcsr [rdi]; ret. 0x9fc0 takes small numbers for zero.
    code = mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
    code.write(b"\x0f\xae\x17\xc3")
    tell = ctypes.CFUNCTYPE(None, ctypes.c_void_p)(ctypes.addressof(ctypes.c_char.from_buffer(code)))
    mode = lambda bits: tell(ctypes.addressof(ctypes.c_uint32(bits)))
    seen = []

    class Small(armplane.Controller):
        def control(self, tick, estimate, singularity, state, torque):
            seen.append(5e-324 * torque.tau[1] if tick else np.float64(1e-308) * np.float64(0.1))
            torque.tau[0], torque.tau[1] = 1e-310, 1.0
            torque.phase = armplane.wire.PHASE_DONE if tick == 3 else armplane.wire.PHASE_RUNNING

    before = trial("short.toml", controller=Small)["hash"]
    try:
        mode(0x9FC0)
        after = trial("short.toml", controller=Small)["hash"]
        assert np.float64(1e-308) * np.float64(0.1) == 0
    finally:
        mode(0x1F80)
    # The controller has the mode of its thread, the run the standard one.
    assert before == after and seen[0] > 0 and seen[4] == 0


def test_a_trial_leaves_the_interpreter_lock():
    begun, done = threading.Event(), threading.Event()
    work = lambda: (begun.set(), trial("fig5-wrist-rotation"), done.set())
    thread = threading.Thread(target=work)
    thread.start()
    begun.wait()
    steps = 0
    while not done.is_set():
        steps += 1
    thread.join()
    assert steps > 1000


def test_lines_and_laws_are_those_of_the_command():
    lines = armplane.lines("ur5", 1, seed=1)
    assert [line["singularities"] for line in lines] == ["elbow", "wrist", "overhead"]
    assert lines == armplane.lines("ur5", 2, seed=1)[:3] and all(trial(line["scenario"])["s2"] for line in lines)
    assert all("+" in line["singularities"] for line in armplane.lines("puma560", 1, kind="two"))
    assert len(armplane.lines("puma560", 6, kind="near")) == 6
    assert armplane.laws()[0] == "blended" and set(armplane.laws()) <= set(armplane.laws(all=True))


@pytest.mark.parametrize("call", [lambda: trial("nowhere"), lambda: trial("short.toml", {"control.kp": 1}), lambda: armplane.lines("ur6", 1)])
def test_bad_input_is_a_value_error(call):
    with pytest.raises(ValueError):
        call()


def test_what_a_law_refuses_is_a_row():
    assert trial("short.toml", faults=[{"process": "plant", "kind": "kill", "at_tick": 10}])["outcome"] == "refused"


def test_a_grid_counts_like_a_number_and_samples_fill_their_ranges():
    space = {"control.k_p": [100, 400.5], "seed": Range(1, 3, 3), "plant.mass_factor": Range(0.5, 2, 3, log=True)}
    grid = sweep("short.toml", space, run=lambda *_: {"outcome": "goal reached", "reason": ""})
    assert len(grid) == 18 and list(grid.iloc[4])[1:4] == [100, 2, 1.0] and list(grid.iloc[17])[1:4] == [400.5, 3, 2.0]
    space = {"seed": Range(1, 4), "plant.mass_factor": Range(0.5, 1.5)}
    for method in ("random", "sobol"):
        draw = lambda runs, seed: sweep("short.toml", space, runs, method, seed=seed, run=lambda *_: {"outcome": "", "reason": ""})
        table = draw(2000, 1)
        assert table.equals(draw(2000, 1)) and not table.equals(draw(2000, 2)) and table[:100].equals(draw(100, 1))
        assert table["seed"].value_counts().between(400, 600).all() and abs(table["plant.mass_factor"].mean() - 1) < 0.03


@pytest.mark.parametrize(
    "space, more, named",
    [
        ({}, {}, "space"),
        ({"control.kp": [1]}, {}, "kp"),
        ({"seed": Range(1, 4, 3)}, {}, "steps"),
        ({"control.k_p": Range(4, 1, 3)}, {}, "k_p"),
        ({"control.k_p": Range(0, 1, 3, log=True)}, {}, "k_p"),
        ({"control.k_p": [1]}, {"method": "halton", "runs": 4}, "halton.*sobol"),
        ({"control.k_p": Range(1, 2)}, {"method": "random"}, "runs"),
        ({"control.k_p": Range(1, 2)}, {}, "steps"),
        ({"control.k_p": 400}, {}, r"\[400\]"),
        ({"control.k_p": [400]}, {"jobs": 0}, "jobs"),
        ({"control.k_p": [400]}, {"out": "short.toml"}, "short.toml is a file"),
    ],
)
def test_a_space_that_makes_no_sense_is_refused_before_any_run(space, more, named):
    with pytest.raises(ValueError, match=named):
        sweep("short.toml", space, **more, run=lambda *_: pytest.fail("a run"))


@pytest.mark.parametrize(
    "words, named", [("report", "armplane sweep report:"), ("figures out", "--out"), ("sweep short.toml --jbos=2", "--jobs"), ("sweep short.toml", "scenario")]
)
def test_a_wrong_command_line_is_answered_with_what_was_meant(words, named, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["armplane", *words.split()])
    with pytest.raises(SystemExit):
        sys.exit(command.main())
    assert named in capsys.readouterr().err


SWEEP = """name = "killed"
scenario = "short.toml"
[[key]]
key = "control.k_p"
from = 100
to = 900
scale = "log"
[[key]]
key = "seed"
from = 1
to = 1000
[sample]
runs = 48
seed = 1
"""


@pytest.mark.parametrize("wrong", ["scenario = 5", "key = 5", "key = [5]", "sample = 5", "set = [5]", "name = true"])
def test_a_wrong_type_in_a_sweeps_file_is_a_value_error(wrong):
    others = [line for line in ('name = "a"', 'scenario = "short.toml"', "key = []") if line[:3] != wrong[:3]]
    Path("a.toml").write_text("\n".join([wrong, *others]))
    with pytest.raises(ValueError, match="5|True"):
        command.read_file(Path("a.toml"))


def test_a_killed_sweep_goes_on_and_its_table_is_that_of_one_piece():
    Path("killed.toml").write_text(SWEEP)
    name, arguments = command.read_file(Path("killed.toml"))
    whole = sweep(**arguments)
    assert name == "killed" and len(whole) == 48
    start = lambda: subprocess.Popen([sys.executable, *"-m armplane.experiments sweep killed.toml --out out".split()], stdout=subprocess.DEVNULL)
    parts = lambda: len(list(Path("out").glob("runs-*.parquet")))
    for kill in range(1, 4):
        child = start()
        while parts() < kill and child.poll() is None:
            time.sleep(0.01)
        os.kill(child.pid, signal.SIGKILL)
        child.wait()
    assert start().wait() == 0
    assert experiments.read("out")[0].equals(whole)
    # Another sweep, or another program, is refused.
    with pytest.raises(ValueError, match="another sweep"):
        sweep(**{**arguments, "seed": 2}, out="out")
    Path("short.toml").write_text(SHORT.replace("0.4", "0.3"))
    with pytest.raises(ValueError, match="first run"):
        sweep(**arguments, out="out")


def test_a_file_is_written_whole_or_not_at_all(monkeypatch):
    from armplane.results import os, write_whole

    write_whole(Path("one.parquet"), b"before")
    monkeypatch.setattr(os, "fsync", lambda _: sys.exit())
    with pytest.raises(SystemExit):
        write_whole(Path("one.parquet"), b"after")
    assert Path("one.parquet").read_bytes() == b"before"


def test_a_report_ranks_and_repeats_the_worst_runs():
    space = {"control.strategy": ["blended", "damped-least-squares"], "control.k_p": [100, 400], "seed": range(1, 2)}
    table = sweep("fig5-wrist-rotation", space, out="laws")
    report = experiments.report("laws", by="orthogonal_max_deg", worst=1)
    worst = table.loc[table["orthogonal_max_deg"].idxmax()]
    assert report["worst"][0]["value"] == worst["orthogonal_max_deg"] and f"control.strategy={worst['control.strategy']}" in report["worst"][0]["command"]
    assert all(Path(f"laws/report.{kind}").stat().st_size > 10_000 for kind in ("svg", "png", "pdf"))
    refused = sweep("short.toml", {"start.q_deg.5": [0, 500]})
    assert experiments.lack(refused, {"start.q_deg.5": [0, 500]}) and not experiments.lack(table, space)


# covers: CK95 Figures 1, 2, 3 and 4
def test_the_papers_figures_are_drawn_with_their_numbers():
    numbers = experiments.figures("figures")
    for name in ("fig1-2", "fig3", "fig4", "fig5"):
        assert all(Path(f"figures/{name}.{kind}").stat().st_size > 10_000 for kind in ("svg", "png", "pdf"))
    assert numbers == json.loads(Path("figures/figures.json").read_text())
    pseudo, consistent, locks, fig4, fig5 = numbers.values()
    assert pseudo["tip_error_max_mm"] > 100 * consistent["tip_error_max_mm"] and consistent["tip_error_max_mm"] < 1
    assert pseudo["coupling_max_n"] > 1 and consistent["coupling_max_n"] < 1e-6 * pseudo["coupling_max_n"]
    first, second = consistent["joint_2_swings_deg"]
    assert first > 60 and second > 0.9 * first
    assert {name: lock["type"] for name, lock in locks.items()} == {"elbow": "type 1", "wrist": "type 2", "overhead": "mixed"}
    assert all(abs(lock["s"]) < 1e-3 for lock in locks.values())
    assert abs(fig5["zeta_turned_deg"] - 90) < 0.25 and fig5["position_max_mm"] < 0.1
    assert abs(abs(fig4["moved_mm"]) - 80) < 0.1 and fig4["orthogonal_max_mm"] < 0.05


def test_studies_are_tables_and_pictures():
    laws = experiments.compare("fig5-wrist-rotation", ["blended", "damped-least-squares"])
    assert laws["s1"].tolist() == [True, False]
    experiments.compare_plot(laws, "laws")
    table = experiments.race("fig5-wrist-rotation", ["blended", "damped-least-squares"], "race.png")
    assert table["orientation_max_deg"].is_monotonic_increasing
    # All three kinds of picture, or the one that is named; of no other kind, and that is known before the runs.
    assert {path.name for path in Path(".").glob("[lr]a*.*")} == {"laws.svg", "laws.pdf", "laws.png", "race.png"}
    for draw in (lambda path: experiments.race("nowhere", "blended", path), lambda path: experiments.compare_plot(laws, path)):
        with pytest.raises(ValueError, match="race.gif"):
            draw("race.gif")
    lines = experiments.singular_lines("ur5", 1)
    assert lines["s2"].all() and lines["line"].tolist() == [1, 2, 3]
    steered = experiments.steered("ur5", seeds=[1], seconds=5)
    assert steered["kept"].all() and steered["speed_max_ratio"].between(0.01, 1).all() and steered["orthogonal_max_mm"].between(1e-3, 0.5).all()


def test_the_tutorials_experiment_is_twenty_lines_and_works(tmp_path, monkeypatch):
    files = tutorial()
    for name in ("arm.urdf", "arm.toml", "reach.toml"):
        Path(name).write_text(files[name])
    # The arm is beside its scenario, or named from here.
    monkeypatch.chdir("..")
    for scenario in (tmp_path / "reach.toml", files["reach.toml"].replace("arm.urdf", f"{tmp_path.name}/arm.urdf")):
        assert experiments.race(scenario, "blended", tmp_path / "race")["position_max_mm"].iloc[0] < 0.1
    monkeypatch.chdir(tmp_path)
    text = files["gains.py"]
    assert len([line for line in text.splitlines() if line.strip()]) <= 20
    # A hundredth of its runs.
    few = text.replace("range(1, 11)", "[1]").replace("[25, 50, 100, 200, 400, 600, 800, 1200, 1600, 2400]", "[100, 400]").replace("60, 80, 100, 120]", "60]")
    said = subprocess.run([sys.executable, "-c", few], capture_output=True, text=True, check=True, env={**os.environ, "MPLBACKEND": "Agg"})
    assert "best k_v, k_p: " in said.stdout and Path("gains.svg").exists() and Path("gains.parquet").exists()
