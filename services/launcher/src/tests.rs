//! The launcher and the runtime together, on real processes: this test binary, started again in the role that its environment names.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::mpsc::channel;
use std::time::Duration;

use message_log::TopicHash;
use runtime::{Mode, Process, ProcessError, RunDir, SHM, Shell};
use rustix::process::{Pid, Signal, kill_process};
use shared_types::{SensorSample, StateEstimate, TorqueCommand};

use crate::{
    Child, End, Event, Exit, Failure, LaunchError, Launcher, Limits, Outcome, Plan, Restart,
};

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
        "controller" => controller(&run, u64::MAX),
        "controller-that-fails" => controller(&run, 100),
        "controller-that-hangs" => hang(&run),
        "controller-that-keeps-silent" => keep_silent(&run),
        "controller-that-never-starts" => std::process::exit(7),
        "controller-that-opens-less" => controller(&run, u64::MAX),
        "estimator" => slow_estimator(&run),
        "recorder" => recorder(&run, &run.join("recorded")),
        "launcher" => launch_and_tell(),
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

fn controller(run: &Path, fails_at: u64) -> Result<(), ProcessError> {
    let shell = Shell::open(run, "controller")?;
    let mut sensors = shell.reader::<SensorSample>()?;
    let mut torques = shell.writer::<TorqueCommand>()?;
    while let Some(sample) = sensors.next()? {
        let mut torque = TorqueCommand::default();
        torque.header.tick = sample.header.tick;
        torque.tau[0] = (sample.q_encoder[0] * 1e-3).sin() + 1e-3;
        if sample.header.tick == fails_at {
            torque.tau[1] = f64::NAN;
        }
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

/// Reads a few samples and then nothing more, and does not stop either.
fn hang(run: &Path) -> Result<(), ProcessError> {
    let shell = Shell::open(run, "controller")?;
    let mut sensors = shell.reader::<SensorSample>()?;
    let _torques = shell.writer::<TorqueCommand>()?;
    sensors.next()?;
    loop {
        std::thread::sleep(Duration::from_secs(1));
    }
}

/// Reads every sample and sends nothing.
fn keep_silent(run: &Path) -> Result<(), ProcessError> {
    let shell = Shell::open(run, "controller")?;
    let mut sensors = shell.reader::<SensorSample>()?;
    let _torques = shell.writer::<TorqueCommand>()?;
    while sensors.next()?.is_some() {}
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

/// A launcher as a process of its own, for signals that only it shall get.
fn launch_and_tell() -> Result<(), ProcessError> {
    let launcher = Launcher::prepare(plan(Mode::Lockstep, Restart::Never)).expect("prepared");
    eprintln!("run {}", launcher.run_dir().display());
    let mut report = |event: Event<'_>| {
        if let Event::Progress { ticks: 1.. } = event {
            eprintln!("going");
        }
    };
    let outcome = launcher
        .run(&command("controller", u64::MAX), &mut report)
        .expect("ran");
    eprintln!("{:?}", outcome.end);
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
    outcome: Result<Outcome, LaunchError>,
    /// The recorder's report, if there is one.
    recorded: Option<String>,
}

fn run(plan: Plan, controller: &'static str, ticks: u64, mut at: impl FnMut(u64)) -> Ran {
    let launcher = Launcher::prepare(plan).unwrap();
    let name = launcher
        .run_dir()
        .file_name()
        .unwrap()
        .to_str()
        .unwrap()
        .to_owned();
    let mut recorded = None;
    let mut report = |event: Event<'_>| match event {
        Event::Progress { ticks } => at(ticks),
        Event::Line {
            process: "recorder",
            line,
        } if line.starts_with("recorded ") => recorded = Some(line["recorded ".len()..].to_owned()),
        _ => {}
    };
    let outcome = launcher.run(&command(controller, ticks), &mut report);
    Ran {
        name,
        outcome,
        recorded,
    }
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

/// `sensor count, sensor hash, torque count, torque hash, lost`
fn fields(recorded: &Option<String>) -> Vec<String> {
    recorded
        .as_ref()
        .expect("the recorder told what it had")
        .split(' ')
        .map(ToOwned::to_owned)
        .collect()
}

#[test]
fn three_processes_pass_ten_thousand_ticks_in_order_and_lose_nothing_twice_the_same() {
    let ran = run(
        plan(Mode::Lockstep, Restart::Never),
        "controller",
        10_000,
        |_| {},
    );
    let outcome = ran.outcome.unwrap();
    assert_eq!(outcome.end, End::Completed);
    assert_eq!(outcome.ticks, 10_000);
    assert!(
        outcome
            .processes
            .iter()
            .all(|p| p.exit == Exit::Code(0) && p.restarts == 0 && p.pid != 0),
        "{outcome:?}"
    );
    let nothing_wrong = |p: &crate::ProcessOutcome| {
        p.counts
            == runtime::Counts {
                sent: p.counts.sent,
                ..runtime::Counts::default()
            }
    };
    assert!(outcome.processes.iter().all(nothing_wrong), "{outcome:?}");
    assert_eq!(
        outcome.processes.iter().map(|p| p.counts.sent).sum::<u64>(),
        20_000
    );
    let first = fields(&ran.recorded);
    assert_eq!(
        (&*first[0], &*first[2], &*first[4]),
        ("10000", "10000", "0")
    );
    assert!(!is_left_behind(&ran.name));
    let again = run(
        plan(Mode::Lockstep, Restart::Never),
        "controller",
        10_000,
        |_| {},
    );
    assert_eq!(
        fields(&again.recorded),
        first,
        "the same bytes on every topic"
    );
}

#[test]
fn a_process_whose_reader_never_opens_its_topic_is_waited_for() {
    let mut plan = plan(Mode::Lockstep, Restart::Never);
    plan.children[1].process.reads.push("estimate".into());
    let estimator = process("estimator", &["sensor"], &["estimate"], false);
    plan.children.insert(
        1,
        Child {
            process: estimator,
            ends_run: false,
            restart: Restart::Never,
        },
    );
    let outcome = run(plan, "controller-that-opens-less", 1_000, |_| {})
        .outcome
        .unwrap();
    assert_eq!(outcome.end, End::Completed);
    let sent: Vec<_> = outcome
        .processes
        .iter()
        .map(|process| (process.counts.sent, process.counts.lost))
        .collect();
    assert_eq!(
        sent,
        [(1_000, 0), (1_000, 0), (1_000, 0), (0, 0)],
        "to the last tick"
    );
}

#[test]
fn two_runs_side_by_side_do_not_disturb_each_other() {
    let alone = fields(
        &run(
            plan(Mode::Lockstep, Restart::Never),
            "controller",
            3_000,
            |_| {},
        )
        .recorded,
    );
    let both: Vec<_> = std::thread::scope(|scope| {
        let one = || {
            fields(
                &run(
                    plan(Mode::Lockstep, Restart::Never),
                    "controller",
                    3_000,
                    |_| {},
                )
                .recorded,
            )
        };
        let (a, b) = (scope.spawn(one), scope.spawn(one));
        vec![a.join().unwrap(), b.join().unwrap()]
    });
    assert_eq!(both, [alone.clone(), alone]);
}

#[test]
fn a_killed_process_ends_the_run_with_its_name_and_nothing_is_left() {
    let launcher = Launcher::prepare(plan(Mode::Lockstep, Restart::Never)).unwrap();
    let name = launcher
        .run_dir()
        .file_name()
        .unwrap()
        .to_str()
        .unwrap()
        .to_owned();
    let mut killed = None;
    let mut report = |event: Event<'_>| {
        if let (Event::Progress { ticks: 1.. }, None) = (event, killed) {
            killed = pid_of(&name, "controller");
            kill_process(killed.unwrap(), Signal::KILL).unwrap();
        }
    };
    let outcome = launcher
        .run(&command("controller", u64::MAX), &mut report)
        .unwrap();
    let End::Failed(failure) = &outcome.end else {
        panic!("{outcome:?}")
    };
    let text = failure.to_string();
    assert!(
        text.contains("controller") && text.contains("SIGKILL"),
        "{text}"
    );
    let exits: Vec<_> = outcome.processes.iter().map(|p| p.exit).collect();
    assert_eq!(
        exits,
        [Exit::Code(0), Exit::Signal(9), Exit::Code(0)],
        "the others stopped by themselves"
    );
    assert!(!is_left_behind(&name));
}

#[test]
fn a_number_that_is_not_finite_ends_the_run_and_is_named() {
    let ran = run(
        plan(Mode::Lockstep, Restart::Never),
        "controller-that-fails",
        u64::MAX,
        |_| {},
    );
    let outcome = ran.outcome.unwrap();
    let End::Failed(failure) = &outcome.end else {
        panic!("{outcome:?}")
    };
    let text = failure.to_string();
    assert!(
        text.contains("controller")
            && text.contains("tick 100")
            && text.contains("tau is not finite"),
        "{text}"
    );
    assert_eq!(outcome.processes[1].counts.not_finite, 1);
    // Samples 0 to 100 were sent, torques 0 to 99 answered; the refused one never left.
    let recorded = fields(&ran.recorded);
    assert_eq!((&*recorded[0], &*recorded[2]), ("101", "100"));
}

#[test]
fn a_process_that_hangs_is_named_by_who_waited_and_killed_in_the_end() {
    let mut plan = plan(Mode::Lockstep, Restart::Never);
    plan.limits = Limits {
        wait: Some(Duration::from_millis(300)),
        stop: Duration::from_millis(200),
        ..plan.limits
    };
    let ran = run(plan, "controller-that-hangs", u64::MAX, |_| {});
    let outcome = ran.outcome.unwrap();
    let End::Failed(failure) = &outcome.end else {
        panic!("{outcome:?}")
    };
    let text = failure.to_string();
    assert!(
        text.contains("plant waited") && text.contains("tick 0 of topic \"torque\""),
        "{text}"
    );
    assert!(text.contains("controller was behind"), "{text}");
    assert_eq!(
        outcome.processes[1].exit,
        Exit::Signal(9),
        "it ignored the stop and SIGTERM"
    );
    assert!(!is_left_behind(&ran.name));
}

#[test]
fn a_process_that_asks_for_more_without_an_answer_ends_by_itself_with_the_topic_that_it_owes() {
    for restart in [
        Restart::Never,
        Restart::Budget {
            times: 2,
            back_off: Duration::from_millis(1),
        },
    ] {
        let ran = run(
            plan(Mode::Lockstep, restart),
            "controller-that-keeps-silent",
            1_000,
            |_| {},
        );
        let End::Failed(failure) = ran.outcome.unwrap().end else {
            panic!("the run ended without it")
        };
        let text = failure.to_string();
        assert!(
            text.contains("controller asks for more and has not sent topic \"torque\" of tick "),
            "{text}"
        );
        assert!(!is_left_behind(&ran.name));
    }
}

#[test]
fn a_process_that_answers_nothing_is_replaced_where_the_user_sets_a_limit() {
    let mut plan = plan(
        Mode::Lockstep,
        Restart::Budget {
            times: 1,
            back_off: Duration::from_millis(1),
        },
    );
    plan.limits = Limits {
        stop: Duration::from_millis(200),
        ..plan.limits
    }
    .with_silence(Some(Duration::from_millis(300)));
    let launcher = Launcher::prepare(plan).unwrap();
    let mut silenced = Vec::new();
    let mut report = |event: Event<'_>| {
        if let Event::Silenced {
            process, writes, ..
        } = event
        {
            silenced.push((process.to_owned(), writes.to_vec()));
        }
    };
    let outcome = launcher
        .run(&command("controller-that-hangs", u64::MAX), &mut report)
        .unwrap();
    assert!(
        matches!(&outcome.end, End::Failed(Failure::Died { process, restarts: 1, .. }) if process == "controller"),
        "{outcome:?}"
    );
    assert_eq!(
        silenced,
        [
            ("controller".to_owned(), vec!["torque".to_owned()]),
            ("controller".to_owned(), vec!["torque".to_owned()])
        ]
    );
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
fn a_process_that_cannot_start_stops_everything_before_the_first_tick() {
    let ran = run(
        plan(Mode::Lockstep, Restart::Never),
        "controller-that-never-starts",
        u64::MAX,
        |_| {},
    );
    let End::Failed(Failure::Died {
        process,
        exit: Exit::Code(7),
        tick: 0,
        ..
    }) = &ran.outcome.as_ref().unwrap().end
    else {
        panic!("{:?}", ran.outcome)
    };
    assert_eq!(process, "controller");
    assert!(!is_left_behind(&ran.name) && pid_of(&ran.name, "plant").is_none());

    let launcher = Launcher::prepare(plan(Mode::Lockstep, Restart::Never)).unwrap();
    let name = launcher
        .run_dir()
        .file_name()
        .unwrap()
        .to_str()
        .unwrap()
        .to_owned();
    let missing = |name: &str, run: &Path| {
        if name == "recorder" {
            Ok(Command::new("/does/not/exist"))
        } else {
            command("controller", 1)(name, run)
        }
    };
    let error = launcher.run(&missing, &mut |_| {}).unwrap_err();
    assert!(error.to_string().contains("/does/not/exist"), "{error}");
    assert!(!is_left_behind(&name) && pid_of(&name, "plant").is_none());
}

#[test]
fn a_restart_within_the_budget_goes_on_in_real_time() {
    let back_off = Duration::from_millis(1);
    let launcher =
        Launcher::prepare(plan(Mode::Realtime, Restart::Budget { times: 1, back_off })).unwrap();
    let name = launcher
        .run_dir()
        .file_name()
        .unwrap()
        .to_str()
        .unwrap()
        .to_owned();
    let (mut kills, mut restarts) = (0, Vec::new());
    let mut report = |event: Event<'_>| match event {
        Event::Progress { ticks } if ticks > 50 && kills == 0 => {
            kill_process(pid_of(&name, "controller").unwrap(), Signal::KILL).unwrap();
            kills = 1;
        }
        Event::Restarted {
            process,
            exit,
            incarnation,
            ..
        } => restarts.push((process.to_owned(), exit, incarnation)),
        _ => {}
    };
    let outcome = launcher
        .run(&command("controller", 1_000), &mut report)
        .unwrap();
    assert_eq!(outcome.end, End::Completed, "{outcome:?}");
    assert_eq!(restarts, [("controller".to_owned(), Exit::Signal(9), 2)]);
    assert_eq!(
        (outcome.processes[1].restarts, outcome.processes[1].exit),
        (1, Exit::Code(0))
    );
    assert!(!is_left_behind(&name));
}

