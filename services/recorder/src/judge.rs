//! The recorder's pure step: whole ticks in, the summary out. Every figure comes from the
//! simulator's true state, never from the controller's own errors.

mod bars;
mod chatter;
mod force;
mod histogram;
mod joints;
mod latency;
mod path;
mod reach;
mod singularities;
mod steered;
mod task;
#[cfg(test)]
mod tests;
mod tick;
mod turns;

use control::{GroundTruth, free_axis, ground_truth};
use model::{Refused, Robot};
use shared_types::bounds::{larger, within};
use shared_types::codes;
use shared_types::graph::Graph;
use shared_types::scenario::{Goal, Scenario};
use shared_types::summary::{BOUNDARY, MISSED, Pace, REACHED, Summary, TaskSummary};
use shared_types::topics::{ByTopic, Lent};

pub use bars::Bounds;
use chatter::Clock;
use force::{borne, unkept};
use joints::JointMeter;
use latency::LatencyMeter;
use path::PathMeter;
use reach::{Beyond, ReachMeter};
use singularities::SingularityMeter;
use steered::SteeredMeter;
use task::TaskMeter;
use turns::TurnMeter;

pub use joints::Limits;
pub use task::TaskError;
use task::against_reference;
pub(crate) use tick::Tick;

/// Most events that wait to be fetched.
const MOST_EVENTS: usize = 64;

/// Gathers a run's figures tick by tick.
#[derive(Debug)]
pub struct Judge {
    truth: Box<dyn GroundTruth>,
    scenario: Scenario,
    /// A part of the segments' orientations that the judge does not ask for, as a clause.
    unasked: Option<String>,
    ticks: u64,
    path: PathMeter,
    task: TaskMeter,
    reach: ReachMeter,
    joints: JointMeter,
    singularities: SingularityMeter,
    turns: TurnMeter,
    steered: SteeredMeter,
    latency: LatencyMeter,
    events: Vec<(u64, String)>,
    end: Newest,
}

/// The task at the newest tick, which may be the last.
#[derive(Debug, Default)]
struct Newest {
    /// Whether the controller has reported a goal beyond reach, in this tick or before.
    clipped: bool,
    /// Whether the errors are along ζ alone.
    is_at_boundary: bool,
    /// Distance from the path's end where the controller has refused to go on, mm, °.
    left: [f64; 2],
    phase: u32,
    refusal: u32,
}

/// The judge's findings: the part of a run's summary that follows from its ticks; the rest is empty. Every limit that a joint reached and every hold
/// beyond the goal's bounds is in the reason.
pub type Verdict = Summary;

impl Judge {
    /// A judge of a scenario on a robot.
    ///
    /// # Errors
    /// [`Refused`] if the scenario does not fit the robot.
    pub fn new(robot: &Robot, scenario: &Scenario) -> Result<Self, Refused> {
        let truth = ground_truth(robot, scenario)?;
        Ok(Self {
            unasked: unasked(robot, scenario),
            ..Self::of(truth, Limits::of(robot), scenario.clone())
        })
    }

    /// The same for a run in the processes of a graph, by which its latencies are named.
    ///
    /// # Errors
    /// See [`Judge::new`].
    pub fn in_processes(
        graph: &Graph,
        robot: &Robot,
        scenario: &Scenario,
    ) -> Result<Self, Refused> {
        Ok(Self {
            latency: LatencyMeter::new(graph),
            ..Self::new(robot, scenario)?
        })
    }

    /// A judge by this truth, of a run in the processes of the built-in graph.
    fn of(truth: Box<dyn GroundTruth>, limits: Limits, scenario: Scenario) -> Self {
        let graph = Graph::built_in(false).expect("the graph that the program contains is valid");
        Self {
            path: PathMeter::new(truth.as_ref()),
            truth,
            scenario,
            unasked: None,
            ticks: 0,
            task: TaskMeter::default(),
            reach: ReachMeter::default(),
            joints: JointMeter::new(limits),
            singularities: SingularityMeter::default(),
            turns: TurnMeter::default(),
            steered: SteeredMeter::default(),
            latency: LatencyMeter::new(&graph),
            events: Vec::new(),
            end: Newest::default(),
        }
    }

    /// The same for a run on a grid in time: a grid point at which no tick began, because the one before took too long, is a sample too.
    pub fn on_grid(mut self, period_ns: u64) -> Self {
        self.latency.period_ns = period_ns;
        self
    }

