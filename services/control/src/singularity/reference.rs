//! The way of a singularity's auxiliary coordinate: along the fold, out of the neighbourhood by the self-motion, or until ζ is out of the way.

use super::auxiliary_row::FOUND;
use super::family::Situation;
use super::tracker::SMALLEST;
use crate::linear::{Vector3, half_of, rotation_log, sign, smoothstep, wrap_line};
use crate::paper::reference::{Memory, Target};
use crate::paper::type_1::{Fold, SIDE_CHANGE};
use crate::paper::type_2;
use crate::types::{Class, Mode};
use shared_types::bounds::within;
use std::f64::consts::PI;

/// Damping of a fold's feed-forward, rad: of a coordinate that the geometry gives, and of a tracked one, which has more noise.
pub(super) const GEOMETRY_DAMPING: f64 = 0.01;
pub(super) const FOLD_DAMPING: f64 = 0.02;

/// Square of a fold's coordinate below zero at which the desired pose is beyond reach, not only rounded.
const BEYOND_REACH: f64 = -1e-7;

/// Damping of the gain where the path is followed, as a share of what it is at η_in; and the largest error answered to, rad.
const FOLLOW: (f64, f64) = (0.2, 0.1);

/// Curvature along a that is hardly any, unit-scaled.
const BENT: f64 = 1e-3;

/// Share of the gain below which both sides of a lock are as good; how far each is looked along, what one must have more in room, and the distance from
/// a joint limit at which the coordinate is not driven on, rad.
const UNSETTLED: f64 = 0.1;
const FAR: f64 = 2.0;
const NARROW: f64 = 0.1;
const ENDS_BEFORE: f64 = 0.02;

/// Rate at which a neighbourhood is left along the self-motion, rad/s.
const LEAVE: f64 = 0.8;

/// Angle between ζ and where it should be beyond which the path waits, rad; and the remaining motion of a leg below which its direction is
/// undefined, unit-scaled.
const AWAY: (f64, f64) = (0.1, 0.02);

/// Error along ζ, m and rad, from which on following the path by m is given up at the lock, where m has no direction; and the share of that error, and
/// how many times |s|, at which it is followed again.
const LOST: (f64, f64) = (0.0005, 0.003);
const AGAIN: (f64, f64) = (0.2, 1.5);

/// Error along ζ beyond which a goal beyond reach runs away, m: leaving a neighbourhood that can be left costs less.
const SLIDES: f64 = 0.01;

/// Angle near a quarter turn at which either way round is as good: the one taken before, rad.
const UNDECIDED: f64 = 1.4;

/// κ₂ below which ζ does not turn at all, below which the self-motion comes to an end and above which it has left it, and as which less counts.
const STILL: f64 = 1e-3;
const ENDS: (f64, f64) = (0.2, 0.3);
const SLOWEST_TURN: f64 = 0.1;

/// How a turn of ζ goes: not begun; by the shorter way; back from the end of that; by the other way; and neither leads on.
const FRESH: f64 = 0.0;
const TURNING: f64 = 1.0;
const BACK: f64 = 2.0;
const ROUND: f64 = 3.0;
const NEITHER: f64 = 4.0;

/// |s| over η_in within which ζ is turned to what is left of the leg, and not to the error alone; and the bend below which its direction is
/// undefined, unit-scaled.
const AHEAD: f64 = 0.25;
const BEND: f64 = 0.01;

/// Rate asked for over the largest one above which a lock is passed straight, where the clock does not wait.
const PASS_RATIO: f64 = 1.8;

/// Curvature of a one-sided fold that is none, unit-scaled.
const FLAT: f64 = 0.02;

/// Distance to a joint limit that counts as free, rad: further away it does not matter to which side a neighbourhood is left.
const ROOM: f64 = 0.5;

/// Distance along the self-motion that settles on which side of the lock the arm is; and from which on it keeps that side, though the other has more
/// room, rad.
const SIDE: (f64, f64) = (0.01, 0.1);

