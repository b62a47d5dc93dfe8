"""Tables to signals: which columns are joint positions, commands, torques, a twist or a pose, by their names or by a map; their units and their order."""

import fnmatch
import re
from dataclasses import dataclass, field

import numpy as np

from ..rotation import rotation_exp, rotation_of
from .logs import LogError

ROLES = ("t", "q", "qdot", "tau", "q_cmd", "qdot_cmd", "tau_cmd", "twist_cmd", "pose", "pose_cmd")
_COMMAND = {"cmd", "cmds", "command", "commands", "commanded", "target", "desired", "des", "reference", "ref", "setpoint", "goal", "action", "d", "c", "trajectory"}
_VELOCITY = {"qd", "dq", "qdot", "vel", "velocity", "velocities", "speed", "speeds", "qvel", "jog"}
_TORQUE = {"tau", "torque", "torques", "effort", "efforts", "moment"}
_POSITION = {"q", "pos", "position", "positions", "angle", "angles", "jpos", "qpos"}
_CARTESIAN = {"tcp", "pose", "twist", "wrench", "force", "ee", "cartesian", "linear", "angular", "orientation", "flange", "be", "eef", "delta"}
# Columns that name joints, but are none of these quantities.
_NO = {
    "error", "errors", "err", "innovation", "std", "temperature", "current", "currents", "voltage", "acceleration", "accelerations", "acc", "ddq", "qdd", "limit",
    "min", "max", "raw", "disturbance", "received", "sent", "ext", "external", "encoder", "task", "null", "aux", "planned", "received_ns", "gravity", "friction",
    "singularity", "singularities", "events", "header", "mode", "status", "mask", "output", "drive", "index", "images", "imu",
}  # fmt: skip
_TIME = {"t", "time", "timestamp", "timestamps", "stamp", "elapsed", "clock", "secs", "seconds"}
_BEST = ("plant_state", "joint_states", "joint_state", "actual", "feedback", "measured", "observation", "state", "estimate")


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


def choose(source, robot, mapping=None):
    """The `Log` of a `Source` for a robot. `mapping`: {role: [columns or patterns]}. Raises `LogError` where no joint positions are found."""
    notes, streams = list(source.notes), {}
    candidates = {}
    for table in source.tables:
        t = _time(table, source, notes, (mapping or {}).get("t"))
        step = np.median(np.diff(t[np.isfinite(t)])) if t is not None and np.isfinite(t).sum() > 9 else 0
        if not 1e-5 < step < 2:
            notes.append(f"Left out, for its stamps do not increase by steps of a control period: {_short(list(table.columns), table.topic)[0]}.")
            continue
        columns = {name: values for name, values in table.columns.items() if len(values) == len(t)}
        if table.kind.endswith("JointTrajectory"):
            t, columns = _points(t, columns)
        found = [*_joint_groups(table.topic, columns, robot), *_hand_groups(table.topic, columns)]
        for role, rank, names, make in found:
            if not mapping or role not in mapping:
                candidates.setdefault(role, []).append((rank, len(t), Stream(t, make, ", ".join(_short(names, table.topic)))))
        for role, wanted in (mapping or {}).items():
            names = [name for one in wanted for name in (fnmatch.filter(columns, one) if one not in columns else [one])]
            if role != "t" and names and (role not in streams):
                streams[role] = _mapped(role, names, columns, t, robot)
    for role, several in candidates.items():
        rank, _, stream = max(several, key=lambda one: (one[0], one[1]))
        stream.x = stream.x()
        streams.setdefault(role, stream)
    for role in mapping or {}:
        if role != "t" and role not in streams:
            raise LogError(f"{source.name}: --map {role} names no column; there are {_listed(source)}")
    if "q" not in streams and "q_cmd" in streams and "qdot" not in streams:
        streams["q"] = streams["q_cmd"]
        notes.append("The log has only commanded positions; they are taken for the measured ones.")
    if "q" not in streams:
        raise LogError(f"{source.name}: no {robot.dof} joint positions of {robot.name} found{' (' + notes[-1].rstrip('.') + ')' if notes else ''}; name them by --map q=COLUMN,…; there are {_listed(source)}")
    log = Log(source.name, streams, notes)
    _units(log, robot)
    _clean(log)
    return log


def _listed(source):
    names = [f"{table.topic}/{name}" if table.topic else name for table in source.tables for name in table.columns]
    return ", ".join(name[:60] for name in names[:12]) + (f" and {len(names) - 12} more" if len(names) > 12 else "")


