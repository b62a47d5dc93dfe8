//! The examples of `examples/`: a plant in C, a controller, a subscriber and a reader of results in Python; and MuJoCo as the plant.

use recorder::{Contents, RecordReader};
use shared_types::PlantState;

use crate::clients::python;
use crate::command::{Desk, Known, Running, lacks, root, run_of, skipped, source, until};
use crate::wire::wire;

/// The needs of the examples in Python: those with MuJoCo, the reader of results, the subscriber.
const MUJOCO: &str = "mujoco, numpy";
const TABLES: &str = "numpy, pandas, pyarrow, mcap";
const TOPICS: &str = "iceoryx2";

#[test]
fn a_plant_in_one_c_file_runs_like_ours() {
    let desk = Desk::new();
    desk.file("armplane.h", wire(&desk, "c"));
    for file in ["plant.c", "graph.toml", "two-links.toml"] {
        desk.file(file, source(&format!("examples/c/{file}")));
    }
    let mut compiler = desk.program("cc");
    compiler.args([
        "-O2",
        "-std=gnu11",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-o",
        "plant",
        "plant.c",
        "-lm",
    ]);
    link(&desk, &mut compiler);
    let Ok(built) = compiler.output() else {
        return skipped("there is no cc");
    };
    assert!(
        built.status.success(),
        "{}",
        String::from_utf8_lossy(&built.stderr)
    );
    let theirs = desk.run("two-links.toml");
    let again = desk.run("two-links.toml --no-record");
    assert_eq!(again["topics"], theirs["topics"], "the same bytes twice");
    let plain = desk
        .read("two-links.toml")
        .replace("graph = \"graph.toml\"\n", "");
    desk.file("plain.toml", plain);
    desk.run("plain.toml --out ours --set plant.encoder_bits=0");
    let apart = furthest_apart(&desk, "runs/two-links-001", "ours");
    assert!(apart < 1e-6, "joints {apart} rad apart");
}

/// Links the library that cargo has built for the tests.
pub(crate) fn link(desk: &Desk, compiler: &mut std::process::Command) {
    let tests = std::env::current_exe().expect("this test");
    let built = tests.with_file_name("libarmplane_process.so");
    assert!(built.is_file(), "{}: not built", built.display());
    for name in ["libarmplane-process.so", "libarmplane-process.so.1"] {
        std::os::unix::fs::symlink(&built, desk.at(name)).expect("a link");
    }
    let folder = desk.at(".").display().to_string();
    compiler
        .arg(format!("-L{folder}"))
        .arg(format!("-Wl,-rpath,{folder}"))
        .arg("-larmplane-process");
}

/// The largest difference between the true joint positions of two runs; rad.
fn furthest_apart(desk: &Desk, one: &str, other: &str) -> f64 {
    let [one, other] = [one, other].map(|folder| {
        let job = serde_json::from_value(desk.read_json(&format!("{folder}/job.json")));
        let record = RecordReader::open(
            &desk.at(folder).join("messages.mcap"),
            &Contents::of(&job.expect("a job")),
        );
        let states = record.expect("a record").messages::<PlantState>();
        states.collect::<Vec<_>>()
    });
    let (n, m) = (one.len(), other.len());
    assert!(n.abs_diff(m) <= 100 && n > 100, "{n} and {m} ticks");
    let joints = one
        .iter()
        .flat_map(|state| state.q)
        .zip(other.iter().flat_map(|state| state.q));
    joints.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn mujoco_is_the_plant_of_figure_5() {
    if lacks(MUJOCO) {
        return;
    }
    let desk = Desk::new();
    let [first, second] = [0, 1].map(|_| desk.run("fig5-wrist-rotation --plant mujoco"));
    assert_eq!(first["topics"], second["topics"], "the same bytes twice");
    first.holds(r#"{"outcome": "goal reached"}"#);
    desk.succeeds("replay runs/fig5-wrist-rotation-001");
    desk.run("fig5-wrist-rotation --out ours");
    let apart = furthest_apart(&desk, "runs/fig5-wrist-rotation-001", "ours");
    assert!(apart < 2e-3, "joints {apart} rad apart");
}

/// Whichever part is missing, one sentence says what to install, and nothing is left behind.
#[test]
fn without_python_or_mujoco_nothing_starts() {
    let desk = Desk::new();
    let run = "run fig5-wrist-rotation --plant mujoco";
    let sweep = "compare sweep --robot ur5 --plant mujoco --count 1";
    let away = "raise ImportError('mujoco is away')";
    for (path, module, args, expected) in [
        ("no-folder", "", run, "python3"),
        ("", away, run, "pip install mujoco"),
        ("", away, sweep, "pip install mujoco"),
    ] {
        desk.file("mujoco.py", module);
        let mut command = desk.command(args);
        if !path.is_empty() {
            command.env("PATH", path);
        } else if lacks("") {
            continue;
        }
        let said = command.spawn().expect("armplane starts").finish();
        assert!(
            said.code == 2 && said.err.contains(expected) && said.err.lines().count() == 1,
            "{}: {}",
            said.code,
            said.err
        );
        assert!(!desk.has("runs"), "results of no run");
    }
}

#[test]
fn a_controller_in_python_follows_a_line() {
    if lacks(MUJOCO) {
        return;
    }
    let desk = Desk::new();
    let scenario = root().join("examples/python/line.toml");
    let said = desk.succeeds(&format!("run {} --no-record --json", scenario.display()));
    assert!(said.err.contains(" W "), "{}", said.err);
    said.json().holds(r#"{"outcome": "goal reached"}"#);
}

#[test]
fn results_are_read_in_python() {
    if lacks(TABLES) {
        return;
    }
    let desk = Desk::new();
    desk.file(
        "short.toml",
        "name = \"short\"\nrobot = \"puma560\"\nsettle_s = 0.1\n[start]\nq_deg = [20, -60, 170, 0, 30, 0]\n\
         [[segment]]\nby_m = [0.03, 0.0, -0.02]\nduration_s = 0.5\n",
    );
    let code = "import armplane, numpy as np\nr = armplane.run('short.toml', seed=3, settings={'control.k_p': 500})\nassert r.goal_reached, r\n\
                for topic in r.summary['topics']:\n    m = r.messages(topic)\n    assert len(m) == r.summary['topics'][topic]['count'] and \
                (np.diff(m['header']['tick'].astype(int)) == 1).all(), topic\n\
                d, q = r.pandas(), r.messages('estimate')['q']\nassert len(d) == len(q) == r.summary['ticks'] and np.abs(q[:, :6]).max() > 1\n\
                try:\n    armplane.run('nothing')\nexcept RuntimeError as e:\n    assert '`nothing`' in str(e)\nelse:\n    assert False\nprint('good')";
    python(&desk, code);
}

#[test]
fn a_run_is_listened_to_from_outside() {
    if lacks(TOPICS) {
        return;
    }
    let desk = Desk::new();
    let run = desk.start("run fig5-wrist-rotation --mode realtime --no-record --json");
    let folder = || Some(format!("/dev/shm/{}", run_of(run.id())?));
    until("the run", || {
        folder().is_some_and(|folder| desk.has(format!("{folder}/job.json")))
    });
    let code = format!(
        "import armplane\nticks = [m.header.tick for m in armplane.subscribe('estimate', '{}')]\n\
         assert len(ticks) > 100 and ticks == sorted(ticks), ticks[:9]\nprint('good')",
        folder().expect("a run")
    );
    python(&desk, &code);
    let said = run.finish();
    assert_eq!(said.code, 0, "{}", said.err);
}