    /// Takes in the messages of a tick; the error of its true pose. Of a tick that not every process answered only the duration can be judged.
    pub fn take(&mut self, messages: &ByTopic<Lent<'_>>) -> TaskError {
        if let Some(whole) = Tick::of(messages) {
            return self.whole(whole);
        }
        if let Some(sensor) = messages.sensor {
            self.latency.measure_chain(sensor);
            self.ticks += 1;
        }
        TaskError::UNKNOWN
    }

    fn whole(&mut self, tick: Tick<'_>) -> TaskError {
        let events = &mut self.events;
        let k = tick.truth.header.tick;
        let mut event = |text: String| {
            if events.len() < MOST_EVENTS {
                events.push((k, text));
            }
        };
        self.truth.analyse(tick.truth, tick.report);
        let truth = self.truth.as_ref();
        let goal = &self.scenario.goal;
        let dt_s = self.scenario.dt_s();
        let whole = self
            .path
            .error(truth, tick.control.path_time_s, tick.truth, dt_s)
            .unwrap_or_else(|| against_reference(&tick, self.joints.served()));
        let error = TaskError::split(truth, &whole);
        let switches = self.singularities.tick(&tick, &error, goal, &mut event);
        self.turns.tick(&tick, self.joints.count());
        tick.servo
            .into_iter()
            .for_each(|state| self.steered.tick(state));
        let place = self.path.place();
        let is_beyond = truth.is_beyond(&whole);
        self.task.tick(&error, is_beyond);
        // At a fold the path may lie outwards by as much as a route may deviate, and the goal's own bound.
        let bound_mm = goal.path_mm + goal.position_mm;
        self.reach
            .tick(error.position[0], is_beyond, place, tick.truth, bound_mm);
        self.task.touch(&tick, truth, place.as_ref(), &whole, dt_s);
        let clock = Clock {
            tick: k,
            rate_hz: f64::from(self.scenario.rate_hz),
            k_v: self.scenario.control.k_v,
        };
        self.joints.tick(&tick, truth, clock, switches, &mut event);
        self.latency.measure_hops(tick.torque);
        self.latency.measure_chain(tick.sensor);
        if tick.control.clipped != 0 && !self.end.clipped {
            event(
                "the goal is beyond reach: it is clipped to the boundary from here on".to_owned(),
            );
        }
        self.end.clipped |= tick.control.clipped != 0;
        self.end.is_at_boundary = is_at_boundary(&error, goal);
        self.end.phase = tick.torque.phase;
        self.end.refusal = tick.control.refusal;
        if self.end.phase == codes::PHASE_REFUSED {
            let left = self.path.left(self.truth.as_ref(), tick.truth);
            let split = left.map(|left| TaskError::split(self.truth.as_ref(), &left));
            self.end.left = split.map_or([0.0; 2], |left| [left.position[0], left.orientation[0]]);
        }
        self.ticks += 1;
        error
    }

    /// Limits reached and holds begun since the last call, each with its tick, for the log.
    pub fn events(&mut self) -> impl Iterator<Item = (u64, String)> {
        self.events.drain(..)
    }

    /// Why the task has not come to its end, and how far from it the arm is.
    fn stopped(&self) -> String {
        match self.end.phase {
            codes::PHASE_REFUSED => {
                let why = codes::name_of(codes::REFUSALS, self.end.refusal);
                let [mm, deg] = self.end.left;
                format!(
                    "the controller refused to go on and brought the arm to rest {mm:.1} mm and {deg:.1}° from the path's end: {why}"
                )
            }
            _ => format!(
                "the run ended after {} ticks, but the controller never set `phase` to done",
                self.ticks
            ),
        }
    }

