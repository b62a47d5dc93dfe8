//! Where an arm is singular: s(q) = s₁·s₂·…, the neighbourhoods D_si, the singular directions ζ_i and their frames.
//!
//! [`Analyzer`] takes the singularities of the posture from the arm's [`Family`] and adds the quantities that are computed alike for every arm:
//! neighbourhoods with hysteresis, rank, determinant, manipulability.

use crate::centre::AtCentre;
use crate::linear::{Jacobian, Joints, Vector6, rank, volume};
use crate::paper::neighborhood::Neighborhood;
use crate::singularity::family::{Family, Posture};
use crate::types::{Report, Singularity};
use model::{Factors, Robot, TaskAxes, Terms, unit_scaled};
use nalgebra::SMatrix;
use shared_types::scenario::Analysis;
use shared_types::{AnalyzerCheckpoint, MAX_SINGULARITIES};

/// Singular value over the norm of the unit-scaled J below which a direction counts as lost; between encoder noise (1e-4) and the smallest regular one (3e-2).
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

    /// From now on a tracked direction beyond 1.3 η_out is numeric, of unknown type, and takes any free place. Of postures by themselves, for the Newton
    /// steps onto the singularity of a far direction are nine tenths of a first tick with seven joints; near directions stay the same.
    pub fn leave_far_unnamed(&mut self) {
        self.family.leave_far_unnamed();
    }

    /// The family of its arm.
    pub fn family(&self) -> &Family<N> {
        &self.family
    }

    /// One tick: the factors s_i of s(q) = s₁·s₂·…·s_ns, their neighbourhoods D_si, directions ζ_i and types.
    ///
    /// Units `q` rad, `qdot` rad/s · Frame of every vector in the report: B, at C.
    /// Requires finite `q`, `qdot` and `terms` of this very posture. Cost about 1 µs for six joints, no allocation.
    pub fn step(&mut self, q: &Joints<N>, qdot: &Joints<N>, terms: &Terms<N>) -> Report<N> {
        let mut report = Report::unexamined(self.length_m);
        let at = self.list(q, qdot, terms, &mut report);
        let determinant = self.factors.determinant(q.as_slice());
        conditioning(&mut report, &at.J, &terms.J, determinant, &self.task);
        report
    }

    /// The same without rank, determinant and manipulability, which are zero in it.
    ///
    /// Cost about 0.5 µs for six joints, no allocation.
    #[inline]
    pub(crate) fn listed(
        &mut self,
        q: &Joints<N>,
        qdot: &Joints<N>,
        terms: &Terms<N>,
    ) -> Report<N> {
        let mut report = Report::unexamined(self.length_m);
        self.list(q, qdot, terms, &mut report);
        report
    }

    /// Fills a report but for rank, determinant and manipulability; returns the kinematics at C.
    #[inline]
    pub(crate) fn list(
        &mut self,
        q: &Joints<N>,
        qdot: &Joints<N>,
        terms: &Terms<N>,
        report: &mut Report<N>,
    ) -> AtCentre<N> {
        let family = &mut self.family;
        let p_C = family.centre(terms);
        let at = AtCentre::new(terms, &p_C);
        let posture = Posture {
            q,
            qdot,
            terms,
            at: &at,
        };
        report.p_BC = p_C;
        let before = report.count;
        report.count = family.measure(&posture, &mut report.singularities);
        for left in report
            .singularities
            .iter_mut()
            .take(before)
            .skip(report.count)
        {
            *left = Singularity::none();
        }
        for (singularity, inside) in report.singularities[..report.count]
            .iter_mut()
            .zip(&mut self.inside)
        {
            let kind = singularity.kind.code();
            let neighborhood = Neighborhood {
                eta_in: self.analysis.eta_in.of(kind),
                eta_out: self.analysis.eta_out.of(kind),
            };
            *inside = neighborhood.update(*inside, singularity.s);
            singularity.inside = *inside;
            (singularity.eta_in, singularity.eta_out) = (neighborhood.eta_in, neighborhood.eta_out);
        }
        at
    }

    /// Writes what must survive a restart: all that the next [`step`](Self::step) depends on besides its inputs.
    pub fn save(&self, out: &mut AnalyzerCheckpoint) {
        out.inside = self.inside.map(u32::from);
        self.family.save(out);
    }

    /// Takes up what [`save`](Self::save) has written: the next step continues bit for bit.
    pub fn restore(&mut self, from: &AnalyzerCheckpoint) {
        self.inside = from.inside.map(|inside| inside != 0);
        self.family.restore(from);
    }
}

/// Rank, determinant and manipulability of the task's rows.
///
/// s(q) = det J for a square J, √det JJᵀ for a redundant arm     [CK95 Eq. 1]
///
/// Fills these fields of a report. The rank is that of J at C with its linear rows divided by the report's `length_m`; the determinant is of J at E,
/// unscaled: `closed_form` where the arm has one. Nothing here needs the singular values, which cost as much as all the rest of the analysis: they
/// are computed where they are shown.
#[inline]
fn conditioning<const N: usize>(
    report: &mut Report<N>,
    J_C: &Jacobian<N>,
    J_E: &Jacobian<N>,
    closed_form: Option<f64>,
    task: &[bool; 6],
) {
    let scaled = unit_scaled(J_C, report.length_m, task);
    report.rank = rank(&scaled, RANK_TOLERANCE);
    let rows = TaskAxes(*task).count();
    report.det = if N == 6 && rows == 6 {
        closed_form.unwrap_or_else(|| {
            let square = SMatrix::<f64, 6, 6>::from_fn(|i, j| J_E[(i, j)]);
            let det = square.determinant();
            // It divides by pivots, of which one may be too small to have an inverse: the largest one first leaves that one undivided.
            if det.is_finite() {
                det
            } else {
                square.full_piv_lu().determinant()
            }
        })
    } else {
        volume_of(J_E, task)
    };
    report.manipulability = match rows {
        // To carry J from E to C leaves det JJᵀ as it is, and three rows of it are scaled.
        6 if N >= 6 => report.det.abs() / (report.length_m * report.length_m * report.length_m),
        _ if rows <= N => volume_of(&scaled, task),
        _ => 0.0,
    };
}

/// √det JJᵀ of the task's rows; √det JᵀJ where they are more than the joints.
fn volume_of<const N: usize>(J: &Jacobian<N>, task: &[bool; 6]) -> f64 {
    let rows = TaskAxes(*task).count();
    if rows > N {
        let mut columns: [Vector6; N] =
            std::array::from_fn(|j| Vector6::from_fn(|k, _| if task[k] { J[(k, j)] } else { 0.0 }));
        return volume(&mut columns);
    }
    let (mut counted, mut count) = ([Joints::<N>::zeros(); 6], 0);
    for k in (0..6).filter(|k| task[*k]) {
        counted[count] = J.row(k).transpose();
        count += 1;
    }
    volume(&mut counted[..count])
}
