"""The process `ros2` of a run: sends the arm's state to ROS 2, and its commands to the operator."""

import os
import socket
import sys
import threading
import time

try:
    import numpy as np

    from ..play.robot import Robot
    from .door import open_door
    from .servo import REST, Commands, Frames, quaternion
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
# Servo's status (moveit_msgs/ServoStatus) for a reason.
STATUS = {wire.REASON_SINGULARITY: 1, wire.REASON_HELD: 5, wire.REASON_LIMIT: 6, wire.REASON_EFFORT: 6}
INVALID, WARN = -1, 1
SLOWED = (wire.REASON_SINGULARITY, wire.REASON_LIMIT, wire.REASON_REACH, wire.REASON_EFFORT, wire.REASON_STOPPED, wire.REASON_HELD)
# Pause between two sentences on a topic's commands, s.
EVERY_S = 1.0
# Pause between two looks for commands, s.
HEAR_S = 1e-3
OPTIONS = "rate=HZ, units, clock, network"


def options(text):
    """Of `rate=500,units,clock,network`."""
    given = {"rate": 100.0}
    for one in filter(None, text.split(",")):
        name, _, value = one.partition("=")
        if name == "rate":
            try:
                given["rate"] = float(value)
            except ValueError:
                given["rate"] = 0.0
            if not 1.0 <= given["rate"] <= 10_000.0:
                raise ValueError(f"rate={value}: give a number from 1 to 10000, in Hz")
        elif one in ("units", "clock", "network"):
            given[one] = True
        else:
            raise ValueError(f"there is no option '{one}': there are {OPTIONS}")
    return given


