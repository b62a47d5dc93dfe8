"""The incident in a log and its cause: evidence for each cause, ranked.

Each rule yields `Found` for one cause. `find` weighs them: a cause must come before what it explains, and what came in from outside (a NaN, a gap, a jump in
the command) goes before what the arm did about it.
"""

import numpy as np

from .motion import norm, slope, smooth

GAP, JUMP = "gap in the stamps", "jump in the command"
CAUSES = ("singularity", "joint limit", "speed limit", "torque limit", GAP, JUMP, "NaN", "oscillation", "another robot", "unknown", "none")
NO_CAUSE = "no limit, gap, jump, NaN, swing or singularity goes before it"


class Found:
    """A cause, or an effect (stopped, jumped, shook, left limits, strayed): `what`; `t`, when it began (s); `text`, a sentence; of a cause its `weight`, 0 to 1,
    and `data`, numbers for JSON."""

    def __init__(self, what, t, text, weight=0.0, **data):
        self.what, self.t, self.text, self.weight, self.data = what, t, text, weight, data


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


def nan(m):
    """A number that is none, in a column that is dense otherwise."""
    for role, stream in m.log.streams.items():
        broken = ~np.isfinite(stream.x.reshape(len(stream.x), -1)).all(axis=1)
        if broken.any() and not broken.all():
            t, rows = stream.t[np.argmax(broken)], broken.sum()
            yield Found("NaN", t, f"{stream.name} is NaN, infinite or missing from {t:.3f} s on, in {rows} of {len(broken)} rows", 0.97, role=role, rows=rows)


def gap(m):
    """Stamps that leave out several periods, of the state or of a command that came at a steady rate; or that run back."""
    for role, stream in m.log.streams.items():
        steps, t = np.diff(stream.t), stream.t
        if (steps < -1e-3).any():
            k = np.argmax(steps < -1e-3)
            yield Found(GAP, t[k], f"the stamps of {stream.name} run back by {-steps[k]:.3f} s", 0.8, seconds=steps[k])
        elif len(steps) >= 20 and (steps > 0).any():
            usual, k = np.median(steps[steps > 0]), np.argmax(steps)
            late, seconds = steps > max(4.5 * usual, usual + 0.04), steps[k]
            # A stream that comes now and then has no gaps.
            if late.any() and late.mean() <= 0.02 and np.quantile(steps, 0.9) <= 3 * usual:
                words = f"{'the log' if role == 'q' else stream.name} has no message for {seconds:.3f} s ({seconds / usual:.0f} periods)"
                yield Found(GAP, t[k], words, 0.92, seconds=seconds, until=t[k + 1], role=role)


def command_jump(m):
    """A step in the command that its neighbours do not announce."""
    for role, floor in (("q_cmd", 0.03), ("pose_cmd", 0.01), ("twist_cmd", 0.15)):
        stream, is_joints = m.log[role], role == "q_cmd"
        if stream is None or len(stream.t) < 12 or stream is m.log["q"]:
            continue
        x = stream.x[:, :3, 3] if role == "pose_cmd" else stream.x
        known = np.isfinite(x).all(axis=1)
        step, dt, t = np.diff(x[known], axis=0), np.diff(stream.t[known]), stream.t[known]
        # The part of a step beyond the mean of the ones around it; a gap's step may be as long as the gap.
        around, usual = (np.r_[step[:1], step[:-1]] + np.r_[step[1:], step[-1:]]) / 2, np.median(dt)
        odd = np.abs(step - around).max(axis=1) - 1.5 * np.abs(around).max(axis=1) * np.maximum(dt / usual - 1, 0)
        k = np.argmax(odd)
        fourth, size = np.sort(odd[max(0, k - 12) : k + 13])[-4], np.abs(step[k])
        if odd[k] >= max(floor, 4 * fourth) and dt[k] <= 4 * usual:
            j = np.argmax(size)
            part = f"moves {m.robot.joints[j]} by {np.degrees(step[k][j]):.1f}°" if is_joints else f"moves the pose by {1000 * norm(step[k]):.0f} mm"
            if role == "twist_cmd":
                if min(norm(x[known][k : k + 2])) < 0.05 * np.quantile(norm(x[known]), 0.9):
                    # It sets out, or ends.
                    continue
                part = f"changes the hand's speed by {1000 * norm(step[k][:3]):.0f} mm/s and {np.degrees(norm(step[k][3:])):.0f}°/s"
            yield Found(JUMP, t[k + 1], f"the command {part} from one message to the next", 0.95, role=role, step=size[j])


