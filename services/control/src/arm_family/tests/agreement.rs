//! Types by number against types by formula, at 1,000 random near-singular postures of each arm.

use super::numeric::{Arm, ELBOW, OVERHEAD, WRIST, at_lock, iiwa, nearest, puma, ur5};
use crate::analyzer::Analyzer;
use crate::arm_family::classify::FOLD;
use crate::testing::puma_lengths;
use crate::types::{Class, Report, Singularity};
use nalgebra::{SVector, Vector6};
use shared_types::random::Uniform;
use shared_types::scenario::Analysis;
use std::f64::consts::FRAC_PI_2;

/// Postures of each arm.
const POSTURES: usize = 1000;
/// |s| of the nearest singularity is below the one, of every other above the other: near two at once a type belongs to their combination.
const NEAR: (f64, f64) = (0.06, 0.25);

/// How many of [`POSTURES`] have the same type by number as by formula; per place of the formula's report, of how many.
fn agreement<const N: usize>(
    arm: &Arm<N>,
    mut draw: impl FnMut(&mut Uniform, usize) -> SVector<f64, N>,
) -> Vec<(Class, usize, usize)> {
    let formulas = Analyzer::new(&arm.robot, &Analysis::default());
    let by_formula = |q: &SVector<f64, N>| -> Report<N> {
        arm.step(&mut formulas.clone(), q, &SVector::zeros())
    };
    let mut random = Uniform(17);
    let mut out = vec![
        (Class::Unknown, 0, 0);
        by_formula(&SVector::from_fn(|i, _| 0.3 + 0.37 * i as f64)).count
    ];
    let mut found = 0;
    for k in 0..100 * POSTURES {
        let q = draw(&mut random, k);
        let report = by_formula(&q);
        let size = |place: &usize| report.listed()[*place].s.abs();
        let place = (0..report.count)
            .min_by(|a, b| size(a).total_cmp(&size(b)))
            .expect("the family lists singularities");
        let apart = (0..report.count)
            .filter(|other| *other != place)
            .all(|other| size(&other) > NEAR.1);
        if size(&place) > NEAR.0 || !apart {
            continue;
        }
        // By number the same direction: the most parallel of those that are near.
        let (one, by_number) = (report.listed()[place], arm.at(&q));
        let parallel = |s: &Singularity<N>| {
            if s.angular == one.angular {
                s.axis().dot(&one.axis()).abs()
            } else {
                -1.0
            }
        };
        let near = by_number.listed().iter().filter(|s| s.s.abs() < s.eta_out);
        let two = near
            .max_by(|a, b| parallel(a).total_cmp(&parallel(b)))
            .copied()
            .unwrap_or_else(|| nearest(&by_number));
        // An offset tilts the waist's plane: the formula says mixed everywhere, the number says Type 2 where the fold is less than its threshold.
        let flat = one.class == Class::Mixed && two.class == Class::Type2 && two.kappa_1 <= FOLD;
        let same = one.class == two.class || flat;
        out[place] = (
            one.class,
            out[place].1 + usize::from(same),
            out[place].2 + 1,
        );
        found += 1;
        if found == POSTURES {
            break;
        }
    }
    assert_eq!(
        found, POSTURES,
        "too few postures are near one singularity alone"
    );
    out
}

/// At least this share of all postures have the same type by number, and at least 80 % at each singularity.
fn agree(name: &str, found: &[(Class, usize, usize)], share: f64) {
    println!("{name}: type by formula, the same by number, of: {found:?}");
    let same: usize = found.iter().map(|one| one.1).sum();
    assert!(
        same as f64 >= share * POSTURES as f64,
        "{name}: {same} of {POSTURES} agree: {found:?}"
    );
    assert!(
        found.iter().all(|one| one.1 * 10 >= one.2 * 8),
        "{name}: {found:?}"
    );
}

#[test]
fn a_puma_has_the_types_of_its_formulas() {
    let draw = |random: &mut Uniform, k: usize| {
        let near = random.within(-0.05, 0.05);
        at_lock(
            random,
            [ELBOW, WRIST, OVERHEAD][k % 3],
            near,
            puma_lengths("puma560"),
        )
    };
    let found = agreement(puma(), draw);
    assert!(
        found.iter().all(|one| one.2 > 100),
        "each singularity is met: {found:?}"
    );
    agree("puma560", &found, 0.99);
}

#[test]
fn a_ur5_has_the_types_of_its_formulas() {
    let arm = ur5();
    let mut analyzer = arm.analyzer();
    let draw = |random: &mut Uniform, k: usize| {
        let mut q = Vector6::from_fn(|_, _| random.within(-2.5, 2.5));
        match k % 3 {
            0 => q[2] = random.within(-0.05, 0.05),
            1 => q[4] = random.within(-0.05, 0.05),
            _ => {
                // In-plane radius of C from the waist axis, A cos q2 + B sin q2, made small.
                let mut radius = |q2: f64| {
                    q[1] = q2;
                    let terms = arm.model.evaluate(&q, &SVector::zeros());
                    let C = arm.step(&mut analyzer, &q, &SVector::zeros()).p_BC;
                    terms.z[1].cross(&terms.z[0]).dot(&(C - terms.p[0]))
                };
                let (A, B) = (radius(0.0), radius(FRAC_PI_2));
                q[1] = libm::atan2(-A, B) + random.within(-0.05, 0.05);
            }
        }
        q
    };
    let found = agreement(arm, draw);
    assert!(
        found.iter().all(|one| one.2 > 100),
        "each singularity is met: {found:?}"
    );
    agree("ur5", &found, 0.97);
}

#[test]
fn an_iiwa_has_the_types_of_its_formulas() {
    let draw = |random: &mut Uniform, k: usize| {
        let mut q = SVector::<f64, 7>::from_fn(|_, _| random.within(-2.0, 2.0));
        let quarter = if random.within(-1.0, 1.0) < 0.0 {
            -FRAC_PI_2
        } else {
            FRAC_PI_2
        };
        let near = [random.within(-0.03, 0.03), random.within(-0.03, 0.03)];
        match k % 4 {
            0 => q[3] = near[0],
            1 => (q[1], q[2]) = (near[0], quarter + near[1]),
            2 => (q[4], q[5]) = (quarter + near[0], near[1]),
            _ => (q[1], q[5]) = (near[0], near[1]),
        }
        q
    };
    let found = agreement(iiwa(), draw);
    assert!(
        found.iter().filter(|one| one.2 > 100).count() >= 3,
        "elbow, shoulder and wrist are met: {found:?}"
    );
    // A gap: of the elbow's postures one in six is Type 2 by number, where the step onto the lock ends beside it.
    agree("iiwa14", &found, 0.88);
}
