//! The path plan of a scenario: made when a controller is, put into words where there is none (+).

use crate::limits::clock::MARGIN;
use crate::linear::Joints;
use crate::plan::request::analyse;
use crate::plan::schedule::SLOWEST;
use crate::plan::{Deviation, Infeasible, Obstacle, PathPlan, Remedy, Request, plan, remedy};
use crate::reference::path::Path;
use crate::setup::{SetupError, posture_goals, start_posture};
use crate::singularity::analyzer::Analyzer;
use model::{Joint, JointKind, Model, Refused, Robot};
use shared_types::scenario::{Goal, Scenario, Start};

/// Distance from a joint limit from which a path may start, rad (m): many times the noise of an encoder, and of the tracking.
const START_CLEAR: f64 = 1e-3;

impl<const N: usize> Request<'_, N> {
    /// Whether the law follows a plan: under our own laws with the governor on.
    fn is_planned(&self) -> bool {
        let control = &self.scenario.control;
        let is_ours = control.strategy.is_ours() && self.scenario.servo.is_none();
        is_ours && control.governor && self.robot.task.count() <= N
    }

    /// The plan of the whole path, where the law needs one: not where it `is_followed` in time without.
    ///
    /// # Errors
    /// Why the path cannot be followed, in words: a joint limit in the way of every route, a torque limit, or a path beyond reach between reachable ends.
    pub(crate) fn route_ahead(
        &self,
        is_followed: &dyn Fn() -> bool,
    ) -> Result<Option<PathPlan<N>>, String> {
        if !self.is_planned() {
            return Ok(None);
        }
        if let Some(why) = self.too_heavy(&self.q_start, "in its start posture") {
            return Err(why + ": start in a posture that takes less torque");
        }
        if let Some(why) = too_near(self.robot, &self.q_start) {
            return Err(why);
        }
        let found = plan(self, is_followed).map_err(|error| words(self.robot, &error))?;
        let Some(plan) = found else {
            return Ok(None);
        };
        let (segment, fastest) = plan.fastest(self.path, &self.velocity());
        if fastest < SLOWEST {
            return Err(format!(
                "segment {segment} is too short: at the speeds of the joints it takes at least {:.0} times its duration",
                1.0 / fastest
            ));
        }
        self.heaviest(&plan).map_or(Ok(Some(plan)), |why| {
            Err(why + ": lead the path nearer to the base, or start in another posture")
        })
    }

    /// The first posture of a plan that a joint's torque limit does not hold, in words.
    fn heaviest(&self, plan: &PathPlan<N>) -> Option<String> {
        let place = |t: f64| format!("at {t:.2} s of its path");
        let heavy = |(t, q): (f64, &_)| self.too_heavy(q, &place(t));
        plan.postures().find_map(heavy)
    }

    /// A joint whose torque limit does not hold the arm against gravity with a margin to move it, in words.
    fn too_heavy(&self, q: &Joints<N>, place: &str) -> Option<String> {
        let Self { model, robot, .. } = *self;
        let gravity = model.gravity(q);
        let joint = (0..robot.dof()).find(|i| gravity[*i].abs() > MARGIN * model.effort()[*i])?;
        let [_, unit] = robot.joints[joint].kind.units();
        let (name, needed, limit) = (
            &robot.joints[joint].name,
            gravity[joint].abs(),
            model.effort()[joint],
        );
        Some(format!(
            "the arm cannot be held and moved {place}: joint {} ({name}) needs {needed:.1} {unit} against gravity, {:.1} % of its limit of {limit:.1} {unit}, \
         and the law keeps {:.0} % of it for moving the arm",
            joint + 1,
            100.0 * needed / limit,
            100.0 * (1.0 - MARGIN)
        ))
    }
}

/// Advice for a scenario that a controller refuses, as a clause: a change of its start or of its goal with which `succeeds` has seen it reach its end.
/// Empty where the law makes no plan, or where a route is not what it lacks.
///
/// # Errors
/// [`Refused`] if the scenario does not fit the robot.
pub fn advice(
    robot: &Robot,
    scenario: &Scenario,
    succeeds: &mut dyn FnMut(&Scenario) -> bool,
) -> Result<String, Refused> {
    model::with_dof!(robot.dof(), N => advised::<N>(robot, scenario, succeeds).map_err(Refused::because))
        .unwrap_or_else(|| Err(Refused::size(robot)))
}

