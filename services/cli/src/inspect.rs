//! `armplane inspect`: an arm's kinematics, dynamics and singularities at one posture.

use std::process::ExitCode;

use clap::Args;
use model::{Model, Refused, Robot, embedded, with_dof};
use nalgebra::DMatrix;
use serde_json::{Value, json};
use session::{Failure, load};
use shared_types::scenario::{Scenario, Segment, Start};
use shared_types::{SingularityReport, StateEstimate, codes};

use crate::out::say;
use crate::table::{digits, number, table};

#[derive(Args)]
pub(crate) struct InspectArgs {
    /// A built-in robot's name, or a URDF file.
    #[arg(long, value_name = "NAME|FILE.urdf", default_value = "puma560")]
    robot: String,
    /// End-effector frame [default: the robot's].
    #[arg(long, value_name = "LINK")]
    frame: Option<String>,
    /// Joint positions in rad, separated by commas, or a posture's name [default: the middle of the joints' ranges].
    #[arg(long, value_name = "Q", allow_hyphen_values = true, conflicts_with = "q_deg")]
    q: Option<String>,
    /// Joint positions in degrees, separated by commas.
    #[arg(long, value_name = "Q", allow_hyphen_values = true, value_delimiter = ',')]
    q_deg: Option<Vec<f64>>,
    /// Joint velocities in rad/s, separated by commas [default: at rest].
    #[arg(long, value_name = "QDOT", allow_hyphen_values = true, value_delimiter = ',')]
    qdot: Option<Vec<f64>>,
}

pub(crate) fn inspect(args: &InspectArgs, as_json: bool) -> Result<ExitCode, Failure> {
    let robot = load::robot(&args.robot, None)?;
    let q = posture(args, &robot)?;
    let qdot = args.qdot.clone().unwrap_or_else(|| vec![0.0; q.len()]);
    if qdot.len() != q.len() || qdot.iter().any(|rate| !rate.is_finite()) {
        return Err(Failure::Input(format!("--qdot has {} values; {} has {} joints", qdot.len(), robot.name, q.len())));
    }
    let numbers = with_dof!(robot.dof(), N => evaluate::<N>(&robot, args.frame.as_deref(), &q, &qdot))
        .unwrap_or_else(|| Err(Failure::input(Refused::size(&robot))))?;
    if as_json {
        say!("{}", numbers.json(&robot));
    } else {
        numbers.print(&robot);
    }
    Ok(ExitCode::SUCCESS)
}

/// The posture asked for: numbers, or a name from the robot's description.
fn posture(args: &InspectArgs, robot: &Robot) -> Result<Vec<f64>, Failure> {
    let start = match (&args.q, &args.q_deg) {
        (_, Some(degrees)) => Start { q_deg: Some(degrees.clone()), ..Start::default() },
        (Some(text), None) => match text.split(',').map(|number| number.trim().parse()).collect::<Result<Vec<f64>, _>>() {
            Ok(radians) => Start { q_rad: Some(radians), ..Start::default() },
            Err(_) => Start { posture: Some(text.clone()), ..Start::default() },
        },
        (None, None) => Start { q_rad: Some(robot.middle()), ..Start::default() },
    };
    robot.start_posture(&start).map_err(Failure::input)
}

/// A scenario that does nothing but start somewhere: what the analyzer wants to see.
fn start_only(robot: &Robot, frame: Option<&str>, start: Start) -> Scenario {
    Scenario {
        name: "inspect".to_owned(),
        title: String::new(),
        about: String::new(),
        robot: robot.name.clone(),
        frame: frame.unwrap_or_default().to_owned(),
        rate_hz: 1000,
        seed: 0,
        start,
        segment: vec![Segment { duration_s: 1.0, ..Segment::default() }],
        settle_s: 0.0,
        plant: Default::default(),
        estimator: Default::default(),
        analysis: Default::default(),
        control: Default::default(),
        goal: Default::default(),
        view: Default::default(),
        fault: Vec::new(),
        record: Default::default(),
    }
}

/// All numbers, sizes forgotten: rows first.
struct Numbers {
    frame: String,
    q: Vec<f64>,
    qdot: Vec<f64>,
    pose: [[f64; 4]; 4],
    J: DMatrix<f64>,
    A: DMatrix<f64>,
    gravity: Vec<f64>,
    bias: Vec<f64>,
    Jdot_qdot: Vec<f64>,
    det: Option<f64>,
    singular_values: Vec<f64>,
    report: SingularityReport,
}

