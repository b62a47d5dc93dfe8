//! A session that is steered while it lasts: by keys of a terminal in raw mode, with a line of help and a line of state; or by lines from standard
//! input. Each of them is a target for the operator's socket.

use std::io::{self, BufReader, Read};
use std::os::unix::net::UnixDatagram;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;

use crossterm::terminal::{disable_raw_mode, enable_raw_mode};
use lab::studies::steered;
use operator::{Keys, LONGEST};
use runtime::{ControlPage, RunDir};
use session::Failure;
use session::table::count;
use shared_types::SingularityReport;
use shared_types::scenario::Servo;
use shared_types::target_file::{is_head, live};

use crate::out::{direct, set_status, tell};

/// Pause between two lines of state.
const EVERY: Duration = Duration::from_millis(100);
/// Pause before a line that no process took is sent again.
const AGAIN: Duration = Duration::from_millis(2);

/// The operator's socket, which after a roll-back is another one.
#[derive(Clone, Default)]
pub(crate) struct OperatorSocket(Arc<Mutex<PathBuf>>);

impl OperatorSocket {
    /// The processes of this run are about to start.
    pub(crate) fn move_to(&self, run: &RunDir) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = run.path().join(Servo::SOCKET);
    }

    pub(crate) fn path(&self) -> PathBuf {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }
}

/// The last line of a terminal in raw mode: what the arm does and why, until it is dropped.
pub(crate) struct Panel {
    is_over: Arc<AtomicBool>,
}

impl Panel {
    /// Shows a run that keys steer, whose processes are about to start.
    ///
    /// # Errors
    /// [`Failure::Input`] where standard input is no terminal that can be read key by key.
    pub(crate) fn of_keyboard(run: &RunDir) -> Result<Self, Failure> {
        enable_raw_mode().map_err(|error| {
            Failure::Input(format!(
                "cannot read single keys from the terminal: {error}"
            ))
        })?;
        let page = ControlPage::open(run).map_err(Failure::work)?;
        tell(&Keys::HELP);
        let is_over = Arc::new(AtomicBool::new(false));
        let over = Arc::clone(&is_over);
        std::thread::spawn(move || {
            while !over.load(Ordering::Relaxed) {
                let report = page.latest::<SingularityReport>();
                let kind = |place: usize| report.listed().get(place).map(|one| one.kind);
                set_status(Some(steered::describe(&page.latest(), kind)));
                std::thread::sleep(EVERY);
            }
        });
        Ok(Self { is_over })
    }
}

impl Drop for Panel {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        set_status(None);
        let _ = disable_raw_mode();
    }
}

/// The lines of standard input, as they are sent to a run.
#[derive(Default)]
pub(crate) struct Lines {
    /// Lines that are no target.
    wrong: AtomicU64,
    /// Why there was nothing to follow.
    lack: OnceLock<String>,
}

impl Lines {
    /// Sends the lines to a run; at the end of input the session ends with its last target.
    pub(crate) fn send(
        self: &Arc<Self>,
        operator: &OperatorSocket,
        rate_hz: u32,
    ) -> Result<(), Failure> {
        let heard = Arc::clone(self);
        let socket = UnixDatagram::unbound().map_err(Failure::work)?;
        let operator = operator.clone();
        let input = BufReader::new(direct(&io::stdin()).map_err(Failure::work)?);
        std::thread::spawn(move || {
            let send = |line: &str| {
                // The operator makes its socket when it starts.
                while socket.send_to(line.as_bytes(), operator.path()).is_err() {
                    std::thread::sleep(AGAIN);
                }
            };
            heard.take(files::lines(input), rate_hz, send);
            send(Servo::CLOSE);
        });
        Ok(())
    }

    /// The failure of a session whose input was not all targets.
    pub(crate) fn verdict(&self) -> Result<(), Failure> {
        let lack = self.lack.get();
        let lack = lack.map(|lack| format!("standard input {lack}"));
        let wrong = self.wrong.load(Ordering::Relaxed);
        let wrong = (wrong > 0).then(|| {
            format!(
                "{} of standard input not understood as targets: see the warnings above",
                count(wrong, "line")
            )
        });
        lack.or(wrong)
            .map_or(Ok(()), |reason| Err(Failure::Work(reason)))
    }

    fn take(
        &self,
        lines: impl Iterator<Item = io::Result<String>>,
        rate_hz: u32,
        send: impl Fn(&str),
    ) {
        // Goes with each line: an operator that is started again has not heard the lines before.
        let (mut head, mut has_content) = (String::new(), false);
        for line in lines {
            let mut line = match line {
                Ok(line) => line,
                Err(error) => {
                    self.lack.get_or_init(|| format!("cannot be read: {error}"));
                    return;
                }
            };
            let is_unit = is_head(&line);
            // Longer than any target, and cut: the operator refuses it.
            line.truncate(line.floor_char_boundary(LONGEST));
            if !is_unit {
                // A comment is none.
                if live(&line, 0, rate_hz).next().is_none() {
                    continue;
                }
                line.insert_str(0, &head);
            }
            let is_wrong =
                line.len() >= LONGEST || live(&line, 0, rate_hz).any(|target| target.is_err());
            has_content |= !is_unit || is_wrong;
            self.wrong.fetch_add(is_wrong.into(), Ordering::Relaxed);
            send(&line);
            if is_unit {
                // A unit that cannot be read makes one line with each target after it: so they are refused, too.
                head = line + if is_wrong { " " } else { "\n" };
            }
        }
        if !has_content {
            let lack = "had no target: write lines such as `twist, base, 0.2, 0.01 0 0 0 0 0`";
            self.lack.get_or_init(|| lack.to_owned());
        }
    }
}

/// Begins to read keys.
pub(crate) fn read_keys(operator: &OperatorSocket) -> Result<(), Failure> {
    let socket = UnixDatagram::unbound().map_err(Failure::work)?;
    let operator = operator.clone();
    std::thread::spawn(move || send_keys(&socket, &operator));
    Ok(())
}

fn send_keys(socket: &UnixDatagram, operator: &OperatorSocket) {
    const CTRL_C: u8 = 3;
    let (mut keys, mut is_ending) = (Keys::default(), false);
    for key in std::io::stdin().lock().bytes().map_while(Result::ok) {
        // Where the first does not end the session, the one after the second is a signal again.
        if key == CTRL_C && std::mem::replace(&mut is_ending, true) {
            let _ = disable_raw_mode();
        }
        if let Some(line) = keys.press(key) {
            // The operator may not be there yet, or no longer.
            let _ = socket.send_to(line.as_bytes(), operator.path());
        }
    }
}
