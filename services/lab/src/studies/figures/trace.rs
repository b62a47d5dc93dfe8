//! The data of a run that a figure needs.

use std::ops::Range;

use model::{Model, Refused, Robot, rotation_log, with_dof};
use nalgebra::{Cholesky, Matrix3, SVector, Vector3};
use shared_types::bounds::larger;
use shared_types::scenario::Scenario;

use crate::trial::Trial;

/// Length of the hand in stick figures, m.
const HAND: f64 = 0.15;

/// One moment.
#[derive(Clone, Debug)]
pub(super) struct Sample {
    /// s.
    pub t: f64,
    /// rad.
    pub q: Vec<f64>,
    /// rad/s.
    pub qdot: Vec<f64>,
    /// Base, joints, end-effector and, in space, the end of a stick along its z axis; m.
    pub arm: Vec<Vector3<f64>>,
    /// End-effector, true and desired; m.
    pub p: Vector3<f64>,
    pub p_d: Vector3<f64>,
    /// Its orientation.
    R: Matrix3<f64>,
    /// Whole, orthogonal to ζ, along ζ.
    pub error_mm: [f64; 3],
    pub error_deg: [f64; 3],
    /// Per singularity: measure and direction.
    pub s: Vec<f64>,
    pub zeta: Vec<Vector3<f64>>,
    inside: Vec<bool>,
    kind: Vec<u32>,
    /// Its type, by [`TYPES`](shared_types::codes::TYPES).
    pub class: Vec<u32>,
    /// The force with which the null-space torques act on the tip of an arm in the plane, |J̄ᵀΓ_null|; N.
    pub coupling_n: Option<f64>,
    segment: u32,
}

impl Sample {
    /// The hand's axis, x, y or z.
    pub(super) fn axis(&self, which: usize) -> Vector3<f64> {
        self.R.column(which).into()
    }

    /// Angle about `axis` by which the end-effector has turned since another moment; rad.
    pub(super) fn turned_about(&self, axis: &Vector3<f64>, since: Option<&Self>) -> f64 {
        since.map_or(0.0, |since| {
            rotation_log(&(self.R * since.R.transpose())).dot(axis)
        })
    }
}

/// A whole run.
#[derive(Clone, Debug)]
pub(super) struct Trace {
    /// Number of samples.
    pub samples: Vec<Sample>,
    dt: f64,
}

impl Trace {
    /// Runs a scenario on one thread.
    ///
    /// # Errors
    /// [`Refused`] where a cycle does not accept the robot or the scenario.
    pub(super) fn of(robot: &Robot, scenario: &Scenario) -> Result<Self, Refused> {
        with_dof!(robot.dof(), N => sized::<N>(robot, scenario))
            .unwrap_or_else(|| Err(Refused::size(robot)))
    }

    /// A quantity over time.
    pub(super) fn over_time(&self, of: &dyn Fn(&Sample) -> f64) -> Vec<(f64, f64)> {
        let samples = self.samples.iter();
        samples.map(|sample| (sample.t, of(sample))).collect()
    }

    /// Where the end-effector is at the start; m.
    pub(super) fn start(&self) -> Vector3<f64> {
        self.samples
            .first()
            .map(|sample| sample.p)
            .unwrap_or_default()
    }

    /// A horizontal direction, to the side on which the end-effector is at the start; the base's x axis where there is none.
    pub(super) fn outwards(&self, direction: Option<Vector3<f64>>) -> Vector3<f64> {
        let direction = direction.unwrap_or_else(Vector3::x);
        if self.start().dot(&direction) < 0.0 {
            -direction
        } else {
            direction
        }
    }

    pub(super) fn largest(&self, of: impl Fn(&Sample) -> f64) -> f64 {
        self.samples.iter().map(of).fold(0.0, larger)
    }

    pub(super) fn last(&self, of: impl Fn(&Sample) -> f64) -> f64 {
        self.samples.last().map_or(f64::NAN, of)
    }

    /// By how much a joint has moved until `t`; degrees.
    pub(super) fn moved_deg(&self, joint: usize, t: f64) -> f64 {
        let until = self
            .samples
            .iter()
            .take_while(|sample| sample.t <= t)
            .last();
        until.zip(self.samples.first()).map_or(0.0, |(end, start)| {
            (end.q[joint] - start.q[joint]).to_degrees()
        })
    }

    /// The range of a joint in a span of time, s; degrees.
    pub(super) fn swing_deg(&self, joint: usize, span: Range<f64>) -> f64 {
        let within = self
            .samples
            .iter()
            .filter(|sample| span.contains(&sample.t));
        let range = within.fold([f64::INFINITY, -f64::INFINITY], |[low, high], sample| {
            [low.min(sample.q[joint]), high.max(sample.q[joint])]
        });
        (range[1] - range[0]).to_degrees()
    }

