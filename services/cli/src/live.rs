//! A session that is steered while it lasts: keys of a terminal in raw mode, with a line of help and a line of state, or lines from standard input.
//! Each key and each line is a target for the operator's socket.

use std::io::{Read, Write};
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use crossterm::terminal::{disable_raw_mode, enable_raw_mode};
use lab::studies::steered;
use runtime::{ControlPage, RunDir};
use session::Failure;
use shared_types::scenario::Servo;

/// How long a key holds, s: longer than a terminal waits before it repeats one.
const HOLDS_S: f64 = 0.6;
/// Pause between two lines of state.
const EVERY: Duration = Duration::from_millis(100);
/// Pause before a line that no process took is sent again.
const AGAIN: Duration = Duration::from_millis(2);
/// Speed of a key at the start: m/s and rad/s.
const SPEED: (f64, f64) = (0.05, 0.2);

const HELP: &str =
    "w/s x  a/d y  r/f z   i/k turn x  j/l turn y  u/o turn z   + - speed   1 base 2 hand 3 singular   x side   space stop   q end";

/// A terminal that steers; its mode is restored when it is dropped.
pub(crate) struct Keyboard {
    is_over: Arc<AtomicBool>,
}

impl Keyboard {
    /// Begins to read keys for a run whose processes are about to start.
    ///
    /// # Errors
    /// [`Failure::Input`] where standard input is no terminal.
    pub(crate) fn start(run: &RunDir) -> Result<Self, Failure> {
        let page = ControlPage::open(run).map_err(Failure::work)?;
        let socket = UnixDatagram::unbound().map_err(Failure::work)?;
        enable_raw_mode().map_err(|error| {
            Failure::Input(format!("standard input is no terminal ({error}); give targets with --from FILE, or --from -"))
        })?;
        eprint!("{HELP}\r\n");
        let is_over = Arc::new(AtomicBool::new(false));
        let (over, path) = (Arc::clone(&is_over), run.path().join(Servo::SOCKET));
        std::thread::spawn(move || read_keys(&socket, &path));
        std::thread::spawn(move || {
            while !over.load(Ordering::Relaxed) {
                // To the beginning of the line, and clear it.
                eprint!("\r\x1b[K{}", steered::describe(&page.live_state().servo));
                let _ = std::io::stderr().flush();
                std::thread::sleep(EVERY);
            }
        });
        Ok(Self { is_over })
    }
}

/// Sends the lines of standard input to a run; at the end of input the session ends with its last target.
pub(crate) fn send_lines(run: &RunDir) -> Result<(), Failure> {
    let (socket, path) = (UnixDatagram::unbound().map_err(Failure::work)?, run.path().join(Servo::SOCKET));
    std::thread::spawn(move || {
        for line in std::io::stdin().lines().map_while(Result::ok).chain([Servo::CLOSE.to_owned()]) {
            // The operator makes its socket when it starts.
            while socket.send_to(line.as_bytes(), &path).is_err() && path.parent().is_some_and(|run| run.exists()) {
                std::thread::sleep(AGAIN);
            }
        }
    });
    Ok(())
}

impl Drop for Keyboard {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        let _ = disable_raw_mode();
        eprintln!();
    }
}

fn read_keys(socket: &UnixDatagram, path: &Path) {
    let mut keys = Keys::default();
    for key in std::io::stdin().lock().bytes().map_while(Result::ok) {
        if let Some(line) = keys.press(key) {
            // The operator may not be there yet, or no longer.
            let _ = socket.send_to(line.as_bytes(), path);
        }
    }
}

/// Frame, speed and side as the keys have set them.
struct Keys {
    frame: &'static str,
    side: &'static str,
    factor: f64,
}

impl Default for Keys {
    fn default() -> Self {
        Self { frame: "base", side: "keep", factor: 1.0 }
    }
}

impl Keys {
    /// The target of a key; `None` for one that only changes a setting, or none.
    fn press(&mut self, key: u8) -> Option<String> {
        let axis = match key {
            b'w' | b's' => 0,
            b'a' | b'd' => 1,
            b'r' | b'f' => 2,
            b'i' | b'k' => 3,
            b'j' | b'l' => 4,
            b'u' | b'o' => 5,
            b' ' => 6,
            // Ctrl-C and Ctrl-D too.
            b'q' | 3 | 4 => return Some(Servo::END.to_owned()),
            other => {
                self.set(other);
                return None;
            }
        };
        let sign = if b"sdfklo".contains(&key) { -1.0 } else { 1.0 };
        let mut twist = [0.0; 6];
        if axis < 6 {
            twist[axis] = sign * self.factor * if axis < 3 { SPEED.0 } else { SPEED.1 };
        }
        let values: Vec<String> = twist.iter().map(f64::to_string).collect();
        Some(format!("twist, {}, {HOLDS_S}, {}, {}", self.frame, values.join(" "), self.side))
    }

    fn set(&mut self, key: u8) {
        match key {
            b'1' => self.frame = "base",
            b'2' => self.frame = "hand",
            b'3' => self.frame = "singular",
            b'+' | b'=' => self.factor = (self.factor * 1.25).min(8.0),
            b'-' => self.factor = (self.factor / 1.25).max(0.05),
            b'x' => {
                self.side = match self.side {
                    "keep" => "positive",
                    "positive" => "negative",
                    _ => "keep",
                };
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_types::codes::{FRAME_HAND, SIDE_POSITIVE, TARGET_END, TARGET_TWIST};
    use shared_types::target_file::content;

    #[test]
    fn every_key_is_a_target_that_the_operator_reads() {
        let mut keys = Keys::default();
        let mut press = |key: u8| keys.press(key).map(|line| content(&line, 1.0, 0, 1000).unwrap());
        assert_eq!(press(b'd').unwrap().twist, [0.0, -0.05, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!((press(b'2'), press(b'x')), (None, None));
        let turned = press(b'u').unwrap();
        assert_eq!((turned.kind, turned.frame, turned.side, turned.twist[5]), (TARGET_TWIST, FRAME_HAND, SIDE_POSITIVE, 0.2));
        assert_eq!((press(b' ').unwrap().twist, press(3).unwrap().kind), ([0.0; 6], TARGET_END));
    }
}
