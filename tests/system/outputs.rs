//! Readers that do not read: a stopped terminal, a full pipe, a stuck viewer. And writers that never end a line.

use std::fs::File;
use std::io::Write;
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use crate::command::{Desk, Known, Running, assert_nothing_left, restarts, signal, source, until};

/// One end is the program's output, the other one is never read.
struct Unread {
    kept: File,
    output: OwnedFd,
    is_terminal: bool,
}

/// A terminal of so many columns and rows: its keyboard and screen, and the end that a program gets.
pub(crate) fn pseudo_terminal([columns, rows]: [u16; 2]) -> (File, OwnedFd) {
    let (mut terminal, mut end) = (0, 0);
    let size = libc::winsize {
        ws_row: rows,
        ws_col: columns,
        ws_xpixel: 0,
        ws_ypixel: 0,
    };
    let none = std::ptr::null_mut();
    // SAFETY: two descriptors are written, which nobody else has.
    unsafe {
        let opened = libc::openpty(&mut terminal, &mut end, none, none.cast(), &raw const size);
        assert_eq!(opened, 0, "a pseudo-terminal");
        (File::from_raw_fd(terminal), OwnedFd::from_raw_fd(end))
    }
}

impl Unread {
    fn terminal() -> Self {
        let (kept, output) = pseudo_terminal([80, 24]);
        Self {
            kept,
            output,
            is_terminal: true,
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

    fn start(&self, desk: &Desk, args: &str) -> Guarded {
        let output = || Stdio::from(self.output.try_clone().expect("a descriptor"));
        let mut command = desk.command(args);
        command.stdout(output()).stderr(output());
        Guarded(command.spawn().expect("armplane starts"))
    }
}

/// A command that is killed where a test fails.
struct Guarded(Child);

impl Guarded {
    /// Its exit code; nothing is left of it.
    fn ends_within(&mut self, seconds: u64) -> Option<i32> {
        let began = Instant::now();
        loop {
            if let Some(status) = self.0.try_wait().expect("a child") {
                assert_nothing_left(self.0.id());
                return status.code();
            }
            let limit = Duration::from_secs(seconds);
            assert!(began.elapsed() < limit, "it has not ended within {limit:?}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Drop for Guarded {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Deaths are mended and Ctrl-C ends the run while nobody can read what the program says.
fn goes_on(mut unread: Unread, mode: &str, interrupts: u32) {
    let desk = Desk::new();
    let long = format!("run --set segment.1.duration_s=500 --out results --mode {mode}");
    let mut guarded = unread.start(&desk, &long);
    let run = &guarded.0;
    until("the first ticks", || run.ticks() > 100);
    unread.stop();
    // Some progress has met the stop.
    std::thread::sleep(Duration::from_millis(300));
    let killed = ["controller", "estimator"];
    for process in killed {
        let pid = run.pid(process).expect("it lives");
        signal(pid, "KILL");
        until("a replacement", || {
            run.pid(process).is_some_and(|other| other != pid)
        });
        let before = run.ticks();
        until("more ticks", || run.ticks() > before + 20);
    }
    for _ in 0..interrupts {
        run.signal("INT");
        std::thread::sleep(Duration::from_millis(50));
    }
    // An interrupted run, whose results nobody has read.
    assert_eq!(guarded.ends_within(20), Some(1));
    let summary = desk.read_json("results/summary.json");
    summary.holds(r#"{"outcome": "interrupted"}"#);
    for process in killed {
        let faults = summary["faults"].list().iter();
        let listed = faults.filter(|fault| fault["process"] == process && fault["kind"] == "kill");
        assert_eq!(
            (listed.count(), restarts(&summary, process)),
            (1, 1),
            "{summary}"
        );
    }
}

#[test]
fn a_stopped_terminal_and_a_full_pipe_stop_no_run() {
    for (mode, interrupts) in [("lockstep", 1), ("realtime", 2)] {
        goes_on(Unread::terminal(), mode, interrupts);
        goes_on(Unread::pipe(), mode, 3 - interrupts);
    }
}

#[test]
fn a_run_on_a_stopped_terminal_ends_by_itself() {
    let desk = Desk::new();
    let mut unread = Unread::terminal();
    let mut run = unread.start(&desk, "run --set segment.1.duration_s=3 --out results");
    unread.stop();
    until("the end of the run", || desk.has("results/summary.json"));
    run.ends_within(8);
    desk.read_json("results/summary.json")
        .holds(r#"{"outcome": "goal reached"}"#);
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
            let said = command.spawn().expect("armplane starts").finish();
            assert!(
                said.code == 1 && !said.err.is_empty(),
                "{args}: {}",
                said.err
            );
        }
    }
}

#[test]
fn ctrl_c_ends_a_command_whose_results_nobody_reads() {
    let desk = Desk::new();
    let mut unread = Unread::pipe();
    unread.stop();
    let mut drill = unread.start(&desk, "drill --realtime");
    until("the first ticks", || drill.0.ticks() > 100);
    drill.0.signal("INT");
    assert_eq!(drill.ends_within(20), Some(1));
}

#[test]
fn ctrl_c_ends_what_computes_before_its_first_file() {
    let desk = Desk::new();
    let segments = "[[segment]]\nduration_s = 600\n".repeat(6);
    desk.file("long.toml", format!("name = \"x\"\nrobot = \"puma560\"\n[start]\nq_deg = [20, -60, 170, 0, 30, 0]\n{segments}"));
    let unread = Unread::pipe();
    let mut verify = unread.start(&desk, "verify long.toml --runs 1");
    std::thread::sleep(Duration::from_secs(1));
    verify.0.signal("INT");
    verify.ends_within(2);
}

/// A graph whose analyzer says something on standard error before it begins.
fn with_talker(desk: &Desk, says: &str) {
    let script = format!("{says} >&2; exec \"$ARMPLANE\" analyzer");
    let analyzer = "name = \"analyzer\"";
    let command = format!("{analyzer}\ncommand = [\"sh\", \"-c\", {script:?}]");
    let graph = source("shared-types/graph.toml").replace(analyzer, &command);
    desk.file("graph.toml", graph);
}

#[test]
fn every_line_of_a_process_is_printed_or_counted() {
    const LINES: u64 = 100_000;
    let desk = Desk::new();
    with_talker(&desk, &format!("seq {LINES} | sed 's/^/mark /'"));
    let Unread { kept, output, .. } = Unread::pipe();
    let mut command = desk.command("run --graph graph.toml --no-record --out r");
    let run = command.stdout(Stdio::null()).stderr(output).spawn();
    let mut run = Guarded(run.expect("armplane starts"));
    drop(command);
    run.ends_within(30);
    let printed = std::io::read_to_string(kept).expect("the pipe");
    let printed = printed.matches("mark ").count() as u64;
    let summary = desk.read_json("r/summary.json");
    let processes = summary["processes"].list().iter();
    let dropped: u64 = processes
        .map(|process| process["lines_dropped"].count())
        .sum();
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

#[test]
#[expect(clippy::zombie_processes, reason = "`peak_mb` waits for it")]
fn a_line_without_an_end_costs_no_memory() {
    /// Bytes of the line.
    const ENDLESS: u64 = 600 << 20;
    let desk = Desk::new();
    with_talker(&desk, &format!("head -c {ENDLESS} /dev/zero"));
    let endless = File::create(desk.at("endless")).expect("a file");
    endless.set_len(ENDLESS).expect("a sparse file");
    // A line that is no target is in the exit code.
    for (args, code) in [
        ("run --graph graph.toml --no-record --json", 0),
        ("servo ur5 --from - --json", 1),
    ] {
        let mut command = desk.command(args);
        let input = File::open(desk.at("endless")).expect("a file");
        command
            .stdin(input)
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        let child = command.spawn().expect("armplane starts");
        let (status, peak) = peak_mb(&child);
        assert!(
            status.code() == Some(code) && peak < 300,
            "{args}: {status}, {peak} MB"
        );
        assert_nothing_left(child.id());
    }
}