    /// The findings.
    pub fn verdict(self) -> Verdict {
        let completed = self.end.phase == codes::PHASE_DONE;
        let breach = self
            .path
            .breach(self.truth.as_ref(), &self.scenario, completed);
        let goal = &self.scenario.goal;
        let session = self.scenario.servo.as_ref();
        let is_done = breach.is_none();
        let stopped = self.stopped();
        let mut along = self.task.along();
        let contact = self.task.clause();
        let planned_ticks = self.scenario.planned_ticks() as f64;
        let mut task = self.task.finish(self.ticks, planned_ticks);
        let mut beyond = self.reach.finish(self.truth.as_ref());
        beyond.at_end &= self.end.is_at_boundary;
        // A steered run has no path whose reach could be asked, and its reference leads the hand a little: its end counts.
        if session.is_some() && !beyond.at_end {
            beyond = Beyond::default();
        }
        along[0] = larger(along[0], beyond.within_mm);
        task.beyond_max_mm = beyond.most_mm;
        task.beyond_ticks = beyond.ticks;
        let (outcome, mut reason) = match (self.end.phase, breach) {
            (codes::PHASE_DONE, Some(breach)) => (MISSED, breach),
            (codes::PHASE_DONE, None) => {
                let has_broken_a_limit = self.joints.has_broken_a_limit();
                done(&task, goal, along, beyond, has_broken_a_limit)
            }
            _ => ("stopped", stopped),
        };
        let singularities = &self.singularities;
        let is_orthogonal_missed = completed && !is_orthogonal_kept(&task, goal);
        let is_braked = self.joints.is_braked();
        task.causes = causes(singularities, is_orthogonal_missed, beyond, is_braked);
        let clauses = singularities.clauses().chain(singularities.ends());
        let others = self.joints.clauses().chain(contact).chain(self.unasked);
        let is_path_reached = outcome == REACHED && session.is_none();
        let strayed = is_path_reached.then(|| strayed(&task, goal));
        for clause in strayed.into_iter().flatten().chain(clauses).chain(others) {
            reason.push_str("; ");
            reason.push_str(&clause);
        }
        let (singularities, modes) = self.singularities.finish();
        let joints = self.joints.finish();
        let has_session_ended = session.is_some_and(|session| session.ticks == self.ticks);
        let is_over = completed || self.ticks > 0 && has_session_ended;
        let dt_s = self.scenario.dt_s();
        bars::judge(&mut task, &joints, (is_over, is_done), dt_s);
        Summary {
            ticks: self.ticks,
            completed,
            outcome: outcome.to_owned(),
            reason,
            pace: pace(self.ticks, self.latency.wall_s()),
            task,
            joints,
            singularities,
            turns: self.turns.finish(),
            modes,
            servo: self.steered.finish(f64::from(self.scenario.rate_hz)),
            latency_us: self.latency.summary(),
            ..Summary::default()
        }
    }
}

fn pace(ticks: u64, wall_s: f64) -> Pace {
    let ticks_per_s = if wall_s > 0.0 {
        ticks as f64 / wall_s
    } else {
        0.0
    };
    Pace {
        wall_s,
        ticks_per_s,
    }
}

/// The rotation that the arm's task leaves free, where a segment states an orientation: it is met up to a turn about that axis.
fn unasked(robot: &Robot, scenario: &Scenario) -> Option<String> {
    let axis = ["x", "y", "z"][free_axis(&robot.task.0)?.imax()];
    let mut segments = scenario.segment.iter();
    let states = segments.any(|one| one.rotation.is_some() || one.quaternion.is_some());
    states.then(|| {
        format!("orientations are met up to a turn about {axis}, which the arm's task leaves free")
    })
}

/// Whether an error is one along the singular directions alone, as far as the goal's bounds at the end see.
fn is_at_boundary(error: &TaskError, goal: &Goal) -> bool {
    within(error.position[1], goal.position_mm)
        && within(error.orientation[0], goal.orientation_deg)
}

/// Whether the errors orthogonal to the singular directions are within the goal's bounds.
fn is_orthogonal_kept(task: &TaskSummary, goal: &Goal) -> bool {
    within(task.orthogonal_max_mm, goal.orthogonal_mm)
        && within(task.orthogonal_max_deg, goal.orthogonal_deg)
}

/// An error of a run, and the bound that its goal sets.
struct Bar {
    what: &'static str,
    value: f64,
    bound: f64,
    unit: &'static str,
    /// Upper limit of such an error; a larger bound would judge nothing.
    most: f64,
}

impl Bar {
    fn is_judged(&self) -> bool {
        self.bound < self.most
    }

    fn told(&self, word: &str) -> String {
        let Self {
            what,
            value,
            bound,
            unit,
            ..
        } = self;
        format!("{what} off by {value:.3}{unit}{word} {bound}{unit}")
    }
}

/// Codes of what the reason states in words.
fn causes(
    singularities: &SingularityMeter,
    is_orthogonal_missed: bool,
    beyond: Beyond,
    is_braked: bool,
) -> Vec<String> {
    let causes = [
        ("held", singularities.clauses().next().is_some()),
        ("inside", singularities.ends().next().is_some()),
        ("orthogonal", is_orthogonal_missed),
        ("beyond", beyond.ticks > 0),
        ("braked", is_braked),
    ];
    let causes = causes.into_iter().filter(|(_, holds)| *holds);
    causes.map(|(code, _)| code.to_owned()).collect()
}

