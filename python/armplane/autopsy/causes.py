"""The incident in a log and its cause: evidence for each cause, ranked.

Each function looks for one cause and returns its `Evidence`, or `None`. `find` weighs them: a cause must come before what it explains, and what came in from
outside (a NaN, a gap, a jump in the command) goes before what the arm did about it.
"""

from dataclasses import dataclass, field

import numpy as np

from .columns import hold
from .motion import slope, smooth

CAUSES = ("singularity", "joint limit", "speed limit", "torque limit", "gap in the stamps", "jump in the command", "NaN", "oscillation", "another robot", "unknown", "none")


@dataclass
class Evidence:
    """For a cause: `t`, when it began (s); `weight`, 0 to 1; `text`, a sentence; `data`, numbers for JSON."""

    cause: str
    t: float
    weight: float
    text: str
    data: dict = field(default_factory=dict)


@dataclass
class Effect:
    """An incident as it was seen: `what` (stopped, jumped, shook, left limits, strayed), from `t` on (s), and in words."""

    what: str
    t: float
    text: str


def runs(mask):
    """The stretches of True in a mask: (first, last + 1) each."""
    edges = np.flatnonzero(np.diff(np.r_[0, np.asarray(mask, np.int8), 0]))
    return list(zip(edges[::2], edges[1::2]))


def long_run(mask, t, least):
    """The first stretch of True that lasts `least` seconds and three rows, or `None`."""
    return next(((a, b) for a, b in runs(mask) if b - a >= 3 and t[b - 1] - t[a] >= least), None)


# --- causes from outside ---


def nan(log):
    """A number that is none, in a column that is dense otherwise."""
    first = None
    for role, stream in log.streams.items():
        broken = ~np.isfinite(stream.x.reshape(len(stream.x), -1)).all(axis=1)
        if broken.any() and not broken.all():
            t = float(stream.t[np.argmax(broken)])
            if first is None or t < first.t:
                words = f"{stream.name} is NaN or infinite from {t:.3f} s on, in {int(broken.sum())} of {len(broken)} rows"
                first = Evidence("NaN", t, 0.97, words, {"role": role, "rows": int(broken.sum())})
    return first


def gap(log, m):
    """Stamps that leave out several periods, of the state or of a command that came at a steady rate; or that run back."""
    best = None
    for role, stream in log.streams.items():
        steps = np.diff(stream.t)
        usual = np.median(steps[steps > 0]) if (steps > 0).any() else 0
        back = steps < -1e-3
        if back.any():
            k = int(np.argmax(back))
            return Evidence("gap in the stamps", float(stream.t[k]), 0.8, f"the stamps of {stream.name} run back by {-steps[k]:.3f} s", {"seconds": float(steps[k])})
        if usual <= 0 or len(steps) < 20:
            continue
        late = steps > max(4.5 * usual, usual + 0.04)
        # A stream that comes now and then has no gaps.
        if not late.any() or late.mean() > 0.02 or np.quantile(steps, 0.9) > 3 * usual:
            continue
        k = int(np.argmax(steps))
        if best is None or steps[k] > best.data["seconds"]:
            words = f"{'the log' if role == 'q' else stream.name} has no message for {steps[k]:.3f} s ({steps[k] / usual:.0f} periods)"
            best = Evidence("gap in the stamps", float(stream.t[k]), 0.92, words, {"seconds": float(steps[k]), "until": float(stream.t[k + 1]), "role": role})
    return best or _stale(m)


def _stale(m):
    """A command that stood still, bit by bit, while it moved before and after."""
    if m.qc is None:
        return None
    still = np.r_[False, (np.diff(m.qc, axis=0) == 0).all(axis=1)]
    if still.mean() > 0.3:
        return None
    for a, b in runs(still):
        fast = lambda k: np.abs(m.vc[np.clip(k, 0, len(m.t) - 1)]).max()
        if b - a >= 5 and m.t[b - 1] - m.t[a] > 0.06 and b < len(m.t) - 2 and fast(a - 3 - m.reach) > 0.05 and np.abs(m.qc[b] - m.qc[b - 1]).max() > 0.01:
            words = f"the command stood still for {m.t[b] - m.t[a]:.3f} s and then went on elsewhere"
            return Evidence("gap in the stamps", float(m.t[a]), 0.85, words, {"seconds": float(m.t[b] - m.t[a]), "until": float(m.t[b])})
    return None


