"""The package as it is installed: `python/build --test` runs this in an empty virtual environment."""

import os
import subprocess
import sys
import time
from pathlib import Path

import armplane
import numpy as np
import pytest
from armplane import Arm, Law
from armplane.limited import Ended, limited
from scipy.spatial.transform import Rotation

WIRE = armplane.wire


def test_a_new_user_has_a_first_verdict():
    run = armplane.run("fig5-wrist-rotation", out="first")
    assert run.goal_reached and run.summary["task"]["orientation_max_deg"] < 0.5
    assert len(run.signals) == run.summary["ticks"] and "goal reached" in run._repr_html_()


@pytest.mark.parametrize(
    "name, by, q",
    [
        ("ur5", "pose", [0.3, -1.2, 1.4, -0.6, 0.15, 0.2]),
        ("iiwa14", "pose", [0.2, 0.5, 0.1, -0.2, 0.3, 0.6, 0.0]),
        ("puma560", "twist", [0.3, -1.0, 2.9, 0.2, 0.15, 0.1]),
    ],
)
def test_a_law_gives_the_bits_of_the_process(name, by, q):
    """Near a singularity, with the inputs of the process `controller` in a steered run with sensor noise: the same torques and β at every tick."""
    arm = Arm.builtin(name)
    n, p, twist = arm.dof, arm.at(q).pose[:3, 3], [0.08, 0.0, -0.02, 0.0, 0.3, 0.1]
    quaternion = np.roll(Rotation.from_matrix(arm.at(q).pose[:3, :3]).as_quat(), 1)
    text = lambda *parts: " ".join(repr(float(x)) for part in parts for x in part)
    lines = ["# armplane targets 1, length m"]
    for tick in range(1500):
        values = text(p + 1e-3 * tick * np.array(twist[:3]), quaternion, twist) if by == "pose" else text(twist)
        lines.append(f"{tick / 1000}, {by}, base, 1.0, {values}")
    Path(f"{name}.csv").write_text("\n".join([*lines, ""]))
    text = f'name = "{name}"\nrobot = "{name}"\n[start]\nq = {q}\n[servo]\ninput = "{name}.csv"\n'
    Path(f"{name}.toml").write_text(text)
    run = armplane.run(f"{name}.toml", out=name)
    estimates, targets, torques, states = (run.messages(topic) for topic in ("estimate", "target", "torque", "control_state"))
    law, engaged = Law(arm, q=q), 0
    for tick in range(1500):
        target, estimate = targets[tick]["target"], estimates[tick]
        assert target["given_tick"] == tick == estimate["header"]["tick"]
        pose = np.concatenate([target["position"], target["quaternion"]]) if by == "pose" else None
        tau = law.step(estimate["q"][:n], estimate["qdot"][:n], pose, target["twist"], tau_disturbance=estimate["tau_disturbance"][:n])
        assert tau.tobytes() == torques[tick]["tau"][:n].tobytes(), f"tick {tick}"
        engaged += min(law.state.beta.values()) < 1
    # The report has its places in another order than that of their names.
    places = np.argsort([one.name for one in arm.singularities(q)])
    assert [*law.state.beta.values()] == states[1499]["beta"][places].tolist()
    assert engaged > 100


@pytest.fixture
def puma():
    """An arm, a posture, no speed, and the pose of its hand."""
    arm = Arm.builtin("puma560")
    q = np.array(arm.postures["nominal"])
    return arm, q, np.zeros(6), arm.at(q).pose


def test_a_number_is_refused_in_words_and_never_raises(puma):
    arm, q, zero, pose = puma
    for i, bad in enumerate([np.nan, np.inf, -np.inf, 1e300]):
        law, wrong = Law(arm), q.copy()
        assert not law.step(np.full(6, bad), zero).any() and law.state.refusal, "not begun: no torque"
        law.step(q, zero, pose)
        assert law.state.refusal == "" and law.state.phase == WIRE.PHASES[WIRE.PHASE_RUNNING]
        law.step(q, zero, np.where(pose == 0, 0, bad))
        assert law.state.targets_refused == 1 and law.state.target_refusal and law.state.refusal == ""
        wrong[i] = bad
        for _ in range(300):
            assert np.isfinite(law.step(wrong, zero, pose)).all()
        assert law.state.refusal and law.state.reason == law.state.refusal
        law.reset()
        law.step(q, zero, pose)
        assert law.state.refusal == ""
    assert arm.step_many(np.full((3, 6), np.nan))["count"].sum() == 0


