//! Programs in other languages as processes of a run: the wire as they see it, good ones and bad ones.

use std::io::{BufRead, BufReader};

use crate::command::{
    Desk, Known, Running, Said, children_of_run, is_sent, lacks, programs_of, restarts, skipped,
    source, until,
};
use crate::foreign::link;
use crate::wire::wire;

/// An estimator in Python, standard library only; the argument says how it goes wrong at tick 200 of its first incarnation.
const ESTIMATOR: &str = r#"
import os, struct, sys, time
import armplane

HOW = sys.argv[1] if len(sys.argv) > 1 else ""

class Estimator(armplane.Process):
    q = None

    def setup(self):
        if HOW == "layout":
            self.joined._call("output", b"estimate", 0x123)
        if HOW == "absent":
            os._exit(0)
        if HOW == "refuses":
            raise RuntimeError("no licence")
        if HOW == "hides":
            self.end = 2.5

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
        if HOW == "dies":
            os._exit(7)
        if HOW == "nan":
            estimate.q[1] = float("nan")
        if HOW == "twice":
            self.joined.send()
        if HOW == "waits":
            self.joined.wait()
        if HOW == "silent":
            time.sleep(60)
        if HOW == "raises":
            raise ValueError("no idea")
        if HOW == "exits":
            sys.exit(0)
        if HOW == "forks":
            if os.fork() == 0:
                self.joined.wait()
            os.wait()

    def state(self):
        return struct.pack(f"{2 * self.dof}d", *self.q, *self.v)

    def restore(self, state):
        numbers = struct.unpack(f"{2 * self.dof}d", state)
        self.q, self.v = list(numbers[: self.dof]), list(numbers[self.dof :])

    def end(self):
        if HOW == "raises late":
            raise ValueError("too late")

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

/// The program above as a command, and how it goes wrong.
fn python(how: &str) -> String {
    format!("[\"python3\", \"estimator.py\", \"{how}\"]\nanswer_limit_s = 1")
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
        ("twice", 201, "answers a tick"),
        ("waits", 200, "has not answered tick 200"),
        ("silent", 200, " 1 s"),
        ("raises", 200, "ValueError"),
        ("exits", 200, "SystemExit"),
        ("layout", 0, "0000000000000123"),
        ("absent", 0, "code 0"),
        ("refuses", 0, "RuntimeError"),
        ("hides", 0, "armplane.Process.end"),
    ];
    for (how, tick, name) in cases {
        let desk = Desk::new();
        estimator(&desk, &python(how), "never", "");
        let said = desk.refuses(1, "run short.toml --no-record --json", name);
        let summary = said.json();
        // One that ends without a word has not failed, and has not taken part.
        if how != "absent" {
            let fault = &summary["faults"][0];
            fault.holds(r#"{"process": "estimator", "origin": "detected", "kind": "exit"}"#);
            assert_eq!(fault["tick"], tick, "{how}: {fault}");
        }
        let reason = summary["reason"].text();
        assert!(
            reason.contains(&format!("tick {tick}")) && reason.contains(name),
            "{how}: {reason}"
        );
    }
}

