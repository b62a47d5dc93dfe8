"""Tables to signals: which columns are joint positions, commands, torques, a twist or a pose, by their names or by a map; their units and their order."""

from __future__ import annotations

import fnmatch
import re
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from .logs import LogError

ROLES = tuple("t q qdot tau q_cmd qdot_cmd tau_cmd twist_cmd pose pose_cmd".split())
_words = lambda text: set(text.split())
_COMMAND = _words("cmd cmds command commands commanded target desired des reference ref setpoint goal action d c trajectory")
_MEASURED = {"feedback", "actual", "measured"}
_VELOCITY = _words("qd dq qdot vel velocity velocities speed speeds qvel jog")
_TORQUE = _words("tau torque torques effort efforts moment")
_POSITION = _words("q pos position positions angle angles jpos qpos")
_CARTESIAN = _words("tcp pose twist wrench force ee cartesian linear angular orientation flange be eef delta")
# Words around joints that say nothing about the quantity.
_PLAIN = _COMMAND | _MEASURED - {"measured"} | _words("observation state states joint joints j axis a * # data arm robot")
# Columns that name joints, but are none of these quantities.
_NO = _words(
    """error errors err innovation std temperature current currents voltage acceleration accelerations acc ddq qdd limit min max raw disturbance received sent
    ext external encoder task null aux planned received_ns gravity friction singularity singularities events header mode status mask output drive index images
    imu"""
)
_NO_HAND = _NO | _words("wrench force error imu torque camera odom")
_TIME = _words("t time timestamp timestamps stamp elapsed clock secs seconds")
_TICK = (["tick"], ["frame", "index"])
_BEST = "plant_state joint_states joint_state actual feedback measured observation state estimate".split()
_HALVES = {"linear": "l", "angular": "a", "orientation": "q", "position": "p"}
# How the columns of a twist, of a place and of a rotation end.
_TWISTS, _PLACES, _TURNS = ["lx ly lz ax ay az", "vx vy vz wx wy wz"], ["px py pz", "x y z"], ["qx qy qz qw", "qqx qqy qqz qqw", "rx ry rz"]
_AXES = _words("x y z w vx vy vz wx wy wz qx qy qz qw rx ry rz")


@dataclass
class Stream:
    """One quantity over its own time stamps: `t` (N,), s; `x` (N, …); `name`: the columns that it is made of."""

    t: np.ndarray
    x: np.ndarray
    name: str


@dataclass
class Log:
    """The signals of a log by role, in SI units, joints in the arm's order; `notes`: sentences about everything that was guessed."""

    name: str
    streams: dict
    notes: list = field(default_factory=list)
    start: float = 0.0

    def __getitem__(self, role):
        return self.streams.get(role)