    /// ζ of a singularity at the start.
    pub(super) fn zeta_at_start(&self, place: usize) -> Vector3<f64> {
        self.samples
            .first()
            .and_then(|sample| sample.zeta.get(place))
            .copied()
            .unwrap_or_else(Vector3::x)
    }

    /// Place of a kind of singularity in the report; the first where there is none.
    pub(super) fn place_of(&self, kind: u32) -> usize {
        self.samples
            .first()
            .and_then(|sample| sample.kind.iter().position(|known| *known == kind))
            .unwrap_or_default()
    }

    /// Until when a singularity's neighbourhood is not left, from the start; s.
    pub(super) fn inside_until(&self, place: usize) -> f64 {
        self.samples
            .iter()
            .take_while(|sample| sample.inside.get(place) == Some(&true))
            .last()
            .map_or(0.0, |sample| sample.t)
    }

    /// The sample at which a singularity's measure is least in size.
    pub(super) fn most_singular(&self, place: usize) -> Option<&Sample> {
        let size = |sample: &Sample| sample.s.get(place).map_or(f64::INFINITY, |s| s.abs());
        self.samples
            .iter()
            .min_by(|a, b| size(a).total_cmp(&size(b)))
    }

    /// When the second segment begins; s.
    pub(super) fn phase_change(&self) -> f64 {
        self.samples
            .iter()
            .find(|sample| sample.segment > 0)
            .map_or(0.0, |sample| sample.t)
            - self.dt
    }
}

fn sized<const N: usize>(robot: &Robot, scenario: &Scenario) -> Result<Trace, Refused> {
    let model = Model::<N>::new(robot, scenario.frame()).map_err(Refused::because)?;
    let is_planar = !robot.task.0[2];
    let mut trace = Trace {
        samples: Vec::new(),
        dt: scenario.dt_s(),
    };
    let trial = Trial {
        robot,
        scenario: scenario.clone(),
        graph: None,
    };
    trial.watch(|tick, error| {
        let (truth, control) = (&tick.plant_state, &tick.control_state);
        let q = SVector::<f64, N>::from_fn(|i, _| truth.q[i]);
        let terms = model.evaluate(&q, &SVector::zeros());
        let (p, R) = (
            Vector3::from(truth.p_BE),
            Matrix3::from_column_slice(&truth.R_BE),
        );
        let hand = (!is_planar).then(|| p + R.column(2) * HAND);
        let singularities = &tick.singularity.singularities[..tick.singularity.count as usize];
        trace.samples.push(Sample {
            t: truth.header.tick as f64 * scenario.dt_s(),
            q: truth.q[..N].to_vec(),
            qdot: truth.qdot[..N].to_vec(),
            arm: [Vector3::zeros()]
                .into_iter()
                .chain(terms.p)
                .chain([p])
                .chain(hand)
                .collect(),
            p,
            p_d: control.p_BE_d.into(),
            R,
            error_mm: error.position,
            error_deg: error.orientation,
            s: singularities.iter().map(|s| s.s).collect(),
            zeta: singularities
                .iter()
                .map(|s| zeta(&s.zeta_B, s.angular != 0))
                .collect(),
            inside: singularities.iter().map(|s| s.inside != 0).collect(),
            kind: singularities.iter().map(|s| s.kind).collect(),
            class: singularities.iter().map(|s| s.class).collect(),
            coupling_n: is_planar
                .then(|| coupling(&model, &q, &SVector::from_fn(|i, _| control.tau_null[i])))
                .flatten(),
            segment: control.segment,
        });
    })?;
    Ok(trace)
}

/// |J̄ᵀΓ| at the tip of an arm in the plane, J̄ = A⁻¹JᵀΛ; N. `None` where the tip cannot move in some direction.
fn coupling<const N: usize>(
    model: &Model<N>,
    q: &SVector<f64, N>,
    torque: &SVector<f64, N>,
) -> Option<f64> {
    let J = model.jacobian(q).fixed_rows::<2>(0).into_owned();
    let A = Cholesky::new(model.mass_matrix(q))?;
    let mobility = Cholesky::new(J * A.solve(&J.transpose()))?;
    Some(mobility.solve(&(J * A.solve(torque))).norm())
}

fn zeta(twist: &[f64; 6], angular: bool) -> Vector3<f64> {
    let half = if angular { &twist[3..] } else { &twist[..3] };
    Vector3::from_column_slice(half)
}
