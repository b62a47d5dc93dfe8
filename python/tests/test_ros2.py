"""`--ros2`: a participant in another process, with cyclonedds alone, steers a UR5 and hears of it; what a killed side leaves."""

import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import time
from time import monotonic

import armplane
import numpy as np
import pytest
from armplane.results import _program
from armplane.ros2.door import DEFINED
from armplane.ros2.servo import Commands, fields, quaternion
from armplane.rotation import rotation_exp, rotation_log, rotation_of
from numpy.linalg import norm
from processes import ended, having, wait
from scipy.spatial.transform import RigidTransform, Rotation

pytest.importorskip("cyclonedds"), pytest.importorskip("rosbags")
HERE = pathlib.Path(__file__).parent
JOINTS = "shoulder_pan shoulder_lift elbow wrist_1 wrist_2 wrist_3".split()
NEAR_LOCK = np.array([0.3, -1.2, 1.4, -0.6, 0.15, 0.2])
STEERED = f"servo ur5 --duration 300 --start {','.join(map(str, np.degrees(NEAR_LOCK)))}"
# One of its own for each worker: other tests on this machine are not to be steered.
DOMAIN = os.environ["ROS_DOMAIN_ID"] = str(20 + os.getpid() % 80)
TWIST, POSE, JOG, PATH = "servo_node/delta_twist_cmds", "servo_node/pose_target_cmds", "servo_node/delta_joint_cmds", "joint_trajectory"


@pytest.fixture(scope="session")
def store():
    import ros2_peer

    return ros2_peer.store()


def test_our_messages_are_those_of_the_package_to_copy(store):
    for name, ours in DEFINED.items():
        if full := store.fielddefs.get(name.replace("/", "/msg/")):
            assert [field for _, field in ours] == [field for field, _ in full[1]], name


def test_frames_are_those_of_the_urdf(tmp_path):
    """A tool beyond the end-effector, and a camera on a moving link."""
    from armplane.play.robot import Robot

    link = lambda name, parent, xyz, rpy: (f'<link name="{name}"/><joint name="to_{name}" type="fixed"><parent link="{parent}"/><child link="{name}"/>'
                                           f'<origin xyz="{xyz}" rpy="{rpy}"/></joint>')
    more = link("camera", "forearm_link", "0.1 0.2 0.3", "0.4 0.5 0.6") + link("pen", "tool0", "0 0 0.1", "0 0.3 0")
    ended(f"{_program()} servo ur5 --random 1 --duration 0.05 --out {tmp_path}/run")
    job = json.loads((tmp_path / "run/job.json").read_text())
    job["robot"]["urdf"] = job["robot"]["urdf"].replace("</robot>", more + "</robot>")
    robot, q = Robot(job), np.array([0.3, -1.2, 1.6, -1, 0.9, 0.2])
    frame = Commands(robot, True).frame
    offset = lambda xyz, rpy: RigidTransform.from_components(xyz, Rotation.from_euler("xyz", rpy)).as_matrix()
    at = armplane.Arm.builtin("ur5").at(q)
    for name, pose in {
        "forearm_link": at.links[2],
        "camera": at.links[2] @ offset([0.1, 0.2, 0.3], [0.4, 0.5, 0.6]),
        "pen": at.pose @ offset([0, 0, 0.1], [0, 0.3, 0]),
        "/base_link": np.eye(4),
    }.items():
        assert np.abs(frame(name, q) - pose).max() < 1e-9, name
    assert robot.base == "base_link"
    R = rotation_exp(np.array([0.3, -2, 1]))
    assert np.abs(rotation_of(quaternion(R)) - R).max() < 1e-9
    with pytest.raises(ValueError, match="frame_id"):
        frame("nowhere", q)


