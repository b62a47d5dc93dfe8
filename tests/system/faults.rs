//! Faults on real processes: survived, said, and the same again.

use serde_json::Value;

use crate::command::{Desk, Known, assert_nothing_left, finish, interrupt, pid_of, until};
use crate::life::signal;
use crate::patience::ticks;

/// A short task with faults after it.
fn scenario(faults: &str) -> String {
    format!(
        "name = \"short\"\nrobot = \"puma560\"\nstart.posture = \"nominal\"\nsettle_s = 0.2\n\n[[segment]]\nby_m = [0.05, 0.0, 0.05]\nduration_s = 0.8\n\n{faults}"
    )
}

fn fault(process: &str, kind: &str, more: &str) -> String {
    format!("[[fault]]\nprocess = \"{process}\"\nkind = \"{kind}\"\nat_tick = 400\n{more}\n")
}

fn topics(summary: &Value) -> &Value {
    assert_eq!(summary["recorder"]["lost"], 0, "{}", summary["recorder"]);
    &summary["topics"]
}

#[test]
fn planned_deaths_and_lost_messages_give_the_same_bytes_every_time_and_the_goal_is_reached() {
    let plan = [
        fault("controller", "kill", ""),
        fault("estimator", "crash", "for_ticks = 20"),
        fault("analyzer", "hang", "as = \"for-ever\""),
        fault("analyzer", "crash", "as = \"bus-error\""),
        fault("recorder", "kill", ""),
        fault("estimator", "delay", "delay_ticks = 1\njitter_ticks = 1"),
        fault("plant", "drop", "probability = 0.3"),
        fault("controller", "corrupt", "as = \"nan\"\nprobability = 0.1"),
    ];
    for (i, one) in plan.iter().enumerate() {
        let desk = Desk::new();
        // The last one comes with all others: the drill's pairs, and more.
        let faults = if i + 1 == plan.len() {
            plan.concat()
        } else {
            one.clone()
        };
        desk.file("s.toml", &scenario(&faults));
        let runs = ["a", "b"].map(|out| {
            let said = desk.armplane(&format!("run s.toml --json --out {out}"));
            assert_nothing_left(said.launcher);
            let summary = said.json();
            // It strays on its way, and gets there.
            assert_eq!(summary["completed"], true, "{faults}\n{}", said.err);
            assert!(
                summary["task"]["final_position_mm"].number() < 1.0,
                "{}",
                summary["task"]
            );
            summary
        });
        assert_eq!(topics(&runs[0]), topics(&runs[1]), "{faults}");
        // Together, the dead send nothing that could be corrupted.
        let injected = runs[0]["faults"]
            .list()
            .iter()
            .filter(|fault| fault["occurred"] == true)
            .count();
        assert!(
            injected == 1 || i + 1 == plan.len() && injected + 1 >= plan.len(),
            "{}",
            runs[0]["faults"]
        );
        assert!(runs[0]["joints"]["torque_max_ratio"].number() <= 1.0);
    }
}

#[test]
fn an_estimate_that_no_arm_can_have_moved_to_gets_no_torque() {
    for (field, amount) in [("q[1]", "1e6"), ("qdot[4]", "1000.0")] {
        let desk = Desk::new();
        let corrupt =
            format!("as = \"huge\"\nfield = \"{field}\"\namount = {amount}\nfor_ticks = 80");
        desk.file(
            "absurd.toml",
            &scenario(&fault("estimator", "corrupt", &corrupt)),
        );
        let summary = desk.run("absurd.toml --no-record");
        assert_eq!(
            summary["faults"][0]["occurred"], true,
            "{}",
            summary["faults"]
        );
        assert_eq!(
            summary["outcome"], "goal reached",
            "{field}: {}",
            summary["reason"]
        );
        assert!(
            summary["reason"].text().contains("set aside for 80 ticks"),
            "{field}: {}",
            summary["reason"]
        );
        // It takes 22 % of the limits to follow the path, and as much to be brought to rest: not the full torque of 80 ms.
        let torque = summary["joints"]["torque_max_ratio"].number();
        assert!(torque < 0.3, "{field}: {torque} of the torque limit");
        assert!(
            summary["joints"]["speed_max_ratio"].number() < 0.3,
            "{field}"
        );
    }
}

