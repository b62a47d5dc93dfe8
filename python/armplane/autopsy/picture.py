"""One page about an incident: joint speeds, the hand's speed asked and actual, and the distance from singularities."""

import numpy as np

from ..experiments.style import BLUE, GREY, RED, curves, page
from .motion import norm


def draw(path, answer, m):
    """Saves the picture of the seconds around the incident."""
    first, t, robot = answer["evidence"][0], m.t_k, m.robot
    near = np.abs(t - first["t"]) < (2 if answer["cause"] not in ("none", "another robot") else np.inf)
    near = near if near.sum() > 5 else np.ones(len(t), bool)
    most = np.where(np.isfinite(robot.velocity), robot.velocity, max(np.abs(m.v).max(), 1e-6))
    panels = {
        f"joint speed, % of {'its limit' if np.isfinite(robot.velocity).all() else 'the largest'}": [*zip(robot.joints, 100 * (m.v_k / most).T)],
        f"hand speed, rad/s ({robot.length:.2f} m count as 1 rad)": [("actual", norm(m.W), BLUE)],
        "singularity": [("smallest singular value, % of usual", 100 * m.sigma / m.usual, BLUE)],
    }
    if m.S is not None:
        _, hand, lost = panels.values()
        hand.insert(0, (f"asked ({m.asked_by})", norm(m.S), GREY))
        lost.append(("asked motion along ζ, %", 100 * np.abs(np.sum(m.u * m.S, axis=1)) / np.maximum(norm(m.S), 1e-9), GREY))
    title, subtitle = f"{answer['log']}: {answer['what']}, {answer['cause']}", f"{answer['robot']}, {answer['rate_hz']:g} Hz"
    with page(path, title, subtitle, [first["text"][:300]], [(2.2, 1), (1.8, 2)]) as rows:
        for axes, (heading, lines) in zip(np.concatenate(rows), panels.items()):
            curves(axes, heading, t[near], *((name, values[near], *colour) for name, values, *colour in lines)).axvline(first["t"], color=RED, lw=1)
        axes.set_ylim(bottom=0)
