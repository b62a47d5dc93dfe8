//! `armplane inspect`: an arm's kinematics, dynamics and singularities at one posture.

use std::process::ExitCode;

use clap::Args;
use lab::studies::posture::{Posture, evaluate};
use model::Robot;
use nalgebra::DMatrix;
use session::{Failure, load};
use shared_types::codes;
use shared_types::scenario::Start;

use crate::out::say;
use session::table::{number, table};
use viz::plot::digits;

#[derive(Args)]
pub(crate) struct InspectArgs {
    /// A built-in robot's name, or a URDF file.
    #[arg(long, value_name = "NAME|FILE.urdf", default_value = "puma560")]
    robot: String,
    /// Base link: the joints before it are no part of the arm [default: the robot's].
    #[arg(long, value_name = "LINK")]
    base: Option<String>,
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
    let whole = load::robot(&args.robot, None, args.frame.as_deref())?;
    let robot = match &args.base {
        Some(base) => load::on_base(&whole, base)?,
        None => whole,
    };
    let q = posture(args, &robot)?;
    let qdot = args.qdot.clone().unwrap_or_else(|| vec![0.0; q.len()]);
    if qdot.len() != q.len() || qdot.iter().any(|rate| !rate.is_finite()) {
        return Err(Failure::Input(format!("--qdot has {} values; {} has {} joints", qdot.len(), robot.name, q.len())));
    }
    let evaluated = evaluate(&robot, args.frame.as_deref(), &q, &qdot)?;
    if as_json {
        say!("{}", evaluated.json(&robot));
    } else {
        print(&evaluated, &robot);
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

fn print(posture: &Posture, robot: &Robot) {
    say!("{} at frame {}, base axes, SI units\n", robot.name, posture.frame);
    let mut joints = table(&["joint", "q rad", "q °", "lower °", "upper °", "gravity N·m", "bias N·m", "torque limit"]);
    for (i, joint) in robot.joints.iter().enumerate() {
        let degrees = |radians: f64| if radians.is_finite() { format!("{:.2}", radians.to_degrees()) } else { "–".to_owned() };
        joints.add_row([
            joint.name.clone().into(),
            number(format!("{:.6}", posture.q[i])),
            number(degrees(posture.q[i])),
            number(degrees(joint.lower)),
            number(degrees(joint.upper)),
            number(digits(posture.gravity[i])),
            number(digits(posture.bias[i])),
            number(digits(joint.effort)),
        ]);
    }
    say!("{joints}");
    print_matrix("pose X_BE", &DMatrix::from_fn(4, 4, |row, column| posture.pose[row][column]));
    print_matrix("J, rows [v; ω]", &posture.J);
    print_matrix("A, kg·m²", &posture.A);
    let list = |values: &[f64]| values.iter().map(|value| digits(*value)).collect::<Vec<_>>().join("  ");
    if let Some(det) = posture.det {
        say!("det J            {}", digits(det));
    }
    say!("singular values  {}", list(&posture.singular_values));
    say!("unit-scaled      {}  (lengths / {} m, at the wrist centre)", list(&posture.report.sigma), posture.report.length_m);
    say!(
        "rank {}, condition {}, manipulability {}\n",
        posture.report.rank,
        digits(posture.report.condition),
        digits(posture.report.manipulability)
    );
    let mut found = table(&["singularity", "s", "η in/out", "inside", "type", "κ₁", "κ₂", "ζ (base axes)"]);
    for (name, s) in posture.singularities() {
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

fn print_matrix(title: &str, matrix: &DMatrix<f64>) {
    say!("{title}");
    for row in matrix.row_iter() {
        say!("  {}", row.iter().map(|value| format!("{value:>10.5}")).collect::<Vec<_>>().join(" "));
    }
    say!();
}
