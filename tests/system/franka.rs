//! A Franka arm behind its control interface as the plant: the simulator `franka-sim`, where it is installed.
//!
//! `ARMPLANE_FRANKA_PYTHON` names a Python that has it (`docs/franka.md`); `python3` is asked otherwise.

use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};

use crate::command::{Desk, Known, Running, root, skipped, until};

/// A second up and a second down, from the posture that the simulator starts in.
const LINE: &str = "name = \"line\"\nrobot = \"fr3\"\nsettle_s = 0.3\n[start]\nq_deg = [2, 0, 0, -90, 0, 90, 45]\n[estimator]\n\
    disturbance_bandwidth = 30.0\n[control]\ncompensate_disturbance = true\n[[segment]]\nby_m = [0.0, 0.0, 0.04]\npath = \"there-and-back\"\n\
    duration_s = 2.0\n";

fn python() -> String {
    std::env::var("ARMPLANE_FRANKA_PYTHON").unwrap_or_else(|_| "python3".to_owned())
}

fn simulator(args: &[&str]) -> Command {
    let mut command = Command::new(python());
    let null = Stdio::null;
    command
        .arg(root().join("examples/franka/simulator.py"))
        .args(args);
    command.stdin(null()).stdout(null()).stderr(null());
    command
}

/// The part that is not here: the client in this build, the simulator on this machine.
fn missing(desk: &Desk) -> Option<&'static str> {
    let said = desk.armplane("run fr3-wrist --plant fci://127.0.0.1:9");
    if said.err.contains("--features fci") {
        return Some("armplane is built without Franka's control interface (--features fci)");
    }
    let checked = simulator(&["--check"]).status();
    let is_installed = checked.is_ok_and(|status| status.success());
    (!is_installed).then_some("franka-sim is not installed (docs/franka.md; ARMPLANE_FRANKA_PYTHON names a Python that has it)")
}

/// A simulator on a port of its own, ended with the value.
struct Simulator {
    process: Child,
    address: String,
}

impl Simulator {
    /// Its temporary files are in the desk's folder.
    fn start(desk: &Desk) -> Self {
        let port = TcpListener::bind("127.0.0.1:0")
            .and_then(|socket| socket.local_addr())
            .expect("a free port")
            .port();
        let options = [
            "--no-gripper",
            "--enforce-motion-limits",
            "--enforce-comm-constraints",
        ];
        let process = simulator(&options)
            .args(["--port", &port.to_string()])
            .env("TMPDIR", desk.path())
            .spawn()
            .expect("the simulator starts");
        until("the simulator", || {
            TcpStream::connect(("127.0.0.1", port)).is_ok()
        });
        Self {
            process,
            address: format!("fci://127.0.0.1:{port}"),
        }
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

#[test]
fn an_arm_behind_its_control_interface_is_the_plant() {
    let desk = Desk::new();
    if let Some(why) = missing(&desk) {
        return skipped(why);
    }
    let simulator = Simulator::start(&desk);
    desk.file("line.toml", LINE);
    let args = format!(
        "run line.toml --plant {} --out out --json",
        simulator.address
    );
    let said = desk.succeeds(&args);
    let summary = said.json();
    summary.holds(r#"{"outcome": "goal reached", "mode": "realtime"}"#);
    assert!(summary["ticks"].count() >= 2300, "{summary}");
    assert!(
        summary["task"]["position_max_mm"].number() < 1.0,
        "{summary}"
    );
    assert!(said.err.contains(" % "), "{}", said.err);
    // The arm is the robot's own: its URDF has other names than the built-in one.
    assert!(desk.read("out/robot.urdf").contains("\"joint1\"") && desk.has("out/run.rrd"));
    // The clock of the robot does not run in lockstep.
    desk.refuses(2, &format!("{args} --mode lockstep"), "--mode realtime");
}

#[test]
fn a_robot_that_is_lost_ends_the_run_in_words() {
    let desk = Desk::new();
    if let Some(why) = missing(&desk) {
        return skipped(why);
    }
    let mut simulator = Simulator::start(&desk);
    desk.file(
        "line.toml",
        LINE.replace("duration_s = 2.0", "duration_s = 60.0"),
    );
    let run = desk.begin(&format!(
        "run line.toml --plant {} --out out --json",
        simulator.address
    ));
    simulator
        .process
        .kill()
        .expect("the simulator can be ended");
    let said = run.finish();
    assert_eq!(said.code, 1, "{}", said.err);
    let kept = desk.read_json("out/summary.json");
    for text in [&*said.err, kept["reason"].text()] {
        assert!(text.contains(&simulator.address), "{text}");
    }
    let mut faults = kept["faults"].list().iter();
    assert!(faults.any(|fault| fault["process"] == "plant"), "{kept}");
}

#[test]
fn a_robot_that_does_not_answer_is_refused_before_anything_starts() {
    let desk = Desk::new();
    for (address, expected) in [("fci://127.0.0.1:9", "fci"), ("127.0.0.1", "fci://")] {
        let said = desk.armplane(&format!("run fr3-wrist --plant {address}"));
        assert!(
            said.code != 0 && said.err.contains(expected) && !said.err.contains("panicked"),
            "{address}: {}",
            said.err
        );
        assert!(!desk.has("runs/fr3-wrist-001"), "a folder without results");
    }
}