/// Where no file has a message, it is in the retainer of its topic and in the recorder's checkpoints alone.
#[test]
fn a_recorder_killed_from_outside_loses_nothing() {
    let desk = Desk::new();
    let run = |out: &str, more: &str| {
        desk.start(&format!(
            "run --set segment.1.duration_s=20 --json --out {out} {more}"
        ))
    };
    let whole = finish(run("whole", "")).json();
    for more in ["", "--no-record", "--no-messages"] {
        let child = run("killed", more);
        // Further than the retainers reach back, and not just behind a checkpoint that is due for its age.
        until("thousands of ticks", || ticks(&child) > 6_000);
        signal(pid_of(child.id(), "recorder").unwrap(), "KILL");
        let said = finish(child);
        assert_nothing_left(said.launcher);
        let killed = said.json();
        assert_eq!(
            (said.code, topics(&killed), &killed["task"]),
            (0, topics(&whole), &whole["task"]),
            "{more}: every message, in order, and the figures"
        );
        assert_eq!(
            (&killed["joints"], &killed["modes"]),
            (&whole["joints"], &whole["modes"])
        );
        let faults = killed["faults"].list();
        assert_eq!(
            (faults.len(), &faults[0]["origin"]),
            (1, &"detected".into()),
            "{more}: {faults:?}"
        );
        if !more.is_empty() {
            continue;
        }
        assert_eq!(killed["recorder"]["parts"], 2);
        let mut ticks = Vec::new();
        let collect = |piece: viz::Piece| {
            if let viz::Piece::Rows(rows) = piece {
                ticks.extend_from_slice(&rows.ticks);
            }
            Ok::<(), viz::ReadError>(())
        };
        viz::read(&viz::parts_in(&desk.path().join("killed")), collect).unwrap();
        ticks.sort_unstable();
        assert_eq!(
            ticks,
            (0..killed["ticks"].count()).collect::<Vec<_>>(),
            "every tick once in the recording"
        );
    }
}

#[test]
fn a_live_fault_is_recorded_and_its_run_can_be_repeated() {
    let desk = Desk::new();
    let child = desk.start("run --set segment.1.duration_s=12 --json --out live");
    let run = format!("-{}-", child.id());
    until("the run to take a fault", || {
        let runs = desk.armplane("doctor --json").json();
        let name = runs["runs"]
            .list()
            .iter()
            .filter_map(|one| one["run"].as_str())
            .find(|name| name.contains(&run))
            .map(str::to_owned);
        name.is_some_and(|name| {
            desk.armplane(&format!("fault controller kill --for 50ms --run {name}"))
                .code
                == 0
        })
    });
    let said = finish(child);
    assert_eq!(said.code, 0, "{}", said.err);
    let live = said.json();
    assert_eq!(
        (&live["faults"][0]["origin"], &live["faults"][0]["occurred"]),
        (&"live".into(), &true.into()),
        "{}",
        live["faults"]
    );
    let again = desk.run("live/scenario.toml --out again");
    assert_eq!(topics(&live), topics(&again));
    assert_eq!(again["faults"][0]["origin"], "planned");
    assert_nothing_left(said.launcher);
}

#[test]
fn a_budget_that_is_spent_ends_the_run_with_a_sentence() {
    let desk = Desk::new();
    let kills = |k: usize| {
        format!(
            "[[fault]]\nprocess = \"controller\"\nkind = \"kill\"\nat_tick = {}\nfor_ticks = 10\n",
            100 * (k + 1)
        )
    };
    desk.file("s.toml", &scenario(&(0..6).map(kills).collect::<String>()));
    let said = desk.armplane("run s.toml --out r");
    assert_eq!(said.code, 1);
    assert!(
        said.err
            .contains("at tick 600 after 5 restarts, all that its budget allows"),
        "{}",
        said.err
    );
    assert_nothing_left(said.launcher);
    // The tick is that of the last death, wherever the plan lists it.
    desk.file(
        "s.toml",
        &scenario(&(0..6).map(|k| kills((k + 5) % 6)).collect::<String>()),
    );
    desk.refuses(
        1,
        "run s.toml --out r",
        &["controller", "at tick 600 after 5 restarts"],
    );
}

#[test]
fn drill_judges_a_cell_and_takes_only_cells_that_exist() {
    let desk = Desk::new();
    desk.file("s.toml", &scenario(""));
    for cell in [
        "controller:kill",
        "plant:kill",
        "recorder:disk-full",
        "plant:delay",
        "controller:zombie",
    ] {
        let said = desk.succeeds(&format!("drill s.toml --only {cell} --json"));
        let drill = said.json();
        let one = &drill["cells"][0];
        assert_eq!(
            (&drill["passed"], &one["replayed_identically"]),
            (&true.into(), &true.into()),
            "{one}"
        );
        assert!(
            one["stale_ticks"].count() <= 3 && one["torque_max_ratio"].number() <= 1.0,
            "{one}"
        );
        assert_eq!(
            one["goal_reached"],
            !cell.starts_with("plant:kill"),
            "{one}"
        );
        assert_nothing_left(said.launcher);
    }
    // The bounds stay, whatever a scenario allows itself; nor does it pass without what it tests.
    for (changed, cell, check) in [
        ("--set plant.hold_ticks=200", "controller:kill", "age"),
        ("--without hold", "controller:kill", "age"),
        (
            "--without torque-check",
            "controller:corrupt:huge",
            "torque",
        ),
        ("--without fencing", "controller:zombie", "fence"),
    ] {
        let said = desk.armplane(&format!("drill s.toml --json --only {cell} {changed}"));
        let drill = said.json();
        let broken = drill["cells"][0]["broken"].list();
        assert!(
            said.code == 1 && broken.iter().any(|one| one["check"] == check),
            "{drill}\n{}",
            said.err
        );
    }
    desk.refuses(
        1,
        "drill s.toml --only controller:kill --set goal.position_mm=1e-7",
        &["without a fault does not reach its goal"],
    );
    desk.refuses(2, "drill --only recorder:drop", &["can happen to plant"]);
}

