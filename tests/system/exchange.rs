//! Programs in other languages as processes of a run: the wire as they see it, good ones and bad ones.

use std::io::{BufRead, BufReader};

use crate::command::{Desk, Known, Running, children_of_run, lacks, programs_of, restarts, until};

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

/// A graph with one process more, or in the place of one; and a short motion with faults.
pub(crate) fn graph(desk: &Desk, process: &str, faults: &str) {
    desk.file(
        "graph.toml",
        format!("extends = \"armplane\"\n[[process]]\n{process}\n"),
    );
    let text = "name = \"short\"\nrobot = \"puma560\"\ngraph = \"graph.toml\"\nsettle_s = 0.1\n[start]\nq_deg = [20, -60, 170, 0, 30, 0]\n\
                [[segment]]\nby_m = [0.03, 0.0, -0.02]\nduration_s = 0.5\n";
    desk.file("short.toml", [text, faults].concat());
}

/// A graph whose estimator is this command; the program above is there.
fn estimator(desk: &Desk, command: &str, restart: &str, faults: &str) {
    desk.file("estimator.py", ESTIMATOR);
    let process = format!(
        "name = \"estimator\"\ncommand = {command}\nreads = [\"sensor\"]\nwrites = [\"estimate\"]\nrestart = \"{restart}\"\n"
    );
    graph(desk, &process, faults);
}

/// The program above as a command, with an exchange page, and how it goes wrong.
fn python(how: &str) -> String {
    format!("[\"python3\", \"estimator.py\", \"{how}\"]\nexchange = true\nanswer_limit_s = 1")
}