fn evaluate<const N: usize>(robot: &Robot, frame: Option<&str>, q: &[f64], qdot: &[f64]) -> Result<Numbers, Failure> {
    let model = Model::<N>::new(robot, frame).map_err(Failure::input)?;
    let (n, q_vector, qdot_vector) = (robot.dof(), embedded::<N>(q), embedded::<N>(qdot));
    let terms = model.evaluate(&q_vector, &qdot_vector);
    let start = Start { q_rad: Some(q.to_vec()), ..Start::default() };
    let mut analyzer = analyzer::cycle(robot, &start_only(robot, frame, start)).map_err(Failure::input)?;
    let mut estimate = StateEstimate::default();
    estimate.q[..n].copy_from_slice(q);
    estimate.qdot[..n].copy_from_slice(qdot);
    let mut report = SingularityReport::default();
    analyzer.step(&estimate, &mut report);
    let J = DMatrix::from_fn(6, n, |row, column| terms.J[(row, column)]);
    let (R, p) = (terms.X_BE.R, terms.X_BE.p);
    let mut singular_values: Vec<f64> = J.clone().svd(false, false).singular_values.iter().copied().collect();
    singular_values.sort_by(|a, b| b.total_cmp(a));
    Ok(Numbers {
        frame: frame.unwrap_or(&robot.default_frame).to_owned(),
        q: q.to_vec(),
        qdot: qdot.to_vec(),
        pose: [
            [R[(0, 0)], R[(0, 1)], R[(0, 2)], p.x],
            [R[(1, 0)], R[(1, 1)], R[(1, 2)], p.y],
            [R[(2, 0)], R[(2, 1)], R[(2, 2)], p.z],
            [0.0, 0.0, 0.0, 1.0],
        ],
        det: (n == 6).then(|| J.determinant()),
        J,
        A: DMatrix::from_fn(n, n, |row, column| terms.A[(row, column)]),
        gravity: terms.gravity.as_slice()[..n].to_vec(),
        bias: (terms.coriolis + terms.gravity).as_slice()[..n].to_vec(),
        Jdot_qdot: terms.Jdot_qdot.as_slice().to_vec(),
        singular_values,
        report,
    })
}

fn rows(matrix: &DMatrix<f64>) -> Vec<Vec<f64>> {
    matrix.row_iter().map(|row| row.iter().copied().collect()).collect()
}

impl Numbers {
    fn singularities(&self) -> impl Iterator<Item = (String, &shared_types::SingularityState)> {
        let count = (self.report.count as usize).min(self.report.singularities.len());
        self.report.singularities[..count]
            .iter()
            .enumerate()
            .map(|(i, singularity)| (codes::singularity_name(singularity.kind, i), singularity))
    }

    fn json(&self, robot: &Robot) -> Value {
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
            "robot": robot.name, "frame": self.frame, "q": self.q, "qdot": self.qdot, "pose": self.pose,
            "J": rows(&self.J), "A": rows(&self.A), "gravity": self.gravity, "bias": self.bias, "Jdot_qdot": self.Jdot_qdot,
            "det": self.det, "singular_values": self.singular_values, "rank": self.report.rank,
            "scaled_singular_values": self.report.sigma, "length_m": self.report.length_m, "condition": self.report.condition,
            "manipulability": self.report.manipulability, "singularities": singularities, "notes": robot.notes,
        })
    }

    fn print(&self, robot: &Robot) {
        say!("{} at frame {}, base axes, SI units\n", robot.name, self.frame);
        let mut joints = table(&["joint", "q rad", "q °", "lower °", "upper °", "gravity N·m", "bias N·m", "torque limit"]);
        for (i, joint) in robot.joints.iter().enumerate() {
            let degrees = |radians: f64| if radians.is_finite() { format!("{:.2}", radians.to_degrees()) } else { "–".to_owned() };
            joints.add_row([
                joint.name.clone().into(),
                number(format!("{:.6}", self.q[i])),
                number(degrees(self.q[i])),
                number(degrees(joint.lower)),
                number(degrees(joint.upper)),
                number(digits(self.gravity[i])),
                number(digits(self.bias[i])),
                number(digits(joint.effort)),
            ]);
        }
        say!("{joints}");
        print_matrix("pose X_BE", &DMatrix::from_fn(4, 4, |row, column| self.pose[row][column]));
        print_matrix("J, rows [v; ω]", &self.J);
        print_matrix("A, kg·m²", &self.A);
        let list = |values: &[f64]| values.iter().map(|value| digits(*value)).collect::<Vec<_>>().join("  ");
        if let Some(det) = self.det {
            say!("det J            {}", digits(det));
        }
        say!("singular values  {}", list(&self.singular_values));
        say!("unit-scaled      {}  (lengths / {} m, at the wrist centre)", list(&self.report.sigma), self.report.length_m);
        say!(
            "rank {}, condition {}, manipulability {}\n",
            self.report.rank,
            digits(self.report.condition),
            digits(self.report.manipulability)
        );
        let mut found = table(&["singularity", "s", "η in/out", "inside", "type", "κ₁", "κ₂", "ζ (base axes)"]);
        for (name, s) in self.singularities() {
            let half = if s.angular != 0 { &s.zeta_B[3..] } else { &s.zeta_B[..3] };
            let kind = if s.angular != 0 { "rotation" } else { "translation" };
            found.add_row([
                name.into(),
                number(digits(s.s)),
                number(format!("{} / {}", s.eta_in, s.eta_out)),
                if s.inside != 0 { "inside".into() } else { "".into() },
                codes::name_of(codes::TYPES, s.class).into(),
                number(digits(s.kappa_1)),
                number(digits(s.kappa_2)),
                format!("{kind} [{:.3}, {:.3}, {:.3}]", half[0], half[1], half[2]).into(),
            ]);
        }
        say!("{found}");
        for note in &robot.notes {
            say!("note: {note}");
        }
    }
}

fn print_matrix(title: &str, matrix: &DMatrix<f64>) {
    say!("{title}");
    for row in matrix.row_iter() {
        say!("  {}", row.iter().map(|value| format!("{value:>10.5}")).collect::<Vec<_>>().join(" "));
    }
    say!();
}
