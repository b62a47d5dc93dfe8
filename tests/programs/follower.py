"""A controller of three links in a plane, which follows its path, or says in one of several ways that it has. The argument says how."""
import cmath, itertools, math, sys
import armplane
from armplane import wire

HOW, LINKS, BY, LASTS, SETTLE = sys.argv[1], (0.4, 0.3, 0.2), 0.03 - 0.04j, 0.4, 0.1
GOES = HOW in ("follows", "does not settle", "is stuck", "waits for ever")

def links(q):
    """The links as complex numbers: what stands at right angles to them is `1j` times them."""
    return [length * cmath.exp(1j * angle) for length, angle in zip(LINKS, itertools.accumulate(q))]

class Follower(armplane.Controller):
    def setup(self):
        self.start = sum(links(map(math.radians, self.job["scenario"]["start"]["q_deg"])))

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
        t, v, parts = tick * self.dt, estimate.qdot[:3], links(estimate.q[:3])
        u = min(self.clock(t) / LASTS, 1.0) if GOES else 0.0
        share, rate = u**3 * (10 - 15 * u + 6 * u * u), 30 * u * u * (1 - u) ** 2 / LASTS
        place, desired = sum(parts), self.start + share * BY
        columns = [1j * sum(parts[i:]) for i in range(3)]
        force = 20000 * (desired - place) + 400 * (rate * BY - sum(c * speed for c, speed in zip(columns, v)))
        torque.tau[:3] = [(c.conjugate() * force).real - 0.2 * speed for c, speed in zip(columns, v)]
        ends = {"ends at once": 0.003, "does not settle": LASTS + 0.01}.get(HOW, LASTS + SETTLE)
        torque.phase = wire.PHASE_DONE if t >= ends and HOW != "waits for ever" else wire.PHASE_RUNNING
        shown, along = desired if HOW == "follows" else place, parts[2] / LINKS[2]
        state.p_BE_d[:2] = shown.real, shown.imag
        state.R_BE_d[:] = along.real, along.imag, 0, -along.imag, along.real, 0, 0, 0, 1
        state.path_time_s, state.time_scale, state.null_scale, state.task_scale = self.clock(t), 1.0, 1.0, 1.0
        state.beta[:] = [1.0] * 4

Follower.run()
