//! Programs in other languages that observe a run, and how they end.

use std::io::{BufRead, BufReader};

use crate::command::{Desk, Known, assert_nothing_left, finish};
use crate::exchange::{armplane, lacks, programs_of, run, scenario};
use crate::life::signal;

/// An observer that at tick 100 does this.
fn watch(desk: &Desk, at_100: &str) {
    let program = "import armplane, os, time\nclass W(armplane.Observer):\n    def see(self, tick, plant_state=None):\n        if tick == 100:\n            ";
    desk.file("watch.py", &format!("{program}{at_100}\nW.run()\n"));
    let process = "[[process]]\nname = \"watch\"\ncommand = [\"python3\", \"watch.py\"]\nexchange = true\nreads = [\"plant_state\"]\n";
    desk.file("graph.toml", &format!("extends = \"armplane\"\n{process}"));
    scenario(desk, "");
}

#[test]
fn the_end_of_an_observer_has_one_tick() {
    if lacks("") {
        return;
    }
    for (at_100, kind) in [
        ("os.kill(os.getpid(), 9)", "exit"),
        ("os.kill(os.getppid(), 9)", "kill"),
    ] {
        let desk = Desk::new();
        watch(&desk, at_100);
        let said = run(&desk, "run short.toml --no-record --json");
        let summary = said.json();
        let (fault, reason) = (&summary["faults"][0], summary["reason"].text());
        let at = format!(" at tick {}", fault["tick"]);
        assert_eq!(
            (said.code, &fault["kind"], &fault["plan"]["at_tick"]),
            (1, &kind.into(), &fault["tick"]),
            "{}",
            said.err
        );
        assert!(
            reason.contains(&at) && fault["detail"].text().contains(&at),
            "{reason}: {fault}"
        );
        assert!(kind == "kill" || fault["tick"] == 100, "{fault}");
    }
}

#[test]
fn a_program_that_hangs_ends_quietly_with_an_interrupted_run() {
    if lacks("") {
        return;
    }
    let desk = Desk::new();
    watch(&desk, "print('hangs', flush=True); time.sleep(600)");
    let mut launcher = armplane(&desk, "run short.toml --no-record --json")
        .spawn()
        .expect("armplane starts");
    let mut lines = BufReader::new(launcher.stderr.take().expect("piped"))
        .lines()
        .map_while(Result::ok);
    assert!(
        lines.by_ref().any(|line| line.contains("hangs")),
        "it does not come to tick 100"
    );
    signal(launcher.id().cast_signed(), "INT");
    let rest: Vec<String> = lines.collect();
    let said = finish(launcher);
    let summary = said.json();
    assert_eq!(
        (
            &summary["outcome"],
            summary["faults"].as_array().map(Vec::len)
        ),
        (&"interrupted".into(), Some(0)),
        "{summary}"
    );
    assert!(
        !rest.iter().any(|line| line.contains("has not answered")),
        "{rest:?}"
    );
    assert_nothing_left(said.launcher);
    assert_eq!(programs_of(said.launcher), Vec::<i32>::new());
}
