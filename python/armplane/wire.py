"""The wire of armplane: messages and codes. Written by `armplane generate wire --lang python`; do not edit."""

import ctypes

ARMPLANE_VERSION = "0.1.0"
MAX_DOF = 8  # elements of an array of joints
MAX_HOPS = 8  # processes that stamp a message
MAX_SINGULARITIES = 4  # elements of an array of singularities

DRIVE_ACTIVE = 0
DRIVE_HOLDING = 1
DRIVE_STOPPING = 2
DRIVE_BRAKED = 3
DRIVES = {DRIVE_ACTIVE: "active", DRIVE_HOLDING: "holding", DRIVE_STOPPING: "stopping", DRIVE_BRAKED: "braked"}

DRIVE_ABSENT = 1
DRIVE_REFUSED = 2
DRIVE_EFFORT = 4
DRIVE_RATE = 8
DRIVE_SPEED = 16
DRIVE_STALE = 64
DRIVE_ENCODER = 128
DRIVE_DIVERGED = 32
DRIVE_FLAGS = {DRIVE_ABSENT: "absent", DRIVE_REFUSED: "refused", DRIVE_EFFORT: "effort", DRIVE_RATE: "rate", DRIVE_SPEED: "speed", DRIVE_STALE: "stale", DRIVE_ENCODER: "encoder", DRIVE_DIVERGED: "diverged"}

FRAME_BASE = 0
FRAME_HAND = 1
FRAME_SINGULAR = 2
FRAMES = {FRAME_BASE: "base", FRAME_HAND: "hand", FRAME_SINGULAR: "singular"}

KIND_NUMERIC = 0
KIND_ELBOW = 1
KIND_WRIST = 2
KIND_OVERHEAD = 3
KIND_SHOULDER = 4
KINDS = {KIND_NUMERIC: "numeric", KIND_ELBOW: "elbow", KIND_WRIST: "wrist", KIND_OVERHEAD: "overhead", KIND_SHOULDER: "shoulder"}

MODE_REGULAR = 0
MODE_BLEND = 1
MODE_TRACK = 2
MODE_PASS = 3
MODE_HOLD = 4
MODE_REORIENT = 5
MODE_SLIDE = 6
MODE_RECOVER = 7
MODES = {MODE_REGULAR: "regular", MODE_BLEND: "blend", MODE_TRACK: "track", MODE_PASS: "pass", MODE_HOLD: "hold", MODE_REORIENT: "reorient", MODE_SLIDE: "slide", MODE_RECOVER: "recover"}

PHASE_RUNNING = 0
PHASE_SETTLING = 1
PHASE_DONE = 2
PHASE_REFUSED = 3
PHASES = {PHASE_RUNNING: "running", PHASE_SETTLING: "settling", PHASE_DONE: "done", PHASE_REFUSED: "refused"}

REASON_FOLLOWING = 0
REASON_RESTING = 1
REASON_STALE = 2
REASON_FAST = 3
REASON_SINGULARITY = 4
REASON_EFFORT = 5
REASON_LIMIT = 6
REASON_REACH = 7
REASON_STOPPED = 8
REASON_OVER = 9
REASON_HELD = 10
REASON_AXES = 11
REASON_LOST = 12
REASONS = {REASON_FOLLOWING: "follows", REASON_RESTING: "rests", REASON_STALE: "rests: the target is older than its validity", REASON_FAST: "slowed: the target is faster than the session allows", REASON_SINGULARITY: "slowed near a singularity", REASON_EFFORT: "slowed: a joint is at its speed or torque limit", REASON_LIMIT: "slowed before a joint limit", REASON_REACH: "at the boundary of reach", REASON_STOPPED: "stopped, goes on from rest", REASON_OVER: "over", REASON_HELD: "held back: something is in the arm's way", REASON_AXES: "leaves out axes that the arm does not serve", REASON_LOST: "held: the motion asked for is lost in a singularity"}

