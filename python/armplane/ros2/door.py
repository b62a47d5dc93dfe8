"""Topics of ROS 2 by `cyclonedds` alone, or by `rclpy` where a ROS environment is sourced. Both doors have the same methods."""

import collections
import functools
import importlib
import os
import threading
from importlib.util import find_spec

# Messages of ROS and MoveIt, and our own (examples/ros2/armplane_msgs), field by field. Those of a service begin as rmw_cyclonedds has them.
TYPES = """
builtin_interfaces/Time: int32 sec, uint32 nanosec
builtin_interfaces/Duration: int32 sec, uint32 nanosec
std_msgs/Header: builtin_interfaces/Time stamp, string frame_id
std_msgs/String: string data
geometry_msgs/Vector3: float64 x, float64 y, float64 z
geometry_msgs/Point: float64 x, float64 y, float64 z
geometry_msgs/Quaternion: float64 x, float64 y, float64 z, float64 w
geometry_msgs/Pose: geometry_msgs/Point position, geometry_msgs/Quaternion orientation
geometry_msgs/PoseStamped: std_msgs/Header header, geometry_msgs/Pose pose
geometry_msgs/Twist: geometry_msgs/Vector3 linear, geometry_msgs/Vector3 angular
geometry_msgs/TwistStamped: std_msgs/Header header, geometry_msgs/Twist twist
geometry_msgs/Transform: geometry_msgs/Vector3 translation, geometry_msgs/Quaternion rotation
geometry_msgs/TransformStamped: std_msgs/Header header, string child_frame_id, geometry_msgs/Transform transform
tf2_msgs/TFMessage: geometry_msgs/TransformStamped[] transforms
sensor_msgs/JointState: std_msgs/Header header, string[] name, float64[] position, float64[] velocity, float64[] effort
trajectory_msgs/JointTrajectoryPoint: float64[] positions, float64[] velocities, float64[] accelerations, float64[] effort, builtin_interfaces/Duration time_from_start
trajectory_msgs/JointTrajectory: std_msgs/Header header, string[] joint_names, trajectory_msgs/JointTrajectoryPoint[] points
control_msgs/JointJog: std_msgs/Header header, string[] joint_names, float64[] displacements, float64[] velocities, float64 duration
diagnostic_msgs/KeyValue: string key, string value
diagnostic_msgs/DiagnosticStatus: byte level, string name, string message, string hardware_id, diagnostic_msgs/KeyValue[] values
diagnostic_msgs/DiagnosticArray: std_msgs/Header header, diagnostic_msgs/DiagnosticStatus[] status
rosgraph_msgs/Clock: builtin_interfaces/Time clock
moveit_msgs/ServoStatus: int8 code, string message
moveit_msgs/ServoCommandType_Request: uint64 client, int64 number, int8 command_type
moveit_msgs/ServoCommandType_Response: uint64 client, int64 number, bool success
armplane_msgs/Singularity: string name, string type, bool inside, float64 s, float64 s_rate, float64 eta_in, float64 eta_out, geometry_msgs/Vector3 linear, geometry_msgs/Vector3 angular, string mode, float64 beta
armplane_msgs/Singularities: std_msgs/Header header, string reason, string joint, armplane_msgs/Singularity[] singularities
"""
# By message: (kind, name) of each field.
DEFINED = {name: [tuple(one.split(" ")) for one in fields.split(", ")] for name, fields in (line.split(": ") for line in TYPES.strip().splitlines())}
# As ROS 2 has it with ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST: without multicast, and here on no other interface.
LOOPBACK = """<CycloneDDS><Domain>
<General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces><AllowMulticast>false</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>"""


class Door:
    """The part that both doors share."""

    byte = int

    def make(self, name, *values):
        """A message with the values of its fields in their order; a message in it is the tuple of its own."""

        def filled(kind, value):
            if kind.endswith("[]"):
                return [filled(kind[:-2], one) for one in value]
            return self.make(kind, *value) if "/" in kind else self.byte(value) if kind == "byte" else value

        return self.type(name)(**{field: filled(kind, value) for (kind, field), value in zip(DEFINED[name], values)})

    def close(self):
        """Leaves the topics."""


