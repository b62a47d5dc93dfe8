//! Checks a graph before anything starts. The first broken rule is the complaint.

use super::built_in::{BUILT_IN, EVERYTHING, STEERED};
use super::topology::Graph;
use crate::file::{Complaint, each, nearest, require};
use crate::layout::DeclaredTopic;
use crate::process::{MAX_PROCESSES, Process, Program, Role};
use crate::topics::{MAX_TOPICS, TOPICS};
use crate::wire::MAX_HOPS;

/// Readers that a topic has room for.
const MOST_READERS: usize = 8;

/// Longest name of a process or a topic: it is part of the names of files.
const LONGEST_NAME: usize = 32;

/// Names in logs and fault tables that are no process of the graph.
const RESERVED: [&str; 1] = ["launcher"];

const NAMES: &str = "up to 32 lower-case letters, digits, `-` and `_`, a letter first";

impl Graph {
    /// # Errors
    /// [`Complaint`], its path relative to the graph.
    pub(crate) fn check(&self) -> Result<(), Complaint> {
        let count = self.process.len();
        require(
            count > 0,
            "process",
            "the graph has no processes",
            "extends = \"armplane\" takes those of the built-in graph; [[process]] adds others",
        )?;
        require(
            count <= MAX_PROCESSES,
            format!("process.{MAX_PROCESSES}"),
            format!("the graph has {count} processes"),
            format!("{MAX_PROCESSES} at most"),
        )?;
        let own = self.topic.len();
        let most = MAX_TOPICS - TOPICS.len();
        let message = format!("the graph declares {own} topics");
        require(own <= most, "topic", message, format!("{most} at most"))?;
        each("topic", &self.topic, |i, topic| self.check_topic(i, topic))?;
        // First: a name that is misspelt lacks elsewhere, too.
        each("process", &self.process, |_, one| self.check_topics(one))?;
        each("process", &self.process, |i, one| {
            self.check_process(i, one)
        })?;
        self.check_numbers()?;
        self.check_loop()
    }

    /// The path is relative to the topic.
    fn check_topic(&self, i: usize, topic: &DeclaredTopic) -> Result<(), Complaint> {
        let name = &topic.name;
        let type_name = &topic.type_name;
        let message = format!("`{name}` cannot be the name of a topic");
        require(is_name(name), "name", message, NAMES)?;
        let is_new = !is_listed(name) && self.topic[..i].iter().all(|one| one.name != *name);
        let message = format!("there is a topic `{name}` already");
        require(is_new, "name", message, "another name")?;
        let is_part = |c: char| c.is_ascii_alphanumeric() || "._".contains(c);
        require(
            (3..=128).contains(&type_name.len()) && type_name.chars().all(is_part),
            "type",
            format!("`{type_name}` cannot be the name of a type"),
            "3 to 128 letters, digits, `.` and `_`, as in armplane.Energy.v1",
        )?;
        let layout = topic.layout()?;
        let mut known = TOPICS.into_iter().filter_map(|name| self.layout(name));
        let of_that_type = known.find(|known| known.type_name == layout.type_name);
        require(
            of_that_type.is_none_or(|known| known.hash == layout.hash),
            "type",
            format!("`{type_name}` is a type of armplane with other fields"),
            "another name, or the fields that `armplane generate wire` prints",
        )?;
        require(
            self.writer(name).is_some(),
            "name",
            format!("no process writes `{name}`"),
            "add it to one process's `writes`",
        )
    }

    /// The path is relative to the process.
    fn check_process(&self, i: usize, process: &Process) -> Result<(), Complaint> {
        let name = process.name.as_str();
        let message = format!("`{name}` names a part of armplane in every run");
        require(
            !RESERVED.contains(&name),
            "name",
            message,
            "choose another name",
        )?;
        let message = format!("`{name}` cannot be the name of a process");
        require(is_name(name), "name", message, NAMES)?;
        let is_new = self.process[..i].iter().all(|earlier| earlier.name != name);
        let message = format!("`{name}` is listed twice");
        require(is_new, "name", message, "one process of each name")?;
        require(
            process.priority <= 99,
            "priority",
            "the priority is out of range",
            "1 to 99, or 0 for ordinary scheduling",
        )?;
        for (key, topics) in uses(process) {
            each(key, topics, |_, topic| self.check_use(i, key, topic))?;
        }
        check_kind(process)?;
        match process {
            _ if !process.robot.is_empty() => check_robot(process),
            _ if !process.command.is_empty() || process.external => check_command(process),
            _ => self.check_program(process),
        }
    }

