//! The checks of a graph before anything starts.

use super::built_in::{BUILT_IN, EVERYTHING, STEERED};
use super::topology::Graph;
use crate::file::Complaint;
use crate::process::{MAX_PROCESSES, Process, Program, Role};
use crate::topics::{MAX_TOPICS, TOPICS};
use crate::wire::MAX_HOPS;

/// Readers that a topic has room for.
const MOST_READERS: usize = 8;

/// Longest name of a process or a topic: it is part of the names of files.
const LONGEST_NAME: usize = 32;

impl Graph {
    /// # Errors
    /// [`Complaint`], its path relative to the graph.
    pub(crate) fn check(&self) -> Result<(), Complaint> {
        if self.process.is_empty() {
            let remedy =
                "extends = \"armplane\" takes those of the built-in graph; [[process]] adds others";
            return Err(Complaint::new(
                "process",
                "the graph has no processes",
                remedy,
            ));
        }
        if self.process.len() > MAX_PROCESSES {
            let message = format!("the graph has {} processes", self.process.len());
            return Err(Complaint::new(
                format!("process.{MAX_PROCESSES}"),
                message,
                format!("{MAX_PROCESSES} at most"),
            ));
        }
        self.check_topics()?;
        for (i, process) in self.process.iter().enumerate() {
            let at = |key: &str| format!("process.{i}.{key}");
            if RESERVED.contains(&process.name.as_str()) {
                let message = format!("`{}` names a part of armplane in every run", process.name);
                return Err(Complaint::new(at("name"), message, "choose another name"));
            }
            if !is_name(&process.name) {
                return Err(Complaint::new(
                    at("name"),
                    format!("`{}` cannot be the name of a process", process.name),
                    NAMES,
                ));
            }
            if self.process[..i]
                .iter()
                .any(|earlier| earlier.name == process.name)
            {
                return Err(Complaint::new(
                    at("name"),
                    format!("`{}` is listed twice", process.name),
                    "one process of each name",
                ));
            }
            if !(0..=99).contains(&process.priority) {
                return Err(Complaint::new(
                    at("priority"),
                    "the priority is out of range",
                    "1 to 99, or 0 for ordinary scheduling",
                ));
            }
            for (key, topics) in [
                ("reads", &process.reads),
                ("feedback", &process.feedback),
                ("writes", &process.writes),
            ] {
                for (j, topic) in topics.iter().enumerate() {
                    self.check_use(i, key, topic)
                        .map_err(|complaint| Complaint {
                            path: at(&format!("{key}.{j}")),
                            ..complaint
                        })?;
                }
            }
            check_program(process)
                .map_err(|complaint| complaint.within(&format!("process.{i}")))?;
        }
        self.check_once_only()?;
        self.check_loop()?;
        self.check_stamps()
    }

    /// A message has room for the time stamps of so many processes.
    fn check_stamps(&self) -> Result<(), Complaint> {
        let stamping: Vec<usize> = (0..self.process.len())
            .filter(|&i| self.process[i].role() != Role::Observer)
            .collect();
        let Some(ninth) = stamping.get(MAX_HOPS) else {
            return Ok(());
        };
        let message = format!(
            "{} processes write messages, and a message has room for the time stamps of {MAX_HOPS}",
            stamping.len()
        );
        let remedy = format!(
            "let one process do the work of several, or let `{}` only read",
            self.process[*ninth].name
        );
        Err(Complaint::new(
            format!("process.{ninth}.writes"),
            message,
            remedy,
        ))
    }

    /// A second recorder would write the same files.
    fn check_once_only(&self) -> Result<(), Complaint> {
        let recorders = || {
            (0..self.process.len())
                .filter(|&i| self.process[i].program() == Some(Program::Recorder))
        };
        let (Some(first), Some(second)) = (recorders().next(), recorders().nth(1)) else {
            return Ok(());
        };
        let message = format!(
            "`{}` records the run as `{}` does, into the same files",
            self.process[second].name, self.process[first].name
        );
        Err(Complaint::new(
            format!("process.{second}.name"),
            message,
            "one recorder in a run; a program of your own may read the topics too",
        ))
    }

