"""One page about an incident: joint speeds, the hand's speed asked and actual, and the distance from singularities."""

import numpy as np

from ..experiments.style import BLUE, GREY, RED, curves, page
from .motion import norm


def draw(path, answer, m):
    """Saves the picture of the seconds around the incident; the ending of `path` (png, svg, pdf) is its format."""
    stem, _, ending = str(path).rpartition(".")
    if ending not in ("png", "svg", "pdf"):
        raise ValueError(f"{path} is no picture's name: end it with .png, .svg or .pdf")
    first, t, robot = answer["evidence"][0], m.t_k, m.robot
    near = np.abs(t - first["t"]) < (2 if answer["cause"] not in ("none", "another robot") else np.inf)
    near = near if near.sum() > 5 else np.ones(len(t), bool)
    t, v = t[near], m.v_k[near]
    most = np.where(np.isfinite(robot.velocity), robot.velocity, max(np.abs(m.v).max(), 1e-6))
    speeds, losses = [("actual", norm(m.W[near]), BLUE)], [("smallest singular value, % of usual", 100 * m.sigma[near] / m.usual, BLUE)]
    if m.S is not None:
        S = m.S[near]
        speeds.insert(0, (f"asked ({m.asked_by})", norm(S), GREY))
        losses.append(("asked motion along ζ, %", 100 * np.abs(np.sum(m.u[near] * S, axis=1)) / np.maximum(norm(S), 1e-9), GREY))
    title, subtitle = f"{answer['log']}: {answer['what']}, {answer['cause']}", f"{answer['robot']}, {answer['rate_hz']:g} Hz"
    with page(stem, title, subtitle, [first["text"][:300]], [(2.2, 1), (1.8, 2)], files=(ending,)) as ((top,), (hand, lost)):
        heading = f"joint speed, % of {'its limit' if np.isfinite(robot.velocity).all() else 'the largest'}"
        curves(top, heading, t, *((name, 100 * speed) for name, speed in zip(robot.joints, (v / most).T)))
        curves(hand, f"hand speed, rad/s ({robot.length:.2f} m count as 1 rad)", t, *speeds)
        curves(lost, "singularity", t, *losses).set_ylim(bottom=0)
        for axes in (top, hand, lost):
            axes.axvline(first["t"], color=RED, lw=1)
