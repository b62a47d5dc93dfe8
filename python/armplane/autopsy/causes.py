"""The incident in a log and its cause: evidence for each cause, ranked.

Each function looks for one cause and returns its `Evidence`, or `None`. `find` weighs them: a cause must come before what it explains, and what came in from
outside (a NaN, a gap, a jump in the command) goes before what the arm did about it.
"""

from dataclasses import dataclass, field

import numpy as np

from .motion import norm, slope, smooth

GAP, JUMP = "gap in the stamps", "jump in the command"
CAUSES = ("singularity", "joint limit", "speed limit", "torque limit", GAP, JUMP, "NaN", "oscillation", "another robot", "unknown", "none")
NO_CAUSE = "no limit, gap, jump, NaN, swing or singularity goes before it"


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


def long_runs(masks, t, least):
    """Of masks (N, n): the first long stretch of each column that has one, (first, last + 1, column), in order of time."""
    return sorted((*run, j) for j, mask in enumerate(masks.T) if (run := long_run(mask, t, least)))


# --- causes from outside ---


def nan(log, m):
    """A number that is none, in a column that is dense otherwise."""
    found = []
    for role, stream in log.streams.items():
        broken = ~np.isfinite(stream.x.reshape(len(stream.x), -1)).all(axis=1)
        if broken.any() and not broken.all():
            t = stream.t[np.argmax(broken)]
            words = f"{stream.name} is NaN or infinite from {t:.3f} s on, in {broken.sum()} of {len(broken)} rows"
            found.append(Evidence("NaN", t, 0.97, words, {"role": role, "rows": broken.sum()}))
    return min(found, key=lambda one: one.t, default=None)


def gap(log, m):
    """Stamps that leave out several periods, of the state or of a command that came at a steady rate; or that run back."""
    found = []
    for role, stream in log.streams.items():
        steps = np.diff(stream.t)
        if (steps < -1e-3).any():
            k = np.argmax(steps < -1e-3)
            return Evidence(GAP, stream.t[k], 0.8, f"the stamps of {stream.name} run back by {-steps[k]:.3f} s", {"seconds": steps[k]})
        if len(steps) < 20 or not (steps > 0).any():
            continue
        usual, k = np.median(steps[steps > 0]), np.argmax(steps)
        late = steps > max(4.5 * usual, usual + 0.04)
        # A stream that comes now and then has no gaps.
        if late.any() and late.mean() <= 0.02 and np.quantile(steps, 0.9) <= 3 * usual:
            words = f"{'the log' if role == 'q' else stream.name} has no message for {steps[k]:.3f} s ({steps[k] / usual:.0f} periods)"
            found.append(Evidence(GAP, stream.t[k], 0.92, words, {"seconds": steps[k], "until": stream.t[k + 1], "role": role}))
    return max(found, key=lambda one: one.data["seconds"], default=None) or _stale(m)


def _stale(m):
    """A command that stood still, bit by bit, while it moved before and after."""
    still = np.r_[False, (np.diff(m.qc, axis=0) == 0).all(axis=1)] if m.qc is not None else np.ones(1)
    if still.mean() > 0.3:
        return None
    for a, b in runs(still):
        moved = np.abs(m.vc[max(a - 3 - m.reach, 0)]).max() > 0.05 and b < len(m.t) - 2 and np.abs(m.qc[b] - m.qc[b - 1]).max() > 0.01
        if b - a >= 5 and m.t[b - 1] - m.t[a] > 0.06 and moved:
            words = f"the command stood still for {m.t[b] - m.t[a]:.3f} s and then went on elsewhere"
            return Evidence(GAP, m.t[a], 0.85, words, {"seconds": m.t[b] - m.t[a], "until": m.t[b]})
    return None