    fn check_topics(&self) -> Result<(), Complaint> {
        if self.topic.len() + TOPICS.len() > MAX_TOPICS {
            let message = format!("the graph declares {} topics", self.topic.len());
            return Err(Complaint::new(
                "topic",
                message,
                format!("{} at most", MAX_TOPICS - TOPICS.len()),
            ));
        }
        for (i, topic) in self.topic.iter().enumerate() {
            let at = |key: &str| format!("topic.{i}.{key}");
            if !is_name(&topic.name) {
                return Err(Complaint::new(
                    at("name"),
                    format!("`{}` cannot be the name of a topic", topic.name),
                    NAMES,
                ));
            }
            if TOPICS.contains(&topic.name.as_str())
                || self.topic[..i]
                    .iter()
                    .any(|earlier| earlier.name == topic.name)
            {
                return Err(Complaint::new(
                    at("name"),
                    format!("there is a topic `{}` already", topic.name),
                    "another name",
                ));
            }
            let is_type = (3..=128).contains(&topic.type_name.len())
                && topic
                    .type_name
                    .chars()
                    .all(|c| c.is_ascii_alphanumeric() || "._".contains(c));
            if !is_type {
                let message = format!("`{}` cannot be the name of a type", topic.type_name);
                return Err(Complaint::new(
                    at("type"),
                    message,
                    "3 to 128 letters, digits, `.` and `_`, as in armplane.Energy.v1",
                ));
            }
            let layout = topic
                .layout()
                .map_err(|complaint| complaint.within(&format!("topic.{i}")))?;
            let of_that_type = TOPICS
                .into_iter()
                .filter_map(|name| self.layout(name))
                .find(|known| known.type_name == layout.type_name);
            if of_that_type.is_some_and(|known| known.hash != layout.hash) {
                let message = format!(
                    "`{}` is a type of armplane with other fields",
                    topic.type_name
                );
                return Err(Complaint::new(
                    at("type"),
                    message,
                    "another name, or the fields that `armplane generate wire` prints",
                ));
            }
            if self.writer(&topic.name).is_none() {
                let message = format!("no process writes `{}`", topic.name);
                return Err(Complaint::new(
                    at("name"),
                    message,
                    "add it to one process's `writes`",
                ));
            }
        }
        Ok(())
    }

    /// A topic at a place of process `i`; the path is the caller's.
    fn check_use(&self, i: usize, key: &str, topic: &str) -> Result<(), Complaint> {
        let refuse = |message: String, remedy: String| Err(Complaint::new("", message, remedy));
        let is_declared = self.topic.iter().any(|declared| declared.name == topic);
        if topic == EVERYTHING {
            return refuse(
                format!("`{EVERYTHING}` stands in `{key}`"),
                "it stands in `reads` only".to_owned(),
            );
        }
        if !TOPICS.contains(&topic) && !is_declared {
            let known: Vec<_> = TOPICS
                .into_iter()
                .chain(self.topic.iter().map(|declared| declared.name.as_str()))
                .collect();
            return refuse(
                format!("there is no topic `{topic}`"),
                format!(
                    "known: {}; declare others under [[topic]]",
                    known.join(", ")
                ),
            );
        }
        if key == "writes"
            && let Some(other) = self.process[..i]
                .iter()
                .find(|other| other.writes.iter().any(|one| one == topic))
        {
            return refuse(
                format!("`{topic}` is already written by `{}`", other.name),
                "a topic has one writer".to_owned(),
            );
        }
        if key != "writes" && self.writer(topic).is_none() {
            return refuse(
                format!("no process writes `{topic}`"),
                "add it to one process's `writes`".to_owned(),
            );
        }
        if key != "writes" && self.readers(topic).count() > MOST_READERS {
            return refuse(
                format!("`{topic}` has {} readers", self.readers(topic).count()),
                format!("{MOST_READERS} at most"),
            );
        }
        Ok(())
    }

    fn check_loop(&self) -> Result<(), Complaint> {
        let mut worlds = (0..self.process.len()).filter(|&i| self.process[i].role() == Role::World);
        if worlds.next().is_none() {
            let remedy = "give the process that moves the arm feedback = [\"torque\"]";
            return Err(Complaint::new(
                "process",
                "no process has `feedback`: nothing makes the ticks",
                remedy,
            ));
        }
        if let Some(second) = worlds.next() {
            let message = format!(
                "`{}` is the second process with `feedback`",
                self.process[second].name
            );
            return Err(Complaint::new(
                format!("process.{second}.feedback"),
                message,
                "one process makes the ticks",
            ));
        }
        let (_, mut waiting) = self.in_order();
        // Those for which none of the others waits only stand behind the loop.
        let leads_on = |waiting: &[&Process], process: &Process| {
            waiting.iter().any(|other| {
                process
                    .writes
                    .iter()
                    .any(|topic| other.reads.contains(topic))
            })
        };
        while let Some(behind) = waiting
            .iter()
            .position(|process| !leads_on(&waiting, process))
        {
            waiting.remove(behind);
        }
        let Some(first) = waiting.first() else {
            return Ok(());
        };
        let i = self
            .process
            .iter()
            .position(|process| process.name == first.name)
            .unwrap_or(0);
        Err(Complaint::new(
            format!("process.{i}.reads"),
            format!(
                "`{}` waits for itself: its inputs depend on its own output of the same tick",
                first.name
            ),
            "move the topic that closes the loop to `feedback`",
        ))
    }
}

