"""The process `ros2` of a run: sends the arm's state to ROS 2, and its commands to the operator."""

import contextlib
import os
import socket
import sys
import threading
import time

try:
    import numpy as np

    from ..play.robot import Robot
    from .door import open_door
    from .servo import REST, Commands, quaternion
except ImportError as error:
    sys.exit(f"{error}: pip install the wheel that `python/build` makes, for the Python {sys.executable}")

from .. import wire
from ..process import Observer

NODE = "/servo_node"
COMMANDS = {
    f"{NODE}/delta_twist_cmds": ("geometry_msgs/TwistStamped", Commands.twist),
    f"{NODE}/pose_target_cmds": ("geometry_msgs/PoseStamped", Commands.pose),
    f"{NODE}/delta_joint_cmds": ("control_msgs/JointJog", Commands.jog),
    "/joint_trajectory": ("trajectory_msgs/JointTrajectory", Commands.trajectory),
}
# Servo's status (moveit_msgs/ServoStatus) for a reason; reasons that are worth a warning.
STATUS, INVALID, WARN = {wire.REASON_SINGULARITY: 1, wire.REASON_HELD: 5, wire.REASON_LIMIT: 6, wire.REASON_EFFORT: 6}, -1, 1
SLOWED = {*STATUS, wire.REASON_REACH, wire.REASON_STOPPED}
# Pause between two sentences on a topic's commands, and between two looks for commands, s.
EVERY_S, HEAR_S = 1, 1e-3
OPTIONS = ("rate", "units", "clock", "network")


def options(text=""):
    """Of `rate=500,units,clock,network`."""
    given = dict(one.partition("=")[::2] for one in text.split(",") if one)
    if unknown := given.keys() - set(OPTIONS):
        raise ValueError(f"there is no option '{unknown.pop()}': there are rate=HZ, units, clock, network")
    try:
        rate = float(given.get("rate", 100))
    except ValueError:
        rate = 0.0
    if not 1 <= rate <= 10_000:
        raise ValueError(f"rate={given['rate']}: give a number from 1 to 10000, in Hz")
    return {**given, "rate": rate}


