"""A participant of ROS 2 that knows nothing of armplane: cyclonedds alone, and messages written down from the definitions of ROS. test_ros2.py starts it.

It answers each line of standard input, a Python tuple, with one: `("send", TOPIC, SECONDS, HZ, FIELDS)` with the times of sending, ns on CLOCK_MONOTONIC
(a stamp of `None` is now; a text is the message in hexadecimal); `("take", TOPIC)` with all that has come there, each with its time of arrival in ns since
1970 and its bytes in hexadecimal; `("heard", TOPIC)` with the number of listeners; `("lag", TOPIC, SECONDS, HZ)`, see there.
"""

import os
import sys
import time
from dataclasses import dataclass

from cyclonedds._clayer import ddspy_take, ddspy_write
from cyclonedds.core import InstanceState, Policy, Qos, SampleState, ViewState
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import byte, float64, int8, int32, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

LOCALHOST = """<CycloneDDS><Domain><General><AllowMulticast>false</AllowMulticast><Interfaces><NetworkInterface name="lo"/></Interfaces></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="localhost"/></Peers></Discovery></Domain></CycloneDDS>"""


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Duration(IdlStruct, typename="builtin_interfaces::msg::dds_::Duration_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    linear: Vector3
    angular: Vector3


@dataclass
class TwistStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TwistStamped_"):
    header: Header
    twist: Twist


@dataclass
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Point
    orientation: Quaternion


@dataclass
class PoseStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PoseStamped_"):
    header: Header
    pose: Pose


@dataclass
class Transform(IdlStruct, typename="geometry_msgs::msg::dds_::Transform_"):
    translation: Vector3
    rotation: Quaternion


@dataclass
class TransformStamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
class TFMessage(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    transforms: sequence[TransformStamped]


@dataclass
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


@dataclass
class JointJog(IdlStruct, typename="control_msgs::msg::dds_::JointJog_"):
    header: Header
    joint_names: sequence[str]
    displacements: sequence[float64]
    velocities: sequence[float64]
    duration: float64


@dataclass
class JointTrajectoryPoint(IdlStruct, typename="trajectory_msgs::msg::dds_::JointTrajectoryPoint_"):
    positions: sequence[float64]
    velocities: sequence[float64]
    accelerations: sequence[float64]
    effort: sequence[float64]
    time_from_start: Duration


@dataclass
class JointTrajectory(IdlStruct, typename="trajectory_msgs::msg::dds_::JointTrajectory_"):
    header: Header
    joint_names: sequence[str]
    points: sequence[JointTrajectoryPoint]


@dataclass
class KeyValue(IdlStruct, typename="diagnostic_msgs::msg::dds_::KeyValue_"):
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticStatus_"):
    level: byte
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticArray_"):
    header: Header
    status: sequence[DiagnosticStatus]


@dataclass
class Clock(IdlStruct, typename="rosgraph_msgs::msg::dds_::Clock_"):
    clock: Time


@dataclass
class ServoStatus(IdlStruct, typename="moveit_msgs::msg::dds_::ServoStatus_"):
    code: int8
    message: str


@dataclass
class Singularity(IdlStruct, typename="armplane_msgs::msg::dds_::Singularity_"):
    name: str
    type: str
    inside: bool
    s: float64
    s_rate: float64
    eta_in: float64
    eta_out: float64
    linear: Vector3
    angular: Vector3
    mode: str
    beta: float64


@dataclass
class Singularities(IdlStruct, typename="armplane_msgs::msg::dds_::Singularities_"):
    header: Header
    reason: str
    joint: str
    singularities: sequence[Singularity]


HEARD = {
    "joint_states": JointState,
    "tf": TFMessage,
    "robot_description": String,
    "diagnostics": DiagnosticArray,
    "armplane/singularity": Singularities,
    "servo_node/status": ServoStatus,
    "clock": Clock,
}
SENT = {
    "servo_node/delta_twist_cmds": TwistStamped,
    "servo_node/pose_target_cmds": PoseStamped,
    "servo_node/delta_joint_cmds": JointJog,
    "joint_trajectory": JointTrajectory,
}


def made(kind, value):
    """A message from nested tuples in the order of its fields; a stamp of `None` is now."""
    if kind is Time and value is None:
        now = time.time_ns()
        return Time(now // 10**9, now % 10**9)
    if isinstance(kind, type) and issubclass(kind, IdlStruct):
        return kind(*(made(field.type, one) for field, one in zip(kind.__dataclass_fields__.values(), value)))
    element = getattr(kind, "__metadata__", [None])[0]
    return [made(element.subtype, one) for one in value] if hasattr(element, "subtype") else value


def lag(reader, writer, seconds, hz):
    """Twists of k nm/s along x, k = 1, 2, …: when each was sent, ns on CLOCK_MONOTONIC; and of each message that came meanwhile its age, ns."""
    sent, ages, begin = [], [], time.monotonic()
    while time.monotonic() < begin + seconds:
        if time.monotonic() >= begin + len(sent) / hz:
            sent.append(time.monotonic_ns())
            vector = Vector3(1e-9 * len(sent), 0.0, 0.0)
            writer.write(TwistStamped(made(Header, (None, "base_link")), Twist(vector, Vector3(0.0, 0.0, 0.0))))
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
    readers = {topic: DataReader(participant, Topic(participant, f"rt/{topic}", kind), Qos(*reliable, durability(topic))) for topic, kind in HEARD.items()}
    writers = {topic: DataWriter(participant, Topic(participant, f"rt/{topic}", kind), Qos(*reliable)) for topic, kind in SENT.items()}
    every = SampleState.Any | ViewState.Any | InstanceState.Any
    print("ready", flush=True)
    for line in sys.stdin:
        what, topic, *more = eval(line, {"nan": float("nan"), "inf": float("inf")})
        answer = []
        if what == "take":
            for data, info in ddspy_take(readers[topic]._ref, every, 100_000):
                answer.append((info.source_timestamp, data.hex()))
        elif what == "lag":
            answer = lag(readers[topic], writers["servo_node/delta_twist_cmds"], *more)
        elif what == "heard":
            answer = len(writers[topic].get_matched_subscriptions())
        else:
            seconds, hz, fields = more
            begin = time.monotonic()
            for k in range(max(1, round(seconds * hz))):
                time.sleep(max(0.0, begin + k / hz - time.monotonic()))
                answer.append(time.monotonic_ns())
                message = bytes.fromhex(fields) if isinstance(fields, str) else made(SENT[topic], fields).serialize(use_version_2=False)
                ddspy_write(writers[topic]._ref, message)
        print(answer, flush=True)
    del domain


if __name__ == "__main__":
    main()