class Ros2(Observer):
    """All that a run shows and hears in ROS 2."""

    def setup(self):
        self.given = options(sys.argv[1] if len(sys.argv) > 1 else "")
        self.robot, self.door = Robot(self.job), open_door("network" in self.given)
        self.frames = Frames(self.robot, self.job["robot"]["urdf"])
        self.names, self.every = self.robot.arm.joints, max(1, round(1.0 / self.dt / self.given["rate"]))
        self.heard, self.senders, self.said, self.refused, self.due, self.diagnosed = {}, {}, {}, {}, 0, 0
        self._send("/robot_description", "std_msgs/String", lambda: {"data": self.job["robot"]["urdf"]}, is_kept=True)
        if (self.job["scenario"].get("servo") or {}).get("live"):
            self.commands = Commands(self.frames, "units" in self.given)
            self.operator = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self.operator.setblocking(False)
            for topic, (name, _) in COMMANDS.items():
                try:
                    self.heard[topic] = self.door.listen(topic, name, topic.startswith(NODE))
                except ModuleNotFoundError as error:
                    print(f"armplane: {topic} is left out: {error}")
            self.is_over, self.hearing = threading.Event(), threading.Thread(target=self._hear_all, daemon=True)

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
            age = 0.0 if is_simulated else 1e-9 * (time.monotonic_ns() - estimate.header.sent_ns[0])
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
        for topic, take in self.heard.items():
            try:
                message = take()
                if message is None:
                    continue
                line = COMMANDS[topic][1](self.commands, message, now, q)
            except ValueError as error:
                self.commands.motion, line = None, REST
                self.refused[topic] = self.refused.get(topic, 0) + 1
                self._say(topic, f"refused: {error}")
            if line:
                self._give(line)
        if self.heard and (line := self.commands.next(now, q)):
            self._give(line)

    def _give(self, line):
        try:
            self.operator.sendto(line.encode(), os.path.join(self.joined.folder, "operator.socket"))
        except OSError as error:
            # The operator is being started again, or is behind: the next line replaces this one.
            self._say("the operator", f"a target is lost: {error.strerror}")

    def _say(self, subject, sentence):
        if time.monotonic() - self.said.get(subject, -EVERY_S) >= EVERY_S:
            self.said[subject] = time.monotonic()
            print(f"armplane: {subject}: {sentence}")

    # State.

    def _make(self, name, /, **fields):
        return self.door.type(name)(**fields)

    def _header(self, now, frame=""):
        return self._make("std_msgs/Header", stamp=self._time(now), frame_id=frame)

    def _time(self, now):
        return self._make("builtin_interfaces/Time", sec=int(now), nanosec=int(now % 1.0 * 1e9))

    def _vector(self, values, name="Vector3"):
        return self._make(f"geometry_msgs/{name}", **dict(zip("xyz", map(float, values))))

    def _send(self, topic, name, fields, is_kept=False):
        """Sends the message with the fields that a function gives; leaves out a topic of a package that rclpy lacks."""
        if topic not in self.senders:
            try:
                self.senders[topic] = self.door.publish(topic, name, is_kept)
            except ModuleNotFoundError as error:
                print(f"armplane: {topic} is left out: {error}")
                self.senders[topic] = None
        if send := self.senders[topic]:
            send(self._make(name, **fields()))

    def _show(self, now, tick, estimate, sensor, report, control, servo):
        n, header, base = self.dof, self._header(now), self.frames.base
        if "clock" in self.given:
            self._send("/clock", "rosgraph_msgs/Clock", lambda: {"clock": self._time(now)})
        effort = sensor.tau_drive[:n] if sensor else []
        state = {"name": self.names, "position": estimate.q[:n], "velocity": estimate.qdot[:n], "effort": effort}
        self._send("/joint_states", "sensor_msgs/JointState", lambda: {"header": header, **state})
        hand, found = self.robot.frames(self.at[0])[-1], list(report.singularities[: report.count]) if report else []
        frames = {"hand": (hand[:3, :3], hand[:3, 3])}
        if control:
            frames["target"] = np.reshape(control.R_BE_d, (3, 3)).T, control.p_BE_d
        if found:
            nearest = min(found, key=lambda one: abs(one.s) / one.eta_out)
            frames["singular"] = np.reshape(nearest.R_BS, (3, 3)).T, hand[:3, 3]
        transforms = lambda: [self._transform(now, base, name, *at) for name, at in frames.items()]
        self._send("/tf", "tf2_msgs/TFMessage", lambda: {"transforms": transforms()})
        reason, joint = self._reason(control, servo)
        if control:
            each = lambda: [self._singularity(*one) for one in zip(found, control.mode, control.beta)]
            self._send("/armplane/singularity", "armplane_msgs/Singularities",
                       lambda: {"header": self._header(now, base), "reason": reason, "joint": joint, "singularities": each()})
        if self.heard and servo:
            is_invalid = any(time.monotonic() - at < EVERY_S for at in list(self.said.values()))
            code = INVALID if is_invalid else STATUS.get(servo.reason, 0)
            self._send(f"{NODE}/status", "moveit_msgs/ServoStatus", lambda: {"code": code, "message": reason})
        if tick >= self.diagnosed:
            self.diagnosed = tick + round(1.0 / self.dt)
            self._diagnose(header, tick, reason, servo)

    def _transform(self, now, base, name, R, p):
        w, x, y, z = map(float, quaternion(R))
        turn = self._make("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w)
        at = self._make("geometry_msgs/Transform", translation=self._vector(p), rotation=turn)
        return self._make("geometry_msgs/TransformStamped", header=self._header(now, base), child_frame_id=f"armplane/{name}", transform=at)

    def _reason(self, control, servo):
        """Why the arm moves as it does, and the joint of that."""
        if servo:
            return wire.REASONS[servo.reason], self.names[servo.joint - 1] if servo.joint else ""
        return (wire.REFUSALS[control.refusal] or "follows" if control else ""), ""

    def _singularity(self, one, mode, beta):
        numbers = {"s": one.s, "s_rate": one.s_rate, "eta_in": one.eta_in, "eta_out": one.eta_out, "beta": beta}
        ways = {"linear": self._vector(one.zeta_B[:3]), "angular": self._vector(one.zeta_B[3:])}
        words = {"name": wire.KINDS[one.kind], "type": wire.TYPES[one.class_], "mode": wire.MODES[mode]}
        return self._make("armplane_msgs/Singularity", inside=bool(one.inside), **words, **numbers, **ways)

    def _diagnose(self, header, tick, reason, servo):
        values = {"tick": tick, "incarnation": self.incarnation, **{f"refused on {topic}": count for topic, count in dict(self.refused).items()}}
        if servo:
            values |= {"targets refused": servo.refused, "stops": servo.stops, "nearest singularity, |s| over its threshold": f"{servo.nearest:.3f}"}
        self._send("/diagnostics", "diagnostic_msgs/DiagnosticArray", lambda: {"header": header, "status": [self._make(
            "diagnostic_msgs/DiagnosticStatus", level=self.door.byte(WARN if servo and servo.reason in SLOWED else 0), name="armplane: arm", message=reason,
            hardware_id=self.robot.name, values=[self._make("diagnostic_msgs/KeyValue", key=key, value=str(value)) for key, value in values.items()])]})

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
        open_door("network" in options(sys.argv[1] if len(sys.argv) > 1 else "")).close()
    except (ValueError, ImportError) as error:
        remedy = "" if isinstance(error, ValueError) else f": pip install cyclonedds, or source a ROS 2 environment, for the Python {sys.executable}"
        sys.exit(f"{error}{remedy}")


if __name__ == "__main__":
    main()
