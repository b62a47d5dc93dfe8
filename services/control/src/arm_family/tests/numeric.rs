//! Any arm by number: directions, types and continuity.

use crate::analyzer::Analyzer;
use crate::arm_family::lost_geometry::Span;
use crate::arm_family::puma_inverse::PumaLengths;
use crate::arm_family::screws::Screws;
use crate::testing::puma_lengths;
use crate::types::{Class, Report, Singularity};
use model::{Model, Robot};
use nalgebra::{SVector, Vector6};
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;
use shared_types::AnalyzerCheckpoint;
use shared_types::random::Uniform;
use shared_types::scenario::Analysis;
use std::sync::OnceLock;

pub(super) struct Arm<const N: usize> {
    pub(super) robot: Robot,
    pub(super) model: Model<N>,
    /// Before its first tick; an arm's reference values are costly to sample.
    fresh: Analyzer<N>,
}

impl<const N: usize> Arm<N> {
    fn new(name: &str) -> Self {
        let robot = Robot::builtin(name).unwrap();
        let fresh = Analyzer::new(
            &robot,
            &Analysis {
                numeric: true,
                ..Analysis::default()
            },
        );
        Self {
            model: Model::new(&robot, None).unwrap(),
            robot,
            fresh,
        }
    }

    pub(super) fn analyzer(&self) -> Analyzer<N> {
        self.fresh.clone()
    }

    pub(super) fn step(
        &self,
        analyzer: &mut Analyzer<N>,
        q: &SVector<f64, N>,
        qdot: &SVector<f64, N>,
    ) -> Report<N> {
        analyzer.step(q, qdot, &self.model.evaluate(q, qdot))
    }

    pub(super) fn at(&self, q: &SVector<f64, N>) -> Report<N> {
        self.step(&mut self.analyzer(), q, &SVector::zeros())
    }
}

pub(super) fn puma() -> &'static Arm<6> {
    static ARM: OnceLock<Arm<6>> = OnceLock::new();
    ARM.get_or_init(|| Arm::new("puma560"))
}

pub(super) fn ur5() -> &'static Arm<6> {
    static ARM: OnceLock<Arm<6>> = OnceLock::new();
    ARM.get_or_init(|| Arm::new("ur5"))
}

pub(super) fn iiwa() -> &'static Arm<7> {
    static ARM: OnceLock<Arm<7>> = OnceLock::new();
    ARM.get_or_init(|| Arm::new("iiwa14"))
}

pub(super) const ELBOW: usize = 0;
pub(super) const WRIST: usize = 1;
pub(super) const OVERHEAD: usize = 2;

/// A random PUMA posture `near` one of its three locks, and away from the other two.
pub(super) fn at_lock(
    random: &mut Uniform,
    lock: usize,
    near: f64,
    lengths: PumaLengths,
) -> Vector6<f64> {
    let PumaLengths {
        a2,
        L3,
        q3_stretched,
    } = lengths;
    loop {
        let mut q = Vector6::from_fn(|_, _| random.within(-2.0, 2.0));
        let theta = if lock == ELBOW { near } else { q[2] };
        q[2] = q3_stretched + theta;
        if lock == WRIST {
            q[4] = near;
        }
        // In-plane radius of the wrist centre: R = K cos q2 + M sin q2.
        let (K, M) = (a2 + L3 * libm::cos(theta), -L3 * libm::sin(theta));
        if lock == OVERHEAD {
            q[1] =
                libm::atan2(-K, M) + libm::asin((near * (a2 + L3) / K.hypot(M)).clamp(-1.0, 1.0));
        }
        let R = (K * libm::cos(q[1]) + M * libm::sin(q[1])) / (a2 + L3);
        let open = [
            libm::sin(theta).abs() > 0.4,
            libm::sin(q[4]).abs() > 0.4,
            R.abs() > 0.35,
        ];
        if (0..3).all(|k| k == lock || open[k]) {
            return q;
        }
    }
}

