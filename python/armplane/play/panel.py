"""What the page says beside the picture, as HTML: the reason in words, |s| against η, speeds and torques against their limits."""

import html

import numpy as np

from .. import wire
from .scene import name_of

# The deed of the law inside a neighbourhood, by mode.
DOES = {
    wire.MODE_BLEND: "motion along ζ is faded out",
    wire.MODE_TRACK: "the joints move in the null space, so that the hand can follow",
    wire.MODE_PASS: "passes straight through, ζ off the way",
    wire.MODE_HOLD: "ζ is held",
    wire.MODE_REORIENT: "ζ is turned first",
    wire.MODE_SLIDE: "slides along the boundary of reach",
    wire.MODE_RECOVER: "outside again, the posture settles",
}
# A share of a joint's limit from which on it counts as reached.
AT_LIMIT = 0.999
GOOD, SLOW, STOP = "#3ecf8e", "#f5b942", "#ff5c5c"
COLOURS = {wire.REASON_FOLLOWING: GOOD, wire.REASON_RESTING: "#8a94a6", wire.REASON_OVER: "#8a94a6", wire.REASON_STOPPED: STOP, wire.REASON_HELD: STOP}
STYLE = """<style>
.ap{font:13px/1.45 system-ui,sans-serif;padding:2px 14px 8px}.ap h3{margin:10px 0 4px;font-size:11.5px;font-weight:600;opacity:.6}
.ap .say{border-left:4px solid;padding:6px 10px;border-radius:4px;background:rgba(128,140,160,.13);font-size:15px;min-height:44px}.ap .say small{display:block;opacity:.75;font-size:12px}
.ap .row{display:grid;grid-template-columns:74px 1fr 48px;gap:8px;align-items:center;height:19px}.ap .two{grid-template-columns:22px 1fr 1fr}
.ap .bar{position:relative;height:9px;border-radius:5px;background:rgba(128,140,160,.22);overflow:hidden}.ap .bar i{position:absolute;left:0;top:0;bottom:0;border-radius:5px}
.ap .bar.thin{height:4px;margin-top:2px}.ap .bar b{position:absolute;top:0;bottom:0;width:2px;background:#ff42c8}.ap .num{text-align:right;font-variant-numeric:tabular-nums;opacity:.8}
.ap .log{font-size:12px;opacity:.8;white-space:pre-wrap;overflow-wrap:anywhere}.ap .foot{font-size:11px;opacity:.55;margin-top:8px}
@media (max-width:36em){[style*="width: 20em"]{width:100vw!important;max-height:45vh!important}[style*="width: 20em"] [style*="width: 20em"]{max-height:none!important}}</style>"""


def _bar(share, colour, mark=None, thin=False):
    line = f'<b style="left:{100 * mark:.1f}%"></b>' if mark is not None else ""
    return f'<div class="bar{" thin" if thin else ""}"><i style="width:{100 * min(max(share, 0.0), 1.0):.1f}%;background:{colour}"></i>{line}</div>'


def reason(robot, seen):
    """Why the hand moves as it does: a sentence, and what the law does about the nearest singularity."""
    servo, report, control = seen["servo_state"], seen["singularity"], seen["control_state"]
    text = wire.REASONS.get(servo.reason, "unknown")
    if servo.joint:
        text += f" (joint {servo.joint}" + (f", {'upper' if servo.upper else 'lower'} side)" if servo.reason == wire.REASON_LIMIT else ")")
    details = []
    if servo.singularity and servo.nearest < 1.0:
        place = servo.singularity - 1
        words = [name_of(robot, place), wire.TYPES.get(report.singularities[place].class_, "")]
        does = DOES.get(control.mode[place])
        details.append("near " + ", ".join(words) + (f": {does}" if does else ""))
    if servo.reason not in (wire.REASON_FOLLOWING, wire.REASON_RESTING) and servo.speed_scale < 0.97 and max(map(abs, servo.V_target)) > 0.005:
        details.append(f"{100 * servo.speed_scale:.0f} % of the speed asked for")
    if seen["plant_state"].drive:
        details.append(f"the drives: {wire.DRIVES.get(seen['plant_state'].drive)}")
    return text, "; ".join(details)


def _measures(robot, report):
    rows = []
    for place, one in enumerate(report.singularities[: report.count]):
        full = 5 * one.eta_out
        colour = "#ff42c8" if one.inside else "#a88bd8"
        bar = _bar(abs(one.s) / full, colour, mark=one.eta_out / full)
        rows.append(f'<div class="row" title="{wire.TYPES.get(one.class_, "")}"><span>{name_of(robot, place)}</span>{bar}<span class="num">{abs(one.s):.3f}</span></div>')
    return "".join(rows)


def _joints(robot, seen, ghost):
    """Speeds and torques as shares of their limits; thin below: the ghost's."""
    rows, n = [], robot.dof
    shares = lambda state: np.abs([state.qdot[:n] / robot.arm.velocity, state.tau[:n] / robot.arm.effort])
    ours, theirs = shares(seen["plant_state"]), ghost and shares(ghost.seen["plant_state"])
    for i in range(n):
        cells = [_bar(one[i], STOP if one[i] > 1.0 else SLOW if one[i] > 0.85 else "#5aa9ff") for one in ours]
        if ghost:
            cells = [cell + _bar(one[i], STOP if peak[i] >= AT_LIMIT else "#ffa048", thin=True) for cell, one, peak in zip(cells, theirs, ghost.peaks)]
        rows.append(f'<div class="row two"><span>{i + 1}</span><div>{cells[0]}</div><div>{cells[1]}</div></div>')
    return "".join(rows)


def _race(ghost):
    speed, torque = ghost.peaks.max(axis=1)
    alarm = f'style="color:{STOP}"' if max(speed, torque) >= AT_LIMIT else ""
    return f"<h3>Race</h3><span {alarm}>{html.escape(ghost.law)}: largest speed {100 * speed:.0f} %, torque {100 * torque:.0f} % of the limit</span>"


def page(robot, seen, ghost, story, foot):
    """The panel. `ghost`: its session, or `None`; `story`: what happened last; `foot`: who steers."""
    text, detail = map(html.escape, reason(robot, seen))
    return (
        f'{STYLE}<div class="ap"><div class="say" style="border-color:{COLOURS.get(seen["servo_state"].reason, SLOW)}">{text}<small>{detail or "&nbsp;"}</small></div>'
        f"<h3>|s| of each singularity; line: η, where the law begins</h3>{_measures(robot, seen['singularity'])}"
        f"<h3>Joints: speed (left) and torque (right), as shares of their limits</h3>{_joints(robot, seen, ghost)}{_race(ghost) if ghost else ''}"
        f'<h3>What happened</h3><div class="log">{html.escape(story)}</div><div class="foot">{foot}</div></div>'
    )
