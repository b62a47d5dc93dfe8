//! The law, tick by tick: the steps of the processes `analyzer` and `controller`, towards a target that is given at each tick.

use std::sync::Arc;

use model::Robot;
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use shared_types::{
    ControlState, MAX_SINGULARITIES, ServoState, SingularityReport, StateEstimate, Target,
    TargetContent, TorqueCommand, codes,
};

use crate::arm::{Arm, is_finite};
use crate::{in_parts, numbers, refused};

/// Age from which a target no longer counts, where those after it are refused; s.
const VALID_S: f64 = 0.1;

/// The part of a law that all its rows share.
struct Task {
    robot: Arc<Robot>,
    /// Before its first tick: each row begins with a copy.
    steps: Steps,
    /// The posture in which it begins; `None`: that of the first tick.
    q: Option<Vec<f64>>,
}

/// The steps of one arm under the law.
struct Steps {
    analyzer: Box<dyn analyzer::Step>,
    controller: Box<dyn controller::Step>,
}

/// One arm under the law, with its last messages.
#[derive(Default)]
struct Row {
    /// `None` before the first tick in a posture of the arm.
    steps: Option<Steps>,
    /// Why there is none yet.
    not_begun: String,
    tick: u64,
    estimate: StateEstimate,
    report: SingularityReport,
    target: Target,
    control: ControlState,
    servo: ServoState,
    torque: TorqueCommand,
}

/// The arguments of a tick, their rows one after another: q, qdot, pose, twist, tau_disturbance.
#[derive(Clone, Copy)]
struct Given<'a>([Option<&'a [f64]>; 5]);

impl Given<'_> {
    /// Row `i` of `count`.
    fn row(&self, i: usize, count: usize) -> Self {
        Self(self.0.map(|all| {
            let all = all?;
            let width = all.len() / count;
            Some(&all[i * width..][..width])
        }))
    }

    /// The target of a tick: a pose that moves on with a twist, a twist alone, or none.
    fn target(&self, tick: u64) -> TargetContent {
        let mut target = TargetContent {
            given_tick: tick,
            valid_s: VALID_S,
            ..TargetContent::default()
        };
        let [_, _, pose, twist, _] = self.0;
        if let Some(twist) = twist {
            target.twist.copy_from_slice(twist);
            target.kind = codes::TARGET_TWIST;
        }
        match pose {
            Some(pose) if pose.len() == 7 => {
                target.position.copy_from_slice(&pose[..3]);
                target.quaternion.copy_from_slice(&pose[3..]);
            }
            Some(X) => {
                let R = Matrix3::from_fn(|i, j| X[4 * i + j]);
                let R = Rotation3::from_matrix_unchecked(R);
                let turn = UnitQuaternion::from_rotation_matrix(&R);
                target.position = [X[3], X[7], X[11]];
                target.quaternion = [turn.w, turn.i, turn.j, turn.k];
            }
            None => return target,
        }
        target.kind = codes::TARGET_POSE;
        target
    }
}

impl Task {
    /// The steps of an arm that begins at rest in `q`.
    fn begin(&self, q: &[f64]) -> Result<Steps, String> {
        self.robot
            .check_posture(q)
            .map_err(|error| error.to_string())?;
        Ok(Steps {
            analyzer: self.steps.analyzer.copied(),
            controller: self.steps.controller.begun_at(q),
        })
    }
}

