//! The singular rows. Step 2 of a tick: for each singularity the target by its type, the mode by the transition table, the auxiliary loop's demand, and
//! the row with which it enters the solve.

use super::Engaged;
use super::auxiliary::{Demand, Gains};
use crate::controller::Setup;
use crate::limits::range::Room;
use crate::linear::{Joints, Vector6, sign};
use crate::paper::operational_space::Operational;
use crate::paper::reference::Target;
use crate::paper::singular_frame::orthogonal_rows;
use crate::paper::type_1::{self, SIDE_CHANGE};
use crate::paper::type_2;
use crate::reference::guide::{Guide, WAIT};
use crate::reference::turn;
use crate::singularity::family::Situation;
use crate::state::State;
use crate::tick::{Motion, Now};
use crate::types::{Class, Mode, Refusal, Report, Singularity};
use model::TaskAxes;
use nalgebra::SMatrix;
use shared_types::MAX_SINGULARITIES;
use shared_types::scenario::Strategy;

/// Slope per length of the arm from which on a side of a fold is the plan's, and how far the plan is looked along for it, s.
const SIDE: f64 = 0.01;
const SIDE_S: f64 = 0.25;
/// Dampings of a slope, per length of the arm: of the way to where a force has the hand, and of the rate.
const DAMPING: f64 = 0.08;
const STEADY: f64 = 0.02;

/// Step 2's result: the singularities that take part in the solve, and by place in the report what is shown of each.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SingularRows<const N: usize> {
    list: [Engaged<N>; MAX_SINGULARITIES],
    count: usize,
    /// a* whose feedback along a lost direction asks no auxiliary coordinate for more than its largest rate: a hold is left without a leap.
    pub(crate) a: Vector6,
    /// Largest share of an auxiliary rate at full clock speed.
    pub(crate) load: f64,
    pub(crate) beta: [f64; MAX_SINGULARITIES],
    pub(crate) aux_d: [f64; MAX_SINGULARITIES],
    pub(crate) aux_rate_d: [f64; MAX_SINGULARITIES],
    pub(crate) clipped: bool,
}

impl<const N: usize> SingularRows<N> {
    /// None of them: a* is the motion's.
    fn none(a: Vector6) -> Self {
        let nothing = Engaged {
            zeta_B: Vector6::zeros(),
            gain: 0.0,
            beta: 1.0,
            aux_row: Joints::zeros(),
            aux_acceleration: 0.0,
            aux_rate: 0.0,
        };
        Self {
            list: [nothing; MAX_SINGULARITIES],
            count: 0,
            a,
            load: 0.0,
            beta: [1.0; MAX_SINGULARITIES],
            aux_d: [0.0; MAX_SINGULARITIES],
            aux_rate_d: [0.0; MAX_SINGULARITIES],
            clipped: false,
        }
    }

    /// The singularities that take part in the solve.
    pub(crate) fn engaged(&self) -> &[Engaged<N>] {
        &self.list[..self.count]
    }
}