def command_jump(log, m):
    """A step in the command that its neighbours do not announce; a step of joint commands that leaves the hand where it is, is a singularity's."""
    for role, floor in (("q_cmd", 0.03), ("pose_cmd", 0.01)):
        stream, is_joints = log[role], role == "q_cmd"
        if stream is None or len(stream.t) < 12 or stream is log["q"]:
            continue
        x = stream.x if is_joints else stream.x[:, :3, 3]
        known = np.isfinite(x).all(axis=1)
        x, t = x[known], stream.t[known]
        step, dt = np.diff(x, axis=0), np.diff(t)
        # The part of a step beyond the mean of the ones around it; a gap's step may be as long as the gap.
        around = (np.r_[step[:1], step[:-1]] + np.r_[step[1:], step[-1:]]) / 2
        odd = np.abs(step - around).max(axis=1) - 1.5 * np.abs(around).max(axis=1) * np.maximum(dt / np.median(dt) - 1, 0)
        k = np.argmax(odd)
        fourth = np.sort(odd[max(0, k - 12) : k + 13])[-4]
        if odd[k] < max(floor, 4 * fourth) or dt[k] > 4 * np.median(dt) or is_joints and _keeps_hand(m, x[k], x[k + 1]):
            continue
        j = np.argmax(np.abs(step[k]))
        part = f"{m.robot.joints[j]} by {np.degrees(step[k][j]):.1f}°" if is_joints else f"the pose by {1000 * np.linalg.norm(step[k]):.0f} mm"
        return Evidence(JUMP, t[k + 1], 0.95, f"the command moves {part} from one message to the next", {"role": role, "step": np.abs(step[k]).max()})
    return None


def _keeps_hand(m, before, after):
    """Whether a step of the joints is one along the lost direction: it turns joints, and hardly moves the hand."""
    r, step = m.robot, after - before
    pose, J = r.move(np.stack([before, after, (before + after) / 2]))
    _, sigma, null = r.decompose(J[2:])
    size = max(np.linalg.norm(step), 1e-9)
    return sigma[0] < 0.35 * m.usual and abs(null[0] @ step) > 0.7 * size and np.linalg.norm(pose[1, :3, 3] - pose[0, :3, 3]) < 0.6 * r.length * size


# --- limits ---


def joint_limit(log, m):
    """A joint that has come to its limit and rests there, or is told to go on."""
    r, back = m.robot, max(5, int(0.3 / m.dt))
    span = r.upper - r.lower
    room = np.tile(np.maximum(0.004, np.where(np.isfinite(span), 0.002 * span, 0)), 2)
    side, limit = np.repeat([1, -1], r.dof), np.r_[r.upper, r.lower]
    beyond = side * (np.tile(m.q, 2) - limit) + room
    for a, b, k in long_runs(beyond > 0, m.t, 0.05):
        j = k % r.dof
        pushed = m.qc is not None and np.max(side[k] * (m.qc[a:b, j] - limit[k])) > -room[k]
        came = a > 3 and side[k] * (m.q[a, j] - m.q[max(0, a - back), j]) > 3 * room[k]
        if (a >= 5 or b <= 0.9 * len(m.t)) and (pushed or came):
            at = f"{np.degrees(limit[k]):.1f}°" if r.turns[j] else f"{1000 * limit[k]:.0f} mm"
            words = f"{r.joints[j]} is at its limit of {at} from {m.t[a]:.3f} s on" + (", and told to go on" if pushed else "")
            return Evidence("joint limit", m.t[a], 0.9 if pushed else 0.84, words, {"joint": r.joints[j], "limit": limit[k]})
    return None