def test_a_pose_in_millimetres_or_transposed_is_refused(puma):
    arm, q, zero, pose = puma
    far, mirrored = pose.copy(), pose @ np.diag([1.0, 1.0, -1.0, 1.0])
    far[:3, 3] *= 1000
    for wrong, refused in ((pose, 0), (pose + 1e-12, 0), (pose.T, 1), (mirrored, 1), (far, 1)):
        law = Law(arm)
        law.step(q, zero, wrong)
        assert law.state.targets_refused == refused


def test_a_wrong_argument_is_named_with_what_is_expected():
    arm, zero = Arm.builtin("iiwa14"), np.zeros(7)
    law = Law(arm)
    law.step_many(np.zeros((4, 7)), np.zeros((4, 7)))
    for call, words in [
        (lambda: law.step(zero[:5], zero), r"q .*\(5,\).*\(7,\)"),
        (lambda: law.step(zero, zero, np.eye(3)), r"pose .*\(3, 3\).*\(7,\).*\(4, 4\)"),
        (lambda: law.step(zero, zero, twist=zero), r"twist .*\(7,\).*\(6,\)"),
        (lambda: law.step(zero, zero, out=np.zeros(3)), r"out .*\(3,\).*\(7,\)"),
        (lambda: law.step_many(np.zeros((3, 7)), np.zeros((3, 7))), r"q .*\(3, 7\).*\(4, 7\)"),
        (lambda: law.step(zero, zero, out=np.zeros(7, int)), r"out .*float64.*\(7,\)"),
        (lambda: law.step(zero, zero, out=np.zeros(14)[::2]), r"out .*\(7,\)"),
        (lambda: arm.step_many(zero), r"q .*\(7,\).*\(N, 7\)"),
        (lambda: Law(arm, dt=0.3), "dt.*0.3"),
        (lambda: Law(arm, settings={"control.kp": 1}), "kp.*k_p"),
        (lambda: Law(arm, q=zero + 9), "joint.*9"),
        (lambda: Arm.builtin("iiwa"), "iiwa.*iiwa14"),
        (lambda: arm.at(["a"] * 7), "q: .*'a'"),
        (lambda: arm.at(0.0), r"q .*\(\).*\(7,\)"),
        (lambda: Arm.from_urdf("nothing.urdf"), "nothing.urdf"),
        (lambda: armplane.lines("ur5", 0), "count.*1"),
        (lambda: armplane.lines(arm, 1), "robot.*path"),
        (lambda: armplane.lines("ur5", 1, speed=280), "speed.*m/s"),
    ]:
        with pytest.raises(ValueError, match=words):
            call()
    assert arm.step_many(np.zeros((0, 7))).shape == (0,)
    with pytest.raises(TypeError, match="MjModel"):
        Arm.from_mujoco("arm.xml")
    for folder in ("nothere", __file__):
        with pytest.raises(FileNotFoundError, match="summary.json"):
            armplane.load(folder)


URDF = """<robot name="two"><link name="base"/>
<link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="2"/><inertia ixx="0.01" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.2 0 0"/><mass value="1"/><inertia ixx="0.01" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tool0"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="40" velocity="4"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0"/><axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="20" velocity="4"/></joint>
<joint name="flange" type="fixed"><parent link="fore"/><child link="tool0"/><origin xyz="0.4 0 0"/></joint></robot>"""


