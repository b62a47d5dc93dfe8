//! Everything that a process needs to know about its run. The launcher writes it once, before
//! anything starts.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::file::Complaint;
use crate::graph::Graph;
use crate::scenario::Scenario;
use crate::summary::FaultSummary;
use crate::words::words;

/// Name of the file of a job in a run's directory and in its results folder.
pub const JOB: &str = "job.json";

words! {
    /// How time passes.
    Mode {
        /// Tick by tick as fast as the machine allows; every process works on exactly tick k, and the same scenario gives the same bytes.
        Lockstep "lockstep",
        /// On absolute deadlines of a fixed grid; the newest message is used, and late ones are
        /// counted.
        Realtime "realtime",
    }
}

/// The texts a robot is made from: every process builds the same robot out of them.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RobotText {
    /// Name.
    pub name: String,
    /// armplane's own description, TOML; may be empty.
    pub description: String,
    /// The URDF.
    pub urdf: String,
    /// Where its file is: the paths of its meshes start there. Empty for an arm out of no file.
    #[serde(default)]
    pub folder: PathBuf,
}

/// The job of a run: scenario, graph and settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Job {
    /// The name of the run on its machine.
    pub run: String,
    /// A random number that no other run has: the message logs carry it.
    #[serde(default)]
    pub id: u64,
    /// Version of armplane that wrote this.
    pub version: String,
    /// How time passes.
    pub mode: Mode,
    /// Folder of the results.
    pub out: PathBuf,
    /// Whether the recorder keeps every message as it was on the wire, in `messages.mcap` of the results folder; it judges and hashes either way.
    pub record: bool,
    /// The kind of fault.
    pub scenario: Scenario,
    /// With which arm.
    pub robot: RobotText,
    /// Its joints; 0 in a job of an earlier version.
    #[serde(default)]
    pub dof: u32,
    /// In which processes.
    pub graph: Graph,
    /// The run that it goes on from; `None`: it begins with tick 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from: Option<Branch>,
    /// Deaths before this start of its processes, for a launcher that goes on after the death of this one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub deaths: Vec<FaultSummary>,
}

/// The place at which a run goes on from another one.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Branch {
    /// The folder of that run.
    pub run: String,
    /// The tick.
    pub tick: u64,
    /// Settings that differ from there on; none: it is the same run.
    pub settings: Vec<String>,
}

impl std::fmt::Display for Branch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}@{}", self.run, self.tick)?;
        match &*self.settings {
            [] => Ok(()),
            settings => write!(f, " with {}", settings.join(", ")),
        }
    }
}

impl Job {
    /// The checks of a scenario and a graph as read from their files: a job may come from elsewhere.
    ///
    /// # Errors
    /// [`Complaint`], its path relative to the job.
    pub fn check(&self) -> Result<(), Complaint> {
        self.scenario
            .check()
            .map_err(|complaint| complaint.within("scenario"))?;
        self.graph
            .check()
            .map_err(|complaint| complaint.within("graph"))?;
        self.scenario
            .scheduled_faults(&self.graph)
            .map(drop)
            .map_err(|complaint| complaint.within("scenario"))
    }
}
