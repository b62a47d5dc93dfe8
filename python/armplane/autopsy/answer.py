"""The answer about one log."""

import json

import numpy as np

from .causes import find
from .columns import Log, Stream, choose
from .logs import LogError, read
from .motion import motion_of
from .robot import Robot

# Rows that are looked at together; a longer log is taken in pieces that overlap, and the clearest one counts.
PIECE, OVERLAP = 120_000, 1000
# How the first sentence goes on after the cause's time.
_REASONS = {"none": "", "another robot": "", "unknown": ", for a reason that the log does not tell", "singularity": ", because of a singularity"}
_WHAT = {"none": "nothing happened", "another robot": "the log does not fit the robot"}


def autopsy(path, robot, tip=None, mapping=None, episode=None, picture=None):
    """The answer about one log, as a dictionary: `cause` (one of `CAUSES`), `t` (s from the log's first stamp), `what`, `text` (a paragraph), `evidence`, …

    `robot`: a `Robot`, a built-in name, the path of a URDF or MJCF file, or `None` for the one in the log. `mapping`: {role of `ROLES`: [columns]}.
    `picture`: where to save one. Raises `LogError` or ValueError with one sentence where the log or the robot cannot be read.
    """
    source = read(path, episode)
    if robot is None and source.urdf is None:
        raise LogError(f"{source.name} holds no /robot_description: name the arm by --robot")
    if not isinstance(robot, Robot):
        robot = Robot(robot, tip) if robot else Robot("the log's robot", tip or source.tip, source.urdf, source.description)
    if source.dof not in (None, robot.dof):
        raise LogError(f"{source.name} has {source.dof} joints, the arm {robot.name} has {robot.dof}: leave out --robot, or name the arm of the log")
    log, found = choose(source, robot, mapping or {}), []
    # A long log's columns are in memory once.
    source.tables.clear()
    for piece in _pieces(log):
        m = motion_of(piece, robot)
        found.append((m, *find(m)))
    m, seen, ranked = max(found, key=lambda one: (one[2][0].what != "none", one[2][0].weight))
    answer = _answer(source, log, m, seen, ranked)
    others = [{"t": round(float(first.t), 4), "cause": first.what} for _, _, (first, *_) in found if first.what != "none" and first is not ranked[0]]
    answer["others"] = others[:20]
    if picture is not None:
        from .picture import draw

        draw(picture, answer, m)
    return answer


def _pieces(log):
    t = log["q"].t
    for k in range(0, max(len(t) - OVERLAP, 1), PIECE):
        low, high = t[k], t[min(k + PIECE + OVERLAP, len(t)) - 1]
        cut = {role: Stream(one.t[inside], one.x[inside], one.name) for role, one in log.streams.items() if (inside := (one.t >= low) & (one.t <= high)).sum() > 10}
        yield Log(log.name, cut, log.notes, log.start) if len(t) > PIECE else log


def _answer(source, log, m, seen, ranked):
    robot, first, notes = m.robot, ranked[0], [*m.robot.notes, *log.notes, *m.notes]
    effect = next((one for one in seen if one.t >= first.t - 0.3), seen[0] if seen else None)
    what, near = _WHAT.get(first.what) or (effect.what if effect else "it went on"), m.sigma / m.usual
    when = "" if first.what in _WHAT else f" at {first.t:.2f} s"
    reason = _REASONS.get(first.what, f": {'not a singularity, but ' if near.min() < 0.3 else ''}{first.what}")
    sentences = [f"{source.name}: {what}{when}{reason}"] + [text[:1].upper() + text[1:] for text in dict.fromkeys(one.text for one in (effect, first) if one)]
    if first.what not in ("singularity", *_WHAT):
        at = np.argmin(np.abs(m.t_k - first.t))
        is_near = "It was near a singularity, but nothing shows that this was the cause" if near[at] < 0.3 else "No singularity"
        sentences.append(f"{is_near}: then, the smallest singular value was {near[at]:.0%} of this arm's usual one")
    if len(ranked) > 1 and ranked[1].weight > 0.6:
        sentences.append(f"Also: {ranked[1].text}")
    rate, seconds, columns = 1 / m.dt, log["q"].t[-1], {role: one.name for role, one in log.streams.items()}
    read_as = ", ".join(f"{role} ({name})" for role, name in columns.items())
    sentences += [*dict.fromkeys(note for note in notes if note != first.text), f"Read: {read_as}; {rate:.0f} Hz, {seconds:.1f} s"]
    text = " ".join(one if one.endswith((".", "?")) else f"{one}." for one in sentences)
    evidence = [{"cause": one.what, "t": round(one.t, 4), "weight": round(one.weight, 3), "text": one.text, **one.data} for one in ranked]
    answer = {
        "log": source.name, "robot": robot.name, "cause": first.what, "what": what, "t": round(first.t, 4), "text": text,
        "evidence": evidence, "effects": [{"what": one.what, "t": round(one.t, 4), "text": one.text} for one in seen], "notes": notes,
        "rate_hz": round(rate, 2), "seconds": round(seconds, 3), "start": log.start, "columns": columns,
    }  # fmt: skip
    # Without the numbers and arrays of numpy.
    return json.loads(json.dumps(answer, default=lambda value: value.tolist()))
