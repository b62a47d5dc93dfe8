//! The additions to the paper reduce to the paper's law inside D_si and to operational-space control outside.

use crate::centre::AtCentre;
use crate::law::auxiliary::{Demand, Gains, LEFT, Loop};
use crate::law::{self, Engaged, Problem, Rows, Torques};
use crate::limits::clock::{Clock, Load};
use crate::paper::operational_space::null_torque;
use crate::paper::reference::Target;
use crate::paper::singular_frame::orthogonal_rows;
use crate::singularity::analyzer::Analyzer;
use crate::singularity::puma_inverse::PumaLengths;
use crate::testing::{posture, puma, puma_lengths, robot};
use crate::types::{Mode, Report, Singularity};
use model::{Model, Terms};
use nalgebra::{DMatrix, DVector, Matrix1, Vector1, Vector6};
use proptest::prelude::*;
use shared_types::random::Uniform;
use shared_types::scenario::Analysis;

fn analysed(
    model: &Model<6>,
    name: &str,
    q: &Vector6<f64>,
    qdot: &Vector6<f64>,
) -> (Report<6>, Terms<6>) {
    let terms = model.evaluate(q, qdot);
    (
        Analyzer::new(robot(name), &Analysis::default()).step(q, qdot, &terms),
        terms,
    )
}

/// A random posture with some of the three locks forced, and which of them.
fn at_locks(random: &mut Uniform, locks: usize) -> Vector6<f64> {
    let mut q = Vector6::from_fn(|i, _| random.within(puma().lower()[i], puma().upper()[i]));
    let near = |random: &mut Uniform| {
        random.within(-1.0, 1.0) * [0.0, 0.08][random.within(0.0, 2.0) as usize % 2]
    };
    let lengths = puma_lengths("puma560");
    if locks & 1 != 0 {
        q[2] = lengths.q3_stretched + near(random);
    }
    if locks & 2 != 0 {
        q[4] = near(random);
    }
    if locks & 4 != 0 {
        // R = c2·K + s2·M = 0 at q2 = atan2(−K, M), up or down.
        let theta = q[2] - lengths.q3_stretched;
        let (K, M) = (
            lengths.a2 + lengths.L3 * libm::cos(theta),
            -lengths.L3 * libm::sin(theta),
        );
        q[1] = libm::atan2(-K, M) + near(random);
    }
    q
}

/// The singularities within η_out.
fn engaged(report: &Report<6>, beta: f64) -> Vec<Engaged<6>> {
    let near = report.listed().iter().filter(|s| s.s.abs() < s.eta_out);
    near.map(|s| Engaged {
        zeta_B: s.zeta_B,
        gain: s.gain,
        beta,
        aux_row: s.aux_row,
        aux_acceleration: 0.7,
        aux_rate: 0.3,
    })
    .collect()
}

fn sum(torques: &Torques<6>) -> Vector6<f64> {
    torques.parts.sum()
}

fn problem<'a>(terms: &'a Terms<6>, at: &'a AtCentre<6>, qdot: &'a Vector6<f64>) -> Problem<'a, 6> {
    Problem {
        A: &terms.A,
        at,
        qdot,
        task: [true; 6],
        a: Vector6::new(0.3, -0.5, 0.2, 0.4, -0.1, 0.6),
        a_path: Vector6::zeros(),
        V: Vector6::zeros(),
        a_feed: Vector6::zeros(),
        grad_V_0: Vector6::zeros(),
        k_vq: 40.0,
    }
}

