//! The singularities of one arm: factors of det J where its geometry gives them, tracked by number everywhere else, and the references of their coordinates.
//!
//! | form | arms | by geometry | tracked |
//! |---|---|---|---|
//! | [`Factors`] | six joints, axes 2 and 3 parallel: PUMA 560, Universal Robots, most industrial arms | elbow, wrist, overhead | |
//! | `Elbow` | KUKA iiwa and its kin: three axes meet in a shoulder, three in a wrist | the elbow | vector measures of the rest |
//! | none | with spare joints: Panda, FR3, xArm 7, Gen3 | | vector measures |
//! | none | any other | | signed singular values |
//!
//! The law depends on the type of a singularity, not on who measures it.

use super::axes::{EXACT, ROUNDED, in_general_position, meeting, three_meet};
use super::elbow::{self, BetweenCentres};
use super::factors::Factors;
use super::geometry::Geometry;
use super::reference;
use super::screws::Screws;
use super::tracked_svd::TrackedSvd;
use super::tracker::{TRACKED, Tracker};
use crate::centre::{AtCentre, PoseMotion};
use crate::linear::{Joints, Vector3, Vector6};
use crate::paper::reference::{Memory, Target};
use crate::paper::type_1::Fold;
use crate::reference::path::Ahead;
use crate::types::{Kind, Singularity};
use model::{Model, Robot, Terms};
use shared_types::scenario::Analysis;
use shared_types::{AnalyzerCheckpoint, MAX_SINGULARITIES};

/// The arm at one tick.
#[derive(Clone, Copy, Debug)]
pub struct Posture<'a, const N: usize> {
    /// Joint positions, rad.
    pub q: &'a Joints<N>,
    /// Joint velocities, rad/s.
    pub qdot: &'a Joints<N>,
    /// The model's terms at E.
    pub terms: &'a Terms<N>,
    /// Kinematics at C.
    pub at: &'a AtCentre<N>,
}

/// A singularity, the arm and its desired motion at one tick: all that a reference is computed from.
#[derive(Clone, Copy, Debug)]
pub struct Situation<'a, const N: usize> {
    /// The singularity whose reference it is.
    pub s: &'a Singularity<N>,
    /// Joint positions, rad.
    pub q: &'a Joints<N>,
    /// Joint velocities that the path needs, by the law's own solution, rad/s: a reference's rate follows from them and not from measured ones, whose
    /// noise it would amplify near a singularity.
    pub qdot_planned: &'a Joints<N>,
    /// The model's terms.
    pub terms: &'a Terms<N>,
    /// Kinematics at C.
    pub at: &'a AtCentre<N>,
    /// Desired motion of C.
    pub desired: &'a PoseMotion,
    /// The rest of the path's leg.
    pub ahead: &'a Ahead<'a>,
    /// Pose error at C, `[p_d − p; log(R_d Rᵀ)]`.
    pub error: &'a Vector6,
    /// Motion of the joints per unit of the auxiliary coordinate, the kept rows and the other coordinates at rest; on a path, or of a vector measure, the
    /// coordinate's own direction.
    pub null_motion: &'a Joints<N>,
    /// Motion at C by which the folds before it will open, `[m; rad]`: at the lock ζ is turned out of its way, too.
    pub opening: &'a Vector6,
    /// The arm's model: its joints' limits.
    pub model: &'a Model<N>,
    /// Largest auxiliary rate, rad/s.
    pub rate_max: f64,
    /// Whether the clock slows down for a rate that is too large.
    pub governed: bool,
    /// Whether the goal is beyond reach, as the plan of the path has found.
    pub clips: bool,
}

/// The singularities that an arm has by formula.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Form {
    Factors(Factors),
    /// The elbow alone, between the shoulder's centre S (base axes, m) and the wrist's.
    Elbow(Vector3),
    None,
}

/// The singularities of one arm.
///
/// Ensures that each keeps its place for the whole run but where [`Tracker`] says so, that ζ_i, s_i and `aux` are continuous in q, and that nothing is
/// allocated. `inside` and the thresholds are the analyzer's.
#[derive(Clone, Debug)]
pub struct Family<const N: usize> {
    form: Form,
    /// C on the last axis, from its origin, m; `None`: C is E.
    offset: Option<f64>,
    /// Makes radians of metres, m.
    length_m: f64,
    /// `None` where formulas give all, and for an arm with more task axes than joints, which is singular everywhere: nothing is reported.
    tracker: Option<Tracker<N>>,
}

