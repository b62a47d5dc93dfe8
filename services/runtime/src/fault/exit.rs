//! The end of a process, as the kernel reports it.

use std::fmt;
use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;

use signal_hook::consts::{SIGABRT, SIGBUS, SIGHUP, SIGINT, SIGQUIT, SIGSEGV, SIGTERM};
use signal_hook::low_level::signal_name;

/// How a process ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// By itself, with this code.
    Code(i32),
    /// By this signal.
    Signal(i32),
}

/// Not among the constants of `signal_hook`, which are of signals that can be caught.
const SIGKILL: i32 = libc::SIGKILL;

/// In the fault table: the upper half says which it is, the lower half has the number. 0: not known.
const CODE: u32 = 1 << 16;
const SIGNAL: u32 = 2 << 16;
const NUMBER: u32 = 0xffff;

impl Exit {
    /// Whether it ended by itself and reported success.
    #[must_use]
    pub fn is_success(self) -> bool {
        self == Self::Code(0)
    }

    /// The signal that has ended it, or the program that it started: a shell's exit code is then 128 and the signal's number.
    #[must_use]
    pub fn signal(self) -> Option<i32> {
        match self {
            Self::Signal(signal) => Some(signal),
            Self::Code(code) => [
                SIGHUP, SIGINT, SIGQUIT, SIGABRT, SIGBUS, SIGKILL, SIGSEGV, SIGTERM,
            ]
            .into_iter()
            .find(|signal| code == 128 + signal),
        }
    }

    pub(super) fn word(self) -> u32 {
        match self {
            Self::Code(code) => CODE | (code as u32 & NUMBER),
            Self::Signal(signal) => SIGNAL | (signal as u32 & NUMBER),
        }
    }

    pub(super) fn of_word(word: u32) -> Option<Self> {
        let number = (word & NUMBER) as i32;
        match word & !NUMBER {
            CODE => Some(Self::Code(number)),
            SIGNAL => Some(Self::Signal(number)),
            _ => None,
        }
    }
}

impl From<ExitStatus> for Exit {
    fn from(status: ExitStatus) -> Self {
        status.code().map_or_else(
            || Self::Signal(status.signal().unwrap_or_default()),
            Self::Code,
        )
    }
}

impl fmt::Display for Exit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Code(code) => write!(f, "exit code {code}"),
            Self::Signal(signal) => write!(
                f,
                "signal {signal} ({})",
                signal_name(signal).unwrap_or("no name")
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_end_survives_the_fault_table() {
        for exit in [
            Exit::Code(0),
            Exit::Code(3),
            Exit::Code(255),
            Exit::Signal(9),
            Exit::Signal(64),
        ] {
            assert_eq!(Exit::of_word(exit.word()), Some(exit));
        }
        assert_eq!(Exit::of_word(0), None);
    }

    #[test]
    fn the_exit_code_of_a_shell_gives_the_signal_that_ended_its_program() {
        let signals = [
            Exit::Signal(9),
            Exit::Code(137),
            Exit::Code(143),
            Exit::Code(1),
            Exit::Code(0),
            Exit::Code(128),
        ]
        .map(Exit::signal);
        assert_eq!(signals, [Some(9), Some(9), Some(15), None, None, None]);
    }
}