/// The reported singularity that is nearest.
pub(super) fn nearest<const N: usize>(report: &Report<N>) -> Singularity<N> {
    *report
        .listed()
        .iter()
        .min_by(|a, b| a.s.abs().total_cmp(&b.s.abs()))
        .unwrap()
}

#[test]
fn directions_are_those_of_the_formulas() {
    let mut random = Uniform(3);
    // The bars 0.1°, 1.4°, 2.2° of the prototype hold for the median; at worst the overhead lock is 6.8° off, which is a gap.
    for (lock, median_deg, worst_deg) in
        [(ELBOW, 0.1, 1.0), (WRIST, 1.5, 1.5), (OVERHEAD, 2.2, 7.0)]
    {
        let mut angles = vec![];
        for k in 0..300 {
            let q = at_lock(
                &mut random,
                lock,
                if k % 2 == 0 { 0.05 } else { -0.05 },
                puma_lengths("puma560"),
            );
            let exact = Analyzer::new(&puma().robot, &Analysis::default()).step(
                &q,
                &SVector::zeros(),
                &puma().model.evaluate(&q, &SVector::zeros()),
            );
            let (one, two) = (nearest(&puma().at(&q)), exact.singularities[lock]);
            assert_eq!(one.angular, two.angular, "lock {lock}");
            angles.push(one.axis().cross(&two.axis()).norm().asin().to_degrees());
        }
        angles.sort_by(f64::total_cmp);
        let (median, worst) = (angles[150], angles[299]);
        println!("lock {lock}: ζ within {median:.3}° (median), {worst:.3}° (worst)");
        assert!(
            median < median_deg && worst < worst_deg,
            "lock {lock}: ζ is off by {median}°, at worst {worst}°"
        );
    }
}

/// Shares of Type 1, Type 2, mixed, unknown over seeded postures at a lock; and the medians of κ₁ and κ₂.
fn census<const N: usize>(
    arm: &Arm<N>,
    mut posture: impl FnMut(usize) -> SVector<f64, N>,
) -> ([usize; 4], [f64; 2]) {
    let mut counts = [0; 4];
    let (mut k1, mut k2) = (vec![], vec![]);
    for k in 0..200 {
        let one = nearest(&arm.at(&posture(k)));
        counts[match one.class {
            Class::Type1 => 0,
            Class::Type2 => 1,
            Class::Mixed => 2,
            Class::Unknown => 3,
        }] += 1;
        k1.push(one.kappa_1);
        k2.push(one.kappa_2);
    }
    k1.sort_by(f64::total_cmp);
    k2.sort_by(f64::total_cmp);
    (counts, [k1[100], k2[100]])
}

#[test]
fn a_puma_is_classified_as_its_geometry_says() {
    let mut random = Uniform(5);
    let ideal = Arm::<6>::new("puma560-ideal");
    let mut results = vec![];
    for lock in [ELBOW, WRIST, OVERHEAD] {
        results.push(census(puma(), |k| {
            let near = random.within(-0.05, 0.05) * f64::from(k as u32 % 2);
            at_lock(&mut random, lock, near, puma_lengths("puma560"))
        }));
    }
    results.push(census(&ideal, |_| {
        let near = random.within(-0.05, 0.05);
        at_lock(&mut random, OVERHEAD, near, puma_lengths("puma560-ideal"))
    }));
    println!("elbow, wrist, overhead, overhead without offset: {results:?}");
    assert_eq!(results[0].0, [200, 0, 0, 0], "elbow");
    assert_eq!(results[1].0, [0, 200, 0, 0], "wrist");
    assert!(
        results[2].0[2] >= 190,
        "overhead with a shoulder offset: {:?}",
        results[2]
    );
    assert!(results[3].0[1] >= 198, "overhead without: {:?}", results[3]);
}

