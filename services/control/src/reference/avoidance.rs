//! The self-motion as a way around singularities of codimension two or more (+).
//!
//! An arm with one spare joint reaches a pose in a curve of postures, and few of them are singular. Near a lost direction the null space is driven to
//! where the product w of J's singular values grows: for a null motion n, d ln w/dt = tr(J⁺·J̇(n)), and σ_min·d ln w/dt is about σ̇_min there.
//!
//! Reduces to nothing: beyond twice η_out the weight is zero, and the null space has its posture control alone.

use crate::controller::Setup;
use crate::linear::{Basis, Jacobian, Joints, smoothstep, unit};
use crate::paper::operational_space::Cholesky;
use crate::singularity::screws::Screws;
use crate::tick::Now;
use crate::types::Singularity;
use model::{TaskAxes, unit_scaled};
use shared_types::bounds::within;

/// |s| over η_out at which the null space begins to be driven.
const REACH: f64 = 2.0;

/// Null rate per relative growth of σ_min, rad²/s; and the largest null rate, rad/s.
const DRIVE: (f64, f64) = (1.0, 0.8);

/// The null motion that leads away from the singularities, rad/s, and the weight that it has against the posture's control, 0 to 1.
///
/// `None` far from every singularity of codimension two or more, and for more or fewer than one spare joint.
/// Cost about 1 µs near a singularity, none elsewhere; no allocation.
pub(crate) fn away<const N: usize>(setup: &Setup<N>, now: &Now<'_, N>) -> Option<(Joints<N>, f64)> {
    let is_ours = setup.scenario.control.strategy.is_ours();
    let first = setup.family.first_of_higher_codimension();
    let first = first.filter(|_| is_ours)?;
    let (J, report, task) = (&now.at.J, now.report, &setup.task);
    let openness = |s: &Singularity<N>| (s.s.abs() / s.eta_out - 1.0) / (REACH - 1.0);
    let nearest = report
        .listed()
        .iter()
        .skip(first)
        .min_by(|a, b| openness(a).total_cmp(&openness(b)))?;
    let weight = 1.0 - smoothstep(openness(nearest));
    let rows = TaskAxes(*task).count();
    if within(weight, 0.0) || rows + 1 != N {
        return None;
    }
    // Inside, the singularity's own strategy acts, and what is left of the null space rests.
    let open = smoothstep((nearest.s.abs() / nearest.eta_in - 1.0) / 0.3);
    if open == 0.0 {
        return Some((Joints::zeros(), weight));
    }
    let scaled = |rows: &Jacobian<N>| unit_scaled(rows, report.length_m, task);
    let S = scaled(J);
    let mut basis = Basis::<N>::empty();
    for k in (0..6).filter(|k| task[*k]) {
        basis.add(S.row(k).transpose());
    }
    if !basis.add_best((0..N).map(unit)) {
        return None;
    }
    let n = basis[basis.len() - 1];
    // tr J⁺J̇ with J⁺ = Jᵀ(JJᵀ)⁻¹.
    let mut gram = S * S.transpose();
    (0..6)
        .filter(|k| !task[*k])
        .for_each(|k| gram[(k, k)] = 1.0);
    let rate = scaled(&Screws(*J).rate(&n));
    let growth = Cholesky::new(gram)
        .ok()?
        .solve(&(rate * S.transpose()))
        .trace();
    let driven = open * (DRIVE.0 * nearest.s.abs() * growth).clamp(-DRIVE.1, DRIVE.1);
    growth.is_finite().then_some((n * driven, weight))
}