#[test]
fn a_recorder_that_is_killed_while_the_plant_ends_is_replaced() {
    let is_dead = |pid: Pid| {
        let stat = std::fs::read_to_string(format!("/proc/{}/stat", pid.as_raw_nonzero()))
            .unwrap_or_default();
        stat.rsplit(')')
            .next()
            .is_none_or(|rest| rest.trim_start().starts_with('Z'))
    };
    let mut plan = plan(Mode::Lockstep, Restart::Never);
    plan.children[2].restart = Restart::Budget {
        times: 1,
        back_off: Duration::ZERO,
    };
    let launcher = Launcher::prepare(plan).unwrap();
    let name = launcher
        .run_dir()
        .file_name()
        .unwrap()
        .to_str()
        .unwrap()
        .to_owned();
    let mut pids = None;
    let mut report = |event: Event<'_>| {
        if event == Event::Go {
            pids = Some((
                pid_of(&name, "plant").unwrap(),
                pid_of(&name, "recorder").unwrap(),
            ));
        }
        if let Event::Progress { ticks: 2_000.. } = event
            && let Some((plant, recorder)) = pids.take()
        {
            // Both are dead when the launcher looks at its children next.
            while !is_dead(plant) {
                std::thread::sleep(Duration::from_millis(1));
            }
            kill_process(recorder, Signal::KILL).unwrap();
            while !is_dead(recorder) {
                std::thread::sleep(Duration::from_millis(1));
            }
        }
    };
    let outcome = launcher
        .run(&command("controller", 2_000), &mut report)
        .unwrap();
    assert_eq!(outcome.end, End::Completed, "{outcome:?}");
    assert_eq!(
        (outcome.processes[2].restarts, outcome.processes[2].exit),
        (1, Exit::Code(0)),
        "{outcome:?}"
    );
    assert!(!is_left_behind(&name));
}