REFUSAL_NONE = 0
REFUSAL_STATE = 1
REFUSAL_REPORT = 2
REFUSAL_SINGULAR = 3
REFUSAL_SPEED = 4
REFUSAL_ROOM = 5
REFUSAL_TORQUE = 6
REFUSAL_ROUTE = 7
REFUSAL_LIMIT = 8
REFUSAL_UNLISTED = 9
REFUSAL_ESTIMATE = 10
REFUSAL_PARTED = 11
REFUSAL_CHECKPOINT = 12
REFUSAL_CONTACT = 13
REFUSAL_BOUNCE = 14
REFUSAL_PRESSING = 15
REFUSALS = {REFUSAL_NONE: "", REFUSAL_STATE: "the estimated state is not a finite number", REFUSAL_REPORT: "the singularity report is of another version of the wire", REFUSAL_SINGULAR: "the arm is singular in a way that the law does not handle; start or lead the path elsewhere", REFUSAL_SPEED: "the path passes so near to a singularity that even at its slowest it needs far more joint speed than there is", REFUSAL_ROOM: "the singular direction cannot be turned as asked: the joints have no room for it; ask for less, or start elsewhere", REFUSAL_TORQUE: "the torque is not a finite number", REFUSAL_ROUTE: "the path cannot be followed within the joint limits from this start posture; start in another posture, or lead the path elsewhere", REFUSAL_LIMIT: "a joint came too near to its limit and the arm was stopped before it; start in another posture, or end the path earlier", REFUSAL_UNLISTED: "the arm has lost a direction that no listed singularity explains: start elsewhere, or lead the path around that posture", REFUSAL_ESTIMATE: "the estimated state moves as no torque within the limits can move the arm; see to the encoders", REFUSAL_PARTED: "the arm was held back or thrown", REFUSAL_CHECKPOINT: "the checkpoint of the process before it is damaged; start the run again", REFUSAL_CONTACT: "the hand met nothing in the direction of its force; put a surface in the way, or raise force.reach_m", REFUSAL_BOUNCE: "the hand bounced off the surface that it met; state the surface's stiffness in force.stiffness_n_m, or approach more slowly", REFUSAL_PRESSING: "the hand could not press as asked; a lost direction bears the force, something else holds the hand, or the force swings about its set-point"}

SIDE_KEEP = 0
SIDE_NEGATIVE = 1
SIDE_POSITIVE = 2
SIDES = {SIDE_KEEP: "keep", SIDE_NEGATIVE: "negative", SIDE_POSITIVE: "positive"}

TARGET_NONE = 0
TARGET_TWIST = 1
TARGET_POSE = 2
TARGET_POSTURE = 3
TARGET_END = 4
TARGET_UNREADABLE = 5
TARGETS = {TARGET_NONE: "none", TARGET_TWIST: "twist", TARGET_POSE: "pose", TARGET_POSTURE: "posture", TARGET_END: "end", TARGET_UNREADABLE: "unreadable"}

TARGET_REFUSAL_NONE = 0
TARGET_REFUSAL_NUMBER = 1
TARGET_REFUSAL_FRAME = 2
TARGET_REFUSAL_KIND = 3
TARGET_REFUSAL_ROTATION = 4
TARGET_REFUSAL_TIME = 5
TARGET_REFUSAL_RANGE = 6
TARGET_REFUSAL_JOINTS = 7
TARGET_REFUSAL_FORCE = 8
TARGET_REFUSALS = {TARGET_REFUSAL_NONE: "", TARGET_REFUSAL_NUMBER: "it holds a NaN or an infinity", TARGET_REFUSAL_FRAME: "its frame is unknown, or not one for its kind (a pose is in base, a force in base or hand)", TARGET_REFUSAL_KIND: "its kind or its side is unknown", TARGET_REFUSAL_ROTATION: "its rotation is none: a quaternion has norm 1, a matrix determinant 1", TARGET_REFUSAL_TIME: "its time stamp is in the future, or its validity is negative", TARGET_REFUSAL_RANGE: "a number is beyond 1000, or its position beyond 100 m", TARGET_REFUSAL_JOINTS: "its posture has not one value for each joint of the arm", TARGET_REFUSAL_FORCE: "its force has nothing to press on, is below 0.1 N or beyond what the joints hold, or comes with a posture"}