#[test]
fn a_ur5_is_classified_as_its_geometry_says() {
    let mut random = Uniform(7);
    let mut any = |k: usize, at: f64| {
        let mut q = Vector6::from_fn(|_, _| random.within(-2.5, 2.5));
        q[2] = random.within(0.7, 2.0);
        q[4] = random.within(0.7, 2.0);
        q[k] = at;
        q
    };
    let elbow = census(ur5(), |k| any(2, 0.02 * f64::from(k as u32 % 3)));
    let wrist = census(ur5(), |k| any(4, 0.02 * f64::from(k as u32 % 3)));
    let mut analyzer = ur5().analyzer();
    let shoulder = census(ur5(), |_| {
        let mut q = any(0, 0.3);
        // In-plane radius of C from the waist axis, A cos q2 + B sin q2, made zero.
        let mut radius = |q2: f64| {
            q[1] = q2;
            let terms = ur5().model.evaluate(&q, &SVector::zeros());
            let C = analyzer.step(&q, &SVector::zeros(), &terms).p_BC;
            terms.z[1].cross(&terms.z[0]).dot(&(C - terms.p[0]))
        };
        let (A, B) = (radius(0.0), radius(std::f64::consts::FRAC_PI_2));
        q[1] = libm::atan2(-A, B);
        q
    });
    println!("elbow {elbow:?}, wrist {wrist:?}, shoulder {shoulder:?}");
    assert!(shoulder.0[2] >= 190, "shoulder {shoulder:?}");
    assert!(
        elbow.0[0] >= 190 && (elbow.1[0] - 0.32).abs() < 0.1,
        "elbow {elbow:?}"
    );
    assert!(wrist.0[1] >= 190, "wrist {wrist:?}");
}

proptest! {
    #[test]
    fn the_second_order_is_the_derivative_of_the_first(q in prop::array::uniform6(-3.0..3.0), qdot in prop::array::uniform6(-1.0..1.0), a in prop::array::uniform6(-1.0..1.0)) {
        let (q, qdot, a, h) = (Vector6::from(q), Vector6::from(qdot), Vector6::from(a), 1e-5);
        let J = |q: &Vector6<f64>| ur5().model.jacobian(q);
        let screws = Screws(J(&q));
        let rate = (J(&(q + qdot * h)) - J(&(q - qdot * h))) / (2.0 * h);
        prop_assert!((screws.rate(&qdot) - rate).amax() < 1e-8);
        prop_assert!((screws.hessian(&a) * qdot - rate.tr_mul(&a)).amax() < 1e-8);
        let (moved, p) = screws.moved(&qdot);
        prop_assert!((moved.0 - J(&(q + qdot))).amax() < 1e-12);
        let went = ur5().model.forward_kinematics(&(q + qdot)).p - ur5().model.forward_kinematics(&q).p;
        prop_assert!((p - went).norm() < 1e-12);
    }

    #[test]
    fn any_posture_gives_finite_numbers(q in prop::array::uniform7(-1e3..1e3), lock in 0..8_u32) {
        let q = SVector::from(q).map_with_location(|i, _, x: f64| if lock & (1 << (i % 3)) != 0 { 0.0 } else { x });
        let qdot = SVector::from_fn(|i, _| 1.0 - 0.3 * i as f64);
        finite(&iiwa().step(&mut iiwa().analyzer(), &q, &qdot))?;
        let six = |v: &SVector<f64, 7>| v.fixed_rows::<6>(0).into_owned();
        finite(&ur5().step(&mut ur5().analyzer(), &six(&q), &six(&qdot)))?;
        finite(&puma().step(&mut puma().analyzer(), &six(&q), &six(&qdot)))?;
    }

}

#[test]
fn directions_that_leave_no_other_have_no_nan() {
    let mut span = Span {
        vectors: [SVector::<f64, 6>::zeros(); 6],
        count: 0,
    };
    for k in 0..6 {
        assert!(
            (span.any().norm() - 1.0).abs() < 1e-12,
            "{k} directions leave another one"
        );
        span.push(span.any());
    }
    assert!(span.any().norm() < 1e-3, "{}", span.any());
}

