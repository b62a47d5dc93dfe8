"""A controller of three links in a plane, which follows its path, or says in one of several ways that it has. The argument says how."""
import math, sys
import armplane
from armplane import wire

HOW, LINKS, BY, LASTS, SETTLE = sys.argv[1], (0.4, 0.3, 0.2), (0.03, -0.04), 0.4, 0.1

def tip(q):
    angles = [sum(q[: i + 1]) for i in range(3)]
    return angles, [sum(l * f(a) for l, a in zip(LINKS, angles)) for f in (math.cos, math.sin)]

class Follower(armplane.Controller):
    def setup(self):
        start = [math.radians(a) for a in self.job["scenario"]["start"]["q_deg"]]
        self.start = tip(start)[1]

    def clock(self, t):
        if HOW == "jumps" and t > 0.003:
            return LASTS
        if HOW == "goes back" and t > 0.2:
            return min(t - 0.1, LASTS)
        if HOW == "no number" and t > 0.1:
            return float("nan")
        if HOW in ("is stuck", "waits for ever"):
            return min(t, 0.19)
        return min(t, LASTS)

    def control(self, tick, estimate, singularity, state, torque):
        t, q, v = tick * self.dt, estimate.q[:3], estimate.qdot[:3]
        angles, place = tip(q)
        u = min(self.clock(t) / LASTS, 1.0) if HOW in ("follows", "does not settle", "is stuck", "waits for ever") else 0.0
        share, rate = u**3 * (10 - 15 * u + 6 * u * u), 30 * u * u * (1 - u) ** 2 / LASTS
        desired = [p + share * by for p, by in zip(self.start, BY)]
        # J has the columns [-sum of l*sin, sum of l*cos] of the links from each joint on.
        columns = [
            (-sum(l * math.sin(a) for l, a in zip(LINKS[i:], angles[i:])), sum(l * math.cos(a) for l, a in zip(LINKS[i:], angles[i:])))
            for i in range(3)
        ]
        speed = [sum(columns[j][i] * v[j] for j in range(3)) for i in range(2)]
        force = [20000 * (desired[i] - place[i]) + 400 * (rate * BY[i] - speed[i]) for i in range(2)]
        torque.tau[:3] = [sum(c * f for c, f in zip(columns[j], force)) - 0.2 * v[j] for j in range(3)]
        ends = {"ends at once": 0.003, "does not settle": LASTS + 0.01}.get(HOW, LASTS + SETTLE)
        torque.phase = wire.PHASE_DONE if t >= ends and HOW != "waits for ever" else wire.PHASE_RUNNING
        shown = place if HOW != "follows" else desired
        state.p_BE_d[:2], state.R_BE_d[:] = shown, estimate_rotation(angles[-1])
        state.path_time_s, state.time_scale, state.null_scale, state.task_scale = self.clock(t), 1.0, 1.0, 1.0
        state.beta[:] = [1.0] * 4

def estimate_rotation(angle):
    c, s = math.cos(angle), math.sin(angle)
    return [c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0]

Follower.run()
