//! `armplane compare` and `armplane figures`: tables, JSON and pictures; what is wrong is said in a sentence.

use serde_json::Value;

use crate::command::{Desk, Known};

fn assert_pictures(desk: &Desk, path: &str) {
    let file =
        |extension: &str| std::fs::read(desk.path().join(format!("{path}.{extension}"))).unwrap();
    assert!(
        file("svg").starts_with(b"<svg ") && file("png").starts_with(b"\x89PNG"),
        "{path}"
    );
}

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
    assert_pictures(&desk, "out/fig5-wrist-rotation");
    assert_pictures(&desk, "out/sweep");
    let [ours, damped] = [0, 1].map(|law| &json["scenarios"][0]["laws"][law]);
    assert!(
        ours["s1"] == true && damped["s1"] == false,
        "{ours} {damped}"
    );
    assert!(
        ours["orthogonal_max_mm"].number() < 0.1 && damped["orthogonal_max_mm"].number() > 1.0,
        "{ours} {damped}"
    );
    let sweep = &json["scenarios"][1]["laws"][0];
    assert_eq!(
        (
            &sweep["all"]["lines"],
            &sweep["near"]["wrist"]["lines"],
            &sweep["all"]["ends"]
        ),
        (&3.into(), &1.into(), &3.into())
    );
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
            &format!("name = \"edge\"\nrobot = \"puma560\"\nsettle_s = 0.0\n[start]\nq = [0.3, -1.0, 2.9, 0.2, {}, 0.0]\n[[segment]]\nduration_s = 5.0\n", s.asin()),
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
    let args = "compare sweep --robot ur5 --count 1 --out out --json";
    let told = desk.succeeds(args).json();
    assert_eq!(
        told,
        desk.read_json("out/compare.json"),
        "said and saved alike"
    );
    let lines = told["sweep"]["lines"].list();
    let names: Vec<_> = lines
        .iter()
        .map(|line| line["singularities"].text())
        .collect();
    assert_eq!(names, ["elbow", "wrist", "overhead"]);
    for line in lines {
        assert!(
            line["outcome"] == "reached" && line["score"]["speed_max_ratio"].number() <= 1.0,
            "{line}"
        );
    }
    desk.refuses(2, "compare sweep --robot ur6 --out out", &["ur5"]);
    desk.refuses(
        2,
        "compare --robot ur5",
        &["armplane compare sweep --robot"],
    );
}

#[test]
fn a_race_has_the_marks_of_a_steered_run_only_where_one_is_steered() {
    let desk = Desk::new();
    let marks = |scenario: &str| {
        desk.succeeds(&format!(
            "compare {scenario} --race --out {scenario} --json"
        ));
        let recording = std::fs::read(desk.path().join(scenario).join("run.rrd")).unwrap();
        // Paths of entities stand in the heads of chunks as they are.
        let has = |path: &str| {
            recording
                .windows(path.len())
                .any(|bytes| bytes == path.as_bytes())
        };
        [
            "/world/rival/link",
            "/world/asked/motion",
            "/world/ahead/way",
        ]
        .map(has)
    };
    assert_eq!(
        marks("fig5-wrist-rotation"),
        [true, false, false],
        "the other arm, and no target"
    );
    assert_eq!(
        marks("servo-line-panda"),
        [true; 3],
        "the other arm, the twist that is asked for and the way that the present twist leads"
    );
}

// covers: CK95 Figures 1, 2, 3 and 4
#[test]
fn the_papers_figures_are_drawn_with_their_numbers() {
    let desk = Desk::new();
    desk.succeeds("figures --out out");
    for figure in ["fig1-2", "fig3", "fig4", "fig5"] {
        assert_pictures(&desk, &format!("out/{figure}"));
    }
    let numbers = desk.read_json("out/figures.json");
    let number = |figure: &str, key: &str| numbers[figure][key].number();
    let (pseudo, consistent) = (
        number("fig1", "tip_error_max_mm"),
        number("fig2", "tip_error_max_mm"),
    );
    assert!(
        consistent < 1.0 && pseudo > 100.0 * consistent,
        "{pseudo} {consistent}"
    );
    let (pushed, still) = (
        number("fig1", "coupling_max_n"),
        number("fig2", "coupling_max_n"),
    );
    assert!(
        still < 1e-6 * pushed && pushed > 1.0,
        "force on the tip: {pushed} N, {still} N"
    );
    let swings = &numbers["fig2"]["joint_2_swings_deg"];
    let [first, later] = [0, 1].map(|i| swings[i].number());
    assert!(first > 60.0 && later > 0.9 * first, "{swings}");
    assert_eq!(numbers["fig3"]["overhead"]["type_in_the_paper"], "type 2");
    for (lock, class) in [
        ("elbow", "type 1"),
        ("wrist", "type 2"),
        ("overhead", "mixed"),
    ] {
        let one = &numbers["fig3"][lock];
        assert!(
            one["type"] == class && one["s"].number().abs() < 1e-3,
            "{lock}: {one}"
        );
    }
    assert!(
        (number("fig5", "zeta_turned_deg") - 90.0).abs() < 0.25
            && number("fig5", "position_max_mm") < 0.1,
        "{numbers}"
    );
    assert!(
        (number("fig4", "moved_mm").abs() - 80.0).abs() < 0.1
            && number("fig4", "orthogonal_max_mm") < 0.05,
        "{numbers}"
    );
}

#[test]
fn work_beyond_one_thread_is_left_out_by_name_or_refused() {
    let desk = Desk::new();
    let fault = "\n[[fault]]\nprocess = \"controller\"\nkind = \"kill\"\nat_tick = 100\n";
    desk.file(
        "faulty.toml",
        &[sim::scenarios::text("fig5-wrist-rotation").unwrap(), fault].concat(),
    );
    let compare = |scenario: &str, more: &str| {
        let said = desk.succeeds(&format!(
            "compare {scenario} --law blended --out out {more}"
        ));
        said.out
    };
    let [json, whole] = ["faulty.toml", "fig5-wrist-rotation"].map(|scenario| -> Value {
        let json: Value = serde_json::from_str(&compare(scenario, "--json")).unwrap();
        json["scenarios"][0].clone()
    });
    assert_eq!(
        (
            &json["faults_left_out"],
            &whole["faults_left_out"],
            &json["laws"]
        ),
        (&1.into(), &0.into(), &whole["laws"]),
        "{json}"
    );
    assert!(compare("faulty.toml", "").contains("without its planned faults (1)"));
    desk.refuses(
        2,
        "figures --set fault=[{process=\"controller\",kind=\"kill\",at_tick=100}] --out f",
        &["plans the `kill` of the controller"],
    );
}

#[test]
fn wrong_input_is_said() {
    let desk = Desk::new();
    let cases: [(&str, &str); 5] = [
        (
            "compare fig5 --law blendet",
            "there is no control law `blendet`: did you mean `blended`?",
        ),
        (
            "compare fig5-wrist-rotatoin",
            "did you mean `fig5-wrist-rotation`?",
        ),
        (
            "compare sweep --speed 0",
            "--speed is 0: it must be a positive number",
        ),
        (
            "compare sweep --set control.baseline.truncated_svd_floor=-1",
            "it must be a positive number",
        ),
        (
            "figures --out /proc/nowhere",
            "choose another folder with --out",
        ),
    ];
    for (args, expected) in cases {
        desk.refuses(2, args, &[expected]);
    }
    assert!(
        !desk.path().join("runs").exists(),
        "nothing is left of what did not begin"
    );
}
