//! An arm: its description, and at a posture its kinematics, dynamics and singularities.

use std::path::Path;
use std::sync::Arc;

use model::{JointKind, Model, Refused, Robot, RobotText, embedded, with_dof};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use shared_types::scenario::Scenario;
use shared_types::{
    AnalyzerCheckpoint, MAX_SINGULARITIES, SingularityReport, SingularityState, StateEstimate,
    codes,
};

use crate::{in_parts, numbers, refused};

/// A steered scenario without an end; the arm, the frame and the start are laid over it.
const SESSION: &str =
    "name = \"python\"\nrobot = \"python\"\n[start]\nposture = \"x\"\n[servo]\nduration_s = 1\n";

/// A serial arm of up to 8 joints; n is the number of its joints. SI units: a turning joint is in rad, a sliding one in m.
#[pyclass(frozen, module = "armplane")]
pub(crate) struct Arm {
    pub(crate) robot: Arc<Robot>,
    /// The link that is the end-effector E; `None`: the description's.
    tip: Option<String>,
    /// Before its first tick, with the default thresholds.
    analyzer: Box<dyn analyzer::Step>,
}

impl Arm {
    fn new(robot: Robot, tip: Option<String>) -> PyResult<Self> {
        with_dof!(robot.dof(), N => Model::<N>::new(&robot, tip.as_deref()).map(drop))
            .ok_or_else(|| refused(Refused::size(&robot)))?
            .map_err(refused)?;
        let scenario = scenario(&robot, tip.as_deref(), &[])?;
        Ok(Self {
            analyzer: analyzer::cycle(&robot, &scenario).map_err(refused)?,
            robot: Arc::new(robot),
            tip,
        })
    }

    /// A steered scenario on this arm, with `settings` applied, that starts in the middle of the joints' ranges.
    pub(crate) fn scenario(&self, settings: &[String]) -> PyResult<Scenario> {
        scenario(&self.robot, self.tip.as_deref(), settings)
    }

    /// The analysis of each row of `q`, `qdot` by itself: without memory of the rows before. A row that is not finite has no singularities, and NaN.
    fn analyse(&self, q: &[f64], qdot: &[f64], reports: &mut [SingularityReport]) {
        let n = self.robot.dof();
        let mut fresh = AnalyzerCheckpoint::default();
        self.analyzer.save(&mut fresh);
        in_parts(reports, |first, part| {
            let (mut analyzer, mut estimate) = (self.analyzer.copied(), StateEstimate::default());
            for (row, report) in (first..).zip(part) {
                let place = row * n..(row + 1) * n;
                estimate.q[..n].copy_from_slice(&q[place.clone()]);
                estimate.qdot[..n].copy_from_slice(&qdot[place]);
                if is_finite(&estimate.q) && is_finite(&estimate.qdot) {
                    analyzer.restore(&fresh);
                    analyzer.step(&estimate, report);
                } else {
                    (report.det, report.manipulability) = (f64::NAN, f64::NAN);
                    report.singularities.iter_mut().for_each(|one| {
                        (one.s, one.zeta_B) = (f64::NAN, [f64::NAN; 6]);
                    });
                }
            }
        });
    }

    fn joint_values<'py>(
        &self,
        py: Python<'py>,
        value: fn(&model::Joint) -> f64,
    ) -> Bound<'py, PyArray1<f64>> {
        let values: Vec<f64> = self.robot.joints.iter().map(value).collect();
        values.into_pyarray(py)
    }
}

fn scenario(robot: &Robot, tip: Option<&str>, settings: &[String]) -> PyResult<Scenario> {
    let mut scenario = Scenario::parse("settings", SESSION, settings).map_err(refused)?;
    scenario.frame = tip.unwrap_or_default().to_owned();
    (scenario.start.posture, scenario.start.q) = (None, Some(robot.middle()));
    if let Some(servo) = &mut scenario.servo {
        servo.duration_s = f64::INFINITY;
    }
    Ok(scenario)
}

pub(crate) fn is_finite(values: &[f64]) -> bool {
    values.iter().all(|x| x.is_finite())
}

#[pymethods]
impl Arm {
    /// The arm of a URDF file, seen at the link `tip` (the chain's last link where None).
    ///
    /// `description` is a TOML file with what a URDF has no element for (armature, friction, torque rates, postures); where None it is the file of the
    /// same name beside the URDF, if there is one. Raises ValueError with the joint or link and the remedy where something is missing.
    #[staticmethod]
    #[pyo3(signature = (path, tip=None, description=None))]
    fn from_urdf(path: &str, tip: Option<String>, description: Option<&str>) -> PyResult<Self> {
        let read = |path: &Path| {
            std::fs::read_to_string(path)
                .map_err(|error| refused(format!("cannot read {}: {error}", path.display())))
        };
        let (path, beside) = (Path::new(path), Path::new(path).with_extension("toml"));
        let text = match description {
            Some(file) => read(Path::new(file))?,
            None if beside.is_file() => read(&beside)?,
            None => String::new(),
        };
        let stem = path.file_stem().unwrap_or_default();
        let source = RobotText {
            name: stem.to_string_lossy().into_owned(),
            description: text,
            urdf: read(path)?,
        };
        let robot = Robot::from_source_at(&source, tip.as_deref())
            .map_err(|error| refused(format!("{}: {error}", path.display())))?;
        Self::new(robot, tip)
    }

