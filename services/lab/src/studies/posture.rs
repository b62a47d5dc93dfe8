//! The arm at one posture: kinematics, dynamics and singularities, as the processes compute them.

use control::centre::AtCentre;
use control::{Analyzer, wire};
use model::{Model, Refused, Robot, embedded, unit_scaled, with_dof};
use nalgebra::DMatrix;
use serde_json::{Value, json};
use session::Failure;
use shared_types::{SingularityReport, codes};

use crate::trial::bare;

/// The arm at a posture and velocity. SI units, base axes; rows of J are [v; ω].
pub struct Posture<'a> {
    /// The arm.
    pub robot: &'a Robot,
    /// The end-effector frame.
    pub frame: String,
    /// Joint positions, n; rad (m).
    pub q: Vec<f64>,
    /// Joint velocities, n; rad/s (m/s).
    pub qdot: Vec<f64>,
    /// X_BE, homogeneous.
    pub pose: DMatrix<f64>,
    /// J, 6×n.
    pub J: DMatrix<f64>,
    /// A, n×n; kg·m².
    pub A: DMatrix<f64>,
    /// Gravity torque, n; N·m.
    pub gravity: Vec<f64>,
    /// Coriolis and gravity torque, n; N·m.
    pub bias: Vec<f64>,
    /// J̇·q̇, 6; m/s², rad/s².
    pub Jdot_qdot: Vec<f64>,
    /// det J, of six joints.
    pub det: Option<f64>,
    /// Singular values of J, largest first.
    pub singular_values: Vec<f64>,
    /// Those of J at C, lengths divided by the report's `length_m`, rows that are no task axes zero; largest first.
    pub scaled_singular_values: [f64; 6],
    /// How many task axes count, or joints where they are fewer.
    pub served: usize,
    /// The analyzer's report.
    pub report: SingularityReport,
}

/// Evaluates `robot` at `q`, `qdot` (both of its n joints).
///
/// # Errors
/// A robot of more joints than are compiled, an unknown frame.
pub fn evaluate<'a>(
    robot: &'a Robot,
    frame: Option<&str>,
    q: &[f64],
    qdot: &[f64],
) -> Result<Posture<'a>, Failure> {
    with_dof!(robot.dof(), N => at::<N>(robot, frame, q, qdot))
        .unwrap_or_else(|| Err(Failure::input(Refused::size(robot))))
}

fn at<'a, const N: usize>(
    robot: &'a Robot,
    frame: Option<&str>,
    q: &[f64],
    qdot: &[f64],
) -> Result<Posture<'a>, Failure> {
    let model = Model::<N>::new(robot, frame).map_err(Failure::input)?;
    let (n, q_vector, qdot_vector) = (robot.dof(), embedded::<N>(q), embedded::<N>(qdot));
    let terms = model.evaluate(&q_vector, &qdot_vector);
    let mut scenario = bare("inspect", &robot.name, &[])?;
    scenario.frame = frame.unwrap_or_default().to_owned();
    scenario.start.q = Some(q.to_vec());
    scenario.start.posture = None;
    let found = Analyzer::new(robot, &scenario.analysis).step(&q_vector, &qdot_vector, &terms);
    let mut report = SingularityReport::default();
    wire::report_message(0, &found, &mut report);
    let at_centre = AtCentre::new(&terms, &report.p_BC.into());
    let scaled = unit_scaled(&at_centre.J, report.length_m, &robot.task.0);
    let scaled = DMatrix::from_column_slice(6, N, scaled.as_slice());
    let J = DMatrix::from_fn(6, n, |row, column| terms.J[(row, column)]);
    let singular_values = J.singular_values().as_slice().to_vec();
    let (R, p) = (terms.X_BE.R, terms.X_BE.p);
    Ok(Posture {
        robot,
        frame: frame.unwrap_or(&robot.default_frame).to_owned(),
        q: q.to_vec(),
        qdot: qdot.to_vec(),
        pose: DMatrix::from_fn(4, 4, |row, column| match (row, column) {
            (3, 3) => 1.0,
            (3, _) => 0.0,
            (_, 3) => p[row],
            _ => R[(row, column)],
        }),
        det: (n == 6).then(|| J.determinant()),
        J,
        A: DMatrix::from_fn(n, n, |row, column| terms.A[(row, column)]),
        gravity: terms.gravity.as_slice()[..n].to_vec(),
        bias: (terms.coriolis + terms.gravity).as_slice()[..n].to_vec(),
        Jdot_qdot: terms.Jdot_qdot.as_slice().to_vec(),
        singular_values,
        scaled_singular_values: std::array::from_fn(|i| scaled.singular_values()[i]),
        served: robot.task.count().min(n),
        report,
    })
}

fn rows(matrix: &DMatrix<f64>) -> Vec<Vec<f64>> {
    matrix
        .row_iter()
        .map(|row| row.iter().copied().collect())
        .collect()
}

impl Posture<'_> {
    /// Each singularity of the report with its name.
    pub fn singularities(&self) -> impl Iterator<Item = (&str, &shared_types::SingularityState)> {
        let listed = self.report.listed().iter().enumerate();
        listed.map(|(i, singularity)| (codes::singularity_name(singularity.kind, i), singularity))
    }

    /// Condition of the unit-scaled J, σ_max/σ_min over the task's rows; 1e18 where σ_min is 0.
    pub fn condition(&self) -> f64 {
        let (largest, smallest) = (
            self.scaled_singular_values[0],
            self.scaled_singular_values[self.served.saturating_sub(1)],
        );
        if smallest > largest * 1e-18 {
            largest / smallest
        } else {
            1e18
        }
    }

    /// All of it as JSON.
    pub fn json(&self) -> Value {
        let singularities: Vec<Value> = self
            .singularities()
            .map(|(name, s)| {
                json!({
                    "name": name, "s": s.s, "s_rate": s.s_rate, "eta_in": s.eta_in, "eta_out": s.eta_out, "inside": s.inside != 0,
                    "zeta": s.zeta_B, "frame": (0..3).map(|row| (0..3).map(|column| s.R_BS[3 * column + row]).collect::<Vec<_>>()).collect::<Vec<_>>(),
                    "type": codes::name_of(codes::TYPES, s.class), "kappa_1": s.kappa_1, "kappa_2": s.kappa_2, "aux": s.aux,
                })
            })
            .collect();
        json!({
            "robot": self.robot.name, "frame": self.frame, "q": self.q, "qdot": self.qdot, "pose": rows(&self.pose),
            "J": rows(&self.J), "A": rows(&self.A), "gravity": self.gravity, "bias": self.bias, "Jdot_qdot": self.Jdot_qdot,
            "det": self.det, "singular_values": self.singular_values, "rank": self.report.rank,
            "scaled_singular_values": self.scaled_singular_values, "length_m": self.report.length_m, "condition": self.condition(),
            "manipulability": self.report.manipulability, "singularities": singularities, "notes": self.robot.notes,
        })
    }
}
