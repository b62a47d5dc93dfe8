//! The additions to the paper reduce to the paper's law inside D_si and to operational-space control outside.

use crate::centre::AtCentre;
use crate::law::auxiliary::LEFT;
use crate::law::force::Pressing;
use crate::law::{self, Engaged, Problem, Rows};
use crate::linear::{Basis, Vector3, Vector6, linear, stack};
use crate::paper::singular_frame::orthogonal_rows;
use crate::singularity::analyzer::Analyzer;
use crate::testing::{PumaLengths, posture, puma, puma_lengths, robot};
use crate::types::Report;
use model::{Model, Terms};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;
use shared_types::random::Uniform;
use shared_types::scenario::Analysis;

fn analysed(model: &Model<6>, name: &str, q: &Vector6, qdot: &Vector6) -> (Report<6>, Terms<6>) {
    let terms = model.evaluate(q, qdot);
    (
        Analyzer::new(robot(name), &Analysis::default()).step(q, qdot, &terms),
        terms,
    )
}

/// A random posture with some of the three locks forced, and which of them.
fn at_locks(random: &mut Uniform, locks: usize) -> Vector6 {
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
        q[1] = lengths.overhead(q[2]) + near(random);
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

/// A posture as the law meets it.
struct Met {
    report: Report<6>,
    terms: Terms<6>,
    at: AtCentre<6>,
    qdot: Vector6,
}

impl Met {
    fn new(q: &Vector6, qdot: Vector6) -> Self {
        let (report, terms) = analysed(puma(), "puma560", q, &qdot);
        let at = AtCentre::new(&terms, &report.p_BC);
        Self {
            report,
            terms,
            at,
            qdot,
        }
    }

    fn problem(&self) -> Problem<'_, 6> {
        Problem {
            A: &self.terms.A,
            at: &self.at,
            qdot: &self.qdot,
            task: [true; 6],
            a: Vector6::new(0.3, -0.5, 0.2, 0.4, -0.1, 0.6),
            a_path: Vector6::zeros(),
            V: Vector6::zeros(),
            a_feed: Vector6::zeros(),
            grad_V_0: Vector6::zeros(),
            k_vq: 40.0,
        }
    }

    fn rows(&self, beta: f64) -> Rows<6> {
        Rows::of(&self.problem(), &engaged(&self.report, beta)).unwrap()
    }

    /// Whether a measure is nearer to its lock than this.
    fn is_within(&self, s: f64) -> bool {
        self.report.listed().iter().any(|one| one.s.abs() < s)
    }
}

fn moving(random: &mut Uniform) -> Vector6 {
    Vector6::from_fn(|_, _| random.within(-0.5, 0.5))
}

proptest! {
    // covers: CK95 Eq. 1 (analyzer::conditioning)
    // covers: CK95 Eq. 1 (factors::Factors::measure)
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
        let met = Met::new(&at_locks(&mut random, k % 8), Vector6::zeros());
        let rows = met.rows(0.0);
        let lu = rows.J_T.transpose().lu();
        // With other locks active, ζ of this one is not orthogonal to theirs: only a lone one moves by its own gain alone.
        if let [active] = &engaged(&met.report, 0.0)[..] {
            lone += 1;
            let row = Vector6::from_fn(|j, _| f64::from(u8::from(j == rows.kept)));
            let moved = active.zeta_B.dot(&(met.at.J * lu.solve(&row).unwrap()));
            let gain = active.gain;
            assert!((moved - gain).abs() < 1e-9, "{moved} against {gain}");
        } else {
            assert!(lu.is_invertible(), "{k}");
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
        let mut met = Met::new(&q, Vector6::zeros());
        let length_m = met.report.length_m;
        (0..3).for_each(|i| met.at.J.row_mut(i).scale_mut(1.0 / length_m));
        // Engaged as long as the law keeps it so on the way out.
        let listed = met.report.singularities.iter_mut();
        listed.for_each(|s| s.eta_out *= LEFT);
        smallest = smallest.min(met.rows(0.0).J_T.singular_values()[5]);
        of_J = of_J.min(met.at.J.singular_values()[5]);
    }
    println!("smallest singular value: augmented {smallest}, J {of_J}");
    assert!(smallest > 0.03 && of_J < 1e-6, "{smallest} {of_J}");
}

/// The directions that are kept.
fn kept(problem: &Problem<'_, 6>, engaged: &[Engaged<6>]) -> Basis<6> {
    orthogonal_rows::<6>(&problem.task, engaged.iter().map(|one| one.zeta_B)).unwrap()
}