    /// Whether the topics of a process exist; the path is relative to the process.
    fn check_topics(&self, process: &Process) -> Result<(), Complaint> {
        let declared = self.topic.iter().map(|declared| &*declared.name);
        let known: Vec<_> = TOPICS.into_iter().chain(declared).collect();
        let check = |topic: &String| {
            if topic == EVERYTHING || known.contains(&&**topic) {
                return Ok(());
            }
            let remedy = match nearest(topic, known.iter().copied()) {
                Some(near) => format!("did you mean `{near}`?"),
                None => format!(
                    "known: {}; declare others under [[topic]]",
                    known.join(", ")
                ),
            };
            let message = format!("there is no topic `{topic}`");
            Err(Complaint::new("", message, remedy))
        };
        let mut uses = uses(process).into_iter();
        uses.try_for_each(|(key, topics)| each(key, topics, |_, topic| check(topic)))
    }

    /// A topic at a place of process `i`; the path is the caller's.
    fn check_use(&self, i: usize, key: &str, topic: &str) -> Result<(), Complaint> {
        let is_everything = topic == EVERYTHING;
        let message = format!("`{EVERYTHING}` stands in `{key}`");
        require(!is_everything, "", message, "it stands in `reads` only")?;
        if key == "writes" {
            let writes = |other: &&Process| other.writes.iter().any(|one| one == topic);
            let Some(other) = self.process[..i].iter().find(writes) else {
                return Ok(());
            };
            let message = format!("`{topic}` is already written by `{}`", other.name);
            let remedy = format!(
                "a topic has one writer; name = \"{}\" replaces that one",
                other.name
            );
            return Err(Complaint::new("", message, remedy));
        }
        let message = format!("no process writes `{topic}`");
        let remedy = "add it to one process's `writes`";
        require(self.writer(topic).is_some(), "", message, remedy)?;
        let readers = self.readers(topic).count();
        require(
            readers <= MOST_READERS,
            "",
            format!("`{topic}` has {readers} readers"),
            format!("{MOST_READERS} at most"),
        )
    }

    /// One source, one recorder, and no more writers than a message has stamps for.
    fn check_numbers(&self) -> Result<(), Complaint> {
        let places = |is: &dyn Fn(&Process) -> bool| {
            let all = self
                .process
                .iter()
                .enumerate()
                .filter(|(_, process)| is(process));
            all.map(|(i, _)| i).collect::<Vec<_>>()
        };
        let name = |i: usize| &self.process[i].name;
        // A second recorder would write the same files.
        if let [first, second, ..] = places(&|one| one.program() == Some(Program::Recorder))[..] {
            let first = name(first);
            let second_name = name(second);
            return Err(Complaint::new(
                format!("process.{second}.name"),
                format!("`{second_name}` records the run as `{first}` does, into the same files"),
                "one recorder in a run; a program of your own may read the topics too",
            ));
        }
        let worlds = places(&|one| one.role() == Role::World);
        require(
            !worlds.is_empty(),
            "process",
            "no process has `feedback`: nothing makes the ticks",
            "give the process that moves the arm feedback = [\"torque\"]",
        )?;
        if let Some(&second) = worlds.get(1) {
            return Err(Complaint::new(
                format!("process.{second}.feedback"),
                format!("`{}` is the second process with `feedback`", name(second)),
                "one process makes the ticks",
            ));
        }
        let stamping = places(&|one| one.role() != Role::Observer);
        let Some(&ninth) = stamping.get(MAX_HOPS) else {
            return Ok(());
        };
        let count = stamping.len();
        Err(Complaint::new(
            format!("process.{ninth}.writes"),
            format!(
                "{count} processes write messages, and a message has room for the time stamps of {MAX_HOPS}"
            ),
            format!(
                "let one process do the work of several, or let `{}` only read",
                name(ninth)
            ),
        ))
    }

    /// A process that armplane contains: it has the topics that its program needs.
    fn check_program(&self, process: &Process) -> Result<(), Complaint> {
        let name = &process.name;
        let Some(program) = process.program() else {
            let known = Program::ALL.map(Program::name).join(", ");
            let remedy =
                format!("armplane itself runs {known}; give any other process a `command`");
            let (key, message) = match process.program.as_str() {
                "" => ("name", format!("there is no process `{name}`")),
                program => ("program", format!("armplane has no program `{program}`")),
            };
            return Err(Complaint::new(key, message, remedy));
        };
        if let Some(foreign) = process.writes.iter().find(|topic| !is_listed(topic)) {
            return Err(Complaint::new(
                "writes",
                format!("armplane's {} does not write `{foreign}`", program.name()),
                "take it out, or give the process that writes it a `command`",
            ));
        }
        let own = built_in(program);
        for ((key, topics), (_, needed)) in uses(process).into_iter().zip(uses(&own)) {
            if let Some(missing) = needed.iter().find(|topic| !topics.contains(topic)) {
                if key != "writes" && self.writer(missing).is_none() {
                    let message = format!("no process writes `{missing}`, which `{name}` reads");
                    let remedy = "add it to the `writes` of the process that is to send it";
                    return Err(Complaint::new("name", message, remedy));
                }
                let message = format!("`{name}` needs `{missing}` in its `{key}`");
                return Err(Complaint::new(
                    "name",
                    message,
                    format!("{key} = {needed:?}"),
                ));
            }
        }
        Ok(())
    }