#[test]
fn a_stopped_recorder_costs_the_chain_nothing_in_real_time_and_its_losses_are_counted() {
    let mut plan = plan(Mode::Realtime, Restart::Never);
    plan.rate_hz = 4_000;
    let launcher = Launcher::prepare(plan).unwrap();
    let name = launcher
        .run_dir()
        .file_name()
        .unwrap()
        .to_str()
        .unwrap()
        .to_owned();
    let (mut stopped, mut recorded) = (None, None);
    let mut report = |event: Event<'_>| match event {
        Event::Progress { .. } if stopped.is_none() => {
            stopped = pid_of(&name, "recorder");
            kill_process(stopped.unwrap(), Signal::STOP).unwrap();
        }
        // By now the plant has done all its ticks beside a recorder that took nothing in.
        Event::Stopping => kill_process(stopped.unwrap(), Signal::CONT).unwrap(),
        Event::Line {
            process: "recorder",
            line,
        } if line.starts_with("recorded ") => recorded = Some(line["recorded ".len()..].to_owned()),
        _ => {}
    };
    let outcome = launcher
        .run(&command("controller", 4_000), &mut report)
        .unwrap();
    assert_eq!(
        (&outcome.end, outcome.ticks),
        (&End::Completed, 4_000),
        "{outcome:?}"
    );
    let recorded = fields(&recorded);
    let number = |i: usize| recorded[i].parse::<u64>().unwrap();
    assert!(
        number(4) > 0 && number(4) == outcome.processes[2].counts.lost,
        "{recorded:?}"
    );
    assert!(number(0) + number(2) + number(4) <= 8_000, "{recorded:?}");
}