impl Row {
    /// One tick; the torque is in `self.torque`, zero before the law has begun. Allocates where it begins, and nowhere else.
    fn step(&mut self, task: &Task, given: Given<'_>) {
        let Given([Some(q), qdot, _, _, tau_disturbance]) = given else {
            return;
        };
        let steps = match &mut self.steps {
            Some(steps) => steps,
            none => match task.begin(task.q.as_deref().unwrap_or(q)) {
                Ok(steps) => none.insert(steps),
                Err(why) => return self.not_begun = why,
            },
        };
        let (n, tick, estimate) = (q.len(), self.tick, &mut self.estimate);
        self.tick += 1;
        estimate.header.tick = tick;
        let StateEstimate {
            q: place,
            qdot: rate,
            tau_disturbance: torque,
            ..
        } = estimate;
        for (values, given) in [(place, Some(q)), (rate, qdot), (torque, tau_disturbance)] {
            match given {
                Some(given) => values[..n].copy_from_slice(given),
                None => values.fill(0.0),
            }
        }
        // A state that is not finite is the controller's to refuse, and none for the analysis to remember.
        if is_finite(&estimate.q) && is_finite(&estimate.qdot) {
            steps.analyzer.step(estimate, &mut self.report);
        }
        self.target.target = given.target(tick);
        steps.controller.steer(
            (estimate, &self.report),
            Some(&self.target),
            &mut self.servo,
            &mut self.control,
            &mut self.torque,
        );
    }

    /// Why the law gives no motion any more; empty: it does.
    fn refusal(&self) -> &str {
        match (&self.steps, self.control.refusal) {
            (None, _) => &self.not_begun,
            (_, refusal) => codes::name_of(codes::REFUSALS, refusal),
        }
    }

    fn state(&self) -> LawState {
        let servo = &self.servo;
        let count = (self.report.count as usize).min(MAX_SINGULARITIES);
        let listed = self.report.singularities[..count].iter().enumerate();
        let names = listed.map(|(place, one)| codes::singularity_name(one.kind, place));
        let modes = self
            .control
            .mode
            .map(|mode| codes::name_of(codes::MODES, mode));
        let set_aside = match self.control.rejected_ticks {
            0 => codes::REFUSAL_NONE,
            _ => codes::REFUSAL_ESTIMATE,
        };
        let refusal = self.refusal().to_owned();
        let stopped = [&refusal, codes::name_of(codes::REFUSALS, set_aside)];
        let stopped = stopped.into_iter().find(|words| !words.is_empty());
        LawState {
            tick: self.tick,
            phase: codes::name_of(codes::PHASES, self.torque.phase),
            reason: stopped.map_or_else(
                || codes::reason_text(servo.reason, servo.joint, servo.upper),
                str::to_owned,
            ),
            mode: names.clone().zip(modes).collect(),
            beta: names.zip(self.control.beta).collect(),
            speed_scale: servo.speed_scale,
            targets_refused: servo.refused,
            target_refusal: codes::name_of(codes::TARGET_REFUSALS, servo.refusal),
            refusal,
        }
    }
}

/// The control law of one arm (`step`) or of N arms at once (`step_many`), as in the process `controller` of a steered run.
///
/// `dt` is the time between two steps in s, 1/dt a whole number from 50 to 20000. `q`, shape (n,), rad, is the posture in which it begins at rest, and to
/// which spare joints are drawn; that of the first step where None. `settings` are keys of a scenario: `{"control.k_p": 900, "servo.speed_m_s": 0.2}`.
#[pyclass(module = "armplane")]
pub(crate) struct Law {
    task: Task,
    one: Vec<Row>,
    many: Vec<Row>,
}

#[pymethods]
impl Law {
    #[new]
    #[pyo3(signature = (arm, dt=0.001, q=None, settings=None))]
    fn new(
        arm: &Arm,
        dt: f64,
        q: Option<&Bound<'_, PyAny>>,
        settings: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let mut keys = Vec::new();
        for (key, value) in settings.into_iter().flatten() {
            // As TOML has it: true, not True.
            let value = match value.extract::<bool>() {
                Ok(flag) => flag.to_string(),
                Err(_) => value.str()?.to_string(),
            };
            keys.push(format!("{key}={value}"));
        }
        let rate = (1.0 / dt).round();
        if !((rate * dt - 1.0).abs() < 1e-9 && (50.0..=20_000.0).contains(&rate)) {
            return Err(refused(format!(
                "dt = {dt}: give the time of a tick in s, one over a whole number from 50 to 20000, such as 0.001"
            )));
        }
        keys.push(format!("rate_hz={rate}"));
        let (robot, scenario) = (Arc::clone(&arm.robot), arm.scenario(&keys)?);
        let mut task = Task {
            steps: Steps {
                analyzer: analyzer::cycle(&robot, &scenario).map_err(refused)?,
                controller: controller::cycle(&robot, &scenario).map_err(refused)?,
            },
            robot,
            q: None,
        };
        if let Some(q) = q {
            let q = numbers("q", q, &[], &[&[arm.robot.dof()]])?
                .as_slice()?
                .to_vec();
            task.robot.check_posture(&q).map_err(refused)?;
            task.q = Some(q);
        }
        Ok(Self {
            task,
            one: vec![Row::default()],
            many: Vec::new(),
        })
    }

