//! The law, tick by tick, towards a target that is given at each tick.

use arm::{Given, Row, State, Task};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::{PyIndexError, PyMemoryError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arm::Arm;
use crate::{in_parts, numbers, refused};

/// The control law of one arm (`step`) or of N arms at once (`step_many`), as in the process `controller` of a steered run.
///
/// `dt` is the time between two steps in s, 1/dt a whole number from 50 to 20000. `q`, shape (n,), rad, is the posture in which it begins at rest, and to
/// which spare joints are drawn; that of the first step where None. `settings` are keys of a scenario: `{"control.k_p": 900, "servo.speed_m_s": 0.2}`.
#[pyclass(module = "armplane")]
pub(crate) struct Law {
    task: Task,
    one: [Row; 1],
    many: Vec<Row>,
}

#[pymethods]
impl Law {
    #[new]
    #[pyo3(signature = (arm, dt=0.001, q=None, settings=None))]
    fn new(
        arm: &Bound<'_, PyAny>,
        dt: f64,
        q: Option<&Bound<'_, PyAny>>,
        settings: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let Ok(arm) = arm.cast::<Arm>() else {
            let given = arm.repr()?;
            let why =
                format!("arm is {given}: give an Arm, such as armplane.Arm.builtin(\"puma560\")");
            return Err(PyTypeError::new_err(why));
        };
        let arm = arm.get();
        let mut keys = Vec::new();
        for (key, value) in settings.into_iter().flatten() {
            // As TOML has it: true, not True.
            let value = match value.extract::<bool>() {
                Ok(flag) => flag.to_string(),
                Err(_) => value.str()?.to_string(),
            };
            keys.push(format!("{key}={value}"));
        }
        let n = arm.inner.robot().dof();
        let q = q.map(|q| numbers("q", q, &[], &[&[n]])).transpose()?;
        let q = q.as_ref().map(|q| q.as_slice()).transpose()?;
        let task = Task::new(&arm.inner, dt, q, keys).map_err(refused)?;
        Ok(Self {
            one: [Row::new(&task)],
            task,
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
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let n = self.task.robot().dof();
        let unfit = || {
            refused(format!(
                "out has to be a writable float64 array of shape ({n},), its numbers side by side"
            ))
        };
        let out = match out {
            Some(given) => given.cast::<PyArray1<f64>>().map_err(|_| unfit())?.clone(),
            None => PyArray1::zeros(py, n, false),
        };
        numbers("out", &out, &[], &[&[n]])?;
        let given = [Some(q), Some(qdot), pose, twist, tau_disturbance];
        tick(py, &self.task, &mut self.one, &[], given)?;
        let tau = self.one[0].tau(&self.task);
        let mut filled = out.try_readwrite().map_err(|_| unfit())?;
        let filled = filled.as_slice_mut().map_err(|_| unfit())?;
        filled.copy_from_slice(tau);
        Ok(out)
    }

    /// One tick of N arms on all cores, each row with its own memory: the torques, shape (N, n), N·m.
    ///
    /// The arguments are those of `step` with a first axis of N rows. N stays the same until `reset`; a row begins with the first call, and again after
    /// `reset(rows)`. Raises MemoryError for more rows than there is memory for.
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
        let (n, task, many) = (self.task.robot().dof(), &self.task, &mut self.many);
        let known = Some(many.len()).filter(|rows| *rows > 0);
        let N = numbers("q", q, &[known], &[&[n]])?.shape()[0];
        let given = [Some(q), Some(qdot), pose, twist, tau_disturbance];
        if known.is_none() {
            let bytes = N.saturating_mul(self.one[0].bytes());
            // A row that finds no memory ends the program.
            if Vec::<u8>::new().try_reserve_exact(bytes).is_err() {
                let text = format!("{N} rows take {:.1} GB", bytes as f64 / 1e9);
                return Err(PyMemoryError::new_err(text));
            }
            many.resize_with(N, || Row::new(task));
        }
        let done = tick(py, task, many, &[Some(N)], given);
        if done.is_err() && known.is_none() {
            many.clear();
        }
        done?;
        let tau = many.iter().flat_map(|row| row.tau(task)).copied();
        PyArray1::from_iter(py, tau).reshape([N, n])
    }

    /// Forgets everything: the next step begins anew. `rows`, indices or a mask of shape (N,): only those rows of `step_many`.
    #[pyo3(signature = (rows=None))]
    fn reset(&mut self, py: Python<'_>, rows: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let Some(rows) = rows else {
            self.one[0].reset();
            self.many.clear();
            return Ok(());
        };
        let all = py
            .import("numpy")?
            .call_method1("arange", (self.many.len(),))?;
        for row in all.get_item(rows)?.try_iter()? {
            self.many[row?.extract::<usize>()?].reset();
        }
        Ok(())
    }

    /// The law's answer to the last `step`, with its reasons.
    #[getter]
    fn state(&self) -> LawState {
        LawState::new(&self.one[0].state(&self.task))
    }

    /// The same of a row of the last `step_many`.
    fn state_of(&self, row: usize) -> PyResult<LawState> {
        let missing = || PyIndexError::new_err(format!("there are {} rows", self.many.len()));
        let row = self.many.get(row).ok_or_else(missing)?;
        Ok(LawState::new(&row.state(&self.task)))
    }

    /// Whether each row of the last `step_many` was refused, shape (N,).
    #[getter]
    fn refused<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        let refused = self
            .many
            .iter()
            .map(|row| row.refusal(&self.task).is_some());
        PyArray1::from_iter(py, refused)
    }

    fn __repr__(&self) -> String {
        let tick = self.one[0].state(&self.task).tick;
        format!("Law({}, tick {tick})", self.task.robot().name)
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

impl LawState {
    fn new(state: &State<'_>) -> Self {
        let listed = state.singularities.iter().flatten();
        Self {
            tick: state.tick,
            phase: state.phase,
            reason: state.reason.to_string(),
            refusal: state
                .refusal
                .map_or_else(String::new, |one| one.to_string()),
            mode: listed
                .clone()
                .map(|one| (one.0.to_owned(), one.1))
                .collect(),
            beta: listed.map(|one| (one.0.to_owned(), one.2)).collect(),
            speed_scale: state.speed_scale,
            targets_refused: state.targets_refused,
            target_refusal: state.target_refusal,
        }
    }
}

#[pymethods]
impl LawState {
    fn __repr__(&self) -> String {
        let (tick, phase, reason) = (self.tick, self.phase, &self.reason);
        let targets = match self.targets_refused {
            0 => String::new(),
            count => format!(
                "; targets refused: {count}, the last: {}",
                self.target_refusal
            ),
        };
        format!(
            "LawState(tick {tick}, {phase}: {reason}{targets}; mode {:?}, beta {:?})",
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
    let n = &[task.robot().dof()][..];
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