/// Starts a launcher of its own and waits until it goes; returns it, its run and the rest of its output.
fn independent_launcher() -> (
    std::process::Child,
    String,
    std::sync::mpsc::Receiver<String>,
) {
    use std::io::BufRead;
    let mut launcher = role("launcher")
        .stderr(std::process::Stdio::piped())
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let lines = std::io::BufReader::new(launcher.stderr.take().unwrap()).lines();
    let (sender, said) = channel();
    std::thread::spawn(move || {
        lines
            .map_while(Result::ok)
            .for_each(|line| drop(sender.send(line)))
    });
    let patience = Duration::from_secs(30);
    let first = said.recv_timeout(patience).unwrap();
    let name = first.rsplit('/').next().unwrap().to_owned();
    while said.recv_timeout(patience).unwrap() != "going" {}
    (launcher, name, said)
}

#[test]
fn ctrl_c_stops_cleanly() {
    let (mut launcher, name, said) = independent_launcher();
    assert!(is_left_behind(&name) && pid_of(&name, "plant").is_some());
    kill_process(Pid::from_child(&launcher), Signal::INT).unwrap();
    assert!(launcher.wait().unwrap().success());
    assert!(
        said.iter()
            .any(|line| line == "Interrupted { signal: \"SIGINT\" }")
    );
    assert!(!is_left_behind(&name) && pid_of(&name, "plant").is_none());
}

#[test]
fn no_child_outlives_a_killed_launcher_and_its_files_are_found() {
    let (mut launcher, name, _said) = independent_launcher();
    let plant = pid_of(&name, "plant").unwrap();
    kill_process(Pid::from_child(&launcher), Signal::KILL).unwrap();
    launcher.wait().unwrap();
    let until = std::time::Instant::now() + Duration::from_secs(30);
    while pid_of(&name, "plant") == Some(plant) && std::time::Instant::now() < until {
        std::thread::yield_now();
    }
    assert_eq!(pid_of(&name, "plant"), None);
    assert!(
        RunDir::list()
            .iter()
            .any(|run| run.name == name && !run.alive && run.bytes > 0)
    );
    let removed = crate::clean().unwrap();
    assert!(removed.iter().any(|run| run.name == name) && !is_left_behind(&name));
}