    /// A built-in arm by its name (`Arm.names()`), seen at the link `tip` (its own end-effector frame where None).
    #[staticmethod]
    #[pyo3(signature = (name, tip=None))]
    fn builtin(name: &str, tip: Option<String>) -> PyResult<Self> {
        Self::new(Robot::builtin(name).map_err(refused)?, tip)
    }

    /// The names of the built-in arms.
    #[staticmethod]
    fn names() -> Vec<&'static str> {
        Robot::builtin_names().to_vec()
    }

    /// The arm's name.
    #[getter]
    fn name(&self) -> &str {
        &self.robot.name
    }

    /// Number of joints n.
    #[getter]
    fn dof(&self) -> usize {
        self.robot.dof()
    }

    /// The link that is the end-effector E.
    #[getter]
    fn tip(&self) -> &str {
        self.tip.as_deref().unwrap_or(&self.robot.default_frame)
    }

    /// Names of the joints, from the base outwards.
    #[getter]
    fn joints(&self) -> Vec<&str> {
        self.robot.joints.iter().map(|one| &*one.name).collect()
    }

    /// Whether each joint slides: its values are then in m, m/s, N.
    #[getter]
    fn slides(&self) -> Vec<bool> {
        let joints = self.robot.joints.iter();
        joints.map(|one| one.kind == JointKind::Prismatic).collect()
    }

    /// Lower position limits, shape (n,), rad; −inf for none.
    #[getter]
    fn lower<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.joint_values(py, |joint| joint.lower)
    }

    /// Upper position limits, shape (n,), rad; inf for none.
    #[getter]
    fn upper<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.joint_values(py, |joint| joint.upper)
    }

    /// Torque limits, shape (n,), N·m.
    #[getter]
    fn effort<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.joint_values(py, |joint| joint.effort)
    }

    /// Speed limits, shape (n,), rad/s.
    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.joint_values(py, |joint| joint.velocity)
    }

    /// Largest torque rates, shape (n,), N·m/s.
    #[getter]
    fn torque_rate<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.joint_values(py, |joint| joint.torque_rate)
    }

    /// Named postures, each of shape (n,), rad.
    #[getter]
    fn postures<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let postures = PyDict::new(py);
        for (name, q) in &self.robot.postures {
            postures.set_item(name, PyArray1::from_slice(py, q))?;
        }
        Ok(postures)
    }

    /// Assumptions and omissions of the reading, one sentence each.
    #[getter]
    fn notes(&self) -> Vec<String> {
        self.robot.notes.clone()
    }

    fn __repr__(&self) -> String {
        let (name, dof) = (&self.robot.name, self.robot.dof());
        format!("Arm({name}: {dof} joints, tip {})", self.tip())
    }

    /// Kinematics and dynamics at joint positions `q`, shape (n,), rad, and velocities `qdot`, shape (n,), rad/s (at rest where None).
    #[pyo3(signature = (q, qdot=None))]
    fn at(
        &self,
        py: Python<'_>,
        q: &Bound<'_, PyAny>,
        qdot: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Posture> {
        let n = self.robot.dof();
        let values = |name, given| -> PyResult<Vec<f64>> {
            Ok(numbers(name, given, &[&[Some(n)]])?.as_slice()?.to_vec())
        };
        let q = values("q", q)?;
        let qdot = qdot.map_or_else(|| Ok(vec![0.0; n]), |qdot| values("qdot", qdot))?;
        let made = with_dof!(n, N => {
            let model = Model::<N>::new(&self.robot, self.tip.as_deref()).map_err(refused)?;
            let terms = model.evaluate(&embedded(&q), &embedded(&qdot));
            let matrix = |rows: usize, columns: usize, value: &dyn Fn(usize, usize) -> f64| -> PyResult<Py<PyArray2<f64>>> {
                let values = (0..rows * columns).map(|i| value(i / columns, i % columns));
                let array = PyArray1::from_iter(py, values).reshape([rows, columns])?;
                Ok(array.unbind())
            };
            let X = terms.X_BE;
            let homogeneous = |i: usize, j: usize| match (i, j) {
                (3, j) => if j == 3 { 1.0 } else { 0.0 },
                (i, 3) => X.p[i],
                _ => X.R[(i, j)],
            };
            let vector = |values: &[f64]| PyArray1::from_slice(py, &values[..n]).unbind();
            Ok(Posture {
                pose: matrix(4, 4, &homogeneous)?,
                J: matrix(6, n, &|i, j| terms.J[(i, j)])?,
                A: matrix(n, n, &|i, j| terms.A[(i, j)])?,
                bias: vector(terms.bias().as_slice()),
                gravity: vector(terms.gravity.as_slice()),
            })
        });
        made.unwrap_or_else(|| Err(refused(Refused::size(&self.robot))))
    }

    /// The singularities of the arm at `q`, shape (n,), rad, each with its measure; the same analysis as that of the process `analyzer` at its first tick.
    fn singularities(&self, py: Python<'_>, q: &Bound<'_, PyAny>) -> PyResult<Vec<Singularity>> {
        let n = self.robot.dof();
        let q = numbers("q", q, &[&[Some(n)]])?;
        let (q, mut report) = (q.as_slice()?, SingularityReport::default());
        if !is_finite(q) {
            return Err(refused(format!(
                "q = {q:?} has a number that is not finite"
            )));
        }
        self.analyse(q, &[0.0; 16][..n], std::slice::from_mut(&mut report));
        let count = (report.count as usize).min(MAX_SINGULARITIES);
        let listed = report.singularities[..count].iter().enumerate();
        Ok(listed
            .map(|(place, one)| Singularity::new(py, place, one))
            .collect())
    }

    /// The singularities at N postures on all cores, each row by itself: `q` of shape (N, n), rad, `qdot` of the same shape, rad/s, or None.
    ///
    /// A dict of arrays: `rank` (N,), `det` (N,), `manipulability` (N,), `count` (N,); and for the 4 places of a report, of which `count` are in use,
    /// `measure` (N, 4), `inside` (N, 4), `direction` (N, 4, 6) as in `Singularity`, `name` and `type` (N, 4), codes whose words are `KINDS` and `TYPES`
    /// of `armplane.wire`. A row with a NaN gives NaN and a count of 0.
    #[pyo3(signature = (q, qdot=None))]
    fn step_many<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        qdot: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let n = self.robot.dof();
        let q = numbers("q", q, &[&[None, Some(n)]])?;
        let (q, N) = (q.as_slice()?, q.as_slice()?.len() / n);
        let qdot = qdot
            .map(|qdot| numbers("qdot", qdot, &[&[Some(N), Some(n)]]))
            .transpose()?;
        let qdot = match &qdot {
            Some(qdot) => qdot.as_slice()?,
            None => &vec![0.0; N * n],
        };
        /// Reports at once: 1.3 kB each.
        const BLOCK: usize = 16_384;
        let mut reports = vec![SingularityReport::default(); N.min(BLOCK)];
        let [mut rank, mut count, mut inside, mut name, mut class] =
            [const { Vec::<u32>::new() }; 5];
        let [mut det, mut volume, mut s, mut zeta] = [const { Vec::<f64>::new() }; 4];
        for first in (0..N).step_by(BLOCK) {
            let rows = first..(first + BLOCK).min(N);
            let place = rows.start * n..rows.end * n;
            let part = &mut reports[..rows.len()];
            part.fill(SingularityReport::default());
            py.detach(|| self.analyse(&q[place.clone()], &qdot[place], part));
            for report in part.iter() {
                rank.push(report.rank);
                count.push(report.count);
                det.push(report.det);
                volume.push(report.manipulability);
                for one in &report.singularities {
                    inside.push(one.inside);
                    name.push(one.kind);
                    class.push(one.class);
                    s.push(one.s);
                    zeta.extend(one.zeta_B);
                }
            }
        }
        let places = [N, MAX_SINGULARITIES];
        let found = PyDict::new(py);
        found.set_item("rank", rank.into_pyarray(py))?;
        found.set_item("count", count.into_pyarray(py))?;
        found.set_item("det", det.into_pyarray(py))?;
        found.set_item("manipulability", volume.into_pyarray(py))?;
        found.set_item("measure", s.into_pyarray(py).reshape(places)?)?;
        let inside: Vec<bool> = inside.into_iter().map(|inside| inside != 0).collect();
        found.set_item("inside", inside.into_pyarray(py).reshape(places)?)?;
        let zeta = zeta.into_pyarray(py).reshape([N, MAX_SINGULARITIES, 6])?;
        found.set_item("direction", zeta)?;
        found.set_item("name", name.into_pyarray(py).reshape(places)?)?;
        found.set_item("type", class.into_pyarray(py).reshape(places)?)?;
        Ok(found)
    }
}

/// An arm at a posture. Frames: B base, E end-effector; rows of twists and Jacobians are `[linear; angular]` in the axes of B.
#[pyclass(frozen, get_all, module = "armplane")]
pub(crate) struct Posture {
    /// Pose of E in B, homogeneous, shape (4, 4), m.
    pose: Py<PyArray2<f64>>,
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
            name: codes::singularity_name(one.kind, place),
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
