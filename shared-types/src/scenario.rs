//! A scenario as TOML: robot, start posture, task, gains, noise, seed, goal.
//!
//! ```toml
//! name = "fig5-wrist-rotation"
//! title = "Wrist lock: turn the singular direction, then rotate about it"
//! robot = "puma560"                    # a built-in name, or a URDF file beside this one
//!
//! [start]
//! q_deg = [20, -60, 170, 0, 0, 0]
//!
//! [[segment]]                          # ζ of the wrist turned by null-space motion, end-effector held
//! reorient = { singularity = "wrist", by_deg = 90 }
//! duration_s = 2.0
//!
//! [[segment]]                          # a straight line with geodesic rotation, quintic in time
//! turn = { about = "zeta:wrist@start", by_deg = 45 }
//! duration_s = 2.0
//! ```

mod analysis;
mod control;
mod curve;
mod force;
mod mount;
mod plant;
mod result;
mod servo;
mod task;

use serde::{Deserialize, Serialize};

use crate::fault::{Fault, ScheduledFault};
use crate::file::{Complaint, InvalidFile, each, key_within, require, within};
use crate::graph::Graph;
use crate::topics::{PRESSING, STEERED};

pub use analysis::{Analysis, BySingularity};
pub use control::{Baseline, Control, Damping, Strategy};
pub use curve::{AXES, Arc, Axis, Frame, Points, Table};
pub use force::{Direction, Force, Moment, Surface};
pub use mount::{Mount, Payload, Push, Tool};
pub use plant::{Estimator, Plant, PlantModel};
pub use result::{Goal, Layout, View};
pub use servo::Servo;
pub use task::{Path, Reorient, Segment, Slide, Start, Turn};

/// Most segments of a task: a route is looked for through each of them before the start.
const MOST_SEGMENTS: usize = 10_000;

/// A scenario file. Every key has a default except `name`, `robot`, `start`, and `segment` or
/// `servo`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Short name: letters, digits, `-`, `_` and `.`.
    pub name: String,
    /// Title for lists and reports.
    #[serde(default)]
    pub title: String,
    /// A few sentences on what to look at.
    #[serde(default)]
    pub about: String,
    /// A built-in robot, or a URDF or MJCF file beside the scenario. A description file of the same
    /// name (`arm.toml` beside `arm.urdf`) is read too.
    pub robot: String,
    /// File of the process graph, beside the scenario. Empty: the built-in graph.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub graph: String,
    /// End-effector frame: a link of the robot. Empty: the robot's default.
    #[serde(default)]
    pub frame: String,
    /// Control rate, 50 to 20000; Hz.
    #[serde(default = "rate_hz")]
    pub rate_hz: u32,
    /// Seed of all random numbers of the run.
    #[serde(default = "one")]
    pub seed: u64,
    /// Start posture. The arm starts at rest.
    pub start: Start,
    /// The pieces of the path, in order.
    #[serde(default)]
    pub segment: Vec<Segment>,
    /// A steered run: the arm follows targets instead of segments.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub servo: Option<Servo>,
    /// Time to hold the last pose before the end is judged; s.
    #[serde(default = "settle_s")]
    pub settle_s: f64,
    /// How the base stands, and what the hand carries.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mount: Option<Mount>,
    /// The simulated arm and its surroundings.
    #[serde(default)]
    pub plant: Plant,
    /// The state estimator.
    #[serde(default)]
    pub estimator: Estimator,
    /// Detection of singularities.
    #[serde(default)]
    pub analysis: Analysis,
    /// The control law and its gains.
    #[serde(default)]
    pub control: Control,
    /// Errors within which the goal counts as reached.
    #[serde(default)]
    pub goal: Goal,
    /// Layout of the recording in the viewer.
    #[serde(default)]
    pub view: View,
    /// Planned faults.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub fault: Vec<Fault>,
}

fn rate_hz() -> u32 {
    1000
}
fn one() -> u64 {
    1
}
fn settle_s() -> f64 {
    0.5
}

/// Whether a text can name a scenario or a sweep: ASCII letters, digits, `-`, `_` and `.`.
#[must_use]
pub fn is_name(text: &str) -> bool {
    !text.is_empty() && text.chars().all(is_part_of_name)
}

/// A name as near to a text as can be: `-` for each character that no name has.
#[must_use]
pub fn as_name(text: &str) -> String {
    let part = |c| if is_part_of_name(c) { c } else { '-' };
    text.chars().map(part).collect()
}

