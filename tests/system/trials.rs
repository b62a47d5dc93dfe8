//! Trials on one thread: settings and faults drawn at random give the bytes of the processes.

use lab::trial::Trial;
use serde_json::Value;
use session::load;
use shared_types::random::Uniform;

use crate::command::{Desk, Known, has_python, skipped};

/// A short task, so that a run of it takes a moment.
const SHORT: &str = "name = \"short\"\nrobot = \"puma560\"\nsettle_s = 0.05\n[start]\nq_deg = [20, -60, 170, 0, 30, 0]\n[[segment]]\nby_m = [0.02, 0.0, -0.01]\nduration_s = 0.4\n";

/// One of the values, or a number of the range.
enum Values {
    Of(&'static [&'static str]),
    Within(f64, f64),
    Whole(u64, u64),
}
use Values::{Of, Whole, Within};

/// Draws settings, and runs the scenario on one thread and in five processes.
fn drawn_runs_are_those_of_five_processes(faults: &str, keys: &[(&str, Values)], count: u32) {
    let desk = Desk::new();
    desk.file("short.toml", [SHORT, faults].concat());
    let path = desk.at("short.toml").display().to_string();
    let mut random = Uniform(5);
    for run in 0..count {
        let mut draw = |(key, values): &(&str, Values)| match values {
            Of(values) => format!(
                "{key}={}",
                values[random.within(0.0, values.len() as f64) as usize]
            ),
            Within(low, high) => format!("{key}={:?}", random.within(*low, *high)),
            Whole(low, high) => {
                format!("{key}={}", random.within(*low as f64, *high as f64) as u64)
            }
        };
        let settings: Vec<String> = keys.iter().map(&mut draw).collect();
        is_as_in_processes(&desk, &path, &settings, &format!("run-{run}"));
    }
}

fn is_as_in_processes(desk: &Desk, scenario: &str, settings: &[String], out: &str) {
    let loaded = load::scenario(scenario, settings, None).expect("a scenario");
    let trial = Trial {
        robot: &loaded.robot,
        scenario: loaded.scenario.clone(),
        graph: None,
    };
    let row = trial.run().expect("a run");
    let given = settings.iter().flat_map(|setting| ["--set", setting]);
    let mut command = desk.command("run");
    command.args([scenario, "--json", "--no-record", "--out", out]);
    let said = command.args(given).output().expect("a run");
    let summary: Value =
        serde_json::from_slice(&said.stdout).unwrap_or_else(|_| panic!("{settings:?}: {said:?}"));
    assert_eq!(row.outcome, summary["outcome"].text(), "{settings:?}");
    let position = summary["task"]["position_max_mm"].number();
    assert_eq!(row.task.position_max_mm, position, "{settings:?}");
    let topics = summary["topics"].as_object().expect("topics").iter();
    let hashes = topics.map(|(topic, it)| (topic.clone(), it["hash"].text().to_owned()));
    assert_eq!(row.hash, hashes.collect(), "{settings:?}");
}

/// From the source tree, where the package has no extension module.
#[test]
fn experiments_without_the_wheel_are_refused_in_one_line() {
    if !has_python("") || has_python("armplane") {
        return skipped("there is no python3 here, or one that has the wheel");
    }
    let desk = Desk::new();
    for args in [
        "sweep x.toml",
        "sweep report x",
        "figures",
        "servo --seeds 1",
    ] {
        let said = desk.refuses(2, args, "python/build");
        assert_eq!(said.err.lines().count(), 1, "{args}: {}", said.err);
    }
}

#[test]
fn a_steered_run_has_the_bytes_of_its_processes() {
    let seed = ["seed=3".to_owned()];
    is_as_in_processes(&Desk::new(), "servo-hostile", &seed, "steered");
}

/// Gains, masses, noise, start, laws, an analysis by number, a faulty sensor.
#[test]
fn runs_drawn_at_random_have_the_bytes_of_five_processes() {
    let fault = "[[fault]]\nprocess = \"plant\"\nkind = \"sensor\"\nas = \"bias\"\njoint = 5\namount = 0.01\nat_s = 0.1\nfor_s = 0.2\n";
    let keys = [
        (
            "control.strategy",
            Of(&["blended", "chang-khatib", "damped-least-squares"]),
        ),
        ("control.k_p", Within(100.0, 900.0)),
        ("plant.mass_factor", Within(0.8, 1.2)),
        ("plant.encoder_noise_counts", Within(0.0, 3.0)),
        ("plant.friction", Of(&["true", "false"])),
        ("start.q_deg.4", Within(-5.0, 40.0)),
        ("analysis.numeric", Of(&["true", "false"])),
        ("fault.0.amount", Within(-0.05, 0.05)),
        ("seed", Whole(1, 1_000_000)),
    ];
    drawn_runs_are_those_of_five_processes(fault, &keys, 6);
}

/// Two faults of any process and its messages, their kinds, ticks and lengths.
#[test]
fn faults_drawn_at_random_have_the_bytes_of_five_processes() {
    let fault = |process: &str, kind: &str| {
        format!(
            "[[fault]]\nprocess = \"{process}\"\nkind = \"{kind}\"\nat_tick = 1\nfor_ticks = 1\n"
        )
    };
    let faults = [fault("controller", "kill"), fault("plant", "drop")].concat();
    let keys = [
        (
            "fault.0.process",
            Of(&["estimator", "analyzer", "controller"]),
        ),
        ("fault.0.kind", Of(&["kill", "crash", "hang", "cut"])),
        ("fault.0.at_tick", Whole(0, 400)),
        ("fault.0.for_ticks", Whole(1, 120)),
        (
            "fault.1.process",
            Of(&["plant", "estimator", "analyzer", "controller"]),
        ),
        (
            "fault.1.kind",
            Of(&["delay", "drop", "duplicate", "stale", "corrupt", "zombie"]),
        ),
        ("fault.1.at_tick", Whole(0, 400)),
        ("fault.1.for_ticks", Whole(1, 120)),
        ("seed", Whole(1, 1_000_000)),
    ];
    drawn_runs_are_those_of_five_processes(&faults, &keys, 12);
}
