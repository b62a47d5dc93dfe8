//! A terminal that a command redraws until a key ends it.

use std::io::{IsTerminal, Read, Write, stdin, stdout};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

use session::{Failure, Interrupts};

/// How long a signal may wait.
const LOOK: Duration = Duration::from_millis(50);

/// The terminal's other screen; the first one is as it was when this is dropped.
pub(crate) struct Screen {
    keys: Receiver<u8>,
    /// A signal ends the command, and leaves the terminal as it was.
    signals: Interrupts,
}

impl Screen {
    /// Takes the terminal; `None` where output or input is none.
    ///
    /// # Errors
    /// [`Failure::Work`] where the terminal refuses.
    pub(crate) fn open() -> Result<Option<Self>, Failure> {
        if !(stdout().is_terminal() && stdin().is_terminal()) {
            return Ok(None);
        }
        let signals = session::interrupts()?;
        crossterm::terminal::enable_raw_mode().map_err(Failure::work)?;
        let (send, keys) = channel();
        std::thread::spawn(move || {
            stdin()
                .lock()
                .bytes()
                .map_while(Result::ok)
                .try_for_each(|key| send.send(key))
        });
        put("\x1b[?1049h\x1b[?25l");
        Ok(Some(Self { keys, signals }))
    }

    /// Waits so long; true as soon as q, Ctrl-C or a signal says to end.
    pub(crate) fn ends_within(&mut self, time: Duration) -> bool {
        let until = Instant::now() + time;
        loop {
            let rest = until.saturating_duration_since(Instant::now());
            match self.keys.recv_timeout(rest.min(LOOK)) {
                // Ctrl-C is a key here.
                Ok(b'q' | b'Q' | 3) | Err(RecvTimeoutError::Disconnected) => return true,
                Ok(_) => {}
                Err(RecvTimeoutError::Timeout) => {
                    let is_stopped = self.signals.pending().is_some();
                    if is_stopped || rest.is_zero() {
                        return is_stopped;
                    }
                }
            }
        }
    }

    /// Shows these lines.
    pub(crate) fn show(lines: &[String]) {
        put(&format!("\x1b[H{}\x1b[K\x1b[J", lines.join("\x1b[K\r\n")));
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        put("\x1b[?25h\x1b[?1049l");
        let _ = crossterm::terminal::disable_raw_mode();
    }
}

/// A terminal that is gone is no error.
fn put(text: &str) {
    let mut out = stdout().lock();
    let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
}
