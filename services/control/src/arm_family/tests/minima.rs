//! The guard on lost directions: σ_min is minimised from random starts within the limits, and whatever it finds must be listed.

use crate::analyzer::{Analyzer, RANK_TOLERANCE};
use crate::arm_family::screws::Screws;
use crate::centre::AtCentre;
use crate::linear::{angular, linear, singular_values, symmetric_eigen};
use crate::testing::{panda, robot};
use crate::types::{Class, Kind, Report};
use model::{Model, Robot};
use nalgebra::{SMatrix, SVector, Vector6};
use shared_types::random::Uniform;
use shared_types::scenario::Analysis;
use std::collections::BTreeMap;

/// Minima asked for on each arm.
const MINIMA: usize = 200;

/// JJᵀ, lengths divided by `length_m`: its smallest eigenvalue, eigenvector, and the gradient of σ_min.
fn smallest<const N: usize>(
    J: &SMatrix<f64, 6, N>,
    length_m: f64,
) -> (f64, Vector6<f64>, SVector<f64, N>) {
    let scaled = Screws(*J).scaled(length_m);
    let (values, vectors) = symmetric_eigen(&(scaled * scaled.transpose()));
    let i = (0..6)
        .min_by(|a, b| values[*a].total_cmp(&values[*b]))
        .unwrap();
    let u: Vector6<f64> = vectors.column(i).into_owned();
    let row = scaled.tr_mul(&u);
    let sigma = row.norm();
    let mut covector = u;
    covector.fixed_rows_mut::<3>(0).scale_mut(1.0 / length_m);
    let gradient = Screws(*J).hessian(&covector).tr_mul(&row) / sigma.max(1e-300);
    (sigma, u, gradient)
}

/// A posture within the limits with σ_min below 1e-7, found downhill from a random one; `None` where the way down ends elsewhere.
fn minimum<const N: usize>(
    model: &Model<N>,
    length_m: f64,
    random: &mut Uniform,
) -> Option<SVector<f64, N>> {
    let inside = |q: &SVector<f64, N>| {
        SVector::<f64, N>::from_fn(|i, _| {
            q[i].clamp(model.lower()[i].max(-3.1), model.upper()[i].min(3.1))
        })
    };
    let mut q = SVector::from_fn(|i, _| {
        random.within(model.lower()[i].max(-3.1), model.upper()[i].min(3.1))
    });
    let value = |q: &SVector<f64, N>| smallest(&model.jacobian(q), length_m);
    let (mut sigma, _, mut gradient) = value(&q);
    for _ in 0..200 {
        if sigma < 1e-7 {
            return Some(q);
        }
        // Newton's step for a value that is zero at the minimum, shortened until it goes down.
        let mut step = gradient * (-sigma / gradient.norm_squared().max(1e-9));
        step *= (0.3 / step.amax()).min(1.0);
        let next = (0..12).find_map(|k| {
            let next = inside(&(q + step * 0.5_f64.powi(k)));
            let (value, _, gradient) = value(&next);
            (value < sigma).then_some((next, value, gradient))
        });
        (q, sigma, gradient) = next?;
    }
    None
}

/// Names and types of the minima of an arm.
type Census = BTreeMap<(String, String), usize>;

/// Every minimum of an arm, analysed at once by a new analyzer, and by one that has come from a posture near by.
fn census<const N: usize>(robot: &Robot, analysis: &Analysis) -> Census {
    let model = Model::<N>::new(robot, None).unwrap();
    let fresh = Analyzer::<N>::new(robot, analysis);
    let mut random = Uniform(17);
    let mut census = Census::new();
    let mut found = 0;
    while found < MINIMA {
        let zero = SVector::zeros();
        let Some(q) = minimum(&model, robot.length_m, &mut random) else {
            continue;
        };
        found += 1;
        let step = |analyzer: &mut Analyzer<N>, q: &SVector<f64, N>| {
            analyzer.step(q, &zero, &model.evaluate(q, &zero))
        };
        let mut tracked = fresh.clone();
        let away = SVector::<f64, N>::from_fn(|_, _| random.within(-0.2, 0.2));
        (0..=40).for_each(|k| {
            step(&mut tracked, &(q + away * (1.0 - f64::from(k) / 40.0)));
        });
        for (how, report) in [
            ("at once", step(&mut fresh.clone(), &q)),
            ("tracked", step(&mut tracked, &q)),
        ] {
            explained(&model, robot, &q, &report, how);
            for s in report.listed().iter().filter(|s| s.inside) {
                *census
                    .entry((format!("{:?}", s.kind), format!("{:?}", s.class)))
                    .or_default() += 1;
            }
        }
    }
    census
}

