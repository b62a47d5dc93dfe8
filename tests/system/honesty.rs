//! Success is what the arm has done: controllers that only say so, and tasks that the arm cannot do.

use serde_json::Value;

use crate::command::{Desk, Known, lacks, source};

/// Three links in a horizontal plane, so that an arm without torque stays where it is.
const ARM: &str = r#"
<robot name="three">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="2"/><inertia ixx="0.01" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="fore"><inertial><origin xyz="0.15 0 0"/><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="hand"><inertial><origin xyz="0.1 0 0"/><mass value="0.5"/><inertia ixx="0.005" iyy="0.005" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="tip"/>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="40" velocity="4"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-2.8" upper="2.8" effort="20" velocity="4"/></joint>
  <joint name="wrist" type="revolute"><parent link="fore"/><child link="hand"/><origin xyz="0.3 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-2.8" upper="2.8" effort="10" velocity="6"/></joint>
  <joint name="flange" type="fixed"><parent link="hand"/><child link="tip"/><origin xyz="0.2 0 0"/></joint>
</robot>
"#;

const CONTROLLER: &str = r#"
import math, sys
import armplane
from armplane import wire

HOW, LINKS, BY, LASTS, SETTLE = sys.argv[1], (0.4, 0.3, 0.2), (0.03, -0.04), 0.4, 0.1

def tip(q):
    angles = [sum(q[: i + 1]) for i in range(3)]
    return angles, [sum(l * f(a) for l, a in zip(LINKS, angles)) for f in (math.cos, math.sin)]

class Follower(armplane.Controller):
    def setup(self):
        start = [math.radians(a) for a in self.job["scenario"]["start"]["q_deg"]]
        self.start = tip(start)[1]

    def clock(self, t):
        if HOW == "jumps" and t > 0.003:
            return LASTS
        if HOW == "goes back" and t > 0.2:
            return min(t - 0.1, LASTS)
        if HOW == "no number" and t > 0.1:
            return float("nan")
        if HOW in ("is stuck", "waits for ever"):
            return min(t, 0.19)
        return min(t, LASTS)

    def control(self, tick, estimate, singularity, state, torque):
        t, q, v = tick * self.dt, estimate.q[:3], estimate.qdot[:3]
        angles, place = tip(q)
        u = min(self.clock(t) / LASTS, 1.0) if HOW in ("follows", "does not settle", "is stuck", "waits for ever") else 0.0
        share, rate = u**3 * (10 - 15 * u + 6 * u * u), 30 * u * u * (1 - u) ** 2 / LASTS
        desired = [p + share * by for p, by in zip(self.start, BY)]
        # J has the columns [-sum of l*sin, sum of l*cos] of the links from each joint on.
        columns = [
            (-sum(l * math.sin(a) for l, a in zip(LINKS[i:], angles[i:])), sum(l * math.cos(a) for l, a in zip(LINKS[i:], angles[i:])))
            for i in range(3)
        ]
        speed = [sum(columns[j][i] * v[j] for j in range(3)) for i in range(2)]
        force = [20000 * (desired[i] - place[i]) + 400 * (rate * BY[i] - speed[i]) for i in range(2)]
        torque.tau[:3] = [sum(c * f for c, f in zip(columns[j], force)) - 0.2 * v[j] for j in range(3)]
        ends = {"ends at once": 0.003, "does not settle": LASTS + 0.01}.get(HOW, LASTS + SETTLE)
        torque.phase = wire.PHASE_DONE if t >= ends and HOW != "waits for ever" else wire.PHASE_RUNNING
        shown = place if HOW != "follows" else desired
        state.p_BE_d[:2], state.R_BE_d[:] = shown, estimate_rotation(angles[-1])
        state.path_time_s, state.time_scale, state.null_scale, state.task_scale = self.clock(t), 1.0, 1.0, 1.0
        state.beta[:] = [1.0] * 4

def estimate_rotation(angle):
    c, s = math.cos(angle), math.sin(angle)
    return [c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0]

Follower.run()
"#;

#[test]
fn only_the_controller_that_follows_the_path_has_reached_the_goal() {
    if lacks("") {
        return;
    }
    let (bent, stretched) = ("[20, 40, 50]", "[0, 0, 0]");
    let line = "by_m = [0.03, -0.04, 0.0]";
    let inwards = "by_m = [-0.05, 0.0, 0.0]\npath = \"there-and-back\"";
    let desk = Desk::new();
    desk.file("arm.urdf", ARM);
    let task = "default_frame = \"tip\"\nlength_m = 0.4\ntask = [\"x\", \"y\"]\n";
    desk.file("arm.toml", task);
    desk.file("controller.py", CONTROLLER);
    let lies = [
        "holds still",
        "ends at once",
        "does not settle",
        "is stuck",
        "waits for ever",
        "jumps",
        "goes back",
        "no number",
    ];
    let cases = lies.map(|how| (how, bent, line));
    for (how, start, segment) in cases
        .into_iter()
        .chain([("holds still", stretched, inwards), ("follows", bent, line)])
    {
        desk.file(
            "line.toml",
            format!(
                "name = \"line\"\nrobot = \"arm.urdf\"\ngraph = \"graph.toml\"\nsettle_s = 0.1\n\
                 [start]\nq_deg = {start}\n[[segment]]\n{segment}\nduration_s = 0.4\n"
            ),
        );
        desk.file(
            "graph.toml",
            format!(
                "extends = \"armplane\"\n[[process]]\nname = \"controller\"\ncommand = [\"python3\", \"controller.py\", \"{how}\"]\n\
                 reads = [\"estimate\", \"singularity\"]\nwrites = [\"control_state\", \"torque\"]\n"
            ),
        );
        let said = desk.armplane("run line.toml --json");
        let is_reached = said.json()["outcome"] == "goal reached";
        let code = i32::from(how != "follows");
        assert_eq!(
            (said.code, is_reached),
            (code, code == 0),
            "{how}: {}",
            said.err
        );
    }
}

