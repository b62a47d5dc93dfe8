//! An arm: its description, and at a posture its kinematics, dynamics and singularities.

use std::collections::BTreeMap;
use std::f64::consts::TAU;
use std::path::PathBuf;

use model::{Joint, JointKind, Refused, Robot, RobotText, description};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use shared_types::job::Job;
use shared_types::{SingularityReport, SingularityState, codes};

use crate::{in_parts, numbers, refused};

/// A serial arm of up to 8 joints; n is the number of its joints. SI units: a turning joint is in rad, a sliding one in m.
#[pyclass(frozen, module = "armplane")]
pub(crate) struct Arm {
    pub(crate) inner: arm::Arm,
    /// The arm's name.
    #[pyo3(get)]
    name: String,
    /// Number of joints n.
    #[pyo3(get)]
    dof: usize,
    /// The link that is the end-effector E.
    #[pyo3(get)]
    tip: String,
    /// Names of the joints, from the base outwards.
    #[pyo3(get)]
    joints: Vec<String>,
    /// Lower position limits, shape (n,), rad; −inf for none.
    #[pyo3(get)]
    lower: Py<PyArray1<f64>>,
    /// Upper position limits, shape (n,), rad; inf for none.
    #[pyo3(get)]
    upper: Py<PyArray1<f64>>,
    /// Torque limits, shape (n,), N·m.
    #[pyo3(get)]
    effort: Py<PyArray1<f64>>,
    /// Speed limits, shape (n,), rad/s.
    #[pyo3(get)]
    velocity: Py<PyArray1<f64>>,
    /// Largest torque rates, shape (n,), N·m/s.
    #[pyo3(get)]
    torque_rate: Py<PyArray1<f64>>,
    /// Whether the hand's task has each of x, y, z, rx, ry, rz, base axes.
    #[pyo3(get)]
    task: [bool; 6],
    /// Named postures, each a list of n values, rad.
    #[pyo3(get)]
    postures: BTreeMap<String, Vec<f64>>,
    /// What was assumed or left out when its file was read: joints without a limit, say, or held at zero. A sentence each.
    #[pyo3(get)]
    notes: Vec<String>,
}

impl Arm {
    pub(crate) fn new(py: Python<'_>, made: Result<arm::Arm, Refused>) -> PyResult<Self> {
        let inner = made.map_err(refused)?;
        let (robot, tip) = (inner.robot(), inner.tip().to_owned());
        let values = |value: fn(&Joint) -> f64| {
            PyArray1::from_iter(py, robot.joints.iter().map(value)).unbind()
        };
        Ok(Self {
            name: robot.name.clone(),
            dof: robot.dof(),
            tip,
            joints: robot.joints.iter().map(|one| one.name.clone()).collect(),
            lower: values(|joint| joint.lower),
            upper: values(|joint| joint.upper),
            effort: values(|joint| joint.effort),
            velocity: values(|joint| joint.velocity),
            torque_rate: values(|joint| joint.torque_rate),
            task: robot.task.0,
            postures: robot.postures.clone(),
            notes: robot.notes.clone(),
            inner,
        })
    }

    /// The arm of the texts that `armplane.mjcf` makes, with the description of `source` laid over theirs.
    fn of_mjcf(texts: &Bound<'_, PyAny>, source: RobotText, tip: Option<&str>) -> PyResult<Self> {
        let (urdf, own): (String, String) = texts.extract()?;
        let description = description::merged(&own, &source.description).map_err(refused)?;
        let source = RobotText {
            urdf,
            description,
            ..source
        };
        Self::new(texts.py(), arm::Arm::parse(&source, tip))
    }

    /// A number of each joint.
    fn finite(&self, name: &str, given: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
        let values = numbers(name, given, &[], &[&[self.dof]])?
            .as_slice()?
            .to_vec();
        if arm::is_finite(&values) {
            return Ok(values);
        }
        Err(refused(format!(
            "{name} = {values:?} has a number that is not finite"
        )))
    }