/// Step 2.
///
/// # Errors
/// [`Refusal::Unlisted`] where more directions are lost than singularities are inside their neighbourhoods, [`Refusal::Room`] where a commanded turn of ζ
/// has none.
pub(crate) fn engaged<const N: usize>(
    setup: &Setup<N>,
    state: &mut State<N>,
    now: &Now<'_, N>,
    motion: &Motion<N>,
) -> Result<SingularRows<N>, Refusal> {
    check_rank(setup, now.report)?;
    let (control, dt_s) = (&setup.scenario.control, setup.scenario.dt_s());
    let ahead = setup.path.ahead(&state.progress, *now.p_EC);
    let planned = state.qdot_planned;
    let mut out = SingularRows::none(motion.a);
    let mut gains = [Gains::default(); MAX_SINGULARITIES];
    for (i, s) in now.report.listed().iter().enumerate() {
        gains[i] = Gains::of(setup, i, s);
    }
    // A path whose joint nears its limit is refused; a reference arm goes on beside it.
    let is_steered = setup.scenario.servo.is_some();
    let null_motions = is_steered.then(|| null_motions(setup, state, now));
    for (one, w) in gains.iter_mut().zip(null_motions.iter().flatten()) {
        one.room = Room::of(now.q, w, one.rate_max, &setup.model);
    }
    // The motion by which the folds open that come before a singularity.
    let mut opening = Vector6::zeros();
    for (i, s) in now.report.listed().iter().enumerate() {
        let fold = Opening::of(&gains, i, now, motion);
        let bounds = Gains {
            rate_max: fold.rate_max,
            ..gains[i]
        };
        let is_higher = setup.family.has_higher_codimension(i);
        let situation = Situation {
            s,
            q: now.q,
            qdot_planned: &planned,
            terms: now.terms,
            at: now.at,
            desired: &motion.desired,
            ahead: &ahead,
            error: &motion.error,
            null_motion: null_motions
                .as_ref()
                .filter(|_| !is_higher)
                .map_or(&s.aux_row, |motions| &motions[i]),
            opening: &opening,
            model: &setup.model,
            rate_max: bounds.rate_max,
            governed: control.governor,
            clips: motion.clips,
        };
        let target = target(setup, state, i, &situation, (now, motion))?;
        opening += fold.per_aux * target.error;
        let one = &mut state.loops[i];
        let is_hard = control.strategy == Strategy::ChangKhatib;
        let demand = one.step(s, &target, &bounds, is_hard, (motion.clock, dt_s));
        let withheld = bounds.room.joint_at(one.rate).filter(|_| one.engaged());
        state.targets.withheld = state.targets.withheld.or(withheld);
        if control.strategy.is_ours() {
            let passes = one.mode == Mode::Pass && is_higher;
            let load = load::<N>(&demand, target.error, motion.planned.is_some(), passes);
            out.load = out.load.max(load);
        }
        out.beta[i] = demand.beta;
        out.aux_d[i] = s.aux + target.error * target.weight;
        out.aux_rate_d[i] = one.rate;
        if one.engaged() {
            if is_higher {
                let along = s.zeta_B.dot(&motion.feedback);
                let most = control.k_v * s.gain.abs() * gains[i].rate_max;
                out.a -= s.zeta_B * beyond(along, most);
            }
            out.clipped |= target.clipped;
            out.list[out.count] = Engaged {
                zeta_B: s.zeta_B,
                gain: s.gain,
                beta: demand.beta,
                aux_row: s.aux_row,
                aux_acceleration: demand.acceleration - s.aux_bias,
                aux_rate: demand.nominal,
            };
            out.count += 1;
        }
    }
    Ok(out)
}

/// By place, the motion of the joints per unit of the auxiliary coordinate, with the kept rows and the other coordinates at rest: a column of J̄.
///
/// Cost about 1 µs for six joints where a direction is lost, no allocation.
fn null_motions<const N: usize>(
    setup: &Setup<N>,
    state: &State<N>,
    now: &Now<'_, N>,
) -> [Joints<N>; MAX_SINGULARITIES] {
    let listed = now.report.listed();
    let mut out = [Joints::zeros(); MAX_SINGULARITIES];
    for (motion, s) in out.iter_mut().zip(listed) {
        *motion = s.aux_row / s.aux_row.norm_squared().max(f64::MIN_POSITIVE);
    }
    let (mut places, mut zetas, mut count) = (
        [0; MAX_SINGULARITIES],
        [Vector6::zeros(); MAX_SINGULARITIES],
        0,
    );
    for (i, s) in listed.iter().enumerate() {
        if s.inside || state.loops[i].engaged() {
            (places[count], zetas[count]) = (i, s.zeta_B);
            count += 1;
        }
    }
    if count == 0 {
        return out;
    }
    let Ok(kept) = orthogonal_rows::<N>(&setup.task, zetas[..count].iter().copied()) else {
        return out;
    };
    let [mut J_T, mut units] = [SMatrix::<f64, N, N>::zeros(); 2];
    for (k, e) in kept.iter().enumerate() {
        J_T.set_column(k, &now.at.J.tr_mul(e));
    }
    for (k, place) in places[..count].iter().enumerate() {
        J_T.set_column(kept.len() + k, &listed[*place].aux_row);
        units[(kept.len() + k, k)] = 1.0;
    }
    if let Ok(rows) = Operational::new(J_T, kept.len() + count, &now.terms.A) {
        let motions = rows.Jbar(&units);
        for (k, place) in places[..count].iter().enumerate() {
            out[*place] = motions.column(k).into_owned();
        }
    }
    out
}

