//! The recorder's pure step: whole ticks in, the summary out. Every figure is of the simulator's truth; the controller's own errors are not used.

mod histogram;
mod joints;
mod latency;
mod path;
mod singularities;
mod steered;
mod task;
#[cfg(test)]
mod tests;
mod tick;
mod turns;

use std::collections::BTreeMap;

use control::commanded_path;
use model::{Refused, Robot};
use serde::{Deserialize, Serialize};
use shared_types::SensorSample;
use shared_types::bounds::within;
use shared_types::codes;
use shared_types::graph::Graph;
use shared_types::scenario::{Goal, Scenario};
use shared_types::summary::{
    JointSummary, Latency, ModeChange, ServoSummary, SingularitySummary, TaskSummary, TurnSummary,
};

use joints::JointMeter;
use latency::{Chain, LatencyMeter};
use path::PathMeter;
use singularities::SingularityMeter;
use steered::SteeredMeter;
use task::TaskMeter;
use turns::TurnMeter;

pub use joints::Limits;
pub use task::TaskError;
pub use tick::Tick;

/// Most events that wait to be fetched.
const MOST_EVENTS: usize = 64;

/// Gathers a run's figures tick by tick.
#[derive(Debug, Serialize, Deserialize)]
pub struct Judge {
    goal: Goal,
    planned_ticks: f64,
    rate_hz: f64,
    ticks: u64,
    path: PathMeter,
    task: TaskMeter,
    joints: JointMeter,
    singularities: SingularityMeter,
    turns: TurnMeter,
    steered: SteeredMeter,
    latency: LatencyMeter,
    events: Vec<(u64, String)>,
    clipped: bool,
    phase: u32,
    refusal: u32,
}

/// The judge's findings.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict {
    /// Whole ticks seen.
    pub ticks: u64,
    /// Whether the task ran to its end.
    pub completed: bool,
    /// `"goal reached"`, `"goal missed"` or `"stopped"`.
    pub outcome: String,
    /// Why, in one sentence. Every limit that a joint reached and every hold beyond the goal's bounds is in it.
    pub reason: String,
    /// Wall-clock time between the first and the last sample; s.
    pub wall_s: f64,
    /// Task errors.
    pub task: TaskSummary,
    /// Joint loads.
    pub joints: JointSummary,
    /// Per singularity.
    pub singularities: Vec<SingularitySummary>,
    /// Null-space turns of singular directions.
    pub turns: Vec<TurnSummary>,
    /// Mode changes.
    pub modes: Vec<ModeChange>,
    /// How the arm followed its targets, of a steered run.
    pub servo: Option<ServoSummary>,
    /// Per hop and end to end.
    pub latency_us: BTreeMap<String, Latency>,
}

impl Judge {
    /// A judge of a scenario on a robot.
    ///
    /// # Errors
    /// [`Refused`] where the scenario does not fit the robot.
    pub fn new(robot: &Robot, scenario: &Scenario) -> Result<Self, Refused> {
        Self::resumed(
            Self::of_chain(Chain::default(), robot, scenario),
            robot,
            scenario,
        )
    }

    /// The same for a run in the processes of a graph, by which its latencies are named.
    ///
    /// # Errors
    /// As [`Judge::new`].
    pub fn in_processes(
        graph: &Graph,
        robot: &Robot,
        scenario: &Scenario,
    ) -> Result<Self, Refused> {
        Self::resumed(
            Self::of_chain(Chain::of(graph), robot, scenario),
            robot,
            scenario,
        )
    }

    /// A judge that a checkpoint has kept, of the same scenario and robot: it takes up the path where it was.
    ///
    /// # Errors
    /// As [`Judge::new`].
    pub fn resumed(mut self, robot: &Robot, scenario: &Scenario) -> Result<Self, Refused> {
        self.path.follow(commanded_path(robot, scenario)?);
        Ok(self)
    }

    fn of_chain(chain: Chain, robot: &Robot, scenario: &Scenario) -> Self {
        Self {
            rate_hz: f64::from(scenario.rate_hz),
            ..Self::pathless(
                chain,
                Limits::of(robot),
                scenario.goal.clone(),
                scenario.planned_ticks() as f64,
            )
        }
    }

    /// A judge without a path of its own: errors are those against the controller's reference.
    fn pathless(chain: Chain, limits: Limits, goal: Goal, planned_ticks: f64) -> Self {
        Self {
            goal,
            planned_ticks,
            rate_hz: 1000.0,
            ticks: 0,
            path: PathMeter::default(),
            task: TaskMeter::default(),
            joints: JointMeter::new(limits),
            singularities: SingularityMeter::default(),
            turns: TurnMeter::default(),
            steered: SteeredMeter::default(),
            latency: LatencyMeter::new(chain),
            events: Vec::new(),
            clipped: false,
            phase: 0,
            refusal: 0,
        }
    }

    /// The same for a run on a grid in time: a grid point at which no tick began, because the one before took too long, is a sample too.
    #[must_use]
    pub fn on_grid(self, period_ns: u64) -> Self {
        Self {
            latency: self.latency.on_grid(period_ns),
            ..self
        }
    }

