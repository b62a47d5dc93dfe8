//! The joint motion that turns ζ while the end-effector rests, predicted before the arm moves.

use super::family::{Family, Posture};
use crate::centre::AtCentre;
use crate::linear::{Joints, Vector6, rotation_log, stack, wrap_angle};
use crate::paper::operational_space::Cholesky;
use crate::paper::type_2::TURNS;
use crate::types::Singularity;
use model::Model;
use nalgebra::Matrix6;
use shared_types::MAX_SINGULARITIES;

/// Steps of a turn, and most corrections after each.
const STEPS: (u32, u32) = (16, 8);
/// Error of pose (m, rad) and of ζ's turn (rad) that is none.
const EXACT: f64 = 1e-11;

/// Joint motion that turns ζ of `s` by `angle` about the second axis of its frame, the end-effector at rest but for what is lost along ζ.
///
/// Newton's method step by step along the turn: ζ's row of J is replaced by the auxiliary row, as the law does it. The arm's copy of the singularity
/// is the one whose ζ is the most parallel, because a copy that was not tracked may list it in another place.
///
/// Shape N · Units rad · Requires `s` of the posture `q` · Errors `None` where the null motion does not turn ζ, or leads to a regular posture · Cost
/// about 0.1 ms, once a turn; no allocation
pub fn turning<const N: usize>(
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