def tokens(name):
    """The words and numbers of a name, in lower case."""
    return [one.lower() for one in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", name)]


def _matching(wanted, names):
    """The names in the order of the names or patterns that are wanted."""
    return [name for one in wanted for name in ([one] if one in names else fnmatch.filter(names, one))]


def choose(source, robot, mapping):
    """The `Log` of a `Source` for a robot. `mapping`: {role: [columns or patterns]}. Raises `LogError` where no joint positions are found."""
    notes, streams, candidates = list(source.notes), {}, []
    for table in source.tables:
        t = _time(table, source, notes, mapping.get("t"))
        step = np.median(np.diff(t[np.isfinite(t)])) if t is not None and np.isfinite(t).sum() > 9 else 0
        if not 1e-5 < step < 2:
            notes.append(f"Left out, for its stamps do not increase by steps of a control period: {_short(list(table.columns), table.topic)}.")
            continue
        columns = {name: values for name, values in table.columns.items() if len(values) == len(t)}
        if table.kind.endswith("JointTrajectory"):
            t, columns = _points(t, columns)
        found = [*_joint_groups(table.topic, columns, robot), *_hand_groups(table.topic, columns)]
        candidates += [(rank, len(t), role, names, t, columns, table.topic) for role, rank, names in found if role not in mapping]
        for role, wanted in mapping.items():
            names = _matching(wanted, columns)
            if role != "t" and names and role not in streams:
                streams[role] = _mapped(role, names, columns, t, robot)
    for _, _, role, names, t, columns, topic in sorted(candidates, key=lambda one: one[:2], reverse=True):
        if role not in streams:
            streams[role] = Stream(t, _stacked(role, names, columns), _short(names, topic))
    for role in mapping:
        if role != "t" and role not in streams:
            raise LogError(f"{source.name}: --map {role} names no column; there are {_listed(source)}")
    if "q_cmd" in streams and "q" not in streams and "qdot" not in streams:
        streams["q"] = streams["q_cmd"]
        notes.append("The log has only commanded positions; they are taken for the measured ones.")
    if "q" not in streams:
        why = f" ({notes[-1].rstrip('.')})" if notes else ""
        raise LogError(f"{source.name}: no {robot.dof} joint positions of {robot.name} found{why}; name them by --map q=COLUMN,…; there are {_listed(source)}")
    log = Log(source.name, streams, notes)
    _units(log, robot)
    _clean(log)
    return log


def _listed(source):
    names = [f"{table.topic}/{name}" if table.topic else name for table in source.tables for name in table.columns]
    return ", ".join(name[:60] for name in names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")


def _short(names, topic):
    first, last = str(names[0])[:60], str(names[-1])[:60]
    return f"{topic}: {first} … {last}" if topic else f"{first} … {last}"


def _time(table, source, notes, mapped):
    """Time stamps of a table in seconds: those in its messages' headers, else when they were logged, or a column."""
    if table.t is not None:
        sec, nsec = (next((values for name, values in table.columns.items() if name.endswith(f"header.stamp.{end}")), None) for end in ("sec", "nanosec"))
        if sec is not None and nsec is not None and np.all(sec[:1] > 0):
            stamps = sec + nsec * 1e-9
            if abs((stamps[-1] - stamps[0]) - (table.t[-1] - table.t[0])) < 10:
                return stamps
        return table.t
    words = {name: tokens(name) for name in table.columns}
    named = _matching(mapped, words) if mapped else [name for name in words if _TIME & {*words[name]} and not _COMMAND & {*words[name]}]
    for name in sorted(named, key=lambda name: (len(words[name]), name)):
        t = table.columns[name]
        step = np.diff(t[np.isfinite(t)])
        if len(step) and np.median(step) > 0:
            # A control period is 0.2 ms to 0.5 s; beyond that the unit is a smaller one.
            units = {1.0: "", 1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds"}
            unit = next((unit for unit in units if 2e-4 <= np.median(step) * unit < 0.5), 1.0)
            if units[unit]:
                notes.append(f"Column {name[:60]} is in {units[unit]}, by its steps.")
            return t * unit
    ticks = next((values for name, values in table.columns.items() if words[name] in _TICK), None)
    if ticks is None and not source.fps:
        return None
    if source.fps and ticks is not None:
        return ticks / source.fps
    notes.append(f"The log has no time stamps; its rows are taken for {source.fps or 1000:g} Hz.")
    return np.arange(len(next(iter(table.columns.values())))) / (source.fps or 1000)


def _points(t, columns):
    """A trajectory message's points, each at its time from the start; of overlapping messages, the later one counts."""
    points = {}
    for name, values in columns.items():
        if match := re.match(r"points\[(\d+)\]\.(.*)$", name):
            points.setdefault(int(match[1]), {})[match[2]] = values
    if not points:
        return t, columns
    points = [points[k] for k in sorted(points)]
    at = np.stack([t + point.pop("time_from_start.sec", 0) + 1e-9 * point.pop("time_from_start.nanosec", 0) for point in points], 1)
    if len(points) > 1:
        at[:-1][at[:-1] >= t[1:, None]] = np.nan
    known = np.isfinite(at)
    return at[known], {name: np.stack([point[name] for point in points], 1)[known] for name in points[0] if all(name in point for point in points)}


def _joint_groups(topic, columns, robot):
    """Groups of one column per joint, by the joints' names or by numbers: (role, rank, names)."""
    # Names such as joint1 also come with other prefixes, and are found by their numbers.
    forms = [(f" {' '.join(form)} ", j) for j, name in enumerate(robot.joints) for words in [tokens(name)] for form in (words, [w for w in words if w not in ("joint", "link")])]
    forms = [(form, j) for form, j in forms if re.search(r"[a-z]", form)]
    groups = {}
    for name in columns:
        text = f" {' '.join(tokens(name))} "
        if inside := [one for one in forms if one[0] in text]:
            form, j = max(inside, key=lambda one: one[0].count(" "))
            groups.setdefault((True, text.replace(form, " * ", 1)), {}).setdefault(j, name)
        for number in re.finditer(r"(?<= )\d{1,3}(?= )", text):
            groups.setdefault((False, f"{text[: number.start()]}#{text[number.end() :]}"), {}).setdefault(int(number[0]), name)
    for (is_named, stem), members in groups.items():
        first = 0 if is_named else min(members)
        names = [members.get(first + k) for k in range(robot.dof)]
        too_many = len(members) > robot.dof + 2 and not topic
        # Messages of a fixed size end in zeros behind the last joint.
        is_padded = len(members) > robot.dof and not any(columns[members[k]].any() for k in members if k >= first + robot.dof - 1)
        if None in names or first > 1 or not is_named and (too_many or is_padded):
            continue
        if role := _role([*tokens(topic), *stem.split()]):
            best = next((len(_BEST) - k for k, word in enumerate(_BEST) if word in f"{topic}.{names[0]}".lower()), 0)
            yield role, 10 * is_named + best - len(stem.split()), names


def _role(words):
    """The role of a group of joint columns by the words around the joint's name, `None` for another quantity."""
    known = set(words)
    if known & (_NO | _CARTESIAN):
        return None
    command = "_cmd" if known & _COMMAND and not known & _MEASURED else ""
    if known & (_VELOCITY | _TORQUE):
        return f"{'qdot' if known & _VELOCITY else 'tau'}{command}"
    return f"q{command}" if known & _POSITION or len(known - _PLAIN) < 2 else None


def _hand_groups(topic, columns):
    """Twists and poses of the hand, six or seven columns each: (role, rank, names)."""
    groups = {}
    for name in columns:
        words = tokens(name)
        if words and words[-1] in _AXES:
            half = next((_HALVES[one] for one in _HALVES if one in words), "")
            groups.setdefault(tuple(one for one in words[:-1] if one not in _HALVES), {})[half + words[-1]] = name
        if match := re.fullmatch(r"(.*?)[\[_.]?(\d+)\]?", name):
            groups.setdefault(tuple(tokens(match[1])), {})[match[2]] = name
    for stem, members in groups.items():
        words = {*tokens(topic), *stem}
        if words & _NO_HAND:
            continue
        pick = lambda *endings: next((found for ending in endings if None not in (found := [members.get(one) for one in ending.split()])), [])
        six = pick("0 1 2 3 4 5") if len(members) == 6 and words & _CARTESIAN else []
        twist = six if six and words & (_VELOCITY | {"twist", "v", "dp"}) else pick(*_TWISTS)
        if twist and words & (_COMMAND | {"delta"}):
            yield "twist_cmd", 0, twist
        place = pick(*_PLACES)
        names = [*place, *pick(*_TURNS)] if place else six if "pose" in words else []
        if len(names) > 3 or names and words & _CARTESIAN:
            yield "pose_cmd" if words & _COMMAND else "pose", len(names), names
    if "r_be_d[8]" in columns and "p_be_d[2]" in columns:
        yield "pose_cmd", 20, [*(f"p_be_d[{k}]" for k in range(3)), *(f"r_be_d[{k}]" for k in range(9))]


def _stacked(role, names, columns):
    """The rows of columns; of a pose (N, 4, 4) `x y z`, with a rotation vector, a quaternion `x y z w` or a matrix by columns behind; a NaN stays one."""
    rows = np.stack([columns[name] for name in names], 1)
    if not role.startswith("pose"):
        return rows
    pose, turn = np.tile(np.eye(4), (len(rows), 1, 1)), rows[:, 3:]
    pose[:, :3, 3] = rows[:, :3]
    if turn.shape[1] == 9:
        pose[:, :3, :3] = turn.reshape(-1, 3, 3).transpose(0, 2, 1)
    elif turn.shape[1]:
        known = np.isfinite(turn).all(axis=1) & (turn.any(axis=1) | (turn.shape[1] == 3))
        pose[~known, :3, :3] = np.nan
        pose[known, :3, :3] = (Rotation.from_rotvec if turn.shape[1] == 3 else Rotation.from_quat)(turn[known]).as_matrix()
    return pose


def _mapped(role, names, columns, t, robot):
    """The stream of a `--map`; raises where it has another number of columns than its role."""
    needed = {"twist_cmd": (6,), "pose": (3, 6, 7), "pose_cmd": (3, 6, 7)}.get(role, (robot.dof,))
    if len(names) not in needed:
        raise LogError(f"--map {role} names {len(names)} columns: it needs {' or '.join(map(str, needed))}, in the order of {', '.join(robot.joints)}")
    return Stream(t, _stacked(role, names, columns), ", ".join(names))


def _units(log, robot):
    """Degrees to radians, by the size of positions and by velocities as derivatives of positions."""
    turns, q = robot.turns, log["q"]

    def to_radians(stream, sentence):
        stream.x = np.where(turns, np.radians(stream.x), stream.x)
        log.notes.append(sentence)

    inside = lambda x: np.mean((x > robot.lower[turns] - 0.1) & (x < robot.upper[turns] + 0.1))
    for role, words in (("q", "Positions"), ("q_cmd", "Commanded positions")):
        stream = log[role]
        if stream is None or role == "q_cmd" and stream is q or not np.isfinite(x := stream.x[:, turns]).any():
            continue
        largest = np.nanmax(np.abs(x))
        is_large = largest > 10 or largest > 2 * np.pi + 0.1 and inside(np.radians(x)) > inside(x) + 0.2
        is_other = role == "q_cmd" and np.nanmedian(np.abs(x)) > 20 * np.nanmedian(np.abs(q.x[:, turns])) + 0.1
        # A command that runs away in the incident was in the state's units when it set out.
        off = lambda x: np.abs(x[np.isfinite(x).all(axis=1)][:1] - q.x[:1, turns]).sum()
        is_alike = role == "q_cmd" and off(x) < off(np.radians(x))
        if (is_large or is_other) and largest < 3000 and not is_alike:
            to_radians(stream, f"{words} are in degrees: the largest is {largest:.0f}.")
    if len(q.t) < 10:
        return
    slopes = np.nanquantile(np.abs(np.gradient(q.x[:, turns], axis=0) / np.maximum(np.gradient(q.t), 1e-9)[:, None]), 0.95)
    for role, words in (("qdot", "Velocities"), ("qdot_cmd", "Commanded velocities")):
        if (stream := log[role]) is not None and slopes > 1e-3 and 25 < (times := np.nanquantile(np.abs(stream.x[:, turns]), 0.95) / slopes) < 130:
            to_radians(stream, f"{words} are in degrees per second: they are {times:.0f} times the positions' slope.")


def _clean(log):
    """One clock that starts at zero; rows whose stamps are not finite left out; an action that is no position left out."""
    for stream in log.streams.values():
        if not np.isfinite(stream.t).any():
            raise LogError(f"{log.name}: the time stamps of {stream.name} are no numbers; name others by --map t=COLUMN")
    log.start = min(np.nanmin(stream.t) for stream in log.streams.values())
    for stream in {id(stream): stream for stream in log.streams.values()}.values():
        known = np.isfinite(stream.t)
        stream.t, stream.x = stream.t[known] - log.start, stream.x[known]
    q, cmd = log["q"], log["q_cmd"]
    if cmd is not None and cmd is not q:
        off = np.nanmedian(np.abs(hold(cmd, q.t) - q.x), axis=0)
        if np.median(off / (np.nanmax(q.x, axis=0) - np.nanmin(q.x, axis=0) + 0.3)) > 1:
            del log.streams["q_cmd"]
            log.notes.append(f"The columns {cmd.name} are no joint positions in the arm's units, and were left out.")


def hold(stream, t):
    """A stream's newest values at the times `t`; its first before it begins."""
    return stream.x[np.clip(np.searchsorted(stream.t, t + 1e-9, side="right") - 1, 0, len(stream.t) - 1)]
