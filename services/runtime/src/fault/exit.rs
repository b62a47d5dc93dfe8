//! Exit of a process, as the kernel reports it.

use std::fmt;
use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;

use signal_hook::consts::{
    SIGABRT, SIGBUS, SIGFPE, SIGHUP, SIGILL, SIGINT, SIGQUIT, SIGSEGV, SIGSYS, SIGTERM, SIGTRAP,
};
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
    pub fn is_success(self) -> bool {
        self == Self::Code(0)
    }

    /// The signal that has ended it, or the program that it started: a shell's exit code is then 128 and the signal's number.
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

    /// Whether the process ended for a reason of its own: by an exit code, or a signal that the kernel raises for a defect.
    pub fn is_own(self) -> bool {
        const RAISED: [i32; 7] = [SIGILL, SIGTRAP, SIGABRT, SIGBUS, SIGFPE, SIGSEGV, SIGSYS];
        self.signal().is_none_or(|signal| RAISED.contains(&signal))
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
    fn an_end_survives_the_fault_table_and_a_shell_gives_the_signal_of_its_program() {
        let cases = [
            (Exit::Code(0), None),
            (Exit::Code(1), None),
            (Exit::Code(128), None),
            (Exit::Code(137), Some(9)),
            (Exit::Code(143), Some(15)),
            (Exit::Code(255), None),
            (Exit::Signal(9), Some(9)),
            (Exit::Signal(64), Some(64)),
        ];
        for (exit, signal) in cases {
            assert_eq!(
                (Exit::of_word(exit.word()), exit.signal()),
                (Some(exit), signal)
            );
        }
        assert_eq!(Exit::of_word(0), None);
    }
}
