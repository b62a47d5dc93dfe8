//! The law: one problem, one solve, for every strategy.
//!
//! # The problem
//! Find the torque Γ that follows the desired motion of the end-effector as far as the posture allows, and in the directions that are lost moves the
//! null space instead, so that nothing of it disturbs what is kept.
//!
//! | symbol | code | meaning | shape, unit |
//! |---|---|---|---|
//! | A | `A` | mass matrix | N×N; kg·m² |
//! | J | `at.J` | Jacobian of C, base axes, linear rows first | 6×N |
//! | a* | `a` | acceleration that follows the path and answers to the error | 6; m/s², rad/s² |
//! | ζ_i, s_i | [`Engaged`] | singular direction and measure of an engaged singularity | |
//! | x_i | `aux_row` | its auxiliary coordinate, regular where ζ_iᵀJ vanishes: ζ_iᵀJ = g_i·∂x_i/∂q modulo the other rows | rad |
//! | β_i | `beta` | weight of operational control along ζ_i: 0 inside its neighbourhood, 1 outside | |
//! | ∇V₀, k_vq | `grad_V_0`, `k_vq` | potential and damping of the null space | rad/s²; 1/s |
//!
//! **Rows.** The directions of the task orthogonal to every ζ_i are kept; each engaged singularity has one row more:
//!
//! ```text
//! kept:       e_kᵀJ                                      = e_kᵀ(a* − J̇q̇)         e_k ⊥ ζ_i
//! singular:   β_i·ζ_iᵀJ/g_i + (1 − β_i)·∂x_i/∂q           = β_i·ζ_iᵀ(a* − J̇q̇)/g_i + (1 − β_i)·ẍ_i
//! force:      eᵀJ                                        = eᵀ(a_f − J̇q̇)        in the place of the path's part of a*: [`force`]
//! ```
//!
//! **Solve.** With J̄ = A⁻¹JᵀΛ of these rows (Eq. 4), r their right-hand sides and Γ₀ = −A[∇V₀ + k_vq q̇] (Eq. 5), Γ = JᵀΛr + [1 − JᵀJ̄ᵀ]Γ₀
//! (Eq. 3); gravity and Coriolis are added in joint space, where they are regular. All of it is [`solve`], in
//! [`operational_space`](crate::paper::operational_space).
//!
//! **Strategy.** Which singularities are engaged, and with which β:
//!
//! | strategy | engaged | β |
//! |---|---|---|
//! | `blended` (+) | from η_in on the way in to well beyond η_out on the way out | continuous in q and in the error |
//! | `chang-khatib` | inside their neighbourhoods | 0: the paper's hard switching |
//! | `operational-space`, `dynamically-consistent` | none | |
//!
//! With β = 0 this is the paper's law: its null-space torque is A·Σ w_i·(ẍ_i − ∂x_i/∂q·J̄_r r), w_i the motion that leaves the kept rows alone and moves
//! x_i by one, and gives the same q̈ (test `one_solve_gives_the_papers_torque`). With β = 1 the rows span those of J: operational-space control
//! (`outside_every_neighbourhood_one_solve_is_operational_space_control`). Between, β is a convex weight, because g_i makes both rows the same modulo
//! the kept ones. The other strategies are laws of others: [`baselines`](crate::baselines).

pub mod auxiliary;
pub(crate) mod force;
pub(crate) mod singular_rows;

use crate::baselines;
use crate::centre::AtCentre;
use crate::controller::Setup;
use crate::limits::Parts;
use crate::linear::{Joints, Vector6, angular, linear};
use crate::paper::operational_space::{Operational, null_torque};
use crate::paper::singular_frame::orthogonal_rows;
use crate::state::State;
use crate::tick::{Motion, Now};
use crate::types::Refusal;
use nalgebra::{SMatrix, Vector4};
use shared_types::scenario::Strategy;
use singular_rows::SingularRows;