/// The rank that is lost is what is listed inside, and the listed ζ with the kept rows span every lost direction.
fn explained<const N: usize>(
    model: &Model<N>,
    robot: &Robot,
    q: &SVector<f64, N>,
    report: &Report<N>,
    how: &str,
) {
    let terms = model.evaluate(q, &SVector::zeros());
    let at = AtCentre::new(&terms, &report.p_BC, &terms.omega[N - 1]);
    let inside: Vec<_> = report.listed().iter().filter(|s| s.inside).collect();
    let scaled = Screws(at.J).scaled(robot.length_m);
    let rank = singular_values(&scaled)
        .0
        .iter()
        .filter(|s| **s > RANK_TOLERANCE * scaled.norm())
        .count();
    assert_eq!(report.rank as usize, rank);
    assert!(
        report.rank < 6 && rank + inside.len() >= 6,
        "{how}: rank {rank}, listed inside {inside:?} at {q}"
    );
    // The lost covectors, not orthogonal to every ζ: eliminating the rows of ζ leaves full rank.
    let (values, vectors) = symmetric_eigen(&(scaled * scaled.transpose()));
    for i in (0..6).filter(|i| values[*i] < 1e-10) {
        let u = vectors.column(i).into_owned();
        let share: f64 = inside
            .iter()
            .map(|s| {
                let half = if s.angular { angular(&u) } else { linear(&u) };
                half.dot(&s.axis()).powi(2)
            })
            .sum();
        assert!(
            share > 1e-3,
            "{how}: no ζ has a share in the lost direction {u} at {q}: {inside:?}"
        );
    }
    // In place of the rows of ζ, the auxiliary rows make the matrix regular.
    let mut rows: Vec<SVector<f64, N>> = inside.iter().map(|s| s.aux_row.normalize()).collect();
    for half in [0..3, 3..6] {
        let mut basis: Vec<Vector6<f64>> = vec![];
        let residual = |mut e: Vector6<f64>, basis: &[Vector6<f64>]| {
            for _ in 0..2 {
                for b in basis {
                    e -= b * b.dot(&e);
                }
            }
            e
        };
        for s in inside.iter().filter(|s| s.angular == (half.start == 3)) {
            let e = residual(s.zeta_B, &basis);
            assert!(
                e.norm() > 1e-3,
                "{how}: two ζ are the same at {q}: {inside:?}"
            );
            basis.push(e.normalize());
        }
        while basis.len() < 3 {
            let axes = half.clone().map(|k| {
                residual(
                    Vector6::from_fn(|i, _| if i == k { 1.0 } else { 0.0 }),
                    &basis,
                )
            });
            let e = axes
                .max_by(|a, b| a.norm().total_cmp(&b.norm()))
                .unwrap()
                .normalize();
            basis.push(e);
            rows.push(scaled.tr_mul(&e));
        }
    }
    let gram = SMatrix::<f64, 6, 6>::from_fn(|i, j| rows[i].dot(&rows[j]));
    let least = symmetric_eigen(&gram).0.min().max(0.0).sqrt();
    assert!(
        least > 5e-3,
        "{how}: kept and auxiliary rows have σ_min = {least:e} at {q}: {inside:?}"
    );
}

#[test]
fn every_lost_direction_of_a_puma_and_a_ur5_is_listed() {
    for name in ["puma560", "ur5"] {
        let census = census::<6>(robot(name), &Analysis::default());
        println!("{name}: {census:?}");
        assert!(
            census.keys().all(|(kind, _)| kind != "Numeric"),
            "{census:?}"
        );
    }
}

#[test]
fn every_lost_direction_of_an_iiwa_is_listed() {
    let census = census::<7>(robot("iiwa14"), &Analysis::default());
    println!("iiwa14: {census:?}");
    for kind in [Kind::Elbow, Kind::Wrist, Kind::Shoulder] {
        assert!(
            census.keys().any(|(name, _)| *name == format!("{kind:?}")),
            "{kind:?}: {census:?}"
        );
    }
    assert!(
        census
            .keys()
            .all(|(_, class)| *class != format!("{:?}", Class::Unknown)),
        "{census:?}"
    );
}

#[test]
fn every_lost_direction_of_a_panda_is_listed_and_named() {
    let census = census::<7>(panda(), &Analysis::default());
    println!("panda: {census:?}");
    for kind in [Kind::Elbow, Kind::Wrist, Kind::Shoulder] {
        assert!(
            census.keys().any(|(name, _)| *name == format!("{kind:?}")),
            "{kind:?}: {census:?}"
        );
    }
    assert!(
        census
            .keys()
            .all(|(kind, class)| kind != "Numeric" && *class != format!("{:?}", Class::Unknown)),
        "{census:?}"
    );
}

#[test]
fn names_and_types_stand_off_the_singularities_too() {
    for (robot, first) in [(robot("iiwa14"), 1), (panda(), 0)] {
        let model = Model::<7>::new(robot, None).unwrap();
        let q = SVector::<f64, 7>::from([0.2, 0.5, -0.3, -1.6, 0.4, 1.6, 0.3]);
        let report = Analyzer::<7>::new(robot, &Analysis::default()).step(
            &q,
            &SVector::zeros(),
            &model.evaluate(&q, &SVector::zeros()),
        );
        let listed: Vec<_> = report.listed().iter().map(|s| (s.kind, s.class)).collect();
        println!("{}: {listed:?}", robot.name);
        assert_eq!(
            listed.iter().map(|one| one.0).collect::<Vec<_>>()[first..],
            [Kind::Elbow, Kind::Wrist, Kind::Shoulder, Kind::Numeric][first..]
        );
        assert!(
            listed
                .iter()
                .filter(|one| one.0 != Kind::Numeric)
                .all(|one| one.1 != Class::Unknown),
            "{listed:?}"
        );
    }
}
