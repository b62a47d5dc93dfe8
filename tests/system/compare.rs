//! `armplane compare`: tables and JSON; what is wrong is said in a sentence.

use crate::command::{Desk, Known};

#[test]
fn laws_are_compared_on_a_scenario_and_on_lines() {
    let desk = Desk::new();
    let args = "compare fig5-wrist-rotation sweep --count 3 --law blended,damped-least-squares --out out --json";
    let said = desk.succeeds(args);
    let json = said.json();
    assert_eq!(
        json,
        desk.read_json("out/compare.json"),
        "said and saved alike"
    );
    let [ours, damped] = [0, 1].map(|law| &json["scenarios"][0]["laws"][law]);
    ours.holds(r#"{"s1": true}"#);
    damped.holds(r#"{"s1": false}"#);
    assert!(
        ours["orthogonal_max_mm"].number() < 0.1 && damped["orthogonal_max_mm"].number() > 1.0,
        "{ours} {damped}"
    );
    json["scenarios"][1]["laws"][0]
        .holds(r#"{"all/lines": 3, "near/wrist/lines": 1, "all/ends": 3}"#);
    assert_eq!(
        desk.armplane(args).out,
        said.out,
        "the same again, whichever core does which run"
    );
}

/// Noisy encoders, an estimator, drives: S1, S2 and the ends reached, of seeded lines.
#[test]
fn lines_through_and_near_every_singularity_keep_the_bars() {
    let desk = Desk::new();
    // A near miss of a lock is at the edge of S2 either way.
    for (args, lines, s1) in [
        ("--count 24 --seed 3", 24, 23),
        ("--count 12 --seed 4 --speed 1", 12, 0),
    ] {
        let json = desk.json(&format!("compare sweep --law blended {args} --out out"));
        let all = &json["scenarios"][0]["laws"][0]["all"];
        assert_eq!(all["ends"], lines, "{all}");
        assert!(
            all["s2"].count() + 1 >= lines && all["s1"].count() >= s1,
            "{all}"
        );
    }
}

/// With noise at the edge of a neighbourhood hard switching chatters, the blend does not.
#[test]
fn nothing_chatters_at_the_edge() {
    let desk = Desk::new();
    for s in [0.1_f64, 0.2, 0.21] {
        desk.file(
            "edge.toml",
            format!("name = \"edge\"\nrobot = \"puma560\"\nsettle_s = 0.0\n[start]\nq = [0.3, -1.0, 2.9, 0.2, {}, 0.0]\n[[segment]]\nduration_s = 5.0\n", s.asin()),
        );
        let json = desk.json("compare edge.toml --law blended,chang-khatib --out out");
        let [blended, hard] =
            [0, 1].map(|law| json["scenarios"][0]["laws"][law]["switches"].count());
        assert!(
            blended <= 2 && (s > 0.1 || hard > 20),
            "{s}: {blended}, {hard}"
        );
    }
}

#[test]
fn lines_through_exactly_singular_postures_of_an_arm_reach_their_goals() {
    let desk = Desk::new();
    let told = desk.json("compare sweep --robot ur5 --count 1 --out out");
    assert_eq!(
        told,
        desk.read_json("out/compare.json"),
        "said and saved alike"
    );
    let lines = told["scenarios"][0]["laws"][0]["lines"].list();
    for (line, lock) in lines.iter().zip(["elbow", "wrist", "overhead"]) {
        assert_eq!(line["singularities"], lock);
        line.holds(r#"{"outcome": "reached"}"#);
        assert!(line["score"]["speed_max_ratio"].number() <= 1.0, "{line}");
    }
    assert_eq!(lines.len(), 3);
}

#[test]
fn a_race_has_the_marks_of_a_steered_run_only_where_one_is_steered() {
    let desk = Desk::new();
    // The other arm; and where it is steered the twist that is asked for, and the way that the present twist leads.
    for (scenario, is_steered) in [("fig5-wrist-rotation", false), ("servo-line-panda", true)] {
        desk.json(&format!("compare {scenario} --race --out {scenario}"));
        let recording = desk.bytes(format!("{scenario}/run.rrd"));
        // Paths of entities stand in the heads of chunks as they are.
        for (path, is_there) in [
            ("/world/rival/link", true),
            ("/world/asked/motion", is_steered),
            ("/world/ahead/way", is_steered),
        ] {
            let mut parts = recording.windows(path.len());
            let found = parts.any(|bytes| bytes == path.as_bytes());
            assert_eq!(found, is_there, "{scenario}: {path}");
        }
    }
}

#[test]
fn work_beyond_one_thread_is_left_out_by_name_or_refused() {
    let desk = Desk::new();
    let fault = "\n[[fault]]\nprocess = \"controller\"\nkind = \"kill\"\nat_tick = 100\n";
    let text = sim::scenarios::text("fig5-wrist-rotation").unwrap();
    desk.file("faulty.toml", [text, fault].concat());
    let args = |scenario: &str| format!("compare {scenario} --law blended --out out");
    let [faulty, whole] = ["faulty.toml", "fig5-wrist-rotation"]
        .map(|scenario| desk.json(&args(scenario))["scenarios"][0].take());
    faulty.holds(r#"{"faults_left_out": 1}"#);
    whole.holds(r#"{"faults_left_out": 0}"#);
    assert_eq!(faulty["laws"], whole["laws"]);
}