/// Step 3: torques by the scenario's law.
pub(crate) fn torques<const N: usize>(
    setup: &Setup<N>,
    state: &mut State<N>,
    now: &Now<'_, N>,
    motion: &Motion<N>,
    rows: &SingularRows<N>,
) -> Result<Torques<N>, Refusal> {
    let control = &setup.scenario.control;
    let a = rows.a;
    let problem = &Problem {
        A: &now.terms.A,
        at: now.at,
        qdot: now.qdot,
        task: setup.task,
        a,
        a_path: along_path(&motion.V_nominal, &a, setup.length_m),
        V: motion.V_nominal,
        a_feed: motion.a_feed,
        grad_V_0: setup.postures.gradient(setup, state, now, motion),
        k_vq: control.k_vq(),
    };
    let torques = match control.strategy {
        Strategy::Blended | Strategy::ChangKhatib => solve(problem, rows.engaged()),
        Strategy::OperationalSpace | Strategy::DynamicallyConsistent => solve(problem, &[]),
        Strategy::PseudoInverse => baselines::pseudo_inverse(problem),
        Strategy::DampedLeastSquares => Ok(baselines::resolved_rate(setup, now, motion, problem)),
    }?;
    state.qdot_planned = torques.qdot_nominal * motion.clock;
    Ok(torques)
}

/// The share of the acceleration `a` along the twist `V` of the path, metres made radians by the arm's length.
fn along_path(V: &Vector6, a: &Vector6, length_m: f64) -> Vector6 {
    let dot = |x: &Vector6, y: &Vector6| {
        linear(x).dot(&linear(y)) / (length_m * length_m) + angular(x).dot(&angular(y))
    };
    let size = dot(V, V);
    if size < 1e-8 {
        Vector6::zeros()
    } else {
        V * (dot(V, a) / size)
    }
}

/// What the law solves at one tick. Frame: base axes at C.
#[derive(Clone, Copy, Debug)]
pub struct Problem<'a, const N: usize> {
    /// Mass matrix.
    pub A: &'a SMatrix<f64, N, N>,
    /// Kinematics at C.
    pub at: &'a AtCentre<N>,
    /// Joint velocities, rad/s.
    pub qdot: &'a Joints<N>,
    /// Which of the six task axes count.
    pub task: [bool; 6],
    /// Operational acceleration a*.
    pub a: Vector6,
    /// The share of a* that lies along the path, which the limits give up before the rest.
    pub a_path: Vector6,
    /// Twist of the path at full clock speed, for predicting joint speeds.
    pub V: Vector6,
    /// Acceleration of the path at its present speed, for predicting torques.
    pub a_feed: Vector6,
    /// ∇V₀ of the posture in the null space of all rows (redundant arms), rad/s².
    pub grad_V_0: Joints<N>,
    /// Damping of that null space, 1/s.
    pub k_vq: f64,
}

/// A singularity that takes part in the solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Engaged<const N: usize> {
    /// ζ, base axes, at C.
    pub zeta_B: Vector6,
    /// ζᵀJ = gain·aux_row modulo the other rows.
    pub gain: f64,
    /// 1: operational control along ζ; 0: auxiliary control.
    pub beta: f64,
    /// Gradient of the auxiliary coordinate.
    pub aux_row: Joints<N>,
    /// Desired auxiliary acceleration, less its value at q̈ = 0; rad/s².
    pub aux_acceleration: f64,
    /// Auxiliary rate at which the path would be followed at full clock speed, rad/s.
    pub aux_rate: f64,
}

/// Torques before gravity, Coriolis and limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Torques<const N: usize> {
    /// Along the path, in the null space of the kept rows, and the rest of the task torque: feedback, and the motion orthogonal to the path; N·m.
    pub parts: Parts<N>,
    /// Joint velocities at which the path would be followed at full clock speed, rad/s.
    pub qdot_nominal: Joints<N>,
    /// Joint accelerations of the path itself, without feedback and without a change of its clock, rad/s².
    pub qddot_path: Joints<N>,
}

/// The rows of the problem, those kept first, and their right-hand sides.
#[derive(Clone, Debug)]
pub struct Rows<const N: usize> {
    /// Row i is column i; zero from `count` on.
    pub J_T: SMatrix<f64, N, N>,
    /// How many rows are orthogonal to the singular directions.
    pub kept: usize,
    /// How many there are.
    pub count: usize,
    /// Of each row its share of a*, of the path's part of it, of the path's twist, and of the path's acceleration.
    sides: SMatrix<f64, 4, N>,
}

