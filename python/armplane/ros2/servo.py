"""Commands of ROS 2 as targets of a steered run, by the rules of MoveIt Servo (moveit2, moveit_ros/moveit_servo).

Each function gives the line of a target (docs/servo.md); a command that cannot be followed raises ValueError. Then the arm comes to rest, as with Servo.
"""

from dataclasses import dataclass

import numpy as np
from numpy.linalg import norm

from ..rotation import rotation_log, rotation_of

# Servo's defaults: age at which a command is over (s), what 1.0 means without units (m/s, rad/s, and rad/s or m/s of a joint), room before a joint's limit.
TIMEOUT_S, LINEAR, ROTATIONAL, JOINT, MARGIN = 0.1, 0.4, 0.8, 0.5, 0.1
# armplane's reference arm goes to a posture at GAIN times the way to it, 1/s, and at most at this share of each joint's speed limit.
GAIN, SHARE = 5, 0.4
# A path begins no further than this from the arm, and a jog leads the arm by no more; rad or m.
APART = 0.2
# Of a table of way points: longest path, s, and pause between the points that are kept of it.
LONGEST_S, STEP_S = 600, 0.01
# The law takes no larger number and no farther position, m (services/control/src/reference/targets/intake.rs).
LARGEST, FARTHEST_M = 1000, 100
REST = "twist, base, 0.1, 0 0 0 0 0 0"


def seconds(time):
    return time.sec + 1e-9 * time.nanosec


def numbers(values):
    """Their array; ValueError where one is not finite, or is absurd."""
    found = np.array(list(values), float)
    if not np.isfinite(found).all():
        raise ValueError("it holds a NaN or an infinity")
    if (most := np.abs(found).max(initial=0)) > LARGEST:
        raise ValueError(f"it holds a number of size {most:.3g}, and {LARGEST} is the largest that an arm can follow")
    return found


def fields(message, names):
    """The numbers of a message in fields of one letter."""
    return numbers(getattr(message, name) for name in names)


def line(head, valid_s, *values):
    return f"{head}, {valid_s:.4f}, " + " ".join(f"{x:.9g}" for x in np.concatenate(values))


def quaternion(R):
    """`w, x, y, z` of a rotation matrix."""
    turn = rotation_log(R)
    # sin(a/2)/a of the angle a, also of none.
    return np.append(np.cos(norm(turn) / 2), turn * np.sinc(norm(turn) / (2 * np.pi)) / 2)


class Commands:
    """The command in force. `has_units`: speeds are in m/s and rad/s, not shares of Servo's scale (`command_in_type`)."""

    def __init__(self, robot, has_units):
        """`robot`: of `armplane.play.robot`."""
        self.robot, self.has_units, self.arm = robot, has_units, robot.arm
        self.most = SHARE * np.minimum(self.arm.velocity, 10)
        self.motion = None

    def frame(self, name, q):
        """The pose of a link in the base, (4, 4); ValueError for an unknown one."""
        name = name.lstrip("/")
        if name == self.arm.tip:
            return self.robot.frames(q)[-1]
        if name not in self.robot.links:
            raise ValueError(f"its frame_id is '{name}', and the arm's frames are {', '.join([*self.robot.links, self.arm.tip])}")
        joint, at = self.robot.links[name]
        return at if joint is None else self.robot.frames(q)[joint] @ at

    def _valid_s(self, message, now):
        """For how long a command is still valid, s. One from the future is from now."""
        age = now - seconds(message.header.stamp)
        if age >= TIMEOUT_S:
            stamp = "its stamp is 0: send the time" if not seconds(message.header.stamp) else f"it is {age:.2f} s old, and valid for {TIMEOUT_S} s"
            raise ValueError(stamp)
        return TIMEOUT_S - max(age, 0)

    def _scaled(self, speed, scale):
        return speed * (min(1, scale / max(norm(speed), 1e-12)) if self.has_units else scale)

    def twist(self, message, now, q):
        """A geometry_msgs/TwistStamped: about the hand, in the axes of its frame."""
        self.motion, valid_s, name = None, self._valid_s(message, now), message.header.frame_id
        v, w = self._scaled(fields(message.twist.linear, "xyz"), LINEAR), self._scaled(fields(message.twist.angular, "xyz"), ROTATIONAL)
        axes = {self.robot.base: "base", self.arm.tip: "hand", "armplane/singular": "singular"}.get(name.lstrip("/"))
        if axes is None:
            R = self.frame(name, q)[:3, :3]
            axes, v, w = "base", R @ v, R @ w
        return line(f"twist, {axes}", valid_s, v, w)

    def pose(self, message, now, q):
        """A geometry_msgs/PoseStamped: a goal of the hand."""
        self.motion, valid_s = None, self._valid_s(message, now)
        p, x = fields(message.pose.position, "xyz"), fields(message.pose.orientation, "wxyz")
        if abs(norm(x) - 1) > 1e-3:
            raise ValueError(f"its quaternion has norm {norm(x):.4f}, not 1")
        base = self.frame(message.header.frame_id, q)
        p = base[:3, :3] @ p + base[:3, 3]
        if np.abs(p).max() > FARTHEST_M:
            raise ValueError(f"its position is {norm(p):.3g} m from the base, and {FARTHEST_M} m is the farthest that an arm can follow")
        return line("pose, base", valid_s, p, quaternion(base[:3, :3] @ rotation_of(x)), np.zeros(6))

    def jog(self, message, now, q):
        """A control_msgs/JointJog: speeds of joints, and rest for all others."""
        valid_s, velocity = self._valid_s(message, now), np.zeros(self.arm.dof)
        if len(message.joint_names) != len(message.velocities):
            raise ValueError(f"it has {len(message.joint_names)} joints and {len(message.velocities)} velocities")
        velocity[self._places(message.joint_names)] = numbers(message.velocities)
        velocity *= 1 if self.has_units else JOINT
        velocity /= max(1, np.max(np.abs(velocity) / self.most, initial=0))
        before = self.motion if isinstance(self.motion, Jog) else None
        self.motion = Jog(self.arm, before.q if before else q, velocity, now, now + valid_s)
        return None

    def _places(self, names):
        unknown = [name for name in names if name not in self.arm.joints]
        if unknown or len(set(names)) < len(names):
            raise ValueError(f"it names {', '.join(unknown) or 'a joint twice'}, and the arm's joints are {', '.join(self.arm.joints)}")
        return [self.arm.joints.index(name) for name in names]

    def trajectory(self, message, now, q):
        """A trajectory_msgs/JointTrajectory: way points from the arm's posture; without points, rest."""
        self.motion = None
        if not message.points:
            return REST
        places = self._places(message.joint_names)
        if len(places) != self.arm.dof:
            raise ValueError(f"it has {len(places)} of the arm's {self.arm.dof} joints")
        if any(len(point.positions) != self.arm.dof or len(point.velocities) not in (0, self.arm.dof) for point in message.points):
            raise ValueError(f"each point needs {self.arm.dof} positions, and as many velocities or none")
        order, has_speeds = np.argsort(places), all(len(point.velocities) for point in message.points)
        times = np.array([seconds(point.time_from_start) for point in message.points])
        points = numbers(point.positions for point in message.points)[:, order]
        speeds = numbers(point.velocities for point in message.points)[:, order] if has_speeds else None
        if times[0] > 0:
            times, points = np.append(0, times), np.vstack([q, points])
            speeds = np.vstack([0 * q, speeds]) if has_speeds else None
        begin = seconds(message.header.stamp) or now
        self.motion = Path(self.arm, q, times, points, speeds, begin, self.most)
        if now > begin + self.motion.times[-1]:
            self.motion = None
            raise ValueError(f"it was over {now - begin:.2f} s after its stamp")
        return None

    def next(self, now, q):
        """The line of a jog or a path at this moment, `None` if there is none."""
        found = self.motion and self.motion.line(now, q)
        self.motion = self.motion if found else None
        return found