TYPE_UNKNOWN = 0
TYPE_1 = 1
TYPE_2 = 2
TYPE_MIXED = 3
TYPES = {TYPE_UNKNOWN: "unknown", TYPE_1: "type 1", TYPE_2: "type 2", TYPE_MIXED: "mixed"}


class Header(ctypes.Structure):
    """The first field of every message."""

    __slots__ = ()
    _fields_ = [
        ("received_ns", ctypes.c_uint64 * 8),  # When hop i had its input in hand [ns on CLOCK_MONOTONIC]
        ("sent_ns", ctypes.c_uint64 * 8),  # When hop i sent its output [ns on CLOCK_MONOTONIC]
        ("due_ns", ctypes.c_uint64),  # When the tick should have begun, 0 in lockstep [ns on CLOCK_MONOTONIC]
        ("tick", ctypes.c_uint64),  # Tick of the sensor sample this message was computed from
        ("incarnation", ctypes.c_uint32),  # How often the writing process has been started in this run, from 1
        ("flags", ctypes.c_uint32),  # Bit flags, zero in this version
    ]


assert ctypes.sizeof(Header) == 152


class SingularityState(ctypes.Structure):
    """One singularity at one posture, as Chang & Khatib 1995 describe it."""

    __slots__ = ()
    _fields_ = [
        ("kind", ctypes.c_uint32),  # One of `KINDS`
        ("class_", ctypes.c_uint32),  # One of `TYPES`, latched while inside
        ("inside", ctypes.c_uint32),  # 1 inside the neighbourhood D_si (hysteretic: entered at η_in, left at η_out), else 0
        ("angular", ctypes.c_uint32),  # 1 where ζ is a rotation, 0 where it is a translation
        ("s", ctypes.c_double),  # Measure s_i(q), signed [dimensionless]
        ("s_rate", ctypes.c_double),  # ds_i/dt [1/s]
        ("eta_in", ctypes.c_double),  # Entry threshold on |s_i|
        ("eta_out", ctypes.c_double),  # Exit threshold on |s_i|
        ("zeta_B", ctypes.c_double * 6),  # Singular direction ζ_i at C: a unit vector in its linear or its angular half; continuous in sign
        ("R_BS", ctypes.c_double * 9),  # Singular frame, rotation R_BS column-major, first axis along ζ_i
        ("gain", ctypes.c_double),  # Velocity along ζ_i per unit of the auxiliary rate: ζᵀJ → g·aux as s grows; signed, m or dimensionless
        ("aux", ctypes.c_double),  # Regular auxiliary coordinate (elbow angle from full stretch, wrist φ, waist angle) [rad]
        ("aux_rate", ctypes.c_double),  # Its rate [rad/s]
        ("aux_bias", ctypes.c_double),  # Its acceleration at q̈ = 0 [rad/s²]
        ("aux_row", ctypes.c_double * 8),  # Its gradient: aux̎ = aux_row·q̈ + aux_bias
        ("kappa_1", ctypes.c_double),  # Second-order motion along ζ per null motion: > 0 is a fold (Type 1)
        ("kappa_2", ctypes.c_double),  # Turning rate of ζ along the null motion (Type 2)
    ]


assert ctypes.sizeof(SingularityState) == 280


