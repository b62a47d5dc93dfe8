//! One child process. It cannot outlive the launcher; its exit and the end of its standard error
//! are recorded.

use std::collections::VecDeque;
use std::io::BufReader;
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
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
/// Bytes of its lines that wait for the launcher. Further lines are dropped, because the child must
/// not wait for its reader.
const WAITING: usize = 1 << 20;

/// A child that has been started and whose exit has not been taken in yet. It ends with this value.
#[derive(Debug)]
pub(crate) struct Child {
    process: std::process::Child,
    pub(crate) pidfd: OwnedFd,
    pub(crate) ear: Arc<Ear>,
}

/// Hears a child's standard error, on a thread that never waits for the launcher.
#[derive(Debug, Default)]
pub(crate) struct Ear {
    heard: Mutex<Heard>,
    ended: Condvar,
}

#[derive(Debug, Default)]
struct Heard {
    /// Lines that the launcher has not taken yet, and their bytes.
    waiting: Vec<String>,
    bytes: usize,
    /// Lines for which there was no room.
    dropped: u64,
    last: VecDeque<String>,
    is_over: bool,
}

impl Ear {
    fn heard(&self) -> MutexGuard<'_, Heard> {
        self.heard.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Lines that have been read and that nobody was or will be given.
    pub(crate) fn unheard(&self) -> u64 {
        let heard = self.heard();
        heard.dropped + heard.waiting.len() as u64
    }

    fn listen(&self, stderr: impl std::io::Read) {
        for line in files::lines(BufReader::new(stderr)).map_while(Result::ok) {
            let heard = &mut *self.heard();
            if heard.last.len() == LAST_WORDS {
                heard.last.pop_front();
            }
            heard.last.push_back(line.clone());
            // An empty line takes room too.
            let bytes = line.len() + size_of::<String>();
            if heard.bytes + bytes > WAITING {
                heard.dropped += 1;
            } else {
                heard.bytes += bytes;
                heard.waiting.push(line);
            }
        }
        self.heard().is_over = true;
        self.ended.notify_all();
    }
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
        // SAFETY: between fork and exec only system calls are made; nothing is allocated or locked.
        unsafe {
            command.pre_exec(move || {
                // Its output stands in the log of the run.
                rustix::stdio::dup2_stdout(rustix::stdio::stderr())?;
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
        let pidfd = pidfd_open(Pid::from_child(&process), PidfdFlags::empty());
        let pidfd = pidfd.inspect_err(|_| {
            let _ = process.kill().and_then(|()| process.wait());
        })?;
        let (stderr, ear) = (process.stderr.take(), Arc::new(Ear::default()));
        let listener = Arc::clone(&ear);
        let child = Self {
            process,
            pidfd,
            ear,
        };
        if let Some(stderr) = stderr {
            let thread = std::thread::Builder::new().name("stderr".into());
            thread.spawn(move || listener.listen(stderr))?;
        }
        Ok(child)
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
        match fields(&self.of_kernel("stat")).next()? {
            "T" => Some(Delay::Stopped),
            "t" => Some(Delay::Traced),
            _ => None,
        }
    }

    /// Whether its end has begun, though it cannot be taken in yet: that of a process with much memory takes milliseconds.
    pub(crate) fn is_dying(&self) -> bool {
        is_dying(&self.of_kernel("stat"), &self.of_kernel("status"))
    }

    /// A file of the kernel on it; empty where it is gone.
    fn of_kernel(&self, file: &str) -> String {
        std::fs::read_to_string(format!("/proc/{}/{file}", self.pid())).unwrap_or_default()
    }

    /// New lines on its standard error.
    pub(crate) fn new_lines(&self) -> Vec<String> {
        let heard = &mut *self.ear.heard();
        heard.bytes = 0;
        std::mem::take(&mut heard.waiting)
    }

    /// The lines not yet seen and the last ones before its end. A descendant may hold its standard error open, and write on.
    pub(crate) fn farewell(&self) -> (Vec<String>, Vec<String>) {
        let goes_on = |heard: &mut Heard| !heard.is_over;
        let waited = self
            .ear
            .ended
            .wait_timeout_while(self.ear.heard(), LAST_WORDS_LIMIT, goes_on);
        let last = waited
            .unwrap_or_else(PoisonError::into_inner)
            .0
            .last
            .drain(..)
            .collect();
        (self.new_lines(), last)
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        self.kill_and_wait();
    }
}

/// The fields of a `stat` from the third on, the state. The second is the command in parentheses and may contain anything: they count from its end.
fn fields(stat: &str) -> impl Iterator<Item = &str> {
    let rest = stat.rsplit_once(") ").map(|(_, rest)| rest.split(' '));
    rest.into_iter().flatten()
}

/// By the kernel's words: the flags of a task that ends (`PF_EXITING`, `PF_SIGNALED`; proc_pid_stat(5), field 9), or a SIGKILL that it has yet to follow.
fn is_dying(stat: &str, status: &str) -> bool {
    const ENDING: u64 = 0x4 | 0x400;
    const KILL: u64 = 1 << (Signal::KILL.as_raw() - 1);
    let flags = fields(stat).nth(6).and_then(|word| word.parse().ok());
    let mut pending = status.lines().filter_map(|line| {
        let word = line
            .strip_prefix("SigPnd:")
            .or(line.strip_prefix("ShdPnd:"))?;
        u64::from_str_radix(word.trim(), 16).ok()
    });
    flags.unwrap_or(0_u64) & ENDING != 0 || pending.any(|signals| signals & KILL != 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_that_ends_is_told_by_its_flags_and_by_the_signal_that_waits_for_it() {
        let stat = |flags| format!("7 (a) b) R 1 7 7 0 -1 {flags} 0 0");
        let status = |own, shared| {
            format!(
                "Name:\ta\nSigPnd:\t{own:016x}\nShdPnd:\t{shared:016x}\nSigBlk:\t{:016x}\n",
                0x100
            )
        };
        for (flags, own, shared, expected) in [
            (0x0040_0000, 0, 0x4000, false),
            (0x0040_0004, 0, 0, true),
            (0x0040_0400, 0, 0, true),
            (0x0040_0000, 0x100, 0, true),
            (0x0040_0000, 0, 0x100, true),
        ] {
            assert_eq!(is_dying(&stat(flags), &status(own, shared)), expected);
        }
        assert!(!is_dying("", ""));
    }

    #[test]
    fn lines_for_which_there_is_no_room_are_dropped_and_the_last_ones_are_kept() {
        let text: String = (0..200_000).map(|line| format!("line {line}\n")).collect();
        let ear = Ear::default();
        ear.listen(text.as_bytes());
        let heard = ear.heard();
        let kept = heard.waiting.len() as u64;
        assert_eq!(heard.dropped + kept, 200_000);
        assert!(
            heard.dropped > 0 && heard.bytes <= WAITING,
            "{kept} are kept"
        );
        let last: Vec<_> = heard.last.iter().collect();
        assert_eq!(
            (last.len(), last[LAST_WORDS - 1].as_str()),
            (LAST_WORDS, "line 199999")
        );
    }
}