impl<const N: usize> Family<N> {
    /// The singularities of `robot`: by its geometry, else by number, as with `analysis.numeric`.
    pub fn of(robot: &Robot, analysis: &Analysis) -> Self {
        let nothing = Self {
            form: Form::None,
            offset: None,
            length_m: robot.length_m,
            tracker: None,
        };
        let Ok(model) = Model::<N>::new(robot, None) else {
            return nothing;
        };
        // Any posture without parallel axes.
        let q = Joints::from_fn(|i, _| 0.3 + 0.37 * i as f64);
        let terms = model.evaluate(&q, &Joints::zeros());
        // C's position must not depend on a rotation that the task does not serve: only E itself may then be moved.
        let meets = |tolerance: f64| {
            let turns = robot.task.0[3..].iter().all(|served| *served);
            meeting(&terms, tolerance).0.filter(|_| turns)
        };
        // The formulas are those of the whole twist at C: a task that leaves a rotation free has other singularities.
        let form = if analysis.numeric || !robot.task.is_full() {
            Form::None
        } else {
            Form::of::<N>(robot)
        };
        let found = Self { form, ..nothing };
        let tolerance = if found.is_factored() { ROUNDED } else { EXACT };
        let out = Self {
            offset: meets(tolerance),
            ..found
        };
        if out.is_factored() {
            return out;
        }
        let tracker = out.tracked(robot, analysis, &terms);
        Self { tracker, ..out }
    }

    /// Whether the factors of det J give all singularities.
    pub(crate) fn is_factored(&self) -> bool {
        matches!(self.form, Form::Factors(_))
    }

    /// The tracker of the directions that no formula gives; `None` where there are more task axes than joints.
    fn tracked(&self, robot: &Robot, analysis: &Analysis, terms: &Terms<N>) -> Option<Tracker<N>> {
        let (rows, dof) = (robot.task.count(), robot.dof());
        if rows == 0 || rows > dof {
            return None;
        }
        let whole = TrackedSvd::new((0..6).filter(|k| robot.task.0[*k]), (0, dof));
        let has_wrist = meeting(terms, EXACT).1 && robot.task.is_full() && rows == dof;
        let blocks = if has_wrist {
            &[
                TrackedSvd::new(0..3, (0, N - 3)),
                TrackedSvd::new(3..6, (N - 3, N)),
            ][..]
        } else {
            &[whole][..]
        };
        let S = (N == 7 && robot.task.is_full() && rows < dof)
            .then(|| three_meet(terms, EXACT))
            .flatten();
        let [E, W, S_, X] = [Kind::Elbow, Kind::Wrist, Kind::Shoulder, Kind::Numeric];
        let names = match self.form {
            Form::Elbow(_) => &[W, S_, X][..],
            _ if S.is_some() => &[E, W, S_, X],
            _ if has_wrist => &[X, X, X, W],
            _ if rows < dof => &[X; TRACKED][..rows.min(TRACKED)],
            _ => &[X; MAX_SINGULARITIES][..rows.min(MAX_SINGULARITIES)],
        };
        let geometry = Geometry {
            S,
            elbow_apart: matches!(self.form, Form::Elbow(_)),
        };
        let C = self.centre(terms);
        let at = AtCentre::new(terms, &C);
        let arm = (Screws(at.J), C - S.unwrap_or_default());
        let length_m = robot.length_m;
        Some(Tracker::new(
            &arm, geometry, blocks, length_m, analysis, names,
        ))
    }

    /// See [`Analyzer::leave_far_unnamed`](super::analyzer::Analyzer::leave_far_unnamed).
    pub(super) fn leave_far_unnamed(&mut self) {
        if let Some(tracker) = &mut self.tracker {
            tracker.leave_far_unnamed();
        }
    }

    /// The point C of the end-effector link at which singularities are analysed. Shape 3; m; frame B.
    pub fn centre(&self, terms: &Terms<N>) -> Vector3 {
        self.offset.map_or(terms.X_BE.p, |offset| {
            terms.p[N - 1] + terms.z[N - 1] * offset
        })
    }

