//! Arms by the geometry of their axes: the guarantees of [`Singularity`](crate::types::Singularity).

use crate::analyzer::Analyzer;
use crate::arm_family::parallel_axes::ParallelAxes;
use crate::arm_family::spherical_shoulder::SphericalShoulder;
use crate::centre::AtCentre;
use crate::law::Engaged;
use crate::linear::singular_values;
use crate::paper::singular_frame::orthogonal_rows;
use crate::testing::{posture, robot};
use crate::types::{Report, Singularity};
use model::{Model, Robot, Terms};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3, Vector6};
use proptest::prelude::*;
use shared_types::scenario::Analysis;

fn model<const N: usize>(name: &str) -> Model<N> {
    Model::new(robot(name), None).unwrap()
}

fn analysed<const N: usize>(
    name: &str,
    q: &SVector<f64, N>,
    qdot: &SVector<f64, N>,
) -> (Report<N>, Terms<N>) {
    let terms = model::<N>(name).evaluate(q, qdot);
    (
        Analyzer::new(robot(name), &Analysis::default()).step(q, qdot, &terms),
        terms,
    )
}

#[test]
fn axes_say_what_an_arm_is() {
    assert!(
        ParallelAxes::of::<6>(robot("ur5")).is_some()
            && SphericalShoulder::<6>::of(robot("ur5"), &Analysis::default()).is_none()
    );
    let iiwa = SphericalShoulder::<7>::of(robot("iiwa14"), &Analysis::default()).unwrap();
    assert!(
        (iiwa.shoulder() - Vector3::new(0.0, 0.0, 0.36)).norm() < 1e-9
            && ParallelAxes::of::<7>(robot("iiwa14")).is_none()
    );
    assert!(
        ParallelAxes::of::<6>(robot("puma560")).is_none()
            && ParallelAxes::of::<3>(robot("planar3r")).is_none()
    );
}

/// J without the reported directions, their auxiliary rows in their place: smallest singular value, unit-scaled.
fn augmented_sigma<const N: usize>(report: &Report<N>, terms: &Terms<N>, engaged: &[bool]) -> f64 {
    let at = AtCentre::new(terms, &report.p_BC, &terms.omega[N - 1]);
    let actives: Vec<Engaged<N>> = (report.listed().iter().zip(engaged))
        .filter(|(_, yes)| **yes)
        .map(|(s, _)| Engaged {
            zeta_B: s.zeta_B,
            gain: s.gain,
            beta: 0.0,
            aux_row: s.aux_row,
            aux_acceleration: 0.0,
            aux_rate: 0.0,
        })
        .collect();
    let mut M = SMatrix::<f64, 6, N>::zeros();
    let orthogonal = orthogonal_rows(&[true; 6], &actives).unwrap();
    for (i, e) in orthogonal.iter().enumerate() {
        let scale = if e.fixed_rows::<3>(0).norm() > 0.5 {
            1.0 / report.length_m
        } else {
            1.0
        };
        M.set_row(i, &(at.J.tr_mul(e) * scale).transpose());
    }
    for (i, active) in actives.iter().enumerate() {
        M.set_row(orthogonal.len() + i, &active.aux_row.transpose());
    }
    singular_values(&M).0[5]
}

