//! One child process: started so that it cannot outlive the launcher, its exit and the end of its standard error recorded.

use std::collections::VecDeque;
use std::io::{BufRead, BufReader};
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use runtime::Exit;
use rustix::process::{
    Pid, PidfdFlags, Signal, getppid, pidfd_open, set_parent_process_death_signal,
};

use crate::delay::Delay;

/// Lines of a child's standard error that are kept.
const LAST_WORDS: usize = 20;
/// How long to wait for the rest of a dead child's standard error.
const LAST_WORDS_LIMIT: Duration = Duration::from_millis(200);

/// A child that has been started and whose exit has not been taken in yet.
pub(crate) struct Child {
    process: std::process::Child,
    pub(crate) pidfd: OwnedFd,
    lines: Receiver<String>,
    last_words: VecDeque<String>,
}

impl Child {
    /// Starts a command in its own process group, so that Ctrl-C in a terminal reaches the launcher only.
    pub(crate) fn start(mut command: Command) -> std::io::Result<Self> {
        let launcher = rustix::process::getpid();
        command
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .process_group(0);
        // SAFETY: between fork and exec only two system calls are made; nothing is allocated or locked.
        unsafe {
            command.pre_exec(move || {
                set_parent_process_death_signal(Some(Signal::KILL))?;
                // The launcher may have died before the line above: then the signal never comes.
                if getppid() == Some(launcher) {
                    Ok(())
                } else {
                    Err(rustix::io::Errno::SRCH.into())
                }
            });
        }
        let mut process = command.spawn()?;
        let (sender, lines) = channel();
        let stderr = process.stderr.take();
        match pidfd_open(pid_of(&process), PidfdFlags::empty()) {
            Ok(pidfd) => {
                if let Some(stderr) = stderr {
                    let read = move || forward(stderr, &sender);
                    if let Err(error) = std::thread::Builder::new()
                        .name("stderr".into())
                        .spawn(read)
                    {
                        let _ = process.kill();
                        let _ = process.wait();
                        return Err(error);
                    }
                }
                Ok(Self {
                    process,
                    pidfd,
                    lines,
                    last_words: VecDeque::new(),
                })
            }
            Err(errno) => {
                let _ = process.kill();
                let _ = process.wait();
                Err(errno.into())
            }
        }
    }

    pub(crate) fn pid(&self) -> u32 {
        self.process.id()
    }

    /// Takes in its exit, if it has ended.
    pub(crate) fn try_wait(&mut self) -> Option<Exit> {
        // An error means that there is nothing to wait for; it cannot happen to a child that has not been waited for.
        self.process.try_wait().ok().flatten().map(Exit::from)
    }

    pub(crate) fn signal(&self, signal: Signal) {
        // It fails when the child has just ended, which the next look shows.
        let _ = rustix::process::pidfd_send_signal(&self.pidfd, signal);
    }

    pub(crate) fn kill_and_wait(&mut self) {
        self.signal(Signal::KILL);
        let _ = self.process.wait();
    }

    /// Whether the kernel has it stopped (SIGSTOP), or a debugger holds it.
    pub(crate) fn halted(&self) -> Option<Delay> {
        let stat =
            std::fs::read_to_string(format!("/proc/{}/stat", self.pid())).unwrap_or_default();
        // The second field is the command in parentheses and may contain anything: count from its end.
        let (_, rest) = stat.rsplit_once(") ")?;
        match rest.chars().next()? {
            'T' => Some(Delay::Stopped),
            't' => Some(Delay::Traced),
            _ => None,
        }
    }

    /// New lines on its standard error.
    pub(crate) fn new_lines(&mut self) -> Vec<String> {
        let lines: Vec<_> = self.lines.try_iter().collect();
        for line in &lines {
            self.last_words.push_back(line.clone());
        }
        let surplus = self.last_words.len().saturating_sub(LAST_WORDS);
        self.last_words.drain(..surplus);
        lines
    }

    /// The lines not yet seen and the last ones before its end.
    pub(crate) fn farewell(&mut self) -> (Vec<String>, Vec<String>) {
        let mut rest = Vec::new();
        while let Ok(line) = self.lines.recv_timeout(LAST_WORDS_LIMIT) {
            self.last_words.push_back(line.clone());
            rest.push(line);
        }
        let surplus = self.last_words.len().saturating_sub(LAST_WORDS);
        (rest, self.last_words.drain(..).skip(surplus).collect())
    }
}

fn pid_of(process: &std::process::Child) -> Pid {
    Pid::from_child(process)
}

fn forward(stderr: impl std::io::Read, lines: &Sender<String>) {
    let mut reader = BufReader::new(stderr);
    let mut line = Vec::new();
    while reader.read_until(b'\n', &mut line).is_ok_and(|n| n > 0) {
        let text = String::from_utf8_lossy(&line).trim_end().to_owned();
        line.clear();
        if lines.send(text).is_err() {
            break;
        }
    }
}