class Peer:
    """The participant that knows nothing of armplane."""

    def __init__(self):
        self.process = subprocess.Popen([sys.executable, HERE / "ros2_peer.py"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout.readline() == "ready\n"

    def ask(self, *words):
        self.process.stdin.write(repr(words) + "\n")
        self.process.stdin.flush()
        return eval(self.process.stdout.readline())

    def stop(self):
        self.process.kill()
        self.process.wait()


class Face:
    """A run with the face, and a peer; as a context, it ends with it."""

    def __init__(self, store, folder, words):
        self.store, self.folder, self.peer, self.last = store, folder, Peer(), {}
        self.log = open(folder / "log", "w+")
        self.process = subprocess.Popen([_program(), *words.split(), "--out", folder / "run"], cwd=folder, stdout=self.log, stderr=self.log)

    def send(self, topic, content, seconds=0.0, hz=100):
        return self.peer.ask("send", topic, seconds, hz, content)

    def messages(self, topic):
        """All that has come since the last call."""
        from ros2_peer import HEARD

        return [self.store.deserialize_cdr(bytes.fromhex(data), HEARD[topic]) for _, data in self.peer.ask("take", topic)]

    def until(self, topic, wanted=lambda _: True, seconds=60):
        """The first message that is as wanted."""

        def find():
            for self.last[topic] in self.messages(topic):
                if wanted(self.last[topic]):
                    return self.last[topic]
            assert self.process.poll() is None, self.said()
            return None

        found = wait(find, seconds)
        assert found, f"{self.last.get(topic)}\n{self.said()}"
        return found

    def said(self):
        self.log.flush()
        return (self.folder / "log").read_text()

    def q(self):
        """The arm's posture now."""
        self.messages("joint_states")
        return self.until("joint_states").position

    def hand(self):
        self.messages("tf")
        at = self.until("tf").transforms[0].transform
        return fields(at.translation, "xyz"), fields(at.rotation, "wxyz")

    def push(self, topic, content, is_there):
        """Sends a command until the fifth joint is there; its positions meanwhile."""
        found, end = [], monotonic() + 40
        while not (found and is_there(found[-1])):
            self.send(topic, content, seconds=0.3, hz=500)
            found += [one.position[4] for one in self.messages("joint_states")]
            assert monotonic() < end, found[-1]
        return found

    def moves(self, v):
        """Sends a twist along x, again where those who have just met did not hear each other yet; how far the hand has gone."""
        begin, sent_s, end = self.hand()[0][0], 0, monotonic() + 40
        while True:
            times = self.send(TWIST, twist([v, 0, 0]), seconds=0.5)
            sent_s += (times[-1] - times[0]) / 1e9
            self.rests()
            if abs(moved := self.hand()[0][0] - begin) > 0.005:
                # 0.1 s that the last twist is valid, and 0.2 s to come to rest.
                assert abs(moved) < abs(v) * (sent_s + 0.31), (moved, sent_s)
                return moved
            assert monotonic() < end, self.said()

    def rests(self):
        """Waits until the arm stands; its posture."""
        before = self.q()
        for _ in range(200):
            time.sleep(0.2)
            after = self.q()
            if np.abs(after - before).max() < 4e-4:
                return after
            before = after
        raise AssertionError("the arm does not come to rest")

    def pid(self):
        """Of the process of the run."""
        return next(iter(having(ROS_DOMAIN_ID=DOMAIN, ARMPLANE_PROCESS="ros2")), None)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.send_signal(signal.SIGINT)
        self.process.wait(30)
        self.peer.stop()
        assert self.pid() is None


def twist(v, w=(0, 0, 0), frame="base_link", stamp=None):
    return (stamp, frame), (tuple(map(float, v)), tuple(map(float, w)))


def pose(p, x):
    return (None, "base_link"), (tuple(map(float, p)), tuple(map(float, x)))


def jog(names, *speeds):
    return (None, ""), tuple(names.split()), (), speeds, 0.0


def point(q, t):
    return tuple(map(float, q)), (), (), (), (int(t), int(t % 1 * 1e9))


def path(*points, names=JOINTS):
    return ((0, 0), ""), tuple(names), points


def test_twists_and_poses_lead_through_a_wrist_lock(store, tmp_path):
    with Face(store, tmp_path, f"{STEERED} --ros2=rate=500,units") as face:
        state = face.until("joint_states")
        assert state.name == JOINTS and np.abs(state.position - NEAR_LOCK).max() < 1e-3 and len(state.velocity) == len(state.effort) == 6
        assert face.until("robot_description").data.startswith("<?xml")
        assert [one.child_frame_id for one in face.until("tf").transforms] == ["armplane/hand", "armplane/target", "armplane/singular"]
        report = face.until("armplane/singularity")
        wrist = next(one for one in report.singularities if one.name == "wrist")
        assert 0.1 < wrist.s < 2 * wrist.eta_out and report.header.frame_id == "base_link"
        assert abs(max(norm(fields(half, "xyz")) for half in (wrist.linear, wrist.angular)) - 1) < 1e-9
        assert {pair.key for pair in face.until("diagnostics").status[0].values} >= {"tick", "stops"}
        # To the side by less than a millimetre, while the wrist turns through its lock.
        begin, x = face.hand()
        face.messages("tf"), face.messages("joint_states"), face.messages("servo_node/status")
        v, w = np.split(-0.1 * armplane.Arm.builtin("ur5").at(NEAR_LOCK * [1, 1, 1, 1, 0, 1]).J[:, 4], 2)
        v[2] += 0.02
        wrists = face.push(TWIST, twist(v, w), lambda wrist: wrist < -0.1)
        places = np.array([fields(one.transforms[0].transform.translation, "xyz") for one in face.messages("tf")]) - begin
        along = places @ v / (v @ v)
        assert along.max() > 1 and norm(places - along[:, None] * v, axis=1).max() < 1e-3
        # On a busy machine a command may come when it is over, or overrun the operator: the log then has the reason for the status "invalid".
        assert not re.search(r": refused: (?!it is [\d.]+ s old)", face.said()), face.said()
        known = {-1, 0, 1} if re.search(": refused: |a target is lost", face.said()) else {0, 1}
        assert {one.code for one in face.messages("servo_node/status")} <= known and max(wrists) > 0.14
        # Back through it by poses.
        face.rests()
        (p, y), goal = face.hand(), begin
        turn = rotation_log(rotation_of(x) @ rotation_of(y).T)
        for part in np.linspace(0, 1, 40):
            at, to = p + part * (goal - p), quaternion(rotation_exp(part * turn) @ rotation_of(y))
            last = pose(at, np.roll(to, -1))
            face.send(POSE, last, seconds=0.05)
        face.push(POSE, last, lambda wrist: abs(wrist - NEAR_LOCK[4]) < 1e-3)
        assert norm(face.hand()[0] - goal) < 1e-3 and abs(face.hand()[1] @ x) > 1 - 1e-5
        # A frame of a link, turned about the hand: the place stays.
        is_turned = lambda: abs(face.hand()[1] @ x) < np.cos(0.08)
        for _ in range(10):
            # On a busy machine some commands come late, and do not count.
            if not is_turned():
                face.send(TWIST, twist([0, 0, 0], [0, 0, 0.5], frame="tool0"), seconds=0.5)
        assert norm(face.hand()[0] - goal) < 2e-3 and is_turned()
    assert "goal reached" in face.said() or "interrupted" in face.said(), face.said()


def test_only_timely_commands_that_can_be_followed_move_the_arm(store, tmp_path):
    nan, now = float("nan"), time.time
    with Face(store, tmp_path, f"{STEERED} --ros2=units") as face:
        face.until("joint_states")
        start = face.rests()
        still = lambda: np.abs(face.rests() - start).max() < 1e-3
        long_ago, fine = (int(now()) - 1, 0), twist([0.05, 0, 0])
        refused = [
            (TWIST, twist([0.05, 0, 0], stamp=(0, 0)), "its stamp is 0"),
            (TWIST, twist([0.05, 0, 0], stamp=long_ago), "valid for 0.1 s"),
            (TWIST, twist([0.05, nan, 0]), "a NaN"),
            (TWIST, twist([1e300, 0, 0]), "size 1e+300"),
            (TWIST, twist([0, 0, 0], [0, 0, -5000]), "size 5e+03"),
            (TWIST, twist([0.05, 0, 0], frame="nowhere"), "frame_id is 'nowhere'"),
            (TWIST, twist([0.05, 0, 0], frame=""), "frame_id is ''"),
            (POSE, pose((0.3, 0.2, nan), (0, 0, 0, 1)), "a NaN"),
            (POSE, pose((0.3, -1e300, 0.3), (0, 0, 0, 1)), "size 1e+300"),
            (POSE, pose((300, 200, 300), (0, 0, 0, 1)), "469 m from the base"),
            (POSE, pose((0.3, 0.2, 0.3), (0, 0, 0, 0)), "norm 0.0000"),
            (JOG, jog("knee", 0.1), "it names knee"),
            (JOG, jog("elbow elbow", 0.1, 0.1), "a joint twice"),
            (JOG, jog("elbow"), "0 velocities"),
            (JOG, jog("elbow", 1e300), "size 1e+300"),
            (PATH, path(point(start[:5], 1)), "each point needs 6"),
            (PATH, path(point(start + 0.1, 1), names=JOINTS[:5]), "5 of the arm's 6"),
            (PATH, path(point(start, 1), point(start, 1)), "its times must rise"),
            (PATH, path(point(start + 9, 1)), "joint limits"),
            (PATH, path(point(start + 1, 0)), "it begins 1.00 rad"),
            (PATH, path(point([nan] * 6, 1)), "a NaN"),
            (PATH, path(point([-1e300] * 6, 1)), "size 1e+300"),
        ]
        for topic, content, why in refused:
            # A sentence a second and topic is said; and on a busy machine a message may be lost.
            is_said = lambda: face.send(topic, content) and re.search(rf"/{topic}: refused: .*{re.escape(why)}", face.said())
            assert wait(is_said, 20), (topic, content, why, face.said()[-600:])
        # Servo's service: each of its three types is granted, another one is not.
        for command_type, success in ((1, True), (2, True), (9, False)):
            face.send("servo_node/switch_command_typeRequest", (7, command_type, command_type))
            reply = face.until("servo_node/switch_command_typeReply")
            assert (reply.client, reply.number, reply.success) == (7, command_type, success)
        # Bytes that are no message.
        for garbage in ("0001000001", "00010000" + "ff" * 40, "00010000" + "00" * 8 + "ffffff7f" + "41" * 60, "0007" + "ab" * 90, "0000" * 2000):
            face.send(TWIST, garbage, seconds=0.1)
        assert still()
        count = lambda one: sum(int(pair.value) for pair in one.status[0].values if pair.key.startswith("refused on"))
        # The first diagnosis after a refusal warns.
        assert face.until("diagnostics", lambda one: count(one) >= len(refused) and one.status[0].level == 1)
        # A wrong command ends a right one, a stream that stops ends by itself, and one from the future does not last longer.
        for end in (None, twist([0.05, 0, 0], frame="nowhere")):
            begin, _ = face.hand()
            face.send(TWIST, fine, seconds=0.5)
            if end:
                face.send(TWIST, end)
            face.rests()
            assert 0.005 < face.hand()[0][0] - begin[0] < 0.04
        begin, _ = face.hand()
        face.send(TWIST, twist([0.05, 0, 0], stamp=(int(now()) + 100, 0)))
        face.rests()
        assert face.hand()[0][0] - begin[0] < 0.015


def test_joints_jog_and_follow_a_table(store, tmp_path):
    with Face(store, tmp_path, f"{STEERED} --ros2") as face:
        face.until("joint_states")
        start = face.rests()
        # Without units, 1.0 is 0.5 rad/s.
        face.send(JOG, jog("elbow wrist_3", 0.4, -0.2), seconds=1.5, hz=50)
        moved = face.rests() - start
        assert 0.1 < moved[2] < 0.36 and abs(moved[5] + moved[2] / 2) < 0.02 and np.abs(moved[[0, 1, 3, 4]]).max() < 1e-3
        # The elbow's limit is π: all joints stand with 0.1 rad to it.
        for _ in range(4):
            # Of a busy machine the run gets only a part of this time.
            if np.pi - face.rests()[2] > 0.13:
                face.send(JOG, jog("elbow wrist_3", 1.0, 0.1), seconds=4.5, hz=50)
        assert 0.08 < np.pi - face.rests()[2] < 0.13
        order = [3, 0, 5, 1, 4, 2]
        points = [(start, 4), (start + 0.2, 6), (start - [0.1, 0, 0.1, 0, 0.1, 0], 9)]
        face.send(PATH, path(*(point(q[order], t) for q, t in points), names=[JOINTS[i] for i in order]))
        sent, passed = monotonic(), {}
        for q, t in points:
            time.sleep(max(0, sent + t + 0.05 - monotonic()))
            passed[t] = np.abs(face.q() - q).max()
        assert passed[4] < 0.3 and passed[6] < 0.1, passed
        assert np.abs(face.rests() - points[-1][0]).max() < 2e-3
        # Without points, it ends at once.
        face.send(PATH, path(point(start, 5)))
        time.sleep(1)
        face.send(PATH, path(names=()))
        assert np.abs(face.rests() - start).max() > 0.02


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_each_side_may_be_killed_and_stopped(mode, store, tmp_path):
    with Face(store, tmp_path, f"{STEERED} --ros2=units,rate=500 --mode {mode}") as face:
        face.until("joint_states")
        face.send(TWIST, twist([0.05, 0, 0]), seconds=0.5)
        face.messages("robot_description")
        os.kill(face.pid(), signal.SIGKILL)
        # The next one says anew whom it shows.
        assert face.until("robot_description").data.startswith("<?xml")
        face.messages("joint_states")
        face.rests()
        assert face.moves(0.05) > 0
        # A listener that stands still holds up nobody.
        ticks = lambda one: int(one.status[0].values[0].value)
        face.messages("diagnostics")
        before = ticks(face.until("diagnostics"))
        face.peer.process.send_signal(signal.SIGSTOP)
        time.sleep(4)
        face.peer.process.send_signal(signal.SIGCONT)
        assert face.until("diagnostics", lambda one: ticks(one) > before + 1000)
        # Its sender killed, the arm rests; the next one steers it.
        face.peer.stop()
        face.peer = Peer()
        face.until("joint_states")
        assert face.moves(-0.05) < 0
        # The launcher's death ends everything.
        face.process.kill()
        assert wait(lambda: face.pid() is None, 30)
    # A killed launcher leaves this in shared memory.
    assert ended(f"{_program()} clean").returncode == 0


def test_a_run_on_its_path_has_the_clock_of_its_ticks(store, tmp_path):
    with Face(store, tmp_path, "run fig5-wrist-rotation --ros2=clock,rate=100") as face:
        last = face.until("clock", lambda one: one.clock.sec >= 1, seconds=60)
        assert last.clock.nanosec % 10_000_000 == 0
        assert face.process.wait(60) == 0
        stamps = [one.header.stamp for one in face.messages("joint_states")]
        assert stamps[-1].sec >= 1
    assert "goal reached" in face.said()


def test_what_cannot_be_had_is_said_before_the_start(tmp_path):
    for word, why in [("--ros2=rate=0", "rate=0"), ("--ros2=cloc", "no option 'cloc'")]:
        done = ended(f"{_program()} servo ur5 {word}", cwd=tmp_path)
        assert done.returncode == 2 and why in done.stderr and not list(tmp_path.glob("runs/*"))