fn advised<const N: usize>(
    robot: &Robot,
    scenario: &Scenario,
    succeeds: &mut dyn FnMut(&Scenario) -> bool,
) -> Result<String, SetupError> {
    let model = Model::<N>::new(robot, scenario.frame())?;
    let q_start = start_posture(robot, scenario)?;
    let postures = posture_goals(robot, scenario)?;
    let analyzer = Analyzer::new(robot, &scenario.analysis);
    let report = analyse(&mut analyzer.clone(), &model, &q_start);
    let path = Path::new(scenario, model.forward_kinematics(&q_start), &report)?;
    let request = Request {
        model: &model,
        robot,
        scenario,
        path: &path,
        analyzer: &analyzer,
        q_start,
        postures: &postures,
        allowed: Deviation::of(&scenario.goal),
    };
    // A segment that is too short says by itself what to do.
    let lacks_route = || {
        plan(&request, &|| false).map_or(true, |plan| {
            plan.is_some_and(|plan| request.heaviest(&plan).is_some())
        })
    };
    if !request.is_planned() || !lacks_route() {
        return Ok(String::new());
    }
    let mut helps = |remedy: &Remedy<N>| succeeds(&changed(robot, scenario, remedy));
    let found = remedy(&request, &mut helps);
    Ok(help(robot, scenario, found))
}

/// The scenario with a remedy, rounded as it is printed.
fn changed<const N: usize>(robot: &Robot, scenario: &Scenario, remedy: &Remedy<N>) -> Scenario {
    let mut scenario = scenario.clone();
    match remedy {
        Remedy::Start(q) => scenario.start = start(robot, q),
        Remedy::Allow(allowed) => {
            let round = |x: f64, unit: f64| (x / unit).round() * unit;
            scenario.goal.path_mm = round(allowed.position_m * 1e3, 1.0);
            scenario.goal.path_deg = round(allowed.orientation_rad.to_degrees(), 0.1);
        }
    }
    scenario
}

/// A posture as a scenario states it, rounded.
fn start<const N: usize>(robot: &Robot, q: &Joints<N>) -> Start {
    let slides = robot
        .joints
        .iter()
        .any(|joint| joint.kind == JointKind::Prismatic);
    let rounded = |unit: f64| {
        let values = q.iter().take(robot.dof());
        Some(values.map(|q| (q / unit * 1e4).round() * 1e-4).collect())
    };
    if slides {
        Start {
            q: rounded(1.0),
            ..Start::default()
        }
    } else {
        Start {
            q_deg: rounded(1f64.to_radians()),
            ..Start::default()
        }
    }
}

/// A joint that begins so near to its limit that noise takes it beyond, in words.
fn too_near<const N: usize>(robot: &Robot, q: &Joints<N>) -> Option<String> {
    let room = |i: usize| (q[i] - robot.joints[i].lower).min(robot.joints[i].upper - q[i]);
    let joint = (0..robot.dof()).find(|i| room(*i) < START_CLEAR)?;
    let Joint { name, kind, .. } = &robot.joints[joint];
    let [unit, _] = kind.units();
    // The printed margin must do: it is rounded up.
    let least = (kind.shown(START_CLEAR) * 1e3).ceil() * 1e-3;
    Some(format!(
        "joint {} ({name}) starts {:.3}{unit} from its limit, where noise takes it beyond: start at least {least:.3}{unit} from it",
        joint + 1,
        kind.shown(room(joint)),
    ))
}

fn words(robot: &Robot, infeasible: &Infeasible) -> String {
    let Infeasible {
        leg,
        time_s,
        obstacle,
        is_certain,
    } = infeasible;
    let (found, tried) = match is_certain {
        true => ("", "every route"),
        false => (" found", "every route that was tried"),
    };
    let reason = match obstacle {
        Obstacle::Limit { joint, limit } => {
            let Joint { name, kind, .. } = &robot.joints[*joint];
            let (limit, [unit, _]) = (kind.shown(*limit), kind.units());
            format!(
                "joint {} ({name}) would pass its limit of {limit:.1}{unit}, on {tried}",
                joint + 1
            )
        }
        Obstacle::Reach => "the path leaves the reachable space, between reachable ends".to_owned(),
        Obstacle::Discontinuous | Obstacle::Undecided => {
            format!("the poses from there on belong to other postures of the arm, on {tried}")
        }
    };
    format!("no route{found} from this start posture: at {time_s:.2} s (segment {leg}) {reason}")
}

/// A remedy, as a clause.
fn help<const N: usize>(robot: &Robot, scenario: &Scenario, remedy: Option<Remedy<N>>) -> String {
    match remedy {
        Some(Remedy::Start(q)) => {
            let Start { q, q_deg, .. } = start(robot, &q);
            let (key, list) = q.map_or(("q_deg", q_deg), |q| ("q", Some(q)));
            format!(
                "; it was followed from another posture of the same pose: [start] {key} = {:.4?}",
                list.unwrap_or_default()
            )
        }
        Some(Remedy::Allow(Deviation {
            position_m,
            orientation_rad,
        })) => {
            let (mm, deg) = (position_m * 1e3, orientation_rad.to_degrees());
            format!(
                "; it was followed with more deviation: [goal] path_mm = {mm:.0}, path_deg = {deg:.1}"
            )
        }
        None => {
            let Goal {
                path_mm, path_deg, ..
            } = scenario.goal;
            format!(
                "; neither another posture of the start pose nor a deviation beyond {path_mm} mm and {path_deg}° has been found to help: lead the path \
                 elsewhere, or end it earlier"
            )
        }
    }
}