/// Outcome and reason of a task that ran to its end; `along`: largest errors along the singular
/// directions within reach, mm, °; `beyond`: the part of the path that is out of reach.
fn done(
    task: &TaskSummary,
    goal: &Goal,
    along: [f64; 2],
    beyond: Beyond,
    has_broken_a_limit: bool,
) -> (&'static str, String) {
    let [ends, along, across] = bars(task, goal, along);
    let is_judged = ends.iter().chain(&across).any(Bar::is_judged);
    // What lies beyond reach cannot be asked for.
    let asked = ends.iter().filter(|_| !beyond.at_end);
    let asked = asked.chain(along.iter().chain(&across).filter(|_| is_judged));
    let missed = asked.filter(|bar| !within(bar.value, bar.bound));
    let force = task.force.as_ref().and_then(|force| unkept(force, goal));
    let pressed = (task.force.is_some() && task.contact_ticks > 0)
        .then(|| "a contact was harder than asked for".to_owned());
    let missed = missed.map(|bar| bar.told(", allowed"));
    let missed: Vec<String> = force.into_iter().chain(pressed).chain(missed).collect();
    // Exactly zero is the error of an axis that the task does not count.
    let kept = ends
        .iter()
        .filter(|bar| bar.is_judged() && bar.value != 0.0);
    let kept: Vec<String> = kept.map(|bar| bar.told(" of")).collect();
    let place = (beyond.ticks > 0).then(|| {
        if beyond.at_end {
            format!(
                "the goal is {:.1} mm beyond reach and the path up to {:.1} mm",
                task.final_position_mm, beyond.most_mm
            )
        } else {
            format!("the path lies up to {:.1} mm beyond reach", beyond.most_mm)
        }
    });
    if !missed.is_empty() {
        let borne = task.force.as_ref().and_then(borne);
        let all: Vec<String> = place.into_iter().chain(missed).chain(borne).collect();
        (MISSED, all.join("; "))
    } else if has_broken_a_limit {
        let reason = "the path was followed, but beyond the arm's limits";
        (MISSED, reason.to_owned())
    } else if let Some(place) = place {
        let reason = format!(
            "{place}, for {} ticks: the arm went along its boundary, orthogonal to it off by {:.3} mm at most",
            beyond.ticks, task.orthogonal_max_mm
        );
        (BOUNDARY, reason)
    } else if !is_judged {
        let reason = format!(
            "the path was followed to its end; its errors, up to {:.3} mm and {:.3}°, are not judged",
            task.position_max_mm, task.orientation_max_deg
        );
        (REACHED, reason)
    } else if kept.is_empty() {
        (REACHED, "all errors within the goal".to_owned())
    } else {
        (REACHED, kept.join("; "))
    }
}

/// By how much the hand left the path along ζ on its way, where that is more than it may at the end.
fn strayed(task: &TaskSummary, goal: &Goal) -> impl Iterator<Item = String> + use<> {
    let [ends, ..] = bars(task, goal, [0.0; 2]);
    let along = [task.along_max_mm, task.along_max_deg];
    let left = ends.into_iter().zip(along);
    let left = left.filter(|(end, along)| end.is_judged() && !within(*along, end.bound));
    left.map(|(end, along)| {
        let unit = end.unit;
        format!("on its way off by up to {along:.3}{unit} along the singular directions")
    })
}

/// The errors at the end, and those along and orthogonal to the singular directions while the arm moved.
fn bars(task: &TaskSummary, goal: &Goal, [along_mm, along_deg]: [f64; 2]) -> [[Bar; 2]; 3] {
    let s2 = Bounds::s2();
    let pair = |[mm, deg]: [&'static str; 2], values: [f64; 2], bounds: [f64; 2]| {
        let bar = |i: usize, what, unit, most| Bar {
            what,
            value: values[i],
            bound: bounds[i],
            unit,
            most,
        };
        [bar(0, mm, " mm", 1000.0), bar(1, deg, "°", 180.0)]
    };
    [
        pair(
            ["end position", "end orientation"],
            [task.final_position_mm, task.final_orientation_deg],
            [goal.position_mm, goal.orientation_deg],
        ),
        pair(
            [
                "position along the singular directions",
                "orientation about the singular directions",
            ],
            [along_mm, along_deg],
            [s2.along_mm, s2.along_deg],
        ),
        pair(
            [
                "position orthogonal to the singular directions",
                "orientation orthogonal to the singular directions",
            ],
            [task.orthogonal_max_mm, task.orthogonal_max_deg],
            [goal.orthogonal_mm, goal.orthogonal_deg],
        ),
    ]
}
