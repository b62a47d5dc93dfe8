//! The commanded path of a run, followed by the judge's own code.

use control::centre::PoseMotion;
use control::{GroundTruth, Progress, ground_truth};
use model::Pose;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use shared_types::job::Job;
use shared_types::scenario::Force;
use shared_types::{PlantState, SingularityReport};

use crate::{numbers, refused};

/// The commanded path of a run, `Reference(job)` with the text of its `job.json`: the code by which the judge follows it.
///
/// `advance` moves along it; then `pose` (4, 4), m, `twist` (6,) and `acceleration` (6,), `[linear; angular]` in the axes of B, `leg`, `time_s` and `done`
/// are those of the place come to. `duration_s` is the time that the path takes by its own clock. `force` is what the leg presses with: a dictionary of its keys
/// in the scenario, and `axis` as a unit vector (3,), in the hand's axes where `of_tool`; `None` where it does not.
#[pyclass(unsendable, module = "armplane")]
pub(crate) struct Reference {
    truth: Box<dyn GroundTruth>,
    place: Progress,
    state: PlantState,
    /// Of each leg.
    forces: Vec<Option<Force>>,
    dof: usize,
    /// The motion at the place; `None` where there is none.
    desired: Option<PoseMotion>,
    #[pyo3(get)]
    duration_s: f64,
    #[pyo3(get)]
    time_s: f64,
}

#[pymethods]
impl Reference {
    #[new]
    fn new(job: &str) -> PyResult<Self> {
        let job: Job = serde_json::from_str(job).map_err(refused)?;
        let robot = model::Robot::from_source_at(&job.robot, job.scenario.frame());
        let robot = robot.map_err(refused)?;
        let truth = ground_truth(&robot, &job.scenario).map_err(refused)?;
        let none = || refused("a steered run has no path");
        let place = truth.start().ok_or_else(none)?;
        Ok(Self {
            desired: truth.desired(&place, 0.0),
            place,
            forces: job
                .scenario
                .segment
                .into_iter()
                .map(|one| one.force)
                .collect(),
            duration_s: truth.duration_s(),
            dof: robot.dof(),
            truth,
            state: PlantState::default(),
            time_s: 0.0,
        })
    }

    /// Moves on by `by_s` of the path's clock, which then runs at `rate`, 0 to 1.
    ///
    /// `q` (n,), rad, `qdot` (n,), rad/s, and `report`, the bytes of the message `singularity`: a leg that begins takes from them the singular direction that
    /// it is stated by. The judge takes them from the truth.
    fn advance(
        &mut self,
        by_s: f64,
        rate: f64,
        q: &Bound<'_, PyAny>,
        qdot: &Bound<'_, PyAny>,
        report: &[u8],
    ) -> PyResult<()> {
        let shape = [&[self.dof][..]];
        let (q, qdot) = (
            numbers("q", q, &[], &shape)?,
            numbers("qdot", qdot, &[], &shape)?,
        );
        self.state.q[..self.dof].copy_from_slice(q.as_slice()?);
        self.state.qdot[..self.dof].copy_from_slice(qdot.as_slice()?);
        let report: SingularityReport =
            bytemuck::try_pod_read_unaligned(report).map_err(refused)?;
        if !(by_s >= 0.0 && by_s.is_finite()) {
            return Err(refused(format!("by_s is {by_s}: a clock only runs on")));
        }
        self.truth.analyse(&self.state, &report);
        self.truth.advance(&mut self.place, by_s);
        self.time_s += by_s;
        self.desired = self.truth.desired(&self.place, rate);
        Ok(())
    }

    #[getter]
    fn leg(&self) -> usize {
        self.place.leg
    }

    #[getter]
    fn force<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyDict>>> {
        let force = self.forces.get(self.place.leg).and_then(Option::as_ref);
        let Some((force, (axis, of_tool))) = force.and_then(|it| Some((it, it.direction()?)))
        else {
            return Ok(None);
        };
        let found = PyDict::new(py);
        found.set_item("axis", PyArray1::from_slice(py, &axis))?;
        found.set_item("of_tool", of_tool)?;
        found.set_item("newtons", force.newtons)?;
        found.set_item("stiffness_n_m", force.stiffness_n_m)?;
        found.set_item("until_newtons", force.until_newtons)?;
        found.set_item("ramp_s", force.ramp_s)?;
        found.set_item("approach_m_s", force.approach_m_s)?;
        found.set_item("reach_m", force.reach_m)?;
        Ok(Some(found))
    }

    #[getter]
    fn done(&self) -> bool {
        self.time_s >= self.duration_s
    }

    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (R, p) = self
            .desired
            .map_or_else(Default::default, |desired| (desired.R, desired.p));
        let rows = Pose { R, p }.to_homogeneous().transpose();
        PyArray1::from_slice(py, rows.as_slice()).reshape([4, 4])
    }

    #[getter]
    fn twist<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_iter(py, self.desired.into_iter().flat_map(|it| it.V.data.0[0]))
    }

    #[getter]
    fn acceleration<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_iter(py, self.desired.into_iter().flat_map(|it| it.a.data.0[0]))
    }
}
