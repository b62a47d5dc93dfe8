//! The end of a process, as the kernel reports it.

use std::fmt;
use std::os::unix::process::ExitStatusExt;
use std::process::ExitStatus;

use signal_hook::low_level::signal_name;

/// How a process ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// By itself, with this code.
    Code(i32),
    /// By this signal.
    Signal(i32),
}

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
        status.code().map_or_else(|| Self::Signal(status.signal().unwrap_or_default()), Self::Code)
    }
}

impl fmt::Display for Exit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Code(code) => write!(f, "exit code {code}"),
            Self::Signal(signal) => write!(f, "signal {signal} ({})", signal_name(signal).unwrap_or("no name")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_end_survives_the_fault_table() {
        for exit in [Exit::Code(0), Exit::Code(3), Exit::Code(255), Exit::Signal(9), Exit::Signal(64)] {
            assert_eq!(Exit::of_word(exit.word()), Some(exit));
        }
        assert_eq!(Exit::of_word(0), None);
    }
}
