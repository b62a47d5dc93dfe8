"""Controllers of others in the plant: an opponent of 20 lines from another folder, cheats, and the same bytes twice."""

import json
import pathlib
import sys

import armplane
import numpy as np
import pytest
from armplane.arena import __main__ as program
from armplane.arena import tasks
from armplane.arena.__main__ import after_delay
from armplane.results import _program
from processes import ended

pytest.importorskip("mujoco")

TASK = """name = "short"
robot = "ur5"
settle_s = 0.2
[start]
posture = "bent"
[[segment]]
by_m = [0.05, 0.0, -0.05]
turn = { about = "z", by_deg = 10 }
duration_s = 0.8
"""
HOME_MADE = """
import numpy as np

import armplane.arena


class Mine(armplane.arena.Velocity):
    damping = 0.001

    def qdot(self, q, ref):
        J = self.arm.J(q)
        return J.T @ np.linalg.solve(J @ J.T + self.damping**2 * np.eye(6), ref.V + 10 * self.arm.error(q, ref))
"""
# Processes of their own, which may say what they like; the judge takes their clock alone.
CHEAT = """
import armplane
from armplane.arena import Arm


class Cheat(armplane.Controller):
    def setup(self):
        self.arm, self.all = Arm(self.mjcf()), self.job["scenario"]["segment"][0]["duration_s"]

    def control(self, tick, estimate, singularity, state, torque):
        n = self.dof
        self.arm.move_to(estimate.q[:n], estimate.qdot[:n])
        torque.tau[:n] = (self.arm.bias() - 5 * self.arm.data.qvel).tolist()
        torque.phase = armplane.wire.PHASE_DONE if tick > {end} else armplane.wire.PHASE_RUNNING
        state.p_BE_d[:], state.R_BE_d[:] = self.arm.position.tolist(), self.arm.rotation.T.flatten().tolist()
        state.path_time_s = min(tick * self.dt, self.all)
        state.time_scale = 1.0


Cheat.run()
"""
GRAPH = """extends = "armplane"
[[process]]
name = "controller"
command = ["{python}", "cheat.py"]
reads = ["estimate", "singularity"]
writes = ["control_state", "torque"]
"""


def compare(folder, arguments, code=0):
    done = ended(f"{_program()} compare {arguments} --out {folder} --json")
    assert done.returncode == code, done.stderr
    return json.loads(done.stdout)["scenarios"][0]["laws"]


@pytest.fixture
def task(tmp_path):
    path = tmp_path / "short.toml"
    path.write_text(TASK)
    return str(path)


def test_the_reference_is_that_of_the_law(tmp_path):
    run = armplane.run("ur5-wrist", out=tmp_path / "run")
    states, estimates, reports = (run.messages(topic) for topic in ("control_state", "estimate", "singularity"))
    reference, came, worst = armplane.Reference((run.folder / "job.json").read_text()), 0, 0
    for state, estimate, report in zip(states, estimates, reports):
        by = max(state["path_time_s"] - came, 0)
        came += by
        reference.advance(by, 1.0, estimate["q"][:6], estimate["qdot"][:6], report.tobytes())
        worst = max(worst, np.abs(reference.pose[:3, 3] - state["p_BE_d"]).max())
        worst = max(worst, np.abs(reference.pose[:3, :3].T.flatten() - state["R_BE_d"]).max())
    assert reference.done and reference.leg > 2 and worst < 1e-9
    with pytest.raises(ValueError):
        reference.advance(-1, 1, np.zeros(6), np.zeros(6), reports[0].tobytes())


def test_a_home_made_opponent_enters_the_table_with_the_same_bytes_twice(tmp_path, task):
    (tmp_path / "mine.py").write_text(HOME_MADE)
    laws = compare(tmp_path / "a", f"{task} --law blended,mine={tmp_path}/mine.py")
    assert [law["law"] for law in laws] == ["blended", "mine"]
    assert laws[1]["s1"] and laws[1]["completed"] and laws[1]["orthogonal_max_mm"] < 1
    assert compare(tmp_path / "b", f"{task} --law mine={tmp_path}/mine.py")[0]["hash"] == laws[1]["hash"]


@pytest.mark.parametrize("name", program.OPPONENTS)
def test_an_installed_opponent_ends_an_easy_path_with_the_same_bytes_twice(tmp_path, task, name):
    file = program.OPPONENTS[name]
    reason, _ = program.asked_file(file, {})
    if reason:
        pytest.skip(reason)
    first, second = (compare(tmp_path / run, f"{task} --law {name}={file}")[0] for run in "ab")
    assert first["completed"] and first["orthogonal_max_deg"] < 5.0 and first["hash"] == second["hash"]