/// The same cases every time. Not every random path passes: `a_direction_jumps_on_few_random_paths` measures on how many a direction jumps.
fn cases(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        rng_seed: proptest::test_runner::RngSeed::Fixed(3),
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

proptest! {
    #![proptest_config(cases(24))]

    #[test]
    fn measures_and_directions_are_continuous_along_a_path(a in prop::array::uniform7(-2.0..2.0), b in prop::array::uniform7(-2.0..2.0)) {
        continuous_on_every_arm(a, b)?;
    }
}

/// Where two measures of one block meet within a tick, a direction can jump: docs/guarantees.md states on how many paths.
#[test]
fn a_direction_jumps_on_few_random_paths() {
    let mut random = TestRunner::new(cases(1));
    let paths = (
        prop::array::uniform7(-2.0..2.0),
        prop::array::uniform7(-2.0..2.0),
    );
    let jumps = |_: &u32| {
        let (a, b) = paths
            .new_tree(&mut random)
            .expect("every value is allowed")
            .current();
        continuous_on_every_arm(a, b).is_err()
    };
    let count = (0..400).filter(jumps).count();
    assert!(count <= 3, "{count} of 400 paths");
}

proptest! {
    #![proptest_config(cases(1200))]

    #[test]
    fn a_restart_changes_nothing_anywhere(q in prop::array::uniform6(-2.0..2.0), qdot in prop::array::uniform6(-1.0..1.0)) {
        resumed(q, qdot)?;
    }
}

fn continuous_on_every_arm(a: [f64; 7], b: [f64; 7]) -> Result<(), TestCaseError> {
    let six = |v: &SVector<f64, 7>| v.fixed_rows::<6>(0).into_owned();
    let (a, b) = (SVector::from(a), SVector::from(b));
    continuous(iiwa(), &a, &b)?;
    continuous(puma(), &six(&a), &six(&b))?;
    continuous(ur5(), &six(&a), &six(&b))
}

fn resumed(q: [f64; 6], qdot: [f64; 6]) -> Result<(), TestCaseError> {
    let (mut q, qdot) = (Vector6::from(q), Vector6::from(qdot));
    for arm in [puma(), ur5()] {
        let mut one = arm.analyzer();
        for _ in 0..50 {
            arm.step(&mut one, &q, &qdot);
            q += qdot * 1e-3;
        }
        let mut two = arm.analyzer();
        let mut checkpoint = AnalyzerCheckpoint::default();
        one.save(&mut checkpoint);
        two.restore(&checkpoint);
        for _ in 0..3 {
            prop_assert_eq!(arm.step(&mut one, &q, &qdot), arm.step(&mut two, &q, &qdot));
            q += qdot * 1e-3;
        }
    }
    Ok(())
}

fn finite<const N: usize>(report: &Report<N>) -> Result<(), TestCaseError> {
    prop_assert!(report.count > 0);
    for s in report.listed() {
        let numbers = [
            s.s, s.s_rate, s.gain, s.aux, s.aux_rate, s.aux_bias, s.kappa_1, s.kappa_2,
        ];
        let all = numbers
            .iter()
            .chain(&s.zeta_B)
            .chain(&s.R_BS)
            .chain(&s.aux_row)
            .all(|x| x.is_finite());
        prop_assert!(all, "{s:?}");
        prop_assert!((s.axis().norm() - 1.0).abs() < 1e-9 && s.s != 0.0);
    }
    Ok(())
}

/// Along a straight line in joint space, at 1 rad/s in the fastest joint: s never steps by more than the Jacobian does, its rate is its
/// derivative, and inside a neighbourhood ζ turns by no more than its gap to the others allows.
fn continuous<const N: usize>(
    arm: &Arm<N>,
    a: &SVector<f64, N>,
    b: &SVector<f64, N>,
) -> Result<(), TestCaseError> {
    let mut analyzer = arm.analyzer();
    let qdot = (b - a) / (b - a).amax().max(1e-3);
    let mut last: Option<Report<N>> = None;
    for k in 0..1000 {
        let q = a + qdot * (f64::from(k) * 1e-3);
        let report = arm.step(&mut analyzer, &q, &qdot);
        finite(&report)?;
        if let Some(last) = last {
            prop_assert_eq!(last.count, report.count);
            for (i, (x, y)) in last.listed().iter().zip(report.listed()).enumerate() {
                // Directions of an arm with spare joints take their places by name, beyond 1.3 η_out.
                let renamed = N > 6 && x.s.abs().min(y.s.abs()) > 1.25 * y.eta_out;
                prop_assert!(
                    (x.s - y.s).abs() < 0.03 || renamed,
                    "s steps from {} to {} at {}",
                    x.s,
                    y.s,
                    k
                );
                // Where two values (nearly) meet only their common subspace is continuous; ζ then turns at a rate of 1/gap.
                let gap = (report.listed().iter().enumerate())
                    .filter(|(j, _)| *j != i)
                    .map(|(_, z)| (z.s.abs() - y.s.abs()).abs())
                    .fold(1.0, f64::min);
                if x.inside && y.inside && x.angular == y.angular && gap > 0.02 {
                    prop_assert!(x.axis().dot(&y.axis()) > 0.5, "ζ flips at {k}: {x:?} {y:?}");
                }
            }
        }
        last = Some(report);
    }
    Ok(())
}

#[test]
fn a_seven_joint_arm_finds_its_elbow_and_its_wrist() {
    let mut q = SVector::<f64, 7>::from([0.3, 0.7, -0.4, 0.0, 0.5, 0.9, 0.2]);
    let elbow = nearest(&iiwa().at(&q));
    assert!(elbow.s.abs() < 1e-9 && !elbow.angular, "{elbow:?}");
    println!(
        "iiwa elbow {:?} {} {}",
        elbow.class, elbow.kappa_1, elbow.kappa_2
    );
    // The spare joint stands in for the wrist but for q5 = ±90°.
    (q[3], q[4], q[5]) = (1.2, std::f64::consts::FRAC_PI_2, 0.0);
    let wrist = nearest(&iiwa().at(&q));
    assert!(wrist.s.abs() < 1e-9 && wrist.angular, "{wrist:?}");
    println!(
        "iiwa wrist {:?} {} {}",
        wrist.class, wrist.kappa_1, wrist.kappa_2
    );
}

#[test]
fn a_measure_crosses_zero_in_a_straight_line() {
    let mut random = Uniform(11);
    for lock in [ELBOW, WRIST] {
        let mut analyzer = puma().analyzer();
        let mut q = at_lock(&mut random, lock, -0.02, puma_lengths("puma560"));
        let joint = if lock == ELBOW { 2 } else { 4 };
        let qdot = Vector6::from_fn(|i, _| if i == joint { 1.0 } else { 0.0 });
        let mut values = vec![];
        let place = {
            let report = puma().step(&mut analyzer, &q, &qdot);
            (0..report.count)
                .min_by(|a, b| {
                    report.singularities[*a]
                        .s
                        .abs()
                        .total_cmp(&report.singularities[*b].s.abs())
                })
                .unwrap()
        };
        for _ in 0..=40 {
            let one = puma().step(&mut analyzer, &q, &qdot).singularities[place];
            values.push((one.s, one.s_rate));
            q += qdot * 1e-3;
        }
        for pair in values.windows(2) {
            let rate = (pair[1].0 - pair[0].0) / 1e-3;
            assert!(
                (rate - pair[0].1).abs() < 0.02 * rate.abs() && rate * values[0].1 > 0.0,
                "lock {lock}: {pair:?}"
            );
        }
        assert!(values[0].0 * values[40].0 < 0.0);
    }
}