fn is_part_of_name(c: char) -> bool {
    c.is_ascii_alphanumeric() || "-_.".contains(c)
}

impl Scenario {
    /// Reads and validates a scenario, with `settings` (`key=value`) applied.
    ///
    /// # Errors
    /// [`InvalidFile`]: where, what, and what to do.
    pub fn parse(file: &str, text: &str, settings: &[String]) -> Result<Self, InvalidFile> {
        let scenario: Self = crate::file::parse(file, text, settings)?;
        scenario
            .check()
            .map_err(|complaint| complaint.locate_with(file, text, settings))?;
        Ok(scenario)
    }

    /// The end-effector frame, if it is not the robot's default.
    #[must_use]
    pub fn frame(&self) -> Option<&str> {
        Some(self.frame.as_str()).filter(|frame| !frame.is_empty())
    }

    /// Whether a segment controls a force, or a target may: where a steered run has a surface.
    #[must_use]
    pub fn presses(&self) -> bool {
        let is_steered_to = self.servo.is_some() && !self.plant.surface.is_empty();
        is_steered_to || self.segment.iter().any(|segment| segment.force.is_some())
    }

    /// Whether a segment controls a force by a sensor at the wrist.
    #[must_use]
    pub fn has_wrist_sensor(&self) -> bool {
        self.plant.wrist_sensor && self.presses()
    }

    /// Whether its run has a topic of ours: targets where it is steered, a wrist's force where it controls one.
    #[must_use]
    pub fn sends(&self, topic: &str) -> bool {
        match topic {
            PRESSING => self.has_wrist_sensor(),
            _ => self.servo.is_some() || !STEERED.contains(&topic),
        }
    }

    /// Time step; s.
    #[must_use]
    pub fn dt_s(&self) -> f64 {
        1.0 / f64::from(self.rate_hz)
    }

    /// Planned length of the task, settling included; s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        let steered = self.servo.as_ref().map_or(0.0, Servo::duration_s);
        self.segment
            .iter()
            .map(|segment| segment.duration_s)
            .sum::<f64>()
            + steered
            + self.settle_s
    }

    /// Ticks that the task is planned to take.
    #[must_use]
    pub fn planned_ticks(&self) -> u64 {
        self.at_most((self.duration_s() * f64::from(self.rate_hz)).round() as u64)
    }

    /// The smaller of `ticks` and the ticks of the interrupted session.
    #[must_use]
    pub fn at_most(&self, ticks: u64) -> u64 {
        let cut = self.servo.as_ref().map_or(0, |session| session.ticks);
        if cut > 0 { ticks.min(cut) } else { ticks }
    }

    /// The checks that do not need the robot.
    ///
    /// # Errors
    /// [`Complaint`]: the first value that cannot be.
    pub fn check(&self) -> Result<(), Complaint> {
        require(
            is_name(&self.name),
            "name",
            format!("`{}` cannot be a name", self.name),
            "letters, digits, `-`, `_` and `.`",
        )?;
        let rate_hz = self.rate_hz;
        let message = format!("rate {rate_hz} Hz is out of range");
        within("rate_hz", f64::from(rate_hz), 50.0..=20_000.0, message)?;
        key_within("", "settle_s", self.settle_s, 0.0..=600.0)?;
        self.start.check()?;
        self.servo.iter().try_for_each(Servo::check)?;
        let has_segments = !self.segment.is_empty();
        require(
            !(self.servo.is_some() && has_segments),
            "segment",
            "a steered run has no segments",
            "leave out [servo], or the segments",
        )?;
        require(
            self.servo.is_some() || has_segments,
            "segment",
            "the task is empty",
            "add a [[segment]] with a duration_s",
        )?;
        require(
            self.segment.len() <= MOST_SEGMENTS,
            "segment",
            format!("the task has {} segments", self.segment.len()),
            format!("{MOST_SEGMENTS} at most"),
        )?;
        each("segment", &self.segment, |_, one| one.check(&self.plant))?;
        require(
            self.duration_s() <= 36_000.0,
            "segment",
            format!("the task takes {} s", self.duration_s()),
            "10 hours at most",
        )?;
        let has_frame = !self.frame.is_empty();
        let has_floor = self.plant.floor_m.is_some();
        let mut mount = self.mount.iter();
        mount.try_for_each(|mount| mount.check(has_frame, has_floor))?;
        self.plant.check()?;
        self.estimator.check()?;
        self.analysis.check()?;
        self.control.check()?;
        self.goal.check()?;
        each("fault", &self.fault, |_, fault| {
            fault.check_time()?;
            fault.check(self.rate_hz)
        })
    }

    /// Its faults in their fixed-size form, for the processes of a graph.
    ///
    /// # Errors
    /// [`Complaint`]: a fault that makes no sense, or of a process that the graph does not have.
    pub fn scheduled_faults(&self, graph: &Graph) -> Result<Vec<ScheduledFault>, Complaint> {
        let target = |fault: &Fault| {
            graph.target(&fault.process).ok_or_else(|| {
                let names: Vec<_> = graph.process.iter().map(|one| one.name.as_str()).collect();
                let message = format!("there is no process `{}`", fault.process);
                Complaint::new(
                    "process",
                    message,
                    format!("the graph has {}", names.join(", ")),
                )
            })
        };
        let first = self.seed.wrapping_mul(0x0100_0000_01b3);
        let scheduled = |(i, fault): (usize, &Fault)| {
            let seed = first.wrapping_add(i as u64);
            target(fault)
                .and_then(|on| fault.schedule(&on, self.rate_hz, seed))
                .map_err(|complaint| complaint.within(&format!("fault.{i}")))
        };
        let mut faults: Vec<_> = self
            .fault
            .iter()
            .enumerate()
            .map(scheduled)
            .collect::<Result<_, _>>()?;
        end_with_budgets(&mut faults, graph);
        Ok(faults)
    }
}