def _short(names, topic):
    first, last = str(names[0])[:60], str(names[-1])[:60]
    return [f"{topic}: {first} … {last}" if topic else f"{first} … {last}"]


def _time(table, source, notes, mapped):
    """Time stamps of a table in seconds: those in its messages' headers, else when they were logged, or a column."""
    if table.t is not None:
        sec, nsec = (next((values for name, values in table.columns.items() if name.endswith(f"header.stamp.{end}")), None) for end in ("sec", "nanosec"))
        if sec is not None and nsec is not None and np.all(sec[:1] > 0):
            stamps = sec + nsec * 1e-9
            if abs((stamps[-1] - stamps[0]) - (table.t[-1] - table.t[0])) < 10:
                return stamps
        return table.t
    wanted = lambda name: name in mapped or any(fnmatch.fnmatch(name, one) for one in mapped) if mapped else _TIME & set(tokens(name)) and not _COMMAND & set(tokens(name))
    named = sorted((name for name in table.columns if wanted(name)), key=lambda name: (len(tokens(name)), name))
    for name in named:
        t = table.columns[name]
        step = np.diff(t[np.isfinite(t)])
        if len(step) and np.median(step) > 0:
            # A control period is 0.2 ms to 0.5 s; beyond that the unit is a smaller one.
            unit = next((unit for unit in (1.0, 1e-3, 1e-6, 1e-9) if 2e-4 <= np.median(step) * unit < 0.5), 1.0)
            words = {1e-3: "milliseconds", 1e-6: "microseconds", 1e-9: "nanoseconds"}.get(unit)
            if words:
                notes.append(f"Column {name[:60]} is in {words}, by its steps.")
            return t * unit
    tick = next((values for name, values in table.columns.items() if tokens(name) in (["tick"], ["frame", "index"])), None)
    if source.fps and tick is not None:
        return tick / source.fps
    count = len(next(iter(table.columns.values())))
    if source.fps or tick is not None:
        notes.append(f"The log has no time stamps; its rows are taken for {source.fps or 1000:g} Hz.")
        return np.arange(count) / (source.fps or 1000)
    return None


def _points(t, columns):
    """A trajectory message's points, each at its time from the start; of overlapping messages, the later one counts."""
    rows, seconds = {}, {}
    for name, values in columns.items():
        if match := re.match(r"points\[(\d+)\]\.(time_from_start\.(sec|nanosec)|.*)$", name):
            part = seconds if match.group(3) else rows
            part.setdefault(int(match.group(1)), {})[match.group(3) or match.group(2)] = values
    if not rows:
        return t, columns
    keys = sorted(rows)
    at = np.stack([t + seconds[k].get("sec", 0) + seconds[k].get("nanosec", 0) * 1e-9 if k in seconds else t for k in keys], 1)
    if len(keys) > 1:
        at[:-1][at[:-1] >= t[1:, None]] = np.nan
    flat = {name: np.stack([rows[k][name] for k in keys], 1).ravel() for name in rows[keys[0]] if all(name in rows[k] for k in keys)}
    known = np.isfinite(at.ravel())
    return at.ravel()[known], {name: values[known] for name, values in flat.items()}


def _joint_groups(topic, columns, robot):
    """Groups of one column per joint: (role, rank, names, how to stack them)."""
    named = [[full, [one for one in full if one not in ("joint", "link")]] for full in map(tokens, robot.joints)]
    named = [[one for one in both if any(not word.isdigit() for word in one)] for both in named]
    # Names such as joint1 also come with other prefixes, and are found by their numbers.
    groups = {}
    for name in columns:
        words = tokens(name)
        best = (0, None, None)
        for j, both in enumerate(named):
            for form in both:
                at = next((k for k in range(len(words) - len(form) + 1) if words[k : k + len(form)] == form), None)
                if at is not None and len(form) > best[0]:
                    best = (len(form), j, tuple(words[:at] + ["*"] + words[at + len(form) :]))
        if best[1] is not None:
            groups.setdefault(("named", best[2]), {}).setdefault(best[1], name)
        for k, word in enumerate(words):
            if word.isdigit() and len(word) < 4:
                groups.setdefault(("numbered", tuple(words[:k] + ["#"] + words[k + 1 :])), {}).setdefault(int(word), name)
    found = []
    for (how, stem), members in groups.items():
        first = min(members)
        if how == "numbered" and (first not in (0, 1) or not all(first + k in members for k in range(robot.dof))):
            continue
        if how == "numbered" and len(members) > robot.dof and not (len(members) <= robot.dof + 2 or topic):
            continue
        if how == "named" and len(members) < robot.dof:
            continue
        start = first if how == "numbered" else 0
        names = [members[start + k] for k in range(robot.dof)]
        if role := _role([*tokens(topic), *stem]):
            rank = 10 * (how == "named") + next((len(_BEST) - k for k, word in enumerate(_BEST) if word in f"{topic}.{names[0]}".lower()), 0)
            found.append((role, rank - len(stem), names, lambda names=names: np.stack([columns[one] for one in names], 1)))
    return found


