//! A process of a graph: its part in the run, the command that starts it, and the processes that this program contains.

use serde::{Deserialize, Serialize};

/// How often a process with `restart = "always"` is started again.
pub const MOST_RESTARTS: u32 = 5;

/// Most processes a run may have.
pub const MAX_PROCESSES: usize = 16;

/// One operating-system process.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Process {
    /// Its name; without a `command` and a `program` also the subcommand of `armplane` that it runs.
    pub name: String,
    /// The subcommand of `armplane` that it runs under another name; empty: the one of its own name.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub program: String,
    /// The program that it runs and its arguments, in the folder of the graph's file; empty: this program itself.
    ///
    /// The environment names the process and its run: `ARMPLANE_PROCESS` and `ARMPLANE_RUN`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub command: Vec<String>,
    /// The program does not know armplane's shell: it takes part by an exchange page, in any language (`docs/wire.md`). The environment gives the
    /// page's path: `ARMPLANE_EXCHANGE`.
    #[serde(default, skip_serializing_if = "is_false")]
    pub exchange: bool,
    /// The program is started separately: the run says where its exchange page is, and waits for it. There is no `command` then.
    #[serde(default, skip_serializing_if = "is_false")]
    pub external: bool,
    /// The arm of this address takes the place of the simulated one, `fci://HOST`: only for the process that makes the ticks, in real time
    /// (`docs/franka.md`). `armplane run --plant` sets it.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub robot: String,
    /// The longest that an exchange page's program may take for an answer; s. 0: 10 s.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub answer_limit_s: u32,
    /// The longest that it may take to join, from its start on; s. 0: 60 s.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub join_limit_s: u32,
    /// Topics it reads at the tick it works on; `"*"`: all that others write.
    #[serde(default)]
    pub reads: Vec<String>,
    /// Topics it reads to get to the next tick.
    #[serde(default)]
    pub feedback: Vec<String>,
    /// Topics it alone writes.
    #[serde(default)]
    pub writes: Vec<String>,
    /// The core it is pinned to in real time; modulo the cores there are.
    #[serde(default)]
    pub core: usize,
    /// SCHED_FIFO priority in real time, 1 to 99; 0: ordinary scheduling.
    #[serde(default)]
    pub priority: u32,
    /// The launcher's response to its unrequested end.
    #[serde(default)]
    pub restart: Restart,
}

fn is_false(value: &bool) -> bool {
    !value
}

fn is_zero(value: &u32) -> bool {
    *value == 0
}

/// The launcher's response to the unrequested end of a process.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Restart {
    /// Stop the whole graph.
    #[default]
    Never,
    /// Start it again, within the budget.
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
            Self::World => "the process that makes the ticks",
            Self::Stage => "the processes that write messages",
            Self::Observer => "the processes that only read",
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

    /// Whether a program takes part for it by an exchange page.
    #[must_use]
    pub fn is_exchanged(&self) -> bool {
        self.exchange || self.external
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

    /// Their names, in the same order.
    pub const NAMES: [&'static str; Self::ALL.len()] = {
        let mut names = [""; Self::ALL.len()];
        let mut place = 0;
        while place < names.len() {
            names[place] = Self::ALL[place].name();
            place += 1;
        }
        names
    };

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