/// A death that no restart follows takes its process down for one tick: the plant waits there for
/// the end of the run, so its last tick does not depend on when the launcher detects the death.
fn end_with_budgets(faults: &mut [ScheduledFault], graph: &Graph) {
    let is_death = |fault: &&mut ScheduledFault| fault.ends_process();
    let mut deaths: Vec<_> = faults.iter_mut().filter(is_death).collect();
    deaths.sort_by_key(|death| death.at);
    for (index, process) in graph.process.iter().enumerate() {
        let own = deaths
            .iter_mut()
            .filter(|death| death.process as usize == index);
        own.skip(process.restarts() as usize)
            .for_each(|death| death.until = death.at.saturating_add(1));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "name = \"x\"\nrobot = \"puma560\"\n[start]\nposture = \"ready\"\n[[segment]]\nduration_s = 1.0\n";

    #[test]
    fn wrong_values_are_refused_with_their_line() {
        const TIME: &str = "duration_s = 1.0";
        let cases = [
            (TIME, "duration_s = -1.0", 6),
            (
                TIME,
                "duration_s = 1.0\nturn = { about = \"zta\", by_deg = 1 }",
                7,
            ),
            (TIME, "duration_s = 1.0\nquaternion = [1, 1, 0, 0]", 7),
            (
                TIME,
                "duration_s = 1.0\nrotation = [[1,0,0],[0,1,0],[0,0,-1]]",
                7,
            ),
            (TIME, "duration_s = 1.0\nto_m = [0,0,0]\nby_m = [0,0,0]", 5),
            ("posture = \"ready\"", "posture = \"ready\"\nq_rad = [0]", 3),
            ("name = \"x\"", "name = \"x\"\nrate_hz = 1", 2),
            (
                TIME,
                "duration_s = 1.0\n[[fault]]\nprocess = \"plant\"\nkind = \"kill\"\nat_tick = 0\njoint = 1",
                11,
            ),
        ];
        let many = "[[segment]]\nduration_s = 1.0\n".repeat(MOST_SEGMENTS);
        let many = Scenario::parse("a.toml", &(TEXT.to_owned() + &many), &[]);
        assert!(many.unwrap_err().line().is_some());
        for (right, wrong, line) in cases {
            let text = TEXT.replacen(right, wrong, 1);
            let error = Scenario::parse("a.toml", &text, &[]).unwrap_err();
            assert_eq!(error.line(), Some(line), "{error}");
        }
    }

    #[test]
    fn a_scenario_survives_being_written_and_read() {
        for floor in [
            "plant.floor_m=-0.5",
            "plant.floor_m=0",
            "plant.floor_m=\"none\"",
        ] {
            let scenario = Scenario::parse("a.toml", TEXT, &[floor.to_owned()]).unwrap();
            let text = toml::to_string(&scenario).unwrap();
            assert_eq!(Scenario::parse("b.toml", &text, &[]).unwrap(), scenario);
        }
        let word = ["plant.floor_m=\"never\"".to_owned()];
        assert!(Scenario::parse("a.toml", TEXT, &word).is_err());
    }
}
