//! A program in another language that observes a run, and how it ends.

use std::io::{BufRead, BufReader};

use crate::command::{Desk, Known, Running, lacks};
use crate::programs::graph;

/// An observer that at tick 100 does this.
fn watch(at_100: &str) -> Desk {
    let desk = Desk::new();
    let program = "import armplane, os, time\nclass W(armplane.Observer):\n    def see(self, tick, plant_state=None):\n        if tick == 100:\n            ";
    desk.file("watch.py", format!("{program}{at_100}\nW.run()\n"));
    graph(
        &desk,
        "name = \"watch\"\ncommand = [\"python3\", \"watch.py\"]\nreads = [\"plant_state\"]\n",
        "",
    );
    desk
}

#[test]
fn a_program_that_hangs_ends_quietly_with_an_interrupted_run() {
    if lacks("") {
        return;
    }
    let desk = watch("print('hangs', flush=True); time.sleep(600)");
    let mut run = desk.start("run short.toml --no-record --json");
    let stderr = BufReader::new(run.stderr.take().expect("piped"));
    let mut lines = stderr.lines().map_while(Result::ok);
    let has_come = lines.by_ref().any(|line| line.contains("hangs"));
    assert!(has_come, "it does not come to tick 100");
    run.signal("INT");
    let rest: Vec<String> = lines.collect();
    run.finish()
        .json()
        .holds(r#"{"outcome": "interrupted", "faults": []}"#);
    let is_loud = rest.iter().any(|line| line.contains("answer_limit_s"));
    assert!(!is_loud, "{rest:?}");
}