impl<const N: usize> Situation<'_, N> {
    /// The coordinate y of a fold as the desired pose needs it: y_d² = y² + 2ζᵀe/h with h = −κ₁, because the motion along ζ is h·y²/2 and ζ points outwards.
    ///
    /// `damping` is one of the feed-forward. Units rad, rad/s · Ensures a size of 0 and no rate where the desired pose is beyond reach · Errors `None`: a curvature that is none · Cost O(1), no
    /// allocation
    pub(super) fn fold(&self, damping: f64) -> Option<Fold> {
        let s = self.s;
        if s.kappa_1.is_nan() || s.kappa_1 <= 1e-6 {
            return None;
        }
        let per_curvature = -1.0 / s.kappa_1;
        let square = s.aux * s.aux + 2.0 * per_curvature * s.zeta_B.dot(self.error);
        let size = square.max(0.0).sqrt();
        let growth = per_curvature * self.along();
        let clipped = square < BEYOND_REACH;
        Some(Fold::new(s.aux, size, growth, size, damping, clipped))
    }

    /// How far the auxiliary coordinate of a vector measure moves: as the path needs it to the second order, damped.
    ///
    /// At the lock that leads nowhere if a has no curvature towards the path. Only then the type decides: the lock is left along the self-motion, or ζ
    /// turned out of the way.
    pub(super) fn direction(&self, length_m: f64, memory: &mut Memory) -> Option<Target> {
        let s = self.s;
        let (share, times) = if memory.passing { AGAIN } else { (1.0, 1.0) };
        let most = share * if s.angular { LOST.1 } else { LOST.0 };
        let x = s.zeta_B.dot(self.error);
        let off = x.abs().max(s.zeta_B.dot(self.opening).abs());
        let is_lost = s.s < times * FOUND && off > most;
        // A row that hardly bends has its vertex too far away to be a place to go to.
        let least = BENT * if s.angular { 1.0 } else { length_m };
        let is_bent = s.s < s.eta_out && s.kappa_1.abs() > least;
        let k = if is_bent { -s.kappa_1 } else { 0.0 };
        let strategy = match s.class {
            Class::Mixed | Class::Type2 if self.clips && self.slides(memory) => Some(Target {
                weight: 1.0,
                mode: Mode::Slide,
                clipped: true,
                ..Target::default()
            }),
            Class::Mixed if is_lost && !is_bent => Some(self.leave(memory)),
            Class::Type2 if is_lost && k * x <= 0.0 => self.aside(memory),
            _ => None,
        };
        strategy.or_else(|| {
            memory.passing = false;
            let way = self.follow(k, memory);
            // Another direction of Π bends the other way: the path waits until the lock is left along the self-motion.
            let waits = way.clipped && s.class == Class::Mixed && !self.clips;
            Some(match waits {
                true => Target {
                    mode: Mode::Pass,
                    clipped: false,
                    ..way
                },
                false => way,
            })
        })
    }

    /// The desired motion along ζ without the share that the kept motion has along it, which the auxiliary coordinate does not repeat; m/s or rad/s.
    fn along(&self) -> f64 {
        let s = self.s;
        let moved = s.zeta_B.dot(&(self.at.J * self.qdot_planned));
        let carried = moved - s.slope() * s.aux_row.dot(self.qdot_planned);
        s.zeta_B.dot(&self.desired.V) - carried
    }

    /// The rest of the leg, in the half that ζ takes; rad or m.
    fn left_of_leg(&self) -> Vector3 {
        let s = self.s;
        let end = self.ahead.pose(1.0);
        if s.angular {
            rotation_log(&(end.R * self.terms.X_BE.R.transpose()))
        } else {
            end.p - self.at.p
        }
    }

    /// The goal of ζ of a signed measure: turned until the desired motion is orthogonal to it, or as far along ζ as a one-sided fold leads.
    ///
    /// `length_m` makes radians of metres. `None`: neither turns ζ nor moves the end-effector along it, and ζ is held.
    pub(super) fn signed(&self, length_m: f64, memory: &mut Memory) -> Option<Target> {
        let s = self.s;
        let unit = if s.angular { 1.0 } else { length_m };
        let is_fold = s.class == Class::Mixed && s.kappa_1 > FLAT * unit;
        if s.kappa_2 <= STILL && !is_fold {
            memory.passing = false;
            return None;
        }
        let along = self.along();
        Some(if is_fold {
            self.one_sided(along, unit, memory)
        } else {
            self.turned(along, unit, memory)
        })
    }

    /// ζ turned by the angle at which the bend b is along what it should be: tan ε = (ζ·b_d)/(t·b_d), b_d = r·t + e.
    ///
    /// t = ζ×y is the direction in which a posture off the lock is bent, y the second axis of the singular frame, and r = gain/κ₂ how far; the
    /// auxiliary coordinate turns b about y. e is the pose error; deep in the neighbourhood, where r is small, what is left of the leg.
    fn turned(&self, along: f64, unit: f64, memory: &mut Memory) -> Target {
        let s = self.s;
        let (zeta, t) = (s.axis(), s.axis().cross(&s.R_BS.column(1)));
        let error = half_of(self.error, s.angular);
        let ahead = if self.is_hasty(&error, (&zeta, &t)) {
            1.0
        } else {
            1.0 - smoothstep(s.s.abs() / (AHEAD * s.eta_in))
        };
        let e = error + (self.left_of_leg() - error) * ahead;
        let kappa_2 = s.kappa_2.max(SLOWEST_TURN);
        let (across, bend) = (e.dot(&zeta), s.gain / kappa_2 + e.dot(&t));
        let square = across * across + bend * bend;
        let least = BEND * unit;
        let weight = square / (square + least * least);
        let angle = wrap_line(libm::atan2(across, bend));
        let Some(angle) = self.decided(angle, memory) else {
            return type_2::held();
        };
        let error = if memory.passage >= BACK {
            angle / kappa_2
        } else {
            self.within_limits(angle / kappa_2, PI / kappa_2)
        };
        let rate = (bend * along - across * half_of(&self.desired.V, s.angular).dot(&t))
            / (square + least * least);
        memory.holding = weight < if memory.holding { 0.5 } else { 0.3 };
        Target {
            error,
            rate: rate / kappa_2 * (1.0 - ahead),
            weight,
            mode: if memory.holding {
                Mode::Hold
            } else {
                Mode::Track
            },
            ..Target::default()
        }
    }

    /// Whether the bend, on its way at the desired velocity, passes the lock so nearly that no rate allowed turns ζ around it, and no clock waits for it.
    fn is_hasty(&self, error: &Vector3, (zeta, t): (&Vector3, &Vector3)) -> bool {
        let s = self.s;
        let V = half_of(&self.desired.V, s.angular);
        let (across, bend) = (
            error.dot(zeta),
            s.gain / s.kappa_2.max(SLOWEST_TURN) + error.dot(t),
        );
        let (v, w) = (V.dot(zeta), V.dot(t));
        let most = PASS_RATIO * self.rate_max * s.kappa_2;
        !self.governed
            && s.inside
            && v * v + w * w > most * (across * w - bend * v).abs()
            && libm::hypot(v, w) > STILL
    }

    /// The way round by which ζ turns through `angle`: of two that are as long, the one taken before. `None`: neither leads there.
    ///
    /// A self-motion may end before ζ is where it should be: κ₂ vanishes there, and the other way round is tried, once.
    fn decided(&self, angle: f64, memory: &mut Memory) -> Option<f64> {
        let s = self.s;
        let (ends, away) = (s.kappa_2 < ENDS.0, angle.abs() > AWAY.0);
        memory.passage = match memory.passage {
            _ if !s.inside => FRESH,
            TURNING | NEITHER if !away => FRESH,
            FRESH if !ends => TURNING,
            TURNING if ends => {
                memory.side = -sign(angle >= 0.0);
                BACK
            }
            BACK if s.kappa_2 > ENDS.1 => ROUND,
            ROUND if ends => NEITHER,
            state => state,
        };
        match memory.passage {
            FRESH if ends && away && s.inside => None,
            NEITHER => None,
            BACK => Some(memory.side * UNDECIDED),
            ROUND if angle * memory.side < 0.0 => Some(angle + memory.side * PI),
            _ if angle.abs() > UNDECIDED && memory.side != 0.0 => Some(angle.abs() * memory.side),
            _ => {
                memory.side = sign(angle >= 0.0);
                Some(angle)
            }
        }
    }

    /// Whether the joints have room for the auxiliary coordinate to move so far.
    fn fits(&self, by: f64) -> bool {
        (0..N).all(|i| {
            let q = self.q[i] + self.null_motion[i] * by;
            self.null_motion[i].abs() < 1e-3
                || q > self.model.lower()[i] && q < self.model.upper()[i]
        })
    }

    /// The same line reached the other way round, half a turn from `error`, where the joints allow only that.
    fn within_limits(&self, error: f64, half_turn: f64) -> f64 {
        let other = error - half_turn.copysign(error);
        if !self.fits(error) && self.fits(other) {
            other
        } else {
            error
        }
    }

    /// A fold whose ζ turns, too: the motion along ζ is x = g·y − κ₁y²/2 with g = gain + κ₂(t·e), so y = (g ∓ √(g² − 2κ₁x))/κ₁ for x = ζ·e.
    ///
    /// ζ points outwards: where no y leads that far, the largest x is taken, and the goal is beyond reach.
    fn one_sided(&self, along: f64, unit: f64, memory: &mut Memory) -> Target {
        let s = self.s;
        let (zeta, t) = (s.axis(), s.axis().cross(&s.R_BS.column(1)));
        let e = half_of(self.error, s.angular);
        let (x, g) = (zeta.dot(&e), s.gain + s.kappa_2 * t.dot(&e));
        let square = g * g - 2.0 * s.kappa_1 * x;
        let root = square.max(0.0).sqrt();
        // The sign of dx/dy is the side of the fold.
        if memory.side == 0.0 || s.s.abs() > s.eta_in {
            memory.side = sign(s.gain >= 0.0);
        }
        let on = |side: f64| (g - side * root) / s.kappa_1;
        let is_other = !self.fits(on(memory.side)) && self.fits(on(-memory.side));
        let side = memory.side * sign(!is_other);
        let clipped = square < BEYOND_REACH * unit * unit;
        let damping = FOLD_DAMPING * unit;
        Target {
            error: on(side),
            rate: if clipped {
                0.0
            } else {
                along * side * root / (root * root + damping * damping * s.kappa_1 / unit)
            },
            weight: 1.0,
            mode: slid(clipped),
            clipped,
            ..Target::default()
        }
    }

    /// Whether the goal beyond reach runs away along ζ: no self-motion leads there, and the arm stays at the boundary.
    fn slides(&self, memory: &mut Memory) -> bool {
        let s = self.s;
        let off = s.zeta_B.dot(self.error).abs() / if s.angular { AWAY.0 } else { SLIDES };
        memory.holding = off > if memory.holding { 0.5 } else { 1.0 };
        if memory.holding {
            memory.passing = false;
        }
        memory.holding
    }

    /// The auxiliary coordinate follows the path: g·y + k·y²/2 is the desired motion along ζ less what the kept motion carries there, damped.
    ///
    /// If no y leads that far, that with the farthest is taken, and the goal is beyond reach.
    fn follow(&self, k: f64, memory: &mut Memory) -> Target {
        let s = self.s;
        let (x, g) = (s.zeta_B.dot(self.error), s.slope());
        let square = g * g + 2.0 * k * x;
        let root = square.max(0.0).sqrt();
        let clipped = square < BEYOND_REACH;
        let room = |side, most| (self.room(side, most) - ENDS_BEFORE).max(0.0);
        let towards = memory.side * x.signum();
        if g.abs() > UNSETTLED * root {
            memory.side = sign(g >= 0.0);
        } else if room(towards, FAR) + NARROW < room(-towards, FAR) {
            memory.side = -memory.side;
        }
        let damping = FOLLOW.0 * s.gain * s.eta_in / s.s.max(SMALLEST);
        let inverse = |slope: f64| slope / (slope * slope + damping * damping).max(SMALLEST);
        let (error, rate) = if clipped {
            (-g / k, 0.0)
        } else {
            let slope = memory.side * root;
            // The last solution carries the more the higher this rate is: without a bound the two may grow together.
            let rate = self.along() * inverse(slope);
            let rate = rate.max(-self.rate_max).min(self.rate_max);
            (2.0 * x * inverse(g + slope), rate)
        };
        Target {
            error: error.clamp(-room(-1.0, FOLLOW.1), room(1.0, FOLLOW.1)),
            rate,
            weight: 1.0,
            mode: slid(clipped),
            clipped,
            ..Target::default()
        }
    }

    /// ζ turned until what is left of the leg lies in its orthogonal complement [CK95 §4]: ζ(ε) = ζ cos ε + T sin ε, T = y×ζ with y the second axis of
    /// the singular frame, meets ζ(ε)·d = 0 at tan ε = −(ζ·d)/(T·d).
    fn aside(&self, memory: &mut Memory) -> Option<Target> {
        let s = self.s;
        if within(s.kappa_2.abs(), ENDS.0) {
            memory.passing = false;
            return None;
        }
        let d = self.left_of_leg() + half_of(self.opening, s.angular);
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
        Some(Target {
            error: angle / s.kappa_2,
            weight,
            mode: match (memory.passing, memory.holding) {
                (true, _) => Mode::Pass,
                (_, true) => Mode::Hold,
                _ => Mode::Track,
            },
            ..Target::default()
        })
    }

    /// How far the auxiliary coordinate can move to this side before a joint that takes part in it is at its limit, rad; at most `most`.
    fn room(&self, side: f64, most: f64) -> f64 {
        (0..N).fold(most, |room, i| {
            let by = side * self.null_motion[i];
            let left = if by > 0.0 {
                self.model.upper()[i] - self.q[i]
            } else {
                self.q[i] - self.model.lower()[i]
            };
            if by.abs() > 0.1 {
                room.min(left / by.abs())
            } else {
                room
            }
        })
    }

    /// The side of a fold to which the arm changes while it is at the fold, because a joint limit is near on the other: −1 or +1; 0: it keeps its side.
    pub(crate) fn roomier(&self, side: f64) -> i32 {
        let s = self.s;
        let is_narrow = self.room(side, ROOM) < ROOM && self.room(-side, ROOM) >= ROOM;
        if s.aux.abs() < SIDE_CHANGE && is_narrow {
            -side as i32
        } else {
            0
        }
    }

    /// Out of the neighbourhood along the self-motion: away from the lock, or where that direction is undefined, to where the joints have more room.
    fn leave(&self, memory: &mut Memory) -> Target {
        let s = self.s;
        let room = |side| self.room(side, FAR);
        let decided = s.aux.abs() > SIDE.0;
        if !memory.passing || decided && s.aux * memory.side < 0.0 {
            let more = sign(room(1.0) >= room(-1.0));
            let away = if decided { s.aux.signum() } else { more };
            let is_narrow = room(away) + NARROW < room(-away);
            let changes = room(away) < NARROW || is_narrow && s.aux.abs() < SIDE.1;
            memory.side = away * sign(!changes);
            memory.passing = true;
        }
        let rate = memory.side * LEAVE.min(self.rate_max);
        Target {
            rate,
            weight: 1.0,
            mode: Mode::Pass,
            ..Target::default()
        }
    }
}

/// The mode of a coordinate that follows the path, or has been `clipped` to the boundary of reach.
fn slid(clipped: bool) -> Mode {
    if clipped { Mode::Slide } else { Mode::Track }
}