def test_a_urdf_that_lacks_something_is_refused_with_the_joint_and_the_remedy():
    def arm(text):
        Path("two.urdf").write_text(text)
        return Arm.from_urdf("two.urdf", tip="tool0")

    good = arm(URDF)
    assert (good.dof, good.tip, good.joints) == (2, "tool0", ["shoulder", "elbow"])
    assert any(one.inside for one in good.singularities([0.3, 0])) and not any(one.inside for one in good.singularities([0.3, 1]))
    inertia = URDF[URDF.index('<inertial><origin xyz="0.2 0 0"/><mass value="1"') : URDF.index('</link>\n<link name="tool0"/>')]
    # Kinematics needs neither masses nor limits, the law all of them.
    bare = arm(URDF.replace(inertia, ""))
    assert np.isnan(bare.at([0.3, 0]).A).any() and any(one.inside for one in bare.singularities([0.3, 0]))
    limits = '<limit lower="-2" upper="2" effort="20" velocity="4"/>'
    lacks = {inertia: "fore.*<inertial>", limits: "elbow.*lower.*velocity", ' effort="20"': "elbow.*effort", ' velocity="4"': "shoulder.*velocity"}
    for without, words in lacks.items():
        with pytest.raises(ValueError, match=f"(?s){words}"):
            Law(arm(URDF.replace(without, "")))


def test_many_states_at_once_are_the_same_as_one_by_one():
    random, checked = np.random.default_rng(5), 0
    for name in ("puma560", "iiwa14", "panda"):
        arm = Arm.builtin(name)
        N, n = 200, arm.dof
        q = random.uniform(np.maximum(arm.lower, -2.5), np.minimum(arm.upper, 2.5), (N, n))
        q[::2, {"puma560": 4}.get(name, 3)] = np.clip(0, arm.lower, arm.upper)[{"puma560": 4}.get(name, 3)]
        twist = random.normal(0, 0.2, (N, 6))
        found, many = arm.step_many(q, far=True), Law(arm)
        near = np.abs(found["singularities"]["s"]) <= 1.3 * found["singularities"]["eta_out"]
        assert (arm.step_many(q)["singularities"][near] == found["singularities"][near]).all() and near.any()
        tau = [many.step_many(q, q * 0, twist=twist) for _ in range(5)]
        assert np.isfinite(tau).all() and (np.abs(tau) <= arm.effort).all() and not many.refused.any()
        for row in range(0, N, 40):
            alone = Law(arm)
            assert all((alone.step(q[row], q[row] * 0, twist=twist[row]) == tau[tick][row]).all() for tick in range(5))
            assert repr(alone.state) == repr(many.state_of(row))
            for one, place in zip(arm.singularities(q[row]), found[row]["singularities"]):
                assert (place["s"], place["inside"], WIRE.TYPES[place["class_"]]) == (one.measure, one.inside, one.type)
                assert (place["zeta_B"] == one.direction).all()
                checked += 1
        many.reset(np.arange(N) < 3)
        assert many.step_many(q, q * 0).shape == (N, n) and many.state_of(0).tick == 1 and many.state_of(3).tick == 6
    assert checked > 30