class Dds(Door):
    """The topics by cyclonedds."""

    def __init__(self, network):
        from cyclonedds import core, domain

        number = int(os.environ.get("ROS_DOMAIN_ID") or 0)
        self._domain = None if network else domain.Domain(number, LOOPBACK)
        self._participant = domain.DomainParticipant(number)
        policy = core.Policy
        # CDR of the first version, as ROS speaks it.
        encoding = policy.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False)
        self._policy, self._qos = policy, lambda reliability, *others: core.Qos(reliability, encoding, *others)

    @functools.cache
    def type(self, name):
        """A dataclass with the fields of a message."""
        from cyclonedds.idl import make_idl_struct, types

        package, short = name.split("/")
        basic = {"string": str, "bool": bool, "byte": types.byte}

        def kind(text):
            if text.endswith("[]"):
                return types.sequence[kind(text[:-2])]
            return self.type(text) if "/" in text else basic.get(text) or getattr(types, text)

        part = "srv" if short.endswith(("_Request", "_Response")) else "msg"
        return make_idl_struct(f"{short}_", f"{package}::{part}::dds_::{short}_", {field: kind(text) for text, field in DEFINED[name]})

    def _topic(self, topic, name):
        from cyclonedds.topic import Topic

        prefix = {"Request": "rq", "Response": "rr"}.get(name.rpartition("_")[2], "rt")
        return Topic(self._participant, f"{prefix}{topic}", self.type(name))

    def publish(self, topic, name, is_kept=False):
        """A function that sends a message. A kept one comes to those who listen later, too."""
        from cyclonedds.core import DDSException
        from cyclonedds.pub import DataWriter

        policy = self._policy
        durability = policy.Durability.TransientLocal if is_kept else policy.Durability.Volatile
        # A listener that has stopped is not waited for.
        qos = self._qos(policy.Reliability.Reliable(0), durability, policy.History.KeepLast(1 if is_kept else 10))
        writer = DataWriter(self._participant, self._topic(topic, name), qos)

        def send(message):
            try:
                writer.write(message)
            except DDSException as error:
                if error.code != DDSException.DDS_RETCODE_TIMEOUT:
                    raise

        return send

    def listen(self, topic, name, is_stream):
        """A function that gives the newest message that has come, `None` if none has; ValueError if it cannot be read. Without `is_stream`, a message that is
        lost is sent again; with it, every sender matches."""
        from cyclonedds.sub import DataReader

        policy = self._policy
        reliability = policy.Reliability.BestEffort if is_stream else policy.Reliability.Reliable(0)
        qos = self._qos(reliability, policy.Durability.Volatile, policy.History.KeepLast(1))
        reader = DataReader(self._participant, self._topic(topic, name), qos)

        def take():
            try:
                samples = reader.take()
            except Exception as error:
                raise ValueError(f"it is no {name} ({error})") from error
            return samples[0] if samples and samples[0].sample_info.valid_data else None

        return take

    def serve(self, service, name, answer):
        """A function that answers the newest request of a service, if there is one, by `answer(request)`."""
        take, send = self.listen(f"{service}Request", f"{name}_Request", False), self.publish(f"{service}Reply", f"{name}_Response")

        def turn():
            if request := take():
                send(self.make(f"{name}_Response", request.client, request.number, answer(request)))

        return turn


class Rclpy(Door):
    """The topics by rclpy."""

    def __init__(self, network):
        if not network:
            os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        import rclpy
        from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
        from rclpy.signals import SignalHandlerOptions

        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._rclpy, self._node = rclpy, rclpy.create_node("armplane")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)

        def spin():
            try:
                self._executor.spin()
            except ExternalShutdownException:
                pass

        self._spinning = threading.Thread(target=spin, daemon=True)
        self._spinning.start()

    @functools.cache
    def type(self, name):
        package, short = name.split("/")
        return getattr(importlib.import_module(f"{package}.msg"), short)

    def publish(self, topic, name, is_kept=False):
        from rclpy.qos import DurabilityPolicy, QoSProfile

        durability = DurabilityPolicy.TRANSIENT_LOCAL if is_kept else DurabilityPolicy.VOLATILE
        return self._node.create_publisher(self.type(name), topic, QoSProfile(depth=1 if is_kept else 10, durability=durability)).publish

    def listen(self, topic, name, is_stream):
        from rclpy.qos import QoSProfile, ReliabilityPolicy

        came, policy = collections.deque(maxlen=1), ReliabilityPolicy
        qos = QoSProfile(depth=1, reliability=policy.BEST_EFFORT if is_stream else policy.RELIABLE)
        # rclpy asks for a signature, and a built-in method has none.
        self._node.create_subscription(self.type(name), topic, lambda message: came.append(message), qos)
        return lambda: came.pop() if came else None

    def serve(self, service, name, answer):
        package, short = name.split("/")

        def call(request, response):
            response.success = answer(request)
            return response

        self._node.create_service(getattr(importlib.import_module(f"{package}.srv"), short), service, call)
        return lambda: None

    def byte(self, value):
        return bytes([value])

    def close(self):
        self._rclpy.try_shutdown()
        self._spinning.join(2)


def open_door(network):
    """The door that this Python has; ImportError where it has none."""
    if find_spec("rclpy"):
        return Rclpy(network)
    return Dds(network)