def _role(words):
    """The role of a group of joint columns by the words around the joint's name, `None` for another quantity."""
    known = set(words)
    if known & (_NO | _CARTESIAN):
        return None
    command = "_cmd" if known & _COMMAND and not known & {"feedback", "actual", "measured"} else ""
    if known & _VELOCITY:
        return f"qdot{command}"
    if known & _TORQUE:
        return f"tau{command}" if known & _COMMAND or "state" in known or known & {"actual", "measured", "joint"} or len(words) < 3 else "tau"
    if known & _POSITION:
        return f"q{command}"
    rest = known - _COMMAND - {"observation", "state", "states", "joint", "joints", "j", "axis", "a", "*", "#", "data", "actual", "arm", "robot", "feedback"}
    return f"q{command}" if len(rest) < 2 else None


def _hand_groups(topic, columns):
    """Twists and poses of the hand: six or seven columns each."""
    found, groups = [], {}
    for name in columns:
        words = tokens(name)
        if words and words[-1] in ("x", "y", "z", "w", "vx", "vy", "vz", "wx", "wy", "wz", "qx", "qy", "qz", "qw", "rx", "ry", "rz"):
            kind = "l" if "linear" in words else "a" if "angular" in words else "q" if "orientation" in words else "p" if "position" in words else ""
            stem = tuple(one for one in words[:-1] if one not in ("linear", "angular", "orientation", "position"))
            groups.setdefault(stem, {})[kind + words[-1]] = name
        if match := re.fullmatch(r"(.*?)[\[_.]?(\d+)\]?", name):
            groups.setdefault(tuple(tokens(match.group(1))), {})[f"#{int(match.group(2))}"] = name
    for stem, members in groups.items():
        words = {*tokens(topic), *stem}
        if words & {"wrench", "force", "error", "imu", "torque", "camera", "odom"} or _NO & words:
            continue
        command = bool(words & _COMMAND)
        pick = lambda *names: [members[one] for one in names] if all(one in members for one in names) else None
        twist = pick("lx", "ly", "lz", "ax", "ay", "az") or pick("vx", "vy", "vz", "wx", "wy", "wz")
        six = pick(*(f"#{k}" for k in range(6)))
        six = six if six and len(members) == 6 and words & _CARTESIAN else None
        if six and (words & _VELOCITY or "twist" in words or "v" in words or "dp" in words):
            twist = six
        if twist and (command or "delta" in words):
            found.append(("twist_cmd", 0, twist, lambda names=twist: np.stack([columns[one] for one in names], 1)))
        place = pick("px", "py", "pz") or pick("x", "y", "z")
        turn = pick("qx", "qy", "qz", "qw") or pick("qqx", "qqy", "qqz", "qqw")
        names = place and [*place, *(turn or pick("rx", "ry", "rz") or [])] or (six if "pose" in words else None)
        if names and len(names) in (3, 6, 7) and (len(names) > 3 or words & _CARTESIAN):
            found.append(("pose_cmd" if command else "pose", len(names), names, lambda names=names: _poses(np.stack([columns[one] for one in names], 1))))
    if "r_be_d[8]" in columns and "p_be_d[2]" in columns:
        names = [*(f"p_be_d[{k}]" for k in range(3)), *(f"r_be_d[{k}]" for k in range(9))]
        found.append(("pose_cmd", 20, names, lambda: _poses(np.stack([columns[one] for one in names], 1))))
    return found