fn a_guarantee_holds<const N: usize>(
    name: &str,
    q: &SVector<f64, N>,
    qdot: &SVector<f64, N>,
) -> Result<(), TestCaseError> {
    let (report, terms) = analysed(name, q, qdot);
    let at = AtCentre::new(&terms, &report.p_BC, &terms.omega[N - 1]);
    let h = 1e-6;
    let (before, after) = (
        analysed(name, &(q - qdot * h), qdot).0,
        analysed(name, &(q + qdot * h), qdot).0,
    );
    for i in 0..report.count {
        let (s, a, b) = (
            report.singularities[i],
            before.singularities[i],
            after.singularities[i],
        );
        // Each posture has an analyzer of its own here, and beyond 1.3 η_out a direction may be listed under another name.
        let named = N < 7 || i == 0 || s.s < 1.25 * s.eta_out;
        if s.s.abs() > 1e-3 && s.s.abs() < 2.0 && named {
            prop_assert!(
                ((b.s - a.s) / (2.0 * h) - s.s_rate).abs() < 1e-5,
                "{i}: ds/dt is {}, not {}",
                (b.s - a.s) / (2.0 * h),
                s.s_rate
            );
        }
        // A singularity of two conditions has no coordinate, only a rate.
        let counted = !(N == 7 && i > 0);
        if (b.aux - a.aux).abs() < 1.0 && counted {
            prop_assert!(
                ((b.aux - a.aux) / (2.0 * h) - s.aux_rate).abs() < 1e-6,
                "{i}: auxiliary rate"
            );
        }
        prop_assert!(
            (s.aux_row.dot(qdot) - s.aux_rate).abs() < 1e-9,
            "{i}: the row is the rate's gradient"
        );
        if counted {
            prop_assert!(
                ((b.aux_rate - a.aux_rate) / (2.0 * h) - s.aux_bias).abs() < 1e-5,
                "{i}: auxiliary bias"
            );
        }
        prop_assert!(
            (s.R_BS.transpose() * s.R_BS - Matrix3::identity()).norm() < 1e-9
                && (s.R_BS.column(0) - s.axis()).norm() < 1e-9
        );
    }
    // ζᵀJ − gain·aux is a combination of the other rows, the spare joint's motion left out.
    for (i, s) in report.listed().iter().enumerate() {
        // Of two vector measures that are both below 1.3 η_out, the later one's ζ is put apart from the earlier one's.
        let beyond = |j: usize, other: &Singularity<N>| {
            other.s.abs()
                > if N == 7 && j > 0 {
                    1.3 * other.eta_out
                } else {
                    0.2
                }
        };
        let regular = report
            .listed()
            .iter()
            .enumerate()
            .all(|(j, other)| j == i || beyond(j, other));
        // A vector measure's row is its own gradient beyond η_out only: inside, it is carried.
        let carried = N == 7 && i > 0 && s.s < s.eta_out;
        if !regular || s.s.abs() > 0.3 || carried {
            continue;
        }
        let rest = at.J.tr_mul(&s.zeta_B) - s.aux_row * s.gain;
        let alone = Engaged {
            zeta_B: s.zeta_B,
            gain: s.gain,
            beta: 0.0,
            aux_row: s.aux_row,
            aux_acceleration: 0.0,
            aux_rate: 0.0,
        };
        let orthogonal = orthogonal_rows(&[true; 6], &[alone]).unwrap();
        let rows = SMatrix::<f64, 5, N>::from_fn(|r, c| at.J.tr_mul(&orthogonal[r])[c]);
        let Some(gram) = (rows * rows.transpose()).try_inverse() else {
            continue;
        };
        let residual = rest - rows.transpose() * (gram * (rows * rest));
        prop_assert!(
            residual.norm() < 1e-6,
            "{i}: {} beyond the kept rows",
            residual.norm()
        );
    }
    Ok(())
}

/// The distances between the parallel axes 2 and 3, and 3 and 4; m.
fn between_axes(robot: &Robot) -> [f64; 2] {
    [1, 2].map(|joint| {
        let (n, p) = (robot.joints[joint].axis, robot.joints[joint + 1].X_PJ.p);
        (p - n * n.dot(&p)).norm()
    })
}

proptest! {
    // covers: CK95 Eq. 1 (parallel_axes::ParallelAxes::measure)
    #[test]
    fn the_determinant_of_parallel_axes_is_the_product_of_the_factors(q in posture(&model::<6>("ur5"))) {
        let (report, _) = analysed("ur5", &q, &Vector6::zeros());
        let [elbow, wrist, overhead] = [0, 1, 2].map(|i| report.singularities[i].s);
        let [L2, L3] = between_axes(robot("ur5"));
        let product = L2 * L3 * (L2 + L3) * elbow * wrist * overhead;
        prop_assert!((report.det.abs() - product.abs()).abs() < 1e-12, "{} {product}", report.det);
    }

    #[test]
    fn a_ur5_keeps_the_guarantees_of_a_source(q in posture(&model::<6>("ur5")), qdot in prop::array::uniform6(-1.0..1.0)) {
        a_guarantee_holds("ur5", &q, &SVector::from(qdot))?;
    }

    #[test]
    fn an_iiwa_keeps_the_guarantees_of_a_source(q in posture(&model::<7>("iiwa14")), qdot in prop::array::uniform7(-1.0..1.0)) {
        a_guarantee_holds("iiwa14", &q, &SVector::from(qdot))?;
    }

    #[test]
    fn a_ur5_is_regular_with_the_locked_directions_replaced(q in posture(&model::<6>("ur5")), locks in 0..8_usize, off in prop::array::uniform3(-0.1..0.1)) {
        // Any of the three locks, or several: elbow q3, wrist q5, overhead by q2.
        let mut q = q;
        if locks & 1 != 0 {
            q[2] = off[0];
        }
        if locks & 2 != 0 {
            q[4] = off[1];
        }
        if locks & 4 != 0 {
            let R = |q2: f64| analysed("ur5", &SVector::from([q[0], q2, q[2], q[3], q[4], q[5]]), &Vector6::zeros()).0.singularities[2].gain;
            // R = A sin q2 + B cos q2.
            q[1] = libm::atan2(-R(0.0), R(std::f64::consts::FRAC_PI_2)) + off[2];
        }
        let (report, terms) = analysed("ur5", &q, &Vector6::zeros());
        // Folded back, upper arm and forearm lie on each other: beyond the elbow's own limit.
        prop_assume!(libm::cos(q[2]) > -0.9);
        let engaged: Vec<bool> = report.listed().iter().map(|s| s.s.abs() < 0.2).collect();
        let sigma = augmented_sigma(&report, &terms, &engaged);
        prop_assert!(sigma > 0.01, "{engaged:?}: σ_min {sigma}");
    }
}