    /// Takes in one whole tick; the error of its true pose.
    pub fn tick(&mut self, tick: Tick<'_>) -> TaskError {
        let (events, k) = (&mut self.events, tick.truth.header.tick);
        let mut event = |text: String| {
            if events.len() < MOST_EVENTS {
                events.push((k, text));
            }
        };
        let dt_s = 1.0 / self.rate_hz;
        let against_path = self
            .path
            .error(tick.control.path_time_s, dt_s, tick.truth, tick.report);
        let error = match against_path {
            Some(error) => TaskError::split(&tick, &error),
            None => TaskError::on(&tick, self.joints.served()),
        };
        let switches = self
            .singularities
            .tick(&tick, &error, &self.goal, &mut event);
        self.turns.tick(&tick, self.joints.count());
        tick.servo
            .into_iter()
            .for_each(|state| self.steered.tick(state));
        self.task.tick(&error);
        self.joints.tick(&tick, switches, &mut event);
        self.latency.measure_hops(tick.torque);
        self.latency.measure_chain(tick.sensor);
        if tick.control.clipped != 0 && !self.clipped {
            event(
                "the goal is beyond reach: it is clipped to the boundary from here on".to_owned(),
            );
        }
        self.clipped |= tick.control.clipped != 0;
        (self.phase, self.refusal) = (tick.torque.phase, tick.control.refusal);
        self.ticks += 1;
        error
    }

    /// Takes in a tick that not every process answered: only its duration can be judged.
    pub fn torn(&mut self, sensor: &SensorSample) {
        self.latency.measure_chain(sensor);
    }

    /// Limits reached and holds begun since the last call, each with its tick, for the log.
    pub fn events(&mut self) -> impl Iterator<Item = (u64, String)> {
        self.events.drain(..)
    }

    /// The findings.
    #[must_use]
    pub fn verdict(self) -> Verdict {
        let task = self.task.finish(self.ticks, self.planned_ticks);
        let breach = self.path.breach(self.phase == codes::PHASE_DONE);
        let (outcome, mut reason) = match (self.phase, self.clipped) {
            (codes::PHASE_REFUSED, _) => {
                let why = codes::name_of(codes::REFUSALS, self.refusal);
                (
                    "stopped",
                    format!("the controller refused to go on and brought the arm to rest: {why}"),
                )
            }
            (codes::PHASE_DONE, clipped) => match breach {
                Some(breach) => ("goal missed", breach),
                None => done(&task, &self.goal, clipped),
            },
            _ => (
                "stopped",
                format!(
                    "the run ended after {} ticks, before the task did",
                    self.ticks
                ),
            ),
        };
        for clause in self
            .singularities
            .clauses()
            .chain(self.singularities.ends())
            .chain(self.joints.clauses())
        {
            reason.push_str("; ");
            reason.push_str(&clause);
        }
        let (singularities, modes) = self.singularities.finish();
        Verdict {
            ticks: self.ticks,
            completed: self.phase == codes::PHASE_DONE,
            outcome: outcome.to_owned(),
            reason,
            wall_s: self.latency.wall_s(),
            task,
            joints: self.joints.finish(),
            singularities,
            turns: self.turns.finish(),
            modes,
            servo: self.steered.finish(self.rate_hz),
            latency_us: self.latency.summary(),
        }
    }
}

/// Bounds that no error of position or orientation exceeds: a goal that allows as much does not judge.
const MOST_MM: f64 = 1000.0;
const MOST_DEG: f64 = 180.0;

/// Outcome and reason of a task that ran to its end.
fn done(task: &TaskSummary, goal: &Goal, clipped: bool) -> (&'static str, String) {
    let bounds = [
        (
            "end position",
            task.final_position_mm,
            goal.position_mm,
            "mm",
            MOST_MM,
        ),
        (
            "end orientation",
            task.final_orientation_deg,
            goal.orientation_deg,
            "°",
            MOST_DEG,
        ),
        (
            "position orthogonal to the singular directions",
            task.orthogonal_max_mm,
            goal.orthogonal_mm,
            "mm",
            MOST_MM,
        ),
        (
            "orientation orthogonal to the singular directions",
            task.orthogonal_max_deg,
            goal.orthogonal_deg,
            "°",
            MOST_DEG,
        ),
    ];
    let missed: Vec<String> = bounds
        .iter()
        .filter(|(_, value, bound, ..)| !within(*value, *bound))
        .map(|(what, value, bound, unit, _)| {
            format!("{what} off by {value:.3} {unit}, allowed {bound} {unit}")
        })
        .collect();
    let clipped = if clipped {
        "; the goal was beyond reach and has been clipped to the boundary"
    } else {
        ""
    };
    if missed.is_empty() {
        // A bound that nothing can break judges nothing.
        let judged = |(_, _, bound, _, most): &&(_, f64, f64, _, f64)| bound < most;
        let told = |(what, value, bound, unit, _): &(&str, f64, f64, &str, f64)| {
            format!("{what} off by {value:.3} {unit} of {bound} {unit}")
        };
        let kept: Vec<String> = bounds[..2].iter().filter(judged).map(told).collect();
        let reason = if bounds.iter().any(|bound| judged(&bound)) {
            if kept.is_empty() {
                "all errors within the goal".to_owned()
            } else {
                kept.join("; ")
            }
        } else {
            format!(
                "the path was followed to its end; its errors, up to {:.3} mm and {:.3}°, are not judged",
                task.position_max_mm, task.orientation_max_deg
            )
        };
        ("goal reached", format!("{reason}{clipped}"))
    } else {
        ("goal missed", format!("{}{clipped}", missed.join("; ")))
    }
}