/// Runs a task of one segment, or of several; it ends with this exit code, and a sentence that has this word.
fn ends(desk: &Desk, [robot, start, segments]: [&str; 3], code: i32, word: &str) -> Option<Value> {
    let text = format!(
        "name = \"task\"\nrobot = \"{robot}\"\n[start]\n{start}\n[[segment]]\n{segments}\n"
    );
    desk.file("task.toml", text);
    let said = desk.refuses(code, "run task.toml --json", word);
    (code == 0).then(|| said.json())
}

const PUMA: &str = "q = [0.3, -0.8, 2.9, 0.2, 0.5, 0.1]";

/// What no motion of the arm can do is refused before the start, with the axis or the reason named; what it can, is done.
#[test]
fn a_goal_that_the_task_does_not_serve_is_refused() {
    let desk = Desk::new();
    let (bent, lock) = (
        "posture = \"bent\"",
        "reorient = { singularity = \"wrist\", by_deg = 30 }",
    );
    for (robot, start, segment, code, word) in [
        (
            "planar3r",
            bent,
            "turn = { about = \"z\", by_deg = 60 }",
            2,
            " z,",
        ),
        ("planar3r", bent, "by_m = [0.1, 0.0, 0.3]", 2, " z,"),
        ("planar3r", bent, "by_m = [0.1, 0.1, 0.0]", 0, ""),
        ("puma560", PUMA, lock, 2, "segment 0 "),
    ] {
        let segment = format!("{segment}\nduration_s = 1.0");
        ends(&desk, [robot, start, &segment], code, word);
    }
}

/// The position of a frame far from the wrist centre, of a task that leaves the rotations free: the arms of the case that was 30 mm off.
#[test]
fn a_task_of_positions_alone_moves_the_point_that_it_names() {
    let desk = Desk::new();
    let flange = format!("frame = \"flange\"\n[start]\n{PUMA}");
    for (robot, start) in [
        ("puma560", &*flange),
        ("ur5", "[start]\nq_deg = [20, -70, 80, -40, -90, 0]"),
        ("iiwa14", "[start]\nq_deg = [0, 30, 0, -80, 0, 60, 0]"),
    ] {
        let [urdf, toml] =
            ["urdf", "toml"].map(|end| source(&format!("services/model/robots/{robot}.{end}")));
        let free = toml
            .lines()
            .filter(|line| !line.starts_with("task"))
            .collect::<Vec<_>>();
        desk.file("arm.urdf", urdf);
        desk.file(
            "arm.toml",
            format!("task = [\"x\", \"y\", \"z\"]\n{}", free.join("\n")),
        );
        desk.file(
            "point.toml",
            format!("name = \"point\"\nrobot = \"arm.urdf\"\n{start}\n[[segment]]\nby_m = [0.1, 0.1, 0.1]\nduration_s = 2.0\n"),
        );
        let off_mm = desk.run("point.toml")["task"]["final_position_mm"].number();
        assert!(off_mm < 1.0, "{robot}: {off_mm} mm");
    }
}

/// A leg in less time than the arm needs is followed as slowly as it must be, at the start and after another leg; one of a tick is refused.
#[test]
fn a_leg_that_is_too_short_is_stretched_or_refused() {
    let desk = Desk::new();
    let there = "by_m = [0.1, 0.1, 0.05]\nduration_s = ";
    let first = "by_m = [-0.05, -0.05, -0.05]\nduration_s = 1.0\n[[segment]]\n";
    for (legs, code) in [
        (format!("{there}0.001"), 2),
        (format!("{there}0.01"), 0),
        (format!("{there}0.05"), 0),
        (format!("{first}{there}0.02"), 0),
    ] {
        if let Some(summary) = ends(&desk, ["puma560", PUMA, &legs], code, "") {
            let [off_mm, stretch] =
                ["position_max_mm", "time_stretch"].map(|key| summary["task"][key].number());
            assert!(off_mm < 0.2 && stretch > 1.2, "{legs}: {off_mm} {stretch}");
        }
    }
}