#[test]
fn a_process_in_python_is_as_deterministic_as_ours_faults_included() {
    if lacks("") {
        return;
    }
    let desk = Desk::new();
    let faults = "\n[[fault]]\nprocess = \"estimator\"\nkind = \"kill\"\nat_tick = 150\nfor_ticks = 2\n\
                  \n[[fault]]\nprocess = \"estimator\"\nkind = \"drop\"\nat_tick = 300\nfor_ticks = 40\nprobability = 0.2\n";
    estimator(&desk, &python(""), "always", faults);
    let [first, second] = [0, 1].map(|_| desk.run("short.toml"));
    assert_eq!(first["topics"], second["topics"], "the same bytes twice");
    first.holds(
        r#"{"outcome": "goal reached", "faults/#": 2, "faults/0/occurred": true, "faults/1/occurred": true}"#,
    );
    assert_eq!(restarts(&first, "estimator"), 1);
    // The requests to the program are on record: the controller behind it computes the same again.
    desk.succeeds("replay runs/short-001");
    desk.json("verify short.toml --runs 2 --set segment.0.duration_s=0.3")
        .holds(r#"{"identical": true}"#);
}

#[test]
fn bad_programs_are_named_in_the_log_and_among_the_faults() {
    if lacks("") {
        return;
    }
    let cases = [
        ("dies", 200, "code 7"),
        ("nan", 200, "`estimate`"),
        ("tick", 200, "tick 7 "),
        ("silent", 200, " 1 s"),
        ("count", 200, " 9999 "),
        ("code", 200, " 77 "),
        ("state", 200, "1073741824 bytes"),
        ("raises", 200, "ValueError"),
        ("garbage", 200, "4294967295"),
        ("cut", 200, ""),
        ("version", 0, "version 7"),
        ("layout", 0, "armplane.SensorSample.v2 (0000000000000123)"),
        ("absent", 0, "code 0"),
        ("refuses", 0, "RuntimeError"),
    ];
    for (how, tick, name) in cases {
        let desk = Desk::new();
        estimator(&desk, &python(how), "never", "");
        let said = desk.refuses(1, "run short.toml --no-record --json", name);
        let summary = said.json();
        summary.holds(
            r#"{"faults/#": 1, "faults/0/process": "estimator", "faults/0/origin": "detected"}"#,
        );
        let fault = &summary["faults"][0];
        let kind = if how == "cut" { "signal" } else { "exit" };
        assert_eq!(fault["kind"], kind, "{fault}");
        assert_eq!(fault["tick"], tick, "{how}: {fault}");
        let reason = summary["reason"].text();
        assert!(
            reason.contains(&format!("tick {tick}")) && reason.contains(name),
            "{how}: {reason}"
        );
    }
}

#[test]
fn a_program_that_ends_once_costs_no_byte_and_one_that_ends_again_at_the_same_tick_ends_the_run() {
    if lacks("") {
        return;
    }
    let desk = Desk::new();
    estimator(&desk, &python("dies"), "always", "");
    let said = desk.refuses(1, "run short.toml --no-record --json", "code 7");
    said.json().holds(
        r#"{"outcome": "failed", "faults/#": 2, "faults/0/tick": 200, "faults/1/tick": 200, "faults/0/kind": "exit"}"#,
    );
    estimator(&desk, &python(""), "always", "");
    let whole = desk.run("short.toml --no-record");
    let once = "[\"sh\", \"-c\", \"test -e once && exec python3 estimator.py; touch once; exec python3 estimator.py dies\"]\nexchange = true";
    estimator(&desk, once, "always", "");
    let healed = desk.run("short.toml --no-record");
    assert_eq!(healed["topics"], whole["topics"]);
    assert_eq!(restarts(&healed, "estimator"), 1);
}

/// A program that is killed before it has taken part, once: by a signal, and in a shell that gives the signal as its exit code. Of its own, or ours.
#[test]
fn a_program_that_is_killed_before_it_joins_is_replaced() {
    let own = format!("{} estimator", env!("CARGO_BIN_EXE_armplane"));
    let foreign = "python3 estimator.py";
    for (then, how, kind) in [
        (foreign, "kill -KILL $$", "kill"),
        (foreign, "sh -c 'kill -KILL $$'; exit $?", "kill"),
        (foreign, "kill -TERM $$", "signal"),
        (&own, "kill -KILL $$", "kill"),
        (&own, "sh -c 'kill -KILL $$'; exit $?", "kill"),
    ] {
        let is_foreign = then == foreign;
        if is_foreign && lacks("") {
            continue;
        }
        let desk = Desk::new();
        let exchange = if is_foreign { "exchange = true" } else { "" };
        let command = format!(
            "[\"sh\", \"-c\", \"test -e once && exec {then}; touch once; {how}\"]\n{exchange}"
        );
        estimator(&desk, &command, "always", "");
        let first = desk.run("short.toml");
        assert_eq!(restarts(&first, "estimator"), 1, "{how}");
        first.holds(
            r#"{"outcome": "goal reached", "faults/0/tick": 0, "faults/0/process": "estimator"}"#,
        );
        if is_foreign {
            assert_eq!(first["faults"][0]["kind"], kind, "{how}");
        }
        // A kill from outside is none of the plan's.
        let again = desk.run("runs/short-001/scenario.toml");
        assert_eq!(again["topics"], first["topics"], "{how}");
        assert_eq!(restarts(&again, "estimator"), 0, "{how}");
    }
}

/// A process whose program starts others: one in its process group, one in a session of its own.
#[test]
fn the_descendants_of_a_program_end_with_the_run_or_a_killed_launcher() {
    let desk = Desk::new();
    let with_descendants = |then: &str| {
        let command = format!("sleep 600 & setsid sleep 601 & sleep 0.3; {then}");
        let process = format!(
            "name = \"watch\"\nexchange = true\nreads = [\"estimate\"]\ncommand = [\"sh\", \"-c\", \"{command}\"]\n"
        );
        graph(&desk, &process, "");
    };
    with_descendants("exit 3");
    desk.refuses(1, "run short.toml --no-record", "watch 3");
    with_descendants("sleep 602");
    let run = desk.start("run short.toml --no-record");
    let id = run.id();
    until("the program to start others", || programs_of(id).len() >= 4);
    run.signal("KILL");
    run.finish();
    until("the program and its descendants to go", || {
        programs_of(id).is_empty() && children_of_run(id).is_empty()
    });
    desk.succeeds("clean");
    crate::command::assert_nothing_left(id);
}

#[test]
fn a_full_volume_is_refused_where_it_would_have_no_effect() {
    let desk = Desk::new();
    let process =
        "name = \"watch\"\nexchange = true\nreads = [\"estimate\"]\ncommand = [\"true\"]\n";
    let fault = "\n[[fault]]\nprocess = \"watch\"\nkind = \"disk-full\"\nat_tick = 10\n";
    graph(&desk, process, fault);
    desk.refuses(2, "run short.toml", "`disk-full` watch");
}

#[test]
fn an_external_program_is_awaited() {
    if lacks("") {
        return;
    }
    let desk = Desk::new();
    let program = desk.file("estimator.py", ESTIMATOR);
    graph(
        &desk,
        "name = \"estimator\"\nexternal = true\nreads = [\"sensor\"]\nwrites = [\"estimate\"]\n",
        "",
    );
    let mut run = desk.start("run short.toml --no-record --json");
    let said = BufReader::new(run.stderr.take().expect("piped"));
    let page = said.lines().map_while(Result::ok).find_map(|line| {
        let (_, rest) = line.split_once("ARMPLANE_EXCHANGE=")?;
        Some(rest.strip_suffix(" COMMAND")?.to_owned())
    });
    let mut python = desk.program("python3");
    python.arg(program).env(
        "ARMPLANE_EXCHANGE",
        page.expect("the run says what to start"),
    );
    assert!(python.status().expect("python3 runs").success());
    run.finish().json().holds(r#"{"outcome": "goal reached"}"#);
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
    graph(
        &desk,
        "name = \"watch\"\ncommand = [\"python3\", \"watch.py\"]\nexchange = true\nreads = [\"plant_state\", \"torque\"]\n",
        "",
    );
    let said = desk.succeeds("run short.toml --no-record --json");
    let saw = format!("saw {} ticks", said.json()["ticks"]);
    assert!(said.err.contains(&saw), "{saw}: {}", said.err);
}
