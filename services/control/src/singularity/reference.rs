//! Where the auxiliary coordinate of a tracked direction goes: along the fold, out of the neighbourhood by the self-motion, or until ζ is out of the way.

use super::family::Situation;
use super::tracker::SMALLEST;
use crate::linear::{rotation_log, sign, smoothstep, wrap_line};
use crate::paper::reference::Memory;
use crate::paper::type_1::Fold;
use crate::paper::type_2::{Direction, TURNS};
use crate::types::{Class, Singularity};
use shared_types::bounds::within;

/// Damping of a fold's feed-forward, rad.
const FOLD_DAMPING: f64 = 0.02;

/// Square of a fold's coordinate below zero at which the desired pose is beyond reach, not only rounded.
const BEYOND_REACH: f64 = -1e-7;

/// |s| over η_in from which on the path is followed again, and by which alone.
const FOLLOWING: (f64, f64) = (0.9, 1.3);

/// Damping of the gain where the path is followed, as a share of what it is at η_in; and the largest error answered to, rad.
const FOLLOW: (f64, f64) = (0.2, 0.1);

/// Rate at which a neighbourhood is left along the self-motion, rad/s.
const LEAVE: f64 = 0.8;

/// Angle between ζ and where it should be beyond which the path waits, rad; and the remaining motion of a leg below which its direction is
/// undefined, unit-scaled.
const AWAY: (f64, f64) = (0.1, 0.02);

/// Error along ζ beyond which a goal beyond reach runs away, m: leaving a neighbourhood that can be left costs less.
const SLIDES: f64 = 0.01;

/// Angle near a quarter turn at which either way round is as good: the one taken before, rad.
const UNDECIDED: f64 = 1.4;

/// Distance to a joint limit that leaving must find free, rad.
const ROOM: f64 = 0.3;

/// Distance along the self-motion that settles on which side of the lock the arm is, rad.
const SIDE: f64 = 0.01;

/// The coordinate y of a fold as the desired pose needs it: y_d² = y² + 2ζᵀe/h with h = −κ₁, because the motion along ζ is h·y²/2 and ζ points outwards.
///
/// Units rad, rad/s · Ensures a size of 0 and no rate where the desired pose is beyond reach · Errors `None`: a curvature that is none · Cost O(1), no
/// allocation
pub(super) fn fold<const N: usize>(s: &Singularity<N>, at: &Situation<'_, N>) -> Option<Fold> {
    if s.kappa_1.is_nan() || s.kappa_1 <= 1e-6 {
        return None;
    }
    let per_curvature = -1.0 / s.kappa_1;
    let square = s.aux * s.aux + 2.0 * per_curvature * s.zeta_B.dot(at.error);
    let (clipped, size) = (square < BEYOND_REACH, square.max(0.0).sqrt());
    let damped = size * size + FOLD_DAMPING * FOLD_DAMPING;
    let rate = if clipped {
        0.0
    } else {
        per_curvature * s.zeta_B.dot(&at.desired.V) * size / damped
    };
    Some(Fold {
        x: s.aux,
        size,
        rate,
        clipped,
    })
}

/// Where ζ should be, or how the neighbourhood is left: by the type.
pub(super) fn direction<const N: usize>(
    s: &Singularity<N>,
    at: &Situation<'_, N>,
    memory: &mut Memory,
) -> Option<Direction> {
    let inside = match s.class {
        Class::Mixed | Class::Type2 if at.clips && slides(s, at, memory) => Some(Direction {
            weight: 1.0,
            clipped: true,
            ..Direction::default()
        }),
        Class::Mixed => Some(leave(s, at, memory)),
        Class::Type2 => aside(s, at, memory),
        _ => None,
    };
    let (error, rate) = follow(s, at);
    let share = smoothstep((s.s / s.eta_in - FOLLOWING.0) / (FOLLOWING.1 - FOLLOWING.0));
    if share > 0.99 {
        memory.passing = false;
    }
    let follows = Direction {
        error,
        rate,
        weight: 1.0,
        ..Direction::default()
    };
    let Some(inside) = inside.filter(|_| share <= 0.99) else {
        return (share > 0.0).then_some(Direction {
            error: share * error,
            rate: share * rate,
            ..follows
        });
    };
    let mix = |inside: f64, outside: f64| inside + share * (outside - inside);
    Some(Direction {
        error: mix(inside.error * inside.weight, error),
        rate: mix(inside.rate, rate),
        weight: 1.0,
        ..inside
    })
}

