//! Readers that do not read: a stopped terminal, a full pipe, a stuck viewer. And writers that never end a line.

use std::fs::File;
use std::io::Write;
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::command::{Args, Desk, Known, assert_nothing_left, finish, pid_of, restarts, until};
use crate::life::signal;
use crate::patience::ticks;

/// One end is the program's output, the other one is never read.
struct Unread {
    kept: File,
    output: OwnedFd,
    is_terminal: bool,
}

impl Unread {
    fn terminal() -> Self {
        let (mut kept, mut output) = (0, 0);
        let none = std::ptr::null_mut();
        // SAFETY: two descriptors are written, which nobody else has.
        unsafe {
            let opened = libc::openpty(&mut kept, &mut output, none, none.cast(), none.cast());
            assert_eq!(opened, 0, "a pseudo-terminal");
            Self {
                kept: File::from_raw_fd(kept),
                output: OwnedFd::from_raw_fd(output),
                is_terminal: true,
            }
        }
    }

    fn pipe() -> Self {
        let (kept, output) = std::io::pipe().expect("a pipe");
        Self {
            kept: File::from(OwnedFd::from(kept)),
            output: OwnedFd::from(output),
            is_terminal: false,
        }
    }

    /// From now on nothing more can be written: Ctrl-S, or a full pipe.
    fn stop(&mut self) {
        if self.is_terminal {
            self.kept.write_all(b"\x13").expect("Ctrl-S");
            return;
        }
        // A description of its own: the program's stays blocking.
        let path = format!("/proc/self/fd/{}", self.output.as_raw_fd());
        let mut full = std::os::unix::fs::OpenOptionsExt::custom_flags(
            File::options().write(true),
            libc::O_NONBLOCK,
        )
        .open(path)
        .expect("the pipe");
        while full.write(&[b'.'; 4096]).is_ok() {}
        while full.write(b".").is_ok() {}
    }

    fn start(&self, desk: &Desk, args: impl Args) -> Running {
        let output = || Stdio::from(self.output.try_clone().expect("a descriptor"));
        let mut command = desk.command(args);
        command.stdout(output()).stderr(output());
        Running(command.spawn().expect("armplane starts"))
    }
}

/// A command that is killed where a test fails.
struct Running(Child);

