"""The panel beside the picture: the reason in words, |s| against η, joints against limits."""

import html
import json
import pathlib

import numpy as np

from .. import wire
from .scene import name_of

# The deed of the law inside a neighbourhood, by mode.
DOES = {
    wire.MODE_BLEND: "motion along ζ is faded out",
    wire.MODE_TRACK: "joints turn without moving the hand, until it can follow",
    wire.MODE_PASS: "passes straight through, ζ off the way",
    wire.MODE_HOLD: "ζ is held",
    wire.MODE_REORIENT: "ζ is turned first",
    wire.MODE_SLIDE: "slides along the boundary of reach",
    wire.MODE_RECOVER: "outside again, the posture settles",
}
# A share of a joint's limit from which on it counts as reached.
AT_LIMIT = 0.999
GOOD, SLOW, STOP, GREY = "#3ecf8e", "#f5b942", "#ff5c5c", "#8a94a6"
PLAIN, RIVAL, INSIDE, OUTSIDE = "#5aa9ff", "#ffa048", "#ff42c8", "#a88bd8"
COLOURS = {
    wire.REASON_FOLLOWING: GOOD,
    wire.REASON_RESTING: GREY,
    wire.REASON_OVER: GREY,
    wire.REASON_STOPPED: STOP,
    wire.REASON_HELD: STOP,
}
STYLE = f"<style>{pathlib.Path(__file__).with_suffix('.css').read_text()}</style>"


def _bar(share, colour, mark=None, kind="bar"):
    line = f'<b style="left:{100 * mark:.1f}%"></b>' if mark is not None else ""
    width = 100 * min(max(share, 0), 1)
    return f'<div class="{kind}"><i style="width:{width:.1f}%;background:{colour}"></i>{line}</div>'


def _gap(seen, ball):
    """From hand to ball, m."""
    return float(np.linalg.norm(np.subtract(seen["plant_state"].p_BE, ball)))


def _cannot(seen, ball):
    """Whether the hand stands and the ball is beyond what the arm reaches."""
    servo = seen["servo_state"]
    ends = servo.reason in (wire.REASON_REACH, wire.REASON_LIMIT) and servo.speed_scale < 0.02
    return ends and _gap(seen, ball) > 0.01


def reason(robot, seen, ball):
    """Why the hand moves as it does, and what the law does about the nearest singularity."""
    servo, plant = seen["servo_state"], seen["plant_state"]
    text, details = wire.REASONS.get(servo.reason, "unknown"), []
    if servo.joint:
        side = f", {'upper' if servo.upper else 'lower'} side"
        text += f" (joint {servo.joint}{side if servo.reason == wire.REASON_LIMIT else ''})"
    if servo.singularity and servo.nearest < 1:
        place = servo.singularity - 1
        kind = wire.TYPES.get(seen["singularity"].singularities[place].class_, "")
        does = DOES.get(seen["control_state"].mode[place])
        details.append(f"near {name_of(robot, place)}, {kind}{f': {does}' if does else ''}")
    is_slowed = servo.reason not in (wire.REASON_FOLLOWING, wire.REASON_RESTING)
    if _cannot(seen, ball):
        end = f"joint {servo.joint} is at its limit" if servo.joint else "the arm stretches to it"
        text = f"out of reach: {end}"
        details.append(f"{100 * _gap(seen, ball):.0f} cm short of the ball")
    elif is_slowed and servo.speed_scale < 0.97 and max(map(abs, servo.V_target)) > 0.005:
        details.append(f"{100 * servo.speed_scale:.0f}\u00a0% of the speed asked for")
    if plant.drive:
        details.append(f"the drives: {wire.DRIVES.get(plant.drive)}")
    return text, "; ".join(details)


def _measures(robot, report):
    for place, one in enumerate(report.singularities[: report.count]):
        bar = _bar(abs(one.s) / one.eta_out / 5, INSIDE if one.inside else OUTSIDE, mark=0.2)
        kind, name = wire.TYPES.get(one.class_, ""), name_of(robot, place)
        number = f'<span class="num">{abs(one.s):.3f}</span>'
        yield f'<div class="row" title="{kind}"><span>{name}</span>{bar}{number}</div>'


def _joints(robot, seen, ghost):
    """Speeds and torques as shares of their limits; thin below: the ghost's."""

    def shares(state):
        n, arm = robot.dof, robot.arm
        return np.abs([state.qdot[:n] / arm.velocity, state.tau[:n] / arm.effort]).T

    ours = shares(seen["plant_state"])
    theirs = ghost and shares(ghost.seen["plant_state"])
    for i, joint in enumerate(ours):
        cells = [_bar(x, STOP if x > 1 else SLOW if x > 0.85 else PLAIN) for x in joint]
        for k in range(2 if ghost else 0):
            colour = STOP if ghost.peaks[k, i] >= AT_LIMIT else RIVAL
            cells[k] += _bar(theirs[i, k], colour, kind="bar thin")
        yield f'<div class="row two"><span>{i + 1}</span>' + "".join(
            f"<div>{cell}</div>" for cell in cells
        ) + "</div>"


def _race(seen, ghost, ball):
    speed, torque = 100 * ghost.peaks.max(axis=1)
    alarm = f'style="color:{STOP}"' if ghost.peaks.max() >= AT_LIMIT else ""
    text = f"largest speed {speed:.0f} %, torque {torque:.0f} % of the limit"
    ours, theirs = (f"{100 * _gap(one, ball):.0f} cm" for one in (seen, ghost.seen))
    gaps = f"To the ball: this arm {ours}, the other {theirs}."
    gaps += " Out of reach: the nearer one has not won." if _cannot(seen, ball) else ""
    return f"<h3>Race. {gaps}</h3><span {alarm}>{html.escape(ghost.law)}: {text}</span>"


def page(robot, seen, ghost, ball, story, foot, state):
    """The panel. `ghost`: its session, or `None`; `ball`: where it is, m; `story`: what happened
    last; `state`: for programs that look at the page."""
    text, detail = map(html.escape, reason(robot, seen, ball))
    colour = COLOURS.get(seen["servo_state"].reason, SLOW)
    return (
        f'<div class="ap" data-state="{html.escape(json.dumps(state))}"><div class="say" style="border-color:{colour}">{text}'
        f"<small>{detail or '&nbsp;'}</small></div><h3>Distance to each singularity, where the hand loses a direction. Left of the line, the law takes over.</h3>"
        f"{''.join(_measures(robot, seen['singularity']))}<h3>Joints: speed (left) and torque (right), as shares of their limits</h3>"
        f"{''.join(_joints(robot, seen, ghost))}{_race(seen, ghost, ball) if ghost else ''}<h3>Messages</h3><div class=\"log\">{html.escape(story)}</div>"
        f'<div class="foot">{foot}</div></div>'
    )