    /// One tick: the torque, shape (n,), N·m, within the torque limits and torque rates.
    ///
    /// `q` (n,), rad; `qdot` (n,), rad/s. `pose`: of E in B, (7,) `x y z qw qx qy qz` or (4, 4), m; `twist` (6,): with which the pose moves on, or alone
    /// what is asked for, `[linear; angular]` in the axes of B, m/s and rad/s; neither: rest. `tau_disturbance` (n,), N·m: torque on the joints that the
    /// model does not explain. `out` (n,): the array that is filled and returned, so that nothing is allocated.
    ///
    /// No number raises: a NaN in the state, a state that no arm can move to or a posture that the arm does not have is refused, and `state` says why.
    /// A refused law brings the arm to rest; `reset` begins anew. Before the law has begun the torque is zero. Raises ValueError for a wrong shape.
    #[pyo3(signature = (q, qdot, pose=None, twist=None, tau_disturbance=None, out=None))]
    #[allow(clippy::too_many_arguments, reason = "Python's keyword arguments")]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        qdot: &Bound<'py, PyAny>,
        pose: Option<&Bound<'py, PyAny>>,
        twist: Option<&Bound<'py, PyAny>>,
        tau_disturbance: Option<&Bound<'py, PyAny>>,
        out: Option<Bound<'py, PyArray1<f64>>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let n = self.task.robot.dof();
        let out = out.unwrap_or_else(|| PyArray1::zeros(py, n, false));
        numbers("out", &out, &[], &[&[n]])?;
        let given = [Some(q), Some(qdot), pose, twist, tau_disturbance];
        tick(py, &self.task, &mut self.one, &[], given)?;
        let tau = &self.one[0].torque.tau[..n];
        out.try_readwrite()?.as_slice_mut()?.copy_from_slice(tau);
        Ok(out)
    }

    /// One tick of N arms on all cores, each row with its own memory: the torques, shape (N, n), N·m.
    ///
    /// The arguments are those of `step` with a first axis of N rows. N stays the same until `reset`; a row begins with the first call, and again after
    /// `reset(rows)`.
    #[pyo3(signature = (q, qdot, pose=None, twist=None, tau_disturbance=None))]
    fn step_many<'py>(
        &mut self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        qdot: &Bound<'py, PyAny>,
        pose: Option<&Bound<'py, PyAny>>,
        twist: Option<&Bound<'py, PyAny>>,
        tau_disturbance: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (n, task, many) = (self.task.robot.dof(), &self.task, &mut self.many);
        let known = Some(many.len()).filter(|rows| *rows > 0);
        let N = numbers("q", q, &[known], &[&[n]])?.shape()[0];
        let given = [Some(q), Some(qdot), pose, twist, tau_disturbance];
        many.resize_with(N, Row::default);
        let done = tick(py, task, many, &[Some(N)], given);
        if done.is_err() && known.is_none() {
            many.clear();
        }
        done?;
        let tau = many.iter().flat_map(|row| &row.torque.tau[..n]).copied();
        PyArray1::from_iter(py, tau).reshape([N, n])
    }

    /// Forgets everything: the next step begins anew. `rows`, indices or a mask of shape (N,): only those rows of `step_many`.
    #[pyo3(signature = (rows=None))]
    fn reset(&mut self, py: Python<'_>, rows: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let Some(rows) = rows else {
            (self.one, self.many) = (vec![Row::default()], Vec::new());
            return Ok(());
        };
        let all = py
            .import("numpy")?
            .call_method1("arange", (self.many.len(),))?;
        for row in all.get_item(rows)?.try_iter()? {
            self.many[row?.extract::<usize>()?] = Row::default();
        }
        Ok(())
    }

    /// The law's answer to the last `step`, with its reasons.
    #[getter]
    fn state(&self) -> LawState {
        self.one[0].state()
    }

    /// The same of a row of the last `step_many`.
    fn state_of(&self, row: usize) -> PyResult<LawState> {
        let missing = || PyIndexError::new_err(format!("there are {} rows", self.many.len()));
        Ok(self.many.get(row).ok_or_else(missing)?.state())
    }

    /// Whether each row of the last `step_many` was refused, shape (N,).
    #[getter]
    fn refused<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        let refused = self.many.iter().map(|row| !row.refusal().is_empty());
        PyArray1::from_iter(py, refused)
    }

    fn __repr__(&self) -> String {
        format!("Law({}, tick {})", self.task.robot.name, self.one[0].tick)
    }
}