/// Names in logs and fault tables that are no process of the graph.
const RESERVED: [&str; 1] = ["launcher"];

const NAMES: &str = "up to 32 lower-case letters, digits, `-` and `_`, a letter first";

fn is_name(name: &str) -> bool {
    let is_part = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-_".contains(c);
    name.len() <= LONGEST_NAME
        && name.starts_with(|c: char| c.is_ascii_lowercase())
        && name.chars().all(is_part)
}

/// Whether there is a program for a process, and whether it has the topics it needs; the path is relative to the process.
fn check_program(process: &Process) -> Result<(), Complaint> {
    let name = &process.name;
    if process.exchange && process.command.is_empty() && !process.external {
        let message = format!("`{name}` exchanges messages with a program that is not named");
        return Err(Complaint::new(
            "exchange",
            message,
            "give its `command`, or external = true for a program that is started separately",
        ));
    }
    if process.external && !process.command.is_empty() {
        let message = format!("`{name}` is started separately and has a command");
        return Err(Complaint::new(
            "external",
            message,
            "take out `command`, or `external`",
        ));
    }
    if process.is_exchanged()
        && let Some(foreign) = process
            .writes
            .iter()
            .find(|topic| !TOPICS.contains(&topic.as_str()))
    {
        let message = format!(
            "`{name}` writes `{foreign}`, which only this graph knows, by an exchange page"
        );
        return Err(Complaint::new(
            "writes",
            message,
            format!("an exchange page carries {}", TOPICS.join(", ")),
        ));
    }
    if process.is_exchanged()
        && let Some(foreign) = process
            .reads
            .iter()
            .chain(&process.feedback)
            .find(|topic| !TOPICS.contains(&topic.as_str()))
    {
        let message =
            format!("`{name}` reads `{foreign}`, which only this graph knows, by an exchange page");
        return Err(Complaint::new(
            "reads",
            message,
            format!("an exchange page carries {}", TOPICS.join(", ")),
        ));
    }
    if process.answer_limit_s > 0 && !process.is_exchanged() {
        let message = format!("`{name}` has an `answer_limit_s` and no exchange page");
        return Err(Complaint::new("answer_limit_s", message, "exchange = true"));
    }
    if !process.robot.is_empty() {
        return check_robot(process);
    }
    if !process.command.is_empty() || process.external {
        if !process.program.is_empty() {
            let message = format!("`{name}` names a program of armplane and is another program");
            return Err(Complaint::new(
                "program",
                message,
                "take out `program`, or `command` and `external`",
            ));
        }
        if let Some(i) = process.command.iter().position(|part| part.contains('\0')) {
            let message = format!("the command of `{name}` holds a zero byte");
            return Err(Complaint::new(
                format!("command.{i}"),
                message,
                "take it out: no program can be given one",
            ));
        }
        if process
            .command
            .first()
            .is_some_and(|program| program.trim().is_empty())
        {
            return Err(Complaint::new(
                "command",
                format!("the command of `{name}` has no program"),
                "command = [\"program\", \"argument\"]",
            ));
        }
        if process.role() == Role::Stage && process.reads.is_empty() {
            return Err(Complaint::new(
                "name",
                format!("`{name}` reads nothing, so it has no ticks"),
                "add a topic to its `reads`",
            ));
        }
        return match process.role() == Role::Observer && process.reads.is_empty() {
            true => Err(Complaint::new(
                "name",
                format!("`{name}` neither reads nor writes"),
                "add a topic to its `reads`",
            )),
            false => Ok(()),
        };
    }
    let Some(program) = process.program() else {
        let known = Program::ALL.map(Program::name).join(", ");
        let remedy = format!("armplane itself runs {known}; give any other process a `command`");
        let (key, message) = match process.program.as_str() {
            "" => ("name", format!("there is no process `{name}`")),
            program => ("program", format!("armplane has no program `{program}`")),
        };
        return Err(Complaint::new(key, message, remedy));
    };
    if let Some(foreign) = process
        .writes
        .iter()
        .find(|topic| !TOPICS.contains(&topic.as_str()))
    {
        let message = format!("armplane's {} does not write `{foreign}`", program.name());
        return Err(Complaint::new(
            "writes",
            message,
            "take it out, or give the process that writes it a `command`",
        ));
    }
    let own = built_in(program);
    for (key, topics, needed) in [
        ("reads", &process.reads, &own.reads),
        ("feedback", &process.feedback, &own.feedback),
        ("writes", &process.writes, &own.writes),
    ] {
        if let Some(missing) = needed
            .iter()
            .find(|topic| !topics.iter().any(|name| name == *topic))
        {
            let all = needed
                .iter()
                .map(|topic| format!("{topic:?}"))
                .collect::<Vec<_>>()
                .join(", ");
            return Err(Complaint::new(
                "name",
                format!("`{name}` needs `{missing}` in its `{key}`"),
                format!("{key} = [{all}]"),
            ));
        }
    }
    Ok(())
}