def test_more_rows_than_there_is_memory_for_raise_memory_error():
    # In a child, whose memory is limited: there may be room for them all.
    lines = [
        "import armplane, numpy, resource",
        "law, q = armplane.Law(armplane.Arm.builtin('puma560')), numpy.zeros((300_000, 6))",
        "resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))",
        "try: law.step_many(q, q)",
        "except MemoryError: law.step_many(q[:100], q[:100]); print('caught')",
    ]
    child = subprocess.run([sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True)
    assert child.stdout == "caught\n", child.stderr


def test_a_function_is_ended_by_its_limits():
    assert limited(60, abs, -1) == 1
    for kind, call in [(Ended, (0.2, time.sleep, 600)), (Ended, (60, os.abort)), (Ended, (60, bytearray, 1 << 50)), (ValueError, (60, int, "x"))]:
        with pytest.raises(kind):
            limited(*call)


def test_every_public_thing_has_words():
    assert dir(armplane) == sorted(armplane.__all__) and {"Arm", "Law", "trial"} <= set(dir(armplane))
    for kind in (Arm, Law, armplane.LawState, armplane.Posture, armplane.Singularity, armplane.Run):
        for name in [name for name in vars(kind) if not name.startswith("_")]:
            assert getattr(kind, name).__doc__, f"{kind.__name__}.{name}"


# Every way of MJCF to state a pose, a mass, a limit or a default, in one arm.
ODD = Path(__file__).with_name("odd.xml")


def test_an_arm_in_mjcf_has_mujocos_numbers():
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(ODD))
    data = mujoco.MjData(model)
    arms = [Arm.from_mujoco(model, site="tip"), Arm.from_urdf(ODD, tip="tip")]
    for arm in arms:
        assert any("'j1'" in note and "velocity" in note for note in arm.notes)
        assert list(arm.effort) == [24, 8, 18, 90, 3] and arm.joints == ["j1", "j2", "j3", "j4", "j5"]
    random = np.random.default_rng(1)
    for _ in range(100):
        data.qpos[:], data.qvel[:] = random.uniform(-1, 1, 5), random.normal(size=5)
        mujoco.mj_forward(model, data)
        A, linear, angular = np.zeros((5, 5)), np.zeros((3, 5)), np.zeros((3, 5))
        mujoco.mj_fullM(model, data, A)
        mujoco.mj_jacSite(model, data, linear, angular, 0)
        for arm in arms:
            at = arm.at(data.qpos, data.qvel)
            for ours, theirs in [(at.A, A), (at.bias, data.qfrc_bias), (at.J, np.vstack([linear, angular])), (at.pose[:3, 3], data.site_xpos[0])]:
                np.testing.assert_allclose(ours, theirs, atol=1e-12)


TETRAHEDRON = "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.3\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
HAND = """<mujoco><compiler meshdir="assets"/><asset><mesh name="hand" file="hand.obj" scale="2 1 1"/></asset><worldbody>
<body name="hand" pos="0 0 0.4"><joint name="one" axis="0 1 0" range="-90 90"/><geom type="mesh" mesh="hand"/>
<body name="finger" pos="0 0 0.3"><joint name="finger" type="slide" axis="1 0 0" range="0 0.01"/><geom size="0.01"/></body></body></worldbody>
<keyframe><key name="home" qpos="0.5 0"/><key name="far" qpos="2 0"/></keyframe></mujoco>"""


def test_mjcf_has_included_files_meshes_with_their_mass_and_keys(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    (tmp_path / "assets").mkdir()
    (tmp_path / "assets/hand.obj").write_text(TETRAHEDRON)
    (tmp_path / "hand.xml").write_text(HAND)
    (tmp_path / "whole.xml").write_text('<mujoco><include file="hand.xml"/></mujoco>')
    arm = Arm.from_urdf(tmp_path / "whole.xml")
    # A tetrahedron of water, 0.2 by 0.1 by 0.3 m, and what is fixed to it.
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "whole.xml"))
    data = mujoco.MjData(model)
    data.qpos[0] = 0.3
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(arm.at([0.3]).bias, data.qfrc_bias[:1], atol=1e-12)
    assert arm.postures == {"home": [0.5]} and any("'far'" in note for note in arm.notes)
    from armplane.mjcf import read

    urdf, _ = read(tmp_path / "whole.xml")
    assert 'filename="assets/hand.obj"' in urdf and "scale=" in urdf


def test_an_arm_in_mjcf_runs_and_its_saved_scenario_repeats_it():
    pytest.importorskip("mujoco")
    Path("up.toml").write_text(
        f'name = "up"\nrobot = "{ODD}"\nsettle_s = 0.1\n[start]\nq = [0.1, 0.2, 0.3, 0.05, 0.4]\n[[segment]]\nby_m = [0.0, 0.0, 0.01]\nduration_s = 0.5\n'
    )
    one = armplane.run("up.toml", out="one")
    two = armplane.run("one/scenario.toml", out="two")
    assert one.goal_reached and one.summary["topics"] == two.summary["topics"]
    assert Path("two/robot.urdf").exists()

