"""One page about an incident: joint speeds, the hand's speed asked and actual, and the distance from singularities."""

import numpy as np

from ..experiments.style import BLUE, GREY, RED, curves, page


def draw(path, answer, m):
    """Saves the picture of the seconds around the incident; the ending of `path` (png, svg, pdf) is its format."""
    path = str(path)
    stem, dot, ending = path.rpartition(".")
    if not dot or ending not in ("png", "svg", "pdf"):
        raise ValueError(f"{path} is no picture's name: end it with .png, .svg or .pdf")
    at = answer["evidence"][0]["t"]
    t = m.t[m.rows]
    near = (t > at - 2) & (t < at + 2) if answer["cause"] not in ("none", "another robot") else np.ones(len(t), bool)
    near = near if near.sum() > 5 else np.ones(len(t), bool)
    t, rows = t[near], m.rows[near]
    limits = m.robot.velocity
    share = np.where(np.isfinite(limits), 100 / limits, 100 / max(np.abs(m.v).max(), 1e-6))
    notes = [answer["evidence"][0]["text"][:300]]
    with page(stem, f"{answer['log']}: {answer['what']}, {answer['cause']}", f"{answer['robot']}, {answer['rate_hz']:g} Hz", notes, [(2.2, 1), (1.8, 2)], files=(ending,)) as ((top,), (hand, lost)):
        curves(top, "joint speed, % of its limit" if np.isfinite(limits).all() else "joint speed, % of the largest", t, *((name, m.v[rows, j] * share[j]) for j, name in enumerate(m.robot.joints)))
        scale = m.robot.scale
        lines = [("actual", np.linalg.norm(m.V[near] * scale, axis=1), BLUE)]
        if m.asked is not None:
            lines.insert(0, (f"asked ({m.asked_by})", np.linalg.norm(m.asked[near] * scale, axis=1), GREY))
        curves(hand, f"hand speed, rad/s ({m.robot.length:.2f} m count as 1 rad)", t, *lines)
        lines = [("smallest singular value, % of usual", 100 * m.sigma[near] / m.usual, BLUE)]
        if m.asked is not None:
            S = m.asked[near] * scale
            lines.append(("asked motion along ζ, %", 100 * np.abs(np.einsum("ki,ki->k", m.u[near], S)) / np.maximum(np.linalg.norm(S, axis=1), 1e-9), GREY))
        curves(lost, "singularity", t, *lines).set_ylim(bottom=0)
        for axes in (top, hand, lost):
            axes.axvline(at, color=RED, lw=1)