proptest! {
    // covers: CK95 Eq. 1 (analyzer::conditioning)
    // covers: CK95 Eq. 1 (puma::Puma::measure)
    #[test]
    fn the_determinant_is_the_product_of_the_three_factors(q in posture(puma())) {
        let (report, _) = analysed(puma(), "puma560", &q, &Vector6::zeros());
        let PumaLengths { a2, L3, .. } = puma_lengths("puma560");
        let [elbow, wrist, overhead] = [0, 1, 2].map(|i| report.singularities[i].s);
        let product = -a2 * L3 * (a2 + L3) * elbow * wrist * overhead;
        prop_assert!((report.det - product).abs() < 1e-14, "{} {}", report.det, product);
    }

    #[test]
    fn a_tool_moves_the_determinant_not_at_all_and_the_singularities_neither(q in posture(puma())) {
        let tool = Model::<6>::new(robot("puma560"), Some("flange")).unwrap();
        let (a, _) = analysed(puma(), "puma560", &q, &Vector6::zeros());
        let (b, _) = analysed(&tool, "puma560", &q, &Vector6::zeros());
        prop_assert!((a.det - b.det).abs() < 1e-14);
        prop_assert!((a.p_BC - b.p_BC).norm() < 1e-14);
        for (x, y) in a.listed().iter().zip(b.listed()) {
            prop_assert!((x.zeta_B - y.zeta_B).norm() < 1e-13 && (x.gain - y.gain).abs() < 1e-13);
        }
    }

}

#[test]
fn the_auxiliary_motion_moves_zeta_by_the_gain_and_nothing_else() {
    let (mut random, mut lone) = (Uniform(1), 0);
    for k in 0..2000 {
        let q = at_locks(&mut random, k % 8);
        let (report, terms) = analysed(puma(), "puma560", &q, &Vector6::zeros());
        let at = AtCentre::new(&terms, &report.p_BC, &terms.omega[5]);
        let (engaged, zero) = (engaged(&report, 0.0), Vector6::zeros());
        lone += usize::from(engaged.len() == 1);
        let rows = Rows::of(&problem(&terms, &at, &zero), &engaged).unwrap();
        let lu = rows.J_T.transpose().lu();
        for (i, active) in engaged.iter().enumerate() {
            let w = lu
                .solve(&Vector6::from_fn(|j, _| {
                    if j == rows.kept + i { 1.0 } else { 0.0 }
                }))
                .unwrap();
            let moved = active.zeta_B.dot(&(at.J * w));
            // With other locks active, ζ of this one is not orthogonal to theirs: only a lone one moves by its own gain alone.
            if engaged.len() == 1 {
                assert!(
                    (moved - active.gain).abs() < 1e-9,
                    "{:?}: {moved} against {}",
                    report.singularities[i].kind,
                    active.gain
                );
            }
        }
    }
    assert!(lone > 200, "one direction alone is lost at {lone} postures");
}

#[test]
fn the_augmented_matrix_is_regular_everywhere() {
    let mut random = Uniform(2);
    let (mut smallest, mut of_J) = (f64::MAX, f64::MAX);
    for k in 0..20_000 {
        let q = at_locks(&mut random, k % 8);
        if (0..6).any(|i| q[i] < puma().lower()[i] || q[i] > puma().upper()[i]) {
            continue;
        }
        let (report, terms) = analysed(puma(), "puma560", &q, &Vector6::zeros());
        let mut at = AtCentre::new(&terms, &report.p_BC, &terms.omega[5]);
        (0..3).for_each(|i| at.J.row_mut(i).scale_mut(1.0 / report.length_m));
        // Engaged as long as the law keeps it so on the way out.
        let mut near = report;
        near.singularities
            .iter_mut()
            .for_each(|s| s.eta_out *= LEFT);
        let zero = Vector6::zeros();
        let rows = Rows::of(&problem(&terms, &at, &zero), &engaged(&near, 0.0)).unwrap();
        smallest = smallest.min(rows.J_T.singular_values()[5]);
        of_J = of_J.min(at.J.singular_values()[5]);
    }
    println!("smallest singular value: augmented {smallest}, J {of_J}");
    assert!(smallest > 0.03 && of_J < 1e-6, "{smallest} {of_J}");
}