    /// Says so where a turning joint is over a turn beyond its limits.
    fn warn_of_degrees(&self, py: Python<'_>, q: &[f64]) -> PyResult<()> {
        let mut joints = self.inner.robot().joints.iter().zip(q);
        let is_far = |(joint, q): &(&Joint, &f64)| {
            joint.kind == JointKind::Revolute
                && !(joint.lower - TAU..=joint.upper + TAU).contains(*q)
        };
        let Some((joint, q)) = joints.find(is_far) else {
            return Ok(());
        };
        let text = format!(
            "joint '{}' at {q} rad is over a turn beyond its limits, {:.2} to {:.2} rad: is it in degrees?",
            joint.name, joint.lower, joint.upper
        );
        let text = std::ffi::CString::new(text).map_err(refused)?;
        PyErr::warn(py, &py.get_type::<PyUserWarning>(), &text, 1)
    }

    /// The analysis of each row of `q` by itself, at rest, with or without names of far directions. A row that is not finite has no singularities, and NaN.
    fn analyse(&self, q: &[f64], far: bool, reports: &mut [SingularityReport]) {
        in_parts(reports, |first, part| {
            let mut analysis = self.inner.analysis();
            if !far {
                analysis.leave_far_unnamed();
            }
            for (q, report) in q[first * self.dof..].chunks(self.dof).zip(part) {
                analysis.at(q, report);
            }
        });
    }
}

#[pymethods]
impl Arm {
    /// The arm of a URDF or MJCF file, seen at the link `tip` (the chain's last link where None).
    ///
    /// `description` is a TOML file with what a URDF has no element for (armature, friction, torque rates, postures); where None it is the file of the
    /// same name beside the URDF, if there is one. Raises ValueError with the joint or link and the remedy where something is missing.
    #[staticmethod]
    #[pyo3(signature = (path, tip=None, description=None))]
    fn from_urdf(
        py: Python<'_>,
        path: PathBuf,
        tip: Option<String>,
        description: Option<PathBuf>,
    ) -> PyResult<Self> {
        if path.extension().is_none_or(|ending| ending != "xml") {
            let made = arm::Arm::read(&path, description.as_deref(), tip.as_deref());
            return Self::new(py, made);
        }
        let source = files::robot(&path, description.as_deref()).map_err(refused)?;
        let texts = py.import("armplane.mjcf")?.call_method1("read", (&path,))?;
        Self::of_mjcf(&texts, source, tip.as_deref())
    }

    /// The arm of a MuJoCo model (`mujoco.MjModel`), seen at the site or body `site` (the chain's last one where None).
    ///
    /// `description` is a TOML file with what MJCF has no element for, limits of speed above all. Raises ValueError as `from_urdf` does.
    #[staticmethod]
    #[pyo3(signature = (model, site=None, description=None))]
    fn from_mujoco(
        model: &Bound<'_, PyAny>,
        site: Option<String>,
        description: Option<PathBuf>,
    ) -> PyResult<Self> {
        let texts = model
            .py()
            .import("armplane.mjcf")?
            .call_method1("texts", (model,))?;
        let text = |path: &PathBuf| files::text(path, files::LARGEST_WRITTEN);
        let description = description.as_ref().map(text).transpose();
        let source = RobotText {
            name: "mujoco".to_owned(),
            description: description.map_err(refused)?.unwrap_or_default(),
            ..RobotText::default()
        };
        Self::of_mjcf(&texts, source, site.as_deref())
    }

    /// A built-in arm by its name (`Arm.names()`), seen at the link `tip` (its own end-effector frame where None).
    #[staticmethod]
    #[pyo3(signature = (name, tip=None))]
    fn builtin(py: Python<'_>, name: &str, tip: Option<String>) -> PyResult<Self> {
        Self::new(py, arm::Arm::builtin(name, tip.as_deref()))
    }