class TargetContent(ctypes.Structure):
    """The motion that a person or another program asks for, without its header: also what the controller keeps of it."""

    __slots__ = ()
    _fields_ = [
        ("given_tick", ctypes.c_uint64),  # Tick at which it was given: its age counts from there
        ("valid_s", ctypes.c_double),  # How long it is valid from then on; the arm comes to rest after that [s]
        ("twist", ctypes.c_double * 6),  # Twist of E `[linear; angular]` in the axes of `frame`; of a pose: the twist with which it moves on until the next one, base axes [m/s, rad/s]
        ("position", ctypes.c_double * 3),  # Position of E in B, of a pose [m]
        ("quaternion", ctypes.c_double * 4),  # Rotation of E in B, of a pose: unit quaternion `[w, x, y, z]`
        ("q", ctypes.c_double * 8),  # Joint positions, of a posture [rad (m for prismatic joints)]
        ("force", ctypes.c_double * 3),  # Force with which the hand presses, in the axes of `force_frame`: along it the force is controlled and not the motion; zero: none [N]
        ("kind", ctypes.c_uint32),  # One of `TARGETS`
        ("frame", ctypes.c_uint32),  # One of `FRAMES`: the axes of a twist; a pose is in B
        ("side", ctypes.c_uint32),  # One of `SIDES`: the side in which a Type 1 singularity is to be left
        ("joints", ctypes.c_uint32),  # Joints of a posture
        ("force_frame", ctypes.c_uint32),  # One of `FRAMES`, base or hand: the axes of `force`
        ("reserved", ctypes.c_uint32),  # Zero in this version
    ]


assert ctypes.sizeof(TargetContent) == 232


class SensorSample(ctypes.Structure):
    """The readings of the arm's own sensors at a tick: plant → estimator."""

    __slots__ = ()
    _fields_ = [
        ("header", Header),  # Tick, incarnation, stamps
        ("q_encoder", ctypes.c_double * 8),  # Encoder positions, quantised and noisy [rad (m for prismatic joints)]
        ("tau_drive", ctypes.c_double * 8),  # Torque the drives applied over the tick before, as they report it [N·m]
        ("drive", ctypes.c_uint32),  # One of `DRIVES`
        ("stale_ticks", ctypes.c_uint32),  # Ticks since the last fresh torque
    ]


assert ctypes.sizeof(SensorSample) == 288


class PlantState(ctypes.Structure):
    """The simulator's truth at a tick, for judging and showing only: no process of the control chain reads it."""

    __slots__ = ()
    _fields_ = [
        ("header", Header),  # Tick, incarnation, stamps
        ("q", ctypes.c_double * 8),  # Joint positions [rad]
        ("qdot", ctypes.c_double * 8),  # Joint velocities [rad/s]
        ("tau", ctypes.c_double * 8),  # Torque applied over the tick before [N·m]
        ("p_BE", ctypes.c_double * 3),  # End-effector position in B [m]
        ("R_BE", ctypes.c_double * 9),  # End-effector rotation in B, column-major
        ("V_BE", ctypes.c_double * 6),  # End-effector twist [m/s, rad/s]
        ("contact_force_n", ctypes.c_double * 3),  # Sum of contact forces on the arm, base axes [N]
        ("contact_torque_nm", ctypes.c_double * 3),  # Moment of the surfaces on the hand about E, base axes [N·m]
        ("energy_j", ctypes.c_double),  # Kinetic and potential energy [J]
        ("contacts", ctypes.c_uint32),  # Number of contact points
        ("limit_mask", ctypes.c_uint32),  # Bit i: joint i is at a limit stop
        ("saturation_mask", ctypes.c_uint32),  # Bit i: the drive limited the torque of joint i
        ("drive", ctypes.c_uint32),  # One of `DRIVES`
        ("drive_flags", ctypes.c_uint32),  # Why the drive did not apply the commanded torque: a sum of `DRIVE_FLAGS`
        ("refused", ctypes.c_uint32),  # Commands refused since the start of the run
    ]


assert ctypes.sizeof(PlantState) == 568


class WristForce(ctypes.Structure):
    """The force on the hand as the wrist's sensor measures it, the tool's own weight taken out: plant → controller. Only runs that control a force have it."""

    __slots__ = ()
    _fields_ = [
        ("header", Header),  # Tick, incarnation, stamps
        ("force_n", ctypes.c_double * 3),  # Force of the surroundings on the hand, base axes, noise included [N]
        ("torque_nm", ctypes.c_double * 3),  # Their moment about E, base axes, noise included [N·m]
    ]


assert ctypes.sizeof(WristForce) == 200


