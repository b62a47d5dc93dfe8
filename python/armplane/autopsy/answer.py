"""The answer about one log."""

import numpy as np

from .causes import CAUSES, find
from .columns import ROLES, Log, Stream, choose
from .logs import LogError, read
from .motion import motion_of
from .robot import Robot

# Rows that are looked at together; a longer log is taken in pieces, and the clearest one counts.
PIECE = 120_000


def autopsy(path, robot, tip=None, mapping=None, episode=None, picture=None):
    """The answer about one log, as a dictionary: `cause` (one of `CAUSES`), `t` (s from the log's first stamp), `what`, `text` (a paragraph), `evidence`, …

    `robot`: a `Robot`, a built-in name, the path of a URDF or MJCF file, or `None` for the one in the log. `mapping`: {role of `ROLES`: [columns]}.
    `picture`: where to save one. Raises `LogError` or ValueError with one sentence where the log or the robot cannot be read.
    """
    source = read(path, episode)
    if robot is None and source.urdf is None:
        raise LogError(f"{source.name} holds no /robot_description: name the arm by --robot")
    robot = robot if isinstance(robot, Robot) else Robot("the log's robot" if robot is None else robot, tip, source.urdf if robot is None else None)
    log = choose(source, robot, mapping)
    best, others = None, []
    for piece in _pieces(log):
        m = motion_of(piece, robot)
        seen, found = find(piece, m)
        worth = (found[0].cause != "none", found[0].weight)
        if found[0].cause != "none":
            others.append({"t": round(found[0].t, 4), "cause": found[0].cause})
        if best is None or worth > best[0]:
            best = (worth, m, seen, found, piece)
    _, m, seen, found, piece = best
    answer = _answer(source, log, robot, m, seen, found)
    answer["others"] = [one for one in others if one["t"] != answer["evidence"][0]["t"]][:20]
    if picture is not None:
        from .picture import draw

        draw(picture, answer, m)
    return answer


def _pieces(log):
    t = log["q"].t
    if len(t) <= PIECE:
        yield log
        return
    for k in range(0, len(t) - 1000, PIECE):
        low, high = t[k], t[min(k + PIECE + 1000, len(t) - 1)]
        cut = {role: Stream(one.t[keep], one.x[keep], one.name) for role, one in log.streams.items() if (keep := (one.t >= low) & (one.t <= high)).sum() > 10}
        if "q" in cut:
            yield Log(log.name, cut, log.notes, log.start)


def _answer(source, log, robot, m, seen, found):
    first, effect = found[0], next((one for one in seen if one.t >= found[0].t - 0.3), seen[0] if seen else None)
    rate, seconds = 1 / m.dt, float(log["q"].t[-1])
    what = {"none": "nothing happened", "another robot": "the log does not fit the robot"}.get(first.cause) or (effect.what if effect else "it went on")
    head = f"{source.name}: {what}" + (f" at {first.t:.2f} s" if first.cause not in ("none", "another robot") else "")
    reason = {"none": "", "another robot": "", "unknown": ", for a reason that the log does not tell", "singularity": ", because of a singularity"}
    sentences = [head + reason.get(first.cause, f": {'not a singularity, but ' if m.sigma.min() < 0.3 * m.usual else ''}{first.cause}") + "."]
    sentences += [_sentence(one.text) for one in [effect] if one and one.text != first.text] + [_sentence(first.text)]
    if first.cause not in ("singularity", "none", "another robot"):
        at = int(np.argmin(np.abs(m.t[m.rows] - first.t)))
        sentences.append(f"No singularity: then, the smallest singular value was {m.sigma[at] / m.usual:.0%} of this arm's usual one.")
    if len(found) > 1 and found[1].weight > 0.6:
        sentences.append(f"Also: {found[1].text}.")
    sentences += [*robot.notes, *log.notes, *m.notes]
    sentences.append(f"Read: {', '.join(f'{role} ({one.name})' for role, one in log.streams.items())}; {rate:.0f} Hz, {seconds:.1f} s.")
    evidence = [{"cause": one.cause, "t": round(one.t, 4), "weight": round(one.weight, 3), "text": one.text, **one.data} for one in found]
    return {
        "log": source.name, "robot": robot.name, "cause": first.cause, "what": what, "t": round(first.t, 4), "text": " ".join(sentences),
        "evidence": evidence, "effects": [{"what": one.what, "t": round(one.t, 4), "text": one.text} for one in seen], "notes": [*robot.notes, *log.notes, *m.notes],
        "rate_hz": round(rate, 2), "seconds": round(seconds, 3), "start": log.start, "columns": {role: one.name for role, one in log.streams.items()},
    }  # fmt: skip


def _sentence(text):
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", "?")) else ".")