impl Running {
    fn ends_within(&mut self, limit: Duration) -> ExitStatus {
        let began = Instant::now();
        loop {
            if let Some(status) = self.0.try_wait().expect("a child") {
                return status;
            }
            assert!(began.elapsed() < limit, "it has not ended within {limit:?}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Kills a process of the run and waits for its replacement.
    fn replace(&self, process: &str) {
        let killed = pid_of(self.0.id(), process).expect("it lives");
        signal(killed, "KILL");
        until("a replacement", || {
            pid_of(self.0.id(), process).is_some_and(|pid| pid != killed)
        });
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Deaths are mended and Ctrl-C ends the run while nobody can read what the program says.
fn goes_on(unread: fn() -> Unread, mode: &str, interrupts: u32) {
    let desk = Desk::new();
    let mut unread = unread();
    let long = format!("run --set segment.1.duration_s=500 --out results --mode {mode}");
    let mut run = unread.start(&desk, &long);
    until("the first ticks", || ticks(&run.0) > 100);
    unread.stop();
    // Some progress has met the stop.
    std::thread::sleep(Duration::from_millis(300));
    let killed = ["controller", "estimator"];
    for process in killed {
        run.replace(process);
        let before = ticks(&run.0);
        until("more ticks", || ticks(&run.0) > before + 20);
    }
    for _ in 0..interrupts {
        signal(run.0.id().cast_signed(), "INT");
        std::thread::sleep(Duration::from_millis(50));
    }
    let status = run.ends_within(Duration::from_secs(20));
    assert_eq!(
        status.code(),
        Some(1),
        "{status}: an interrupted run, whose results nobody has read"
    );
    let summary = desk.read_json("results/summary.json");
    assert_eq!(summary["outcome"], "interrupted", "{}", summary["reason"]);
    for process in killed {
        let is_listed = |fault: &Value| fault["process"] == process && fault["kind"] == "kill";
        let faults = summary["faults"].list();
        assert_eq!(
            faults.iter().filter(|fault| is_listed(fault)).count(),
            1,
            "{faults:?}"
        );
        assert_eq!(restarts(&summary, process), 1);
    }
    assert_nothing_left(run.0.id());
}

#[test]
fn a_stopped_terminal_and_a_full_pipe_stop_no_run() {
    for (mode, interrupts) in [("lockstep", 1), ("realtime", 2)] {
        goes_on(Unread::terminal, mode, interrupts);
        goes_on(Unread::pipe, mode, 3 - interrupts);
    }
}

#[test]
fn a_run_on_a_stopped_terminal_ends_by_itself() {
    let desk = Desk::new();
    let mut unread = Unread::terminal();
    let short = "run --set segment.1.duration_s=3 --out results";
    let mut run = unread.start(&desk, short);
    unread.stop();
    until("the end of the run", || {
        desk.path().join("results/summary.json").exists()
    });
    run.ends_within(Duration::from_secs(8));
    assert_eq!(
        desk.read_json("results/summary.json")["outcome"],
        "goal reached"
    );
    assert_nothing_left(run.0.id());
}

#[test]
fn results_that_standard_output_does_not_take_are_in_the_exit_code() {
    let desk = Desk::new();
    let read_only = || File::open("/dev/null").expect("a device");
    for args in [
        "run --set settle_s=0 --no-record",
        "list --json",
        "generate schema scenario",
        "run --help",
    ] {
        let full = File::options().write(true).open("/dev/full");
        let outputs = [full.expect("a device"), read_only(), read_only()];
        for (number, output) in outputs.into_iter().enumerate() {
            let mut command = desk.command(args);
            command.stdout(output);
            if number == 2 {
                // SAFETY: close(2) may be called between fork and exec.
                unsafe {
                    command.pre_exec(|| {
                        libc::close(1);
                        Ok(())
                    });
                }
            }
            let said = finish(command.spawn().expect("armplane starts"));
            assert!(
                said.code == 1 && !said.err.is_empty(),
                "{args}: {}",
                said.err
            );
            assert_nothing_left(said.launcher);
        }
    }
}

#[test]
fn ctrl_c_ends_a_command_whose_results_nobody_reads() {
    let desk = Desk::new();
    let mut unread = Unread::pipe();
    unread.stop();
    let mut soak = unread.start(&desk, "drill --soak 60");
    until("the first ticks", || ticks(&soak.0) > 100);
    signal(soak.0.id().cast_signed(), "INT");
    let status = soak.ends_within(Duration::from_secs(20));
    assert_eq!(status.code(), Some(1), "{status}");
    assert_nothing_left(soak.0.id());
}

#[test]
fn ctrl_c_ends_what_computes_before_its_first_file() {
    let desk = Desk::new();
    let segments = "[[segment]]\nduration_s = 600\n".repeat(6);
    desk.file("long.toml", &format!("name = \"x\"\nrobot = \"puma560\"\n[start]\nq_deg = [20, -60, 170, 0, 30, 0]\n{segments}"));
    let unread = Unread::pipe();
    let mut verify = unread.start(&desk, "verify long.toml --runs 1");
    std::thread::sleep(Duration::from_secs(1));
    signal(verify.0.id().cast_signed(), "INT");
    verify.ends_within(Duration::from_secs(2));
    assert_nothing_left(verify.0.id());
}

#[test]
fn every_line_of_a_process_is_printed_or_counted() {
    const LINES: u64 = 100_000;
    let desk = Desk::new();
    let armplane = env!("CARGO_BIN_EXE_armplane");
    let script = format!("seq {LINES} | sed 's/^/mark /' >&2; exec {armplane} analyzer");
    let graph = include_str!("../../shared-types/graph.toml").replace(
        "name = \"analyzer\"",
        &format!("name = \"analyzer\"\ncommand = [\"sh\", \"-c\", {script:?}]"),
    );
    desk.file("graph.toml", &graph);
    let Unread { kept, output, .. } = Unread::pipe();
    let mut command = desk.command("run --graph graph.toml --no-record --out r");
    let run = command.stdout(Stdio::null()).stderr(output).spawn();
    let mut run = Running(run.expect("armplane starts"));
    drop(command);
    run.ends_within(Duration::from_secs(30));
    let printed = std::io::read_to_string(kept).expect("the pipe");
    let printed = printed.matches("mark ").count() as u64;
    let summary = desk.read_json("r/summary.json");
    let dropped = |process: &Value| process["lines_dropped"].count();
    let dropped: u64 = summary["processes"].list().iter().map(dropped).sum();
    assert!(printed > 0 && dropped > 0, "{printed}, {dropped}");
    assert_eq!(printed + dropped, LINES);
}

/// Waits for the end of a command; its largest memory, in MB.
fn peak_mb(child: &Child) -> (ExitStatus, i64) {
    // SAFETY: all zero is a valid value, which the call fills.
    let (mut status, mut usage) = (0, unsafe { std::mem::zeroed::<libc::rusage>() });
    // SAFETY: a child of this process, which nobody else waits for.
    let pid = unsafe { libc::wait4(child.id().cast_signed(), &mut status, 0, &mut usage) };
    assert_eq!(pid, child.id().cast_signed());
    (ExitStatus::from_raw(status), usage.ru_maxrss / 1024)
}

/// Bytes of a line that has no end.
const ENDLESS: u64 = 600 << 20;

#[test]
#[expect(clippy::zombie_processes, reason = "`peak_mb` waits for it")]
fn a_line_without_an_end_costs_no_memory() {
    let desk = Desk::new();
    let armplane = env!("CARGO_BIN_EXE_armplane");
    let script = format!("head -c {ENDLESS} /dev/zero >&2; exec {armplane} analyzer");
    let graph = include_str!("../../shared-types/graph.toml").replace(
        "name = \"analyzer\"",
        &format!("name = \"analyzer\"\ncommand = [\"sh\", \"-c\", {script:?}]"),
    );
    desk.file("graph.toml", &graph);
    let endless = File::create(desk.path().join("endless")).expect("a file");
    endless.set_len(ENDLESS).expect("a sparse file");
    let from_program = &["run", "--graph", "graph.toml", "--no-record", "--json"][..];
    let from_input = &["servo", "ur5", "--from", "-", "--json"][..];
    for args in [from_program, from_input] {
        let input = File::open(desk.path().join("endless")).expect("a file");
        let mut command = Command::new(armplane);
        command.args(args).current_dir(desk.path()).stdin(input);
        let child = command
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("armplane starts");
        let (status, peak) = peak_mb(&child);
        // A line that is no target is in the exit code.
        let expected = i32::from(args.contains(&"-"));
        assert!(
            status.code() == Some(expected) && peak < 300,
            "{args:?}: {status}, {peak} MB"
        );
        assert_nothing_left(child.id());
    }
}