/// The part of `x` beyond ± `most`.
///
/// Of finite numbers `most` is a NaN only where one overflows beside a zero: the check of the torque finds it, and a bound of NaN would be a panic.
fn beyond(x: f64, most: f64) -> f64 {
    if most.is_nan() {
        return f64::NAN;
    }
    x - x.clamp(-most, most)
}

/// Velocity along a ζ that is lost beside a fold at which the fold may carry the hand, m/s and rad/s: while ζ is turned out of its way, the drift is small.
const CARRIED: (f64, f64) = (0.002, 0.01);

/// The opening of a fold inside its neighbourhood, without a plan.
struct Opening {
    /// Motion at C per rad of the coordinate, m and 1; zero of what is no fold.
    per_aux: Vector6,
    /// Its largest rate, rad/s: one at which the coordinates of the other lost directions can hold the hand along them.
    rate_max: f64,
}

impl Opening {
    fn of<const N: usize>(
        gains: &[Gains; MAX_SINGULARITIES],
        place: usize,
        now: &Now<'_, N>,
        motion: &Motion<N>,
    ) -> Self {
        let (s, listed) = (&now.report.singularities[place], now.report.listed());
        let rate_max = gains[place].rate_max;
        if s.class != Class::Type1 || !s.inside || motion.planned.is_some() {
            let per_aux = Vector6::zeros();
            return Self { per_aux, rate_max };
        }
        let per_aux = now.at.J * s.aux_row / s.aux_row.norm_squared().max(CARRIED.1);
        let turnable = |other: &Singularity<N>| other.inside && other.class == Class::Type2;
        let others = listed
            .iter()
            .enumerate()
            .filter(|(_, other)| turnable(other));
        let rates = others.map(|(j, other)| {
            let drift = if other.angular { CARRIED.1 } else { CARRIED.0 };
            let held = other.gain.abs() * gains[j].rate_max;
            (held + drift) / other.zeta_B.dot(&per_aux).abs().max(drift)
        });
        Self {
            per_aux,
            rate_max: rates.fold(rate_max, f64::min),
        }
    }
}

/// The load of one singularity on the clock: its loop's own, or the wait for a planned coordinate.
fn load<const N: usize>(demand: &Demand, error: f64, is_planned: bool, passes: bool) -> f64 {
    let own = if is_planned {
        Guide::<N>::waiting(error, demand.beta)
    } else {
        demand.load
    };
    // While a neighbourhood is left along the self-motion, or ζ turned out of the way, the path waits.
    let passing = if passes {
        WAIT * (1.0 - demand.beta)
    } else {
        0.0
    };
    own.max(passing)
}