class StateEstimate(ctypes.Structure):
    """The estimated state: estimator → analyzer, controller."""

    __slots__ = ()
    _fields_ = [
        ("header", Header),  # Tick, incarnation, stamps
        ("q", ctypes.c_double * 8),  # Joint positions [rad]
        ("qdot", ctypes.c_double * 8),  # Joint velocities [rad/s]
        ("tau_disturbance", ctypes.c_double * 8),  # Torque that the model does not explain (generalised-momentum observer), as it acts on the joints [N·m]
        ("innovation", ctypes.c_double * 8),  # Encoder minus predicted position [rad]
        ("drive", ctypes.c_uint32),  # One of `DRIVES`, passed on
        ("stale_ticks", ctypes.c_uint32),  # Ticks since the last fresh torque, passed on
    ]


assert ctypes.sizeof(StateEstimate) == 416


class SingularityReport(ctypes.Structure):
    """Where the arm is singular, or nearly: analyzer → controller."""

    __slots__ = ()
    _fields_ = [
        ("header", Header),  # Tick, incarnation, stamps
        ("count", ctypes.c_uint32),  # How many entries of `singularities` are meant
        ("rank", ctypes.c_uint32),  # Singular values above 1e-3 of √Σσ², of J at C with lengths divided by `length_m`
        ("det", ctypes.c_double),  # det J at E (unscaled) for square J, else √det JJᵀ; 0 for planar tasks that leave it undefined
        ("manipulability", ctypes.c_double),  # Yoshikawa's √det(JJᵀ), unit-scaled
        ("length_m", ctypes.c_double),  # The length that makes metres and radians comparable [m]
        ("p_BC", ctypes.c_double * 3),  # Position of C in B [m]
        ("singularities", SingularityState * 4),  # The singularities, in an order that never changes within a run
    ]


assert ctypes.sizeof(SingularityReport) == 1328


class Target(ctypes.Structure):
    """The motion asked for at a tick: operator → controller. Only runs that are steered have it."""

    __slots__ = ()
    _fields_ = [
        ("header", Header),  # Tick, incarnation, stamps
        ("target", TargetContent),  # The motion
    ]


assert ctypes.sizeof(Target) == 384


class ServoState(ctypes.Structure):
    """How the controller follows its target, and why not faster: controller → recorder, operator. Only runs that are steered have it."""

    __slots__ = ()
    _fields_ = [
        ("header", Header),  # Tick, incarnation, stamps
        ("V_target", ctypes.c_double * 6),  # Twist of E that the target asks for, base axes, before any limit [m/s, rad/s]
        ("p_target", ctypes.c_double * 3),  # Position of E in B that the target asks for; of a twist the reference's own [m]
        ("speed_scale", ctypes.c_double),  # Twist of the reference over the one asked for, 0 to 1
        ("behind_m", ctypes.c_double),  # Reference less the motion asked for that reach and limits have taken away since the target began: distance [m]
        ("nearest", ctypes.c_double),  # |s| of the nearest singularity over its η_out: below 1 the law acts on it; 1e9 where the arm reports none
        ("age_s", ctypes.c_double),  # Age of the target [s]
        ("reason", ctypes.c_uint32),  # One of `REASONS`
        ("joint", ctypes.c_uint32),  # 1 + index of the joint in the reason, 0 for none
        ("upper", ctypes.c_uint32),  # 1 where that joint is at its upper limit, 0 at its lower one
        ("singularity", ctypes.c_uint32),  # 1 + place of the nearest singularity, 0 for none
        ("refused", ctypes.c_uint32),  # Targets refused since the start of the run
        ("refusal", ctypes.c_uint32),  # Why the last of them was: one of `TARGET_REFUSALS`
        ("stop", ctypes.c_uint32),  # Why the law stopped the arm for a moment: one of `REFUSALS`
        ("stops", ctypes.c_uint32),  # How often it has since the start of the run
    ]


assert ctypes.sizeof(ServoState) == 288


