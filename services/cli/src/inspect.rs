//! `armplane inspect`: an arm's kinematics, dynamics and singularities at one posture.

use clap::Args;
use lab::studies::posture::evaluate;
use model::Robot;
use session::{Failure, load};
use shared_types::scenario::Start;

use crate::out::answer;

#[derive(Args)]
pub(crate) struct InspectArgs {
    /// A built-in robot, or a URDF or MJCF file.
    #[arg(
        long,
        value_name = "NAME|FILE.urdf|FILE.xml",
        default_value = "puma560"
    )]
    robot: String,
    /// Base link; joints before it are ignored [default: the robot's].
    #[arg(long, value_name = "LINK")]
    base: Option<String>,
    /// End-effector frame [default: the robot's].
    #[arg(long, value_name = "LINK")]
    frame: Option<String>,
    /// Joint positions in rad (prismatic joints: m), separated by commas, or a posture's name [default: mid-range].
    #[arg(
        long,
        value_name = "Q",
        allow_hyphen_values = true,
        conflicts_with = "q_deg"
    )]
    q: Option<String>,
    /// Joint positions in degrees, separated by commas; revolute joints only.
    #[arg(
        long,
        value_name = "Q",
        allow_hyphen_values = true,
        value_delimiter = ','
    )]
    q_deg: Option<Vec<f64>>,
    /// Joint velocities in rad/s (prismatic joints: m/s), separated by commas [default: at rest].
    #[arg(
        long,
        value_name = "QDOT",
        allow_hyphen_values = true,
        value_delimiter = ','
    )]
    qdot: Option<Vec<f64>>,
}

pub(crate) fn inspect(args: &InspectArgs, as_json: bool) -> Result<bool, Failure> {
    let (frame, base) = (args.frame.as_deref(), args.base.as_deref());
    let robot = load::robot(&args.robot, frame, base)?;
    let q = posture(args, &robot)?;
    let qdot = args.qdot.clone().unwrap_or_else(|| vec![0.0; q.len()]);
    if qdot.len() != q.len() || qdot.iter().any(|rate| !rate.is_finite()) {
        return Err(Failure::Input(format!(
            "--qdot has {} values; {} has {} joints",
            qdot.len(),
            robot.name,
            q.len()
        )));
    }
    let evaluated = evaluate(&robot, frame, &q, &qdot)?;
    answer(as_json, &evaluated.json(), &evaluated);
    Ok(true)
}

/// The posture asked for: numbers, or a name from the robot's description.
fn posture(args: &InspectArgs, robot: &Robot) -> Result<Vec<f64>, Failure> {
    let start = match (&args.q, &args.q_deg) {
        (_, Some(degrees)) => Start {
            q_deg: Some(degrees.clone()),
            ..Start::default()
        },
        (Some(text), None) => match text
            .split(',')
            .map(|number| number.trim().parse())
            .collect::<Result<Vec<f64>, _>>()
        {
            Ok(q) => Start {
                q: Some(q),
                ..Start::default()
            },
            Err(_) => Start {
                posture: Some(text.clone()),
                ..Start::default()
            },
        },
        (None, None) => Start {
            q: Some(robot.middle()),
            ..Start::default()
        },
    };
    let refused = |error| match start.q {
        Some(_) => Failure::input(format!("{error}; --q is in rad and m, --q-deg in degrees")),
        None => Failure::input(error),
    };
    robot.start_posture(&start).map_err(refused)
}