/// The target of one auxiliary coordinate: of a commanded turn of ζ, of the planned posture, or of the strategy that its type asks for.
fn target<const N: usize>(
    setup: &Setup<N>,
    state: &mut State<N>,
    place: usize,
    situation: &Situation<'_, N>,
    (now, motion): (&Now<'_, N>, &Motion<N>),
) -> Result<Target, Refusal> {
    let s = situation.s;
    let branch = motion.leg.map_or(0, |leg| leg.branch) + state.targets.branch();
    let mut target = match &motion.planned {
        Some(planned) => {
            // For a leg that is not planned: a fold is on the side of its coordinate.
            if s.class == Class::Type1 && s.aux.abs() > SIDE_CHANGE {
                state.loops[place].memory.side = s.aux.signum();
            }
            let target = setup.guide.target(s, planned, now.q);
            match motion.off_path == Vector6::zeros() {
                true => target,
                false => pressed(setup, state, place, s, target, (now, motion)),
            }
        }
        None => by_type(setup, state, place, situation, branch),
    };
    // A planned leg lies within reach: what the formula of a fold misses there is tracking error.
    target.clipped &= motion.planned.is_none();
    let Some((leg, angle)) = motion.leg.and_then(|leg| {
        leg.reorient
            .filter(|(turned, _)| *turned == place)
            .map(|(_, angle)| (leg, angle))
    }) else {
        return Ok(target);
    };
    // Predicted, and published, before the arm moves.
    if state.turn.duration_s == 0.0 {
        state.turn = turn::plan(setup, now.q, s, angle, leg.duration_s)?;
    }
    let [share, share_rate, _] = setup.path.fraction(&state.progress);
    Ok(state.turn.target(s, share, share_rate, motion.clock))
}

/// A planned target whose hand a force leads off the path.
///
/// To the second order, the motion along ζ is g·y − κ₁y²/2, so its slope is m = g − κ₁y. Where the plan has the slope m_p, the hand off the path by x along
/// ζ has m_d² = m_p² − 2κ₁x, and y_d = y_p + 2x/(m_p + m_d), damped. Beyond reach, m_d = 0. The side of a fold, the sign of m_d, is kept while the plan
/// has none.
fn pressed<const N: usize>(
    setup: &Setup<N>,
    state: &mut State<N>,
    place: usize,
    s: &Singularity<N>,
    target: Target,
    (now, motion): (&Now<'_, N>, &Motion<N>),
) -> Target {
    let slope_at = |error: f64| s.slope() - s.kappa_1 * error;
    let slope = slope_at(target.error);
    let next = (setup.guide).at(state.progress.leg, state.clock.plan_s + SIDE_S);
    let ahead = next.map_or(slope, |plan| slope_at(s.aux_row.dot(&(plan.q - now.q))));
    let decisive = if ahead.abs() > slope.abs() {
        ahead
    } else {
        slope
    };
    let side = &mut state.loops[place].memory.side;
    // A fold of type 1 counts its side by the coordinate, whose slope is −κ₁ times it.
    let sense = match s.class {
        Class::Type1 => -1.0,
        _ => 1.0,
    };
    if decisive.abs() > SIDE * setup.length_m || *side == 0.0 {
        *side = if decisive >= 0.0 { sense } else { -sense };
    }
    let x = s.zeta_B.dot(&motion.off_path);
    let bend = 2.0 * s.kappa_1 * x;
    let wanted = sense * *side * (slope * slope - bend).max(0.0).sqrt();
    let square = |share: f64| (share * setup.length_m) * (share * setup.length_m);
    let both = slope + wanted;
    let (least, steady) = (square(DAMPING), square(STEADY));
    let faster = (slope * wanted + steady) / (wanted * wanted + steady);
    Target {
        error: target.error + 2.0 * x * both / (both * both + least),
        rate: target.rate * faster,
        change: target.change.map(|change| change * faster),
        ..target
    }
}

/// The target of one auxiliary coordinate by the computed type, for every arm.
fn by_type<const N: usize>(
    setup: &Setup<N>,
    state: &mut State<N>,
    place: usize,
    at: &Situation<'_, N>,
    branch: i32,
) -> Target {
    let s = at.s;
    let (family, memory) = (&setup.family, &mut state.loops[place].memory);
    if memory.side == 0.0 {
        memory.side = sign(s.across() >= 0.0);
    }
    match s.class {
        Class::Type1 => family.fold(at).map_or_else(type_2::held, |fold| {
            let side = memory.side;
            let branch = match branch {
                0 => at.roomier(side),
                branch => branch,
            };
            type_1::on_side(&fold, s.inside, branch, memory)
        }),
        Class::Type2 | Class::Mixed => family.direction(at, memory).unwrap_or_else(type_2::held),
        Class::Unknown => type_2::held(),
    }
}

/// Whether the listed singularities explain the rank: each takes one direction.
fn check_rank<const N: usize>(setup: &Setup<N>, report: &Report<N>) -> Result<(), Refusal> {
    let full = TaskAxes(setup.task).count().min(N);
    let listed = report.listed().iter().filter(|s| s.inside).count();
    if setup.scenario.control.strategy.is_ours() && (report.rank as usize + listed) < full {
        return Err(Refusal::Unlisted);
    }
    Ok(())
}
