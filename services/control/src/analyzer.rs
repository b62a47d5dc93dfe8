//! Where an arm is singular: s(q) = s₁·s₂·…, the neighbourhoods D_si, the singular directions ζ_i and their frames.
//!
//! [`Analyzer`] takes the singularities of the posture from the arm's [`Family`] and adds the quantities that are computed alike for every arm:
//! neighbourhoods with hysteresis, unit-scaled singular values, rank, determinant, manipulability.

use crate::arm_family::choice::Family;
use crate::arm_family::family::Posture;
use crate::centre::AtCentre;
use crate::linear::{Lu, singular_values};
use crate::paper::neighborhood::Neighborhood;
use crate::types::Report;
use model::{Factors, Robot, Terms};
use nalgebra::{SMatrix, SVector};
use shared_types::scenario::Analysis;
use shared_types::{AnalyzerCheckpoint, MAX_SINGULARITIES};

/// Relative singular value below which a direction counts as lost; between encoder noise (1e-4) and the smallest regular one (3e-2).
pub const RANK_TOLERANCE: f64 = 1e-3;

/// The singularity analysis of one arm.
#[derive(Clone, Debug)]
pub struct Analyzer<const N: usize> {
    family: Family<N>,
    analysis: Analysis,
    factors: Factors,
    length_m: f64,
    task: [bool; 6],
    inside: [bool; MAX_SINGULARITIES],
}

impl<const N: usize> Analyzer<N> {
    /// An analyzer for `robot` with the scenario's thresholds.
    #[must_use]
    pub fn new(robot: &Robot, analysis: &Analysis) -> Self {
        Self {
            family: Family::of(robot, analysis),
            analysis: analysis.clone(),
            factors: robot.factors,
            length_m: robot.length_m,
            task: robot.task.0,
            inside: [false; MAX_SINGULARITIES],
        }
    }

    /// The family of its arm.
    #[must_use]
    pub fn family(&self) -> &Family<N> {
        &self.family
    }

    /// One tick: the factors s_i of s(q) = s₁·s₂·…·s_ns, their neighbourhoods D_si, directions ζ_i and types.
    ///
    /// Units `q` rad, `qdot` rad/s · Frame of every vector in the report: B, at C.
    /// Requires finite `q`, `qdot` and `terms` of this very posture. Cost about 2 µs for six joints, no allocation.
    pub fn step(&mut self, q: &SVector<f64, N>, qdot: &SVector<f64, N>, terms: &Terms<N>) -> Report<N> {
        let (mut report, at) = self.listed(q, qdot, terms);
        conditioning(&mut report, &at.J, &terms.J, self.factors.determinant(q.as_slice()), &self.task);
        report
    }

    /// The same without singular values, rank and determinant, which are zero in it; and the kinematics at C.
    ///
    /// Cost about 1 µs for six joints, no allocation.
    pub(crate) fn listed(&mut self, q: &SVector<f64, N>, qdot: &SVector<f64, N>, terms: &Terms<N>) -> (Report<N>, AtCentre<N>) {
        let family = self.family.get_mut();
        let p_C = family.centre(terms);
        let at = AtCentre::new(terms, &p_C, &terms.omega[N - 1]);
        let posture = Posture { q, qdot, terms, at: &at };
        let mut report = Report::unexamined(self.length_m, p_C);
        report.count = family.measure(&posture, &mut report.singularities);
        for (singularity, inside) in report.singularities[..report.count].iter_mut().zip(&mut self.inside) {
            let kind = singularity.kind.code();
            let neighborhood = Neighborhood { eta_in: self.analysis.eta_in.of(kind), eta_out: self.analysis.eta_out.of(kind) };
            *inside = neighborhood.update(*inside, singularity.s);
            singularity.inside = *inside;
            (singularity.eta_in, singularity.eta_out) = (neighborhood.eta_in, neighborhood.eta_out);
        }
        (report, at)
    }

    /// Writes what must survive a restart: all that the next [`step`](Self::step) depends on besides its inputs.
    pub fn save(&self, out: &mut AnalyzerCheckpoint) {
        out.inside = self.inside.map(u32::from);
        self.family.get().save(out);
    }

    /// Takes up what [`save`](Self::save) has written: the next step continues bit for bit.
    pub fn restore(&mut self, from: &AnalyzerCheckpoint) {
        self.inside = from.inside.map(|inside| inside != 0);
        self.family.get_mut().restore(from);
    }
}

/// Singular values, rank, condition, determinant and manipulability of the task's rows.
///
/// s(q) = det J for a square J, √det JJᵀ for a redundant arm     [CK95 Eq. 1]
///
/// Fills these fields of a report. The singular values are of J at C with its linear rows divided by the report's `length_m`; the determinant is of
/// J at E, unscaled: `closed_form` where the arm has one.
fn conditioning<const N: usize>(
    report: &mut Report<N>,
    J_C: &SMatrix<f64, 6, N>,
    J_E: &SMatrix<f64, 6, N>,
    closed_form: Option<f64>,
    task: &[bool; 6],
) {
    let mut scaled = *J_C;
    let mut unscaled = *J_E;
    let mut rows = 0;
    for (k, counts) in task.iter().enumerate() {
        if !counts {
            scaled.row_mut(k).fill(0.0);
            unscaled.row_mut(k).fill(0.0);
            continue;
        }
        rows += 1;
        if k < 3 {
            scaled.row_mut(k).scale_mut(1.0 / report.length_m);
        }
    }
    let count = rows.min(N);
    let (sigma, _) = singular_values(&scaled);
    let product = |values: &[f64; 6]| values[..count].iter().product::<f64>();
    report.det = if N == 6 && count == 6 {
        closed_form.unwrap_or_else(|| {
            let square = SMatrix::<f64, 6, 6>::from_fn(|i, j| unscaled[(i, j)]);
            Lu::new(square).map_or(0.0, |lu| lu.determinant())
        })
    } else {
        product(&singular_values(&unscaled).0)
    };
    let (largest, smallest) = (sigma[0], sigma[count.saturating_sub(1)]);
    report.rank = sigma[..count].iter().filter(|s| **s > RANK_TOLERANCE * largest).count() as u32;
    report.sigma = sigma;
    report.condition = if smallest > largest * 1e-18 { largest / smallest } else { 1e18 };
    report.manipulability = if rows <= N { product(&sigma) } else { 0.0 };
}