/// The paper's law in its own form, Γ = J_rᵀΛ_r r + N_T Γ₀, Γ₀ = A·w·(ẍ − ∂x/∂q·J̄_r r) where w moves the auxiliary coordinates by one each and no kept row:
/// by inverses, with nothing in common with the code. The torque, and its part in the null space.
fn papers_torque(problem: &Problem<'_, 6>, engaged: &[Engaged<6>]) -> [Vector6<f64>; 2] {
    let kept = orthogonal_rows::<6>(&problem.task, engaged).unwrap();
    let J_r = DMatrix::from_fn(kept.len(), 6, |i, j| problem.at.J.column(j).dot(&kept[i]));
    let aux = DMatrix::from_fn(engaged.len(), 6, |i, j| engaged[i].aux_row[j]);
    let a = problem.a - problem.at.Jdot_qdot;
    let r = DVector::from_fn(kept.len(), |i, _| kept[i].dot(&a));
    let A = DMatrix::from_column_slice(6, 6, problem.A.as_slice());
    let A_inverse = A.clone().try_inverse().unwrap();
    let Lambda = (&J_r * &A_inverse * J_r.transpose()).try_inverse().unwrap();
    let Jbar = &A_inverse * J_r.transpose() * &Lambda;
    let N_T = DMatrix::<f64>::identity(6, 6) - J_r.transpose() * Jbar.transpose();
    let all = DMatrix::from_fn(6, 6, |i, j| {
        if i < J_r.nrows() {
            J_r[(i, j)]
        } else {
            aux[(i - J_r.nrows(), j)]
        }
    });
    let w = all
        .try_inverse()
        .unwrap()
        .columns(J_r.nrows(), aux.nrows())
        .into_owned();
    let wanted = DVector::from_fn(engaged.len(), |i, _| engaged[i].aux_acceleration);
    let Gamma_0 = A * w * (wanted - &aux * &Jbar * &r);
    let null = N_T * Gamma_0;
    [J_r.transpose() * Lambda * r + &null, null].map(|x| Vector6::from_column_slice(x.as_slice()))
}

#[test]
fn one_solve_gives_the_papers_torque() {
    let mut random = Uniform(3);
    for k in 0..4000 {
        let q = at_locks(&mut random, 1 + k % 7);
        let qdot = Vector6::from_fn(|_, _| random.within(-0.5, 0.5));
        let (report, terms) = analysed(puma(), "puma560", &q, &qdot);
        let at = AtCentre::new(&terms, &report.p_BC, &terms.omega[5]);
        let (engaged, problem) = (engaged(&report, 0.0), problem(&terms, &at, &qdot));
        if engaged.is_empty() {
            continue;
        }
        let one = law::solve(&problem, &engaged).unwrap();
        let [Gamma, null] = papers_torque(&problem, &engaged);
        let scale = Gamma.amax().max(1.0);
        assert!(
            (sum(&one) - Gamma).amax() < 1e-9 * scale,
            "{k}: {} against {Gamma}",
            sum(&one)
        );
        assert!(
            (one.parts.null - null).amax() < 1e-8 * scale,
            "{k}: the same split"
        );
    }
}

#[test]
fn the_blend_is_a_convex_weight_with_the_right_sign() {
    // With a wrong sign of the gain some β between 0 and 1 makes the matrix singular.
    let mut random = Uniform(4);
    for k in 0..2000 {
        let q = at_locks(&mut random, [1, 2, 4][k % 3]);
        let (report, terms) = analysed(puma(), "puma560", &q, &Vector6::zeros());
        let at = AtCentre::new(&terms, &report.p_BC, &terms.omega[5]);
        if report.listed().iter().any(|s| s.s.abs() < 1e-3) {
            continue;
        }
        let zero = Vector6::zeros();
        let det = |beta: f64| {
            let rows = Rows::of(&problem(&terms, &at, &zero), &engaged(&report, beta)).unwrap();
            rows.J_T.determinant()
        };
        let (one, other) = (det(0.0), det(1.0));
        for beta in [0.25, 0.5, 0.75] {
            assert!(
                (det(beta) / one - 1.0).abs() < 1e-6,
                "the row is the same modulo the others: {one}, {}, {other}",
                det(beta)
            );
        }
    }
}

#[test]
fn straight_up_the_ideal_arm_has_rank_three_and_the_measured_one_four() {
    let q = Vector6::new(
        0.3,
        -std::f64::consts::FRAC_PI_2,
        std::f64::consts::FRAC_PI_2,
        0.0,
        0.0,
        0.0,
    );
    let ideal = Model::<6>::new(robot("puma560-ideal"), None).unwrap();
    assert_eq!(
        analysed(&ideal, "puma560-ideal", &q, &Vector6::zeros())
            .0
            .rank,
        3
    );
    let mut q = q;
    q[2] = puma_lengths("puma560").q3_stretched;
    assert_eq!(analysed(puma(), "puma560", &q, &Vector6::zeros()).0.rank, 4);
}