@pytest.mark.parametrize("end, missed", [(5000, "end"), (100, "task")])
def test_a_cheat_is_caught(tmp_path, task, end, missed):
    """The first calls the present pose its goal, to the end; the second ends early."""
    (tmp_path / "cheat.py").write_text(CHEAT.replace("{end}", str(min(end, 1100))))
    (tmp_path / "cheat.toml").write_text(GRAPH.replace("{python}", sys.executable))
    cheat = compare(tmp_path / "out", f"{task} --law cheat={tmp_path}/cheat.toml")[0]
    assert not cheat["s1"] and not cheat["s2"] and missed in cheat["missed"]


PRESSER = """
import numpy as np

import armplane.arena


class Presser(armplane.arena.Torque):
    presses = {presses}

    def torque(self, q, qdot, ref):
        J, A = self.arm.J(q), self.arm.A(q)
        a = 900 * self.arm.error(q, ref) + 60 * (ref.V - J @ qdot) + ref.a
        wrench = np.linalg.solve(J @ np.linalg.solve(A, J.T) + 1e-4 * np.eye(6), a)
        if ref.force:
            wrench[:3] += ref.force.axis * ref.force.newtons
        self.arm.move_to(q, 0 * qdot)
        return J.T @ wrench + self.arm.bias()
"""


@pytest.mark.parametrize("plant", ["", "--plant mujoco"])
def test_an_opponent_presses_and_one_that_cannot_is_not_run(tmp_path, plant):
    for name in ("True", "False"):
        (tmp_path / f"{name}.py").write_text(PRESSER.replace("{presses}", name))
    laws = compare(tmp_path / "a", f"wipe-through-wrist-lock {plant} --law presses={tmp_path}/True.py,not={tmp_path}/False.py", 1)
    assert laws[0]["completed"] and laws[0]["force"]["rms_n"] < 2 and laws[0]["force"]["lift_off_ticks"] == 0 and laws[0]["force"]["impact_max_n"] < 20
    assert laws[1]["outcome"] == "failed" and not laws[1]["completed"]


@pytest.mark.parametrize("of_tool", [False, True])
def test_a_surface_is_approached_and_its_force_waited_for(of_tool):
    from armplane.arena import Reference
    from armplane.arena.pressing import Pressing

    def press(surface, asked):
        """Ticks until the path goes on, with a hand that goes at once where it is led, and presses as it is told."""
        pressing, z, ticks = Pressing(1e-3), 0.0, 0
        axis, R = np.array([0.0, 0, -1]), np.diag([1.0, -1, -1])
        asked = {"axis": R @ axis if of_tool else axis, "of_tool": of_tool, "newtons": 10.0, "stiffness_n_m": 1e4, "until_newtons": None, "ramp_s": 0.3} | asked
        while ticks == 0 or pressing.waits:
            ref = Reference(np.eye(3), np.zeros(3), np.ones(6), np.ones(6))
            pressing.take(ref, asked, R, np.array([0, 0, z]), -axis * 1e4 * max(0.0, surface - z))
            speed = 0 if ref.force else -asked["approach_m_s"]
            assert np.allclose(ref.V, [1, 1, speed, 1, 1, 1]) and ref.a[2] == 0
            if ref.force:
                assert abs(ref.p[2] - z) < 1e-12 and abs(ref.force.surface + surface) < 1e-9 and np.all(ref.force.axis == axis)
            z, ticks = surface - ref.force.newtons / 1e4 if ref.force else ref.p[2], ticks + 1
        return ticks

    slow = {"approach_m_s": 0.01, "reach_m": 0.05}
    # 5 mm at 10 mm/s, then nine tenths of the ramp, and 50 ms.
    assert 760 < press(-0.005, slow) < 860
    assert 500 < press(-0.005, slow | {"until_newtons": 1.0}) < 600
    with pytest.raises(ValueError):
        press(-0.1, slow)


# An opponent may write wherever its user may: it states its score, and makes the task easier.
FORGER = """
import json
import os
import pathlib

import armplane.arena
import numpy as np


class Forger(armplane.arena.Velocity):
    def setup(self, arm):
        pathlib.Path(os.environ.pop("ARMPLANE_ARENA_COST")).write_text(json.dumps({"s1": True, "outcome": "goal reached", "median_us": 1.0, "p99_us": 1.0, "first_ms": 1.0}))
        for path in pathlib.Path(__file__).parent.glob("tasks/**/*.toml"):
            path.write_text(path.read_text().replace("to_m = ", "by_m = [0, 0, 0] #"))

    def qdot(self, q, ref):
        return np.zeros(self.arm.n)
"""