/// A hold where two directions are lost: noise neither slows its clock nor changes its modes.
#[test]
fn a_hold_in_a_double_lock_is_calm() {
    let start = "q = [0.3, -1.2, 0.0, -1.0, 0.0, 0.2]";
    let noisy = "duration_s = 3.0\n[plant]\nencoder_noise_counts = 2.0";
    let summary = ends(&Desk::new(), ["ur5", start, noisy], 0, "").unwrap();
    assert!(
        summary["joints"]["switches"].count() < 10
            && summary["task"]["time_stretch"].number() < 1.05,
        "{summary}"
    );
}

/// Three passes of the wrist's lock: the third has no planned route, which is said, and the plan of the first two is kept.
#[test]
fn legs_before_one_without_a_route_stay_planned() {
    let near = "to_m = [-0.5320221895, -0.3581739325, 0.4529399762]\nrotation = [[0.44753433370, 0.77799976155, 0.44094148273], \
                [0.53793751911, 0.15968108681, -0.82772288602], [-0.71437822313, 0.60763337758, -0.34705249281]]\nduration_s = 2.0\n";
    let far = "to_m = [-0.5597983321, -0.3667661003, 0.5100648165]\nrotation = [[0.67310839583, 0.73227363540, 0.10344278786], \
               [-0.19128210001, 0.30750122169, -0.93212346654], [-0.71437822313, 0.60763337758, 0.34705249281]]\nduration_s = 2.0\n";
    let robot = "ur5\"\nframe = \"tool0";
    let start = "q = [0.3, -1.2, 1.1, -1.0, 0.4, 0.2]";
    let legs = [near, far, near].join("[[segment]]\n");
    let summary = ends(&Desk::new(), [robot, start, &legs], 0, "").unwrap();
    assert!(
        summary["task"]["orthogonal_max_mm"].number() < 1.0,
        "{summary}"
    );
}

/// Positions of a joint that slides are metres in files and millimetres in sentences; degrees do not fit it.
#[test]
fn a_joint_that_slides_has_no_degrees() {
    let joint = |name: &str, kind: &str, links: [&str; 2], at: &str, axis: &str, limit: &str| {
        format!(
            "<link name=\"{}\"><inertial><mass value=\"2\"/><inertia ixx=\"0.01\" iyy=\"0.02\" izz=\"0.02\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial></link>\
             <joint name=\"{name}\" type=\"{kind}\"><parent link=\"{}\"/><child link=\"{}\"/><origin xyz=\"{at}\"/><axis xyz=\"0 0 {axis}\"/><limit {limit}/></joint>",
            links[1], links[0], links[1]
        )
    };
    let turns = "lower=\"-2.6\" upper=\"2.6\" effort=\"80\" velocity=\"5\"";
    let slides = "lower=\"0\" upper=\"0.3\" effort=\"150\" velocity=\"1\"";
    let arm = [
        joint("j1", "revolute", ["base", "l1"], "0 0 0.5", "1", turns),
        joint("j2", "revolute", ["l1", "l2"], "0.4 0 0", "1", turns),
        joint("j3", "prismatic", ["l2", "l3"], "0.3 0 0", "-1", slides),
        joint("j4", "revolute", ["l3", "l4"], "0 0 0", "-1", turns),
    ];
    let desk = Desk::new();
    let urdf = format!(
        "<robot name=\"scara\"><link name=\"base\"/>{}</robot>",
        arm.concat()
    );
    desk.file("arm.urdf", urdf);
    desk.file("arm.toml", "task = [\"x\", \"y\", \"z\", \"rz\"]\n");
    let start = "q = [0.3, 0.8, 0.1, 0.5]";
    for (start, down, code, word) in [
        (start, -0.25, 2, "300.0 mm"),
        ("q_deg = [20, 40, 5, 30]", -0.1, 2, "'j3'"),
        (
            "q = [0.3, 0.8, 0.1, 0.5]\nq_deg = [0, 0, 0, 0]",
            -0.1,
            2,
            "q_deg,",
        ),
        (start, -0.1, 0, ""),
    ] {
        let segment = format!("by_m = [0, 0, {down}]\nduration_s = 1.0");
        if let Some(summary) = ends(&desk, ["arm.urdf", start, &segment], code, word) {
            summary.holds(r#"{"joints/units/2": "m"}"#);
        }
    }
    let shown = desk.succeeds("inspect --robot arm.urdf --q=0.3,0.8,0.1,0.5");
    let table = shown.out.replace('\u{a0}', " ");
    for cell in ["100.00 mm", "-39.2 N "] {
        assert!(table.contains(cell), "{table}");
    }
}

#[test]
fn a_wrong_mass_leaves_the_path_by_less_than_a_millimetre() {
    let desk = Desk::new();
    for scenario in ["ur5-wrist", "seven-joints", "iiwa-posture", "fr3-wrist"] {
        for mass in ["0.7", "1.3"] {
            let set = format!("--no-record --set plant.mass_factor={mass}");
            let summary = desk.run(&format!("{scenario} {set}"));
            let off_mm = summary["task"]["orthogonal_max_mm"].number();
            assert!(off_mm <= 1.0, "{scenario} with {mass}: {off_mm} mm");
        }
    }
}