def command_jump(log, m):
    """A step in the command that its neighbours do not announce; a step of joint commands that leaves the hand where it is, is a singularity's."""
    best = None
    for role, unit in (("q_cmd", "rad"), ("pose_cmd", "m")):
        stream = log[role]
        if stream is None or len(stream.t) < 12 or stream is log["q"]:
            continue
        x = stream.x if role == "q_cmd" else stream.x[:, :3, 3]
        known = np.isfinite(x).all(axis=1)
        x, t = x[known], stream.t[known]
        step = np.diff(x, axis=0)
        usual = np.median(np.diff(t))
        # The part of a step beyond the mean of the ones around it; a gap's step may be as long as the gap.
        around = (np.r_[step[:1], step[:-1]] + np.r_[step[1:], step[-1:]]) / 2
        odd = np.abs(step - around).max(axis=1) - 1.5 * np.abs(around).max(axis=1) * np.maximum(np.diff(t) / usual - 1, 0)
        k = int(np.argmax(odd))
        near = odd[max(0, k - 12) : k + 13]
        floor = max(0.03 if role == "q_cmd" else 0.01, 4 * np.partition(near, -4)[-4])
        if odd[k] < floor or np.diff(t)[k] > 4 * usual:
            continue
        if role == "q_cmd" and m.robot is not None and _keeps_hand(m, x[k], x[k + 1]):
            continue
        j = int(np.argmax(np.abs(step[k])))
        part = f"{m.robot.joints[j]} by {np.degrees(step[k][j]):.1f}°" if role == "q_cmd" else f"the pose by {1000 * np.linalg.norm(step[k]):.0f} mm"
        found = Evidence("jump in the command", float(t[k + 1]), 0.95, f"the command moves {part} from one message to the next", {"role": role, "step": float(np.abs(step[k]).max())})
        best = best or found
    return best


def _keeps_hand(m, before, after):
    """Whether a step of the joints is one along the lost direction: it turns joints, and hardly moves the hand."""
    r = m.robot
    middle = (before + after)[None] / 2
    pose, J = r.move(np.stack([before, after]))
    _, sigma, null = r.decompose(r.move(middle)[1])
    step = after - before
    share = abs(null[0] @ step) / max(np.linalg.norm(step), 1e-9)
    hand = np.linalg.norm(pose[1, :3, 3] - pose[0, :3, 3]) / r.length / np.linalg.norm(step)
    return sigma[0] < 0.35 * m.usual and share > 0.7 and hand < 0.6


# --- limits ---


def joint_limit(m):
    """A joint that has come to its limit and rests there, or is told to go on."""
    r, best = m.robot, None
    for j in range(r.dof):
        for side, limit in ((1, r.upper[j]), (-1, r.lower[j])):
            if not np.isfinite(limit):
                continue
            tolerance = max(0.004, 0.002 * (r.upper[j] - r.lower[j]) if np.isfinite(r.upper[j] - r.lower[j]) else 0)
            touching = side * (m.q[:, j] - limit) > -tolerance
            found = long_run(touching, m.t, 0.05)
            if not found or (found[0] < 5 and found[1] > 0.9 * len(m.t)):
                continue
            a, b = found
            pushed = m.qc is not None and np.max(side * (m.qc[a:b, j] - limit)) > -tolerance
            came = a > 3 and side * (m.q[a, j] - m.q[max(0, a - max(5, int(0.3 / m.dt))), j]) > 3 * tolerance
            if not (pushed or came):
                continue
            words = f"{r.joints[j]} is at its limit of {_angle(m, j, limit)} from {m.t[a]:.3f} s on" + (", and told to go on" if pushed else "")
            one = Evidence("joint limit", float(m.t[a]), 0.9 if pushed else 0.84, words, {"joint": r.joints[j], "limit": float(limit)})
            best = one if best is None or one.t < best.t else best
    return best