    /// The names of the built-in arms.
    #[staticmethod]
    fn names() -> Vec<&'static str> {
        Robot::builtin_names().to_vec()
    }

    /// The links on the chain or fixed to it, from the base on, by name: the index of the joint that moves it, None for the base, and its pose behind that joint,
    /// homogeneous, shape (4, 4), m.
    #[getter]
    fn frames<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let found = PyDict::new(py);
        for frame in &self.inner.robot().frames {
            let rows = frame.X_LF.to_homogeneous().transpose();
            let pose = matrix(py, [4, 4], rows.as_slice())?;
            found.set_item(&frame.name, (frame.joint, pose))?;
        }
        Ok(found)
    }

    fn __repr__(&self) -> String {
        let Self { name, dof, tip, .. } = self;
        let notes = match self.notes.len() {
            0 => String::new(),
            count => format!(", notes {count}"),
        };
        format!("Arm({name}: {dof} joints, tip {tip}{notes})")
    }

    /// Kinematics and dynamics at joint positions `q`, shape (n,), rad, and velocities `qdot`, shape (n,), rad/s (at rest where None).
    #[pyo3(signature = (q, qdot=None))]
    fn at(
        &self,
        py: Python<'_>,
        q: &Bound<'_, PyAny>,
        qdot: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Posture> {
        let n = self.dof;
        let q = self.finite("q", q)?;
        let qdot = qdot.map_or_else(|| Ok(vec![0.0; n]), |qdot| self.finite("qdot", qdot))?;
        self.warn_of_degrees(py, &q)?;
        let at = self.inner.at(&q, &qdot);
        Ok(Posture {
            pose: matrix(py, [4, 4], &at.pose)?,
            links: PyArray1::from_slice(py, at.links[..n].as_flattened())
                .reshape([n, 4, 4])?
                .unbind(),
            J: matrix(py, [6, n], &at.J)?,
            A: matrix(py, [n, n], &at.A)?,
            bias: PyArray1::from_slice(py, &at.bias[..n]).unbind(),
            gravity: PyArray1::from_slice(py, &at.gravity[..n]).unbind(),
        })
    }

    /// The singularities of the arm at `q`, shape (n,), rad, each with its measure; the same analysis as that of the process `analyzer` at its first tick.
    fn singularities(&self, py: Python<'_>, q: &Bound<'_, PyAny>) -> PyResult<Vec<Singularity>> {
        let (q, mut report) = (self.finite("q", q)?, SingularityReport::default());
        self.warn_of_degrees(py, &q)?;
        self.analyse(&q, true, std::slice::from_mut(&mut report));
        let listed = report.listed().iter().enumerate();
        Ok(listed
            .map(|(place, one)| Singularity::new(py, place, one))
            .collect())
    }

    /// The singularities at N postures on all cores, each row by itself: `q` of shape (N, n), rad.
    ///
    /// A structured array of shape (N,), the messages of the process `analyzer`, as `run.messages("singularity")` has them: `rank`, `det`,
    /// `manipulability`, `count`, and `singularities` of shape (N, 4), of which `count` are in use, with `kind`, `class_` (words: `KINDS` and `TYPES` of
    /// `armplane.wire`), `inside`, `s`, `zeta_B` (6,), `eta_in`, `eta_out`. A row takes 1.3 kB. One with a NaN has a NaN in `det` and `s`, and a count of 0.
    ///
    /// A direction that is found by number and has |s| > 1.3 `eta_out` is `numeric` and `unknown`, in any place that is free. With `far=True` it has the name,
    /// type and place of the singular posture that it leads to, at ten times the cost with seven joints.
    #[pyo3(signature = (q, far=false))]
    fn step_many<'py>(&self, q: &Bound<'py, PyAny>, far: bool) -> PyResult<Bound<'py, PyAny>> {
        let (py, n) = (q.py(), self.dof);
        let q = numbers("q", q, &[None], &[&[n]])?;
        let (numpy, wire) = (py.import("numpy")?, py.import("armplane.wire")?);
        let row = numpy.call_method1("dtype", (wire.getattr("SingularityReport")?,))?;
        let rows = numpy.call_method1("zeros", (q.shape()[0], row))?;
        if q.is_empty() {
            return Ok(rows);
        }
        let bytes: Bound<'_, PyArray1<u8>> = rows.call_method1("view", ("u1",))?.cast_into()?;
        let mut bytes = bytes.try_readwrite()?;
        let reports = bytemuck::try_cast_slice_mut(bytes.as_slice_mut()?).map_err(refused)?;
        let q = q.as_slice()?;
        py.detach(|| self.analyse(q, far, reports));
        Ok(rows)
    }
}

