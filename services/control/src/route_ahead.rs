//! The path plan of a scenario: made when a controller is, put into words where there is none.

use crate::analyzer::Analyzer;
use crate::continuous::path_plan::{Infeasible, Obstacle, PathPlan, Request, plan};
use crate::continuous::turn_plan::{self, Room};
use crate::trajectory::Path;
use model::{Model, Robot};
use nalgebra::SVector;
use shared_types::scenario::{Scenario, Strategy};

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
    let ours = matches!(control.strategy, Strategy::Blended | Strategy::ChangKhatib);
    if !ours || !control.governor || robot.task.count() > N {
        return Ok(None);
    }
    let commanded: Vec<_> = scenario.segment.iter().zip(postures).map(|(leg, q)| leg.posture_deg.is_some().then_some(*q)).collect();
    let turning = |q: &SVector<f64, N>, report: &crate::types::Report<N>, place: usize, angle: f64| {
        let terms = model.evaluate(q, &SVector::zeros());
        let s = report.meant().get(place)?;
        let motion = |angle: f64| analyzer.family().get().turning(s, &terms, &report.p_BC, angle);
        turn_plan::plan(s, angle, 1.0, &Room { q, model, control }, motion).ok().map(|turn| turn.by)
    };
    let found = plan(&Request {
        model,
        path,
        q_start: *q_start,
        postures: &commanded,
        analyzer,
        turning: &turning,
        task: robot.task.0,
        length_m: robot.length_m,
        rate_max: &control.aux_rate_max,
        position_m: scenario.goal.path_mm * 1e-3,
        orientation_rad: scenario.goal.path_deg.to_radians(),
    });
    match found {
        Ok(plan) => Ok(Some(plan)),
        // The poses are within reach: the law decides as it goes.
        Err(Infeasible { obstacle: Obstacle::Discontinuous, .. }) => Ok(None),
        Err(infeasible) => Err(words(robot, &infeasible)),
    }
}

fn words(robot: &Robot, infeasible: &Infeasible) -> String {
    let Infeasible { leg, time_s, obstacle } = infeasible;
    match obstacle {
        Obstacle::Limit { joint, limit } => {
            let name = robot.joints.get(*joint).map_or("?", |joint| joint.name.as_str());
            let limit = limit.to_degrees();
            format!(
                "the path cannot be followed from this start posture: at {time_s:.2} s (segment {leg}) joint {} ({name}) would pass its limit of \
                 {limit:.1}°, on every route; start in another posture of the same pose, end the path earlier, or allow more deviation \
                 ([goal] path_deg, path_mm)",
                joint + 1
            )
        }
        Obstacle::Reach => format!(
            "the path leaves the reachable space at {time_s:.2} s (segment {leg}), between reachable ends; lead it around, or allow more deviation \
             ([goal] path_mm)"
        ),
        Obstacle::Discontinuous => format!("no continuous motion follows the path beyond {time_s:.2} s (segment {leg})"),
    }
}