def speed_limit(log, m):
    """A joint at its largest speed for a while, or a command beyond it, of joints or of the hand."""
    limits = m.robot.velocity
    found = _saturation(m, "speed limit", m.v, limits, 0.97, 0.78, "rad/s", m.vc)
    if m.asked_by in ("twist", "pose") and np.isfinite(limits).any():
        some = slice(None, None, max(1, len(m.rows) // 4000))
        needed = np.abs(np.einsum("kji,ki->kj", np.linalg.pinv(m.J[some], rcond=0.02), m.asked[some])) / limits
        t = m.t_k[some]
        hit = long_run((needed.max(axis=1) > 1.1) & (m.sigma[some] > 0.45 * m.usual), t, 0.03)
        if hit and (found is None or t[hit[0]] < found.t):
            j = np.argmax(needed[hit[0]])
            text = f"the hand was asked to move so fast that {m.robot.joints[j]} would need {needed[slice(*hit), j].max():.1f} times its largest speed"
            return Evidence("speed limit", t[hit[0]], 0.77, text, {"joint": m.robot.joints[j], "flips": 0})
    return found


def torque_limit(log, m):
    """A drive at its largest torque for a while; alternating ends are an oscillation's."""
    return _saturation(m, "torque limit", m.tau, m.robot.effort, 0.985, 0.8, "N·m") if m.tau is not None else None


def _saturation(m, cause, x, limits, share, weight, unit, command=None):
    found = [(run, "is at") for run in long_runs(np.abs(x) > share * limits, m.t, 0.03)]
    found += [(run, "is told to exceed") for run in long_runs(np.abs(command) > 1.03 * limits, m.t, 0.02)] if command is not None else []
    if not found:
        return None
    (a, b, j), word = min(found)
    second = x[a : a + max(3, int(1 / m.dt)), j]
    flips = np.count_nonzero(np.diff(np.sign(second[np.abs(second) > share * limits[j]])))
    seconds = m.t[b - 1] - m.t[a]
    words = f"{m.robot.joints[j]} {word} its limit of {limits[j]:.3g} {unit} from {m.t[a]:.3f} s on, for {seconds:.2f} s"
    return Evidence(cause, m.t[a], weight, words, {"joint": m.robot.joints[j], "limit": limits[j], "flips": flips, "seconds": seconds})


def oscillation(log, m):
    """A joint that swings to and fro at 2 Hz or more, several times, and more than before."""
    width, found = max(3, int(0.5 / m.dt)), []
    # Uneven stamps make speeds swing, too.
    jitter = 0.0 if log["qdot"] is not None else float(np.median(np.abs(np.diff(m.t) - m.dt)) / m.dt)
    fast, size = m.v - smooth(m.v, max(3, int(0.16 / m.dt))), np.abs(m.v)
    power, turns = np.sqrt(np.maximum(smooth(fast**2, width), 0)), np.zeros_like(fast)
    for j in range(m.robot.dof):
        # Changes of sign between swings that count, not of noise around rest.
        swings = np.flatnonzero(np.abs(fast[:, j]) > 0.4 * power[:, j])
        turns[swings[1:][np.diff(np.sign(fast[swings, j])) != 0], j] = 1
    crossings = smooth(turns, width) * width
    least = np.maximum(np.maximum(0.05, 5 * np.quantile(power, 0.2, axis=0)), 0.12 * np.quantile(size, 0.9, axis=0))
    swings = (power > least) & (power > (0.15 + 3 * jitter) * smooth(size, width)) & (crossings >= 5)
    for a, b, j in long_runs(swings, m.t, 0.2):
        k, middle = a + np.argmax(power[a:b, j]), (a + b) // 2
        # An oscillation that rings down after a stop or a blow is no cause.
        if power[middle:b, j].mean() >= 0.6 * power[a:middle, j].mean():
            # The window begins to see it up to half a width before its middle.
            t, hertz = m.t[min(a + width // 4, len(m.t) - 1) if a else 0], crossings[k, j] / 2 / (width * m.dt)
            words = f"{m.robot.joints[j]} swings at {hertz:.1f} Hz with up to {size[max(0, k - width) : k + width, j].max():.2f} rad/s"
            found.append(Evidence("oscillation", t, 0.76, words, {"joint": m.robot.joints[j], "hertz": hertz, "speed": power[k, j]}))
    return max(found, key=lambda one: one.data["speed"], default=None)


# --- the singularity ---


def singularity(log, m):
    """The arm near a lost direction ζ while the hand was asked to move along it, and did not, or only with far more joint speed than there is.

    The motion asked for is the twist or pose of the log; with joint commands alone, which pass any posture, it is the hand's steady motion before.
    """
    if m.asked_by in ("twist", "pose"):
        return _along(m, m.S, m.asked_by)
    steady = _steady(m)
    return (_along(m, steady, "steady motion before") if steady is not None else None) or _amplified(m)


def _steady(m):
    """The hand's twist where it was constant for 0.3 s while the joints' speeds were not, as on a straight line; held from then on."""
    t, dt = m.t_k, m.period
    V, v = (smooth(x, max(1, int(0.04 / dt))) for x in (m.W, m.v_k))

    def change(x):
        width = max(4, int(0.3 / dt))
        mean = smooth(x, width)
        spread = np.sqrt(np.maximum(smooth(np.sum(x * x, axis=1), width) - np.sum(mean * mean, axis=1), 0))
        return spread / np.maximum(norm(mean), 1e-9), norm(mean)

    (off, size), (joints, _) = change(V), change(v)
    calm = (off < 0.03) & (off < 0.3 * joints) & (size > 0.3 * np.quantile(size, 0.9)) & (m.sigma > 0.2 * m.usual)
    found = long_run(calm, t, 0.15)
    if not found:
        return None
    asked = np.zeros_like(V)
    asked[found[0] :] = np.median(V[slice(*found)], axis=0)
    return asked


def _along(m, S, by):
    t, v, missing = m.t_k, m.v_k, S - m.W
    dot = lambda a, b: np.abs(np.sum(a * b, axis=1))
    size, part, along, own = norm(S), dot(m.u, S), dot(m.u, missing), dot(m.null, v)
    if not size.max() > 0:
        return None
    share, need = part / np.maximum(size, 1e-12), part / np.maximum(m.sigma, 1e-6)
    limit = _null_speed(m, 3 * np.quantile(norm(m.v), 0.9) + 1e-3)
    # Small arms are ill-conditioned everywhere: near is also far less than before.
    near = ((m.sigma < 0.45 * m.usual) | (m.sigma < 0.45 * np.maximum.accumulate(m.sigma))) & (size > 0.1 * np.quantile(size, 0.95))
    is_fast = (need > 0.8 * limit) & ((share > 0.12) | (own > 0.6 * limit) & (own > 0.8 * norm(v)))
    is_lost = (share > 0.15) & (along > 0.15 * size) & (along > 0.8 * norm(missing)) & (need > 0.2 * limit)
    hit, halt, weight = long_run(near & (is_fast | is_lost), t, 0.03), _halt(m, S, size), 0.87
    if halt and (not hit or halt[0] < hit[0]):
        hit, weight = halt, 0.85
    if not hit:
        return None
    # The lost direction of the incident's beginning; later, the arm may have gone on to another posture.
    a, b = hit if hit == halt else (hit[0], max(hit[0] + 1, min(hit[1], np.searchsorted(t, t[hit[0]] + 0.4) + 1)))
    one = _evidence(m, a, b, weight - 0.03 * (by == "steady motion before"), share[a:b].max(), need[a:b].max(), limit, by)
    one.data["until"] = t[hit[1] - 1]
    return one


def _halt(m, S, size):
    """Where the hand slowed down to rest as the Jacobian's condition number rose, though asked to go on, as MoveIt Servo does it; or `None`."""
    t = m.t_k
    kept = np.sum(m.W * S, axis=1) / np.maximum(size * size, 1e-12)
    for a, b in runs((kept < 0.15) & (size > 0.3 * np.quantile(size, 0.9))):
        before = np.flatnonzero(kept[:a] > 0.85)
        if t[b - 1] - t[a] >= 0.1 and len(before) and t[a] - t[before[-1]] >= 0.05:
            first, last = np.linalg.cond(m.J[[before[-1], a]])
            if last > max(15, 1.3 * first):
                return before[-1], b
    return None


def _null_speed(m, unlimited):
    """The largest speed along the arm's null direction, row by row, that the joints' limits allow."""
    return np.min(np.where(np.isfinite(m.robot.velocity), m.robot.velocity, unlimited) / np.maximum(np.abs(m.null), 1e-3), axis=1)


def _amplified(m):
    """Joint speed that grows along the arm's null direction while the hand's does not, in a log that has only joints."""
    t, dt = m.t_k, m.period
    v, V = (smooth(x, max(1, int(0.02 / dt))) for x in (m.v_k, m.W))
    back = np.maximum(np.arange(len(t)) - max(3, int(0.4 / dt)), 0)
    growth = lambda size: size / np.maximum(size[back], 0.1 * np.quantile(size, 0.9))
    joint, share = norm(v), np.abs(np.sum(m.null * v, axis=1)) / np.maximum(norm(v), 1e-9)
    grown = (growth(joint) > 2.2) & (growth(norm(V)) < 1.4) & (joint > 0.5 * joint.max()) & (back > 0)
    hit = long_run(grown & (m.sigma < 0.4 * m.usual) & (share > 0.75), t, 0.0)
    return _evidence(m, *hit, 0.82, None, joint[slice(*hit)].max(), _null_speed(m, np.inf), "joint motion") if hit else None


def _evidence(m, a, b, weight, share, need, limits, by):
    """The evidence of rows `a` to `b`, with the singularity where σ is smallest: its name, type and ζ are those of the analysis that all of armplane uses."""
    k = a + np.argmin(m.sigma[a:b])
    q, limit, condition = m.q[m.rows[k]], limits[k], min(np.linalg.cond(m.J[k]), 1e6)
    name, kind, zeta, measure = nearest(m, q)
    data = {
        "name": name, "type": kind, "zeta": zeta, "measure": measure, "sigma": m.sigma[k], "condition": condition,
        "share": share, "needed": min(need, 1e6), "limit": limit if np.isfinite(limit) else None, "by": by,
        "q": q, "t_nearest": m.t_k[k],
    }  # fmt: skip
    half, way = (zeta[3:], "rotation about") if np.linalg.norm(zeta[:3]) < 0.5 else (zeta[:3], "translation along")
    fast = f", which needs {min(need, 999):.1f} rad/s" + (f" of {limit:.1f} there are" if np.isfinite(limit) else "")
    fast = fast if need > 0.5 * limit or not np.isfinite(limit) else ""
    asked = "the joints' speed grew while the hand's did not" if share is None else f"{share:.0%} of the motion asked for was along it{fast}"
    where = f"its {name} singularity ({kind}, s = {measure:.3f}" if name != "unnamed" else f"a singularity ({m.sigma[k] / m.usual:.0%} of the usual smallest singular value"
    words = f"the arm is near {where}, condition number {condition:.0f}); lost is the {way} ({' '.join(f'{x:+.2f}' for x in half)}), and {asked}"
    return Evidence("singularity", m.t_k[a], weight, words, data)


def nearest(m, q):
    """Name, type, ζ (6,) in base axes and measure of the singularity nearest to `q`. ζ is that of the exact posture, found from `q` along the slope of σ."""
    exact, r = np.array(q), m.robot
    sigma_of = lambda q: r.decompose(r.move(q)[1])[1]
    sigma = sigma_of(exact[None])
    for _ in range(40 if sigma[0] > 0.15 * m.usual else 0):
        sigma = sigma_of(np.concatenate([exact[None], exact + 1e-5 * np.eye(r.dof)]))
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
    # The lost direction is a wrench at the hand, u: its force is the translation lost, wherever on the hand. A lost rotation is that of the wrist about itself.
    pose, J = r.move(at[None])
    force, moment = np.split(r.decompose(J)[0][0], 2)
    size, none = np.linalg.norm(force), np.zeros(3)
    turns = np.linalg.norm(one.direction[:3]) < 0.5 if one else size < 0.3
    wrist = r.arm.step_many(at[None])["p_BC"][0] - pose[0, :3, 3]
    if one and turns and np.linalg.norm(moment - np.cross(wrist, force / r.length)) < 0.3 * size:
        turns, one = False, None
    zeta = np.r_[none, one.direction[3:] if one else moment] if turns or size < 0.05 else np.r_[force, none]
    name, kind, measure = (one.name, one.type, here[one.name].measure) if one else ("unnamed", "unknown", float("nan"))
    return name, kind, zeta / np.linalg.norm(zeta), measure


# --- what happened ---


def stops(m):
    """Rests that were not asked for: the command goes on, or the motion ends within 0.1 s."""
    speed = norm(m.v * np.where(m.robot.turns, 1, 1 / m.robot.length))
    peak, back = np.quantile(speed, 0.95), max(2, int(0.15 / m.dt))
    asked = np.zeros(len(m.rows)) if m.S is None else norm(m.S)
    off = np.abs(m.qc - m.q).max(axis=1) if m.qc is not None else np.zeros(len(m.t))
    for a, b in runs(speed < max(0.04 * peak, 0.006)) if peak >= 0.01 else ():
        if a < back or m.t[b - 1] - m.t[a] < 0.15:
            continue
        inside = asked[(m.rows >= a) & (m.rows < b)]
        goes_on = len(inside) and np.median(inside) > 0.15 * np.quantile(asked, 0.9) or off[a:b].max() > 0.03 + 2 * np.quantile(off, 0.25)
        # The stop began where the arm last had most of its speed.
        start, before = max(0, a - 1 - np.argmax(speed[a - 1 :: -1] > 0.5 * peak)), speed[a - back : a].max()
        seconds = m.t[a - 1] - m.t[start]
        if goes_on or before > 0.5 * peak and seconds < 0.1:
            words = "while the command went on" if goes_on else f"from {before:.2f} rad/s within {seconds * 1000:.0f} ms"
            yield Effect("stopped", m.t[start], f"it came to rest at {m.t[a]:.2f} s {words}")
            return


def strays(m):
    """A joint that no longer follows its command, or a hand that no longer moves as asked."""
    if m.qc is not None:
        off, fast = np.abs(m.qc - m.q), np.abs(m.vc) + 1e-3
        moving = fast > 0.1 * np.quantile(fast, 0.95)
        delay = np.median(off[moving] / fast[moving]) if moving.any() else 0
        excess = (off - 3 * delay * fast - 0.05 - 3 * np.quantile(off, 0.2)).max(axis=1)
        if hit := long_run(excess > 0, m.t, 0.04):
            k, j = np.unravel_index(np.argmax(off[slice(*hit)]), off[slice(*hit)].shape)
            yield Effect("strayed", m.t[hit[0]], f"{m.robot.joints[j]} was up to {np.degrees(off[hit[0] + k, j]):.1f}° from its command")
    if m.asked_by in ("twist", "pose"):
        size, k = norm(m.S), np.arange(len(m.rows))
        # The hand may follow by up to 0.15 s later.
        late = [np.maximum(k - int(n * 0.05 / m.period), 0) for n in range(4)]
        off = np.min([norm(m.S[before] - m.W) for before in late], axis=0)
        if hit := long_run((off > 0.45 * size) & (size > 0.3 * np.quantile(size, 0.9)), m.t_k, 0.08):
            linear, angular = np.split((m.asked - m.V)[hit[0] + np.argmax(off[slice(*hit)])], 2)
            words = f"{1000 * np.linalg.norm(linear):.0f} mm/s and {np.degrees(np.linalg.norm(angular)):.0f}°/s off what was asked"
            yield Effect("strayed", m.t_k[hit[0]], f"the hand moved up to {words}")


def jumps(m):
    """A velocity that changes within 20 ms by a large part of what the joint can do."""
    reach = max(1, round(0.012 / m.dt))
    change = np.abs(slope(np.arange(len(m.t), dtype=float), m.v, reach)) * 2 * reach
    odd = change / np.where(np.isfinite(m.robot.velocity), m.robot.velocity, np.maximum(2.0, 2 * np.quantile(np.abs(m.v), 0.95, axis=0)))
    k, j = np.unravel_index(np.argmax(odd), odd.shape)
    if odd[k, j] > max(0.3, 6 * np.quantile(odd[:, j], 0.8)):
        first = np.argmax(odd[:, j] > 0.6 * odd[k, j])
        yield Effect("jumped", m.t[first], f"{m.robot.joints[j]} changed its speed by {change[k, j]:.2f} rad/s within {2 * reach * m.dt * 1000:.0f} ms")


# --- the likeliest cause ---


def find(log, m):
    """(effects in order of time, evidence ranked): the likeliest cause first; `none` where nothing happened."""
    if not m.fits:
        return [], [Evidence("another robot", 0.0, 1.0, (m.notes or ["the log does not fit the robot"])[-1])]
    looks = (nan, gap, command_jump, joint_limit, singularity, speed_limit, torque_limit, oscillation)
    found = {one.cause: one for look in looks if (one := look(log, m))}
    swing, lock, limit = found.get("oscillation"), found.get("singularity"), found.get("joint limit")
    seen = [*stops(m), *strays(m), *jumps(m)]
    if swing:
        seen.append(Effect("shook", swing.t, swing.text))
    if limit:
        seen.append(Effect("left limits", limit.t, limit.text))
    if lock and lock.data["by"] == "steady motion before":
        seen.append(Effect("strayed", lock.t, "the hand left the straight motion that it had been in"))
    if lock and lock.data["by"] == "joint motion":
        seen.append(Effect("jumped", lock.t, f"the joints' speed rose to {lock.data['needed']:.1f} rad/s within 0.4 s"))
    seen.sort(key=lambda one: one.t)
    for one in found.values():
        one.weight *= _fits_time(one, seen)
        if one.cause in ("torque limit", "speed limit") and swing and (one.data["flips"] > 1 or swing.t < one.t - 0.05):
            one.weight -= 0.2
    for one in found.values():
        one.weight -= _explained(one, found, lock)
    ranked = sorted(found.values(), key=lambda one: -one.weight)
    if seen and (not ranked or ranked[0].weight < 0.3):
        ranked.insert(0, Evidence("unknown", seen[0].t, 0.3, NO_CAUSE))
    return seen, ranked or [Evidence("none", 0.0, 0.3, "the arm did what it was asked")]


def _explained(one, found, lock):
    """By how much evidence counts less because another cause goes before it."""
    hole = found.get(GAP)
    # After a gap the command has moved on.
    if one.cause == JUMP and hole and hole.t - 0.02 <= one.t <= hole.data.get("until", hole.t) + 0.1:
        return 0.1
    # The hand's command is smooth, and what has become of it in joints is the singularity's.
    if one.cause == JUMP and one.data["role"] == "q_cmd" and lock and lock.data["by"] in ("twist", "pose") and lock.t < one.t:
        return 0.2
    return 0.15 * any(other.t < one.t - 0.25 and other.weight > 0.75 for other in found.values())


# How long a cause may begin after its first effect, s.
_AFTER = {"torque limit": 0.5, "speed limit": 0.03, GAP: 0.08, JUMP: 0.08, "oscillation": 0.5}


def _fits_time(one, seen):
    """How well a cause goes before what is seen: 1 where it begins at most a second before the first effect, and not after it."""
    if not seen or one.cause == "NaN":
        return 1.0
    from_outside = one.cause in (GAP, JUMP)
    # An oscillation is seen by a window that reaches before it.
    first = min([effect.t for effect in seen if effect.what != "shook" or not from_outside] or [seen[0].t])
    is_late = one.t >= first + _AFTER.get(one.cause, 0.25)
    # A drive that pushes against what has stopped it is no cause.
    if one.cause == "torque limit" and any(effect.what == "stopped" and effect.t < one.t - 0.03 for effect in seen):
        is_late = True
    if is_late:
        return 0.6 if from_outside else 0.35
    return 1.0 if first - one.data.get("until", one.t) < (0.6 if from_outside else 0.8) else 0.6