# --- limits ---


def joint_limit(m):
    """A joint that has come to its limit and rests there, or is told to go on."""
    r, back, n = m.robot, max(5, int(0.3 / m.dt)), m.robot.dof
    span = r.upper - r.lower
    room = np.tile(np.maximum(0.004, np.where(np.isfinite(span), 0.002 * span, 0)), 2)
    side, limit = np.repeat([1, -1], n), np.r_[r.upper, r.lower]
    beyond = lambda q: side * (np.tile(q, 2) - limit) + room
    state = beyond(m.q)
    for a, b, k in long_runs(state > 0, m.t, 0.05):
        j = k % n
        pushed = m.qc is not None and beyond(m.qc[a:b])[:, k].max() > 0
        came = a > 3 and state[a, k] - state[max(0, a - back), k] > 3 * room[k]
        if (a >= 5 or b <= 0.9 * len(m.t)) and (pushed or came):
            at = f"{np.degrees(limit[k]):.1f}°" if r.turns[j] else f"{1000 * limit[k]:.0f} mm"
            words = f"{r.joints[j]} is at its limit of {at} from {m.t[a]:.3f} s on{', and told to go on' if pushed else ''}"
            yield Found("joint limit", m.t[a], words, 0.9 if pushed else 0.84, joint=r.joints[j], limit=limit[k])


