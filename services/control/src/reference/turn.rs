//! A commanded turn of ζ, planned and announced before anything moves (+).
//!
//! Reduces to the paper's law: the plan chooses which way round ζ is turned and predicts the motion; the turn itself is the paper's Type 2 strategy.

use super::path::quintic;
use crate::centre::AtCentre;
use crate::controller::Setup;
use crate::limits::clock::MARGIN;
use crate::limits::speed::largest_share;
use crate::linear::{Joints, Vector6, rotation_log, stack, wrap_angle};
use crate::paper::operational_space::Cholesky;
use crate::paper::type_2::{TURNS, Turn};
use crate::singularity::family::{Family, Posture};
use crate::types::{Refusal, Singularity};
use model::Model;
use nalgebra::Matrix6;
use shared_types::MAX_SINGULARITIES;

/// Distance that a planned null-space motion keeps from joint limits, rad.
const LIMIT_MARGIN: f64 = 0.03;
/// Angle between directions that are one line, rad.
const SAME_LINE: f64 = 1e-3;
/// Slices of the duration's integral.
const SLICES: u32 = 64;
/// Steps of a turn, and most corrections after each.
const STEPS: (u32, u32) = (16, 8);
/// Error of pose (m, rad) and of ζ's turn (rad) that is none.
const EXACT: f64 = 1e-11;

/// The turn of ζ by `angle` (rad) in the posture `q`, or the other way round; `duration_s` is the leg's.
///
/// # Errors
/// [`Refusal::Room`] where the joint limits allow neither.
pub(crate) fn plan<const N: usize>(
    setup: &Setup<N>,
    q: &Joints<N>,
    s: &Singularity<N>,
    angle: f64,
    duration_s: f64,
) -> Result<Turn<N>, Refusal> {
    let found = within_limits(&setup.family, &setup.model, q, s, angle);
    let (angle, by) = found.ok_or(Refusal::Room)?;
    Ok(Turn {
        from: s.axis(),
        angle,
        by,
        duration_s: lasting(setup, angle, &by, duration_s),
    })
}

/// The angle by which ζ is turned, rad, and the joint motion: the other way round where joint limits force it and the goal is the same line.
pub(crate) fn within_limits<const N: usize>(
    family: &Family<N>,
    model: &Model<N>,
    q: &Joints<N>,
    s: &Singularity<N>,
    angle: f64,
) -> Option<(f64, Joints<N>)> {
    let by = |angle: f64| {
        let by = turning(family, model, q, s, angle)?;
        is_within(model, q, &by).then_some((angle, by))
    };
    let other = angle - std::f64::consts::PI.copysign(angle);
    // After half a turn the line is where it was: the other way would turn nothing.
    let is_turn = other.abs() > SAME_LINE;
    let around = || is_turn.then(|| by(other)).flatten();
    by(angle).or_else(around)
}

/// Joint motion that turns ζ of `s` by `angle` about the second axis of its frame, the end-effector at rest but for what is lost along ζ.
///
/// Newton's method step by step along the turn: ζ's row of J is replaced by the auxiliary row, as the law does it. The arm's copy of the singularity
/// is the one whose ζ is the most parallel, because a copy that was not tracked may list it in another place.
///
/// Shape N · Units rad · Requires `s` of the posture `q` · Errors `None` where the null motion does not turn ζ, or leads to a regular posture · Cost
/// about 0.1 ms, once a turn; no allocation
pub(crate) fn turning<const N: usize>(
    family: &Family<N>,
    model: &Model<N>,
    q: &Joints<N>,
    s: &Singularity<N>,
    angle: f64,
) -> Option<Joints<N>> {
    let (mut family, zero) = (family.clone(), Joints::zeros());
    let mut listed = [Singularity::none(); MAX_SINGULARITIES];
    let mut at_posture = |q: &Joints<N>, listed: &mut [Singularity<N>; MAX_SINGULARITIES]| {
        let terms = model.evaluate(q, &zero);
        let p_BC = family.centre(&terms);
        let at = AtCentre::new(&terms, &p_BC);
        let posture = Posture {
            q,
            qdot: &zero,
            terms: &terms,
            at: &at,
        };
        (family.measure(&posture, listed), at, terms.X_BE.R)
    };
    let (count, start, R_0) = at_posture(q, &mut listed);
    let parallel = |one: &Singularity<N>| one.zeta_B.dot(&s.zeta_B).abs();
    let place =
        (0..count).max_by(|a, b| parallel(&listed[*a]).total_cmp(&parallel(&listed[*b])))?;
    let (zeta_0, about) = (
        listed[place].axis(),
        listed[place].R_BS.column(1).into_owned(),
    );
    let mut moved = *q;
    for step in 1..=STEPS.0 {
        let target = angle * f64::from(step) / f64::from(STEPS.0);
        for _ in 0..STEPS.1 {
            let (_, at, R) = at_posture(&moved, &mut listed);
            let one = &listed[place];
            if one.kappa_2.abs() <= TURNS {
                return None;
            }
            let (zeta, axis) = (&one.zeta_B, one.axis());
            let turned = libm::atan2(about.dot(&zeta_0.cross(&axis)), zeta_0.dot(&axis));
            let left = wrap_angle(target - turned) / one.kappa_2;
            let e = stack(&(start.p - at.p), &rotation_log(&(R_0 * R.transpose())));
            let e = e - zeta * zeta.dot(&e);
            if e.amax().max(left.abs()) < EXACT {
                break;
            }
            let rows = at.J + zeta * (one.aux_row - at.J.tr_mul(zeta)).transpose();
            let gram: Matrix6<f64> = rows * rows.transpose();
            let share = Cholesky::new(gram)
                .ok()?
                .solve(&Vector6::from(e + zeta * left));
            moved += rows.tr_mul(&share);
        }
    }
    let by = moved - q;
    by.iter().all(|x| x.is_finite()).then_some(by)
}

/// Whether every joint that moves `by` so much from `q` stays within its limits.
fn is_within<const N: usize>(model: &Model<N>, q: &Joints<N>, by: &Joints<N>) -> bool {
    let inside = |i: usize| {
        let end = q[i] + by[i];
        by[i] == 0.0
            || end > model.lower()[i] + LIMIT_MARGIN && end < model.upper()[i] - LIMIT_MARGIN
    };
    (0..N).all(inside)
}

/// Duration of a turn whose time law the governor slows down where a rate would exceed its limit: ∫ max(1, demand/0.95) dt, s.
fn lasting<const N: usize>(setup: &Setup<N>, angle: f64, by: &Joints<N>, planned_s: f64) -> f64 {
    let control = &setup.scenario.control;
    if !control.governor {
        return planned_s;
    }
    let share = angle.abs() / control.aux_rate_max.largest();
    let share = share.max(largest_share(by, setup.model.velocity()));
    let slice = planned_s / f64::from(SLICES);
    let demand = |k: u32| share * quintic(slice * (f64::from(k) + 0.5), planned_s)[1];
    (0..SLICES)
        .map(|k| slice * (demand(k) / MARGIN).max(1.0))
        .sum()
}
