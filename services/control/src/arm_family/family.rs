//! The interface between the law and an arm: one trait for measures and references together.

use crate::centre::{AtCentre, PoseMotion};
use crate::continuous::foresight::{Foreseen, Foresight};
use crate::paper::reference::Memory;
use crate::paper::type_1::Fold;
use crate::paper::type_2::Direction;
use crate::trajectory::Ahead;
use crate::types::Singularity;
use model::Terms;
use nalgebra::{SVector, Vector3, Vector6};
use shared_types::{AnalyzerCheckpoint, MAX_SINGULARITIES};

/// The arm at one tick.
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

/// The arm and its desired motion at one tick: all that a reference is computed from.
#[derive(Clone, Copy, Debug)]
pub struct Situation<'a, const N: usize> {
    /// Joint positions, rad.
    pub q: &'a SVector<f64, N>,
    /// Joint velocities that the path needs, by the law's own solution, rad/s: a reference's rate follows from them and not from measured ones, whose
    /// noise it would amplify near a singularity.
    pub qdot_planned: &'a SVector<f64, N>,
    /// The model's terms.
    pub terms: &'a Terms<N>,
    /// Kinematics at C.
    pub at: &'a AtCentre<N>,
    /// Desired motion of C.
    pub desired: &'a PoseMotion,
    /// Its twist if the clock ran at full speed.
    pub V_nominal: &'a Vector6<f64>,
    /// The rest of the path's leg.
    pub ahead: &'a Ahead,
    /// Pose error at C, `[p_d − p; log(R_d Rᵀ)]`.
    pub error: &'a Vector6<f64>,
    /// Lower joint limits, rad.
    pub lower: &'a SVector<f64, N>,
    /// Upper joint limits, rad.
    pub upper: &'a SVector<f64, N>,
    /// Largest auxiliary rate, rad/s.
    pub rate_max: f64,
    /// Whether the governor may slow the path down.
    pub governed: bool,
    /// Whether the goal is beyond reach, as the plan of the path has found.
    pub clips: bool,
}

/// The singularities of one family of arms, and where their auxiliary coordinates should go.
///
/// Ensures that each singularity keeps its place for the whole run, that ζ_i, s_i and `aux` are continuous in q, and that nothing is allocated.
/// `inside` and the thresholds are the analyzer's.
pub trait ArmFamily<const N: usize> {
    /// The point C of the end-effector link at which singularities are analysed. Shape 3; m; frame B.
    fn centre(&self, terms: &Terms<N>) -> Vector3<f64>;

    /// Fills the singularities of a posture and returns how many there are, at most [`MAX_SINGULARITIES`].
    ///
    /// Requires finite numbers of one posture · Ensures what [`Singularity`] states · Cost bounded, no
    /// allocation.
    fn measure(
        &mut self,
        posture: &Posture<'_, N>,
        out: &mut [Singularity<N>; MAX_SINGULARITIES],
    ) -> usize;

    /// The coordinate of a Type 1 singularity as the desired pose needs it; `None`: ζ is held. Called for Type 1 only.
    fn fold(&self, _s: &Singularity<N>, _at: &Situation<'_, N>) -> Option<Fold> {
        None
    }

    /// The direction of ζ that the desired motion needs; `None`: ζ is held. Called for Type 2 and mixed only.
    fn direction(
        &self,
        _s: &Singularity<N>,
        _at: &Situation<'_, N>,
        _memory: &mut Memory,
    ) -> Option<Direction> {
        None
    }

    /// Joint motion that turns ζ by `angle` (rad) about the second axis of its frame while the end-effector rests. Shape N; rad; `None` where there is
    /// none. Requires a posture at the singularity.
    fn turning(
        &self,
        _s: &Singularity<N>,
        _terms: &Terms<N>,
        _p_BC: &Vector3<f64>,
        _angle: f64,
    ) -> Option<SVector<f64, N>> {
        None
    }

    /// Largest share of any rate limit on each stretch of the path ahead; nothing is foreseen without formulas.
    fn foresee(&self, _at: &Foresight<'_, N>, _out: &mut Foreseen) {}

    /// The first place of the report from which on the singularities have codimension two or more: a self-motion leads around them, and the null
    /// space is driven away from them.
    fn first_of_higher_codimension(&self) -> Option<usize> {
        None
    }

    /// Writes what must survive a restart; nothing where everything is computed anew from each posture.
    fn save(&self, _out: &mut AnalyzerCheckpoint) {}

    /// Takes up what [`save`](Self::save) has written.
    fn restore(&mut self, _from: &AnalyzerCheckpoint) {}
}
