//! The path plan of a scenario: made when a controller is, put into words where there is none (+).

use crate::plan::schedule::SLOWEST;
use crate::plan::{Infeasible, Obstacle, PathPlan, Remedy, Request, plan, remedy};
use crate::reference::path::Path;
use crate::reference::turn::{self, Room};
use crate::singularity::analyzer::Analyzer;
use crate::singularity::turning::turning;
use crate::types::Report;
use model::{Joint, JointKind, Model, Robot};
use nalgebra::SVector;
use shared_types::scenario::{Goal, Scenario};

/// The plan of the whole path, where the law uses one: under our own laws with the governor on.
///
/// # Errors
/// Why the path cannot be followed, in words: a joint limit in the way of every route, or a path beyond reach between reachable ends.
pub(crate) fn route_ahead<const N: usize>(
    model: &Model<N>,
    robot: &Robot,
    scenario: &Scenario,
    path: &Path,
    analyzer: &Analyzer<N>,
    q_start: &SVector<f64, N>,
    postures: &[SVector<f64, N>],
) -> Result<Option<PathPlan<N>>, String> {
    let control = &scenario.control;
    let ours = control.strategy.is_ours();
    if !ours || !control.governor || robot.task.count() > N || scenario.servo.is_some() {
        return Ok(None);
    }
    let commanded: Vec<_> = scenario
        .segment
        .iter()
        .zip(postures)
        .map(|(leg, q)| leg.posture().map(|_| *q))
        .collect();
    let turned = |q: &SVector<f64, N>, report: &Report<N>, place: usize, angle: f64| {
        let s = report.listed().get(place)?;
        let motion = |angle: f64| turning(analyzer.family(), model, q, s, angle);
        turn::plan(s, angle, 1.0, &Room { q, model, control }, motion)
            .ok()
            .map(|turn| turn.by)
    };
    let request = Request {
        model,
        path,
        q_start: *q_start,
        postures: &commanded,
        analyzer,
        turning: &turned,
        task: robot.task.0,
        length_m: robot.length_m,
        rate_max: &control.aux_rate_max,
        position_m: scenario.goal.path_mm * 1e-3,
        orientation_rad: scenario.goal.path_deg.to_radians(),
    };
    if let Some(why) = too_heavy(model, robot, q_start, "in its start posture") {
        return Err(why + ": start in a posture that takes less torque");
    }
    let plan = plan(&request)
        .map_err(|error| words(robot, &error) + &help(robot, scenario, remedy(&request)))?;
    let (segment, fastest) = plan.fastest(&request.velocity());
    if fastest < SLOWEST {
        return Err(format!(
            "segment {segment} is too short: at the speeds of the joints it takes at least {:.0} times its duration",
            1.0 / fastest
        ));
    }
    let heavy = plan
        .postures()
        .find_map(|(t, q)| too_heavy(model, robot, q, &format!("at {t:.2} s of its path")));
    heavy.map_or(Ok(Some(plan)), |why| {
        Err(why + ": lead the path nearer to the base, or start in another posture")
    })
}

/// A joint whose torque limit does not hold the arm against gravity, in words.
fn too_heavy<const N: usize>(
    model: &Model<N>,
    robot: &Robot,
    q: &SVector<f64, N>,
    place: &str,
) -> Option<String> {
    let gravity = model.gravity(q);
    let joint = (0..robot.dof()).find(|i| gravity[*i].abs() > model.effort()[*i])?;
    let [_, unit] = robot.joints[joint].kind.units();
    let (name, needed, limit) = (
        &robot.joints[joint].name,
        gravity[joint].abs(),
        model.effort()[joint],
    );
    Some(format!(
        "the arm cannot be held {place}: joint {} ({name}) needs {needed:.1} {unit} and has {limit:.1} {unit}",
        joint + 1
    ))
}

fn words(robot: &Robot, infeasible: &Infeasible) -> String {
    let Infeasible {
        leg,
        time_s,
        obstacle,
        is_exhausted,
    } = infeasible;
    let (found, tried) = if *is_exhausted {
        ("no route", "")
    } else {
        ("no route found within the budget", " that the search tried")
    };
    let reason = match obstacle {
        Obstacle::Limit { joint, limit } => {
            let Joint { name, kind, .. } = &robot.joints[*joint];
            let (limit, [unit, _]) = (kind.shown(*limit), kind.units());
            format!(
                "joint {} ({name}) would pass its limit of {limit:.1}{unit}, on every route{tried}",
                joint + 1
            )
        }
        Obstacle::Reach => "the path leaves the reachable space, between reachable ends".to_owned(),
        Obstacle::Discontinuous | Obstacle::Undecided => format!(
            "the poses from there on belong to other postures of the arm, on every route{tried}"
        ),
    };
    format!("{found} from this start posture: at {time_s:.2} s (segment {leg}) {reason}")
}

/// The remedy, as far as it is known.
fn help<const N: usize>(robot: &Robot, scenario: &Scenario, remedy: Option<Remedy<N>>) -> String {
    match remedy {
        Some(Remedy::Start(q)) => {
            let slides = |joint: &Joint| joint.kind == JointKind::Prismatic;
            let (key, q) = if robot.joints.iter().any(slides) {
                ("q", q)
            } else {
                ("q_deg", q.map(f64::to_degrees))
            };
            let list: Vec<_> = q.iter().take(robot.dof()).collect();
            format!(
                "; it can be followed from another posture of the same pose: [start] {key} = {list:.4?}"
            )
        }
        Some(Remedy::Allow(position_m, orientation_rad)) => {
            let (mm, deg) = (position_m * 1e3, orientation_rad.to_degrees());
            format!(
                "; it can be followed where more deviation is allowed: [goal] path_mm = {mm:.0}, path_deg = {deg:.1}"
            )
        }
        None => {
            let Goal {
                path_mm, path_deg, ..
            } = scenario.goal;
            format!(
                "; neither another posture of the start pose nor a deviation beyond {path_mm} mm and {path_deg}° has been found to help: lead the path \
                 elsewhere, end it earlier, or let the arm leave it: [control] governor = false starts without a plan"
            )
        }
    }
}
