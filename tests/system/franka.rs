//! A Franka arm behind its control interface as the plant: the simulator `franka-sim`, where it is installed.
//!
//! `ARMPLANE_FRANKA_PYTHON` names a Python that has it (`docs/franka.md`); `python3` is asked otherwise.

use std::net::{TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use serde_json::Value;

use crate::command::{Desk, Known, assert_nothing_left, finish, skipped, until};

/// A second up and a second down, from the posture that the simulator starts in.
const LINE: &str = "name = \"line\"\nrobot = \"fr3\"\nsettle_s = 0.3\n[start]\nq_deg = [2, 0, 0, -90, 0, 90, 45]\n[estimator]\n\
    disturbance_bandwidth = 30.0\n[control]\ncompensate_disturbance = true\n[[segment]]\nby_m = [0.0, 0.0, 0.04]\npath = \"there-and-back\"\n\
    duration_s = 2.0\n";

fn python() -> String {
    std::env::var("ARMPLANE_FRANKA_PYTHON").unwrap_or_else(|_| "python3".to_owned())
}

fn simulator(args: &[&str]) -> Command {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/franka/simulator.py");
    let mut command = Command::new(python());
    command
        .arg(script)
        .args(args)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command
}

/// The part that is not here: the client in this build, the simulator on this machine.
fn missing(desk: &Desk) -> Option<&'static str> {
    let said = desk.armplane("run fr3-wrist --plant fci://127.0.0.1:9");
    if said.err.contains("built without") {
        return Some("armplane is built without Franka's control interface (--features fci)");
    }
    let installed = simulator(&["--check"])
        .status()
        .is_ok_and(|status| status.success());
    (!installed).then_some("franka-sim is not installed (docs/franka.md; ARMPLANE_FRANKA_PYTHON names a Python that has it)")
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
            "--port",
            &port.to_string(),
        ];
        let process = simulator(&options)
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
    let said = desk.armplane(&[
        "run",
        "line.toml",
        "--plant",
        &simulator.address,
        "--out",
        "out",
        "--json",
    ]);
    assert_nothing_left(said.launcher);
    assert_eq!(said.code, 0, "{}\n{}", said.out, said.err);
    let summary = said.json();
    assert_eq!(
        (&summary["outcome"], &summary["mode"]),
        (&"goal reached".into(), &"realtime".into()),
        "{}",
        said.err
    );
    assert!(summary["ticks"].count() >= 2300, "{summary}");
    assert!(
        summary["task"]["position_max_mm"].number() < 1.0,
        "{}",
        summary["task"]
    );
    assert!(said.err.contains("of the commands in time"), "{}", said.err);
    // The arm is the robot's own: its URDF has other names than the built-in one.
    let urdf = std::fs::read_to_string(desk.path().join("out/robot.urdf"))
        .expect("the robot's URDF is kept");
    assert!(urdf.contains("\"joint1\"") && desk.path().join("out/run.rrd").exists());
    // The clock of the robot does not run in lockstep.
    desk.refuses(
        2,
        &[
            "run",
            "line.toml",
            "--plant",
            &simulator.address,
            "--mode",
            "lockstep",
        ],
        &["real time"],
    );
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
        &LINE.replace("duration_s = 2.0", "duration_s = 60.0"),
    );
    let run = desk.start(&[
        "run",
        "line.toml",
        "--plant",
        &simulator.address,
        "--out",
        "out",
        "--json",
    ]);
    until("a hundred ticks", || crate::patience::ticks(&run) > 100);
    simulator
        .process
        .kill()
        .expect("the simulator can be ended");
    let said = finish(run);
    assert_nothing_left(said.launcher);
    assert_eq!(said.code, 1, "{}", said.err);
    assert!(said.err.contains("is lost at tick"), "{}", said.err);
    let kept: Value = desk.read_json("out/summary.json");
    assert!(
        kept["reason"].text().contains("is lost at tick"),
        "{}",
        kept["reason"]
    );
    assert!(
        kept["faults"]
            .list()
            .iter()
            .any(|fault| fault["process"] == "plant"),
        "{}",
        kept["faults"]
    );
}

#[test]
fn a_robot_that_does_not_answer_is_refused_before_anything_starts() {
    let desk = Desk::new();
    for (address, expected) in [
        ("fci://127.0.0.1:9", "fci"),
        ("127.0.0.1", "is no address of a robot"),
        ("fci://", "is no address of a robot"),
    ] {
        let said = desk.armplane(&format!("run fr3-wrist --plant {address}"));
        assert_nothing_left(said.launcher);
        assert!(
            said.code != 0 && said.err.contains(expected) && !said.err.contains("panicked"),
            "{address}: {}",
            said.err
        );
        assert!(
            !desk.path().join("runs/fr3-wrist-001").exists(),
            "a folder without results"
        );
    }
}