class ControlState(ctypes.Structure):
    """The control law's intermediate results and its reference: controller → recorder, for judging and showing."""

    __slots__ = ()
    _fields_ = [
        ("header", Header),  # Tick, incarnation, stamps
        ("tau_task", ctypes.c_double * 8),  # The part of the torque that acts at the end-effector, J_rᵀF_r with compensation of gravity and Coriolis [N·m]
        ("tau_null", ctypes.c_double * 8),  # The part that acts in the null space, N_T Γ₀ [N·m]
        ("p_BE_d", ctypes.c_double * 3),  # Desired end-effector position in B [m]
        ("R_BE_d", ctypes.c_double * 9),  # Desired end-effector rotation in B, column-major
        ("V_BE_d", ctypes.c_double * 6),  # Desired end-effector twist [m/s, rad/s]
        ("error", ctypes.c_double * 6),  # Pose error `[p_d − p; axis-angle of R_d Rᵀ]` as the controller sees it [m, rad]
        ("path_time_s", ctypes.c_double),  # The trajectory's own clock [s]
        ("time_scale", ctypes.c_double),  # How fast it runs against real time, 0 to 1 (the governor)
        ("null_scale", ctypes.c_double),  # Fraction of the null-space torque that the limits let through, 0 to 1
        ("task_scale", ctypes.c_double),  # Fraction of the task torque that the limits let through, 0 to 1
        ("beta", ctypes.c_double * 4),  # Per singularity: β_i, 1 outside (full operational control), 0 fully inside
        ("aux_d", ctypes.c_double * 4),  # Per singularity: reference of the auxiliary coordinate [rad]
        ("aux_rate_d", ctypes.c_double * 4),  # Per singularity: commanded rate of the auxiliary coordinate [rad/s]
        ("planned_dq", ctypes.c_double * 8),  # Planned motion of each joint while ζ is turned by null-space motion, published before it begins. Zero when nothing is planned [rad]
        ("planned_s", ctypes.c_double),  # Planned duration of that motion, the governor's stretch included. Zero when nothing is planned [s]
        ("mode", ctypes.c_uint32 * 4),  # Per singularity: one of `MODES`
        ("segment", ctypes.c_uint32),  # Index of the task segment
        ("clipped", ctypes.c_uint32),  # 1 where the goal was beyond reach and has been clipped to the boundary
        ("planned", ctypes.c_uint32),  # 1 + the place of the singularity whose ζ is being turned as planned, 0 when none is
        ("refusal", ctypes.c_uint32),  # One of `REFUSALS`
        ("rate_mask", ctypes.c_uint32),  # Bit i: the law asked for a faster change of torque i than its drive accepts; the torque sent changes at the largest rate
        ("rejected_ticks", ctypes.c_uint32),  # Ticks in a row for which the estimate has been set aside, because no torque within the limits moves the arm so
    ]


assert ctypes.sizeof(ControlState) == 712


class TorqueCommand(ctypes.Structure):
    """Commanded torque: controller → plant."""

    __slots__ = ()
    _fields_ = [
        ("header", Header),  # Tick, incarnation, stamps
        ("tau", ctypes.c_double * 8),  # Commanded torque Γ [N·m]
        ("phase", ctypes.c_uint32),  # One of `PHASES`: the run is over when the task is
        ("saturation_mask", ctypes.c_uint32),  # Bit i: the torque of joint i is at its limit
    ]


assert ctypes.sizeof(TorqueCommand) == 224


# Topic: structure, versioned type name, hash of the layout.
TOPICS = {
    "sensor": (SensorSample, "armplane.SensorSample.v3", 0x7b596d813efcbd78),
    "plant_state": (PlantState, "armplane.PlantState.v4", 0xb3888d727801d3f1),
    "wrist_force": (WristForce, "armplane.WristForce.v2", 0xc27d3de544822214),
    "estimate": (StateEstimate, "armplane.StateEstimate.v4", 0x26d6dbe8667c45e8),
    "singularity": (SingularityReport, "armplane.SingularityReport.v5", 0xa79668c82480372e),
    "target": (Target, "armplane.Target.v3", 0xd05ed08f0498db01),
    "servo_state": (ServoState, "armplane.ServoState.v1", 0xb214d5f1957726e4),
    "control_state": (ControlState, "armplane.ControlState.v4", 0x3d6226b63bfda497),
    "torque": (TorqueCommand, "armplane.TorqueCommand.v5", 0xf478adead3f15ea4),
}
