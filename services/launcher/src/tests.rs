//! The launcher and the runtime together, on real processes: this test binary, started again in the role that its environment names.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use message_log::TopicHash;
use runtime::{Mode, Process, ProcessError, SHM, Shell};
use rustix::process::{Pid, Signal, kill_process};
use shared_types::{SensorSample, StateEstimate, TorqueCommand};

use crate::{Child, End, Event, Exit, LaunchError, Launcher, Limits, Outcome, Plan, Restart};

mod clearing;

const ROLE: &str = "ARMPLANE_TEST_ROLE";
const RUN: &str = "ARMPLANE_TEST_RUN";
const TICKS: &str = "ARMPLANE_TEST_TICKS";

/// Not a test of its own: the children of the other tests begin here.
#[test]
#[ignore = "the other tests start it in processes of their own"]
fn child_entry() {
    let role = std::env::var(ROLE).expect("started by another test");
    let run = PathBuf::from(std::env::var_os(RUN).unwrap_or_default());
    let ticks = std::env::var(TICKS).map_or(0, |n| n.parse().unwrap());
    let played = match role.as_str() {
        "plant" => plant(&run, ticks),
        "controller" => controller(&run),
        "controller-that-opens-less" => controller(&run),
        "estimator" => slow_estimator(&run),
        "recorder" => recorder(&run, &run.join("recorded")),
        _ => panic!("no role {role}"),
    };
    match played {
        Ok(()) => std::process::exit(0),
        Err(error) => {
            eprintln!("{error}");
            std::process::exit(1)
        }
    }
}

fn plant(run: &Path, ticks: u64) -> Result<(), ProcessError> {
    let shell = Shell::open(run, "plant")?;
    let mut sensors = shell.writer::<SensorSample>()?;
    let mut torques = shell.reader::<TorqueCommand>()?;
    let mut tick_source = shell.tick_source(0);
    let mut state = 0.0;
    while let Some(tick) = tick_source.next()? {
        let mut sample = SensorSample::default();
        sample.header.tick = tick;
        sample.q_encoder[0] = state;
        sensors.send(sample)?;
        match torques.arriving(tick, tick_source.deadline_ns())? {
            Some(torque) => state += torque.tau[0],
            None if shell.is_stopping() => break,
            None => state += 1e3,
        }
        if tick + 1 == ticks {
            break;
        }
    }
    Ok(tick_source.finish()?)
}

fn controller(run: &Path) -> Result<(), ProcessError> {
    let shell = Shell::open(run, "controller")?;
    let mut sensors = shell.reader::<SensorSample>()?;
    let mut torques = shell.writer::<TorqueCommand>()?;
    while let Some(sample) = sensors.next()? {
        let mut torque = TorqueCommand::default();
        torque.header.tick = sample.header.tick;
        torque.tau[0] = (sample.q_encoder[0] * 1e-3).sin() + 1e-3;
        torques.send(torque)?;
    }
    Ok(())
}

/// Answers each tick, later than the controller does.
fn slow_estimator(run: &Path) -> Result<(), ProcessError> {
    let shell = Shell::open(run, "estimator")?;
    let mut sensors = shell.reader::<SensorSample>()?;
    let mut estimates = shell.writer::<StateEstimate>()?;
    while let Some(sample) = sensors.next()? {
        let mut estimate = StateEstimate::default();
        estimate.header.tick = sample.header.tick;
        std::thread::sleep(Duration::from_micros(500));
        estimates.send(estimate)?;
    }
    Ok(())
}

/// Takes everything in, checks order and completeness, and writes down what it had.
fn recorder(run: &Path, file: &Path) -> Result<(), ProcessError> {
    let shell = Shell::open(run, "recorder")?;
    let mut sensors = shell.collector::<SensorSample>()?;
    let mut torques = shell.collector::<TorqueCommand>()?;
    let (mut sensor_hash, mut torque_hash) = (TopicHash::default(), TopicHash::default());
    let mut stamps_in_order = true;
    while shell.poll(Duration::from_micros(500))? {
        sensors.collect(|m| sensor_hash.add(m))?;
        torques.collect(|m| {
            let (received, sent) = (m.header.stamps.received_ns, m.header.stamps.sent_ns);
            stamps_in_order &= sent[0] > 0 && sent[0] <= received[1] && received[1] <= sent[1];
            torque_hash.add(m);
        })?;
    }
    assert!(stamps_in_order, "a torque that was sent before its sample");
    let lost = sensors.lost() + torques.lost();
    let (sensor, torque) = (sensor_hash.summary(), torque_hash.summary());
    let text = format!(
        "{} {} {} {} {lost}",
        sensor.count, sensor.hash, torque.count, torque.hash
    );
    // The run's directory is removed at the end: the test reads what was said on standard error.
    eprintln!("recorded {text}");
    std::fs::write(file, text).expect("the run's directory is writable");
    Ok(())
}