/// A traceback is never a green verdict, however late it comes; what a forked child asks for is refused, and its parent goes on.
#[test]
fn a_program_that_fails_at_the_end_fails_the_run_and_a_forked_child_does_no_harm() {
    if lacks("") {
        return;
    }
    let desk = Desk::new();
    estimator(&desk, &python("raises late"), "never", "");
    desk.refuses(1, "run short.toml --no-record --json", "ValueError");
    estimator(&desk, &python("forks"), "never", "");
    let forked = desk.succeeds("run short.toml --no-record --json");
    assert!(forked.err.contains("forked"), "{}", forked.err);
    estimator(&desk, &python(""), "never", "");
    let whole = desk.run("short.toml --no-record");
    assert_eq!(forked.json()["topics"], whole["topics"]);
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
    let once = "[\"sh\", \"-c\", \"test -e once && exec python3 estimator.py; touch once; exec python3 estimator.py dies\"]";
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
        (foreign, "sh -c 'kill -KILL $$'; exit $?", "exit"),
        (foreign, "kill -TERM $$", "signal"),
        (&own, "kill -KILL $$", "kill"),
        (&own, "sh -c 'kill -KILL $$'; exit $?", "kill"),
    ] {
        let is_foreign = then == foreign;
        if is_foreign && lacks("") {
            continue;
        }
        let desk = Desk::new();
        let command =
            format!("[\"sh\", \"-c\", \"test -e once && exec {then}; touch once; {how}\"]");
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
            "name = \"watch\"\nreads = [\"estimate\"]\ncommand = [\"sh\", \"-c\", \"{command}\"]\n"
        );
        graph(&desk, &process, "");
    };
    with_descendants("exit 3");
    desk.refuses(1, "run short.toml --no-record", "watch 3");
    with_descendants("sleep 602");
    let run = desk.start("run short.toml --no-record");
    let id = run.id();
    until("the program to start others", || {
        programs_of(id, "watch").len() >= 4
    });
    run.signal("KILL");
    run.finish();
    until("the program and its descendants to go", || {
        programs_of(id, "watch").is_empty() && children_of_run(id).is_empty()
    });
    desk.succeeds("clean");
    crate::command::assert_nothing_left(id);
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
    let place = said.lines().map_while(Result::ok).find_map(|line| {
        let (_, rest) = line.split_once("ARMPLANE_RUN=")?;
        Some(rest.split_whitespace().next()?.to_owned())
    });
    let mut python = desk.program("python3");
    python
        .arg(program)
        .env("ARMPLANE_PROCESS", "estimator")
        .env("ARMPLANE_RUN", place.expect("the run says what to start"));
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
        "name = \"watch\"\ncommand = [\"python3\", \"watch.py\"]\nreads = [\"plant_state\", \"torque\"]\n",
        "",
    );
    let said = desk.succeeds("run short.toml --no-record --json");
    let saw = format!("saw {} ticks", said.json()["ticks"]);
    assert!(said.err.contains(&saw), "{saw}: {}", said.err);
}

#[test]
fn a_plant_that_exits_before_its_last_tick_has_died() {
    if lacks("") {
        return;
    }
    let desk = Desk::new();
    let plant = "import os, armplane\nclass P(armplane.Plant):\n    def step(self, torque):\n        pass\n    def sample(self, tick, sensor, truth):\n        \
                 if tick == 150:\n            os._exit(0)\n        sensor.q_encoder[:6] = truth.q[:6] = [0.35, -1.05, 2.97, 0.0, 0.52, 0.0]\nP.run()\n";
    desk.file("plant.py", plant);
    let process = "name = \"plant\"\ncommand = [\"python3\", \"plant.py\"]\nfeedback = [\"torque\"]\nwrites = [\"sensor\", \"plant_state\"]\n";
    graph(&desk, process, "");
    for mode in ["lockstep", "realtime"] {
        let run = format!("run short.toml --no-record --mode {mode}");
        desk.refuses(1, &run, "plant code 0 150");
    }
}

/// A run of the program above, killed once it has passed a cut, and started with this file as `estimator.py`.
fn killed_behind_a_cut(desk: &Desk, program: &str) -> Said {
    estimator(desk, &python(""), "always", "");
    desk.file("estimator.py", program);
    let run = desk.begin("run short.toml --set segment.0.duration_s=30 --json --out killed");
    until("the cut", || run.ticks() > 2200);
    let estimator = programs_of(run.id(), "estimator");
    assert!(is_sent(estimator[0], "KILL"));
    run.finish()
}