#[test]
fn a_cut_edge_keeps_messages_from_one_reader_alone() {
    let desk = Desk::new();
    desk.file(
        "s.toml",
        &scenario(&fault(
            "controller",
            "cut",
            "topic = \"estimate\"\nfor_ticks = 2",
        )),
    );
    let summary = desk.run("s.toml --no-record");
    let count = |topic: &str| summary["topics"][topic]["count"].count();
    assert_eq!(
        (count("estimate"), count("singularity")),
        (count("plant_state"), count("plant_state")),
        "the others have them"
    );
    assert_eq!(
        count("torque") + 2,
        count("estimate"),
        "and it has nothing to answer"
    );
    assert_eq!(summary["outcome"], "goal reached", "{}", summary["reason"]);
    let fault = &summary["faults"][0];
    assert!(
        fault["occurred"] == true
            && fault["detected_ms"].is_number()
            && summary["processes"][3]["restarts"] == 0,
        "{fault}"
    );
}

#[test]
fn slow_processes_and_pages_that_are_gone_change_no_byte_in_lockstep() {
    let desk = Desk::new();
    let everywhere = |kind: &str, processes: &[&str]| {
        processes
            .iter()
            .map(|process| fault(process, kind, "for_ticks = 20"))
            .collect::<String>()
    };
    let stages = ["plant", "estimator", "analyzer", "controller"];
    let faults = everywhere("slow", &stages)
        + &everywhere("page-out", &[&stages[..], &["recorder"]].concat());
    desk.file("calm.toml", &scenario(""));
    desk.file("slow.toml", &scenario(&faults));
    let (calm, slow) = (desk.run("calm.toml --out a"), desk.run("slow.toml --out b"));
    assert_eq!(topics(&calm), topics(&slow));
    let injected = slow["faults"]
        .list()
        .iter()
        .filter(|fault| fault["occurred"] == true)
        .count();
    assert_eq!(injected, 9, "{}", slow["faults"]);
}

#[test]
fn a_fault_that_makes_no_sense_is_one_sentence() {
    let desk = Desk::new();
    desk.file("s.toml", &scenario(&fault("recorder", "drop", "")));
    desk.refuses(2, "run s.toml", &["cannot happen to the recorder"]);
    desk.file("s.toml", &scenario(&fault("plant", "sensor", "joint = 9")));
    desk.refuses(2, "run s.toml", &["has 6 joints"]);
    desk.refuses(2, "fault controller kill --run nowhere", &["nowhere"]);
}

#[test]
fn a_run_of_another_folder_is_named_before_anything_happens_to_it() {
    let (desk, elsewhere) = (Desk::new(), Desk::new());
    let child = desk.begin("run --set segment.1.duration_s=500 --json --no-record --out r");
    elsewhere.refuses(
        2,
        "fault controller kill",
        &[desk.path().join("r").to_str().unwrap(), "--run"],
    );
    let said = interrupt(child);
    let summary = said.json();
    assert_eq!(
        summary["faults"],
        Value::Array(vec![]),
        "nothing happened to it"
    );
}

#[test]
fn a_recorder_killed_after_the_last_tick_loses_nothing() {
    let desk = Desk::new();
    // It is behind at the end.
    desk.file(
        "slow.toml",
        &scenario(&fault(
            "recorder",
            "slow-disk",
            "for_ticks = 100000\namount = 300.0\n",
        )),
    );
    let expected = desk.run("slow.toml --out expected");
    let child = desk.start("run slow.toml --out results --json");
    let has = |process: &str| pid_of(child.id(), process);
    until("the processes", || {
        has("plant").is_some() && has("recorder").is_some()
    });
    until("the plant to end", || has("plant").is_none());
    signal(has("recorder").unwrap(), "KILL");
    let said = finish(child);
    let summary = said.json();
    assert_eq!(
        (said.code, &summary["topics"], &summary["recorder"]["lost"]),
        (0, &expected["topics"], &0.into()),
        "{}",
        said.err
    );
    assert_nothing_left(said.launcher);
}
