"""A participant of ROS 2 that knows nothing of armplane: cyclonedds, and the definitions of ROS that rosbags has. test_ros2.py starts it.

It answers each line of standard input, a Python tuple, with one: `("send", TOPIC, SECONDS, HZ, FIELDS)` with the times of sending, ns on CLOCK_MONOTONIC
(a stamp of `None` is now; a text is the message in hexadecimal); `("take", TOPIC)` with all that has come there, each with its time of arrival in ns since
1970 and its bytes in hexadecimal; `("heard", TOPIC)` with the number of listeners; `("lag", TOPIC, SECONDS, HZ)`, see there.
"""

import functools
import os
import sys
import time
from time import monotonic

from cyclonedds._clayer import ddspy_take, ddspy_write
from cyclonedds.core import InstanceState, Policy, Qos, SampleState, ViewState
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import make_idl_struct, types
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from repository import place
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

LOCALHOST = """<CycloneDDS><Domain><General><AllowMulticast>false</AllowMulticast><Interfaces><NetworkInterface name="lo"/></Interfaces></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="localhost"/></Peers></Discovery></Domain></CycloneDDS>"""
# As the repositories of MoveIt and ros2_control have them, a service's behind what rmw_cyclonedds adds; armplane's own are those of the package to copy.
OTHERS = {
    "moveit_msgs/msg/ServoStatus": "int8 code\nstring message",
    "moveit_msgs/msg/ServoCommandType_Request": "uint64 client\nint64 number\nint8 command_type",
    "moveit_msgs/msg/ServoCommandType_Response": "uint64 client\nint64 number\nbool success",
    "control_msgs/msg/JointJog": "std_msgs/Header header\nstring[] joint_names\nfloat64[] displacements\nfloat64[] velocities\nfloat64 duration",
}
HEARD = {
    "joint_states": "sensor_msgs/msg/JointState",
    "tf": "tf2_msgs/msg/TFMessage",
    "robot_description": "std_msgs/msg/String",
    "diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "armplane/singularity": "armplane_msgs/msg/Singularities",
    "servo_node/status": "moveit_msgs/msg/ServoStatus",
    "clock": "rosgraph_msgs/msg/Clock",
    "servo_node/switch_command_typeReply": "moveit_msgs/msg/ServoCommandType_Response",
}
SENT = {
    "servo_node/delta_twist_cmds": "geometry_msgs/msg/TwistStamped",
    "servo_node/pose_target_cmds": "geometry_msgs/msg/PoseStamped",
    "servo_node/delta_joint_cmds": "control_msgs/msg/JointJog",
    "joint_trajectory": "trajectory_msgs/msg/JointTrajectory",
    "servo_node/switch_command_typeRequest": "moveit_msgs/msg/ServoCommandType_Request",
}
_MESSAGE, _LIST = 2, 4


@functools.cache
def store():
    """All definitions, by the parser of rosbags."""
    found, package = get_typestore(Stores.ROS2_JAZZY), place("examples/ros2/armplane_msgs/msg")
    for name, text in {**OTHERS, **{f"armplane_msgs/msg/{path.stem}": path.read_text() for path in package.glob("*.msg")}}.items():
        found.register(get_types_from_msg(text, name))
    return found


@functools.cache
def struct(name):
    """A message as cyclonedds has it."""

    def of(node):
        form, content = int(node[0]), node[1]
        if form == _MESSAGE:
            return struct(content)
        if form == _LIST:
            return types.sequence[of(content[0])]
        return {"string": str, "bool": bool, "octet": types.byte, "byte": types.byte}.get(content[0]) or getattr(types, content[0])

    package, _, short = name.split("/")
    part = "srv" if "_Re" in short else "msg"
    return make_idl_struct(f"{short}_", f"{package}::{part}::dds_::{short}_", {field: of(node) for field, node in store().fielddefs[name][1]})


def made(name, values):
    """A message from nested tuples in the order of its fields; a stamp of `None` is now."""
    if name.endswith("/Time") and values is None:
        values = divmod(time.time_ns(), 10**9)

    def of(node, value):
        if int(node[0]) == _LIST:
            return [of(node[1][0], one) for one in value]
        return made(node[1], value) if int(node[0]) == _MESSAGE else value

    return struct(name)(**{field: of(node, value) for (field, node), value in zip(store().fielddefs[name][1], values)})


def lag(reader, writer, seconds, hz):
    """Twists of k nm/s along x, k = 1, 2, …: when each was sent, ns on CLOCK_MONOTONIC; and of each message that came meanwhile its age, ns."""
    sent, ages, begin = [], [], monotonic()
    while monotonic() < begin + seconds:
        if monotonic() >= begin + len(sent) / hz:
            sent.append(time.monotonic_ns())
            writer.write(made(SENT["servo_node/delta_twist_cmds"], ((None, "base_link"), ((1e-9 * len(sent), 0.0, 0.0), (0.0, 0.0, 0.0)))))
        for message in reader.take(100):
            stamp = message.header.stamp
            ages.append(time.time_ns() - stamp.sec * 10**9 - stamp.nanosec)
        time.sleep(5e-5)
    return sent, ages


def main():
    number = int(os.environ["ROS_DOMAIN_ID"])
    domain, participant = Domain(number, LOCALHOST), DomainParticipant(number)
    reliable = Policy.Reliability.Reliable(10**8), Policy.History.KeepLast(100_000), Policy.DataRepresentation(use_cdrv0_representation=True)
    durability = lambda topic: Policy.Durability.TransientLocal if topic == "robot_description" else Policy.Durability.Volatile
    prefix = lambda name: "rq" if name.endswith("_Request") else "rr" if name.endswith("_Response") else "rt"
    topics = {topic: Topic(participant, f"{prefix(name)}/{topic}", struct(name)) for topic, name in (HEARD | SENT).items()}
    readers = {topic: DataReader(participant, topics[topic], Qos(*reliable, durability(topic))) for topic in HEARD}
    writers = {topic: DataWriter(participant, topics[topic], Qos(*reliable)) for topic in SENT}
    every = SampleState.Any | ViewState.Any | InstanceState.Any
    print("ready", flush=True)
    for line in sys.stdin:
        what, topic, *more = eval(line, {"nan": float("nan"), "inf": float("inf")})
        answer = []
        if what == "take":
            for data, info in ddspy_take(readers[topic]._ref, every, 100_000):
                # Others say that a sender is gone.
                if info.valid_data:
                    answer.append((info.source_timestamp, data.hex()))
        elif what == "lag":
            answer = lag(readers[topic], writers["servo_node/delta_twist_cmds"], *more)
        elif what == "heard":
            answer = len(writers[topic].get_matched_subscriptions())
        else:
            seconds, hz, fields = more
            begin = monotonic()
            for k in range(max(1, round(seconds * hz))):
                time.sleep(max(0.0, begin + k / hz - monotonic()))
                answer.append(time.monotonic_ns())
                message = bytes.fromhex(fields) if isinstance(fields, str) else made(SENT[topic], fields).serialize(use_version_2=False)
                ddspy_write(writers[topic]._ref, message)
        print(answer, flush=True)
    del domain


if __name__ == "__main__":
    main()