#[test]
fn a_program_goes_on_from_its_state_or_answers_its_past_again() {
    if lacks("") {
        return;
    }
    let without = ESTIMATOR
        .replace("def state", "def kept")
        .replace("def restore", "def resume");
    for program in [ESTIMATOR, &without] {
        let desk = Desk::new();
        let said = killed_behind_a_cut(&desk, program);
        let killed = said.json();
        killed.holds(r#"{"outcome": "goal reached", "faults/#": 1}"#);
        assert!(!said.err.contains("again from tick 0"), "{}", said.err);
        let whole = desk.run("short.toml --set segment.0.duration_s=30 --out whole");
        assert_eq!(killed["topics"], whole["topics"]);
        let on = desk.run("--from whole@3500 --out on");
        assert_eq!(on["topics"], whole["topics"]);
        assert!(!desk.has("killed/messages.past") && !desk.has("on/messages.past"));
    }
    let desk = Desk::new();
    let random = without.replace("e = sensor", "e = os.getpid() * 1e-12 + sensor");
    let said = killed_behind_a_cut(&desk, &random);
    assert_eq!(said.code, 1, "{}", said.err);
    assert!(said.err.contains("q of `estimate`"), "{}", said.err);
}

/// In real time a program that dies is replaced alone, and goes on from what its predecessor has given.
#[test]
fn a_program_that_dies_in_real_time_goes_on_from_its_state() {
    if lacks("") {
        return;
    }
    let desk = Desk::new();
    let told = ESTIMATOR.replace("= struct.unpack", "= self.went_on = struct.unpack").replace(
        "if HOW == \"raises late\"",
        "if self.incarnation > 1:\n            print(\"went on\", len(self.went_on))\n        if HOW == \"raises late\"",
    );
    estimator(&desk, &python("dies"), "always", "");
    desk.file("estimator.py", told);
    let said = desk.armplane("run short.toml --mode realtime --no-record --json");
    assert_eq!(restarts(&said.json(), "estimator"), 1, "{}", said.err);
    assert!(said.err.contains("went on 12"), "{}", said.err);
}

/// A handler that raises while the program waits, here for a process that does not come, ends the wait.
#[test]
fn a_signal_ends_a_wait() {
    if lacks("") {
        return;
    }
    let desk = Desk::new();
    let program = "import armplane, signal\ndef rings(*_):\n    raise RuntimeError('it rings')\nclass W(armplane.Observer):\n    def setup(self):\n        \
                   signal.signal(signal.SIGALRM, rings)\n        signal.setitimer(signal.ITIMER_REAL, 0.1)\nW.run()\n";
    desk.file("watch.py", program);
    let never =
        "[[process]]\nname = \"late\"\ncommand = [\"sleep\", \"600\"]\nreads = [\"estimate\"]\n";
    let watch = "name = \"watch\"\ncommand = [\"python3\", \"watch.py\"]\nreads = [\"estimate\"]\n";
    graph(&desk, &format!("{watch}{never}"), "");
    desk.refuses(1, "run short.toml --no-record", "it rings");
}

/// The blocks of docs/wire.md in a language.
fn blocks(language: &str) -> Vec<String> {
    let page = source("docs/wire.md");
    let fence = format!("```{language}\n");
    let parts = page.split(&fence).skip(1);
    parts
        .filter_map(|part| Some(part.split_once("```")?.0.to_owned()))
        .collect()
}

/// The programs in Python and C of docs/wire.md, which the run takes as its controller, have the same torques. That in Rust is compiled with the crate.
#[test]
fn the_programs_of_the_page_on_the_wire_give_the_same_torques() {
    if lacks("") {
        return;
    }
    let desk = Desk::new();
    desk.file("damp.py", &blocks("python")[0]);
    desk.file("damp.c", &blocks("c")[0]);
    desk.file("armplane.h", wire(&desk, "c"));
    let mut compiler = desk.program("cc");
    compiler.args(["-O2", "-std=gnu11", "-Wall", "-Wextra", "-Werror", "-I."]);
    compiler.args(["-o", "damp", "damp.c"]);
    link(&desk, &mut compiler);
    let Ok(built) = compiler.output() else {
        return skipped("there is no cc");
    };
    let errors = String::from_utf8_lossy(&built.stderr);
    assert!(built.status.success(), "{errors}");
    let [python, c] = ["\"python3\", \"damp.py\"", "\"./damp\""].map(|command| {
        let topics =
            "reads = [\"estimate\", \"singularity\"]\nwrites = [\"control_state\", \"torque\"]";
        let process = format!("name = \"controller\"\ncommand = [{command}]\n{topics}\n");
        graph(&desk, &process, "");
        desk.armplane("run short.toml --no-record --json").json()
    });
    python["topics"]["torque"].holds(r#"{"count": 1001}"#);
    assert_eq!(python["topics"], c["topics"]);
}