ARM = """<body name="base" pos="0 0.2 0.1"><body name="upper"><joint name="one" axis="0 1 0" range="-170 170" armature="0.1" damping="0.5"/>
<inertial pos="0.15 0 0" mass="2" diaginertia="0.01 0.02 0.02"/><geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03"/>
<body name="fore" pos="0.3 0 0"><joint name="two" axis="0 1 0" range="-170 170" armature="0.1"/><inertial pos="0.15 0 0" mass="1" diaginertia="0.01 0.02 0.02"/>
<geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03"/><site name="tip" pos="0.3 0 0"/></body></body></body>"""
SERVOS = '<actuator><position joint="one" kp="90" forcerange="-60 60"/><velocity joint="two" kv="9" forcerange="-60 60"/></actuator>'
BALL = '<body name="ball" pos="0.3 0.2 0.9"><freejoint/><geom size="0.03" density="300"/></body><geom type="plane" size="2 2 0.1"/>'


def test_mujoco_is_the_plant_and_gives_the_same_bytes_twice():
    pytest.importorskip("mujoco")
    file = lambda name, bodies: Path(name).write_text(f'<mujoco model="two"><worldbody>{bodies}</worldbody>{SERVOS}</mujoco>')
    file("arm.xml", ARM), file("scene.xml", ARM + BALL), file("other.xml", ARM.replace("0.3 0 0", "0.31 0 0"))
    Path("arm.toml").write_text('[joints]\none = { velocity = 4 }\ntwo = { velocity = 4 }\n')
    Path("line.toml").write_text('name = "line"\nrobot = "arm.xml"\n[start]\nq_deg = [-60, 100]\n[[segment]]\nby_m = [0.05, 0, 0.05]\nduration_s = 0.6\n')
    runs = [armplane.run("line.toml", plant=plant, out=out) for out, plant in [("a", "mujoco"), ("b", "mujoco"), ("c", "mujoco:scene.xml"), ("d", None)]]
    assert all(run.goal_reached for run in runs), runs
    alone, again, scene, ours = runs
    assert alone.summary["topics"] == again.summary["topics"] != ours.summary["topics"]
    q, hit = ([run.messages("plant_state")[name] for run in runs] for name in ("q", "contacts"))
    # The same arm, another integrator; the ball that falls on it is felt, and the arm is back on its line.
    ticks = min(map(len, q))
    assert np.abs(q[0][:ticks] - q[3][:ticks]).max() < 1e-3 and not hit[0].any()
    assert hit[2].any() and np.abs(q[2][:ticks] - q[0][:ticks]).max() > 1e-5
    file("light.xml", ARM.replace('armature="0.1"', ""))
    rail = '<joint name="rail" type="slide"/><inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/><body name="upper">'
    file("driven.xml", ARM.replace('<body name="upper">', rail))
    file("many.xml", ARM + '<replicate count="1000000000" offset="1 0 0"><body><geom size="0.1"/></body></replicate>')
    os.mkfifo("pipe.xml")
    wrong = {"other": "two.*another arm", "light": "two has 30%.*armature", "driven": "one moves on joint rail", "absent": "No such file"}
    # One that never ends, and one that is a billion bodies.
    for scene, words in {**wrong, "pipe": "no regular file", "many": "takes more than|needs more memory|makes its reader crash|many"}.items():
        with pytest.raises(RuntimeError, match=words):
            armplane.run("line.toml", plant=f"mujoco:{scene}.xml", out="e")
        assert not Path("e").exists()


def test_a_controller_needs_no_topic_but_the_estimate():
    class Mine(armplane.Controller):
        def control(self, tick, estimate, singularity, state, torque):
            self.given = estimate, singularity, state, torque

    one = object.__new__(Mine)
    one.topics = {"estimate": 1, "control_state": 2, "torque": 3}
    one.tick(0)
    assert one.given == (1, None, 2, 3)
