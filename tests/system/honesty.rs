//! Success is what the arm has done, whatever a controller says.

use crate::command::{Desk, lacks};

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