/// The arm of a run as pictures show it, from the text of its `job.json`: [`viz::solids`] as JSON.
#[pyfunction]
pub(crate) fn solids(py: Python<'_>, job: &str) -> PyResult<String> {
    let job: Job = serde_json::from_str(job).map_err(refused)?;
    py.detach(|| {
        let robot = Robot::from_source_at(&job.robot, job.scenario.frame()).map_err(refused)?;
        let floor_m = job.scenario.plant.floor_m.unwrap_or_default();
        Ok(viz::solids(&robot, floor_m).to_string())
    })
}

/// An array of a matrix that lies row by row.
fn matrix(
    py: Python<'_>,
    [rows, columns]: [usize; 2],
    values: &[f64],
) -> PyResult<Py<PyArray2<f64>>> {
    Ok(PyArray1::from_slice(py, &values[..rows * columns])
        .reshape([rows, columns])?
        .unbind())
}

/// An arm at a posture. Frames: B base, E end-effector; rows of twists and Jacobians are `[linear; angular]` in the axes of B.
#[pyclass(frozen, get_all, module = "armplane")]
pub(crate) struct Posture {
    /// Pose of E in B, homogeneous, shape (4, 4), m.
    pose: Py<PyArray2<f64>>,
    /// Poses of the links in B, the frames of their joints in the arm's file, homogeneous, shape (n, 4, 4), m.
    links: Py<PyArray3<f64>>,
    /// Jacobian at E, shape (6, n), m and rad per rad.
    J: Py<PyArray2<f64>>,
    /// Mass matrix, armature included, shape (n, n), kg·m².
    A: Py<PyArray2<f64>>,
    /// Coriolis and gravity torques, shape (n,), N·m.
    bias: Py<PyArray1<f64>>,
    /// Gravity torques, shape (n,), N·m.
    gravity: Py<PyArray1<f64>>,
}

/// A singularity of an arm, at one posture.
#[pyclass(frozen, get_all, module = "armplane")]
pub(crate) struct Singularity {
    /// Its name: elbow, wrist, overhead, shoulder; s1, s2, … of one that is found by number.
    name: String,
    /// `type 1` (null-space motion moves the hand along the singular direction), `type 2` (it only turns that direction), `mixed`, or `unknown`.
    r#type: &'static str,
    /// s, dimensionless, signed: 0 at the singularity.
    measure: f64,
    /// Singular direction ζ in the axes of B, unit vector of shape (6,), `[linear; angular]`.
    direction: Py<PyArray1<f64>>,
    /// Whether the posture is in the singularity's neighbourhood.
    inside: bool,
    /// |measure| below which the neighbourhood is entered.
    entry: f64,
    /// |measure| above which it is left again.
    exit: f64,
}

impl Singularity {
    fn new(py: Python<'_>, place: usize, one: &SingularityState) -> Self {
        Self {
            name: codes::singularity_name(one.kind, place).to_owned(),
            r#type: codes::name_of(codes::TYPES, one.class),
            measure: one.s,
            direction: PyArray1::from_slice(py, &one.zeta_B).unbind(),
            inside: one.inside != 0,
            entry: one.eta_in,
            exit: one.eta_out,
        }
    }
}

#[pymethods]
impl Singularity {
    fn __repr__(&self) -> String {
        let where_ = if self.inside { "inside" } else { "outside" };
        let (name, class, measure) = (&self.name, self.r#type, self.measure);
        format!("Singularity({name}: {class}, measure {measure:.3}, {where_})")
    }
}
