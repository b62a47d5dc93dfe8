//! Where an arm is singular: s(q) = s₁·s₂·…, the neighbourhoods D_si, the singular directions ζ_i and their frames.
//!
//! [`Analyzer`] asks one *source* for the singularities of the posture and adds what is the same for every arm: neighbourhoods with
//! hysteresis, unit-scaled singular values, rank, determinant, manipulability.
//!
//! # The seam
//! A source is anything that implements [`Measures`]: it fills [`Singularity`] values whose promises are written there. `puma` does it
//! by declared lengths, `geometric` by where the axes meet and which are parallel; any other arm does it by number. The law never learns which.

pub mod classify;
pub mod geometric;
mod neighborhood;
mod numeric;
mod puma;

pub use geometric::{GeometricFactors, Geometry};
pub use neighborhood::Neighborhood;
pub use numeric::{Block, Numeric};
pub use puma::PumaFactors;

use crate::MAX_SINGULARITIES;
use crate::centre::AtCentre;
use crate::linear::{Lu, singular_values};
use crate::types::{Report, Singularity};
use model::{Factors, Robot, Terms};
use nalgebra::{SMatrix, SVector, Vector3};
use shared_types::scenario::Analysis;

/// Relative singular value below which a direction counts as lost; between encoder noise (1e-4) and the smallest regular one (3e-2).
pub const RANK_TOLERANCE: f64 = 1e-3;

/// Numbers of a source's own state that survive a restart.
pub const SOURCE_STATE: usize = 24;

/// What a source sees of the arm at a tick.
#[derive(Clone, Copy, Debug)]
pub struct Posture<'a, const N: usize> {
    /// Joint positions, rad.
    pub q: &'a SVector<f64, N>,
    /// Joint velocities, rad/s.
    pub qdot: &'a SVector<f64, N>,
    /// The model's terms at E.
    pub terms: &'a Terms<N>,
    /// Kinematics at C.
    pub at: &'a AtCentre<N>,
}

/// A source of singularities for one arm.
///
/// Ensures that each singularity keeps its place in `out` for the whole run, that ζ_i, s_i and `aux` are continuous in q, and that
/// nothing is allocated. `inside` is left to the caller.
pub trait Measures<const N: usize> {
    /// Where to analyse (a point of the end-effector link), in B, m.
    fn centre(&self, terms: &Terms<N>) -> Vector3<f64>;
    /// Fills the singularities of a posture and says how many there are.
    fn measure(&mut self, posture: &Posture<'_, N>, out: &mut [Singularity<N>; MAX_SINGULARITIES]) -> usize;
    /// What must survive a restart.
    fn state(&self) -> [f64; SOURCE_STATE] {
        [0.0; SOURCE_STATE]
    }
    /// Takes [`state`](Self::state) back.
    fn restore(&mut self, _state: &[f64; SOURCE_STATE]) {}
}

/// The sources there are. An enum, not a trait object: the analyzer stays a plain value.
#[derive(Clone, Debug)]
enum Source<const N: usize> {
    Puma(PumaFactors),
    Geometric(GeometricFactors),
    Numeric(Box<Numeric<N>>),
    /// More task axes than joints: nothing is reported singular.
    None,
}

/// Finds the singularities near a posture.
#[derive(Clone, Debug)]
pub struct Analyzer<const N: usize> {
    source: Source<N>,
    neighborhoods: [Neighborhood; MAX_SINGULARITIES],
    length_m: f64,
    task: [bool; 6],
    inside: [bool; MAX_SINGULARITIES],
}

impl<const N: usize> Analyzer<N> {
    /// An analyzer for `robot` with the scenario's thresholds.
    #[must_use]
    pub fn new(robot: &Robot, analysis: &Analysis) -> Self {
        let neighborhoods: [Neighborhood; MAX_SINGULARITIES] = std::array::from_fn(|i| {
            let i = i.min(analysis.eta_in.len() - 1);
            Neighborhood { eta_in: analysis.eta_in[i], eta_out: analysis.eta_out[i] }
        });
        let numeric =
            || Numeric::new(robot, &neighborhoods.map(|n| n.eta_out)).map_or(Source::None, |numeric| Source::Numeric(Box::new(numeric)));
        let source = match robot.factors {
            _ if analysis.numeric => numeric(),
            Factors::Puma { a2, a3, d4 } if N == 6 => Source::Puma(PumaFactors::new(a2, a3, d4)),
            _ => GeometricFactors::of::<N>(robot).map_or_else(numeric, Source::Geometric),
        };
        Self { source, neighborhoods, length_m: robot.length_m, task: robot.task.0, inside: [false; MAX_SINGULARITIES] }
    }

