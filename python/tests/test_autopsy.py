"""A dozen incidents of known cause (incidents.py makes hundreds), files that are damaged, and logs that do not fit, asked of `armplane.autopsy`."""

import json
import pathlib
import re
import sys

import armplane
import incidents
import numpy as np
import pandas
import pytest
from armplane import autopsy
from processes import ended
from repository import tutorial

pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """A slow UR5 whose file states no masses and torque limits, as many do; the simulated drives have limits."""
    path, text = tmp_path_factory.mktemp("arm") / "bare.urdf", (incidents.ROBOTS / "ur5.urdf").read_text()
    text = re.sub('effort="[^"]*" velocity="[^"]*"', 'effort="0" velocity="2"', re.sub("(?s)<inertial>.*?</inertial>", "", text))
    path.write_text(text)
    made = incidents.Arm("bare", "tool0", path)
    made.effort[:] = [80, 80, 60, 15, 10, 6]
    return made, str(path)


def made(arm, cause, how, style, folder, seed=1):
    """The path of a log of this cause, when it happened, and the logged rows."""
    rng = np.random.default_rng(seed)
    rows, felt = incidents.happened(arm, rng, cause, how)
    log = incidents.log_rows(arm, rows, rng, 250)
    return incidents.write(log, arm, folder, rng, style), felt, log


@pytest.mark.parametrize(
    "cause, how, style",
    [
        ("singularity", "dls", "csv"),
        ("singularity", "pinv clamped", "mcap"),
        ("singularity", "servo halt", "rosbag2"),
        ("singularity", "pinv fault", "csv degrees"),
        ("joint limit", ("joints", False), "rosbag2 mcap"),
        ("speed limit", ("joints", False), "csv"),
        ("gap in the stamps", ("joints", True), "csv"),
        ("jump in the command", ("joints", True), "lerobot"),
        ("NaN", ("joints", False), "csv"),
        ("oscillation", ("joints", False), "mcap"),
        ("unknown", ("joints", False), "csv"),
        ("none", ("joints", True), "lerobot"),
    ],
)
def test_the_cause_is_found(arm, tmp_path, cause, how, style):
    path, felt, log = made(arm[0], cause, how, style, tmp_path)
    answer = autopsy.autopsy(path, arm[1], picture=tmp_path / "why.png")
    assert answer["cause"] == cause, answer["text"]
    assert (tmp_path / "why.png").stat().st_size > 10_000
    if cause != "none":
        # A halt begins with the slowing down, and is felt once the hand stands still.
        first = answer["evidence"][0]
        assert answer["t"] - 0.5 < felt < first.get("until", answer["t"]) + 0.5
    if cause == "singularity":
        assert incidents.off_deg(arm[0], log["t"], log["q"], answer["evidence"][0]) < 5


def table(path, names, *columns):
    pandas.DataFrame(np.column_stack(columns), columns=names.split()).to_csv(path, index=False)


def test_another_order_of_joints_is_found_and_another_robot_is_said(arm, tmp_path):
    path, _, log = made(arm[0], "none", ("twist", False), "csv", tmp_path)
    order = [2, 0, 1, 5, 3, 4]
    pose = [arm[0].pose(q)[0] for q in log["q"]]
    for name, q in (("mixed", log["q"][:, order]), ("other", 1.4 * log["q"] + 0.3)):
        table(tmp_path / f"{name}.csv", "time q0 q1 q2 q3 q4 q5 tcp_pose_x tcp_pose_y tcp_pose_z", log["t"], q, pose)
    mixed = autopsy.autopsy(tmp_path / "mixed.csv", arm[1])
    assert mixed["cause"] == "none" and any("2, 3, 1, 5, 6, 4" in note for note in mixed["notes"])
    assert autopsy.autopsy(tmp_path / "other.csv", arm[1])["cause"] == "another robot"