fn process(name: &str, reads: &[&str], writes: &[&str], polled: bool) -> Process {
    let own = |names: &[&str]| names.iter().map(ToString::to_string).collect();
    let hop = ["plant", "controller"].iter().position(|hop| *hop == name);
    Process {
        name: name.into(),
        reads: own(reads),
        writes: own(writes),
        polled,
        makes_ticks: name == "plant",
        hop,
        ..Process::default()
    }
}

fn plan(mode: Mode, restart: Restart) -> Plan {
    let child = |process, ends_run, restart| Child {
        process,
        ends_run,
        restart,
    };
    Plan {
        mode,
        rate_hz: 1000,
        limits: Limits {
            stop: Duration::from_secs(5),
            ..Limits::of(mode)
        },
        faults: Vec::new(),
        messages: Vec::new(),
        children: vec![
            child(
                process("plant", &["torque"], &["sensor"], false),
                true,
                Restart::Never,
            ),
            child(
                process("controller", &["sensor"], &["torque"], false),
                false,
                restart,
            ),
            child(
                process("recorder", &["sensor", "torque"], &[], true),
                false,
                Restart::Never,
            ),
        ],
    }
}

/// This test binary in a role; `controller` is the role that the process of that name plays.
fn command(
    controller: &'static str,
    ticks: u64,
) -> impl Fn(&str, &Path) -> std::io::Result<Command> {
    move |name, run| {
        let mut command = role(if name == "controller" {
            controller
        } else {
            name
        });
        command.env(RUN, run).env(TICKS, ticks.to_string());
        Ok(command)
    }
}

fn role(role: &str) -> Command {
    let mut command = Command::new(std::env::current_exe().unwrap());
    command
        .args([
            "tests::child_entry",
            "--exact",
            "--ignored",
            "--nocapture",
            "--test-threads=1",
        ])
        .env(ROLE, role);
    command
}

/// The result of a run.
struct Ran {
    name: String,
    outcome: Outcome,
    /// The recorder's report: sensor count, sensor hash, torque count, torque hash, lost.
    recorded: Vec<String>,
}

/// Runs a plan; `at` is told each event, with the name of the run.
fn run(
    plan: Plan,
    controller: &'static str,
    ticks: u64,
    mut at: impl FnMut(&str, &Event<'_>),
) -> Ran {
    let launcher = Launcher::prepare(plan).unwrap();
    let name = launcher.run_dir().file_name().unwrap();
    let name = name.to_str().unwrap().to_owned();
    let mut recorded = Vec::new();
    let mut report = |event: Event<'_>| {
        at(&name, &event);
        if let Event::Line { line, .. } = event
            && let Some(fields) = line.strip_prefix("recorded ")
        {
            recorded = fields.split(' ').map(str::to_owned).collect();
        }
    };
    let outcome = launcher.run(&command(controller, ticks), &mut report);
    Ran {
        outcome: outcome.unwrap(),
        recorded,
        name,
    }
}

fn lockstep() -> Plan {
    plan(Mode::Lockstep, Restart::Never)
}

fn budget(times: u32) -> Restart {
    Restart::Budget {
        times,
        back_off: Duration::from_millis(1),
    }
}

fn kill(run: &str, role: &str, signal: Signal) {
    kill_process(pid_of(run, role).unwrap(), signal).unwrap();
}

fn is_left_behind(name: &str) -> bool {
    std::fs::read_dir(SHM).unwrap().flatten().any(|entry| {
        entry
            .file_name()
            .to_str()
            .is_some_and(|file| file.starts_with(name))
    })
}

/// The process of that name in a run, found by its environment as the kernel shows it.
fn pid_of(run: &str, role: &str) -> Option<Pid> {
    std::fs::read_dir("/proc")
        .ok()?
        .flatten()
        .find_map(|entry| {
            let pid: i32 = entry.file_name().to_str()?.parse().ok()?;
            let environment = std::fs::read(entry.path().join("environ")).ok()?;
            let has = |key: &str, value: &str| {
                environment
                    .split(|&b| b == 0)
                    .any(|one| one == format!("{key}={value}").as_bytes())
            };
            (has(RUN, &format!("{SHM}/{run}")) && has(ROLE, role))
                .then(|| Pid::from_raw(pid))
                .flatten()
        })
}