impl<const N: usize> Rows<N> {
    /// The rows that the head of this module states.
    ///
    /// # Errors
    /// [`Refusal::Singular`] where they outnumber the joints.
    #[inline]
    pub fn of(problem: &Problem<'_, N>, engaged: &[Engaged<N>]) -> Result<Self, Refusal> {
        let (J, Jdot_qdot) = (&problem.at.J, &problem.at.Jdot_qdot);
        let kept = orthogonal_rows::<N>(&problem.task, engaged.iter().map(|one| one.zeta_B))?;
        let mut rows = Self {
            J_T: SMatrix::zeros(),
            kept: kept.len(),
            count: 0,
            sides: SMatrix::zeros(),
        };
        let (a, feed) = (problem.a - Jdot_qdot, problem.a_feed - Jdot_qdot);
        // Transposed once: of each product below the processor then computes several numbers at once.
        let J_T = J.transpose();
        let sides = SMatrix::<f64, 6, 4>::from_columns(&[a, problem.a_path, problem.V, feed]);
        let sides_T = sides.transpose();
        for e in kept.iter() {
            rows.push(J_T * e, sides_T * e);
        }
        for one in engaged {
            let aux = 1.0 - one.beta;
            let mut row = one.aux_row * aux;
            let mut sides = Vector4::new(one.aux_acceleration, 0.0, one.aux_rate, 0.0) * aux;
            // β > 0 only at |s| > η_in, where the gain is far from zero.
            if one.beta > 0.0 {
                let scale = one.beta / one.gain;
                row += J_T * one.zeta_B * scale;
                sides += sides_T * one.zeta_B * scale;
            }
            rows.push(row, sides);
        }
        Ok(rows)
    }

    #[inline]
    fn push(&mut self, row: Joints<N>, sides: Vector4<f64>) {
        self.J_T.set_column(self.count, &row);
        self.sides.set_column(self.count, &sides);
        self.count += 1;
    }
}

/// Torques of the problem, as the head of this module states it; without engaged singularities this is operational-space control.
///
/// The null-space part is Γ's share in the null space of the kept rows, that of singularity i weighted by 1 − β_i, so that the share which the limits
/// give up first is continuous, too.
///
/// Shapes N · Units N·m · Requires every singularity within its neighbourhood to be engaged · Ensures that the null-space part does not accelerate the
/// kept rows · Cost O(N³), no allocation
///
/// # Errors
/// [`Refusal`] if the rows depend on each other: their smallest singular value is above 0.03 wherever every singularity within η_out is engaged.
pub fn solve<const N: usize>(
    problem: &Problem<'_, N>,
    engaged: &[Engaged<N>],
) -> Result<Torques<N>, Refusal> {
    let rows = Rows::of(problem, engaged)?;
    let op = Operational::new(rows.J_T, rows.count, problem.A)?;
    let Gamma_0 = null_torque(problem.A, &problem.grad_V_0, problem.k_vq, problem.qdot);
    let [acceleration, path, velocity, feed] =
        std::array::from_fn(|k| rows.sides.row(k).transpose());
    let mut own = op.not_caused(&acceleration, rows.kept);
    for (k, one) in engaged.iter().enumerate() {
        own[rows.kept + k] *= 1.0 - one.beta;
    }
    let sides = SMatrix::<f64, N, 3>::from_columns(&[acceleration, own, path]);
    let forces = op.force(&sides);
    let [F, F_own, F_path] = std::array::from_fn(|k| forces.column(k).into_owned());
    let motions = op.Jbar(&SMatrix::<f64, N, 2>::from_columns(&[velocity, feed]));
    Ok(Torques {
        parts: Parts {
            null: op.torque(&F_own, &Gamma_0),
            path: op.J_T * F_path,
            rest: op.J_T * (F - F_own - F_path),
        },
        qdot_nominal: motions.column(0).into_owned(),
        qddot_path: motions.column(1).into_owned(),
    })
}