def test_an_opponent_cannot_write_its_score_or_its_task(tmp_path):
    (tmp_path / "forger.py").write_text(FORGER)
    _, rows = arena(tmp_path, f"--lines 1 --law forger={tmp_path}/forger.py --jobs 1")
    assert len(rows) > 1 and not any(row.get("s1") or row["outcome"] == "goal reached" for row in rows)
    arena(tmp_path, f"--law armplane --law armplane={tmp_path}/forger.py", 2)


def arena(folder, asked, code=0):
    """The ended command, and the rows in its folder."""
    done = ended(f"{_program()} arena --size short --robot ur5 --out {folder} --jobs 2 {asked}")
    assert done.returncode == code, done.stderr
    rows = folder / "rows.jsonl"
    return done, [json.loads(line) for line in rows.read_text().splitlines()] if rows.exists() else []


def test_the_arena_runs_continues_and_repeats_itself(tmp_path):
    (tmp_path / "mine.py").write_text(HOME_MADE)
    laws = f"--law armplane --law mine={tmp_path}/mine.py --law absent={tmp_path}/absent.py"
    (tmp_path / "absent.py").write_text("import no_such_package\n")
    first, rows = arena(tmp_path / "a", f"{laws} --again 1")
    assert len(rows) == 8 and {row["law"] for row in rows} == {"armplane", "mine"}
    # A machine at its limits may end a law before it has said what it took.
    assert {row["law"] for row in rows if row.get("median_us", 0) > 0} == {"armplane", "mine"}
    digest = lambda done: done.stdout.split("hash ")[1].split(";")[0]
    # Continued, nothing is run again; in another folder, everything is, to the same bits.
    half = (tmp_path / "a/rows.jsonl").read_text().splitlines(keepends=True)
    (tmp_path / "a/rows.jsonl").write_text("".join(half[:-2]) + half[-2][:20])
    second, _ = arena(tmp_path / "a", laws)
    assert digest(second) == digest(first) and second.stderr.count(" of 2, ") == 2
    assert "left out" in second.stderr and "no_such_package" in second.stderr
    for wrong in ("--law mine=nowhere.py", "--law nothing", f"--check {tmp_path}/mine.py", "--robot nobody"):
        arena(tmp_path / "b", wrong, 2)
    assert pathlib.Path(tmp_path / "a/arena.html").stat().st_size > 1000


# In its first run it fails at its first tick.
FAILING = HOME_MADE + """
    def setup(self, arm):
        self.mark = __import__("pathlib").Path(__file__).with_suffix(".failed")
        self.fails = not self.mark.exists()

    def torque(self, q, qdot, ref):
        if self.fails:
            self.mark.touch()
            {how}
        return super().torque(q, qdot, ref)
"""


@pytest.mark.parametrize(
    "how, why",
    [
        ("1 / 0", "ZeroDivisionError"),
        ("__import__('os')._exit(3)", "ended"),
        ("__import__('time').sleep(1000)", "within 3 s"),
        ("__import__('signal').raise_signal(19)", "within 3 s"),
    ],
)
def test_an_opponent_that_fails_has_another_process_for_its_next_run(tmp_path, how, why):
    (tmp_path / "failing.py").write_text(FAILING.replace("{how}", how))
    _, (first, second) = arena(tmp_path / "a", f"--lines 1 --jobs 1 --join-limit 3 --law failing={tmp_path}/failing.py")
    assert first["outcome"] == "failed" and why in first["reason"], first["reason"]
    assert second["completed"]


def test_a_law_that_fails_at_its_first_tick_has_rows_but_no_curve(tmp_path):
    (tmp_path / "failing.py").write_text(HOME_MADE + "\n    def torque(self, q, qdot, ref):\n        raise MemoryError\n")
    _, rows = arena(tmp_path / "a", f"--lines 1 --law armplane --law failing={tmp_path}/failing.py", 1)
    assert (tmp_path / "a/arena.html").exists()
    assert all(row.get("completed", False) == (row["law"] == "armplane") for row in rows)