def speed_limit(m):
    """A joint at its largest speed for a while, or a command beyond it, of joints or of the hand."""
    limits = m.robot.velocity
    yield from _saturation(m, "speed limit", m.v, limits, 0.97, 0.78, "rad/s", m.vc)
    if m.asked_by in ("twist", "pose") and np.isfinite(limits).any():
        some = slice(None, None, max(1, len(m.rows) // 4000))
        inverse = np.linalg.pinv(m.J[some] * m.robot.scale[:, None], rcond=0.02)
        needed, t = np.abs(np.einsum("kji,ki->kj", inverse, m.S[some])) / limits, m.t_k[some]
        if hit := long_run((needed.max(axis=1) > 1.1) & (m.sigma[some] > 0.45 * m.usual), t, 0.03):
            j = np.argmax(needed[hit[0]])
            text = f"the hand was asked to move so fast that {m.robot.joints[j]} would need {needed[slice(*hit), j].max():.1f} times its largest speed"
            yield Found("speed limit", t[hit[0]], text, 0.77, joint=m.robot.joints[j], flips=0)


def torque_limit(m):
    """A drive at its largest torque for a while; alternating ends are an oscillation's."""
    if m.tau is not None:
        for one in _saturation(m, "torque limit", m.tau, m.robot.effort, 0.985, 0.8, "N·m"):
            # A drive that climbs to its limit gives way on the way there: from half of the way from its usual torque on.
            a, j = np.argmin(np.abs(m.t - one.t)), m.robot.joints.index(one.data["joint"])
            before = m.tau[: a + 1, j] * np.sign(m.tau[a, j])
            light = np.flatnonzero(before < (np.median(before) + one.data["limit"]) / 2)
            one.data["since"] = m.t[light[-1]] if len(light) else one.t
            yield one


def _saturation(m, cause, x, limits, share, weight, unit, command=None):
    found = [(run, "is at") for run in long_runs(np.abs(x) > share * limits, m.t, 0.03)]
    found += [(run, "is told to exceed") for run in long_runs(np.abs(command) > 1.03 * limits, m.t, 0.02)] if command is not None else []
    for (a, b, j), word in sorted(found)[:1]:
        second, joint, limit = x[a : a + max(3, int(1 / m.dt)), j], m.robot.joints[j], limits[j]
        flips = np.count_nonzero(np.diff(np.sign(second[np.abs(second) > share * limit])))
        seconds = m.t[b - 1] - m.t[a]
        words = f"{joint} {word} its limit of {limit:.3g} {unit} from {m.t[a]:.3f} s on, for {seconds:.2f} s"
        yield Found(cause, m.t[a], words, weight, joint=joint, limit=limit, flips=flips, seconds=seconds)


def oscillation(m):
    """A joint that swings to and fro at 2 Hz or more, several times, and more than before."""
    width = max(3, int(0.5 / m.dt))
    # Uneven stamps make speeds swing, too.
    jitter = 0 if m.log["qdot"] is not None else np.median(np.abs(np.diff(m.t) - m.dt)) / m.dt
    fast, size = m.v - smooth(m.v, max(3, int(0.16 / m.dt))), np.abs(m.v)
    power, turns = np.sqrt(np.maximum(smooth(fast**2, width), 0)), np.zeros_like(fast)
    for j in range(m.robot.dof):
        # Changes of sign between swings that count, not of noise around rest.
        swings = np.flatnonzero(np.abs(fast[:, j]) > 0.4 * power[:, j])
        turns[swings[1:][np.diff(np.sign(fast[swings, j])) != 0], j] = 1
    crossings = smooth(turns, width) * width
    least = np.maximum(np.maximum(0.05, 5 * np.quantile(power, 0.2, axis=0)), 0.12 * np.quantile(size, 0.9, axis=0))
    for a, b, j in long_runs((power > least) & (power > (0.15 + 3 * jitter) * smooth(size, width)) & (crossings >= 5), m.t, 0.2):
        k, middle = a + np.argmax(power[a:b, j]), (a + b) // 2
        # An oscillation that rings down after a stop or a blow is no cause.
        if power[middle:b, j].mean() >= 0.6 * power[a:middle, j].mean():
            # The window begins to see it up to half a width before its middle.
            t, hertz = m.t[min(a + width // 4, len(m.t) - 1) if a else 0], crossings[k, j] / 2 / (width * m.dt)
            words = f"{m.robot.joints[j]} swings at {hertz:.1f} Hz with up to {size[max(0, k - width) : k + width, j].max():.2f} rad/s"
            yield Found("oscillation", t, words, 0.76, joint=m.robot.joints[j], hertz=hertz, speed=power[k, j])


# --- the singularity ---


def singularity(m):
    """The arm near a lost direction ζ while the hand was asked to move along it, and did not, or only with far more joint speed than there is.

    The motion asked for is the twist or pose of the log; with joint commands alone, which pass any posture, it is the hand's steady motion before.
    """
    if m.asked_by in ("twist", "pose"):
        yield from _along(m, m.S, m.asked_by)
    else:
        if (steady := _steady(m)) is not None:
            yield from _along(m, steady, "steady motion before")
        yield from _amplified(m)


def _steady(m):
    """The hand's twist where it was constant for 0.3 s while the joints' speeds were not, as on a straight line; held from then on."""
    dt = m.period
    V, v = (smooth(x, max(1, int(0.04 / dt))) for x in (m.W, m.v_k))

    def change(x):
        width = max(4, int(0.3 / dt))
        size = norm(mean := smooth(x, width))
        return np.sqrt(np.maximum(smooth(norm(x) ** 2, width) - norm(mean) ** 2, 0)) / np.maximum(size, 1e-9), size

    (off, size), (joints, _) = change(V), change(v)
    # Slow is measured by what came before: afterwards, the incident may have swept the hand away.
    calm = (off < 0.03) & (off < 0.3 * joints) & (size > 0.3 * np.maximum.accumulate(size)) & (m.sigma > 0.2 * m.usual)
    if found := long_run(calm, m.t_k, 0.15):
        return np.where(np.arange(len(V))[:, None] >= found[0], np.median(V[slice(*found)], axis=0), 0)
    return None


def _along(m, S, by):
    t, v, missing, size = m.t_k, m.v_k, S - m.W, norm(S)
    dot = lambda a, b: np.abs(np.sum(a * b, axis=1))
    part, along, own = dot(m.u, S), dot(m.u, missing), dot(m.null, v)
    if not size.max() > 0:
        return
    share, need = part / np.maximum(size, 1e-12), part / np.maximum(m.sigma, 1e-6)
    # A command goes before the arm, and may be nearer to the singularity.
    need = need if m.vc is None else np.maximum(need, dot(m.null, m.vc[m.rows]))
    limit = _null_speed(m, 3 * np.quantile(norm(m.v), 0.9) + 1e-3)
    # Small arms are ill-conditioned everywhere: near is also far less than before.
    near = (m.sigma < 0.45 * np.maximum(m.usual, np.maximum.accumulate(m.sigma))) & (size > 0.1 * np.quantile(size, 0.95))
    is_fast = (need > limit) & ((share > 0.12) | (own > 0.6 * limit) & (own > 0.8 * norm(v)))
    is_lost = (share > 0.15) & (along > 0.15 * size) & (along > 0.8 * norm(missing)) & (need > 0.2 * limit)
    hit, halt, weight = long_run(near & (is_fast | is_lost), t, 0.03), _halt(m, S, size), 0.87
    if halt and (not hit or halt[0] < hit[0]):
        hit, weight = halt, 0.85
    if hit:
        # The lost direction of the incident's beginning; later, the arm may have gone on to another posture.
        a, b = hit if hit == halt else (hit[0], max(hit[0] + 1, min(hit[1], np.searchsorted(t, t[hit[0]] + 0.4) + 1)))
        weight -= 0.03 * (by == "steady motion before")
        yield _evidence(m, a, b, weight, share[a:b].max(), need[a:b].max(), limit, by, until=t[hit[1] - 1])


def _halt(m, S, size):
    """Where the hand slowed down to rest as the Jacobian's condition number rose, though asked to go on, as MoveIt Servo does it; or `None`."""
    t, kept = m.t_k, np.sum(m.W * S, axis=1) / np.maximum(size * size, 1e-12)
    going = size > 0.3 * np.maximum.accumulate(size)
    for a, b in runs((kept < 0.15) & (size > 0.3 * np.quantile(size, 0.9))):
        # A servo that sets out where it slows down already never gives all; the condition number then has less left to rise.
        most = min(np.quantile(kept[:a][going[:a]], 0.95), 1) if going[:a].any() else 0
        before = np.flatnonzero(kept[:a] > 0.85 * most) if most > 0.3 else ()
        if t[b - 1] - t[a] >= 0.1 and len(before) and t[a] - t[before[-1]] >= 0.05:
            first, last = np.linalg.cond(m.J[[before[-1], a]])
            if last > max(15, (1 + 0.3 * most) * first):
                return before[-1], b
    return None


def _null_speed(m, unlimited):
    """The largest speed along the arm's null direction, row by row, that the joints' limits allow."""
    return np.min(np.where(np.isfinite(m.robot.velocity), m.robot.velocity, unlimited) / np.maximum(np.abs(m.null), 1e-3), axis=1)


def _amplified(m):
    """Joint speed that grows along the arm's null direction while the hand's does not, in a log that has only joints."""
    v, V = (smooth(x, max(1, int(0.02 / m.period))) for x in (m.v_k, m.W))
    back, joint = np.maximum(np.arange(len(v)) - max(3, int(0.4 / m.period)), 0), norm(v)
    growth = lambda size: size / np.maximum(size[back], 0.1 * np.quantile(size, 0.9))
    share = np.abs(np.sum(m.null * v, axis=1)) / np.maximum(joint, 1e-9)
    grown = (growth(joint) > 2.2) & (growth(norm(V)) < 1.4) & (joint > 0.5 * joint.max()) & (back > 0)
    if hit := long_run(grown & (m.sigma < 0.4 * m.usual) & (share > 0.75), m.t_k, 0):
        yield _evidence(m, *hit, 0.82, None, joint[slice(*hit)].max(), _null_speed(m, np.inf), "joint motion")


def _evidence(m, a, b, weight, share, need, limits, by, **more):
    """The evidence of rows `a` to `b`, with the singularity where σ is smallest: its name, type and ζ are those of the analysis that all of armplane uses."""
    k = a + np.argmin(m.sigma[a:b])
    q, limit, condition, sigma = m.q[m.rows[k]], limits[k], min(np.linalg.cond(m.J[k]), 1e6), m.sigma[k]
    name, kind, zeta, measure = nearest(m, q)
    half, way = (zeta[3:], "rotation about") if norm(zeta[:3]) < 0.5 else (zeta[:3], "translation along")
    is_known = np.isfinite(limit)
    fast = f", which needs {min(need, 999):.1f} rad/s" + (f" of {limit:.1f} there are" if is_known else "") if need > limit or not is_known else ""
    asked = "the joints' speed grew while the hand's did not" if share is None else f"{share:.0%} of the motion asked for was along it{fast}"
    where = f"its {name} singularity ({kind}, s = {measure:.3f}" if name != "unnamed" else f"a singularity ({sigma / m.usual:.0%} of the usual smallest singular value"
    words = f"the arm is near {where}, condition number {condition:.0f}); lost is the {way} ({' '.join(f'{x:+.2f}' for x in half)}), and {asked}"
    return Found(
        "singularity", m.t_k[a], words, weight, name=name, type=kind, zeta=zeta, measure=measure, sigma=sigma, condition=condition, share=share,
        needed=min(need, 1e6), limit=limit if is_known else None, by=by, q=q, t_nearest=m.t_k[k], **more,
    )  # fmt: skip


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
    measures, one = {one.name: one.measure for one in r.arm.singularities(q)}, None
    for at in (exact, np.array(q)):
        listed = [one for one in r.arm.singularities(at) if one.inside and abs(measures.get(one.name, np.inf)) < 2 * one.exit]
        one = min(listed, key=lambda one: abs(one.measure) / max(one.exit, 1e-9), default=None)
        if sigma[0] < 0.15 * m.usual and np.abs(at - q).max() < 0.4 and one:
            break
    # The lost direction is a wrench at the hand, u: its force is the translation lost, wherever on the hand. A lost rotation is that of the wrist about itself.
    pose, J = r.move(at[None])
    force, moment = np.split(r.decompose(J)[0][0], 2)
    size, none = norm(force), np.zeros(3)
    turns = norm(one.direction[:3]) < 0.5 if one else size < 0.3
    wrist = r.arm.step_many(at[None])["p_BC"][0] - pose[0, :3, 3]
    if one and turns and norm(moment - np.cross(wrist, force / r.length)) < 0.3 * size:
        turns, one = False, None
    zeta = np.r_[none, one.direction[3:] if one else moment] if turns or size < 0.05 else np.r_[force, none]
    name, kind, measure = (one.name, one.type, measures[one.name]) if one else ("unnamed", "unknown", np.nan)
    return name, kind, zeta / norm(zeta), measure


# --- what happened ---


def stops(m):
    """Rests that were not asked for: the command goes on, or the motion ends within 0.1 s."""
    speed, t = norm(m.v * np.where(m.robot.turns, 1, 1 / m.robot.length)), m.t
    peak, back = np.quantile(speed, 0.95), max(2, int(0.15 / m.dt))
    asked = np.zeros(len(m.rows)) if m.S is None else norm(m.S)
    off = np.abs(m.qc - m.q).max(axis=1) if m.qc is not None else np.zeros(len(t))
    for a, b in runs(speed < max(0.04 * peak, 0.006)) if peak >= 0.01 else ():
        if a < back or t[b - 1] - t[a] < 0.15:
            continue
        inside, until = asked[(m.rows >= a) & (m.rows < b)], asked[(m.rows >= a - back) & (m.rows < a)]
        goes_on = len(inside) and np.median(inside) > 0.15 * np.quantile(asked, 0.9) or off[a:b].max() > 0.03 + 2 * np.quantile(off, 0.25)
        # The stop began where the arm last had most of its speed.
        start, before = max(0, a - 1 - np.argmax(speed[a - 1 :: -1] > 0.5 * peak)), speed[a - back : a].max()
        seconds = t[a - 1] - t[start]
        # Spare joints may move to the end of what the hand was asked for.
        is_over = len(until) and until.max() < 0.3 * np.quantile(asked, 0.9)
        if goes_on or before > 0.5 * peak and seconds < 0.1 and not is_over:
            words = "while the command went on" if goes_on else f"from {before:.2f} rad/s within {seconds * 1000:.0f} ms"
            yield Found("stopped", t[start], f"it came to rest at {t[a]:.2f} s {words}")
            return


def strays(m):
    """A joint that no longer follows its command, or a hand that no longer moves as asked."""
    if m.qc is not None:
        off, fast = np.abs(m.qc - m.q), np.abs(m.vc) + 1e-3
        moving = fast > 0.1 * np.quantile(fast, 0.95)
        delay = np.median(off[moving] / fast[moving]) if moving.any() else 0
        excess = (off - 3 * delay * fast - 0.05 - 3 * np.quantile(off, 0.2)).max(axis=1)
        if hit := long_run(excess > 0, m.t, 0.04):
            most = off[slice(*hit)].max(axis=0)
            j = np.argmax(most)
            yield Found("strayed", m.t[hit[0]], f"{m.robot.joints[j]} was up to {np.degrees(most[j]):.1f}° from its command")
    if m.asked_by in ("twist", "pose"):
        size, k = norm(m.S), np.arange(len(m.rows))
        # The hand may follow by up to 0.15 s later.
        off = np.min([norm(m.S[np.maximum(k - int(n * 0.05 / m.period), 0)] - m.W) for n in range(4)], axis=0)
        if hit := long_run((off > 0.45 * size) & (size > 0.3 * np.quantile(size, 0.9)), m.t_k, 0.08):
            linear, angular = np.split((m.asked - m.V)[hit[0] + np.argmax(off[slice(*hit)])], 2)
            words = f"{1000 * norm(linear):.0f} mm/s and {np.degrees(norm(angular)):.0f}°/s off what was asked"
            yield Found("strayed", m.t_k[hit[0]], f"the hand moved up to {words}")


def jumps(m):
    """A velocity that changes within 20 ms by a large part of what the joint can do."""
    reach = max(1, round(0.012 / m.dt))
    change = np.abs(slope(np.arange(len(m.t), dtype=float), m.v, reach)) * 2 * reach
    odd = change / np.where(np.isfinite(m.robot.velocity), m.robot.velocity, np.maximum(2, 2 * np.quantile(np.abs(m.v), 0.95, axis=0)))
    k, j = np.unravel_index(np.argmax(odd), odd.shape)
    if odd[k, j] > max(0.3, 6 * np.quantile(odd[:, j], 0.8)):
        first = np.argmax(odd[:, j] > 0.6 * odd[k, j])
        yield Found("jumped", m.t[first], f"{m.robot.joints[j]} changed its speed by {change[k, j]:.2f} rad/s within {2 * reach * m.dt * 1000:.0f} ms")


# --- the likeliest cause ---

# The rules, and by what the best of several findings of one is chosen; all alike, it is the first.
_ALIKE, _EARLY = lambda one: 0, lambda one: -one.t
RULES = {
    nan: _EARLY,
    gap: lambda one: (one.weight, one.data["seconds"]),
    command_jump: _ALIKE,
    joint_limit: _ALIKE,
    singularity: _ALIKE,
    speed_limit: _EARLY,
    torque_limit: _ALIKE,
    oscillation: lambda one: one.data["speed"],
}


def find(m):
    """(effects in order of time, evidence ranked): the likeliest cause first; `none` where nothing happened."""
    if not m.fits:
        return [], [Found("another robot", 0.0, (m.notes or ["the log does not fit the robot"])[-1], 1.0)]
    best = (max(rule(m), key=worth, default=None) for rule, worth in RULES.items())
    found = {one.what: one for one in best if one}
    swing, lock, limit = map(found.get, ("oscillation", "singularity", "joint limit"))
    seen = [*stops(m), *strays(m), *jumps(m)]
    seen += [Found(what, one.t, one.text) for what, one in (("shook", swing), ("left limits", limit)) if one]
    by = lock.data["by"] if lock else ""
    if by == "steady motion before":
        seen.append(Found("strayed", lock.t, "the hand left the straight motion that it had been in"))
    if by == "joint motion":
        seen.append(Found("jumped", lock.t, f"the joints' speed rose to {lock.data['needed']:.1f} rad/s within 0.4 s"))
    seen.sort(key=lambda one: one.t)
    if not seen and JUMP in found and found[JUMP].data["role"] == "twist_cmd":
        # The arm followed it.
        del found[JUMP]
    for one in found.values():
        one.weight *= _fits_time(one, seen, m)
        # An arm that swings reaches its limits, and has joint speeds that say nothing about where it is.
        follows = one.what in ("torque limit", "speed limit") or one is lock and by == "joint motion"
        if follows and swing and (one.data.get("flips", 0) > 1 or swing.t < one.t - 0.05):
            one.weight -= 0.2
    for one in found.values():
        one.weight -= _explained(one, found, lock)
    ranked = sorted(found.values(), key=lambda one: -one.weight)
    if seen and (not ranked or ranked[0].weight < 0.3):
        ranked.insert(0, Found("unknown", seen[0].t, NO_CAUSE, 0.3))
    return seen, ranked or [Found("none", 0.0, "the arm did what it was asked", 0.3)]


def _explained(one, found, lock):
    """By how much evidence counts less because another cause goes before it."""
    hole = found.get(GAP)
    # After a gap the command has moved on.
    if one.what == JUMP and hole and hole.t - 0.02 <= one.t <= hole.data.get("until", hole.t) + 0.1:
        return 0.1
    # The hand's command is smooth, and what has become of it in joints is the singularity's: jumps, and joints that race to their limits.
    in_joints = one.what == "joint limit" or one.what == JUMP and one.data["role"] == "q_cmd"
    if in_joints and lock and lock.data["by"] in ("twist", "pose") and lock.t < one.t:
        return 0.2
    return 0.15 * any(other.t < one.t - 0.25 and other.weight > 0.75 for other in found.values())


# How long a cause may begin after its first effect, s.
_AFTER = {"torque limit": 0.5, "speed limit": 0.03, GAP: 0.08, JUMP: 0.08, "oscillation": 0.5}


def _is_held(m, t):
    """Whether the hand stands still at `t` while it is asked to move on: something holds it, where under too heavy a load it would sink."""
    here = (m.t_k > t - 0.05) & (m.t_k < t + 0.25)
    if m.asked is None or not here.any():
        return False
    moves, asked = norm(m.V[:, :3]), norm(m.asked[:, :3])
    return np.median(moves[here]) < 0.25 * np.median(asked[here]) and np.median(asked[here]) > 0.3 * np.quantile(asked, 0.9)


def _fits_time(one, seen, m):
    """How well a cause goes before what is seen: 1 where it begins at most a second before the first effect, and not after it."""
    if not seen or one.what == "NaN":
        return 1
    from_outside = one.what in (GAP, JUMP)
    # An oscillation is seen by a window that reaches before it.
    first = min([effect.t for effect in seen if effect.what != "shook" or not from_outside] or [seen[0].t])
    # A drive that pushes against what has stopped it is no cause.
    stopped = any(effect.what == "stopped" and effect.t < one.t - 0.03 for effect in seen)
    pushes = one.what == "torque limit" and (stopped or _is_held(m, one.t))
    if pushes or one.data.get("since", one.t) >= first + _AFTER.get(one.what, 0.25):
        return 0.6 if from_outside else 0.35
    return 1 if first - one.data.get("until", one.t) < (0.6 if from_outside else 0.8) else 0.6