#[test]
fn a_process_whose_reader_never_opens_its_topic_is_waited_for() {
    let mut plan = lockstep();
    plan.children[1].process.reads.push("estimate".into());
    let estimator = Child {
        process: process("estimator", &["sensor"], &["estimate"], false),
        ..plan.children[1].clone()
    };
    plan.children.insert(1, estimator);
    let outcome = run(plan, "controller-that-opens-less", 1_000, |_, _| {}).outcome;
    assert_eq!(outcome.end, End::Completed);
    let counts = outcome.processes.iter().map(|one| one.counts);
    let sent: Vec<_> = counts.map(|counts| (counts.sent, counts.lost)).collect();
    assert_eq!(sent, [(1_000, 0), (1_000, 0), (1_000, 0), (0, 0)]);
}

#[test]
fn a_limit_on_silence_limits_the_start_too_but_where_a_person_starts_a_program() {
    let limits = Limits::of(Mode::Lockstep);
    let start = |limits: Limits, seconds| {
        limits
            .with_silence(Some(Duration::from_secs(seconds)))
            .start
    };
    assert_eq!(
        (limits.start, start(limits, 1), start(limits, 60)),
        (
            None,
            Some(Duration::from_secs(20)),
            Some(Duration::from_secs(60))
        )
    );
    assert_eq!(
        start(
            Limits {
                awaits_person: true,
                ..limits
            },
            1
        ),
        None
    );
}

#[test]
fn a_program_that_does_not_exist_stops_everything_before_the_first_tick() {
    let launcher = Launcher::prepare(lockstep()).unwrap();
    let name = launcher.run_dir().file_name().unwrap();
    let name = name.to_str().unwrap().to_owned();
    let missing = |name: &str, run: &Path| match name {
        "recorder" => Ok(Command::new("/does/not/exist")),
        _ => command("controller", 1)(name, run),
    };
    let error = launcher.run(&missing, &mut |_| {}).unwrap_err();
    assert!(
        matches!(&error, LaunchError::Spawn { process, .. } if process == "recorder"),
        "{error}"
    );
    assert!(!is_left_behind(&name) && pid_of(&name, "plant").is_none());
}

#[test]
fn a_recorder_that_is_killed_while_the_plant_ends_is_replaced() {
    let wait_for_death = |pid: Pid| {
        let is_alive = || {
            let stat = std::fs::read_to_string(format!("/proc/{}/stat", pid.as_raw_nonzero()));
            let state = stat.as_deref().unwrap_or_default().rsplit_once(") ");
            state.is_some_and(|(_, rest)| !rest.starts_with('Z'))
        };
        while is_alive() {
            std::thread::sleep(Duration::from_millis(1));
        }
    };
    let mut plan = lockstep();
    plan.children[2].restart = Restart::Budget {
        times: 1,
        back_off: Duration::ZERO,
    };
    let mut pids = None;
    let ran = run(plan, "controller", 2_000, |run, event| match event {
        Event::Go => {
            pids = Some(["plant", "recorder"].map(|role| pid_of(run, role).unwrap()));
        }
        Event::Progress { ticks: 2_000.. } => {
            // Both are dead when the launcher looks at its children next.
            if let Some([plant, recorder]) = pids.take() {
                wait_for_death(plant);
                kill_process(recorder, Signal::KILL).unwrap();
                wait_for_death(recorder);
            }
        }
        _ => {}
    });
    assert_eq!(ran.outcome.end, End::Completed, "{:?}", ran.outcome);
    let recorder = &ran.outcome.processes[2];
    assert_eq!((recorder.restarts, recorder.exit), (1, Exit::Code(0)));
    assert!(!is_left_behind(&ran.name));
}

#[test]
fn a_stopped_recorder_costs_the_chain_nothing_in_real_time_and_its_losses_are_counted() {
    let mut plan = plan(Mode::Realtime, Restart::Never);
    plan.rate_hz = 4_000;
    let mut is_stopped = false;
    let ran = run(plan, "controller", 4_000, |run, event| match event {
        Event::Progress { .. } if !is_stopped => {
            kill(run, "recorder", Signal::STOP);
            is_stopped = true;
        }
        // By now the plant has done all its ticks beside a recorder that took nothing in.
        Event::Stopping => kill(run, "recorder", Signal::CONT),
        _ => {}
    });
    let outcome = &ran.outcome;
    assert_eq!(
        (&outcome.end, outcome.ticks),
        (&End::Completed, 4_000),
        "{outcome:?}"
    );
    let [sensors, torques, lost] = [0, 2, 4].map(|i| ran.recorded[i].parse::<u64>().unwrap());
    assert!(lost > 0 && lost == outcome.processes[2].counts.lost);
    assert!(sensors + torques + lost <= 8_000, "{:?}", ran.recorded);
}