/// The process of a built-in graph that runs a program of ours: the topics that it has there are those that the program needs.
fn built_in(program: Program) -> Process {
    let mut graphs = [BUILT_IN, STEERED]
        .into_iter()
        .filter_map(|text| crate::file::parse::<Graph>("graph.toml", text, &[]).ok());
    graphs
        .find_map(|mut graph| {
            graph.read_everything();
            graph
                .process
                .into_iter()
                .find(|process| process.name == program.name())
        })
        .unwrap_or_default()
}

/// Whether a process can stand for a robot: it has the topics of the simulated plant, and nothing else is to run as it.
fn check_robot(process: &Process) -> Result<(), Complaint> {
    let name = &process.name;
    if !process.command.is_empty() || !process.program.is_empty() || process.is_exchanged() {
        let message = format!("`{name}` is a robot and a program");
        return Err(Complaint::new(
            "robot",
            message,
            "take out `command`, `program`, `exchange` and `external`, or `robot`",
        ));
    }
    let plant = built_in(Program::Plant);
    for (key, topics, needed) in [
        ("reads", &process.reads, &plant.reads),
        ("feedback", &process.feedback, &plant.feedback),
        ("writes", &process.writes, &plant.writes),
    ] {
        if topics.len() != needed.len()
            || needed
                .iter()
                .any(|topic| !topics.iter().any(|name| name == topic))
        {
            let all = needed
                .iter()
                .map(|topic| format!("{topic:?}"))
                .collect::<Vec<_>>()
                .join(", ");
            return Err(Complaint::new(
                "robot",
                format!("`{name}` is a robot, with other `{key}` than a plant"),
                format!("{key} = [{all}]"),
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_wrong_graph_is_refused_with_its_line() {
        let cases: [(&str, &str, &str); 23] = [
            (
                "writes = [\"estimate\"]",
                "writes = [\"estimte\"]",
                "there is no topic `estimte`",
            ),
            (
                "writes = [\"estimate\"]",
                "writes = [\"estimate\", \"sensor\"]",
                "already written by `plant`",
            ),
            (
                "feedback = [\"torque\"]",
                "reads = [\"torque\"]",
                "needs `torque` in its `feedback`",
            ),
            (
                "name = \"analyzer\"",
                "name = \"analyser\"",
                "there is no process `analyser` (armplane itself runs plant,",
            ),
            (
                "name = \"analyzer\"",
                "name = \"../analyzer\"",
                "cannot be the name of a process",
            ),
            ("priority = 80", "priority = 180", "out of range"),
            (
                "reads = [\"sensor\"]",
                "reads = [\"sensor\", \"torque\"]",
                "waits for itself",
            ),
            (
                "reads = [\"sensor\"]",
                "reads = [\"sensor\"]\ncommand = [\"\"]",
                "has no program",
            ),
            (
                "reads = [\"sensor\"]",
                "feedback = [\"sensor\"]\ncommand = [\"mine\"]",
                "second process with `feedback`",
            ),
            (
                "reads = [\"sensor\"]",
                "command = [\"mine\"]",
                "`estimator` reads nothing",
            ),
            (
                "writes = [\"estimate\"]",
                "writes = [\"*\"]",
                "stands in `writes`",
            ),
            (
                "feedback = [\"torque\"]",
                "command = [\"mine\"]\nreads = [\"torque\"]",
                "nothing makes the ticks",
            ),
            (
                "reads = [\"sensor\"]",
                "exchange = true\nreads = [\"sensor\"]",
                "exchanges messages with a program that is not named",
            ),
            (
                "reads = [\"sensor\"]",
                "external = true\ncommand = [\"mine\"]\nreads = [\"sensor\"]",
                "started separately and has a command",
            ),
            (
                "reads = [\"sensor\"]",
                "answer_limit_s = 3\nreads = [\"sensor\"]",
                "and no exchange page",
            ),
            (
                "reads = [\"sensor\"]",
                "external = true",
                "`estimator` reads nothing",
            ),
            (
                "reads = [\"sensor\"]",
                "reads = [\"sensor\"]\nrobot = \"fci://a\"",
                "`estimator` is a robot, with other `reads`",
            ),
            (
                "name = \"plant\"",
                "name = \"plant\"\nrobot = \"fci://a\"\ncommand = [\"mine\"]",
                "is a robot and a program",
            ),
            (
                "name = \"estimator\"",
                "name = \"launcher\"",
                "names a part of armplane in every run (choose another name)",
            ),
            (
                "name = \"estimator\"",
                "name = \"observer\"\nprogram = \"estimater\"",
                "armplane has no program `estimater`",
            ),
            (
                "name = \"estimator\"",
                "name = \"estimator\"\nprogram = \"estimator\"\ncommand = [\"mine\"]",
                "and is another program",
            ),
            (
                "name = \"estimator\"",
                "name = \"estimator\"\ncommand = [\"mine\", \"2\\u0000\"]",
                "holds a zero byte",
            ),
            (
                "name = \"estimator\"",
                "name = \"second\"\nprogram = \"recorder\"\nreads = [\"*\"]\n[[process]]\nname = \"estimator\"",
                "records the run as",
            ),
        ];
        for (right, wrong, expected) in cases {
            assert!(BUILT_IN.contains(right), "{right}");
            let error =
                Graph::parse("graph.toml", &BUILT_IN.replacen(right, wrong, 1)).unwrap_err();
            assert!(error.to_string().contains(expected), "{error}");
            assert!(error.line().is_some(), "{error}");
        }
    }

    #[test]
    fn each_wrong_extension_is_refused_at_its_own_line() {
        let topic = "[[topic]]\nname = \"energy\"\ntype = \"armplane.Energy.v1\"\nfields = [\"header: Header\", \"kinetic_j: f64\"]\n";
        let process = "[[process]]\nname = \"energy\"\ncommand = [\"./energy\"]\nreads = [\"estimate\"]\nwrites = [\"energy\"]\n";
        let right = format!("extends = \"armplane\"\n{topic}{process}");
        assert!(Graph::parse("e.toml", &right).is_ok());
        let cases = [
            (
                "extends = \"armplane\"",
                "extends = \"armplan\"",
                "there is no graph `armplan`",
                1,
            ),
            (
                "command = [\"./energy\"]\n",
                "program = \"analyzer\"\n",
                "armplane's analyzer does not write `energy`",
                10,
            ),
            (
                "kinetic_j: f64",
                ": f64",
                "`` cannot be the name of a field",
                5,
            ),
            (
                "kinetic_j: f64",
                "kinetic\\nj: f64",
                "cannot be the name of a field",
                5,
            ),
            ("kinetic_j: f64", "kinetic_j: f32", "no type of a field", 5),
            (
                "name = \"energy\"\ntype",
                "name = \"torque\"\ntype",
                "there is a topic `torque` already",
                3,
            ),
            (
                "armplane.Energy.v1",
                "an energy",
                "cannot be the name of a type",
                4,
            ),
            (
                "writes = [\"energy\"]",
                "writes = [\"energy\", \"torque\"]",
                "already written by `controller`",
                10,
            ),
            (
                "writes = [\"energy\"]",
                "writes = [\"energy\"]\nexchange = true",
                "which only this graph knows, by an exchange page",
                10,
            ),
            (
                "writes = [\"energy\"]",
                "writes = [\"energie\"]",
                "no process writes `energy`",
                3,
            ),
            (
                "reads = [\"estimate\"]",
                "reads = [\"estimate\", \"energy\"]",
                "`energy` waits for itself",
                9,
            ),
            ("reads = [\"estimate\"]\n", "", "`energy` reads nothing", 7),
            (
                "name = \"energy\"\ncommand",
                "name = \"plant\"\ncommand",
                "no process writes `sensor`",
                1,
            ),
        ];
        for (old, new, expected, line) in cases {
            assert!(right.contains(old), "{old}");
            let error = Graph::parse("e.toml", &right.replacen(old, new, 1)).unwrap_err();
            assert!(error.to_string().contains(expected), "{error}");
            assert_eq!(error.line(), Some(line), "{error}");
        }
    }
}