def test_a_run_is_judged_by_its_own_arm(tmp_path):
    # The tutorial's arm of three joints is asked for its tip's place alone; its description, which says so, is in the log.
    for name in ("arm.urdf", "arm.toml", "reach.toml"):
        (tmp_path / name).write_text(tutorial()[name])
    run, log = armplane.run(tmp_path / "reach.toml", out=tmp_path / "reach"), tmp_path / "elsewhere.mcap"
    (tmp_path / "reach/messages.mcap").rename(log)
    assert run.summary["outcome"] == "goal reached"
    assert autopsy.autopsy(log, None)["cause"] == "none"
    with pytest.raises(ValueError, match=r"elsewhere\.mcap has 3 joints, the arm panda has 7"):
        autopsy.autopsy(log, "panda")


def test_zeros_behind_the_last_joint_are_no_joints(tmp_path):
    t = np.arange(0, 2, 0.01)
    q = np.c_[np.sin(t)[:, None] * np.linspace(0.1, 0.2, 3), np.zeros((len(t), 5))]
    table(tmp_path / "eight.csv", "time q[0] q[1] q[2] q[3] q[4] q[5] q[6] q[7]", t, q)
    with pytest.raises(ValueError, match="no 7 joint positions of panda found"):
        autopsy.autopsy(tmp_path / "eight.csv", "panda")


def test_columns_are_mapped_in_their_order(tmp_path):
    t = np.arange(0, 2, 0.01)
    q = 0.5 + np.sin(t)[:, None] * np.linspace(0.1, 0.2, 6)
    table(tmp_path / "odd.csv", "w error_1 zz0 zz1 zz2 zz3 zz4 zz5", t, t, q)
    answer = autopsy.autopsy(tmp_path / "odd.csv", "ur5", mapping={"t": ["w"], "q": ["zz*"]})
    assert answer["columns"] == {"q": "zz0, zz1, zz2, zz3, zz4, zz5"} and abs(answer["rate_hz"] - 100) < 1
    with pytest.raises(ValueError, match="w, error_1, zz0"):
        autopsy.autopsy(tmp_path / "odd.csv", "ur5")


def test_a_damaged_file_is_one_sentence(tmp_path):
    good = "time,q0,q1,q2,q3,q4,q5\n0.1,0,0,0,0,0,0\n"
    files = {
        "empty.csv": b"", "garbage.mcap": bytes(range(256)) * 99, "garbage.parquet": b"PAR1" + b"\xff" * 999 + b"PAR1", "garbage.db3": b"SQLite format 3\0" + b"x" * 999,
        "header.csv": b"time,q0\n", "words.csv": b"time,q\n" + b"x,y\n" * 50, "short.csv": good.encode(), "zero.csv": b"\0" * 999,
        "chunk.mcap": b"\x89MCAP0\r\n\x06" + b"\xff" * 8 + b"x" * 99, "unknown.bin": b"1",
    }  # fmt: skip
    for name, content in files.items():
        path = tmp_path / name
        path.write_bytes(content)
        done = ended(f"{sys.executable} -m armplane.autopsy {path} --robot ur5")
        assert done.returncode == 2 and done.stderr.startswith("armplane: ") and done.stderr.count("\n") == 1 and not done.stdout, (name, done.stderr)


def test_many_logs_are_a_table_and_json_lines(arm, tmp_path):
    logs = tmp_path / "logs"
    for k, cause in enumerate(("none", "jump in the command")):
        (logs / str(k)).mkdir(parents=True)
        path, _, _ = made(arm[0], cause, ("joints", False), "csv", logs / str(k))
        pathlib.Path(path).rename(logs / f"{k}.csv")
    command = f"{sys.executable} -m armplane.autopsy {logs} --robot {arm[1]}"
    done = ended(f"{command} --json")
    assert done.returncode == 0 and [json.loads(line)["cause"] for line in done.stdout.splitlines()] == ["jump in the command", "none"]
    assert len(ended(command).stdout.splitlines()) == 3
