//! The choice of an arm's family.

use super::family::{ArmFamily, Posture};
use super::numeric::Numeric;
use super::parallel_axes::ParallelAxes;
use super::puma::Puma;
use super::redundant::Redundant;
use super::spherical_shoulder::SphericalShoulder;
use crate::types::Singularity;
use model::{Factors, Robot, Terms};
use nalgebra::Vector3;
use shared_types::MAX_SINGULARITIES;
use shared_types::scenario::Analysis;

/// The family of one arm. An enum, not a boxed trait object: analyzer and controller stay plain values.
#[derive(Clone, Debug)]
pub enum Family<const N: usize> {
    /// By declared lengths.
    Puma(Puma),
    /// By geometry: three parallel axes.
    ParallelAxes(ParallelAxes),
    /// By geometry: three axes that meet in a shoulder, three in a wrist.
    SphericalShoulder(Box<SphericalShoulder<N>>),
    /// By number.
    Numeric(Box<Numeric<N>>),
    /// By number, with more joints than task axes.
    Redundant(Box<Redundant<N>>),
    /// More task axes than joints: the arm is singular everywhere, and nothing is reported.
    Deficient(Deficient),
}

/// An arm with more task axes than joints.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Deficient;

impl<const N: usize> ArmFamily<N> for Deficient {
    fn centre(&self, terms: &Terms<N>) -> Vector3<f64> {
        terms.X_BE.p
    }

    fn measure(
        &mut self,
        _posture: &Posture<'_, N>,
        _out: &mut [Singularity<N>; MAX_SINGULARITIES],
    ) -> usize {
        0
    }
}

impl<const N: usize> Family<N> {
    /// The family of `robot`: by declared lengths, by its geometry, else by number, as with `analysis.numeric`.
    #[must_use]
    pub fn of(robot: &Robot, analysis: &Analysis) -> Self {
        let numeric = || {
            let square =
                || Numeric::new(robot, analysis).map(|family| Self::Numeric(Box::new(family)));
            let redundant =
                Redundant::new(robot, analysis).map(|family| Self::Redundant(Box::new(family)));
            redundant
                .or_else(square)
                .unwrap_or(Self::Deficient(Deficient))
        };
        match robot.factors {
            // The formulas are those of the whole twist at the wrist centre: a task that leaves a rotation free has other singularities.
            _ if analysis.numeric || robot.task.0 != [true; 6] => numeric(),
            Factors::Puma { a2, a3, d4 } if N == 6 => Self::Puma(Puma::new(a2, a3, d4)),
            _ => None
                .or_else(|| ParallelAxes::of::<N>(robot).map(Self::ParallelAxes))
                .or_else(|| {
                    SphericalShoulder::of(robot, analysis)
                        .map(|family| Self::SphericalShoulder(Box::new(family)))
                })
                .unwrap_or_else(numeric),
        }
    }

    /// The family's name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Puma(_) => "puma",
            Self::ParallelAxes(_) => "parallel axes",
            Self::SphericalShoulder(_) => "spherical shoulder",
            Self::Numeric(_) => "numeric",
            Self::Redundant(_) => "redundant",
            Self::Deficient(_) => "deficient",
        }
    }

    /// The family's methods.
    #[must_use]
    pub fn get(&self) -> &dyn ArmFamily<N> {
        match self {
            Self::Puma(family) => family,
            Self::ParallelAxes(family) => family,
            Self::SphericalShoulder(family) => &**family,
            Self::Numeric(family) => &**family,
            Self::Redundant(family) => &**family,
            Self::Deficient(family) => family,
        }
    }

    /// The family's methods, those that change its state too.
    pub fn get_mut(&mut self) -> &mut dyn ArmFamily<N> {
        match self {
            Self::Puma(family) => family,
            Self::ParallelAxes(family) => family,
            Self::SphericalShoulder(family) => &mut **family,
            Self::Numeric(family) => &mut **family,
            Self::Redundant(family) => &mut **family,
            Self::Deficient(family) => family,
        }
    }
}