class Ros2(Observer):
    """All that a run shows and hears in ROS 2."""

    def setup(self):
        self.given = options(*sys.argv[1:2])
        self.robot, self.door = Robot(self.job), open_door("network" in self.given)
        self.names, self.every = self.robot.arm.joints, max(1, round(1 / self.dt / self.given["rate"]))
        self.heard, self.senders, self.said, self.refused, self.shown, self.due, self.diagnosed = {}, {}, {}, {}, {}, 0, 0
        self._send("/robot_description", "std_msgs/String", self.job["robot"]["urdf"], is_kept=True)
        if (self.job["scenario"].get("servo") or {}).get("live"):
            self.commands = Commands(self.robot, "units" in self.given)
            self.operator = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self.operator.setblocking(False)
            for topic, (name, _) in COMMANDS.items():
                if take := self._open(topic, self.door.listen, name, topic.startswith(NODE)):
                    self.heard[topic] = take
            # The newest command counts, of whatever type: each type that Servo has is granted.
            self.switch = self._open(f"{NODE}/switch_command_type", self.door.serve, "moveit_msgs/ServoCommandType", lambda asked: asked.command_type in (0, 1, 2))
            self.is_over, self.hearing = threading.Event(), threading.Thread(target=self._hear_all, daemon=True)

    def _open(self, topic, attach, *how):
        """A topic's sender or listener; `None` where rclpy lacks its package."""
        try:
            return attach(topic, *how)
        except ModuleNotFoundError as error:
            print(f"armplane: {topic} is left out: {error}")
            return None

    def state(self):
        return b"-"

    def restore(self, state):
        """Nothing: the state keeps old ticks from coming again after a death."""

    def see(self, tick, estimate=None, sensor=None, singularity=None, control_state=None, servo_state=None):
        if estimate is None:
            return
        is_simulated = "clock" in self.given
        now = tick * self.dt if is_simulated else time.time()
        self.at = np.array(estimate.q[: self.dof]), now
        if self.heard and not self.hearing.is_alive():
            if self.is_over.is_set():
                raise RuntimeError("commands are heard no more: the log has the reason")
            self.hearing.start()
        if tick >= self.due:
            self.due = tick - tick % self.every + self.every
            # In the time of ROS, the state has the stamp of its sensors.
            age = 0 if is_simulated else 1e-9 * (time.monotonic_ns() - estimate.header.sent_ns[0])
            self._show(now - age, tick, estimate, sensor, singularity, control_state, servo_state)

    # Commands: on a thread, for an observer gets its ticks by tens.

    def _hear_all(self):
        try:
            while not self.is_over.wait(HEAR_S):
                q, now = self.at
                self._hear(q, now if "clock" in self.given else time.time())
        finally:
            self.is_over.set()

    def _hear(self, q, now):
        lines = []
        with contextlib.suppress(ValueError):
            self.switch and self.switch()
        for topic, take in self.heard.items():
            try:
                if (message := take()) is not None:
                    lines.append(COMMANDS[topic][1](self.commands, message, now, q))
            except ValueError as error:
                self.commands.motion = None
                lines.append(REST)
                self.refused[topic] = self.refused.get(topic, 0) + 1
                self._say(topic, f"refused: {error}")
        for line in filter(None, [*lines, self.commands.next(now, q)]):
            try:
                self.operator.sendto(line.encode(), f"{self.joined.folder}/operator.socket")
            except OSError as error:
                # The operator is being started again, or is behind: the next line replaces this one.
                self._say("the operator", f"a target is lost: {error.strerror}")

    def _say(self, subject, sentence):
        if time.monotonic() - self.said.get(subject, -EVERY_S) >= EVERY_S:
            self.said[subject] = time.monotonic()
            print(f"armplane: {subject}: {sentence}")

    # State.

    def _send(self, topic, name, *values, is_kept=False):
        """Sends a message with the values of its fields."""
        if topic not in self.senders:
            self.senders[topic] = self._open(topic, self.door.publish, name, is_kept)
        if send := self.senders[topic]:
            send(self.door.make(name, *values))

    def _show(self, now, tick, estimate, sensor, report, control, servo):
        n, stamp = self.dof, (int(now), int(now % 1 * 1e9))
        in_base, hand = (stamp, self.robot.base), self.robot.frames(self.at[0])[-1]
        found = list(report.singularities[: report.count]) if report else []
        if "clock" in self.given:
            self._send("/clock", "rosgraph_msgs/Clock", stamp)
        self._send("/joint_states", "sensor_msgs/JointState", (stamp, ""), self.names, estimate.q[:n], estimate.qdot[:n], sensor.tau_drive[:n] if sensor else [])
        frames = {"hand": (hand[:3, :3], hand[:3, 3])}
        if control:
            frames["target"] = np.reshape(control.R_BE_d, (3, 3)).T, control.p_BE_d
        if found:
            nearest = min(found, key=lambda one: abs(one.s) / one.eta_out)
            frames["singular"] = np.reshape(nearest.R_BS, (3, 3)).T, hand[:3, 3]
        # ROS writes x, y, z, w.
        transforms = [(in_base, f"armplane/{name}", (p, np.roll(quaternion(R), -1))) for name, (R, p) in frames.items()]
        self._send("/tf", "tf2_msgs/TFMessage", transforms)
        reason, joint = (wire.REFUSALS[control.refusal] or "follows") if control else "", ""
        if servo:
            reason, joint = wire.REASONS[servo.reason], self.names[servo.joint - 1] if servo.joint else ""
        if control:
            each = [
                (wire.KINDS[one.kind], wire.TYPES[one.class_], bool(one.inside), one.s, one.s_rate, one.eta_in, one.eta_out, one.zeta_B[:3], one.zeta_B[3:], wire.MODES[mode], beta)
                for one, mode, beta in zip(found, control.mode, control.beta)
            ]  # fmt: skip
            self._send("/armplane/singularity", "armplane_msgs/Singularities", in_base, reason, joint, each)
        if self.heard and servo:
            is_invalid = any(time.monotonic() - at < EVERY_S for at in list(self.said.values()))
            self._send(f"{NODE}/status", "moveit_msgs/ServoStatus", INVALID if is_invalid else STATUS.get(servo.reason, 0), reason)
        if tick >= self.diagnosed:
            self.diagnosed = tick + round(1 / self.dt)
            self._diagnose(stamp, tick, reason, servo)

    def _diagnose(self, stamp, tick, reason, servo):
        refused = dict(self.refused)
        values = {"tick": tick, "incarnation": self.incarnation, **{f"refused on {topic}": count for topic, count in refused.items()}}
        if servo:
            values |= {"targets refused": servo.refused, "stops": servo.stops, "nearest singularity, |s| over its threshold": f"{servo.nearest:.3f}"}
        is_worth = refused != self.shown or servo and servo.reason in SLOWED
        level, pairs, self.shown = WARN if is_worth else 0, [(key, str(value)) for key, value in values.items()], refused
        self._send("/diagnostics", "diagnostic_msgs/DiagnosticArray", (stamp, ""), [(level, "armplane: arm", reason, self.robot.name, pairs)])

    def end(self):
        if self.heard and self.hearing.is_alive():
            self.is_over.set()
            self.hearing.join()
        self.door.close()


def main():
    """Takes part in the run that started this program; without one, checks options and packages."""
    if "ARMPLANE_PROCESS" in os.environ:
        Ros2.run()
        return
    try:
        open_door("network" in options(*sys.argv[1:2])).close()
    except ValueError as error:
        sys.exit(str(error))
    except ImportError as error:
        sys.exit(f"{error}: pip install cyclonedds, or source a ROS 2 environment, for the Python {sys.executable}")


if __name__ == "__main__":
    main()
