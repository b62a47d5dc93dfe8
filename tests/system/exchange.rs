//! Programs in other languages as processes of a run: the wire as they see it, good ones and bad ones.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use serde_json::Value;

use crate::command::{
    Args, Desk, Known, Said, assert_nothing_left, finish, restarts, skipped, until,
};

/// The folder of the repository.
pub(crate) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Whether Python is there, with these modules.
pub(crate) fn has_python(modules: &str) -> bool {
    let code = if modules.is_empty() {
        String::new()
    } else {
        format!("import {modules}")
    };
    Command::new("python3")
        .args(["-c", &code])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

/// Reports that a test is skipped where Python is not there with these modules.
pub(crate) fn lacks(modules: &str) -> bool {
    let lacks = !has_python(modules);
    if lacks {
        skipped(format!("there is no python3 with [{modules}]"));
    }
    lacks
}

/// `armplane` with the Python package of the repository in the path of its programs.
pub(crate) fn armplane(desk: &Desk, args: impl Args) -> Command {
    let mut command = desk.command(args);
    command
        .env("PYTHONPATH", root().join("python"))
        .env("PYTHONDONTWRITEBYTECODE", "1");
    command
}

pub(crate) fn run(desk: &Desk, args: impl Args) -> Said {
    let said = finish(armplane(desk, args).spawn().expect("armplane starts"));
    assert_nothing_left(said.launcher);
    assert_eq!(
        programs_of(said.launcher),
        Vec::<i32>::new(),
        "a program outlives its run"
    );
    said
}

pub(crate) fn summary(said: &Said) -> Value {
    said.json()
}

/// Programs that have an exchange page of a launcher's run in their environment.
pub(crate) fn programs_of(launcher: u32) -> Vec<i32> {
    let marker = format!("-{launcher}-");
    let is_one = |pid: &i32| {
        let environment = std::fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
        environment
            .split(|byte| *byte == 0)
            .map(String::from_utf8_lossy)
            .any(|entry| entry.starts_with("ARMPLANE_EXCHANGE=") && entry.contains(&marker))
    };
    let pids = std::fs::read_dir("/proc")
        .expect("proc")
        .flatten()
        .filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    pids.filter(is_one).collect()
}

/// An estimator in Python, standard library only; the argument says how it goes wrong at tick 200 of its first incarnation.
const ESTIMATOR: &str = r#"
import os, struct, sys, time
import armplane
from armplane import wire

HOW = sys.argv[1] if len(sys.argv) > 1 else ""

class Estimator(armplane.Process):
    q = None

    def setup(self):
        if HOW == "version":
            self.exchange.head.program_version = 7
        if HOW == "layout":
            entry = wire.ExchangeTopic.from_buffer(self.exchange._map, self.exchange.head.topics_at)
            entry.program_type[:] = list(b"armplane.SensorSample.v2".ljust(wire.EXCHANGE_TYPE, b"\0"))
            entry.program_layout = 0x123
        if HOW == "absent":
            os._exit(0)
        if HOW == "refuses":
            raise RuntimeError("no licence")

    def tick(self, tick):
        sensor, estimate, n = self.topics["sensor"], self.topics["estimate"], self.dof
        if self.q is None:
            self.q, self.v = sensor.q_encoder[:n], [0.0] * n
        w, dt = 300.0, self.dt
        for i in range(n):
            e = sensor.q_encoder[i] - (self.q[i] + self.v[i] * dt)
            self.q[i] += self.v[i] * dt + 2 * w * dt * e
            self.v[i] += w * w * dt * e
        estimate.q[:n], estimate.qdot[:n] = self.q, self.v
        estimate.drive, estimate.stale_ticks = sensor.drive, sensor.stale_ticks
        if tick == 200 and self.incarnation == 1:
            self.go_wrong(estimate)

    def go_wrong(self, estimate):
        exchange = self.exchange
        if HOW == "dies":
            os._exit(7)
        if HOW == "nan":
            estimate.q[1] = float("nan")
        if HOW == "tick":
            exchange.head.tick = 7
        if HOW == "silent":
            time.sleep(60)
        if HOW == "count":
            exchange._seen = 9999
        if HOW == "code":
            exchange.answer(77)
            os._exit(0)
        if HOW == "state":
            exchange.head.state_bytes = 1 << 30
            self.save = lambda: None
        if HOW == "raises":
            raise ValueError("no idea")
        if HOW == "cut":
            os.truncate(exchange.path, 0)
        if HOW == "garbage":
            exchange._map[:] = b"\xff" * len(exchange._map)
            os._exit(0)

    def save(self):
        return struct.pack(f"{2 * self.dof}d", *self.q, *self.v)

    def restore(self, state):
        numbers = struct.unpack(f"{2 * self.dof}d", state)
        self.q, self.v = list(numbers[: self.dof]), list(numbers[self.dof :])

Estimator.run()
"#;

/// A short motion and a graph whose estimator is the program above.
fn estimator(desk: &Desk, how: &str, restart: &str, faults: &str) -> PathBuf {
    desk.file("estimator.py", ESTIMATOR);
    let process = format!(
        "extends = \"armplane\"\n[[process]]\nname = \"estimator\"\ncommand = [\"python3\", \"estimator.py\", \"{how}\"]\nexchange = true\n\
         answer_limit_s = 1\nreads = [\"sensor\"]\nwrites = [\"estimate\"]\nrestart = \"{restart}\"\n"
    );
    desk.file("graph.toml", &process);
    scenario(desk, faults)
}

pub(crate) fn scenario(desk: &Desk, faults: &str) -> PathBuf {
    let text = "name = \"short\"\nrobot = \"puma560\"\ngraph = \"graph.toml\"\nsettle_s = 0.1\n[start]\nq_deg = [20, -60, 170, 0, 30, 0]\n\
                [[segment]]\nby_m = [0.03, 0.0, -0.02]\nduration_s = 0.5\n";
    desk.file("short.toml", &format!("{text}{faults}"))
}

#[test]
fn a_process_in_python_is_as_deterministic_as_ours_faults_included() {
    if lacks("") {
        return;
    }
    let desk = Desk::new();
    let faults = "\n[[fault]]\nprocess = \"estimator\"\nkind = \"kill\"\nat_tick = 150\nfor_ticks = 2\n\
                  \n[[fault]]\nprocess = \"estimator\"\nkind = \"drop\"\nat_tick = 300\nfor_ticks = 40\nprobability = 0.2\n";
    estimator(&desk, "", "always", faults);
    let (first, second) = (
        run(&desk, "run short.toml --json"),
        run(&desk, "run short.toml --json"),
    );
    assert_eq!(first.code, 0, "{}", first.err);
    let (first, second) = (first.json(), second.json());
    assert_eq!(first["topics"], second["topics"], "the same bytes twice");
    assert_eq!(
        (restarts(&first, "estimator"), &first["outcome"]),
        (1, &Value::from("goal reached")),
        "{}",
        first["faults"]
    );
    assert!(
        first["faults"]
            .list()
            .iter()
            .all(|fault| fault["occurred"] == true),
        "{}",
        first["faults"]
    );
    // The requests to the program are on record: the controller behind it computes the same again.
    let replayed = run(&desk, "replay runs/short-001");
    assert_eq!(replayed.code, 0, "{}{}", replayed.out, replayed.err);
    let verified = run(
        &desk,
        "verify short.toml --runs 2 --set segment.0.duration_s=0.3 --json",
    );
    assert_eq!(
        (verified.code, &verified.json()["identical"]),
        (0, &Value::from(true)),
        "{}",
        verified.err
    );
}

#[test]
fn bad_programs_are_named_in_the_log_and_among_the_faults() {
    if lacks("") {
        return;
    }
    let cases = [
        ("dies", "ended with exit code 7 at tick 200"),
        (
            "nan",
            "wrote a number that is not finite into q of `estimate` at tick 200",
        ),
        ("tick", "answered tick 7 where tick 200 was asked"),
        ("silent", "has not answered tick 200 within 1 s"),
        ("count", "wrote the count of answers 9999 at tick 200"),
        ("code", "gave the answer 77 at tick 200"),
        (
            "state",
            "says of its checkpoint of tick 200 that it has 1073741824 bytes; there is room for 4096",
        ),
        ("raises", "cannot go on at tick 200: ValueError: no idea"),
        (
            "garbage",
            "wrote the count of answers 4294967295 at tick 200",
        ),
        ("cut", "has cut its exchange page short"),
        (
            "version",
            "speaks version 7 of the exchange page, armplane speaks version 1",
        ),
        (
            "layout",
            "uses armplane.SensorSample.v2 (0000000000000123) for `sensor`, armplane uses armplane.SensorSample.v",
        ),
        ("absent", "ended with exit code 0 before it joined"),
        (
            "refuses",
            "refuses the exchange page: RuntimeError: no licence",
        ),
    ];
    for (how, expected) in cases {
        let desk = Desk::new();
        estimator(&desk, how, "never", "");
        let said = run(&desk, "run short.toml --no-record --json");
        assert_eq!(said.code, 1, "{how}: {}", said.err);
        assert!(
            said.err
                .contains(&format!("the program of estimator {expected}")),
            "{how}: {}",
            said.err
        );
        let summary = said.json();
        let faults = &summary["faults"];
        assert_eq!(
            (&faults[0]["plan"]["process"], &faults[0]["origin"]),
            (&"estimator".into(), &"detected".into()),
            "{how}: {faults}"
        );
        assert_eq!(
            (faults.list().len(), &faults[0]["kind"]),
            (
                1,
                &Value::from(if how == "cut" { "signal" } else { "exit" })
            ),
            "{faults}"
        );
        let (tick, reason) = (&faults[0]["tick"], summary["reason"].text());
        assert!(
            reason.contains(&format!(" at tick {tick}"))
                && reason.contains(": the program of estimator"),
            "{how}: {reason}: {faults}"
        );
    }
}

#[test]
fn the_graph_decides_whether_a_bad_program_is_started_again() {
    if lacks("") {
        return;
    }
    let desk = Desk::new();
    estimator(&desk, "dies", "always", "");
    let said = run(&desk, "run short.toml --json");
    let first = said.json();
    // A tenth of a second without torque in the middle of the motion leaves its mark on the path; the run goes to its end.
    assert_eq!(
        (restarts(&first, "estimator"), &first["completed"]),
        (1, &Value::from(true)),
        "{}",
        said.err
    );
    let faults = first["faults"].list();
    assert_eq!(
        (faults.len(), &faults[0]["plan"]["at_tick"]),
        (1, &Value::from(200)),
        "{faults:?}"
    );
    assert!(faults[0]["recovered_ms"].is_number(), "{faults:?}");
    let detail = faults[0]["detail"].text();
    let expected = "estimator ended with exit code 1 at tick 200; its replacement answers from tick 300 on; its last line: the program of estimator ended with exit code 7";
    assert!(
        faults[0]["kind"] == "exit" && detail.starts_with(expected),
        "{faults:?}"
    );
    // The run leaves the scenario in which that death is planned; the program lives, and the shell dies instead: the same bytes.
    estimator(&desk, "", "always", "");
    let again = run(
        &desk,
        "run runs/short-001/scenario.toml --graph graph.toml --json",
    )
    .json();
    assert_eq!(again["topics"], first["topics"]);
}

/// A program that is killed before it has taken part, once; `how` it ends then, in the words of a shell.
fn killed_first(how: &str, then: &str) -> String {
    format!("[\"sh\", \"-c\", \"test -e once && exec {then}; touch once; {how}\"]")
}

#[test]
fn a_program_that_is_killed_before_it_joins_is_replaced() {
    if lacks("") {
        return;
    }
    // By a signal; and in a shell that gives the signal as its exit code.
    for how in [
        "kill -KILL $$",
        "sh -c 'kill -KILL $$'; exit $?",
        "kill -TERM $$",
    ] {
        let desk = Desk::new();
        estimator(&desk, "", "always", "");
        let graph = std::fs::read_to_string(desk.path().join("graph.toml")).expect("the graph");
        let ours = "[\"python3\", \"estimator.py\", \"\"]";
        assert!(graph.contains(ours), "{graph}");
        desk.file(
            "graph.toml",
            &graph.replace(ours, &killed_first(how, "python3 estimator.py")),
        );
        let said = run(&desk, "run short.toml --json");
        let first = said.json();
        assert_eq!(
            (restarts(&first, "estimator"), &first["outcome"]),
            (1, &Value::from("goal reached")),
            "{how}: {}",
            said.err
        );
        let fault = &first["faults"][0];
        let kind = if how.contains("TERM") {
            "signal"
        } else {
            "kill"
        };
        assert_eq!(
            (&fault["kind"], &fault["tick"], &fault["process"]),
            (&kind.into(), &0.into(), &"estimator".into()),
            "{fault}"
        );
        assert!(
            fault["detail"]
                .as_str()
                .is_some_and(|detail| detail.contains("before it joined")),
            "{fault}"
        );
        // The file `once` is there: the plan kills it now.
        let again = run(&desk, "run runs/short-001/scenario.toml --json").json();
        assert_eq!(
            (&again["topics"], restarts(&again, "estimator")),
            (&first["topics"], 1),
            "{how}"
        );
        desk.file(
            "graph.toml",
            &std::fs::read_to_string(desk.path().join("graph.toml"))
                .unwrap()
                .replace("\"always\"", "\"never\""),
        );
        std::fs::remove_file(desk.path().join("once")).expect("the mark");
        let said = run(&desk, "run short.toml --json");
        assert!(
            said.code == 1 && said.err.contains("the program of estimator ended with"),
            "{how}: {}",
            said.err
        );
    }
}

#[test]
fn a_program_of_its_own_that_is_killed_before_it_joins_is_replaced() {
    for how in ["kill -KILL $$", "sh -c 'kill -KILL $$'; exit $?"] {
        let desk = Desk::new();
        let command = killed_first(
            how,
            &format!("{} estimator", env!("CARGO_BIN_EXE_armplane")),
        );
        let process = format!(
            "name = \"estimator\"\ncommand = {command}\nreads = [\"sensor\"]\nwrites = [\"estimate\"]\nrestart = \"always\"\n"
        );
        desk.file(
            "graph.toml",
            &format!("extends = \"armplane\"\n[[process]]\n{process}"),
        );
        scenario(&desk, "");
        let first = run(&desk, "run short.toml --json").json();
        assert_eq!(
            (restarts(&first, "estimator"), &first["outcome"]),
            (1, &Value::from("goal reached")),
            "{how}: {}",
            first["faults"]
        );
        let again = run(&desk, "run runs/short-001/scenario.toml --json").json();
        assert_eq!(again["topics"], first["topics"], "{how}");
    }
}

/// A process whose program starts others: one in its process group, one in a session of its own.
fn with_descendants(desk: &Desk, then: &str) {
    let command = format!("sleep 600 & setsid sleep 601 & sleep 0.3; {then}");
    let process = "[[process]]\nname = \"watch\"\nexchange = true\nreads = [\"estimate\"]\n";
    desk.file(
        "graph.toml",
        &format!("extends = \"armplane\"\n{process}command = [\"sh\", \"-c\", \"{command}\"]\n"),
    );
}

#[test]
fn the_descendants_of_a_program_end_with_the_run() {
    let desk = Desk::new();
    with_descendants(&desk, "exit 3");
    // `run` looks for programs that are left.
    let said = run(&desk, "run --graph graph.toml --no-record");
    assert!(
        said.code == 1
            && said
                .err
                .contains("the program of watch ended with exit code 3 before it joined"),
        "{}",
        said.err
    );
}

#[test]
fn the_descendants_of_a_program_end_with_a_killed_launcher() {
    let desk = Desk::new();
    with_descendants(&desk, "sleep 602");
    let launcher = armplane(&desk, "run --graph graph.toml --no-record")
        .spawn()
        .expect("armplane starts");
    let id = launcher.id();
    until("the program to start others", || programs_of(id).len() >= 4);
    crate::life::signal(id as i32, "KILL");
    finish(launcher);
    until("the program and its descendants to go", || {
        programs_of(id).is_empty()
    });
    until("the processes to go", || {
        crate::command::children_of_run(id).is_empty()
    });
    desk.succeeds("clean");
    assert_nothing_left(id);
}

#[test]
fn a_full_volume_is_refused_where_it_would_have_no_effect() {
    let desk = Desk::new();
    let process = "[[process]]\nname = \"watch\"\nexchange = true\nreads = [\"estimate\"]\ncommand = [\"true\"]\n";
    desk.file("graph.toml", &format!("extends = \"armplane\"\n{process}"));
    scenario(
        &desk,
        "\n[[fault]]\nprocess = \"watch\"\nkind = \"disk-full\"\nat_tick = 10\n",
    );
    let said = run(&desk, "run short.toml");
    assert!(
        said.code == 2
            && said.err.contains(
                "`disk-full` cannot happen to watch: its program writes its files itself"
            ),
        "{}",
        said.err
    );
}

#[test]
fn an_external_program_is_awaited() {
    if lacks("") {
        return;
    }
    let desk = Desk::new();
    let program = desk.file("estimator.py", ESTIMATOR);
    let graph = "extends = \"armplane\"\n[[process]]\nname = \"estimator\"\nexternal = true\nreads = [\"sensor\"]\nwrites = [\"estimate\"]\n";
    desk.file("graph.toml", graph);
    scenario(&desk, "");
    let mut launcher = armplane(&desk, "run short.toml --no-record --json")
        .spawn()
        .expect("armplane starts");
    let said = BufReader::new(launcher.stderr.take().expect("piped"));
    let page = said.lines().map_while(Result::ok).find_map(|line| {
        let (_, rest) = line.split_once("ARMPLANE_EXCHANGE=")?;
        Some(rest.strip_suffix(" COMMAND")?.to_owned())
    });
    let page = page.expect("the run says what to start");
    let started = Command::new("python3")
        .arg(program)
        .env("ARMPLANE_EXCHANGE", &page)
        .env("PYTHONPATH", root().join("python"))
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .status()
        .expect("python3 runs");
    let said = finish(launcher);
    assert!(
        started.success() && said.code == 0,
        "{started}: {}",
        said.out
    );
    assert_eq!(said.json()["outcome"], "goal reached");
    assert_nothing_left(said.launcher);
}

#[test]
fn an_observer_in_python_sees_every_tick() {
    if lacks("") {
        return;
    }
    let desk = Desk::new();
    let watch = "import armplane\nclass W(armplane.Observer):\n    n = 0\n    def see(self, tick, plant_state=None, torque=None):\n        \
                 assert plant_state.header.tick == torque.header.tick == tick == self.n, (tick, self.n)\n        self.n += 1\n    \
                 def end(self):\n        print(f'saw {self.n} ticks')\nW.run()\n";
    desk.file("watch.py", watch);
    let graph = "extends = \"armplane\"\n[[process]]\nname = \"watch\"\ncommand = [\"python3\", \"watch.py\"]\nexchange = true\n\
                 reads = [\"plant_state\", \"torque\"]\n";
    desk.file("graph.toml", graph);
    scenario(&desk, "");
    let said = run(&desk, "run short.toml --no-record --json");
    assert_eq!(said.code, 0, "{}", said.err);
    let ticks = said.json()["ticks"].count();
    assert!(
        said.err.contains(&format!("saw {ticks} ticks")),
        "{ticks}: {}",
        said.err
    );
}
