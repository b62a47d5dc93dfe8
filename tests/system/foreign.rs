//! The examples of `examples/`: a plant in C, a controller, a subscriber and a reader of results in Python; and MuJoCo as the plant.

use std::path::Path;
use std::process::Command;

use message_log::{Contents, Log};
use shared_types::PlantState;

use crate::clients::python;
use crate::command::{Desk, assert_nothing_left, finish, run_of, skipped, until};
use crate::exchange::{armplane, lacks, root, run, scenario};
use crate::wire::wire;

#[test]
fn a_plant_in_one_c_file_runs_like_ours() {
    let desk = Desk::new();
    desk.file("armplane.h", &wire(&desk, "c"));
    for file in ["plant.c", "graph.toml", "two-links.toml"] {
        desk.file(
            file,
            &std::fs::read_to_string(root().join("examples/c").join(file)).expect("the example"),
        );
    }
    let built = Command::new("cc")
        .args([
            "-O2",
            "-std=gnu11",
            "-Wall",
            "-Wextra",
            "-Werror",
            "-o",
            "plant",
            "plant.c",
            "-lm",
        ])
        .current_dir(desk.path())
        .output();
    let Ok(built) = built else {
        return skipped("there is no cc");
    };
    assert!(
        built.status.success(),
        "{}",
        String::from_utf8_lossy(&built.stderr)
    );
    let theirs = run(&desk, "run two-links.toml --json");
    assert_eq!(theirs.code, 0, "{}", theirs.err);
    let again = run(&desk, "run two-links.toml --no-record --json").json();
    assert_eq!(
        again["topics"],
        theirs.json()["topics"],
        "the same bytes twice"
    );
    let ideal = "--set plant.encoder_bits=0";
    let text = std::fs::read_to_string(desk.path().join("two-links.toml")).expect("the example");
    desk.file("plain.toml", &text.replace("graph = \"graph.toml\"\n", ""));
    let ours = run(&desk, &format!("run plain.toml --out ours --json {ideal}"));
    assert_eq!(ours.code, 0, "{}", ours.err);
    let apart = furthest_apart(
        &desk.path().join("runs/two-links-001"),
        &desk.path().join("ours"),
    );
    assert!(apart < 1e-6, "joints {apart} rad apart");
}

/// The needs of the examples in Python: those with MuJoCo, the reader of results, the subscriber.
const MUJOCO: &str = "mujoco, numpy";
const TABLES: &str = "numpy, pandas, pyarrow, mcap";
const TOPICS: &str = "iceoryx2";

/// The largest difference between the true joint positions of two runs; rad.
fn furthest_apart(one: &Path, other: &Path) -> f64 {
    let states = |folder: &Path| {
        let job = std::fs::read(folder.join("job.json")).expect("a job");
        let job = serde_json::from_slice(&job).expect("a job");
        let log = Log::open(&folder.join("messages.mcap"), &Contents::of(&job));
        let mut states = log.expect("a message log").messages::<PlantState>();
        std::iter::from_fn(|| states.next_message().expect("a whole log")).collect::<Vec<_>>()
    };
    let (one, other) = (states(one), states(other));
    assert!(
        one.len().abs_diff(other.len()) <= 100 && one.len() > 100,
        "{} and {} ticks",
        one.len(),
        other.len()
    );
    let joints = |(a, b): (&PlantState, &PlantState)| {
        a.q.iter()
            .zip(&b.q)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max)
    };
    one.iter().zip(&other).map(joints).fold(0.0, f64::max)
}

#[test]
fn mujoco_is_the_plant_of_figure_5() {
    if lacks(MUJOCO) {
        return;
    }
    let desk = Desk::new();
    let args = "run fig5-wrist-rotation --plant mujoco --json";
    let (first, second) = (run(&desk, args), run(&desk, args));
    assert_eq!(first.code, 0, "{}", first.err);
    let (first, second) = (first.json(), second.json());
    assert_eq!(first["topics"], second["topics"], "the same bytes twice");
    assert_eq!(first["outcome"], "goal reached");
    let replayed = run(&desk, "replay runs/fig5-wrist-rotation-001");
    assert_eq!(replayed.code, 0, "{}{}", replayed.out, replayed.err);
    run(&desk, "run fig5-wrist-rotation --out ours --json");
    let apart = furthest_apart(
        &desk.path().join("runs/fig5-wrist-rotation-001"),
        &desk.path().join("ours"),
    );
    assert!(apart < 2e-3, "joints {apart} rad apart");
}