    fn check_loop(&self) -> Result<(), Complaint> {
        let (_, mut waiting) = self.in_order();
        // Those for which none of the others waits only stand behind the loop.
        let leads_on = |waiting: &[&Process], process: &Process| {
            let reads = |topic: &String| waiting.iter().any(|other| other.reads.contains(topic));
            process.writes.iter().any(reads)
        };
        while let Some(behind) = waiting.iter().position(|one| !leads_on(&waiting, one)) {
            waiting.remove(behind);
        }
        let Some(name) = waiting.first().map(|first| &first.name) else {
            return Ok(());
        };
        let i = self
            .process
            .iter()
            .position(|process| process.name == *name);
        Err(Complaint::new(
            format!("process.{}.reads", i.unwrap_or(0)),
            format!(
                "`{name}` waits for itself: its inputs depend on its own output of the same tick"
            ),
            "move the topic that closes the loop to `feedback`",
        ))
    }
}

fn is_name(name: &str) -> bool {
    let is_part = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-_".contains(c);
    name.len() <= LONGEST_NAME
        && name.starts_with(|c: char| c.is_ascii_lowercase())
        && name.chars().all(is_part)
}

fn is_listed(topic: &str) -> bool {
    TOPICS.contains(&topic)
}

fn uses(process: &Process) -> [(&'static str, &Vec<String>); 3] {
    [
        ("reads", &process.reads),
        ("feedback", &process.feedback),
        ("writes", &process.writes),
    ]
}

/// Whether its keys belong to one kind of process; the path is relative to the process.
fn check_kind(process: &Process) -> Result<(), Complaint> {
    let name = &process.name;
    let has_command = !process.command.is_empty();
    require(
        !(process.external && has_command),
        "external",
        format!("`{name}` is started separately and has a command"),
        "take out `command`, or `external`",
    )?;
    let limits = [
        ("answer_limit_s", process.answer_limit_s),
        ("join_limit_s", process.join_limit_s),
    ];
    limits.into_iter().try_for_each(|(key, limit_s)| {
        require(
            limit_s == 0 || process.is_of_others(),
            key,
            format!("`{name}` has `{key}` and is a program of armplane"),
            "take it out, or give a `command`",
        )
    })
}

/// A process that is a program of others.
fn check_command(process: &Process) -> Result<(), Complaint> {
    let name = &process.name;
    require(
        process.program.is_empty(),
        "program",
        format!("`{name}` names a program of armplane and is another program"),
        "take out `program`, or `command` and `external`",
    )?;
    each("command", &process.command, |_, part| {
        let message = format!("the command of `{name}` holds a zero byte");
        let remedy = "take it out: no program can be given one";
        require(!part.contains('\0'), "", message, remedy)
    })?;
    require(
        process
            .command
            .first()
            .is_none_or(|program| !program.trim().is_empty()),
        "command",
        format!("the command of `{name}` has no program"),
        "command = [\"program\", \"argument\"]",
    )?;
    let message = match process.role() {
        Role::World => return Ok(()),
        Role::Stage => format!("`{name}` reads nothing, so it has no ticks"),
        Role::Observer => format!("`{name}` neither reads nor writes"),
    };
    require(
        !process.reads.is_empty(),
        "name",
        message,
        "add a topic to its `reads`",
    )
}

/// A robot: it has the topics of the simulated plant, and nothing else is to run as it.
fn check_robot(process: &Process) -> Result<(), Complaint> {
    let name = &process.name;
    let plant = built_in(Program::Plant);
    require(
        process.command.is_empty() && process.program.is_empty() && !process.external,
        "robot",
        format!("`{name}` is a robot and a program"),
        "take out `command`, `program` and `external`, or `robot`",
    )?;
    for ((key, topics), (_, needed)) in uses(process).into_iter().zip(uses(&plant)) {
        let is_same =
            topics.len() == needed.len() && needed.iter().all(|topic| topics.contains(topic));
        let message = format!("`{name}` is a robot, with other `{key}` than a plant");
        require(is_same, "robot", message, format!("{key} = {needed:?}"))?;
    }
    Ok(())
}

/// The process of a built-in graph that runs a program of ours: the topics that it has there are those that the program needs.
fn built_in(program: Program) -> Process {
    let mut graphs = [BUILT_IN, STEERED]
        .into_iter()
        .filter_map(|text| crate::file::parse::<Graph>("graph.toml", text, &[]).ok());
    let found = graphs.find_map(|mut graph| {
        graph.read_everything();
        let mut processes = graph.process.into_iter();
        processes.find(|process| process.name == program.name())
    });
    found.unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A text with one part of it replaced, and the line at which the graph is refused.
    type Case = (&'static str, &'static str, usize);

    fn refused(text: &str, cases: &[Case]) {
        assert!(Graph::parse("graph.toml", text).is_ok());
        for (right, wrong, line) in cases {
            assert!(text.contains(right), "{right}");
            let error = Graph::parse("graph.toml", &text.replacen(right, wrong, 1)).unwrap_err();
            assert_eq!(error.line(), Some(*line), "{error}");
        }
    }

    #[test]
    fn each_wrong_graph_is_refused_at_its_line() {
        const SENSOR: &str = "reads = [\"sensor\"]";
        const WRITES: &str = "writes = [\"estimate\"]";
        const TORQUE: &str = "feedback = [\"torque\"]";
        const NAME: &str = "name = \"estimator\"";
        let text: String = BUILT_IN
            .lines()
            .filter(|line| !line.starts_with('#'))
            .map(|line| format!("{line}\n"))
            .collect();
        refused(
            text.trim_start(),
            &[
                (WRITES, "writes = [\"estimte\"]", 11),
                (WRITES, "writes = ['estimate', 'sensor']", 11),
                (WRITES, "writes = [\"*\"]", 11),
                (TORQUE, "reads = [\"torque\"]", 2),
                ("name = \"analyzer\"", "name = \"analyser\"", 17),
                ("name = \"analyzer\"", "name = \"../analyzer\"", 17),
                ("priority = 80", "priority = 180", 6),
                (SENSOR, "reads = [\"sensor\", \"torque\"]", 10),
                (SENSOR, "reads = [\"sensor\"]\ncommand = [\"\"]", 11),
                (SENSOR, "feedback = [\"sensor\"]\ncommand = [\"mine\"]", 10),
                (SENSOR, "command = [\"mine\"]", 9),
                (
                    SENSOR,
                    "external = true\ncommand = ['mine']\nreads = ['sensor']",
                    10,
                ),
                (SENSOR, "answer_limit_s = 3\nreads = [\"sensor\"]", 10),
                (SENSOR, "join_limit_s = 3\nreads = [\"sensor\"]", 10),
                (SENSOR, "reads = [\"sensor\"]\nrobot = \"fci://a\"", 11),
                (
                    "name = \"plant\"",
                    "name = \"plant\"\nrobot = \"fci://a\"\ncommand = [\"mine\"]",
                    3,
                ),
                (TORQUE, "command = ['mine']\nreads = ['torque']", 1),
                (NAME, "name = \"launcher\"", 9),
                (NAME, "name = \"plant\"", 9),
                (NAME, "name = \"observer\"\nprogram = \"estimater\"", 10),
                (
                    NAME,
                    "name = \"estimator\"\nprogram = \"estimator\"\ncommand = [\"mine\"]",
                    10,
                ),
                (
                    NAME,
                    "name = 'estimator'\ncommand = ['mine', \"2\\u0000\"]",
                    10,
                ),
                (
                    NAME,
                    "name = \"second\"\nprogram = \"recorder\"\nreads = [\"*\"]\n[[process]]\nname = \"estimator\"",
                    37,
                ),
            ],
        );
    }

    #[test]
    fn each_wrong_extension_is_refused_at_its_own_line() {
        refused(
            "extends = \"armplane\"\n[[topic]]\nname = \"energy\"\ntype = \"armplane.Energy.v1\"\nfields = [\"header: Header\", \"kinetic_j: f64\"]\n\
             [[process]]\nname = \"energy\"\ncommand = [\"./energy\"]\nreads = [\"estimate\"]\nwrites = [\"energy\"]\n",
            &[
                ("extends = \"armplane\"", "extends = \"armplan\"", 1),
                ("command = [\"./energy\"]\n", "program = \"analyzer\"\n", 10),
                ("kinetic_j: f64", ": f64", 5),
                ("kinetic_j: f64", "kinetic\\nj: f64", 5),
                ("kinetic_j: f64", "kinetic_j: f32", 5),
                ("name = \"energy\"\ntype", "name = \"torque\"\ntype", 3),
                ("armplane.Energy.v1", "an energy", 4),
                ("armplane.Energy.v1", "armplane.TorqueCommand.v5", 4),
                (
                    "writes = [\"energy\"]",
                    "writes = [\"energy\", \"torque\"]",
                    10,
                ),
                ("writes = [\"energy\"]", "writes = [\"energie\"]", 3),
                (
                    "reads = [\"estimate\"]",
                    "reads = [\"estimate\", \"energy\"]",
                    9,
                ),
                ("reads = [\"estimate\"]\n", "", 7),
                ("name = \"energy\"\ncommand", "name = \"plant\"\ncommand", 1),
            ],
        );
    }
}
