//! A process of a graph: its role, the command that starts it, and armplane's own processes.

use serde::{Deserialize, Serialize};

/// Most restarts of a process with `restart = "always"`.
pub const MOST_RESTARTS: u32 = 5;

/// Most processes a run may have.
pub const MAX_PROCESSES: usize = 16;

/// One operating-system process.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Process {
    /// Name. Without `command` and `program`, armplane's own process of this name runs.
    pub name: String,
    /// The process of armplane that runs under another name, such as `estimator`. Empty: the one
    /// called `name`.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub program: String,
    /// Program and arguments, started in the folder of the graph's file. A program without `/` is
    /// looked for in `PATH`. Empty: armplane itself. docs/wire.md shows how a program takes part.
    ///
    /// The environment variables `ARMPLANE_PROCESS` and `ARMPLANE_RUN` name the process and its
    /// run.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub command: Vec<String>,
    /// You start the program yourself, without `command`: the run prints the environment that it
    /// needs, and waits.
    #[serde(default, skip_serializing_if = "crate::is_default")]
    pub external: bool,
    /// Address of a real arm instead of the simulated one, `fci://HOST` (docs/franka.md). Only for
    /// the process with `feedback`, in real time. `armplane run --plant` sets it.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub robot: String,
    /// Longest time for a tick in a program that uses `libarmplane-process`; s. 0: 10 s. If it is stated, also the longest time that the program may be
    /// stopped by SIGSTOP.
    #[serde(default, skip_serializing_if = "crate::is_default")]
    pub answer_limit_s: u32,
    /// Longest time from the start until your program joins; s. 0: 60 s, or 600 s if `external`.
    #[serde(default, skip_serializing_if = "crate::is_default")]
    pub join_limit_s: u32,
    /// Topics that it reads at each tick; `"*"`: all that others write.
    #[serde(default)]
    pub reads: Vec<String>,
    /// Topics of the last tick that it needs for the next one. The process with `feedback` makes
    /// the ticks, and the run ends with it.
    #[serde(default)]
    pub feedback: Vec<String>,
    /// Topics that only this process writes. It answers each tick with one message per topic; the
    /// last one closes the tick.
    #[serde(default)]
    pub writes: Vec<String>,
    /// Core to which it is pinned in real time, modulo the number of cores.
    #[serde(default)]
    pub core: usize,
    /// SCHED_FIFO priority in real time, 1 to 99. 0: ordinary scheduling.
    #[serde(default)]
    pub priority: u32,
    /// What the launcher does if the process ends unasked.
    #[serde(default)]
    pub restart: Restart,
}

/// What the launcher does if a process ends unasked.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Restart {
    /// Stop the whole graph.
    #[default]
    Never,
    /// Start it again, up to five times.
    Always,
}

/// The part of a process in its run, by its topics.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// It reads `feedback`, the topics that close the loop: it makes the ticks, and the run ends with it.
    World,
    /// It reads messages of a tick and writes others of the same tick.
    Stage,
    /// It writes nothing: in real time no process waits for it, and it is stopped last.
    Observer,
}

impl Role {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::World, Self::Stage, Self::Observer];

    /// As in tables and JSON.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::World => "world",
            Self::Stage => "stage",
            Self::Observer => "observer",
        }
    }

    /// In a sentence.
    #[must_use]
    pub fn about(self) -> &'static str {
        match self {
            Self::World => "the plant",
            Self::Stage => "processes that send messages",
            Self::Observer => "processes that only read",
        }
    }
}

impl Process {
    /// Its part in the run.
    #[must_use]
    pub fn role(&self) -> Role {
        match (self.feedback.is_empty(), self.writes.is_empty()) {
            (false, _) => Role::World,
            (true, false) => Role::Stage,
            (true, true) => Role::Observer,
        }
    }

    /// How often it is started again at most.
    #[must_use]
    pub fn restarts(&self) -> u32 {
        match self.restart {
            Restart::Never => 0,
            Restart::Always => MOST_RESTARTS,
        }
    }

    /// The program of ours that runs as the process; `None` for a command, or a name that it does not know.
    #[must_use]
    pub fn program(&self) -> Option<Program> {
        if self.command.is_empty() && !self.external && self.robot.is_empty() {
            Program::named(self.program_name())
        } else {
            None
        }
    }

    /// The name of the program of ours that it asks for.
    #[must_use]
    pub fn program_name(&self) -> &str {
        if self.program.is_empty() {
            &self.name
        } else {
            &self.program
        }
    }

    /// Whether a program of others takes part for it.
    #[must_use]
    pub fn is_of_others(&self) -> bool {
        self.external || !self.command.is_empty()
    }
}

/// A process that this program contains.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Program {
    /// The simulated arm: torques in; sensor samples and the simulator's truth out.
    Plant,
    /// Sensor samples in, estimates out.
    Estimator,
    /// Estimates in, singularity reports out.
    Analyzer,
    /// Estimates and singularity reports in, torques out.
    Controller,
    /// Records and judges.
    Recorder,
    /// Of steered runs alone: targets from a file, or from the program that started the run.
    Operator,
}

impl Program {
    /// Those of the built-in graph, in the order of the data.
    pub const ALL: [Self; 5] = [
        Self::Plant,
        Self::Estimator,
        Self::Analyzer,
        Self::Controller,
        Self::Recorder,
    ];

    /// The name of its process in a graph, and its subcommand.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Plant => "plant",
            Self::Estimator => "estimator",
            Self::Analyzer => "analyzer",
            Self::Controller => "controller",
            Self::Recorder => "recorder",
            Self::Operator => "operator",
        }
    }

    /// The one of that name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL
            .into_iter()
            .chain([Self::Operator])
            .find(|program| program.name() == name)
    }
}