def _poses(rows):
    """Poses (N, 4, 4) of rows `x y z`, with a rotation vector, a quaternion `x y z w` or a matrix by columns behind; a NaN stays one."""
    pose = np.tile(np.eye(4), (len(rows), 1, 1))
    pose[:, :3, 3] = rows[:, :3]
    if rows.shape[1] == 12:
        pose[:, :3, :3] = rows[:, 3:].reshape(-1, 3, 3).transpose(0, 2, 1)
    elif rows.shape[1] > 3:
        make = rotation_exp if rows.shape[1] == 6 else lambda x: rotation_of(np.r_[x[3], x[:3]])
        for k, row in enumerate(rows[:, 3:]):
            pose[k, :3, :3] = make(row) if np.isfinite(row).all() else np.nan
    return pose


def _mapped(role, names, columns, t, robot):
    """The stream of a `--map`; raises where it has another number of columns than its role."""
    needed = {"twist_cmd": (6,), "pose": (3, 6, 7), "pose_cmd": (3, 6, 7)}.get(role, (robot.dof,))
    if len(names) not in needed:
        raise LogError(f"--map {role} names {len(names)} columns: it needs {' or '.join(map(str, needed))}, in the order of {', '.join(robot.joints)}")
    x = np.stack([columns[one] for one in names], 1)
    return Stream(t, _poses(x) if role.startswith("pose") else x, ", ".join(names))


def _units(log, robot):
    """Degrees to radians, by the size of positions and by velocities as derivatives of positions."""
    turns = robot.turns
    q = log["q"]
    for role in ("q", "q_cmd"):
        if (stream := log[role]) is None or (role == "q_cmd" and stream is q):
            continue
        x = stream.x[:, turns]
        largest = np.nanmax(np.abs(x)) if np.isfinite(x).any() else 0
        inside = lambda y: np.mean((y > robot.lower[turns] - 0.1) & (y < robot.upper[turns] + 0.1))
        degrees = largest > 10 or (largest > 2 * np.pi + 0.1 and inside(np.radians(x)) > inside(x) + 0.2)
        if not degrees and role == "q_cmd":
            degrees = np.nanmedian(np.abs(x)) > 20 * np.nanmedian(np.abs(q.x[:, turns])) + 0.1
        if degrees and np.nanmax(np.abs(x)) < 3000:
            stream.x = np.where(turns, np.radians(stream.x), stream.x)
            log.notes.append(f"{'Positions' if role == 'q' else 'Commanded positions'} are in degrees: the largest is {largest:.0f}.")
    for role, base in (("qdot", "q"), ("qdot_cmd", "q")):
        if (stream := log[role]) is None or len(q.t) < 10:
            continue
        v = np.gradient(log[base].x[:, turns], axis=0) / np.maximum(np.gradient(q.t), 1e-9)[:, None]
        mine = np.nanquantile(np.abs(stream.x[:, turns]), 0.95)
        other = np.nanquantile(np.abs(v), 0.95)
        if other > 1e-3 and 25 < mine / other < 130:
            stream.x = np.where(turns, np.radians(stream.x), stream.x)
            log.notes.append(f"{'Velocities' if role == 'qdot' else 'Commanded velocities'} are in degrees per second: they are {mine / other:.0f} times the positions' slope.")


def _clean(log):
    """One clock that starts at zero; rows whose stamps are not finite left out; an action that is no position left out."""
    begins = [np.nanmin(stream.t) for stream in log.streams.values() if np.isfinite(stream.t).any()]
    log.start = min(begins)
    for role, stream in list(log.streams.items()):
        known = np.isfinite(stream.t)
        if not known.any():
            raise LogError(f"{log.name}: the time stamps of {stream.name} are no numbers; name others by --map t=COLUMN")
        stream.t, stream.x = stream.t[known] - log.start, stream.x[known]
    q, cmd = log["q"], log["q_cmd"]
    if cmd is not None and cmd is not q:
        held = hold(cmd, q.t)
        off = np.nanmedian(np.abs(held - q.x), axis=0)
        reach = np.nanmax(q.x, axis=0) - np.nanmin(q.x, axis=0) + 0.3
        if np.median(off / reach) > 1:
            del log.streams["q_cmd"]
            log.notes.append(f"The columns {cmd.name} are no joint positions in the arm's units, and were left out.")


def hold(stream, t):
    """A stream's newest values at the times `t`; its first before it begins."""
    at = np.clip(np.searchsorted(stream.t, t + 1e-9, side="right") - 1, 0, len(stream.t) - 1)
    return stream.x[at]