/// β = 1 everywhere: the rows span those of J.
#[test]
fn outside_every_neighbourhood_one_solve_is_operational_space_control() {
    let mut random = Uniform(5);
    let mut checked = 0;
    for k in 0..3000 {
        let q = at_locks(&mut random, k % 8);
        let qdot = Vector6::from_fn(|_, _| random.within(-0.5, 0.5));
        let (report, terms) = analysed(puma(), "puma560", &q, &qdot);
        if report.listed().iter().any(|s| s.s.abs() < 0.02) {
            continue;
        }
        let at = AtCentre::new(&terms, &report.p_BC, &terms.omega[5]);
        let problem = problem(&terms, &at, &qdot);
        let one = law::solve(&problem, &engaged(&report, 1.0)).unwrap();
        let Gamma = terms.A * at.J.lu().solve(&(problem.a - at.Jdot_qdot)).unwrap();
        assert!(
            (sum(&one) - Gamma).amax() < 1e-8 * Gamma.amax().max(1.0),
            "k {k}: {} against {Gamma}",
            sum(&one)
        );
        checked += 1;
    }
    assert!(checked > 900, "{checked} postures");
}

const GAINS: Gains = Gains {
    k: 12.0,
    k_v: 40.0,
    rate_max: 3.0,
    slew: 50.0,
};

/// One singularity at a fixed place, with an auxiliary rate.
fn still(s: f64, inside: bool, aux_rate: f64) -> Singularity<6> {
    Singularity {
        s,
        inside,
        eta_in: 0.1,
        eta_out: 0.2,
        aux_rate,
        ..Singularity::none()
    }
}

#[test]
fn inside_a_neighbourhood_the_loop_is_a_damped_potential() {
    for (s, error, rate) in [(0.0, 0.05, 0.1), (0.03, -0.2, 0.4), (-0.1, 0.01, -1.0)] {
        let target = Target {
            error,
            weight: 1.0,
            mode: Mode::Track,
            ..Target::default()
        };
        let mut state = Loop::default();
        let demand = (0..2000)
            .map(|_| state.step(&still(s, true, rate), &target, &GAINS, false, (1.0, 1e-3)))
            .last()
            .unwrap();
        assert_eq!(demand.beta, 0.0, "the strategy alone acts along ζ");
        // V₀ = ½ k_v K e² in the auxiliary coordinate, of which one is worth one: its gradient is −k_v K e.
        let gradient = Vector1::new(-GAINS.k_v * GAINS.k * error);
        let Gamma_0 = null_torque(
            &Matrix1::identity(),
            &gradient,
            GAINS.k_v,
            &Vector1::new(rate),
        );
        assert!(
            (demand.acceleration - Gamma_0.x).abs() < 1e-9,
            "{} against {}",
            demand.acceleration,
            Gamma_0.x
        );
    }
}

#[test]
fn outside_a_neighbourhood_the_loop_is_not_used() {
    let target = Target {
        error: 0.3,
        weight: 1.0,
        mode: Mode::Track,
        ..Target::default()
    };
    let mut state = Loop::default();
    for s in [0.2, -0.25, 0.9] {
        assert_eq!(
            state.step(&still(s, false, 0.1), &target, &GAINS, false, (1.0, 1e-3)),
            Demand::none()
        );
        assert!(!state.engaged(), "at {s}");
    }
}

#[test]
fn a_feasible_path_runs_at_full_clock_speed() {
    let limits = Vector1::new(10.0);
    let load = Load {
        speed: 0.94,
        holding: Vector1::new(5.0),
        following: Vector1::new(4.0),
        braking: Vector1::new(0.1),
        planned: 1.0,
    };
    // The demand has been there before: a rising one is extrapolated.
    let mut clock = Clock {
        demand: 0.94,
        ..Clock::default()
    };
    for _ in 0..1000 {
        clock.govern(&load, &limits, 1e-3);
        assert_eq!(
            (clock.rate, clock.rate_dot),
            (1.0, 0.0),
            "the desired motion is the path's own"
        );
    }
}