    /// One tick: the singularities of the posture.
    ///
    /// s(q) = det J = s₁·s₂·…·s_ns     [CK95 Eq. 1]
    ///
    /// Requires finite `q`, `qdot` and `terms` of this very posture. Cost about 2 µs for six joints, no allocation.
    pub fn step(&mut self, q: &SVector<f64, N>, qdot: &SVector<f64, N>, terms: &Terms<N>) -> Report<N> {
        let p_C = match &self.source {
            Source::Puma(puma) => Measures::<N>::centre(puma, terms),
            Source::Geometric(factors) => factors.centre(terms),
            Source::Numeric(numeric) => numeric.centre(terms),
            Source::None => terms.X_BE.p,
        };
        let at = AtCentre::new(terms, &p_C, &terms.omega[N - 1]);
        let posture = Posture { q, qdot, terms, at: &at };
        let mut singularities = [Singularity::none(); MAX_SINGULARITIES];
        let count = match &mut self.source {
            Source::Puma(puma) => puma.measure(&posture, &mut singularities),
            Source::Geometric(factors) => factors.measure(&posture, &mut singularities),
            Source::Numeric(numeric) => numeric.measure(&posture, &mut singularities),
            Source::None => 0,
        };
        for (i, singularity) in singularities[..count].iter_mut().enumerate() {
            let neighborhood = &self.neighborhoods[i];
            self.inside[i] = neighborhood.update(self.inside[i], singularity.s);
            singularity.inside = self.inside[i];
            (singularity.eta_in, singularity.eta_out) = (neighborhood.eta_in, neighborhood.eta_out);
        }
        let conditioning = conditioning(&at.J, &terms.J, self.length_m, &self.task);
        Report { p_BC: p_C, length_m: self.length_m, count, singularities, ..conditioning }
    }

    /// What must survive a restart, for the message's `resume`.
    #[must_use]
    pub fn state(&self) -> [f64; 32] {
        let mut state = [0.0; 32];
        for (place, inside) in state.iter_mut().zip(self.inside) {
            *place = f64::from(u8::from(inside));
        }
        let source = match &self.source {
            Source::Puma(puma) => Measures::<N>::state(puma),
            Source::Geometric(factors) => Measures::<N>::state(factors),
            Source::Numeric(numeric) => numeric.state(),
            Source::None => [0.0; SOURCE_STATE],
        };
        state[32 - SOURCE_STATE..].copy_from_slice(&source);
        state
    }

    /// Takes [`state`](Self::state) back: the next step continues as if nothing had happened.
    pub fn restore(&mut self, state: &[f64; 32]) {
        self.inside = std::array::from_fn(|i| state[i] != 0.0);
        let mut source = [0.0; SOURCE_STATE];
        source.copy_from_slice(&state[32 - SOURCE_STATE..]);
        match &mut self.source {
            Source::Puma(puma) => Measures::<N>::restore(puma, &source),
            Source::Numeric(numeric) => numeric.restore(&source),
            // Computed anew from each posture.
            Source::Geometric(_) | Source::None => {}
        }
    }
}

/// Singular values, rank, condition, determinant and manipulability of the task's rows.
///
/// The singular values are of J at C with its linear rows divided by `length_m`; the determinant is of J at E, unscaled.
fn conditioning<const N: usize>(J_C: &SMatrix<f64, 6, N>, J_E: &SMatrix<f64, 6, N>, length_m: f64, task: &[bool; 6]) -> Report<N> {
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
            scaled.row_mut(k).scale_mut(1.0 / length_m);
        }
    }
    let count = rows.min(N);
    let (sigma, _) = singular_values(&scaled);
    let product = |values: &[f64; 6]| values[..count].iter().product::<f64>();
    let det = if N == 6 && count == 6 {
        let square = SMatrix::<f64, 6, 6>::from_fn(|i, j| unscaled[(i, j)]);
        Lu::new(square).map_or(0.0, |lu| lu.determinant())
    } else {
        product(&singular_values(&unscaled).0)
    };
    let (largest, smallest) = (sigma[0], sigma[count.saturating_sub(1)]);
    Report {
        rank: sigma[..count].iter().filter(|s| **s > RANK_TOLERANCE * largest).count() as u32,
        sigma,
        det,
        condition: if smallest > largest * 1e-18 { largest / smallest } else { 1e18 },
        manipulability: if rows <= N { product(&sigma) } else { 0.0 },
        length_m,
        p_BC: Vector3::zeros(),
        count: 0,
        singularities: [Singularity::none(); MAX_SINGULARITIES],
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A report of an arm that is nowhere singular.
    pub(crate) fn empty_report<const N: usize>() -> Report<N> {
        conditioning(&SMatrix::zeros(), &SMatrix::zeros(), 1.0, &[true; 6])
    }
}