@dataclass
class Jog:
    """Joints that move at their speeds until a joint has MARGIN left to its limit; then all rest."""

    arm: object
    q: np.ndarray
    velocity: np.ndarray
    now: float
    end: float

    def line(self, now, q):
        if now >= self.end:
            return None
        step = self.velocity * max(now - self.now, 0)
        ahead, self.now = self.q + step, now
        # Where it stands nearer to a limit already, it may stay.
        lower, upper = np.minimum(self.arm.lower + MARGIN, self.q), np.maximum(self.arm.upper - MARGIN, self.q)
        is_held = ((ahead > upper) | (ahead < lower)).any() or np.abs(ahead - q).max() > APART
        self.q = self.q if is_held else ahead
        return line("posture, joints", self.end - now, np.clip(self.q + (0 if is_held else self.velocity / GAIN), lower, upper))


class Path:
    """Way points; slower than asked for if a joint would move faster than a posture target does."""

    def __init__(self, arm, q, times, points, speeds, begin, most):
        if times[0] < 0 or (np.diff(times) <= 0).any() or times[-1] > LONGEST_S:
            raise ValueError(f"its times must rise from 0 to at most {LONGEST_S:.0f} s")
        if np.abs(points[0] - q).max() > APART:
            raise ValueError(f"it begins {np.abs(points[0] - q).max():.2f} rad from the arm: give its first point time to get there")
        if len(times) == 1:
            times, points, speeds = np.array([0, STEP_S]), np.vstack([points, points]), None
        grid = np.linspace(0, times[-1], 2 + int(times[-1] / STEP_S))
        k = np.clip(np.searchsorted(times, grid, "right") - 1, 0, len(times) - 2)
        h = (times[k + 1] - times[k])[:, None]
        x, a, way = (grid - times[k])[:, None] / h, points[k], points[k + 1] - points[k]
        # A cubic; a line where the points have no speeds.
        u, v = (way, way) if speeds is None else (h * speeds[k], h * speeds[k + 1])
        self.q = a + x * (u + x * (3 * way - 2 * u - v + x * (u + v - 2 * way)))
        if ((self.q < arm.lower) | (self.q > arm.upper)).any():
            raise ValueError("it leaves the joint limits")
        step = grid[1]
        slower = max(1, np.max(np.abs(np.diff(self.q, axis=0)) / step / most))
        self.times, self.begin, self.speed = grid * slower, begin, np.gradient(self.q, axis=0) / (step * slower)

    def line(self, now, q):
        t = now - self.begin
        # At its end it stays for a second.
        if t > self.times[-1] + 1:
            return None
        part, k = np.modf(np.clip(t / self.times[1], 0, len(self.times) - 1.001))
        goal = (1 - part) * self.q[int(k)] + part * self.q[int(k) + 1]
        return line("posture, joints", TIMEOUT_S, goal + (self.speed[int(k)] / GAIN if 0 <= t < self.times[-1] else 0))