/// The paper's law in its own form, Γ = J_rᵀΛ_r r + N_T Γ₀, Γ₀ = A·w·(ẍ − ∂x/∂q·J̄_r r) where w moves the auxiliary coordinates by one each and no kept row:
/// by inverses, with nothing in common with the code. The torque, and its part in the null space.
fn papers_torque(problem: &Problem<'_, 6>, engaged: &[Engaged<6>]) -> [Vector6; 2] {
    let kept = kept(problem, engaged);
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
        let met = Met::new(&q, moving(&mut random));
        let (engaged, problem) = (engaged(&met.report, 0.0), met.problem());
        if engaged.is_empty() {
            continue;
        }
        let parts = law::solve(&problem, &engaged).unwrap().parts;
        let [Gamma, null] = papers_torque(&problem, &engaged);
        let (sum, scale) = (parts.sum(), Gamma.amax().max(1.0));
        assert!(
            (sum - Gamma).amax() < 1e-9 * scale,
            "{k}: {sum} against {Gamma}"
        );
        let split = (parts.null - null).amax();
        assert!(split < 1e-8 * scale, "{k}: the same split");
    }
}

#[test]
fn the_blend_is_a_convex_weight_with_the_right_sign() {
    // With a wrong sign of the gain some β between 0 and 1 makes the matrix singular.
    let mut random = Uniform(4);
    for k in 0..2000 {
        let met = Met::new(&at_locks(&mut random, [1, 2, 4][k % 3]), Vector6::zeros());
        if met.is_within(1e-3) {
            continue;
        }
        let det = |beta: f64| met.rows(beta).J_T.determinant();
        for beta in [0.25, 0.5, 0.75] {
            // The row is the same modulo the others.
            let ratio = det(beta) / det(0.0);
            assert!((ratio - 1.0).abs() < 1e-6, "{k}: {ratio} at {beta}");
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
    let (mut random, mut checked) = (Uniform(5), 0);
    for k in 0..3000 {
        let q = at_locks(&mut random, k % 8);
        let met = Met::new(&q, moving(&mut random));
        if met.is_within(0.02) {
            continue;
        }
        let problem = met.problem();
        let sum = law::solve(&problem, &engaged(&met.report, 1.0))
            .unwrap()
            .parts
            .sum();
        let qddot = met
            .at
            .J
            .lu()
            .solve(&(problem.a - met.at.Jdot_qdot))
            .unwrap();
        let Gamma = met.terms.A * qddot;
        let scale = Gamma.amax().max(1.0);
        assert!(
            (sum - Gamma).amax() < 1e-8 * scale,
            "{k}: {sum} against {Gamma}"
        );
        checked += 1;
    }
    assert!(checked > 900, "{checked} postures");
}

/// The force's demand along e accelerates the hand along e, as far as rows are kept, in no other row, and no auxiliary coordinate; and the torque that bears a
/// contact keeps it from moving the arm.
#[test]
fn force_and_motion_are_decoupled() {
    let mut random = Uniform(7);
    let (mut kept_least, mut largest) = (1.0_f64, 0.0_f64);
    for k in 0..2000 {
        let met = Met::new(&at_locks(&mut random, k % 8), moving(&mut random));
        let engaged = engaged(&met.report, 0.0);
        let F = moving(&mut random) * 20.0;
        // Along a lost translation now and then.
        let lost = engaged.iter().map(|one| linear(&one.zeta_B));
        let e = lost
            .filter(|zeta| k % 16 > 7 && zeta.norm() > 0.5)
            .fold(linear(&F), |_, zeta| zeta)
            .normalize();
        let A_inverse = met.terms.A.try_inverse().unwrap();
        let mut problem = met.problem();
        let before = law::solve(&problem, &engaged).unwrap().parts.sum();
        problem.a += stack(&(e * 3.0), &Vector3::zeros());
        let pressing = law::solve(&problem, &engaged).unwrap().parts.sum();
        let bearing = Pressing::touching(F).bearing(&met.terms).unwrap();
        let contact = met.terms.J.tr_mul(&F);
        let change = A_inverse * (pressing + bearing + contact - before);
        let kept = kept(&problem, &engaged);
        let asked = DVector::from_fn(kept.len(), |i, _| 3.0 * linear(&kept[i]).dot(&e));
        let moved = DVector::from_fn(kept.len(), |i, _| kept[i].dot(&(met.at.J * change)));
        kept_least = kept_least.min(asked.norm());
        largest = largest.max((moved - asked).amax());
        for one in &engaged {
            largest = largest.max(one.aux_row.dot(&change).abs());
        }
    }
    println!("largest coupling {largest:e}, least share of e kept {kept_least:e}");
    assert!(
        largest < 1e-10 && kept_least < 1e-6,
        "{largest:e} {kept_least:e}"
    );
}