def _angle(m, j, x):
    return f"{np.degrees(x):.1f}°" if m.robot.turns[j] else f"{1000 * x:.0f} mm"


def speed_limit(m):
    """A joint at its largest speed for a while, or a command beyond it, of joints or of the hand."""
    found = _saturation(m, "speed limit", m.v, m.vc, m.robot.velocity, 0.97, 0.78, "rad/s")
    if m.asked_by in ("twist", "pose") and np.isfinite(m.robot.velocity).any():
        rows = np.arange(0, len(m.rows), max(1, len(m.rows) // 4000))
        needed = np.abs(np.einsum("kji,ki->kj", np.linalg.pinv(m.J[rows], rcond=0.02), m.asked[rows])) / m.robot.velocity
        t = m.t[m.rows[rows]]
        hit = long_run((needed.max(axis=1) > 1.1) & (m.sigma[rows] > 0.45 * m.usual), t, 0.03)
        if hit and (found is None or t[hit[0]] < found.t):
            j = int(np.argmax(needed[hit[0]]))
            text = f"the hand was asked to move so fast that {m.robot.joints[j]} would need {needed[hit[0] : hit[1], j].max():.1f} times its largest speed"
            return Evidence("speed limit", float(t[hit[0]]), 0.77, text, {"joint": m.robot.joints[j], "flips": 0})
    return found


def torque_limit(m):
    """A drive at its largest torque for a while; alternating ends are an oscillation's."""
    return _saturation(m, "torque limit", m.tau, None, m.robot.effort, 0.985, 0.8, "N·m") if m.tau is not None else None


def _saturation(m, cause, x, command, limits, share, weight, unit):
    best = None
    for j in range(m.robot.dof):
        if not np.isfinite(limits[j]):
            continue
        full = np.abs(x[:, j]) > share * limits[j]
        found = long_run(full, m.t, 0.03)
        asked = long_run(np.abs(command[:, j]) > 1.03 * limits[j], m.t, 0.02) if command is not None else None
        for run, word in ((found, "is at"), (asked, "is told to exceed")):
            if run and (best is None or m.t[run[0]] < best.t):
                a, b = run
                signs = np.sign(x[a : a + max(3, int(1 / m.dt)), j][full[a : a + max(3, int(1 / m.dt))]])
                flips = int(np.abs(np.diff(signs)).sum() / 2) if len(signs) else 0
                words = f"{m.robot.joints[j]} {word} its limit of {limits[j]:.3g} {unit} from {m.t[a]:.3f} s on, for {m.t[b - 1] - m.t[a]:.2f} s"
                data = {"joint": m.robot.joints[j], "limit": float(limits[j]), "flips": flips, "seconds": float(m.t[b - 1] - m.t[a])}
                best = Evidence(cause, float(m.t[a]), weight, words, data)
    return best


def oscillation(m):
    """A joint that swings to and fro at 2 Hz or more, several times, and more than before."""
    best = None
    width = max(3, int(0.5 / m.dt))
    # Uneven stamps make speeds swing, too.
    steps = np.diff(m.t)
    jitter = 0.0 if m.log["qdot"] is not None else float(np.median(np.abs(steps - m.dt)) / m.dt)
    fast = m.v - smooth(m.v, max(3, int(0.16 / m.dt)))
    for j in range(m.robot.dof):
        power = np.sqrt(smooth(fast[:, j] ** 2, width))
        # Changes of sign between swings that count, not of noise around rest.
        swings = np.flatnonzero(np.abs(fast[:, j]) > 0.4 * power)
        turns = np.zeros(len(m.t))
        turns[swings[1:][np.diff(np.sign(fast[swings, j])) != 0]] = 1
        crossings = smooth(turns, width) * width
        usual = np.quantile(power, 0.2)
        floor = np.maximum(max(0.05, 5 * usual, 0.12 * np.quantile(np.abs(m.v[:, j]), 0.9)), (0.15 + 3 * jitter) * smooth(np.abs(m.v[:, j]), width))
        found = long_run((power > floor) & (crossings >= 5), m.t, 0.2)
        if not found:
            continue
        a, b = found
        k = a + int(np.argmax(power[a:b]))
        # An oscillation that rings down after a stop or a blow is no cause.
        if power[(a + b) // 2 : b].mean() < 0.6 * power[a : (a + b) // 2].mean():
            continue
        # The window begins to see it up to half a width before its middle.
        t = float(m.t[min(a + width // 4, len(m.t) - 1)]) if a else float(m.t[0])
        swings, hertz = m.v[max(0, k - width) : k + width, j], crossings[k] / 2 / (width * m.dt)
        if best is None or power[k] > best.data["speed"]:
            words = f"{m.robot.joints[j]} swings at {hertz:.1f} Hz with up to {np.abs(swings).max():.2f} rad/s"
            best = Evidence("oscillation", t, 0.76, words, {"joint": m.robot.joints[j], "hertz": float(hertz), "speed": float(power[k])})
    return best


# --- the singularity ---


def singularity(m):
    """The arm near a lost direction ζ while the hand was asked to move along it, and did not, or only with far more joint speed than there is.

    The motion asked for is the twist or pose of the log; with joint commands alone, which pass any posture, it is the hand's steady motion before.
    """
    if m.asked_by in ("twist", "pose"):
        return _along(m, m.asked, m.asked_by)
    steady = _steady(m)
    return (_along(m, steady, "steady motion before") if steady is not None else None) or _amplified(m)


def _steady(m):
    """The hand's twist where it was constant for 0.3 s while the joints' speeds were not, as on a straight line; held from then on."""
    t, dt = m.t[m.rows], _period(m)
    V, v = (smooth(x, max(1, int(0.04 / dt))) for x in (m.V * m.robot.scale, m.v[m.rows]))
    width = max(4, int(0.3 / dt))

    def change(x):
        mean = smooth(x, width)
        spread = np.sqrt(np.maximum(smooth(np.sum(x * x, axis=1), width) - np.sum(mean * mean, axis=1), 0))
        return spread / np.maximum(np.linalg.norm(mean, axis=1), 1e-9), np.linalg.norm(mean, axis=1)

    (off, size), (joints, _) = change(V), change(v)
    calm = (off < 0.03) & (off < 0.3 * joints) & (size > 0.3 * np.quantile(size, 0.9)) & (m.sigma > 0.2 * m.usual)
    found = long_run(calm, t, 0.15)
    if not found:
        return None
    asked = np.zeros_like(V)
    asked[found[0] :] = np.median(V[found[0] : found[1]], axis=0)
    return asked / m.robot.scale


def _period(m):
    return float(np.median(np.diff(m.t[m.rows])))


def _along(m, asked, by):
    S, t = asked * m.robot.scale, m.t[m.rows]
    size = np.linalg.norm(S, axis=1)
    if not size.max() > 0:
        return None
    part = np.abs(np.sum(m.u * S, axis=1))
    share, need = part / np.maximum(size, 1e-12), part / np.maximum(m.sigma, 1e-6)
    limit = _null_speed(m, 3 * np.quantile(np.linalg.norm(m.v, axis=1), 0.9) + 1e-3)
    missing = (asked - m.V) * m.robot.scale
    along = np.abs(np.sum(m.u * missing, axis=1))
    lost, pure = along / np.maximum(size, 1e-12), along / np.maximum(np.linalg.norm(missing, axis=1), 1e-12)
    # Small arms are ill-conditioned everywhere: near is also far less than before.
    near = ((m.sigma < 0.45 * m.usual) | (m.sigma < 0.45 * np.maximum.accumulate(m.sigma))) & (size > 0.1 * np.quantile(size, 0.95))
    v = m.v[m.rows]
    own = np.abs(np.sum(m.null * v, axis=1))
    is_fast = near & (need > 0.8 * limit) & ((share > 0.12) | (own > 0.6 * limit) & (own > 0.8 * np.linalg.norm(v, axis=1)))
    is_lost = near & (share > 0.15) & (lost > 0.15) & (pure > 0.8) & (need > 0.2 * limit)
    hit, weight = long_run(is_fast | is_lost, t, 0.03), 0.87
    if halt := _halt(m, S, size):
        hit, weight = (halt, 0.85) if not hit or halt[0] < hit[0] else (hit, weight)
    if not hit:
        return None
    # The lost direction of the incident's beginning; later, the arm may have gone on to another posture.
    a, b = hit[0], hit[1] if hit == halt else max(hit[0] + 1, min(hit[1], int(np.searchsorted(t, t[hit[0]] + 0.4)) + 1))
    weight -= 0.03 * (by == "steady motion before")
    one = _evidence(m, a, a + int(np.argmin(m.sigma[a:b])), weight, share[a:b].max(), need[a:b].max(), limit, by)
    one.data["until"] = float(t[hit[1] - 1])
    return one


def _halt(m, S, size):
    """Where the hand slowed down to rest as the Jacobian's condition number rose, though asked to go on, as MoveIt Servo does it; or `None`."""
    t = m.t[m.rows]
    kept = np.sum(m.V * m.robot.scale * S, axis=1) / np.maximum(size * size, 1e-12)
    asked = size > 0.3 * np.quantile(size, 0.9)
    for a, b in runs((kept < 0.15) & asked):
        before = np.flatnonzero(kept[:a] > 0.85)
        if t[b - 1] - t[a] < 0.1 or not len(before) or t[a] - t[before[-1]] < 0.05:
            continue
        first, last = np.linalg.cond(m.J[[before[-1], a]])
        if last > 15 and last > 1.3 * first:
            return before[-1], b
    return None


def _null_speed(m, unlimited):
    """The largest speed along the arm's null direction, row by row, that the joints' limits allow."""
    return np.min(np.where(np.isfinite(m.robot.velocity), m.robot.velocity, unlimited) / np.maximum(np.abs(m.null), 1e-3), axis=1)


def _amplified(m):
    """Joint speed that grows along the arm's null direction while the hand's does not, in a log that has only joints."""
    t, dt = m.t[m.rows], _period(m)
    v, V = (smooth(x, max(1, int(0.02 / dt))) for x in (m.v[m.rows], m.V * m.robot.scale))
    joint, hand = np.linalg.norm(v, axis=1), np.linalg.norm(V, axis=1)
    back = max(3, int(0.4 / dt))
    k0 = np.maximum(np.arange(len(t)) - back, 0)
    grown, kept = joint / np.maximum(joint[k0], 0.1 * np.quantile(joint, 0.9)), hand / np.maximum(hand[k0], 0.1 * np.quantile(hand, 0.9))
    share = np.abs(np.sum(m.null * v, axis=1)) / np.maximum(joint, 1e-9)
    mask = (m.sigma < 0.4 * m.usual) & (grown > 2.2) & (kept < 1.4) & (share > 0.75) & (joint > 0.5 * joint.max()) & (np.arange(len(t)) > back)
    hit = long_run(mask, t, 0.0)
    if not hit:
        return None
    a, b = hit
    return _evidence(m, a, a + int(np.argmin(m.sigma[a:b])), 0.82, None, float(joint[a:b].max()), _null_speed(m, np.inf), "joint motion")


def _evidence(m, a, k, weight, share, need, limits, by):
    """The evidence of the row `a` on, with the singularity at row `k`: its name, type and ζ are those of the analysis that all of armplane uses."""
    q, limit = m.q[m.rows[k]], float(limits[k])
    name, kind, zeta, measure = nearest(m, q)
    data = {
        "name": name, "type": kind, "zeta": zeta.tolist(), "measure": measure, "sigma": float(m.sigma[k]), "condition": float(min(np.linalg.cond(m.J[k]), 1e6)),
        "share": None if share is None else float(share), "needed": float(min(need, 1e6)), "limit": limit if np.isfinite(limit) else None, "by": by,
        "q": q.tolist(), "t_nearest": float(m.t[m.rows[k]]),
    }  # fmt: skip
    lost = f"{'rotation about' if np.linalg.norm(zeta[:3]) < 0.5 else 'translation along'} {vector(zeta)}"
    fast = f", which needs {min(need, 999):.1f} rad/s" + (f" of {limit:.1f} there are" if np.isfinite(limit) else "") if need > 0.5 * limit or not np.isfinite(limit) else ""
    asked = "the joints' speed grew while the hand's did not" if share is None else f"{share:.0%} of the motion asked for was along it{fast}"
    where = f"{name} singularity ({kind}, s = {measure:.3f}" if name != "unnamed" else f"a singularity ({m.sigma[k] / m.usual:.0%} of the usual smallest singular value"
    words = f"the arm is near {'its ' if name != 'unnamed' else ''}{where}, condition number {data['condition']:.0f}); lost is the {lost}, and {asked}"
    return Evidence("singularity", float(m.t[m.rows[a]]), weight, words, data)


def nearest(m, q):
    """Name, type, ζ (6,) in base axes and measure of the singularity nearest to `q`. ζ is that of the exact posture, found from `q` along the slope of σ."""
    exact, r = np.array(q), m.robot
    sigma = r.decompose(r.move(exact[None])[1])[1]
    for _ in range(40 if sigma[0] > 0.15 * m.usual else 0):
        around = np.concatenate([exact[None], exact + 1e-5 * np.eye(r.dof)])
        sigma = r.decompose(r.move(around)[1])[1]
        if sigma[0] < 1e-4:
            break
        rise = (sigma[1:] - sigma[0]) / 1e-5
        exact = exact - np.clip(sigma[0] * rise / max(rise @ rise, 1e-9), -0.2, 0.2)
    here, one = {one.name: one for one in r.arm.singularities(q)}, None
    for at in (exact, np.array(q)):
        listed = [one for one in r.arm.singularities(at) if one.inside and one.name in here and abs(here[one.name].measure) < 2 * one.exit]
        one = min(listed, key=lambda one: abs(one.measure) / max(one.exit, 1e-9), default=None)
        if sigma[0] < 0.15 * m.usual and np.abs(at - q).max() < 0.4 and one:
            break
    u, named = r.decompose(r.move(at[None])[1])[0][0], one is not None
    # The lost direction is a wrench at the hand, u: its force is the translation lost, wherever on the hand. A lost rotation is that of the wrist about itself.
    turns = np.linalg.norm(one.direction[:3]) < 0.5 if named else np.linalg.norm(u[:3]) < 0.3
    arm = r.arm.step_many(at[None])["p_BC"][0] - r.move(at[None])[0][0, :3, 3]
    if named and turns and np.linalg.norm(u[3:] - np.cross(arm, u[:3] / r.length)) < 0.3 * np.linalg.norm(u[:3]):
        turns = named = False
    zeta = np.r_[np.zeros(3), one.direction[3:] if named else u[3:]] if turns or np.linalg.norm(u[:3]) < 0.05 else np.r_[u[:3], np.zeros(3)]
    measure = here[one.name].measure if named else float("nan")
    return one.name if named else "unnamed", one.type if named else "unknown", zeta / np.linalg.norm(zeta), float(measure)


def vector(zeta):
    """The three numbers of a direction that is a translation or a rotation."""
    part = zeta[:3] if np.linalg.norm(zeta[:3]) > 0.5 else zeta[3:]
    return "(" + " ".join(f"{x:+.2f}" for x in part) + ")"


# --- what happened ---


def effects(log, m):
    """All that can be seen of an incident, in order of time."""
    found = [*_stops(m), *_strays(m), *_jumps(m)]
    return sorted(found, key=lambda one: one.t)


def _stops(m):
    """Rests that were not asked for: the command goes on, or the motion ends within 0.1 s."""
    speed = np.linalg.norm(m.v * np.where(m.robot.turns, 1, 1 / m.robot.length), axis=1)
    peak = np.quantile(speed, 0.95)
    if peak < 0.01:
        return
    rest = speed < max(0.04 * peak, 0.006)
    asked = None if m.asked is None else np.linalg.norm(m.asked * m.robot.scale, axis=1)
    back = max(2, int(0.15 / m.dt))
    for a, b in runs(rest):
        if a < back or m.t[b - 1] - m.t[a] < 0.15:
            continue
        inside = (m.rows >= a) & (m.rows < b)
        demanded = asked is not None and inside.any() and np.median(asked[inside]) > 0.15 * np.quantile(asked, 0.9)
        lag = m.qc is not None and np.abs(m.qc[a:b] - m.q[a:b]).max() > 0.03 + 2 * np.quantile(np.abs(m.qc - m.q).max(axis=1), 0.25)
        fast = m.t[a - 1] - m.t[max(0, a - 1 - np.argmax(speed[a - 1 :: -1] > 0.5 * peak))]
        abrupt = speed[max(0, a - back) : a].max() > 0.5 * peak and fast < 0.1
        if demanded or lag or abrupt:
            words = "while the command went on" if demanded or lag else f"from {speed[max(0, a - back) : a].max():.2f} rad/s within {fast * 1000:.0f} ms"
            # The stop began where the arm last had most of its speed.
            start = max(0, a - 1 - int(np.argmax(speed[a - 1 :: -1] > 0.5 * peak)))
            yield Effect("stopped", float(m.t[start]), f"it came to rest at {m.t[a]:.2f} s {words}")
            return


def _strays(m):
    """A joint that no longer follows its command, or a hand that no longer moves as asked."""
    if m.qc is not None:
        off = np.abs(m.qc - m.q)
        fast = np.abs(m.vc) + 1e-3
        moving = fast > 0.1 * np.quantile(fast, 0.95)
        delay = np.median(off[moving] / fast[moving]) if moving.any() else 0
        excess = (off - 3 * delay * fast - 0.05 - 3 * np.quantile(off, 0.2)).max(axis=1)
        if hit := long_run(excess > 0, m.t, 0.04):
            a, b = hit
            k = a + int(np.argmax(off[a:b].max(axis=1)))
            j = int(np.argmax(off[k]))
            yield Effect("strayed", float(m.t[a]), f"{m.robot.joints[j]} was up to {np.degrees(off[k, j]):.1f}° from its command")
    if m.asked is not None and m.asked_by in ("twist", "pose"):
        asked, V = m.asked * m.robot.scale, m.V * m.robot.scale
        size = np.linalg.norm(asked, axis=1)
        # The hand may follow by up to 0.15 s later.
        late = [min(int(k * 0.05 / _period(m)), len(V) - 1) for k in range(4)]
        off = np.min([np.linalg.norm(np.r_[np.repeat(asked[:1], k, axis=0), asked[: len(V) - k]] - V, axis=1) for k in late], axis=0)
        bad = (off > 0.45 * size) & (size > 0.3 * np.quantile(size, 0.9))
        if hit := long_run(bad, m.t[m.rows], 0.08):
            a, b = hit
            k = a + int(np.argmax(off[a:b]))
            yield Effect("strayed", float(m.t[m.rows[a]]), f"the hand moved up to {1000 * np.linalg.norm((m.asked - m.V)[k, :3]):.0f} mm/s and "
                         f"{np.degrees(np.linalg.norm((m.asked - m.V)[k, 3:])):.0f}°/s off what was asked")  # fmt: skip


def _jumps(m):
    """A velocity that changes within 20 ms by a large part of what the joint can do."""
    reach = max(1, round(0.012 / m.dt))
    change = np.abs(slope(np.arange(len(m.t), dtype=float), m.v, reach)) * 2 * reach
    size = np.where(np.isfinite(m.robot.velocity), m.robot.velocity, np.maximum(2.0, 2 * np.quantile(np.abs(m.v), 0.95, axis=0)))
    odd = change / size
    k = np.unravel_index(np.argmax(odd), odd.shape)
    if odd[k] > 0.3 and odd[k] > 6 * np.quantile(odd[:, k[1]], 0.8):
        first = int(np.argmax(odd[:, k[1]] > 0.6 * odd[k]))
        yield Effect("jumped", float(m.t[first]), f"{m.robot.joints[k[1]]} changed its speed by {change[k]:.2f} rad/s within {2 * reach * m.dt * 1000:.0f} ms")


def find(log, m):
    """(effects, evidence ranked, notes): the likeliest cause first; `none` where nothing happened."""
    if not m.fits:
        text = (m.notes or ["the log does not fit the robot"])[-1]
        return [], [Evidence("another robot", 0.0, 1.0, text)]
    seen = effects(log, m)
    found = [one for one in (nan(log), gap(log, m), command_jump(log, m), joint_limit(m), singularity(m), speed_limit(m), torque_limit(m), oscillation(m)) if one]
    swing = next((one for one in found if one.cause == "oscillation"), None)
    if swing:
        seen.append(Effect("shook", swing.t, swing.text))
    lock = next((one for one in found if one.cause == "singularity"), None)
    if lock and lock.data["by"] == "steady motion before":
        seen.append(Effect("strayed", lock.t, "the hand left the straight motion that it had been in"))
    if lock and lock.data["by"] == "joint motion":
        seen.append(Effect("jumped", lock.t, f"the joints' speed rose to {lock.data['needed']:.1f} rad/s within 0.4 s"))
    limit = next((one for one in found if one.cause == "joint limit"), None)
    if limit:
        seen.append(Effect("left limits", limit.t, limit.text))
    for one in found:
        one.weight *= _fits_time(one, seen)
        if one.cause in ("torque limit", "speed limit") and swing and (one.data["flips"] > 1 or swing.t < one.t - 0.05):
            one.weight -= 0.2
    hole = next((one for one in found if one.cause == "gap in the stamps"), None)
    for one in found:
        # After a gap the command has moved on; and a cause is no longer one where another goes before it.
        if one.cause == "jump in the command" and hole and hole.t - 0.02 <= one.t <= hole.data.get("until", hole.t) + 0.1:
            one.weight -= 0.1
        elif one.cause == "jump in the command" and one.data["role"] == "q_cmd" and lock and lock.data["by"] in ("twist", "pose") and lock.t < one.t:
            # The hand's command is smooth, and what has become of it in joints is the singularity's.
            one.weight -= 0.2
        elif any(other.t < one.t - 0.25 and other.weight > 0.75 for other in found if other is not one):
            one.weight -= 0.15
    if not found:
        cause, text = ("unknown", "no limit, gap, jump, NaN, swing or singularity goes before it") if seen else ("none", "the arm did what it was asked")
        found = [Evidence(cause, seen[0].t if seen else 0.0, 0.3, text)]
    found.sort(key=lambda one: -one.weight)
    if found[0].weight < 0.3 and seen:
        found.insert(0, Evidence("unknown", seen[0].t, 0.3, "no limit, gap, jump, NaN, swing or singularity goes before it"))
    return sorted(seen, key=lambda one: one.t), found


def _fits_time(one, seen):
    """How well a cause goes before what is seen: 1 where it begins at most a second before the first effect, and not after it."""
    if not seen or one.cause == "NaN":
        return 1.0
    # An oscillation is seen by a window that reaches before it.
    sharp = [effect.t for effect in seen if effect.what != "shook"] if one.cause in ("gap in the stamps", "jump in the command") else []
    first = min(sharp or [effect.t for effect in seen])
    after = first - one.data.get("until", one.t)
    if one.cause == "torque limit":
        # A drive that pushes against what has stopped it, or strays under a load that grows.
        blocked = any(effect.what == "stopped" and effect.t < one.t - 0.03 for effect in seen)
        return (1.0 if after < 0.8 else 0.6) if one.t < first + 0.5 and not blocked else 0.35
    if one.cause == "speed limit":
        return (1.0 if after < 0.8 else 0.6) if one.t < first + 0.03 else 0.35
    if one.cause in ("gap in the stamps", "jump in the command"):
        return 1.0 if one.t - 0.08 < first and after < 0.6 else 0.6
    return (1.0 if after < 0.8 else 0.6) if one.t < first + (0.5 if one.cause == "oscillation" else 0.25) else 0.35