    /// Fills the singularities of a posture and returns how many there are, at most [`MAX_SINGULARITIES`].
    ///
    /// Requires finite numbers of one posture · Ensures what [`Singularity`] states · Cost bounded, no allocation.
    pub fn measure(
        &mut self,
        posture: &Posture<'_, N>,
        out: &mut [Singularity<N>; MAX_SINGULARITIES],
    ) -> usize {
        let first = match &self.form {
            Form::Factors(factors) => factors.measure(posture, out),
            Form::Elbow(S) => {
                out[0] = BetweenCentres::new(S, posture.terms, &posture.at.p).measure(posture);
                1
            }
            Form::None => 0,
        };
        let tracker = self.tracker.as_mut();
        first + tracker.map_or(0, |tracker| tracker.measure(posture, &mut out[first..]))
    }

    /// The coordinate of a Type 1 singularity as the desired pose needs it; `None`: ζ is held. Called for Type 1 only.
    pub fn fold(&self, at: &Situation<'_, N>) -> Option<Fold> {
        match &self.form {
            Form::Elbow(S) if at.s.kind == Kind::Elbow => {
                let cosine = BetweenCentres::new(S, at.terms, &at.at.p).cosine(S, at.desired);
                Some(elbow::fold(at.s.aux, cosine))
            }
            Form::Factors(_) => at.fold(reference::GEOMETRY_DAMPING),
            _ => at.fold(reference::FOLD_DAMPING),
        }
    }

    /// The direction of ζ that the desired motion needs; `None`: ζ is held. Called for Type 2 and mixed only.
    pub fn direction(&self, at: &Situation<'_, N>, memory: &mut Memory) -> Option<Target> {
        if self.measures_vectors() {
            at.direction(self.length_m, memory)
        } else {
            at.signed(self.length_m, memory)
        }
    }

    /// Whether no formula gives any of them.
    pub fn is_tracked(&self) -> bool {
        matches!(self.form, Form::None) && self.tracker.is_some()
    }

    /// Whether the measures are vectors: with spare joints, where singularities have codimension two or more.
    pub fn measures_vectors(&self) -> bool {
        (self.tracker.as_ref()).is_some_and(Tracker::measures_vectors)
    }

    /// The first place of the report from which on the singularities have codimension two or more: a self-motion leads around them, and the null
    /// space is driven away from them.
    pub fn first_of_higher_codimension(&self) -> Option<usize> {
        let tracker = self.tracker.as_ref().filter(|one| one.measures_vectors());
        tracker.map(|_| usize::from(matches!(self.form, Form::Elbow(_))))
    }

    /// Whether the singularity at a place of the report has codimension two or more.
    pub fn has_higher_codimension(&self, place: usize) -> bool {
        let first = self.first_of_higher_codimension();
        first.is_some_and(|first| place >= first)
    }

    /// Writes what must survive a restart; nothing where everything is computed anew from each posture.
    pub fn save(&self, out: &mut AnalyzerCheckpoint) {
        if let Some(tracker) = &self.tracker {
            tracker.save(out);
        }
    }

    /// Takes up what [`save`](Self::save) has written.
    pub fn restore(&mut self, from: &AnalyzerCheckpoint) {
        if let Some(tracker) = &mut self.tracker {
            tracker.restore(from);
        }
    }
}

impl Form {
    fn of<const N: usize>(robot: &Robot) -> Self {
        if let Some(factors) = Factors::of::<N>(robot) {
            return Self::Factors(factors);
        }
        let centres = |terms: &Terms<N>| {
            let (offset, spherical) = meeting(terms, EXACT);
            let S = three_meet(terms, EXACT)?;
            offset
                .filter(|_| spherical && N == 7)
                .map(|offset| (S, offset))
        };
        let same = |one: &(Vector3, f64), two: &(Vector3, f64)| {
            (one.0 - two.0).norm() < EXACT && (one.1 - two.1).abs() < EXACT
        };
        in_general_position(robot, centres, same).map_or(Self::None, |(S, _)| Self::Elbow(S))
    }
}