/// The law's answer at a tick, with its reasons.
#[pyclass(frozen, get_all, module = "armplane")]
pub(crate) struct LawState {
    /// Steps since the law began.
    tick: u64,
    /// running, settling, done, refused.
    phase: &'static str,
    /// How the arm follows its target, in words: follows, rests, slowed near a singularity, at the boundary of reach, …; the refusal where there is one.
    reason: String,
    /// Why the law has given up: the arm is brought to rest until `reset`. Empty: it has not.
    refusal: String,
    /// By a singularity's name: regular, blend, track, pass, hold, reorient, slide, recover.
    mode: std::collections::BTreeMap<String, &'static str>,
    /// By a singularity's name: β, the share of the operational-space command along ζ, 0 to 1.
    beta: std::collections::BTreeMap<String, f64>,
    /// Share of the twist asked for that the arm moves with, 0 to 1.
    speed_scale: f64,
    /// Targets refused since the law began.
    targets_refused: u32,
    /// Why the last of them was; the one before it stays in force for 0.1 s.
    target_refusal: &'static str,
}

#[pymethods]
impl LawState {
    fn __repr__(&self) -> String {
        let (tick, phase, reason) = (self.tick, self.phase, &self.reason);
        format!(
            "LawState(tick {tick}, {phase}: {reason}; mode {:?}, beta {:?})",
            self.mode, self.beta
        )
    }
}

/// One tick of each row, towards the arguments of a step.
///
/// # Errors
/// `ValueError` for the first argument that has another shape.
fn tick(
    py: Python<'_>,
    task: &Task,
    rows: &mut [Row],
    count: &[Option<usize>],
    given: [Option<&Bound<'_, PyAny>>; 5],
) -> PyResult<()> {
    const NAMES: [&str; 5] = ["q", "qdot", "pose", "twist", "tau_disturbance"];
    let n = &[task.robot.dof()][..];
    let shapes: [&[&[usize]]; 5] = [&[n], &[n], &[&[7], &[4, 4]], &[&[6]], &[n]];
    let (mut arrays, mut all) = ([const { None }; 5], [None; 5]);
    for (i, array) in arrays.iter_mut().enumerate() {
        let numbers = given[i].map(|given| numbers(NAMES[i], given, count, shapes[i]));
        *array = numbers.transpose()?;
    }
    for (slice, array) in all.iter_mut().zip(&arrays) {
        *slice = array.as_ref().map(|array| array.as_slice()).transpose()?;
    }
    let N = rows.len();
    py.detach(|| {
        in_parts(rows, |first, part| {
            for (i, row) in (first..).zip(part) {
                row.step(task, Given(all).row(i, N));
            }
        });
    });
    Ok(())
}