def test_tracks_and_variations_are_rows_of_their_own(tmp_path):
    (tmp_path / "mine.py").write_text(HOME_MADE)
    _, rows = arena(tmp_path / "a", f"--lines 1 --law armplane --law mine={tmp_path}/mine.py --tracks --varied")
    rows = {(row["condition"], row["law"], row["task"]): row for row in rows}
    hashes = lambda law: {condition: row["hash"] for (condition, name, task), row in rows.items() if name == law and task == "ur5-usual-1"}
    # Payload, noise and delay reach the plant of both; the clock is switched on where there is one.
    assert len(set(hashes("armplane").values())) == 5 and len(hashes("mine")) == 6
    assert {law for condition, law, _ in rows if condition == "own clock"} == {"mine"}
    # Without its hint, the same way of the hand, in another posture.
    assert rows["no hints", "armplane", "fig5-wrist-rotation"]["task_hash"] != rows["given clock", "armplane", "fig5-wrist-rotation"]["task_hash"]
    late = rows["delay 2 ticks", "armplane", "ur5-usual-1"]
    assert late["stopped_ticks"] == 2 and late["s1"] and "joint stop" not in late["missed"]
    assert "data:image/svg+xml" in (tmp_path / "a/arena.html").read_text()


def test_two_hundred_lines_of_the_test_seed_are_not_those_of_training():
    assert sum(tasks.DATA["sizes"]["full"]["lines"].values()) * len(tasks.DATA["arms"]) == 200
    assert tasks.TRAINING != tasks.TEST


def test_one_that_lasts_longer_than_a_delay_is_still_stopped():
    row = {"missed": "joint stop", "s1": False, "s2": False, "stopped_ticks": 3, "orthogonal_max_deg": 0.1}
    assert not after_delay(dict(row))["s1"] and after_delay({**row, "stopped_ticks": 2})["s1"]
    assert not after_delay({**row, "missed": "joint stop, end", "stopped_ticks": 2})["s1"]


def test_the_arm_is_the_same_in_pinocchio():
    pinocchio = pytest.importorskip("pinocchio")
    from armplane.arena import Arm

    arm = Arm(ARM)
    model = arm.pinocchio()
    data, frame = model.createData(), model.getFrameId("end_effector")
    for q, qdot in np.random.default_rng(0).uniform(-1, 1, (5, 2, arm.n)):
        pinocchio.computeAllTerms(model, data, q, qdot)
        pinocchio.updateFramePlacements(model, data)
        J = pinocchio.getFrameJacobian(model, data, frame, pinocchio.LOCAL_WORLD_ALIGNED)
        assert np.abs(data.oMf[frame].translation - arm.pose(q)[1]).max() < 1e-12 and np.abs(J - arm.J(q)).max() < 1e-12
        assert np.abs(np.triu(data.M) - np.triu(arm.A(q))).max() < 1e-10
        arm.move_to(q, qdot)
        assert np.abs(data.nle - arm.bias()).max() < 1e-10
    assert model.nq == 3 and model.upperPositionLimit[1] == 2 and model.velocityLimit[0] == 3


_BODY = (
    '<body name="link{i}" pos="0.1 0.2 0.3" xyaxes="{x}"><joint name="joint{i}" axis="0.6 0 0.8" armature="0.1" user="3" {range}/>'
    '<inertial pos="0.1 0.02 -0.03" mass="{i}" fullinertia="0.1 0.12 0.13 0.01 0.02 -0.01"/>'
)
ARM = (
    '<mujoco><compiler angle="radian" autolimits="true"/><option gravity="0 0 -9.81"/><worldbody>'
    + "".join(_BODY.format(i=i, x=x, range='range="-1 2"' if i == 2 else "") for i, x in ((1, "1 0 0 0 1 0"), (2, "0 1 0 0 0 1"), (3, "0 0.6 0.8 1 0 0")))
    + '<site name="end_effector" pos="0.1 0.2 0.3" xyaxes="0 0 1 1 0 0"/></body></body></body></worldbody><keyframe><key name="start" qpos="0 0 0"/></keyframe></mujoco>'
)


def test_an_opponent_that_floods_or_hangs_while_it_loads_is_neither_kept_nor_waited_for(tmp_path, monkeypatch):
    (tmp_path / "flood.py").write_text(f"import sys\nfor _ in range(20000): print('x' * 1000), print('y' * 1000, file=sys.stderr)\n{HOME_MADE}")
    reason, about = program.asked_file(tmp_path / "flood.py", {})
    assert not reason and about["has_clock"]
    monkeypatch.setitem(program.LONGEST, "join", 1)
    (tmp_path / "hang.py").write_text("import time\ntime.sleep(1000)\n")
    assert program.asked_file(tmp_path / "hang.py", {}) != ("", {})