/// Whether the goal beyond reach runs away along ζ: no self-motion leads there, and the arm stays at the boundary.
fn slides<const N: usize>(s: &Singularity<N>, at: &Situation<'_, N>, memory: &mut Memory) -> bool {
    let off = s.zeta_B.dot(at.error).abs() / if s.angular { AWAY.0 } else { SLIDES };
    memory.holding = off > if memory.holding { 0.5 } else { 1.0 };
    if memory.holding {
        memory.passing = false;
    }
    memory.holding
}

/// Error (rad) and rate (rad/s) by which the auxiliary coordinate follows the path: ζᵀV_d = g·ẏ, damped.
fn follow<const N: usize>(s: &Singularity<N>, at: &Situation<'_, N>) -> (f64, f64) {
    let entry = FOLLOW.0 * s.gain * s.eta_in / s.s.max(SMALLEST);
    let inverse = s.gain / (s.gain * s.gain + entry * entry).max(SMALLEST);
    let error = s.zeta_B.dot(at.error) * inverse;
    (
        (error).clamp(-FOLLOW.1, FOLLOW.1),
        (s.zeta_B.dot(&at.desired.V) * inverse).clamp(-at.rate_max, at.rate_max),
    )
}

/// ζ turned until what is left of the leg lies in its orthogonal complement [CK95 §4]: ζ(ε) = ζ cos ε + T sin ε, T = y×ζ with y the second axis of
/// the singular frame, meets ζ(ε)·d = 0 at tan ε = −(ζ·d)/(T·d).
fn aside<const N: usize>(
    s: &Singularity<N>,
    at: &Situation<'_, N>,
    memory: &mut Memory,
) -> Option<Direction> {
    if !s.inside || within(s.kappa_2.abs(), TURNS) {
        memory.passing = false;
        return None;
    }
    let end = at.ahead.pose(1.0);
    let d = if s.angular {
        rotation_log(&(end.R * at.terms.X_BE.R.transpose()))
    } else {
        end.p - at.at.p
    };
    let (zeta, T) = (s.axis(), s.R_BS.column(1).cross(&s.axis()));
    let (along, across) = (zeta.dot(&d), T.dot(&d));
    let square = along * along + across * across;
    let weight = square / (square + AWAY.1 * AWAY.1);
    let angle = wrap_line(libm::atan2(-along, across));
    if memory.side == 0.0 || angle.abs() < UNDECIDED {
        memory.side = sign(angle >= 0.0);
    }
    let angle = if angle.abs() < UNDECIDED {
        angle
    } else {
        angle.abs() * memory.side
    };
    memory.passing = angle.abs() * weight > if memory.passing { 0.3 } else { 1.0 } * AWAY.0;
    memory.holding = weight < if memory.holding { 0.5 } else { 0.3 };
    Some(Direction {
        error: angle / s.kappa_2,
        rate: 0.0,
        weight,
        passing: memory.passing,
        holding: memory.holding,
        clipped: false,
    })
}

/// Out of the neighbourhood along the self-motion: away from the lock, or where that direction is undefined, to where the joints have more room.
fn leave<const N: usize>(
    s: &Singularity<N>,
    at: &Situation<'_, N>,
    memory: &mut Memory,
) -> Direction {
    if !s.inside {
        memory.passing = false;
        return Direction {
            weight: 1.0,
            ..Direction::default()
        };
    }
    let room = |side: f64| {
        (0..N).fold(ROOM, |room, i| {
            let by = side * s.aux_row[i];
            let left = if by > 0.0 {
                at.upper[i] - at.q[i]
            } else {
                at.q[i] - at.lower[i]
            };
            if by.abs() > 0.1 {
                room.min(left / by.abs())
            } else {
                room
            }
        })
    };
    let decided = s.aux.abs() > SIDE;
    if !memory.passing || decided && s.aux * memory.side < 0.0 {
        let more = sign(room(1.0) >= room(-1.0));
        let away = if decided { s.aux.signum() } else { more };
        memory.side = if room(away) < 0.1 { -away } else { away };
        memory.passing = true;
    }
    let rate = memory.side * LEAVE.min(at.rate_max);
    Direction {
        error: 0.0,
        rate,
        weight: 1.0,
        passing: true,
        holding: false,
        clipped: false,
    }
}