/// Whichever part is missing, one sentence says what to install, and nothing is left behind.
#[test]
fn without_python_or_mujoco_nothing_starts() {
    let desk = Desk::new();
    let cases = [
        (
            "no-folder",
            "",
            "run fig5-wrist-rotation --plant mujoco",
            "python3",
        ),
        (
            "",
            "raise ImportError('mujoco is away')",
            "run fig5-wrist-rotation --plant mujoco",
            "pip install mujoco",
        ),
        (
            "",
            "raise ImportError('mujoco is away')",
            "compare sweep --robot ur5 --plant mujoco --count 1",
            "pip install mujoco",
        ),
    ];
    for (path, module, args, expected) in cases {
        desk.file("mujoco.py", module);
        let mut command = armplane(&desk, args);
        if !path.is_empty() {
            command.env("PATH", path);
        } else if lacks("") {
            continue;
        }
        let said = finish(command.spawn().expect("armplane starts"));
        assert_eq!(said.code, 2, "{}", said.err);
        assert!(
            said.err.contains(expected) && said.err.lines().count() == 1,
            "{}",
            said.err
        );
        assert!(!desk.path().join("runs").exists(), "results of no run");
    }
}

#[test]
fn a_controller_in_python_follows_a_line() {
    if lacks(MUJOCO) {
        return;
    }
    let desk = Desk::new();
    let scenario = root()
        .join("examples/python/line.toml")
        .display()
        .to_string();
    let said = run(&desk, &format!("run {scenario} --no-record --json"));
    assert_eq!(said.code, 0, "{}", said.err);
    assert!(
        said.err.contains("hand at"),
        "the observer prints: {}",
        said.err
    );
    assert_eq!(said.json()["outcome"], "goal reached");
}

#[test]
fn results_are_read_in_python() {
    if lacks(TABLES) {
        return;
    }
    let desk = Desk::new();
    let short = scenario(&desk, "");
    let text = std::fs::read_to_string(&short)
        .expect("the scenario")
        .replace("graph = \"graph.toml\"\n", "");
    desk.file("short.toml", &text);
    let code = "import armplane, numpy as np\nr = armplane.run('short.toml', seed=3, settings={'control.k_p': 500})\nassert r.goal_reached, r\n\
                for topic in r.summary['topics']:\n    m = r.messages(topic)\n    assert len(m) == r.summary['topics'][topic]['count'] and \
                (np.diff(m['header']['tick'].astype(int)) == 1).all(), topic\n\
                d, q = r.pandas(), r.messages('estimate')['q']\nassert len(d) == len(q) == r.summary['ticks'] and np.abs(q[:, :6]).max() > 1\n\
                try:\n    armplane.run('nothing')\nexcept RuntimeError as e:\n    assert 'no scenario' in str(e)\nelse:\n    assert False\nprint('good')";
    python(&desk, code);
}

#[test]
fn a_run_is_listened_to_from_outside() {
    if lacks(TOPICS) {
        return;
    }
    let desk = Desk::new();
    let launcher = armplane(
        &desk,
        "run fig5-wrist-rotation --mode realtime --no-record --json",
    )
    .spawn()
    .expect("armplane starts");
    let mut run = None;
    until("the run", || {
        run = run_of(launcher.id())
            .filter(|run| Path::new("/dev/shm").join(run).join("job.json").exists());
        run.is_some()
    });
    let code = format!(
        "import armplane\nticks = [m.header.tick for m in armplane.subscribe('estimate', '/dev/shm/{}')]\n\
         assert len(ticks) > 100 and ticks == sorted(ticks), ticks[:9]\nprint('good')",
        run.expect("a run")
    );
    python(&desk, &code);
    let said = finish(launcher);
    assert_eq!(said.code, 0, "{}", said.err);
    assert_nothing_left(said.launcher);
}
